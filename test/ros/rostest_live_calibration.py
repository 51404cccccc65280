#!/usr/bin/env python3
"""check_calibration --live: it takes its pictures from the running robot, and says so when none come."""

import itertools
import sys
import unittest

import rospy
import rostest
from helpers import REPOSITORY, Repeating, compressed_image, default_calibration, run_program
from sensor_msgs.msg import CompressedImage
from unit.drawn import RobotPose, Scene, draw

from obst_avoid.core.picture import encode_jpeg

CALL = ['rosrun', 'obst_avoid', 'check_calibration', '--calibration', str(REPOSITORY / 'config' / 'calibrations')]


class Live(unittest.TestCase):
    def test_pictures_of_the_running_robot_are_checked(self) -> None:
        publisher = rospy.Publisher('/default/camera_node/image/compressed', CompressedImage, queue_size=1)
        calibration = default_calibration()
        jpegs = itertools.cycle(
            encode_jpeg(draw(Scene(), calibration, RobotPose(0.1 * n, 0.0, 0.1 * n)), 90) for n in range(3)
        )
        with Repeating(lambda: publisher.publish(compressed_image(next(jpegs), rospy.Time.now()))):
            answer = run_program([*CALL, '--vehicle', 'default', '--live', '--pictures', '3'], 60)
        self.assertEqual(answer.code, 0, answer.output)
        self.assertIn('the calibration fits', answer.output)
        self.assertIn('lines in 3 of 3 pictures', answer.output)

    def test_a_silent_camera_is_named(self) -> None:
        answer = run_program([*CALL, '--vehicle', 'default', '--live', '--pictures', '3'], 60)
        self.assertEqual(answer.code, 1, answer.output)
        self.assertIn('no picture on /default/camera_node/image/compressed for 5 s', answer.output)
        self.assertNotIn('Traceback', answer.output)


if __name__ == '__main__':
    rospy.init_node('live_calibration_test')
    rostest.rosrun('obst_avoid', 'live_calibration', Live, sys.argv)
