#!/usr/bin/env python3
"""Pictures that cannot be used: nothing is published for them, /diagnostics says why, and the node goes on."""

import math
import sys
import unittest

import cv2
import numpy as np
import rospy
import rostest
from geometry_msgs.msg import PoseArray
from helpers import (
    Diagnostics,
    Inbox,
    compressed_image,
    jpeg_of,
    nanoseconds,
    picture_of,
    process_of,
    publisher,
    stamp_of,
    value_of,
)
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import CameraInfo, CompressedImage

from obst_avoid.core.picture import encode_jpeg
from obst_avoid.msg import Twist2DStamped

NODE = '/duck1/obstacle_detection_node'
PNG = bytes(cv2.imencode('.png', np.zeros((480, 640, 3), dtype=np.uint8))[1])
GREY = bytes(cv2.imencode('.jpg', np.full((480, 640), 90, dtype=np.uint8))[1])
WIDE = encode_jpeg(np.full((360, 640, 3), 90, dtype=np.uint8))


class BadInput(unittest.TestCase):
    def setUp(self) -> None:
        cls = type(self)
        if not hasattr(cls, 'pictures'):
            cls.lists = Inbox(NODE + '/posearray', PoseArray).connected()
            cls.diagnostics = Diagnostics()
            cls.pictures = publisher('/duck1/camera_node/image/compressed', CompressedImage)
            cls.good = jpeg_of()
            cls.process = process_of(NODE)
            cls.number = 0

    def tearDown(self) -> None:
        self.assertEqual(process_of(NODE), self.process, 'the node was started anew')

    def show(self, data: bytes) -> rospy.Time:
        """Publish a picture, later than those before. Returns its stamp."""
        type(self).number += 1
        stamp = stamp_of(self.number)
        self.pictures.publish(compressed_image(data, stamp))
        return stamp

    def answer_to(self, stamp: rospy.Time) -> PoseArray:
        return self.lists.wait(lambda msg: msg.header.stamp == stamp, 'the answer to a good picture')

    def refused(self, data: bytes, reason: str) -> None:
        """The picture is named on /diagnostics, has no answer, and a good one after it has."""
        stamp = self.show(data)
        status = self.diagnostics.wait(NODE, lambda line: reason in value_of(line, 'last reason'), reason)
        self.assertEqual(status.hardware_id, 'duck1')
        self.answer_to(self.show(self.good))
        self.assertNotIn(stamp, [msg.header.stamp for msg in self.lists.all()])

    def test_empty_data(self) -> None:
        self.refused(b'', 'is empty')

    def test_junk(self) -> None:
        self.refused(bytes(range(256)) * 40, 'starts with 0001, expected a JPEG')

    def test_png(self) -> None:
        self.refused(PNG, 'starts with 8950, expected a JPEG')

    def test_truncated_jpeg(self) -> None:
        self.refused(self.good[: len(self.good) // 2], 'has no end marker')

    def test_one_channel(self) -> None:
        self.refused(GREY, 'has one channel, expected colour')

    def test_another_aspect(self) -> None:
        self.refused(WIDE, 'is 640x360, expected the aspect of 640x480')

    def test_another_size_of_the_same_aspect_is_taken(self) -> None:
        small = encode_jpeg(cv2.resize(picture_of(), (320, 240), interpolation=cv2.INTER_AREA))
        msg = self.answer_to(self.show(small))
        self.assertEqual(msg.header.frame_id, 'duck1/footprint')
        self.assertTrue(msg.poses)
        self.assertTrue(all(0 <= pose.orientation.z < pose.orientation.w <= 640 for pose in msg.poses))

    def test_time_that_runs_backwards_is_followed(self) -> None:
        self.answer_to(self.show(self.good))
        earlier = stamp_of(-1000 - self.number)
        self.pictures.publish(compressed_image(self.good, earlier))
        self.assertEqual(nanoseconds(self.answer_to(earlier)), earlier.to_nsec())
        self.answer_to(self.show(self.good))

    def test_a_camera_that_is_another_one_than_calibrated_is_said(self) -> None:
        log = Inbox('/rosout', Log).connected()
        self.addCleanup(log.close)
        camera = publisher('/duck1/camera_node/camera_info', CameraInfo)
        camera.publish(CameraInfo(width=640, height=480))  # a driver that knows nothing
        camera.publish(CameraInfo(width=320, height=240, K=[300, 0, 160, 0, 300, 120, 0, 0, 1]))
        warning = log.wait(lambda msg: 'focal length' in msg.msg, 'the warning')
        self.assertIn('has a focal length of 300.0 px, expected 160.0 px', warning.msg)
        self.assertEqual(warning.level, Log.WARN)

    def test_a_car_command_that_is_none_is_named_and_the_next_picture_is_answered(self) -> None:
        log = Inbox('/rosout', Log).connected()
        self.addCleanup(log.close)
        wheels = publisher('/duck1/lane_controller_node/car_cmd', Twist2DStamped)
        for v in (0.2, math.nan, 0.2):
            wheels.publish(Twist2DStamped(v=v))
        warning = log.wait(lambda msg: 'car command dropped' in msg.msg, 'the warning')
        self.assertIn('the car command has v = nan, expected a finite number', warning.msg)
        self.answer_to(self.show(self.good))

    def test_a_good_picture_is_named_as_well(self) -> None:
        self.answer_to(self.show(self.good))
        self.diagnostics.wait(NODE, lambda line: 'obstacles' in value_of(line, 'last reason'), 'how many obstacles')


if __name__ == '__main__':
    rospy.init_node('detection_bad_input')
    rostest.rosrun('obst_avoid', 'detection_bad_input', BadInput, sys.argv)
