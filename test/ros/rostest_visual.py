#!/usr/bin/env python3
"""The visualizer: markers, pictures for those who look, and where the camera sits."""

import math
import sys
import time
import unittest
from typing import Any, List, Tuple

import numpy as np
import rospy
import rostest
from cv_bridge import CvBridge
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from dynamic_reconfigure.msg import Config, DoubleParameter
from geometry_msgs.msg import PoseArray, TransformStamped
from helpers import (
    ANSWER,
    Inbox,
    compressed_image,
    jpeg_of,
    picture_of,
    pose_array,
    publisher,
    stamp_of,
    subscribers_of,
    wait_for,
)
from sensor_msgs.msg import CompressedImage, Image
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from obst_avoid.core.avoidance.corridor import View
from obst_avoid.core.picture import decode_jpeg
from obst_avoid.core.types import Decision, State
from obst_avoid.ros.markers import markers_from_decision

NODE = '/duck1/obstacle_detection_visual_node'
CAMERA = '/duck1/camera_node/image/compressed'
CROP = 'bird_view_crop_distance'
PLAN = '/duck1/obstacle_avoidance_node/markers'
INSIDE, OUTSIDE = (0.40, 0.03, 0.02), (0.50, -0.25, -0.03)
"""(x, y, z) on the wire."""


class Visual(unittest.TestCase):
    number = 0

    def setUp(self) -> None:
        cls = type(self)
        if not hasattr(cls, 'lists'):
            cls.lists = publisher('/duck1/obstacle_detection_node/posearray', PoseArray)

    def tell(self, *obstacles: Tuple[float, float, float]) -> rospy.Time:
        """Publish an obstacle list with a stamp of its own."""
        type(self).number += 1
        stamp = stamp_of(self.number)
        self.lists.publish(pose_array(obstacles, stamp, 'duck1/footprint'))
        return stamp

    def markers_of(self, inbox: Inbox, *obstacles: Tuple[float, float, float]) -> List[Marker]:
        stamp = self.tell(*obstacles)
        found: Any = inbox.wait(
            lambda msg: [marker for marker in msg.markers if marker.header.stamp == stamp], 'the markers of a list'
        )
        self.assertEqual({marker.header.stamp for marker in found.markers}, {stamp})
        self.assertEqual({marker.header.frame_id for marker in found.markers}, {'duck1/footprint'})
        return list(found.markers)

    def test_markers(self) -> None:
        inbox = Inbox(NODE + '/markers', MarkerArray).connected()
        self.addCleanup(inbox.close)
        wait_for(lambda: self.tell(INSIDE, OUTSIDE) and inbox.all(), ANSWER, 'markers')
        markers = self.markers_of(inbox, INSIDE, OUTSIDE)
        self.assertEqual([marker.action for marker in markers], [Marker.ADD, Marker.ADD])
        self.assertEqual(len({(marker.ns, marker.id) for marker in markers}), 2)
        for marker, (x, y, z) in zip(markers, (INSIDE, OUTSIDE)):
            farther = 1 + abs(z) / math.hypot(x, y)
            self.assertAlmostEqual(marker.pose.position.x, x * farther, places=6)
            self.assertAlmostEqual(marker.pose.position.y, y * farther, places=6)
            self.assertAlmostEqual(marker.scale.x, 2 * abs(z), places=6)
            self.assertAlmostEqual(marker.scale.y, 2 * abs(z), places=6)
            self.assertGreater(marker.scale.z, 0)
            self.assertEqual(marker.pose.orientation.w, 1.0)
        red, green = markers[0].color, markers[1].color
        self.assertTrue(red.r > 0.5 > red.g and red.a > 0, red)
        self.assertTrue(green.g > 0.5 > green.r and green.a > 0, green)
        gone = (markers[1].ns, markers[1].id)
        markers = self.markers_of(inbox, INSIDE)
        self.assertEqual([(marker.ns, marker.id) for marker in markers if marker.action == Marker.DELETE], [gone])
        self.assertEqual(len([marker for marker in markers if marker.action == Marker.ADD]), 1)

    def test_health_for_those_who_look(self) -> None:
        wait_for(lambda: NODE not in subscribers_of('/diagnostics'), ANSWER, 'nobody looks, in another test')
        inbox = Inbox(NODE + '/markers', MarkerArray).connected()
        wait_for(lambda: NODE in subscribers_of('/diagnostics'), ANSWER, 'it listens to the nodes')
        said = publisher('/diagnostics', DiagnosticArray)
        line = DiagnosticStatus(
            DiagnosticStatus.ERROR, 'duck1/obstacle_detection_node: state', 'no picture', 'duck1', []
        )
        said.publish(DiagnosticArray(status=[line]))

        def text_with(words: str) -> Marker:
            found = inbox.wait(lambda msg: [item for item in msg.markers if words in item.text], words)
            return next(item for item in found.markers if words in item.text)

        marker = text_with('detector: ERROR no picture')
        self.assertEqual((marker.ns, marker.header.frame_id), ('health', 'duck1/footprint'))
        self.assertIn('visualizer: ', marker.text)
        self.assertIn('calibration: ', marker.text)
        text_with('detector: SILENT for')
        inbox.close()
        wait_for(lambda: NODE not in subscribers_of('/diagnostics'), ANSWER, 'it looks away again')

    def test_pictures_for_those_who_look(self) -> None:
        wait_for(lambda: self.tell(INSIDE) and not subscribers_of(CAMERA), ANSWER, 'nobody looks, in another test')
        self.tell(INSIDE)
        time.sleep(0.3)
        self.assertEqual(subscribers_of(CAMERA), [], 'nobody looks: no picture crosses the network')
        self.assertEqual(subscribers_of(PLAN), [], 'nor a plan')
        kinds = {'image': Image, 'image/compressed': CompressedImage}
        kinds.update({'bird_view': Image, 'bird_view/compressed': CompressedImage})
        inboxes = {name: Inbox('%s/%s' % (NODE, name), cls) for name, cls in kinds.items()}
        wait_for(lambda: self.tell(INSIDE) and subscribers_of(CAMERA) == [NODE], ANSWER, 'it looks at the camera')
        camera = publisher(CAMERA, CompressedImage)
        jpeg, stamps = jpeg_of(), []

        def all_seen() -> bool:
            self.number_up()
            stamps.append(stamp_of(self.number))
            camera.publish(compressed_image(jpeg, stamps[-1]))
            time.sleep(0.1)  # the picture is there before the detector could answer
            self.lists.publish(pose_array([INSIDE], stamps[-1], 'duck1/footprint'))
            return all(inbox.all() for inbox in inboxes.values())

        wait_for(all_seen, ANSWER, 'a picture on each topic')
        seen = {name: inbox.all()[-1] for name, inbox in inboxes.items()}
        for name, msg in seen.items():
            self.assertIn(msg.header.stamp, stamps)
            frame = 'duck1/footprint' if 'bird' in name else 'duck1/camera_optical_frame'
            self.assertEqual(msg.header.frame_id, frame)
        pictures = {name: CvBridge().imgmsg_to_cv2(seen[name], 'bgr8') for name in ('image', 'bird_view')}
        pictures.update({name: decode_jpeg(bytes(seen[name].data)) for name in seen if name not in pictures})
        for name, picture in pictures.items():
            self.assertEqual(picture.shape[1], 640)
            self.assertGreater(int(picture.std()), 5, name + ' is blank')
        self.assertEqual(pictures['image'].shape, (480, 640, 3))
        self.assertEqual(pictures['image/compressed'].shape, (480, 640, 3))
        self.assertEqual(pictures['bird_view'].shape, pictures['bird_view/compressed'].shape)
        change = abs(pictures['image'].astype(int) - picture_of()).max(axis=2)
        self.assertGreater(int((change > 100).sum()), 50, 'no box drawn')
        for inbox in inboxes.values():
            inbox.close()
        for topic in (CAMERA, PLAN):
            wait_for(lambda: self.tell(INSIDE) and not subscribers_of(topic), ANSWER, 'it looks away again')  # noqa: B023

    def test_a_picture_that_comes_after_its_list_is_drawn_too(self) -> None:
        # On a laptop the list, a few bytes, may overtake the picture that it was made from.
        inbox = Inbox(NODE + '/image/compressed', CompressedImage).connected()
        self.addCleanup(inbox.close)
        wait_for(lambda: self.tell(INSIDE) and subscribers_of(CAMERA) == [NODE], ANSWER, 'it looks at the camera')
        camera = publisher(CAMERA, CompressedImage)
        stamps = []

        def seen() -> bool:
            stamps.append(self.tell(INSIDE))
            time.sleep(0.1)
            camera.publish(compressed_image(jpeg_of(), stamps[-1]))
            time.sleep(0.1)
            return any(msg.header.stamp in stamps for msg in inbox.all())

        wait_for(seen, ANSWER, 'a late picture')

    def test_the_plan_is_drawn_while_it_is_fresh(self) -> None:
        pictures = {name: Inbox('%s/%s' % (NODE, name), Image).connected() for name in ('image', 'bird_view')}
        for inbox in pictures.values():
            self.addCleanup(inbox.close)
        wait_for(lambda: self.tell(INSIDE) and subscribers_of(PLAN) == [NODE], ANSWER, 'it looks at the plan')
        camera, plans = publisher(CAMERA, CompressedImage), publisher(PLAN, MarkerArray)
        wait_for(lambda: subscribers_of(CAMERA) == [NODE], ANSWER, 'it looks at the camera')
        corners = np.array([(0.0, 0.1), (1.0, 0.1), (1.0, -0.1), (0.0, -0.1), (0.0, 0.1)])
        view = View(corners, np.array([(0.0, 0.0), (1.0, 0.0)]), (0.45, 0.0, 0.03))

        def drawn(age: int) -> List[Any]:
            """Both pictures of a stamp that is so many pictures' time after the newest plan's."""
            type(self).number += 60
            plan = Decision(State.AVOIDING, 0.0, 0.1, 'avoiding')
            plans.publish(markers_from_decision(plan, view, stamp_of(self.number).to_nsec(), 'duck1/footprint'))
            time.sleep(0.2)
            type(self).number += age
            stamp = stamp_of(self.number)

            def both() -> Any:
                camera.publish(compressed_image(jpeg_of(), stamp))
                self.lists.publish(pose_array([], stamp, 'duck1/footprint'))
                time.sleep(0.1)
                found = [[msg for msg in inbox.all() if msg.header.stamp == stamp] for inbox in pictures.values()]
                return [of[0] for of in found] if all(found) else None

            return [CvBridge().imgmsg_to_cv2(msg, 'bgr8') for msg in wait_for(both, ANSWER, 'the pictures')]

        plain, bare = drawn(age=30)
        self.assertLess(np.abs(plain.astype(int) - picture_of()).mean(), 5, 'a plan 1 s old is not drawn')
        shown, bird = drawn(age=2)
        self.assertGreater(_changed(shown, plain), 50000)
        self.assertGreater(_changed(bird, bare), 500)
        self.assertGreater(int(shown[300, 250, 0]) - int(plain[300, 250, 0]), 10, 'in the blue of AVOIDING')

    def test_the_bird_view_is_that_of_a_detector_that_is_tuned(self) -> None:
        inbox = Inbox(NODE + '/bird_view', Image).connected()
        self.addCleanup(inbox.close)
        wait_for(lambda: self.tell(INSIDE) and subscribers_of(CAMERA) == [NODE], ANSWER, 'it looks at the camera')
        camera = publisher(CAMERA, CompressedImage)
        settings = publisher('/duck1/obstacle_detection_node/parameter_updates', Config)

        def scale() -> int:
            """Rows of the newest bird view: its width is always 640, so the farther it reaches the wider it is."""
            stamp = self.tell(INSIDE)
            camera.publish(compressed_image(jpeg_of(), stamp))
            return int(inbox.wait(lambda msg: msg.header.stamp == stamp, 'a bird view').height)

        before = scale()
        self.addCleanup(lambda: settings.publish(Config(doubles=[DoubleParameter(CROP, 1.7)])))
        settings.publish(Config(doubles=[DoubleParameter(CROP, 1.0)]))
        wait_for(lambda: scale() != before, ANSWER, 'another bird view')
        settings.publish(Config(doubles=[DoubleParameter(CROP, -1.0)]))
        settings.publish(Config(doubles=[DoubleParameter(CROP, 1.7)]))
        wait_for(lambda: scale() == before, ANSWER, 'the first one again')

    def number_up(self) -> None:
        type(self).number += 1

    def test_the_camera_sits_where_the_calibration_says(self) -> None:
        inbox = Inbox('/tf_static', TFMessage)
        self.addCleanup(inbox.close)
        msg = inbox.wait(lambda msg: msg.transforms, 'a transform, latched')
        found: TransformStamped = msg.transforms[0]
        self.assertEqual(
            (found.header.frame_id, found.child_frame_id), ('duck1/footprint', 'duck1/camera_optical_frame')
        )
        place = found.transform.translation
        self.assertAlmostEqual(place.x, 0.066, delta=0.003)
        self.assertAlmostEqual(place.y, 0.0, delta=0.003)
        self.assertAlmostEqual(place.z, 0.108, delta=0.003)
        turn = found.transform.rotation
        self.assertAlmostEqual(math.sqrt(turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2), 1, places=6)
        # The camera's z looks ahead and 21 degrees down, its x to the right.
        pitch = math.radians(21)
        for axis, wanted in (((0, 0, 1), (math.cos(pitch), 0, -math.sin(pitch))), ((1, 0, 0), (0, -1, 0))):
            for value, expected in zip(turned(turn, axis), wanted):
                self.assertAlmostEqual(value, expected, delta=0.02)


def _changed(one: Any, other: Any) -> int:
    """How many pixels differ."""
    return int((one != other).any(axis=2).sum())


def turned(q: Any, v: Tuple[float, float, float]) -> Tuple[float, float, float]:
    """A vector turned by a quaternion: v + 2 w (q x v) + 2 q x (q x v)."""
    first = _cross((q.x, q.y, q.z), v)
    second = _cross((q.x, q.y, q.z), first)
    x, y, z = (a + 2 * q.w * b + 2 * c for a, b, c in zip(v, first, second))
    return x, y, z


def _cross(a: Tuple[float, float, float], b: Tuple[float, float, float]) -> Tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


if __name__ == '__main__':
    rospy.init_node('visual')
    rostest.rosrun('obst_avoid', 'visual', Visual, sys.argv)
