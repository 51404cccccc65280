"""The one border between messages and types: what is encoded on the wire is undone here and nowhere else.

Functions come in pairs. Those that read refuse NaN, a wrong encoding, and on PoseArray a wrong frame, with BorderError.
"""

import math
from typing import Any, List, Sequence

import genpy
import numpy as np
from cv_bridge import CvBridge, CvBridgeError
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.daffy import Pace
from obst_avoid.core.lane_control import Reference, reference_from_decision
from obst_avoid.core.picture import PictureError, check_picture, decode_jpeg
from obst_avoid.core.types import Array, Box, Command, Decision, LanePose, Obstacle, State
from obst_avoid.msg import LaneControl

_BRIDGE = CvBridge()
LARGEST = {'d': 5.0, 'phi': 10.0, 'curvature': 50.0, 'v': 5.0, 'omega': 50.0, 'x': 1e3, 'y': 1e3, 'z': 10.0}
"""[m, rad, 1/m, m/s, rad/s] What is farther from 0 is no road, no robot and no duckie, and arithmetic breaks on it."""


class BorderError(ValueError):
    """A message that must not be used. The message says what was found and what was expected."""


def footprint_frame(veh: str) -> str:
    """Name of the robot frame."""
    return veh + '/footprint'


def camera_frame(veh: str) -> str:
    """Name of the camera frame."""
    return veh + '/camera_optical_frame'


def nanoseconds(stamp: genpy.Time) -> int:
    """A ROS stamp as a whole number; floats would lose the last digits."""
    return int(stamp.secs) * 10**9 + int(stamp.nsecs)


def ros_time(stamp: int) -> genpy.Time:
    """The inverse of nanoseconds."""
    return genpy.Time(stamp // 10**9, stamp % 10**9)


def pose_array_from_obstacles(obstacles: Sequence[Obstacle], stamp: int, frame_id: str) -> PoseArray:
    """The report's interface. z is the radius, negative for an obstacle outside the lane; unknown counts as inside."""
    poses = []
    for obstacle in obstacles:
        box = obstacle.bird_box or Box(0, 0, 0, 0)
        z = -obstacle.radius if obstacle.in_lane is False else obstacle.radius
        poses.append(Pose(Point(obstacle.x, obstacle.y, z), Quaternion(box.top, box.bottom, box.left, box.right)))
    return PoseArray(Header(stamp=ros_time(stamp), frame_id=frame_id), poses)


def obstacles_from_pose_array(msg: PoseArray, frame_id: str) -> List[Obstacle]:
    """The inverse of pose_array_from_obstacles; what the wire does not carry comes back as None.

    An unknown side of the line comes back as inside.
    """
    if msg.header.frame_id.lstrip('/') != frame_id:
        raise BorderError('the obstacle list is in frame %r, expected %r' % (msg.header.frame_id, frame_id))
    obstacles = []
    for i, pose in enumerate(msg.poses):
        p, q = pose.position, pose.orientation
        _require_finite('obstacle %d' % i, x=p.x, y=p.y, z=p.z, top=q.x, bottom=q.y, left=q.z, right=q.w)
        if p.z == 0:
            raise BorderError('obstacle %d has z = 0, expected its radius, or minus its radius outside the lane' % i)
        box = Box(left=q.z, top=q.x, right=q.w, bottom=q.y)
        obstacles.append(Obstacle(None, p.x, p.y, abs(p.z), p.z > 0, bird_box=box))
    return obstacles


def msg_from_lane_pose(pose: LanePose, stamp: int, cls: Any) -> Any:
    """cls: the LanePose class to use, see messages.py. A covariance that is not known is zeros, as filters send."""
    return cls(
        header=Header(stamp=ros_time(stamp)),
        d=pose.d,
        phi=pose.phi,
        d_phi_covariance=list(pose.covariance or (0.0,) * 4),
        curvature=pose.curvature,
        in_lane=True,
    )


def lane_pose_from_msg(msg: Any) -> LanePose:
    """Only d, phi, their covariance and curvature count; in_lane alone is no reason to stop.

    A covariance that is none, zeros or NaN for example, comes back as not known.
    """
    _require_finite('the lane pose', d=msg.d, phi=msg.phi, curvature=msg.curvature)
    dd, dp, pd, pp = msg.d_phi_covariance
    usable = all(math.isfinite(value) for value in (dd, dp, pd, pp)) and dd > 0 and pp > 0
    usable = usable and ((dp + pd) / 2) ** 2 <= dd * pp
    return LanePose(msg.d, msg.phi, msg.curvature, (dd, dp, pd, pp) if usable else None)


def lane_control_from_decision(decision: Decision, stamp: int) -> LaneControl:
    """stamp: of the image that the decision rests on, 0 before the first."""
    return LaneControl(
        header=Header(stamp=ros_time(stamp)),
        d_ref=decision.d_ref,
        v_ref=decision.v_ref,
        active=decision.active,
        state=decision.state.value,
        reason=decision.reason,
    )


def decision_from_lane_control(msg: LaneControl) -> Decision:
    """The inverse of lane_control_from_decision."""
    _require_finite('the lane control', d_ref=msg.d_ref, v_ref=msg.v_ref)
    states = [state for state in State if state.value == msg.state]
    if not states or msg.active != (states[0] is not State.CLEAR) or msg.v_ref < 0:
        raise BorderError(
            'the lane control has state %d, active %s and v_ref %g, expected a known state, active unless CLEAR, '
            'and v_ref >= 0' % (msg.state, msg.active, msg.v_ref)
        )
    return Decision(states[0], msg.d_ref, msg.v_ref, msg.reason)


def reference_from_lane_control(msg: LaneControl) -> Reference:
    """What of a LaneControl the controller tracks."""
    return reference_from_decision(decision_from_lane_control(msg))


def flag_from_decision(decision: Decision, stamp: int, cls: Any) -> Any:
    """The 2018 interface. cls: the BoolStamped class to use."""
    return flag(decision.active, stamp, cls)


def flag(value: bool, stamp: int, cls: Any) -> Any:
    """cls: the BoolStamped class to use."""
    return cls(header=Header(stamp=ros_time(stamp)), data=value)


def msg_from_command(command: Command, stamp: int, cls: Any) -> Any:
    """cls: the Twist2DStamped class to use."""
    return cls(header=Header(stamp=ros_time(stamp)), v=command.v, omega=command.omega)


def command_from_msg(msg: Any) -> Command:
    """The inverse of msg_from_command."""
    _require_finite('the car command', v=msg.v, omega=msg.omega)
    return Command(msg.v, msg.omega)


def stop_line_reading(pace: Pace, stamp: int, cls: Any) -> Any:
    """What slows today's lane controller down, or stops it. cls: the StopLineReading class to use."""
    return cls(
        header=Header(stamp=ros_time(stamp)),
        stop_line_detected=pace is not Pace.FULL,
        at_stop_line=pace is Pace.STAND,
    )


def picture_from_compressed_image(msg: CompressedImage) -> Array:
    """(H, W, 3) uint8, BGR. Raises PictureError."""
    return decode_jpeg(bytes(msg.data))


def compressed_image_from_jpeg(jpeg: bytes, stamp: int, frame_id: str) -> CompressedImage:
    """A JPEG on the wire."""
    return CompressedImage(Header(stamp=ros_time(stamp), frame_id=frame_id), 'jpeg', jpeg)


def camera_info_from_calibration(calibration: Calibration, stamp: int, frame_id: str) -> CameraInfo:
    """What a camera says of itself."""
    return CameraInfo(
        header=Header(stamp=ros_time(stamp), frame_id=frame_id),
        height=calibration.height,
        width=calibration.width,
        distortion_model='plumb_bob',
        D=calibration.distortion.tolist(),
        K=calibration.camera_matrix.ravel().tolist(),
        R=calibration.rectification.ravel().tolist(),
        P=np.column_stack([calibration.projection, np.zeros(3)]).ravel().tolist(),
    )


def picture_from_image(msg: Image) -> Array:
    """(H, W, 3) uint8, BGR. Raises PictureError for data that does not fit its description and for grey pictures."""
    if not (msg.height and msg.width):
        raise PictureError('the picture is %dx%d, expected at least 16x16' % (msg.width, msg.height))
    try:
        dtype, channels = _BRIDGE.encoding_to_dtype_with_channels(msg.encoding)
        if channels == 1 and not msg.encoding.startswith('bayer'):
            raise PictureError('the picture has encoding %s, expected colour' % msg.encoding)
        row = msg.width * channels * np.dtype(dtype).itemsize
        step = max(msg.step, row)
        if len(msg.data) < step * msg.height:
            raise PictureError('the picture has %d bytes, expected %d rows of %d' % (len(msg.data), msg.height, step))
        if step > row:  # cv_bridge up to 1.16 takes the padding for pixels
            rows = np.frombuffer(msg.data, dtype=np.uint8)[: step * msg.height].reshape(msg.height, step)
            msg = Image(msg.header, msg.height, msg.width, msg.encoding, msg.is_bigendian, row, rows[:, :row].tobytes())
        picture = np.ascontiguousarray(_BRIDGE.imgmsg_to_cv2(msg, 'bgr8'))
    except (CvBridgeError, RuntimeError, TypeError) as error:
        raise PictureError(
            'the picture with encoding %r does not convert to bgr8: %s' % (msg.encoding, ' '.join(str(error).split()))
        ) from error
    return check_picture(picture)


def image_from_picture(picture: Array, stamp: int, frame_id: str) -> Image:
    """picture: (H, W, 3) uint8, BGR."""
    msg = _BRIDGE.cv2_to_imgmsg(picture, 'bgr8')
    msg.header = Header(stamp=ros_time(stamp), frame_id=frame_id)
    return msg


def _require_finite(what: str, **values: float) -> None:
    for name, value in values.items():
        if not math.isfinite(value):
            raise BorderError('%s has %s = %s, expected a finite number' % (what, name, value))
        if abs(value) > LARGEST.get(name, math.inf):
            raise BorderError('%s has %s = %g, expected at most %g' % (what, name, value, LARGEST[name]))
