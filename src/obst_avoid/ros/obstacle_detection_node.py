"""obstacle_detection_node: from the camera's newest picture to a PoseArray with the picture's stamp, and to a LanePose
where the lane's lines are seen.
"""

import threading
import time
from dataclasses import dataclass
from typing import Any, Optional, Sequence, Tuple, Union

import numpy as np
import rospy
from geometry_msgs.msg import PoseArray
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from obst_avoid.cfg import ObstacleDetectionConfig
from obst_avoid.core import detection
from obst_avoid.core.age import age
from obst_avoid.core.calibration import CalibrationError, scaled
from obst_avoid.core.detection.robust import native
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.motion import remembered
from obst_avoid.core.picture import PictureError, stretched
from obst_avoid.core.settings import choice, flag, text
from obst_avoid.core.types import Command, Stamped
from obst_avoid.ros import border, node
from obst_avoid.ros.live import LiveSettings
from obst_avoid.ros.messages import DUCKIETOWN, find_classes, find_messages


@dataclass(frozen=True)
class DetectionNodeSettings(DetectionSettings):
    """The detector's settings and those of its node, which launch files set."""

    veh: str = text()
    calibration_dir: str = text()
    allow_default_calibration: bool = flag()
    msgs_package: str = text()
    input: str = choice('compressed', 'raw')
    anti_instagram: bool = flag()


class DetectionNode:
    """Works on the newest picture only; a picture that cannot be used is named and skipped."""

    def __init__(self) -> None:
        self._settings = node.private_settings(DetectionNodeSettings)
        settings = self._settings
        calibration = node.calibration_of(settings.veh, settings.calibration_dir, settings.allow_default_calibration)
        self._detector = detection.start(calibration, settings)
        if settings.profile == 'robust' and native.LIBRARY is None:
            rospy.logwarn('%s: native.c is not built, so each picture takes some 20 times as long', rospy.get_name())
        self._messages = find_messages(settings.msgs_package)
        self._lock = threading.Lock()
        self._commands: Tuple[Stamped[Command], ...] = ()
        self._frame = border.footprint_frame(settings.veh)
        self._newest: node.Newest[Union[CompressedImage, Image]] = node.Newest()
        self._rate, self._reason = node.Rate(), 'no picture yet'
        self._levels: Optional[Tuple[Sequence[int], Sequence[int]]] = None
        self._stamp: Optional[int] = None
        self._milliseconds = 0.0
        self._publisher = rospy.Publisher('~posearray', PoseArray, queue_size=1)
        self._lane_pose_publisher = rospy.Publisher('~lane_pose', self._messages.LanePose, queue_size=1)
        self._health = node.Health(settings.veh, self._diagnose)
        self._live = LiveSettings(ObstacleDetectionConfig, DetectionNodeSettings, self._tune)
        node.in_background(self._work)
        rospy.Subscriber('~car_cmd', self._messages.Twist2DStamped, self._on_car_cmd, queue_size=10)
        rospy.Subscriber('~camera_info', CameraInfo, self._on_camera_info, queue_size=1)
        if settings.anti_instagram:
            (levels_class,) = find_classes(settings.msgs_package or DUCKIETOWN, 'AntiInstagramThresholds')
            rospy.Subscriber('~thresholds', levels_class, self._on_thresholds, queue_size=1)
        if settings.input == 'compressed':
            rospy.Subscriber('~image/compressed', CompressedImage, self._newest.put, queue_size=1, buff_size=2**24)
        else:
            rospy.Subscriber('~image', Image, self._newest.put, queue_size=1, buff_size=2**24)

    def _tune(self, settings: DetectionNodeSettings) -> None:
        """Settings that fit no camera are refused here; the worker takes the others up with its next picture."""
        detection.tuned(self._detector, settings)
        self._settings = settings

    def _work(self) -> None:
        msg = self._newest.take(timeout=0.5)
        if msg is None:
            return
        stamp = border.nanoseconds(msg.header.stamp)
        if self._stamp is not None and stamp < self._stamp:
            rospy.logwarn('%s: time ran backwards by %.2f s, starting anew', rospy.get_name(), age(stamp, self._stamp))
        self._stamp = stamp
        begin = time.perf_counter()
        try:
            picture = self._picture(msg)
            with self._lock:
                commands = self._commands
            if self._detector.settings is not self._settings:
                self._detector = detection.tuned(self._detector, self._settings)
            scene, self._detector = detection.detect(self._detector, picture, stamp, commands)
        except (PictureError, CalibrationError) as error:
            self._reason = node.dropped('picture', error)
            return
        if scene.lane_pose is not None:  # first, since the avoider decides when it hears of the obstacles
            pose = border.msg_from_lane_pose(scene.lane_pose, stamp, self._messages.LanePose)
            self._lane_pose_publisher.publish(pose)
        self._publisher.publish(border.pose_array_from_obstacles(scene.obstacles, stamp, self._frame))
        self._milliseconds = 1e3 * (time.perf_counter() - begin)
        self._reason = '%d obstacles, %d in the lane' % (
            len(scene.obstacles),
            sum(obstacle.in_lane is not False for obstacle in scene.obstacles),
        )
        self._rate.tick()

    def _picture(self, msg: Union[CompressedImage, Image]) -> Any:
        compressed = self._settings.input == 'compressed'
        picture = border.picture_from_compressed_image(msg) if compressed else border.picture_from_image(msg)
        levels = self._levels
        return picture if levels is None else stretched(picture, *levels)

    def _on_thresholds(self, msg: Any) -> None:
        """The stack's black levels: it stretches its own pictures by them, every few seconds anew."""
        try:
            stretched(np.zeros((1, 1, 3), np.uint8), msg.low, msg.high)
        except PictureError as error:
            node.dropped('thresholds', error)
            return
        self._levels = msg.low, msg.high

    def _on_car_cmd(self, msg: Any) -> None:
        """A command counts from when it is heard: its stamp may be that of the picture that it rests on."""
        try:
            command = border.command_from_msg(msg)
        except border.BorderError as error:
            node.dropped('car command', error)
            return
        now = border.nanoseconds(rospy.Time.now())
        with self._lock:
            self._commands = remembered(self._commands, Stamped(now, command))

    def _on_camera_info(self, msg: CameraInfo) -> None:
        """Warn when the camera says that it is another one than the calibration's."""
        if not (msg.width and msg.height and any(msg.K)):
            return
        calibration = self._detector.calibration
        try:
            calibration = scaled(calibration, msg.width, msg.height)
        except CalibrationError as error:
            rospy.logwarn_throttle(60, '%s: camera_info: %s' % (rospy.get_name(), error))
            return
        seen, known = msg.K[0], calibration.camera_matrix[0, 0]
        if abs(seen / known - 1) > 0.05:
            rospy.logwarn_throttle(
                60,
                '%s: camera_info has a focal length of %.1f px, expected %.1f px as in the calibration for %s'
                % (rospy.get_name(), seen, known, calibration.source),
            )

    def _diagnose(self, status: Any) -> None:
        rate = self._rate.read()
        seconds = None if self._stamp is None else age(self._stamp, border.nanoseconds(rospy.Time.now()))
        if seconds is None or rate == 0:
            status.summary(node.ERROR, 'no usable picture: %s' % self._reason)
        elif seconds > self._settings.picture_age_limit:
            status.summary(node.WARN, 'picture %.2f s old, limit %.2f s' % (seconds, self._settings.picture_age_limit))
        else:
            numbers = rate, self._milliseconds, seconds, self._reason
            status.summary(node.OK, '%.1f pictures/s, %.0f ms each, %.2f s old: %s' % numbers)
        status.add('pictures [1/s]', '%.1f' % rate)
        status.add('time per picture [ms]', '%.1f' % self._milliseconds)
        status.add('picture age [s]', node.figure(seconds, '%.3f'))
        status.add('pictures dropped for newer ones', self._newest.dropped)
        status.add('last reason', self._reason)
        status.add('calibration', self._detector.calibration.source)
        status.add('profile', self._settings.profile)
        status.add('black levels', 'not used' if self._levels is None else '%s to %s' % self._levels)


def main() -> None:
    """Entry point."""
    node.run('obstacle_detection_node', DetectionNode)
