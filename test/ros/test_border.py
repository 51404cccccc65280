"""The border between messages and types: round trips, refusals, and the wire format that others rely on."""

import io
import math
from typing import Any

import cv2
import genpy
import numpy as np
import pytest
from cv_bridge import CvBridge
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from hypothesis import assume, given
from hypothesis import strategies as st
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from obst_avoid import msg as messages
from obst_avoid.core.lane_control import Reference
from obst_avoid.core.picture import PictureError, encode_jpeg
from obst_avoid.core.types import Box, Command, Decision, Kind, LanePose, Obstacle, State
from obst_avoid.ros import border

FRAME = 'duck1/footprint'
EXACT = 1_500_000_000_123_456_789
"""[ns] A stamp that a float would round."""

metres = st.floats(min_value=-10, max_value=10)
pixels = st.floats(min_value=0, max_value=640)
floats32 = st.floats(min_value=-10, max_value=10, width=32)
boxes = st.builds(Box, left=pixels, top=pixels, right=pixels, bottom=pixels)
obstacles = st.builds(
    Obstacle,
    kind=st.none(),
    x=metres,
    y=metres,
    radius=st.floats(min_value=1e-6, max_value=1),
    in_lane=st.booleans(),
    bird_box=boxes,
)
stamps = st.integers(min_value=0, max_value=(2**32 - 1) * 10**9 + 10**9 - 1)


def on_the_wire(msg: Any) -> Any:
    """The message as it arrives: every number as wide as its field."""
    buffer = io.BytesIO()
    msg.serialize(buffer)
    return type(msg)().deserialize(buffer.getvalue())


@given(st.lists(obstacles), stamps)
def test_obstacles_come_back(seen: Any, stamp: int) -> None:
    msg = on_the_wire(border.pose_array_from_obstacles(seen, stamp, FRAME))
    assert border.obstacles_from_pose_array(msg, FRAME) == seen
    assert border.nanoseconds(msg.header.stamp) == stamp
    assert msg.header.frame_id == FRAME


def test_an_empty_list_comes_back() -> None:
    msg = on_the_wire(border.pose_array_from_obstacles([], EXACT, FRAME))
    assert msg.poses == []
    assert border.obstacles_from_pose_array(msg, FRAME) == []


def test_what_stands_where_on_the_wire() -> None:
    seen = Obstacle(Kind.DUCKIE, 0.6, -0.1, 0.03, False, bird_box=Box(left=3, top=1, right=4, bottom=2))
    pose = border.pose_array_from_obstacles([seen], EXACT, FRAME).poses[0]
    assert pose == Pose(Point(0.6, -0.1, -0.03), Quaternion(1, 2, 3, 4))


@pytest.mark.parametrize(('in_lane', 'z', 'back'), [(True, 0.03, True), (False, -0.03, False), (None, 0.03, True)])
def test_side_of_the_line(in_lane: Any, z: float, back: bool) -> None:
    seen = Obstacle(Kind.CONE, 0.6, 0.1, 0.03, in_lane, bird_box=Box(0, 0, 1, 1))
    msg = border.pose_array_from_obstacles([seen], 0, FRAME)
    assert msg.poses[0].position.z == z
    assert border.obstacles_from_pose_array(msg, FRAME)[0].in_lane is back


def test_what_the_wire_does_not_carry_comes_back_as_unknown() -> None:
    seen = Obstacle(Kind.CONE, 0.6, 0.1, 0.03, True, confidence=0.4, image_box=Box(1, 2, 3, 4))
    back = border.obstacles_from_pose_array(border.pose_array_from_obstacles([seen], 0, FRAME), FRAME)[0]
    assert back.kind is None
    assert back.image_box is None
    assert back.bird_box == Box(0, 0, 0, 0)


@pytest.mark.parametrize('frame', ['duck1/footprint', '/duck1/footprint'])
def test_frames_that_are_ours(frame: str) -> None:
    assert border.obstacles_from_pose_array(PoseArray(Header(frame_id=frame), []), FRAME) == []


@pytest.mark.parametrize(
    'frame', ['', 'footprint', 'duck2/footprint', 'duck1/footprint/', 'duck1/camera_optical_frame']
)
def test_frames_that_are_not(frame: str) -> None:
    with pytest.raises(border.BorderError, match="is in frame '%s', expected 'duck1/footprint'" % frame):
        border.obstacles_from_pose_array(PoseArray(Header(frame_id=frame), []), FRAME)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ('part', 'field', 'name'),
    [('position', field, field) for field in 'xyz']
    + [('orientation', field, name) for field, name in zip('xyzw', ('top', 'bottom', 'left', 'right'))],
)
def test_numbers_that_are_none_in_an_obstacle_list(part: str, field: str, name: str, value: float) -> None:
    poses = [Pose(Point(0.5, 0, 0.02), Quaternion(1, 2, 3, 4)) for _ in range(2)]
    setattr(getattr(poses[1], part), field, value)
    with pytest.raises(border.BorderError, match='obstacle 1 has %s = .*, expected a finite number' % name):
        border.obstacles_from_pose_array(PoseArray(Header(frame_id=FRAME), poses), FRAME)


@pytest.mark.parametrize('z', [0.0, -0.0])
def test_a_radius_of_nothing(z: float) -> None:
    msg = PoseArray(Header(frame_id=FRAME), [Pose(Point(0.5, 0, z), Quaternion())])
    with pytest.raises(border.BorderError, match='obstacle 0 has z = 0, expected its radius'):
        border.obstacles_from_pose_array(msg, FRAME)


def within(name: str) -> Any:
    """What the border takes of a field."""
    return st.floats(min_value=-border.LARGEST[name], max_value=border.LARGEST[name], width=32)


@given(within('d'), within('phi'), within('curvature'), stamps)
def test_lane_poses_come_back(d: float, phi: float, curvature: float, stamp: int) -> None:
    pose = LanePose(d, phi, curvature)
    msg = on_the_wire(border.msg_from_lane_pose(pose, stamp, messages.LanePose))
    assert border.lane_pose_from_msg(msg) == pose
    assert border.nanoseconds(msg.header.stamp) == stamp


variances = st.floats(min_value=0, max_value=10, width=32, exclude_min=True)


@given(variances, floats32, variances, stamps)
def test_covariances_come_back(dd: float, dp: float, pp: float, stamp: int) -> None:
    assume(dp**2 <= dd * pp)
    pose = LanePose(0.0, 0.0, 0.0, (dd, dp, dp, pp))
    msg = on_the_wire(border.msg_from_lane_pose(pose, stamp, messages.LanePose))
    assert tuple(msg.d_phi_covariance) == pose.covariance
    assert border.lane_pose_from_msg(msg) == pose


def test_a_covariance_that_is_not_known_is_zeros_on_the_wire() -> None:
    msg = on_the_wire(border.msg_from_lane_pose(LanePose(0.5, 0.25), EXACT, messages.LanePose))
    assert tuple(msg.d_phi_covariance) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    'covariance',
    [
        (0, 0, 0, 0),
        (1, 0, 0, 0),
        (0, 0, 0, 1),
        (-1, 0, 0, 1),
        (1e-4, 0.02, 0.02, 1e-4),
        (math.nan, 0, 0, 1),
        (1, 0, math.inf, 1),
        (1, 0, 0, math.nan),
    ],
)
def test_what_is_no_covariance_is_not_known(covariance: Any) -> None:
    assert border.lane_pose_from_msg(messages.LanePose(d_phi_covariance=covariance)) == LanePose(0.0, 0.0)


@pytest.mark.parametrize('field', ['d', 'phi', 'curvature'])
def test_numbers_that_are_none_in_a_lane_pose(field: str) -> None:
    for value in (math.nan, math.inf):
        with pytest.raises(border.BorderError, match='the lane pose has %s = ' % field):
            border.lane_pose_from_msg(messages.LanePose(**{field: value}))


def test_in_lane_alone_is_no_reason_to_refuse_a_lane_pose() -> None:
    msg = messages.LanePose(d=0.1, in_lane=False, d_ref=math.nan, d_phi_covariance=[math.nan] * 4)
    assert border.lane_pose_from_msg(msg).d == pytest.approx(0.1)


@given(
    st.sampled_from(list(State)), floats32, st.floats(min_value=0, max_value=2, width=32), st.text(max_size=80), stamps
)
def test_decisions_come_back(state: State, d_ref: float, v_ref: float, reason: str, stamp: int) -> None:
    decision = Decision(state, d_ref, v_ref, reason)
    msg = on_the_wire(border.lane_control_from_decision(decision, stamp))
    assert border.decision_from_lane_control(msg) == decision
    assert msg.active == (state is not State.CLEAR)
    assert border.nanoseconds(msg.header.stamp) == stamp


@pytest.mark.parametrize('state', list(State))
def test_states_have_the_numbers_of_the_message(state: State) -> None:
    assert getattr(messages.LaneControl, state.name) == state.value


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'d_ref': math.nan}, 'd_ref = nan'),
        ({'v_ref': math.inf}, 'v_ref = inf'),
        ({'state': 7}, 'has state 7'),
        ({'active': False}, 'active False'),
        ({'state': 0}, 'has state 0, active True'),
        ({'v_ref': -0.1}, 'v_ref -0.1'),
    ],
)
def test_lane_control_that_contradicts_itself(changes: Any, words: str) -> None:
    fields = {'state': messages.LaneControl.AVOIDING, 'active': True, 'd_ref': 0.02, 'v_ref': 0.1}
    border.decision_from_lane_control(messages.LaneControl(**fields))
    fields.update(changes)
    with pytest.raises(border.BorderError, match=words):
        border.decision_from_lane_control(messages.LaneControl(**fields))


def test_the_reference_is_what_the_controller_tracks() -> None:
    msg = border.lane_control_from_decision(Decision(State.AVOIDING, 0.5, 0.25, ''), 0)
    assert border.reference_from_lane_control(msg) == Reference(True, 0.5, 0.25)


@pytest.mark.parametrize('state', list(State))
def test_the_flag_is_false_exactly_in_clear(state: State) -> None:
    msg = border.flag_from_decision(Decision(state, 0, 0, ''), EXACT, messages.BoolStamped)
    assert msg.data is (state is not State.CLEAR)
    assert border.nanoseconds(msg.header.stamp) == EXACT


@given(within('v'), within('omega'), stamps)
def test_commands_come_back(v: float, omega: float, stamp: int) -> None:
    msg = on_the_wire(border.msg_from_command(Command(v, omega), stamp, messages.Twist2DStamped))
    assert border.command_from_msg(msg) == Command(v, omega)
    assert border.nanoseconds(msg.header.stamp) == stamp


@pytest.mark.parametrize('field', ['v', 'omega'])
def test_numbers_that_are_none_in_a_command(field: str) -> None:
    with pytest.raises(border.BorderError, match='the car command has %s = nan' % field):
        border.command_from_msg(messages.Twist2DStamped(**{field: math.nan}))


@given(stamps)
def test_stamps_come_back(stamp: int) -> None:
    assert border.nanoseconds(border.ros_time(stamp)) == stamp
    time = genpy.Time(stamp // 10**9, stamp % 10**9)
    assert border.ros_time(border.nanoseconds(time)) == time


def test_frames_are_named_after_the_robot() -> None:
    assert border.footprint_frame('duck1') == 'duck1/footprint'
    assert border.camera_frame('duck1') == 'duck1/camera_optical_frame'


def random_picture() -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (24, 32, 3), dtype=np.uint8)


def test_compressed_pictures_come_back() -> None:
    smooth = cv2.GaussianBlur(random_picture(), (0, 0), 5)
    msg = on_the_wire(border.compressed_image_from_jpeg(encode_jpeg(smooth, 98), EXACT, 'camera'))
    assert (msg.format, msg.header.frame_id, border.nanoseconds(msg.header.stamp)) == ('jpeg', 'camera', EXACT)
    back = border.picture_from_compressed_image(msg)
    assert back.shape == smooth.shape
    assert np.abs(back.astype(int) - smooth).mean() < 6


def test_a_compressed_picture_of_nothing() -> None:
    with pytest.raises(PictureError, match='is empty'):
        border.picture_from_compressed_image(CompressedImage())


def test_raw_pictures_come_back() -> None:
    picture = random_picture()
    msg = on_the_wire(border.image_from_picture(picture, EXACT, 'camera'))
    assert (msg.encoding, msg.width, msg.height) == ('bgr8', 32, 24)
    assert (msg.header.frame_id, border.nanoseconds(msg.header.stamp)) == ('camera', EXACT)
    assert np.array_equal(border.picture_from_image(msg), picture)


@pytest.mark.parametrize('encoding', ['rgb8', 'bgra8', 'rgba8'])
def test_other_colour_orders(encoding: str) -> None:
    code = {'rgb8': cv2.COLOR_BGR2RGB, 'bgra8': cv2.COLOR_BGR2BGRA, 'rgba8': cv2.COLOR_BGR2RGBA}[encoding]
    picture = random_picture()
    msg = CvBridge().cv2_to_imgmsg(cv2.cvtColor(picture, code), encoding)
    back = border.picture_from_image(msg)
    assert np.array_equal(back, picture)


@pytest.mark.parametrize('step', [99, 100, 128])
def test_rows_with_padding(step: int) -> None:
    # Cameras align their rows; cv_bridge up to 1.16 takes the padding for pixels.
    picture = random_picture()
    padded = np.zeros((24, step), dtype=np.uint8)
    padded[:, :96] = picture.reshape(24, 96)
    msg = Image(encoding='bgr8', width=32, height=24, step=step, data=padded.tobytes())
    assert np.array_equal(border.picture_from_image(msg), picture)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'encoding': 'mono8', 'step': 32}, 'encoding mono8, expected colour'),
        ({'encoding': 'mono16'}, 'encoding mono16, expected colour'),
        ({'encoding': 'banana'}, 'banana'),
        ({'encoding': ''}, 'encoding'),
        ({'height': 25}, 'has 2304 bytes, expected 25 rows of 96'),
        ({'width': 33}, 'has 2304 bytes, expected 24 rows of 99'),
        ({'step': 97}, 'has 2304 bytes, expected 24 rows of 97'),
        ({'data': b''}, 'has 0 bytes'),
        ({'width': 0, 'height': 0}, 'picture'),
        ({'width': 8, 'height': 8}, 'at least 16x16'),
        ({'encoding': '32FC3', 'width': 8, 'height': 24}, 'picture'),
    ],
)
def test_raw_pictures_that_are_refused(changes: Any, words: str) -> None:
    fields = {'encoding': 'bgr8', 'width': 32, 'height': 24, 'step': 96, 'data': random_picture().tobytes()}
    border.picture_from_image(Image(**fields))
    fields.update(changes)
    with pytest.raises(PictureError, match=words):
        border.picture_from_image(Image(**fields))


@pytest.mark.parametrize(
    ('cls', 'fields'),
    [
        (
            messages.LanePose,
            'std_msgs/Header header, float32 d, float32 d_ref, float32 phi, float32 phi_ref, '
            'float32[4] d_phi_covariance, float32 curvature, float32 curvature_ref, float32 v_ref, '
            'int32 status, bool in_lane',
        ),
        (messages.BoolStamped, 'std_msgs/Header header, bool data'),
        (messages.Twist2DStamped, 'std_msgs/Header header, float32 v, float32 omega'),
        (
            messages.LaneControl,
            'std_msgs/Header header, float32 d_ref, float32 v_ref, bool active, uint8 state, string reason',
        ),
    ],
)
def test_fields_of_the_messages(cls: Any, fields: str) -> None:
    # A change breaks recorded bags, and the robots whose own messages have these fields.
    assert ', '.join('%s %s' % pair for pair in zip(cls._slot_types, cls.__slots__)) == fields


def test_constants_of_lane_control() -> None:
    cls = messages.LaneControl
    assert (cls.CLEAR, cls.SLOWING, cls.AVOIDING, cls.STOPPED, cls.FAULT) == (0, 1, 2, 3, 4)
