#!/usr/bin/env python3
"""A robot's camera, lane filter and clock, which can be told to fail. A process of its own, as on a robot.

stack.py VEH: reads lines of JSON, changes of Told, and writes one for each command to the wheels:
{"wall": [s] monotonic, "v": [m/s], "age": [s] of the picture that LaneControl rests on, "state": of LaneControl}.
"""

import dataclasses
import json
import math
import sys
import threading
import time
from typing import Any, Dict, Optional

import cv2
import numpy as np
import rospy
from helpers import compressed_image, jpeg_of, picture_of
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header
from unit.drawn import Scene

from obst_avoid.core.picture import encode_jpeg
from obst_avoid.msg import LaneControl, LanePose, Twist2DStamped

CLOCK_PERIOD = 0.01


@dataclasses.dataclass
class Told:
    """pictures: road, blank (no lines), cut, junk, small (half the size), tall (of no camera), none. rate: [1/s].
    lane_pose: good, nan, none. ahead: [s] of ROS time before the wall's. clock: it runs.
    """

    pictures: str = 'road'
    rate: float = 30.0
    lane_pose: str = 'good'
    ahead: float = 0.0
    clock: bool = True


def jpegs() -> Dict[str, Optional[bytes]]:
    """What the camera may send."""
    road = jpeg_of(Scene(()))
    grey = encode_jpeg(np.full((480, 640, 3), 90, np.uint8))
    small = encode_jpeg(cv2.resize(picture_of(Scene(())), (320, 240)))
    tall = encode_jpeg(np.full((640, 200, 3), 90, np.uint8))
    return {
        'road': road, 'blank': grey, 'cut': road[: len(road) // 2], 'junk': b'no picture', 'small': small, 'tall': tall,
        'none': None,
    }  # fmt: skip


class Stack:
    """Publishes as told, from threads of its own."""

    def __init__(self, veh: str) -> None:
        self.told = Told()
        self._jpegs = jpegs()
        self._now = 0.0
        self._decided: Optional[LaneControl] = None
        self._lock = threading.Lock()
        self._clock = rospy.Publisher('/clock', Clock, queue_size=10)
        self._pictures = rospy.Publisher('/%s/camera_node/image/compressed' % veh, CompressedImage, queue_size=2)
        self._poses = rospy.Publisher('/%s/lane_filter_node/lane_pose' % veh, LanePose, queue_size=2)
        rospy.Subscriber('/%s/obstacle_avoidance_node/lane_control' % veh, LaneControl, self._on_lane_control)
        rospy.Subscriber('/%s/lane_controller_node/car_cmd' % veh, Twist2DStamped, self._on_car_cmd)
        for work in (self._run_clock, self._run_camera, self._run_filter):
            threading.Thread(target=work, daemon=True).start()

    def _run_clock(self) -> None:
        while True:
            if self.told.clock:
                self._now = time.time() + self.told.ahead
                self._clock.publish(Clock(rospy.Time.from_sec(self._now)))
            time.sleep(CLOCK_PERIOD)

    def _run_camera(self) -> None:
        while True:
            jpeg = self._jpegs[self.told.pictures]
            if jpeg is not None:
                self._pictures.publish(compressed_image(jpeg, rospy.Time.from_sec(self._now)))
            time.sleep(1 / self.told.rate)

    def _run_filter(self) -> None:
        while True:
            if self.told.lane_pose != 'none':
                d = math.nan if self.told.lane_pose == 'nan' else 0.0
                self._poses.publish(LanePose(header=Header(stamp=rospy.Time.from_sec(self._now)), d=d))
            time.sleep(0.05)

    def _on_lane_control(self, msg: LaneControl) -> None:
        self._decided = msg

    def _on_car_cmd(self, msg: Twist2DStamped) -> None:
        decided = self._decided
        age = None if decided is None else self._now - decided.header.stamp.to_sec()
        say({'wall': time.monotonic(), 'v': msg.v, 'age': age, 'state': None if decided is None else decided.state})


def say(content: Dict[str, Any]) -> None:
    """One line, whole even when several threads speak."""
    sys.stdout.write(json.dumps(content) + '\n')
    sys.stdout.flush()


def main() -> None:
    """Work until stdin ends."""
    rospy.init_node('stack', anonymous=True, disable_signals=True)
    stack = Stack(sys.argv[1])
    for line in sys.stdin:
        stack.told = dataclasses.replace(stack.told, **json.loads(line))


if __name__ == '__main__':
    main()
