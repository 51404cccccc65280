#!/usr/bin/env python3
"""daffy.launch beside today's stack, which this test plays: a lane filter, a lane controller that acts only when it
hears a lane pose and keeps the last StopLineReading, and a robot that drives as it is told.
"""

import math
import os
import signal
import subprocess
import sys
import threading
import time
import unittest
from typing import Any, Callable, List, Tuple

import rospy
import rostest
from duckietown_msgs.msg import BoolStamped, FSMState, LanePose, StopLineReading, Twist2DStamped
from geometry_msgs.msg import PoseArray
from helpers import ANSWER, START, Inbox, Repeating, pose_array, process_of, publisher, subscribers_of, wait_for
from std_msgs.msg import Header
from std_srvs.srv import SetBool

FULL = 0.2
"""[m/s] of the stack's lane controller, full_speed in config/daffy_adapter_node.yaml."""
RECORDER = """
import rospy
from duckietown_msgs.msg import LanePose
rospy.init_node('recorder')
rospy.Subscriber('/duck1/daffy_adapter_node/lane_pose', LanePose, lambda msg: None)
rospy.spin()
"""
LATEST = 1.0
"""[s] after a fault until the wheels stand; 0.5 s on a machine with nothing else to do."""


class Stack:
    """A straight lane with obstacles, a robot in it, and the parts of the stack that the adapter works with."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.obstacles: List[Tuple[float, float, float]] = []  # along, left and radius, in the lane
        self.along, self.d, self.phi = 0.0, 0.0, 0.0
        self.filter_works, self.heard = True, 0
        self.command, self.commanded = Twist2DStamped(), 0.0
        self.reading = StopLineReading()
        self._time = time.monotonic()
        self.readings = Inbox('/duck1/road_anomaly_watcher/obstacle_distance', StopLineReading).connected()
        self.emergency = Inbox('/duck1/wheels_driver_node/emergency_stop', BoolStamped).connected()
        self._poses = publisher('/duck1/lane_filter_node/lane_pose', LanePose)
        self._obstacles = publisher('/duck1/obstacle_detection_node/posearray', PoseArray)
        self._commands = publisher('/duck1/lane_controller_node/car_cmd', Twist2DStamped)
        rospy.Subscriber('/duck1/road_anomaly_watcher/obstacle_distance', StopLineReading, self._on_reading)
        rospy.Subscriber('/duck1/lane_controller_node/car_cmd', Twist2DStamped, self._on_command)
        self.follow('/duck1/daffy_adapter_node/lane_pose')

    def follow(self, topic: str) -> None:
        """Which lane pose the controller hears."""
        if hasattr(self, '_pose'):
            self._pose.unregister()
        self._pose = rospy.Subscriber(topic, LanePose, self._control, queue_size=1)

    def step(self) -> None:
        """The robot drives on; filter and detector say where things are."""
        with self.lock:
            seconds, self._time = time.monotonic() - self._time, time.monotonic()
            v, omega = self.command.v, self.command.omega
            self.along += v * math.cos(self.phi) * seconds
            self.d += v * math.sin(self.phi) * seconds
            self.phi += omega * seconds
            seen = [self._seen(*obstacle) for obstacle in self.obstacles]
            header = Header(stamp=rospy.Time.now())
            pose = LanePose(header=header, d=self.d, phi=self.phi) if self.filter_works else None
        if pose is not None:
            self._poses.publish(pose)
        near = [obstacle for obstacle in seen if 0.2 < obstacle[0] < 1.2]
        self._obstacles.publish(pose_array(near, header.stamp, 'duck1/footprint'))

    def _seen(self, along: float, left: float, radius: float) -> Tuple[float, float, float]:
        x, y = along - self.along, left - self.d
        x, y = (
            x * math.cos(self.phi) + y * math.sin(self.phi),
            y * math.cos(self.phi) - x * math.sin(self.phi),
        )
        near = 1 - radius / math.hypot(x, y)
        return x * near, y * near, radius

    def _on_reading(self, msg: StopLineReading) -> None:
        self.reading = msg

    def _on_command(self, msg: Twist2DStamped) -> None:
        with self.lock:
            self.command, self.commanded = msg, time.monotonic()

    def _control(self, msg: LanePose) -> None:
        self.heard += 1
        reading = self.reading
        factor = 0.0 if reading.at_stop_line else 0.25 if reading.stop_line_detected else 1.0
        omega = FULL * (-msg.d / 0.15**2 - 2 * math.sin(msg.phi) / 0.15)
        self._commands.publish(Twist2DStamped(header=msg.header, v=FULL * factor, omega=omega * factor))

    @property
    def speed(self) -> float:
        with self.lock:
            return float(self.command.v)


class Daffy(unittest.TestCase):
    def setUp(self) -> None:
        cls = type(self)
        if not hasattr(cls, 'stack'):
            cls.stack = Stack()
            cls.modes = rospy.Publisher('/duck1/fsm_node/mode', FSMState, queue_size=1, latch=True)
            rospy.wait_for_service('/duck1/daffy_adapter_node/switch', START)
            cls.switch = rospy.ServiceProxy('/duck1/daffy_adapter_node/switch', SetBool)
        self.put()
        driving = Repeating(self.stack.step)
        driving.__enter__()
        self.addCleanup(driving.__exit__)
        self.reaches(lambda: self.stack.speed > 0.9 * FULL, 'driving')

    def put(self, *obstacles: Tuple[float, float, float]) -> None:
        """Obstacles so far ahead of the robot, and left of the lane's middle."""
        with self.stack.lock:
            self.stack.obstacles = [(self.stack.along + x, y, radius) for x, y, radius in obstacles]

    def reaches(self, what: Callable[[], Any], name: str, seconds: float = ANSWER) -> None:
        wait_for(what, seconds, name)

    def stands(self, since: float, name: str) -> float:
        """Soon, and for a while. Returns after how many seconds."""
        self.reaches(lambda: self.stack.speed == 0 and self.stack.commanded > since, name)
        took = self.stack.commanded - since
        time.sleep(0.5)
        self.assertEqual(self.stack.speed, 0, name)
        return took

    def gap(self) -> float:
        """[m] between bumper and the obstacle that was put, radius 0.03 m at most."""
        return self.stack.obstacles[0][0] - 0.03 - self.stack.along - 0.066

    def stands_before_it(self, within: float = 0.45) -> None:
        """A busy machine may let it stand for a moment on the way."""
        self.reaches(lambda: self.stack.speed == 0 and self.gap() < within, 'standing before it', 30)
        self.stands(time.monotonic(), 'standing before it')

    def test_the_middle_of_a_free_lane(self) -> None:
        with self.stack.lock:
            self.stack.d = 0.08
        self.reaches(lambda: abs(self.stack.d) < 0.01 and abs(self.stack.phi) < 0.05, 'the middle')
        self.assertGreater(self.stack.speed, 0.9 * FULL)
        self.assertFalse(self.stack.reading.stop_line_detected or self.stack.reading.at_stop_line)

    def test_before_what_blocks_the_lane_it_slows_down_and_stops_and_drives_on(self) -> None:
        self.put((1.0, 0.0, 0.03))
        before, pressed = len(self.stack.readings.all()), len(self.stack.emergency.all())
        self.stands_before_it()
        asked = [(msg.stop_line_detected, msg.at_stop_line) for msg in self.stack.readings.all()[before:]]
        order = [item for item, last in zip(asked, [None, *asked]) if item != last]
        self.assertEqual(order[-1], (True, True))
        self.assertIn((True, False), order)
        self.assertTrue(0.05 < self.gap() < 0.45, self.gap())
        self.put()
        self.reaches(lambda: self.stack.speed > 0.9 * FULL, 'driving on')
        self.assertEqual([msg.data for msg in self.stack.emergency.all()[pressed:]], [True, False])

    def test_an_emergency_stop_of_somebody_else_is_not_released(self) -> None:
        person = publisher('/duck1/wheels_driver_node/emergency_stop', BoolStamped)
        self.addCleanup(person.publish, BoolStamped(data=False))
        self.put((1.0, 0.0, 0.03))
        self.stands_before_it()
        pressed = len(self.stack.emergency.all())
        person.publish(BoolStamped(data=True))
        self.reaches(lambda: len(self.stack.emergency.all()) == pressed + 1, 'the person')
        self.put()
        self.reaches(lambda: not self.stack.reading.stop_line_detected, 'free')
        time.sleep(0.5)
        self.assertEqual(len(self.stack.emergency.all()), pressed + 1, 'the adapter would let it drive')
        person.publish(BoolStamped(data=False))
        self.put((0.6, 0.0, 0.03))
        self.reaches(lambda: [msg.data for msg in self.stack.emergency.all()[pressed:]] == [True, False, True], 'again')

    def test_what_stands_at_the_side_is_passed(self) -> None:
        self.put((1.0, -0.085, 0.02))
        begin, most = self.stack.along, 0.0

        def passed() -> bool:
            nonlocal most
            most = max(most, self.stack.d)
            return self.stack.along > begin + 1.3

        self.reaches(passed, 'past it', 30)
        self.assertGreater(most, 0.015)
        self.assertLess(most, 0.05)
        self.reaches(lambda: abs(self.stack.d) < 0.01, 'the middle again')

    def test_without_the_remap_it_stops_instead_of_passing(self) -> None:
        self.stack.follow('/duck1/lane_filter_node/lane_pose')
        recorder = subprocess.Popen([sys.executable, '-c', RECORDER])  # another listener is no controller
        self.addCleanup(recorder.wait)
        self.addCleanup(recorder.terminate)
        self.reaches(lambda: '/recorder' in subscribers_of('/duck1/daffy_adapter_node/lane_pose'), 'a recorder', START)
        self.addCleanup(self.stack.follow, '/duck1/daffy_adapter_node/lane_pose')
        self.put((1.0, -0.085, 0.02))
        begin = self.stack.along
        self.stands_before_it(0.75)
        self.assertLess(self.stack.along, begin + 0.9)

    def test_in_another_mode_it_does_nothing(self) -> None:
        self.addCleanup(self.modes.publish, FSMState(state='LANE_FOLLOWING'))
        self.put((1.0, 0.0, 0.03))
        self.stands_before_it()
        self.modes.publish(FSMState(state='JOYSTICK_CONTROL'))
        self.reaches(lambda: self.stack.speed > 0.9 * FULL, 'cleared')
        self.put((0.6, 0.0, 0.03))
        self.modes.publish(FSMState(state='LANE_FOLLOWING'))
        self.stands(time.monotonic(), 'standing again')

    def test_switched_off_it_does_nothing(self) -> None:
        self.addCleanup(self.switch, True)
        self.put((1.0, 0.0, 0.03))
        self.stands_before_it()
        self.assertTrue(self.switch(False).success)
        self.reaches(lambda: self.stack.speed > 0.9 * FULL, 'cleared')
        self.put((0.6, 0.0, 0.03))
        self.assertTrue(self.switch(True).success)
        self.stands(time.monotonic(), 'standing again')

    def test_when_the_lane_filter_falls_silent_it_stands(self) -> None:
        # the controller acts only when it hears a pose
        since = time.monotonic()
        self.stack.filter_works = False
        try:
            self.assertLess(self.stands(since, 'standing'), LATEST)
            heard = self.stack.heard
            self.reaches(lambda: self.stack.heard > heard + 5, 'the last pose, again and again')
        finally:
            self.stack.filter_works = True
        self.reaches(lambda: self.stack.speed > 0.9 * FULL, 'driving on')

    def test_when_the_avoider_is_killed_it_stands(self) -> None:
        self.killed('obstacle_avoidance_node')

    def test_when_the_adapter_is_killed_it_stands(self) -> None:
        self.killed('daffy_adapter_node')

    def test_when_the_adapter_is_killed_a_controller_without_the_remap_stands_too(self) -> None:
        # it hears lane poses all the time, and keeps the last request: the guard asks it to stand
        self.stack.follow('/duck1/lane_filter_node/lane_pose')
        self.addCleanup(self.stack.follow, '/duck1/daffy_adapter_node/lane_pose')
        self.killed('daffy_adapter_node')

    def killed(self, node: str) -> None:
        process, since = process_of('/duck1/' + node), time.monotonic()
        os.kill(process, signal.SIGKILL)
        self.reaches(lambda: self.stack.speed == 0, 'standing')
        self.assertLess(self.stack.commanded - since, LATEST)
        self.reaches(lambda: self.stack.speed > 0.9 * FULL, 'driving on with the next', START)


if __name__ == '__main__':
    rospy.init_node('daffy')
    rostest.rosrun('obst_avoid', 'daffy', Daffy, sys.argv)
