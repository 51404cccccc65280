#!/usr/bin/env python3
"""The avoider between obstacle lists and lane poses that are published by hand, on wall time."""

import math
import sys
import threading
import unittest
from typing import List, Optional, Sequence, Set, Tuple

import rospy
import rostest
from geometry_msgs.msg import PoseArray
from helpers import ANSWER, START, Inbox, Repeating, nanoseconds, pose_array, publisher, wait_for
from std_msgs.msg import Header, String
from visualization_msgs.msg import Marker, MarkerArray

from obst_avoid.msg import BoolStamped, LaneControl, LanePose

BLOCKING = (0.40, 0.0, 0.02)
BESIDE_RIGHT, BESIDE_LEFT = (0.35, -0.085, 0.012), (0.35, 0.085, 0.012)
"""(x, y, z) on the wire: in the lane, with room to pass it inside the lane on the other side."""
OUTSIDE = (0.40, 0.0, -0.02)
NAN = (0.40, math.nan, 0.02)
STOP_HOLD, AGE_LIMIT = 1.0, 0.3
"""[s] of config/obstacle_avoidance_node.yaml."""
LOOK_AHEAD, CORRIDOR = 0.65, 0.095
"""[m] of the same: how far the corridor reaches, and half its width with the margin."""


class Robot:
    """One avoider: what it is told, and what it says."""

    def __init__(self, veh: str) -> None:
        self.veh = veh
        node = '/%s/obstacle_avoidance_node' % veh
        self.control = Inbox(node + '/lane_control', LaneControl).connected()
        self.flag = Inbox(node + '/obstacle_avoidance_active_flag', BoolStamped).connected()
        self.before_anything: List[LaneControl] = []
        self._obstacles = publisher('/%s/obstacle_detection_node/posearray' % veh, PoseArray)
        self._lane_pose = publisher('/%s/lane_filter_node/lane_pose' % veh, LanePose)
        self._own = publisher('/%s/obstacle_detection_node/lane_pose' % veh, LanePose)
        self.turn = publisher('/%s/turn' % veh, String)
        self._lock = threading.Lock()
        self._scene: Optional[Sequence[Tuple[float, float, float]]] = ()
        self._d: Optional[float] = 0.0
        self.own = False
        self._frame = veh + '/footprint'
        self.stamps: Set[int] = set()

    def publish(self) -> None:
        """Lane pose and obstacle list of this instant."""
        with self._lock:
            if self._d is not None:
                self._lane_pose.publish(LanePose(header=Header(stamp=rospy.Time.now()), d=self._d))
            if self.own:
                self._own.publish(LanePose(header=Header(stamp=rospy.Time.now())))
            if self._scene is not None:
                msg = pose_array(self._scene, rospy.Time.now(), self._frame)
                self.stamps.add(nanoseconds(msg))
                self._obstacles.publish(msg)

    def sees(
        self,
        scene: Optional[Sequence[Tuple[float, float, float]]],
        d: Optional[float] = 0.0,
        frame: Optional[str] = None,
    ) -> int:
        """From now on; None publishes none. Returns the time [ns] before which the old scene was published."""
        with self._lock:
            self._scene, self._d, self._frame = scene, d, frame or self.veh + '/footprint'
            return int(rospy.Time.now().to_nsec())

    def waits_until(self, state: int, words: str = '', seconds: float = ANSWER) -> LaneControl:
        """The next LaneControl in this state and with these words in its reason."""
        wanted = 'state %d, %r' % (state, words)
        try:
            return self.control.wait_new(lambda msg: msg.state == state and words in msg.reason, wanted, seconds)
        except AssertionError as error:
            raise AssertionError('%s, the last was:\n%s' % (error, self.control.all()[-1])) from error


class Avoidance(unittest.TestCase):
    robots: Sequence[Robot] = ()

    def setUp(self) -> None:
        if not self.robots:
            robots = [Robot('duck1'), Robot('duck2')]
            for robot in robots:  # before anything is published, for the test of silence
                wait_for(lambda robot=robot: len(robot.control.all()) >= 20, START, 'LaneControl of ' + robot.veh)
                robot.before_anything = robot.control.all()
            type(self).robots = robots
        self.robot, self.stop_only = self.robots
        for robot in self.robots:
            robot.sees([])
            feeding = Repeating(robot.publish)
            feeding.__enter__()
            self.addCleanup(feeding.__exit__)
        for robot in self.robots:
            robot.waits_until(LaneControl.CLEAR)

    def flag_says_so_too(self, control: LaneControl) -> None:
        self.robot.flag.wait(
            lambda msg: nanoseconds(msg) == nanoseconds(control) and msg.data == control.active,
            'the flag of the same stamp says %s' % control.active,
        )

    def test_silence_is_a_fault_from_the_start_and_is_said_all_the_time(self) -> None:
        for robot in self.robots:
            for msg in robot.before_anything:
                self.assertEqual((msg.state, msg.active, msg.v_ref), (LaneControl.FAULT, True, 0.0))
                self.assertEqual(nanoseconds(msg), 0)
                self.assertIn('no obstacle list yet', msg.reason)

    def test_silence_later_is_a_fault_five_times_a_second(self) -> None:
        self.robot.sees(None, None)
        last = max(self.robot.stamps)
        msg = self.robot.waits_until(LaneControl.FAULT, 'the obstacle list is')
        self.assertEqual((nanoseconds(msg), msg.v_ref, msg.active), (last, 0.0, True))

        def fast() -> bool:
            arrived = self.robot.control.arrived()[-10:]
            return all(item.msg.state == LaneControl.FAULT for item in arrived) and (
                len(arrived) / max(arrived[-1].wall - arrived[0].wall, 1e-3) >= 5
            )

        wait_for(fast, ANSWER, 'LaneControl at 5 Hz')

    def test_clear(self) -> None:
        msg = self.robot.waits_until(LaneControl.CLEAR)
        self.assertFalse(msg.active)
        self.assertAlmostEqual(msg.v_ref, 0.2, places=6)
        self.assertEqual(msg.d_ref, 0)
        self.flag_says_so_too(msg)

    def test_each_stamp_is_exactly_that_of_an_obstacle_list(self) -> None:
        self.robot.sees([BLOCKING])
        self.robot.waits_until(LaneControl.STOPPED)
        said = [nanoseconds(msg) for msg in self.robot.control.all()]
        self.assertEqual([stamp for stamp in said if stamp and stamp not in self.robot.stamps], [])
        flagged = [nanoseconds(msg) for msg in self.robot.flag.all()]
        self.assertEqual([stamp for stamp in flagged if stamp and stamp not in self.robot.stamps], [])
        # It decides on the lists, not only by its timer: most of them have their own answer.
        self.assertGreater(len(set(said) & self.robot.stamps), len(self.robot.stamps) / 2)

    def test_something_that_blocks_stops_and_is_held_after_it_is_gone(self) -> None:
        self.robot.sees([BLOCKING])
        msg = self.robot.waits_until(LaneControl.STOPPED, '1 obstacle in the lane, nearest 0.40 m')
        self.assertEqual((msg.v_ref, msg.active), (0.0, True))
        self.flag_says_so_too(msg)
        gone = self.robot.sees([])
        held = self.robot.waits_until(LaneControl.STOPPED, 'waiting')
        self.assertEqual((held.v_ref, held.active), (0.0, True))
        self.assertGreater(nanoseconds(held), gone)
        released = self.robot.waits_until(LaneControl.CLEAR)
        # The stamp is the list's, which may be as old as the age limit when it is decided on.
        self.assertGreater((nanoseconds(released) - gone) / 1e9, STOP_HOLD - AGE_LIMIT - 0.1)
        between = [msg.state for msg in self.robot.control.all() if gone < nanoseconds(msg) < nanoseconds(released)]
        self.assertNotIn(LaneControl.AVOIDING, between)

    def test_something_outside_the_lane_does_not_count(self) -> None:
        before = len(self.robot.control.all())
        since = self.robot.sees([OUTSIDE])
        self.robot.control.wait(lambda msg: nanoseconds(msg) > since + 10**9, 'a second later', since=before)
        self.assertNotIn(LaneControl.STOPPED, [msg.state for msg in self.robot.control.all()[before:]])
        self.robot.waits_until(LaneControl.CLEAR)

    def test_something_at_the_right_is_passed_at_the_left(self) -> None:
        self.robot.sees([BESIDE_RIGHT])
        msg = self.robot.waits_until(LaneControl.AVOIDING, '1 obstacle in the lane at 0.35 m')
        self.assertTrue(0.005 < msg.d_ref < 0.036, msg.d_ref)
        self.assertAlmostEqual(msg.v_ref, 0.12, places=6)
        self.assertTrue(msg.active)
        self.flag_says_so_too(msg)

    def test_something_at_the_left_is_passed_at_the_right(self) -> None:
        self.robot.sees([BESIDE_LEFT])
        self.assertTrue(-0.036 < self.robot.waits_until(LaneControl.AVOIDING).d_ref < -0.005)

    def test_two_obstacles_stop(self) -> None:
        self.robot.sees([BESIDE_RIGHT, BESIDE_LEFT])
        self.robot.waits_until(LaneControl.STOPPED, '2 obstacles in the lane')

    def test_the_stage_stop_only_stops_where_there_is_room(self) -> None:
        before = len(self.stop_only.control.all())
        self.stop_only.sees([BESIDE_RIGHT])
        self.stop_only.waits_until(LaneControl.STOPPED, 'stage stop_only')
        self.assertNotIn(LaneControl.AVOIDING, [msg.state for msg in self.stop_only.control.all()[before:]])

    def test_the_lane_pose_counts(self) -> None:
        # From 3 cm left of the centre a duckie straight ahead stands in the left half of the lane as well.
        self.robot.sees([(0.35, -0.115, 0.012)], d=0.03)
        self.assertTrue(0.005 < self.robot.waits_until(LaneControl.AVOIDING).d_ref < 0.036)

    def refused(self, words: str) -> int:
        """What is published now is not used, which ends in a fault; the next good messages are used again.

        Returns the time [ns] from which on they were good.
        """
        msg = self.robot.waits_until(LaneControl.FAULT, words)
        self.assertEqual((msg.v_ref, msg.active), (0.0, True))
        self.assertIn(nanoseconds(msg), self.robot.stamps)
        good = self.robot.sees([])
        self.robot.waits_until(LaneControl.CLEAR)
        return good

    def lists_refused(self, since: int, until: int) -> None:
        """Not even the stamps of the lists between two times [ns] were used."""
        said = [nanoseconds(msg) for msg in self.robot.control.all()]
        self.assertEqual([stamp for stamp in said if since < stamp < until], [])

    def test_nan_in_an_obstacle_list(self) -> None:
        since = self.robot.sees([NAN])
        self.lists_refused(since, self.refused('the obstacle list is'))

    def test_another_frame(self) -> None:
        since = self.robot.sees([BLOCKING], frame='duck2/footprint')
        self.lists_refused(since, self.refused('the obstacle list is'))

    def test_nan_in_the_lane_pose(self) -> None:
        self.robot.sees([], d=math.nan)
        self.refused('the lane pose is')

    def test_no_lane_pose(self) -> None:
        self.robot.sees([], d=None)
        self.refused('the lane pose is')

    def test_our_own_lane_pose_is_enough(self) -> None:
        robot = self.stop_only  # the other one would look for its lines for a while
        robot.own = True
        self.addCleanup(setattr, robot, 'own', False)
        since = robot.sees([], d=None)
        before = len(robot.control.all())
        robot.control.wait(lambda msg: nanoseconds(msg) > since + 10**9, 'a second later', since=before)
        self.assertEqual({msg.state for msg in robot.control.all()[before:]}, {LaneControl.CLEAR})
        robot.own = False
        robot.waits_until(LaneControl.FAULT, 'the lane pose is')

    def test_a_turn_that_there_is_not_is_not_heard(self) -> None:
        for turn in ('sideways', '', 'left', ''):
            self.robot.turn.publish(String(turn))
        self.robot.sees([BLOCKING])
        self.robot.waits_until(LaneControl.STOPPED)

    def test_markers_for_those_who_look(self) -> None:
        self.robot.sees([BESIDE_RIGHT])
        self.robot.waits_until(LaneControl.AVOIDING)
        since = int(rospy.Time.now().to_nsec())
        markers = Inbox('/duck1/obstacle_avoidance_node/markers', MarkerArray)
        self.addCleanup(markers.close)
        msg = markers.wait(lambda msg: any(marker.ns == 'deciding' for marker in msg.markers), 'the obstacle')
        named = {marker.ns: marker for marker in msg.markers}
        self.assertLessEqual({'region', 'path', 'deciding'}, set(named))
        for marker in msg.markers:
            self.assertEqual((marker.header.frame_id, marker.action), ('duck1/footprint', Marker.ADD))
            self.assertIn(nanoseconds(marker), self.robot.stamps)
            self.assertGreater(nanoseconds(marker), since - 10**9, 'not one that was kept from earlier')
        region = named['region'].points
        self.assertEqual(region[0], region[-1], 'it is closed')
        self.assertAlmostEqual(max(p.x for p in region), LOOK_AHEAD, delta=0.05)
        self.assertAlmostEqual(min(p.x for p in region), 0.0, delta=0.01)
        self.assertAlmostEqual(max(p.y for p in region), CORRIDOR, delta=0.01)
        self.assertAlmostEqual(min(p.y for p in region), -CORRIDOR, delta=0.01)
        self.assertGreater(named['path'].points[-1].y, 0.005, 'it passes at the left')
        deciding = named['deciding']
        distance = math.hypot(*BESIDE_RIGHT[:2])
        self.assertAlmostEqual(deciding.pose.position.x, BESIDE_RIGHT[0] * (1 + 0.012 / distance), places=4)
        self.assertAlmostEqual(deciding.pose.position.y, BESIDE_RIGHT[1] * (1 + 0.012 / distance), places=4)
        self.robot.sees([])
        markers.wait_new(
            lambda msg: any(marker.ns == 'deciding' and marker.action == Marker.DELETE for marker in msg.markers),
            'the deletion of what does not decide any more',
        )


if __name__ == '__main__':
    rospy.init_node('avoidance')
    rostest.rosrun('obst_avoid', 'avoidance', Avoidance, sys.argv)
