#!/usr/bin/env python3
"""Live tuning as people do it, with dynamic_reconfigure's own programs: what changes, what is refused, what stays."""

import math
import os
import signal
import sys
import unittest
from typing import Any, List

import rospy
import rostest
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PoseArray
from helpers import (
    ANSWER,
    START,
    Diagnostics,
    Inbox,
    Repeating,
    compressed_image,
    jpeg_of,
    pose_array,
    process_of,
    publisher,
    run_program,
    value_of,
    wait_for,
)  # fmt: skip
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header

from obst_avoid.msg import LaneControl, LanePose, Twist2DStamped

DETECTOR, AVOIDER = '/duck1/obstacle_detection_node', '/duck1/obstacle_avoidance_node'
CONTROLLER = '/duck1/lane_controller_node'
BESIDE = (0.35, -0.085, 0.012)
"""(x, y, z) on the wire: in the lane, with room to pass it on the left."""


class LiveTuning(unittest.TestCase):
    def setUp(self) -> None:
        cls = type(self)
        if not hasattr(cls, 'clients'):
            cls.diagnostics = Diagnostics()
            cls.log = Inbox('/rosout', Log)
            cls.clients = {node: Client(node, timeout=START) for node in (DETECTOR, AVOIDER, CONTROLLER)}
            cls.before = {node: client.get_configuration(ANSWER) for node, client in cls.clients.items()}

    def tearDown(self) -> None:
        """Each test begins with the settings as shipped."""
        for node, client in self.clients.items():
            before = {name: value for name, value in self.before[node].items() if name != 'groups'}
            client.update_configuration(before)

    def refused(self, node: str, changes: Any, sentence: str) -> None:
        """It is named in the log, and nothing of the call is changed."""
        before, since = self.clients[node].get_configuration(), len(self.log.all())
        after = self.clients[node].update_configuration(changes)
        self.assertEqual({name: after[name] for name in changes}, {name: before[name] for name in changes})
        self.log.wait(lambda msg: msg.name == node and sentence in msg.msg, sentence, since=since)

    def test_the_yaml_is_where_values_and_descriptions_come_from(self) -> None:
        parameters = {item['name']: item for item in self.clients[AVOIDER].get_parameter_descriptions(ANSWER)}
        self.assertEqual(parameters['lane_width']['description'],
                         'm between the inner edges of the lines (Duckietown: 0.20 to 0.25)')  # fmt: skip
        self.assertEqual(self.before[AVOIDER]['lane_width'], rospy.get_param(AVOIDER + '/lane_width'))
        self.assertIn('avoid_single', parameters['stage']['edit_method'])
        low = rospy.get_param(DETECTOR + '/paper/yellow/low')
        names = ['paper_yellow_low_' + channel for channel in ('hue', 'saturation', 'value')]
        self.assertEqual([self.before[DETECTOR][name] for name in names], low)
        for node in (DETECTOR, AVOIDER, CONTROLLER):
            self.assertTrue(self.clients[node].get_parameter_descriptions(ANSWER))

    def test_dynparam_sets_the_stage_and_the_robot_does_something_else(self) -> None:
        lists = publisher(AVOIDER.replace('avoidance', 'detection') + '/posearray', PoseArray)
        poses = publisher('/duck1/lane_filter_node/lane_pose', LanePose)
        control = Inbox(AVOIDER + '/lane_control', LaneControl).connected()
        self.addCleanup(control.close)

        def feed() -> None:
            poses.publish(LanePose(header=Header(stamp=rospy.Time.now())))
            lists.publish(pose_array([BESIDE], rospy.Time.now(), 'duck1/footprint'))

        with Repeating(feed):
            control.wait_new(lambda msg: msg.state == LaneControl.AVOIDING, 'there is room beside it')
            call = ['rosrun', 'dynamic_reconfigure', 'dynparam', 'set', AVOIDER, 'stage', 'stop_only']
            ended = run_program(call, START)
            self.assertEqual(ended.code, 0, ended.output)
            control.wait_new(lambda msg: msg.state == LaneControl.STOPPED, 'it stops instead')
        self.assertEqual(rospy.get_param(AVOIDER + '/stage'), 'stop_only')
        self.diagnostics.wait(AVOIDER, lambda line: value_of(line, 'stage') == 'stop_only', 'the stage')

    def test_colour_limits_of_the_running_detector(self) -> None:
        lists = Inbox(DETECTOR + '/posearray', PoseArray).connected()
        self.addCleanup(lists.close)
        camera = publisher('/duck1/camera_node/image/compressed', CompressedImage)
        jpeg = jpeg_of()

        def found() -> List[Any]:
            return [list(msg.poses) for msg in lists.all()[-3:]]

        with Repeating(lambda: camera.publish(compressed_image(jpeg, rospy.Time.now()))):
            self.clients[DETECTOR].update_configuration({'profile': 'paper'})
            self.diagnostics.wait(DETECTOR, lambda line: value_of(line, 'profile') == 'paper', 'the profile')
            wait_for(lambda: len(found()) == 3 and all(map(self._near, found())), ANSWER, 'the duckie')
            self.clients[DETECTOR].update_configuration({'paper_yellow_high_hue': 0, 'paper_yellow_low_hue': 0})
            self.assertEqual(rospy.get_param(DETECTOR + '/paper/yellow/high')[0], 0)
            lists.wait_new(lambda msg: not self._near(list(msg.poses)), 'no yellow, no duckie')
            self.assertFalse(rospy.has_param(DETECTOR + '/paper_yellow_high_hue'), 'settings stay as YAML has them')

    @staticmethod
    def _near(poses: List[Any]) -> List[Any]:
        """The drawn duckie, 0.5 m ahead."""
        return [pose for pose in poses if math.hypot(pose.position.x - 0.5, pose.position.y) < 0.08]

    def test_the_controller_drives_as_fast_as_it_is_told_to(self) -> None:
        poses = publisher('/duck1/lane_filter_node/lane_pose', LanePose)
        commands = Inbox(CONTROLLER + '/car_cmd', Twist2DStamped).connected()
        lists = publisher(DETECTOR + '/posearray', PoseArray)
        self.addCleanup(commands.close)

        def feed() -> None:
            poses.publish(LanePose(header=Header(stamp=rospy.Time.now())))
            lists.publish(pose_array([], rospy.Time.now(), 'duck1/footprint'))

        with Repeating(feed):
            commands.wait_new(lambda msg: abs(msg.v - 0.2) < 0.001, 'as shipped')
            self.clients[CONTROLLER].update_configuration({'cruise_speed': 0.11})
            commands.wait_new(lambda msg: abs(msg.v - 0.11) < 0.001, 'slower')

    def test_what_no_start_would_accept_is_refused_in_one_sentence(self) -> None:
        self.refused(AVOIDER, {'margin': -1.0}, AVOIDER + '/margin = -1.0, expected a number >= 0 (m)')
        self.refused(AVOIDER, {'margin': math.nan}, AVOIDER + '/margin = nan, expected a number')
        self.refused(AVOIDER, {'stage': 'fly'}, "/stage = 'fly', expected one of: stop_only, avoid_single")
        self.refused(AVOIDER, {'margin': 0.03, 'lane_width': 0.0}, '/lane_width = 0.0, expected a number > 0 (m)')
        self.refused(DETECTOR, {'paper_white_low_hue': 300}, '/paper/white/low = [300, 0, 150], expected 3 whole')
        self.refused(DETECTOR, {'bird_view_crop_distance': 0.1}, '/bird_view/crop_distance = 0.1, expected a number')

    def test_a_node_that_is_started_again_is_as_it_was_tuned(self) -> None:
        self.clients[AVOIDER].update_configuration({'stage': 'avoid_single'})
        process = process_of(AVOIDER)
        os.kill(process, signal.SIGKILL)

        def another() -> bool:
            try:
                return process_of(AVOIDER) != process
            except Exception:
                return False

        wait_for(another, START, 'another process')
        rospy.wait_for_service(AVOIDER + '/set_parameters', START)
        self.diagnostics.wait(AVOIDER, lambda line: value_of(line, 'stage') == 'avoid_single', 'the stage')


if __name__ == '__main__':
    rospy.init_node('live_tuning')
    rostest.rosrun('obst_avoid', 'live_tuning', LiveTuning, sys.argv)
