#!/usr/bin/env python3
"""input:=raw: sensor_msgs/Image in whatever colour order, and what is refused of it."""

import sys
import unittest
from typing import Any, List

import cv2
import rospy
import rostest
from cv_bridge import CvBridge
from geometry_msgs.msg import Point, PoseArray
from helpers import DUCKIE, Diagnostics, Inbox, picture_of, process_of, publisher, stamp_of, value_of
from sensor_msgs.msg import Image

NODE = '/duck1/obstacle_detection_node'
BRIDGE = CvBridge()
CONFIRMED = 4
"""Consecutive pictures, one more than the tracker asks for."""


class Raw(unittest.TestCase):
    def setUp(self) -> None:
        cls = type(self)
        if not hasattr(cls, 'pictures'):
            cls.lists = Inbox(NODE + '/posearray', PoseArray).connected()
            cls.diagnostics = Diagnostics()
            cls.pictures = publisher('/duck1/camera_node/image', Image)
            cls.bgr = picture_of()
            cls.process = process_of(NODE)
            cls.number = 0

    def tearDown(self) -> None:
        self.assertEqual(process_of(NODE), self.process, 'the node was started anew')

    def show(self, msg: Image) -> rospy.Time:
        """Publish a picture, later than those before. Returns its stamp."""
        type(self).number += 1
        msg.header.stamp = stamp_of(self.number)
        self.pictures.publish(msg)
        return msg.header.stamp

    def answer_to(self, msg: Image) -> List[Point]:
        """Places of what is found once the tracker has seen the picture often enough."""
        for _ in range(CONFIRMED):
            stamp = self.show(msg)
            answer = self.lists.wait(lambda msg, stamp=stamp: msg.header.stamp == stamp, 'the answer to a picture')
        return [pose.position for pose in answer.poses]

    def found_duckie(self, msg: Image) -> None:
        places = self.answer_to(msg)
        near = [place for place in places if abs(place.y) < 0.05 and abs(place.x - DUCKIE.x) < 0.06 and place.z > 0]
        self.assertEqual(len(near), 1, places)

    def refused(self, msg: Image, reason: str) -> None:
        stamp = self.show(msg)
        self.diagnostics.wait(NODE, lambda line: reason in value_of(line, 'last reason'), reason)
        self.answer_to(self.image(self.bgr, 'bgr8'))
        self.assertNotIn(stamp, [msg.header.stamp for msg in self.lists.all()])

    @staticmethod
    def image(picture: Any, encoding: str) -> Image:
        return BRIDGE.cv2_to_imgmsg(picture, encoding)

    def test_bgr8(self) -> None:
        self.found_duckie(self.image(self.bgr, 'bgr8'))

    def test_rgb8(self) -> None:
        # Taken for BGR, the duckie would be blue and not be found.
        self.found_duckie(self.image(cv2.cvtColor(self.bgr, cv2.COLOR_BGR2RGB), 'rgb8'))

    def test_mono8(self) -> None:
        self.refused(self.image(cv2.cvtColor(self.bgr, cv2.COLOR_BGR2GRAY), 'mono8'), 'mono8, expected colour')

    def test_unknown_encoding(self) -> None:
        msg = self.image(self.bgr, 'bgr8')
        msg.encoding = 'banana'
        self.refused(msg, 'banana')

    def test_too_little_data(self) -> None:
        msg = self.image(self.bgr, 'bgr8')
        msg.data = msg.data[:-1]
        self.refused(msg, 'has 921599 bytes, expected 480 rows of 1920')

    def test_no_data(self) -> None:
        self.refused(Image(encoding='bgr8'), 'picture')


if __name__ == '__main__':
    rospy.init_node('detection_raw')
    rostest.rosrun('obst_avoid', 'detection_raw', Raw, sys.argv)
