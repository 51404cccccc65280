#!/usr/bin/env python3
"""The lane controller between lane poses and LaneControl that are published by hand, on wall time."""

import math
import sys
import threading
import unittest
from typing import Any, Optional

import rospy
import rostest
from helpers import Diagnostics, Inbox, Repeating, nanoseconds, publisher
from std_msgs.msg import Header

from obst_avoid.msg import LaneControl, LanePose, Twist2DStamped

NODE = '/duck1/lane_controller_node'
CLEAR = LaneControl(state=LaneControl.CLEAR, active=False, v_ref=0.2)
STOPPED = LaneControl(state=LaneControl.STOPPED, active=True, v_ref=0.0)
CRUISE = 0.2
"""[m/s] of config/lane_controller_node.yaml."""
LATEST = 1.0
"""[s] after which the wheels must stand when an input has stopped; the limit is 0.4 s, the machine may be busy."""


def avoiding(d_ref: float, v_ref: float = 0.12) -> LaneControl:
    return LaneControl(state=LaneControl.AVOIDING, active=True, d_ref=d_ref, v_ref=v_ref)


class Controller(unittest.TestCase):
    def setUp(self) -> None:
        cls = type(self)
        if not hasattr(cls, 'commands'):
            cls.commands = Inbox(NODE + '/car_cmd', Twist2DStamped).connected()
            cls.diagnostics = Diagnostics()
            cls.pose_publisher = publisher('/duck1/lane_filter_node/lane_pose', LanePose)
            cls.control_publisher = publisher('/duck1/obstacle_avoidance_node/lane_control', LaneControl)
        self.lock = threading.Lock()
        self.published = 0
        self.told(CLEAR)
        feeding = Repeating(self.publish)
        feeding.__enter__()
        self.addCleanup(feeding.__exit__)
        self.commands.wait_new(lambda msg: msg.v > 0, 'driving')

    def publish(self) -> None:
        with self.lock:
            if self.pose is not None:
                self.pose_publisher.publish(LanePose(header=Header(stamp=rospy.Time.now()), **self.pose))
            if self.control is not None:
                self.control_publisher.publish(self.control)

    def told(self, control: Optional[LaneControl], **pose: Any) -> int:
        """From now on. Returns the time [ns] before which the old was published."""
        with self.lock:
            self.control, self.pose = control, pose
            return int(rospy.Time.now().to_nsec())

    def settled(self, control: LaneControl, **pose: float) -> Twist2DStamped:
        """A command once both have arrived; one that drives, unless asked to stand: inputs may be late for a moment."""
        since = self.told(control, **pose)
        stands = control.active and control.v_ref == 0
        return self.commands.wait(
            lambda msg: nanoseconds(msg) > since + 3 * 10**8 and (stands or msg.v > 0), 'a command 0.3 s later'
        )

    def test_follows_the_lane_when_nothing_is_asked(self) -> None:
        msg = self.settled(CLEAR, d=0.0, phi=0.0)
        self.assertAlmostEqual(msg.v, CRUISE, places=6)
        self.assertAlmostEqual(msg.omega, 0, places=6)

    def test_left_of_the_centre_turns_right(self) -> None:
        self.assertLess(self.settled(CLEAR, d=0.05, phi=0.0).omega, -0.1)

    def test_right_of_the_centre_turns_left(self) -> None:
        self.assertGreater(self.settled(CLEAR, d=-0.05, phi=0.0).omega, 0.1)

    def test_turned_left_turns_right(self) -> None:
        self.assertLess(self.settled(CLEAR, d=0.0, phi=0.3).omega, -0.1)

    def test_a_lane_that_bends_left_turns_left(self) -> None:
        self.assertGreater(self.settled(CLEAR, d=0.0, phi=0.0, curvature=2.0).omega, 0.1)

    def test_tracks_offset_and_speed_when_active(self) -> None:
        msg = self.settled(avoiding(0.03), d=0.0, phi=0.0)
        self.assertAlmostEqual(msg.v, 0.12, places=6)
        self.assertGreater(msg.omega, 0.05)
        there = self.settled(avoiding(0.03), d=0.03, phi=0.0)
        self.assertAlmostEqual(there.omega, 0, places=5)
        self.assertLess(self.settled(avoiding(-0.03), d=0.0, phi=0.0).omega, -0.05)

    def test_an_offset_counts_only_when_active(self) -> None:
        offset = LaneControl(state=LaneControl.CLEAR, active=False, d_ref=0.03, v_ref=0.05)
        msg = self.settled(offset, d=0.0, phi=0.0)
        self.assertAlmostEqual(msg.omega, 0, places=6)
        self.assertAlmostEqual(msg.v, CRUISE, places=6)

    def test_stands_when_asked_to(self) -> None:
        msg = self.settled(STOPPED, d=0.05, phi=0.3)
        self.assertEqual((msg.v, msg.omega), (0.0, 0.0))
        self.diagnostics.wait(NODE, lambda line: 'asked to' in line.message, 'why it stands')

    def stands_after(self, since: int, words: str) -> None:
        """Soon the command is to stand, and it stays so."""
        first = self.commands.wait(lambda msg: nanoseconds(msg) > since and msg.v == 0, 'standing')
        self.assertLess((nanoseconds(first) - since) / 1e9, LATEST)
        later = self.commands.wait(lambda msg: nanoseconds(msg) > nanoseconds(first) + 10**9, 'a second later')
        after = [msg for msg in self.commands.all() if nanoseconds(first) <= nanoseconds(msg) <= nanoseconds(later)]
        self.assertEqual({(msg.v, msg.omega) for msg in after}, {(0.0, 0.0)})
        self.assertGreaterEqual(len(after), 5, 'wheels go on with the last command that they got')
        self.diagnostics.wait(NODE, lambda line: words in line.message, words)

    def test_stands_when_lane_poses_stop(self) -> None:
        since = self.told(CLEAR)
        with self.lock:
            self.pose = None
        self.stands_after(since, 'the lane pose is')

    def test_stands_when_lane_control_stops(self) -> None:
        self.stands_after(self.told(None, d=0.05), 'the lane control is')

    def test_stands_when_both_stop(self) -> None:
        since = self.told(None)
        with self.lock:
            self.pose = None
        self.stands_after(since, 'is')  # said by its timer alone

    def test_a_lane_pose_of_nan_is_not_used(self) -> None:
        self.stands_after(self.told(CLEAR, d=math.nan), 'the lane pose is')

    def test_a_lane_control_that_contradicts_itself_is_not_used(self) -> None:
        self.stands_after(
            self.told(LaneControl(state=LaneControl.AVOIDING, active=False, v_ref=0.1)), 'the lane control'
        )


if __name__ == '__main__':
    rospy.init_node('lane_controller')
    rostest.rosrun('obst_avoid', 'lane_controller', Controller, sys.argv)
