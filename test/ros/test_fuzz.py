"""Fuzzing of the border: any bytes and any numbers give an answer or one sentence, and nothing blind drives.

`--hypothesis-profile search` looks at a hundred times as many.
"""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import copy
import io
import math
from pathlib import Path
from typing import Any, List, Optional

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from helpers import REPOSITORY, default_calibration, jpeg_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header
from unit.shipped import avoidance_settings, detection_settings

from obst_avoid.core import detection
from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.calibration import CalibrationError, load_calibration
from obst_avoid.core.picture import PictureError
from obst_avoid.core.types import Stamped, State
from obst_avoid.msg import LaneControl, LanePose, Twist2DStamped
from obst_avoid.ros import border

FRAME = 'duck1/footprint'
START = 1_700_000_000_000_000_000
MS = 1_000_000
anything = st.floats(width=32) | st.sampled_from([0.0, math.nan, math.inf, -math.inf, 3e38, 1e-45, -1e-45])
usual = st.floats(-2.0, 2.0, width=32)
some = anything | usual
stamps = st.integers(0, 2**32 - 1)
JPEG = jpeg_of()


def message_bytes(msg: Any) -> bytes:
    """As it is on the wire."""
    buffer = io.BytesIO()
    msg.serialize(buffer)
    return buffer.getvalue()


poses = st.builds(lambda x, y, z, q: Pose(Point(x, y, z), Quaternion(*q)), some, some, some, st.tuples(*[some] * 4))
pose_arrays = st.builds(
    lambda items, frame: PoseArray(Header(frame_id=frame), items),
    st.lists(poses, max_size=4),
    st.sampled_from([FRAME, '/' + FRAME, FRAME, 'duck2/footprint', '', '\N{DUCK}']),
)
lane_poses = st.builds(
    lambda d, phi, curvature, covariance: LanePose(
        d=d, phi=phi, curvature=curvature, d_phi_covariance=list(covariance)
    ),
    some, some, some, st.tuples(*[some] * 4),
)  # fmt: skip
commands = st.builds(lambda v, omega: Twist2DStamped(v=v, omega=omega), some, some)


def read(function: Any, *arguments: Any) -> Any:
    """What the border makes of it; None: it refuses, in one sentence."""
    try:
        return function(*arguments)
    except (border.BorderError, PictureError, CalibrationError) as error:
        sentence = str(error)
    assert sentence and '\n' not in sentence
    return None


@given(sequence=st.lists(st.tuples(pose_arrays, lane_poses, lane_poses, commands, st.integers(0, 900)), max_size=5))
def test_whatever_is_heard_the_avoider_decides(sequence: List[Any]) -> None:
    rules, inputs, memory, now = avoidance_settings(), Inputs(), Memory(), START
    for array, pose, own, command, milliseconds in sequence:
        now += milliseconds * MS
        obstacles = read(border.obstacles_from_pose_array, array, FRAME)
        filtered, lines = read(border.lane_pose_from_msg, pose), read(border.lane_pose_from_msg, own)
        told = read(border.command_from_msg, command)
        inputs = Inputs(
            inputs.obstacles if obstacles is None else Stamped(now, obstacles),
            inputs.lane_pose if filtered is None else Stamped(now, filtered),
            inputs.own_lane_pose if lines is None else Stamped(now, lines),
            inputs.commands if told is None else (*inputs.commands, Stamped(now, told)),
        )
        decision, memory = decide(inputs, memory, now, rules)
        assert 0 <= decision.v_ref <= rules.cruise_speed
        assert abs(decision.d_ref) <= rules.lane_width / 2
        if inputs.obstacles is None or (inputs.lane_pose is None and inputs.own_lane_pose is None):
            assert decision.state is State.FAULT
        border.lane_control_from_decision(decision, now)


@given(state=st.integers(0, 255), active=st.booleans(), d_ref=some, v_ref=some)
def test_any_lane_control_is_taken_whole_or_refused(state: int, active: bool, d_ref: float, v_ref: float) -> None:
    found = read(border.reference_from_lane_control, LaneControl(state=state, active=active, d_ref=d_ref, v_ref=v_ref))
    if found is not None:
        assert math.isfinite(found.d_ref) and math.isfinite(found.v_ref) and found.v_ref >= 0


@given(
    height=st.integers(0, 40), width=st.integers(0, 40), step=st.integers(0, 2**32 - 1) | st.integers(0, 200),
    encoding=st.sampled_from(['bgr8', 'rgb8', 'mono8', 'bayer_rggb8', '16UC3', '8UC3', 'yuv422', 'bgr8 ', '', 'x']),
    size=st.integers(0, 6000),
)  # fmt: skip
def test_any_raw_picture(height: int, width: int, step: int, encoding: str, size: int) -> None:
    msg = Image(height=height, width=width, step=step, encoding=encoding, data=bytes(size))
    found = read(border.picture_from_image, msg)
    assert found is None or (found.shape == (height, width, 3) and found.dtype == np.uint8)


@given(data=st.binary(max_size=400) | st.builds(lambda a, b: JPEG[:a] + b, st.integers(0, len(JPEG)), st.binary()))
def test_any_compressed_picture(data: bytes) -> None:
    found = read(border.picture_from_compressed_image, CompressedImage(data=data))
    assert found is None or found.dtype == np.uint8


@settings(max_examples=15, suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 2**31), kind=st.sampled_from(['noise', 'blocks', 'flipped', 'black', 'white']))
def test_any_picture_gives_obstacles_or_none(seed: int, kind: str) -> None:
    random = np.random.RandomState(seed)
    if kind == 'flipped':  # a JPEG with wrong bits decodes to something
        data = bytearray(JPEG)
        for at in random.randint(20, len(data) - 2, 8):
            data[at] ^= 1 << random.randint(8)
        picture: Optional[Any] = read(border.picture_from_compressed_image, CompressedImage(data=bytes(data)))
    elif kind in ('noise', 'blocks'):
        size = (480, 640, 3) if kind == 'noise' else (24, 32, 3)
        picture = random.randint(0, 256, size).astype(np.uint8)
        picture = picture if kind == 'noise' else np.kron(picture, np.ones((20, 20, 1), np.uint8))
    else:
        picture = np.full((480, 640, 3), 0 if kind == 'black' else 255, np.uint8)
    detector = detection.start(default_calibration(), detection_settings())
    for index in range(3 if picture is not None else 0):
        scene, detector = detection.detect(detector, picture, START + index * 33 * MS, ())
        assert border.pose_array_from_obstacles(scene.obstacles, START, FRAME) is not None
        assert all(math.isfinite(value) for one in scene.obstacles for value in (one.x, one.y, one.radius))


@given(data=st.data())
def test_bytes_of_a_message_that_were_changed(data: Any) -> None:
    msg = PoseArray(Header(frame_id=FRAME), [Pose(Point(0.5, 0.0, 0.03), Quaternion(100, 160, 300, 330))])
    raw = bytearray(message_bytes(msg))
    for _ in range(data.draw(st.integers(1, 6))):
        raw[data.draw(st.integers(24, len(raw) - 1))] = data.draw(st.integers(0, 255))
    try:
        found = PoseArray().deserialize(bytes(raw))
    except Exception:  # rospy logs what does not deserialise, and drops it
        return
    obstacles = read(border.obstacles_from_pose_array, found, FRAME)
    assert obstacles is None or all(math.isfinite(one.x + one.y + one.radius) for one in obstacles)


FILES = {
    kind: yaml.safe_load((REPOSITORY / 'config' / 'calibrations' / kind / 'default.yaml').read_text())
    for kind in ('camera_intrinsic', 'camera_extrinsic')
}
values = (
    st.none() | st.booleans() | some | st.integers(-(10**9), 10**9) | st.text(max_size=5) | st.lists(some, max_size=9)
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(data=st.data())
def test_any_change_of_a_calibration_is_taken_or_refused(tmp_path: Path, data: Any) -> None:
    kind = data.draw(st.sampled_from(sorted(FILES)))
    content = copy.deepcopy(FILES)
    target = content[kind]
    for _ in range(data.draw(st.integers(1, 3))):
        key = data.draw(st.sampled_from(sorted(target)))
        inner = target[key]
        if isinstance(inner, dict) and data.draw(st.booleans()):
            target, key = inner, data.draw(st.sampled_from(sorted(inner)))
            inner = target[key]
        if isinstance(inner, list) and inner and data.draw(st.booleans()):
            inner[data.draw(st.integers(0, len(inner) - 1))] = data.draw(values)
        else:
            target[key] = data.draw(values)
        target = content[kind]
    for name, written in content.items():
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / name / 'duck1.yaml').write_text(yaml.safe_dump(written))
    found = read(load_calibration, str(tmp_path), 'duck1')
    assert found is None or np.isfinite(found.homography).all()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode('utf-8', 'surrogatepass')))
def test_any_bytes_for_a_calibration(tmp_path: Path, data: bytes) -> None:
    for name in FILES:
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / name / 'duck1.yaml').write_bytes(data)
    with pytest.raises(CalibrationError):
        load_calibration(str(tmp_path), 'duck1')
