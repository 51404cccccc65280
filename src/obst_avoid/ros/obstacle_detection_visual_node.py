"""obstacle_detection_visual_node: markers for rviz, the camera picture and the bird view with boxes, for a laptop.

Pictures, the avoider's plan and /diagnostics cross the network and are drawn only while somebody looks at the result.
"""

import collections
import threading
import time
from dataclasses import asdict, dataclass
from typing import Any, Dict, List, Optional, OrderedDict, Tuple, Union

import cv2
import numpy as np
import rospy
import tf2_ros
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.msg import Config
from geometry_msgs.msg import PoseArray, Quaternion, TransformStamped, Vector3
from sensor_msgs.msg import CompressedImage, Image
from visualization_msgs.msg import MarkerArray

from obst_avoid.core.age import age
from obst_avoid.core.avoidance.corridor import View
from obst_avoid.core.bird_view import BirdViewSettings, crop, make_bird_view, warp
from obst_avoid.core.calibration import Calibration, CalibrationError, camera_from_robot, camera_position, scaled
from obst_avoid.core.picture import PictureError, encode_jpeg
from obst_avoid.core.settings import SettingsError, choice, flag, group, load, text
from obst_avoid.core.types import Array, Obstacle, State, in_words
from obst_avoid.ros import border, node
from obst_avoid.ros.health import Heard, health_of, heard_of
from obst_avoid.ros.markers import (
    markers_from_health,
    markers_from_obstacles,
    reason_from_markers,
    state_from_markers,
    view_from_markers,
)
from obst_avoid.viz.overlay import (
    STATE_COLORS,
    draw_on_bird_view,
    draw_on_picture,
    draw_plan_on_bird_view,
    draw_plan_on_picture,
    headline,
)

KEPT = 60
"""Pictures and obstacle lists that wait for each other: 2 s at 30 Hz. Over a network either may come first."""

CROP_DISTANCE = 'bird_view_crop_distance'
"""Of the detector's live settings."""

PLAN_AGE_LIMIT = 0.3
"""[s] between a picture and a plan that is drawn on it."""

HEALTH_PERIOD = 1.0
"""[s] of wall time between two markers that say how the nodes are."""

Waiting = OrderedDict[int, Any]


@dataclass(frozen=True)
class Plan:
    """What the avoider made of a picture. stamp: [ns] of that picture."""

    stamp: int
    state: State
    reason: str
    view: View


@dataclass(frozen=True)
class VisualNodeSettings:
    """config/bird_view.yaml, and what launch files set."""

    veh: str = text()
    calibration_dir: str = text()
    allow_default_calibration: bool = flag()
    input: str = choice('compressed', 'raw')
    bird_view: BirdViewSettings = group(BirdViewSettings)


@dataclass(frozen=True)
class Output:
    """One picture on two topics: raw for rviz, JPEG for everything else."""

    raw: rospy.Publisher
    jpeg: rospy.Publisher

    def wanted(self) -> bool:
        """Somebody looks."""
        return bool(self.raw.get_num_connections() or self.jpeg.get_num_connections())

    def publish(self, picture: Array, stamp: int, frame_id: str) -> None:
        """Encode only what is looked at."""
        if self.raw.get_num_connections():
            self.raw.publish(border.image_from_picture(picture, stamp, frame_id))
        if self.jpeg.get_num_connections():
            self.jpeg.publish(border.compressed_image_from_jpeg(encode_jpeg(picture), stamp, frame_id))


class VisualNode:
    """Pairs obstacle lists with pictures by their exact stamp."""

    def __init__(self) -> None:
        self._settings = settings = node.private_settings(VisualNodeSettings)
        self._calibration = node.calibration_of(
            settings.veh, settings.calibration_dir, settings.allow_default_calibration
        )
        self._bird_view = settings.bird_view
        self._view = make_bird_view(self._calibration, self._bird_view)
        self._frame = border.footprint_frame(settings.veh)
        self._camera_frame = border.camera_frame(settings.veh)
        self._lock = threading.Lock()
        self._pictures: Waiting = collections.OrderedDict()
        self._lists: Waiting = collections.OrderedDict()
        self._newest: node.Newest[Tuple[int, Any, List[Obstacle]]] = node.Newest()
        self._stamp: Optional[int] = None
        self._plan: Optional[Plan] = None
        self._subscribers: List[rospy.Subscriber] = []
        self._diagnostics: Optional[rospy.Subscriber] = None
        self._heard: Dict[str, Heard] = {}
        self._shown = 0
        self._rate, self._reason = node.Rate(), 'nothing yet'
        self._markers = rospy.Publisher('~markers', MarkerArray, queue_size=5)  # two threads publish
        self._image = self._output('~image', Image, CompressedImage)
        self._bird = self._output('~bird_view', Image, CompressedImage)
        self._broadcaster = tf2_ros.StaticTransformBroadcaster()
        self._broadcaster.sendTransform(camera_transform(self._calibration, self._frame, self._camera_frame))
        self._health = node.Health(settings.veh, self._diagnose)
        node.in_background(self._work)
        node.every(HEALTH_PERIOD, self._show_health)
        rospy.Subscriber('~detector_settings', Config, self._on_detector_settings, queue_size=1)
        rospy.Subscriber('~posearray', PoseArray, node.callback(self._on_obstacles), queue_size=1)

    @staticmethod
    def _output(name: str, raw: Any, jpeg: Any) -> Output:
        return Output(
            rospy.Publisher(name, raw, queue_size=1), rospy.Publisher(name + '/compressed', jpeg, queue_size=1)
        )

    def _on_obstacles(self, msg: PoseArray) -> None:
        try:
            obstacles = border.obstacles_from_pose_array(msg, self._frame)
        except border.BorderError as error:
            self._reason = node.dropped('obstacle list', error)
            return
        stamp = border.nanoseconds(msg.header.stamp)
        if self._markers.get_num_connections():
            self._markers.publish(markers_from_obstacles(obstacles, self._shown, stamp, self._frame))
            self._shown = len(obstacles)
        self._subscribe(self._image.wanted() or self._bird.wanted())
        self._wait(self._lists, stamp, obstacles)
        self._stamp = stamp
        self._reason = '%d obstacles' % len(obstacles)
        self._rate.tick()

    def _on_detector_settings(self, msg: Config) -> None:
        """Boxes are in pixels of the detector's bird view, which may be tuned while it runs."""
        told = [item.value for item in msg.doubles if item.name == CROP_DISTANCE]
        if not told or told[0] == self._bird_view.crop_distance:
            return
        try:
            settings = load(BirdViewSettings, {**asdict(self._bird_view), 'crop_distance': told[0]}, rospy.get_name())
            self._view = make_bird_view(self._view.calibration, settings)
        except (SettingsError, CalibrationError) as error:
            node.dropped('the settings of the detector', error)
            return
        self._bird_view = settings

    def _subscribe(self, wanted: bool) -> None:
        """Take pictures and plans over the network only while somebody looks."""
        if wanted and not self._subscribers:
            compressed = self._settings.input == 'compressed'
            topic, cls = ('~image_in/compressed', CompressedImage) if compressed else ('~image_in', Image)
            self._subscribers = [
                rospy.Subscriber(topic, cls, self._on_picture, queue_size=1, buff_size=2**24),
                rospy.Subscriber('~plan', MarkerArray, self._on_plan, queue_size=1),
            ]
        elif not wanted and self._subscribers:
            for subscriber in self._subscribers:
                subscriber.unregister()
            self._subscribers = []
            with self._lock:
                self._pictures.clear()
                self._plan = None

    def _on_picture(self, msg: Union[CompressedImage, Image]) -> None:
        self._wait(self._pictures, border.nanoseconds(msg.header.stamp), msg)

    def _on_plan(self, msg: MarkerArray) -> None:
        try:
            state, reason, view = state_from_markers(msg), reason_from_markers(msg), view_from_markers(msg)
        except border.BorderError as error:
            node.dropped('plan', error)
            return
        with self._lock:
            self._plan = Plan(border.nanoseconds(msg.markers[0].header.stamp), state, reason, view)

    def _wait(self, waiting: Waiting, stamp: int, value: Any) -> None:
        """Keep a picture or a list until its partner is there; then both go to the worker."""
        with self._lock:
            waiting[stamp] = value
            while len(waiting) > KEPT:
                waiting.popitem(last=False)
            if stamp in self._pictures and stamp in self._lists:
                self._newest.put((stamp, self._pictures.pop(stamp), self._lists.pop(stamp)))

    def _work(self) -> None:
        found = self._newest.take(timeout=0.5)
        if found is None:
            return
        stamp, msg, obstacles = found
        try:
            compressed = self._settings.input == 'compressed'
            picture = border.picture_from_compressed_image(msg) if compressed else border.picture_from_image(msg)
            self._draw(picture, obstacles, stamp)
        except (PictureError, CalibrationError) as error:
            self._reason = node.dropped('picture', error)

    def _draw(self, picture: Array, obstacles: List[Obstacle], stamp: int) -> None:
        height, width = picture.shape[:2]
        if (self._view.calibration.width, self._view.calibration.height) != (width, height):
            self._view = make_bird_view(scaled(self._calibration, width, height), self._bird_view)
        with self._lock:
            plan = self._plan
        if plan is not None and abs(age(plan.stamp, stamp)) > PLAN_AGE_LIMIT:
            plan = None
        if self._image.wanted():
            drawn, free = picture, 0
            if plan is not None:
                drawn = draw_plan_on_picture(picture, plan.view, plan.state, self._view)
                drawn, free = headline(drawn, in_words(plan.state, plan.reason), STATE_COLORS[plan.state])
            self._image.publish(draw_on_picture(drawn, obstacles, self._view, free), stamp, self._camera_frame)
        if self._bird.wanted():
            bird = warp(crop(picture, self._view), self._view)
            if plan is not None:
                bird = draw_plan_on_bird_view(bird, plan.view, plan.state, self._view)
            self._bird.publish(draw_on_bird_view(bird, obstacles), stamp, self._frame)

    def _show_health(self) -> None:
        """Listen to /diagnostics while somebody looks at the markers, and say once a second how the nodes are."""
        wanted = bool(self._markers.get_num_connections())
        if wanted and self._diagnostics is None:
            self._diagnostics = rospy.Subscriber('/diagnostics', DiagnosticArray, self._on_diagnostics, queue_size=50)
        elif not wanted and self._diagnostics is not None:
            self._diagnostics.unregister()
            self._diagnostics = None
            with self._lock:
                self._heard = {}
        if wanted:
            with self._lock:
                words, level = health_of(self._heard, time.monotonic())
            self._markers.publish(markers_from_health(words, level, self._frame))

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        heard = heard_of(msg, self._settings.veh, time.monotonic())
        with self._lock:
            self._heard.update(heard)

    def _diagnose(self, status: Any) -> None:
        rate = self._rate.read()
        seconds = None if self._stamp is None else age(self._stamp, border.nanoseconds(rospy.Time.now()))
        if rate and seconds is not None:
            status.summary(node.OK, '%.1f lists/s, %.2f s old: %s' % (rate, seconds, self._reason))
        else:
            status.summary(node.WARN, 'no obstacle list: %s' % self._reason)
        status.add('obstacle lists [1/s]', '%.1f' % rate)
        status.add('obstacle list age [s]', node.figure(seconds, '%.3f'))
        status.add('last reason', self._reason)
        status.add('calibration', self._calibration.source)
        looked_at = [('markers', self._markers.get_num_connections() > 0)]
        looked_at += [('picture', self._image.wanted()), ('bird view', self._bird.wanted())]
        status.add('looked at', ', '.join(name for name, wanted in looked_at if wanted) or 'nothing')


def camera_transform(calibration: Calibration, footprint: str, camera: str) -> TransformStamped:
    """Where the camera sits on the robot, from its calibration, for rviz."""
    msg = TransformStamped()
    msg.header.stamp, msg.header.frame_id, msg.child_frame_id = rospy.Time.now(), footprint, camera
    msg.transform.translation = Vector3(*camera_position(calibration))
    turn = cv2.Rodrigues(camera_from_robot(calibration)[0].T)[0].ravel()  # axis times angle
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle > 0 else turn
    msg.transform.rotation = Quaternion(*(axis * np.sin(angle / 2)), np.cos(angle / 2))
    return msg


def main() -> None:
    """Entry point."""
    node.run('obstacle_detection_visual_node', VisualNode)
