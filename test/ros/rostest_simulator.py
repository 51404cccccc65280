#!/usr/bin/env python3
"""The simulated town in the ROS graph: what a robot would publish, the truth beside it, and a closed loop."""

import json
import os
import sys
import tempfile
from typing import Any, List

import numpy as np
import rospy
import rostest
from geometry_msgs.msg import PoseArray, PoseStamped
from helpers import Inbox, Prepared, default_calibration, nanoseconds, run_program
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage
from std_msgs.msg import String

from obst_avoid.core.picture import decode_jpeg
from obst_avoid.msg import BoolStamped, LaneControl, LanePose

VEH = 'town'
RATE, DURATION = 10.0, 8.0
"""Pictures a second; [s] of the drive."""
ALONG, RADIUS = 1.0, 0.035
"""[m] from the start to the ball's middle along the lane, and half its height."""
AHEAD = 0.066
"""[m] of the body ahead of the axle."""
SCENARIO = """
about: A duckie stands in the middle of the lane.
seed: 1
map: straight
start: {column: 0, row: 0, heading: east, along: 0.5, d: 0.0, phi: 0.0}
turns: []
obstacles:
  - {sort: duckie, height: 0.06, along: 1.0, left: 0.0, yaw: 1.57}
clutter: 0
light: {color: white, strength: 1.0, lamps: 1, glare: 0.0, unevenness: 0.0, headlight: 0.0}
pose_errors: real
turn_said: true           # whether anybody says which turn the robot will take
duration: 8.0
success: {must: stop, goal: 3.0, smallest_gap: 0.05, largest_gap: 0.45}
"""


def topic(name: str) -> str:
    return '/%s/%s' % (VEH, name)


class Simulator(Prepared):
    log: str
    clock: List[Clock]
    images: List[CompressedImage]
    infos: List[CameraInfo]
    poses: List[LanePose]
    arrived: List[int]
    seen: List[PoseArray]
    controls: List[LaneControl]
    places: List[PoseStamped]
    true_poses: List[LanePose]
    true_obstacles: List[PoseArray]
    contacts: List[BoolStamped]
    scenarios: List[String]
    path: str

    @classmethod
    def prepare(cls) -> None:
        inboxes = {
            'clock': Inbox('/clock', Clock),
            'images': Inbox(topic('camera_node/image/compressed'), CompressedImage),
            'infos': Inbox(topic('camera_node/camera_info'), CameraInfo),
            'poses': Inbox(topic('lane_filter_node/lane_pose'), LanePose),
            'seen': Inbox(topic('obstacle_detection_node/posearray'), PoseArray),
            'controls': Inbox(topic('obstacle_avoidance_node/lane_control'), LaneControl),
            'places': Inbox(topic('simulator_node/truth/pose'), PoseStamped),
            'true_poses': Inbox(topic('simulator_node/truth/lane_pose'), LanePose),
            'true_obstacles': Inbox(topic('simulator_node/truth/obstacles'), PoseArray),
            'contacts': Inbox(topic('simulator_node/truth/contact'), BoolStamped),
            'scenarios': Inbox(topic('simulator_node/scenario'), String),
        }
        folder = tempfile.mkdtemp(prefix='obst_avoid_')
        cls.path = os.path.join(folder, 'duckie.yaml')
        with open(cls.path, 'w', encoding='utf-8') as file:
            file.write(SCENARIO)
        arguments = {
            'veh': VEH,
            'scenario': 'duckie.yaml',  # seen from where roslaunch is called, not from where nodes run
            'stage': 'stop_only',
            'profile': 'robust',
            'msgs_package': 'obst_avoid',
            'real_time_factor': '0',
            'picture_rate': str(RATE),
            'ends': 'true',
        }
        call = ['roslaunch', 'obst_avoid', 'simulation.launch', *('%s:=%s' % item for item in arguments.items())]
        cls.log = run_program(call, 150, {'PWD': folder}).output
        for name, inbox in inboxes.items():
            setattr(cls, name, inbox.all())

    def said(self, *marks: str) -> List[str]:
        """Lines of roslaunch's output with one of the marks."""
        return [line for line in self.log.splitlines() if any(mark in line for mark in marks)]

    def stamps(self, messages: List[Any]) -> 'np.ndarray':
        """[s] of their headers."""
        return np.array([nanoseconds(msg) / 1e9 for msg in messages])

    def test_it_runs_its_time_and_ends_by_itself(self) -> None:
        self.assertEqual(len(self.said('the drive is over: its time of 8 s is up')), 1, self.log[-3000:])
        self.assertEqual(self.said('Traceback', '[FATAL]', '[ERROR]', 'exit code'), [], self.log[-3000:])

    def test_time_runs_forward_in_small_steps(self) -> None:
        times = np.array([msg.clock.to_sec() for msg in self.clock])
        times = times[times > times[0]]
        self.assertGreater(len(times), 500)
        steps = np.diff(times)
        self.assertGreaterEqual(steps.min(), 0.0)
        self.assertLess(np.median(steps), 0.0101)
        self.assertAlmostEqual(times[-1] - times[0], DURATION, delta=0.5)

    def test_pictures_come_at_the_cameras_rate_with_their_camera_info(self) -> None:
        stamps = self.stamps(self.images)
        self.assertGreaterEqual(len(stamps), 0.9 * RATE * DURATION)
        self.assertAlmostEqual(float(np.median(np.diff(stamps))), 1 / RATE, delta=0.0051)
        self.assertEqual({msg.header.frame_id for msg in self.images}, {VEH + '/camera_optical_frame'})
        with_info = {nanoseconds(msg) for msg in self.infos} & {nanoseconds(msg) for msg in self.images}
        self.assertGreaterEqual(len(with_info), 0.9 * len(stamps))
        calibration = default_calibration()
        self.assertEqual(decode_jpeg(bytes(self.images[-1].data)).shape, (calibration.height, calibration.width, 3))
        info = self.infos[-1]
        np.testing.assert_allclose(np.reshape(info.K, (3, 3)), calibration.camera_matrix)
        np.testing.assert_allclose(np.reshape(info.P, (3, 4))[:, :3], calibration.projection)
        np.testing.assert_allclose(info.D, calibration.distortion)

    def test_most_pictures_are_answered(self) -> None:
        shown = {nanoseconds(msg) for msg in self.images}
        answered = {nanoseconds(msg) for msg in self.seen}
        self.assertGreater(len(shown & answered), 0.85 * len(shown))

    def test_the_lane_pose_is_that_of_a_lane_filter(self) -> None:
        stamps = self.stamps(self.poses)
        self.assertAlmostEqual(float(np.median(np.diff(stamps))), 0.1, delta=0.0051)
        cells = np.array([msg.phi for msg in self.poses]) / 0.1
        np.testing.assert_allclose(cells, np.round(cells), atol=1e-4)
        truth = np.interp(stamps, self.stamps(self.true_poses), [msg.d for msg in self.true_poses])
        errors = np.array([msg.d for msg in self.poses]) - truth
        self.assertGreater(errors.std(), 0.004)
        self.assertLess(abs(errors).max(), 0.09)

    def test_the_robot_drives_stops_before_the_duckie_and_touches_nothing(self) -> None:
        driving = [msg for msg in self.controls if 'the clock has stood still' not in msg.reason]  # at the end it does
        self.assertIn(LaneControl.CLEAR, [msg.state for msg in driving])
        self.assertEqual(driving[-1].state, LaneControl.STOPPED, driving[-1].reason)
        self.assertTrue(self.contacts)
        self.assertFalse(any(msg.data for msg in self.contacts))
        driven = self.places[-1].pose.position.x - self.places[0].pose.position.x
        self.assertGreater(driven, 0.3)
        self.assertLess(driven, ALONG - AHEAD - RADIUS)

    def test_the_truth_says_where_the_duckie_stands(self) -> None:
        first, last = self.true_obstacles[0], self.true_obstacles[-1]
        self.assertEqual(last.header.frame_id, VEH + '/footprint')
        # The duckie looks across the road: its near point is half its width, 0.87 of 6 cm, before its middle.
        self.assertAlmostEqual(first.poses[0].position.x, ALONG - 0.026, delta=0.006)
        self.assertAlmostEqual(first.poses[0].position.y, 0.0, delta=0.005)
        self.assertGreater(first.poses[0].position.z, 0)
        driven = self.places[-1].pose.position.x - self.places[0].pose.position.x
        nearer = first.poses[0].position.x - last.poses[0].position.x
        self.assertAlmostEqual(nearer, driven, delta=0.02)

    def test_it_says_what_it_drives(self) -> None:
        content = json.loads(self.scenarios[-1].data)
        self.assertEqual((os.path.basename(content['file']), content['seed']), ('duckie.yaml', 1))
        self.assertTrue(os.path.samefile(content['file'], self.path))


if __name__ == '__main__':
    rospy.init_node('simulator_test')
    rostest.rosrun('obst_avoid', 'simulator', Simulator, sys.argv)
