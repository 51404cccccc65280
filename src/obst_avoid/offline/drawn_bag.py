"""The drawn drive that the rostests and the first demo play, as a bag.

The robot drives towards a duckie in its lane, stands before it, the duckie goes away, the robot drives on and meets
a small duckie at the side with room to pass. A cone stands beyond the white line all the time.
"""

import argparse
import os
from typing import Any, Dict, List, Tuple

import rosbag
from sensor_msgs.msg import CameraInfo

from obst_avoid.core.age import NANOSECONDS
from obst_avoid.core.calibration import Calibration, load_calibration
from obst_avoid.core.picture import encode_jpeg
from obst_avoid.core.types import Kind, LanePose
from obst_avoid.msg import LanePose as LanePoseMsg
from obst_avoid.offline import tool
from obst_avoid.ros import border
from obst_avoid.sim.drawn import RobotPose, Scene, Thing, draw

RATE = 30.0
DURATION = 7.0
SPEED = 0.2
VEHICLE = 'drawn'
BLOCKING = Thing(Kind.DUCKIE, 1.3, 0.0)
BESIDE = Thing(Kind.DUCKIE, 1.75, -0.088, 0.03)
OUTSIDE = Thing(Kind.CONE, 1.35, -0.27, 0.07)
STANDS, DUCKIE_GONE, DRIVES_ON = 1.6, 2.6, 3.9
"""[s] into the drive."""


def at(seconds: float) -> Tuple[Scene, RobotPose]:
    """What there is to see, and from where, so many seconds into the drive."""
    driven = min(seconds, STANDS) + max(0.0, seconds - DRIVES_ON)
    things = (BESIDE, OUTSIDE) if seconds >= DUCKIE_GONE else (BLOCKING, BESIDE, OUTSIDE)
    return Scene(things), RobotPose(0.55 + SPEED * driven, 0.0, 0.0)


def drive(calibration: Calibration) -> List[Tuple[int, bytes, LanePose]]:
    """The whole drive: stamp [ns], JPEG and lane pose of each picture."""
    frames = []
    for index in tool.progress(range(int(DURATION * RATE)), 'drawing'):
        scene, pose = at(index / RATE)
        stamp = tool.stamp_of_frame(index, RATE)
        frames.append((stamp, encode_jpeg(draw(scene, calibration, pose, index)), pose.lane_pose))
    return frames


def write(path: str) -> None:
    """Draw the drive into a bag."""
    calibration = load_calibration(os.path.join(tool.package_folder(), 'config/calibrations'), 'default')
    os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
    part = path + '.part'
    with rosbag.Bag(part, 'w') as bag:
        for stamp, jpeg, pose in drive(calibration):
            for topic, msg in _messages(stamp, jpeg, pose, calibration).items():
                bag.write('/%s/%s' % (VEHICLE, topic), msg, border.ros_time(stamp + NANOSECONDS // 1000))
    os.replace(part, path)


def _messages(stamp: int, jpeg: bytes, pose: LanePose, calibration: Calibration) -> Dict[str, Any]:
    image = border.compressed_image_from_jpeg(jpeg, stamp, border.camera_frame(VEHICLE))
    info = CameraInfo(
        header=image.header,
        height=calibration.height,
        width=calibration.width,
        distortion_model='plumb_bob',
        D=calibration.distortion.tolist(),
        K=calibration.camera_matrix.ravel().tolist(),
    )
    return {
        'lane_filter_node/lane_pose': border.msg_from_lane_pose(pose, stamp, LanePoseMsg),
        'camera_node/camera_info': info,
        'camera_node/image/compressed': image,
    }


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog='drawn_bag', description='Draw the bag that tests and demo play.')
    parser.add_argument('output', metavar='BAG', help='bag to write')
    return tool.run(lambda options: write(options.output) or 0, parser, arguments)
