"""obstacle_avoidance_node: decides on each PoseArray; when none comes, ten times a second."""

import threading
from dataclasses import dataclass, replace
from typing import Any

import rospy
from geometry_msgs.msg import PoseArray
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from obst_avoid.cfg import ObstacleAvoidanceConfig
from obst_avoid.core.age import age
from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide, restamped
from obst_avoid.core.avoidance.corridor import TURNS, view_of
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.avoidance.shown import view_in_picture
from obst_avoid.core.motion import remembered
from obst_avoid.core.settings import text
from obst_avoid.core.types import Decision, Stamped, State, in_words
from obst_avoid.msg import LaneControl
from obst_avoid.ros import border, node
from obst_avoid.ros.live import LiveSettings
from obst_avoid.ros.markers import markers_from_decision
from obst_avoid.ros.messages import find_messages

PERIOD = 0.1
"""[s] after which LaneControl is published again when no PoseArray came; the controller waits for 0.4 s."""
LOOK = 0.02
"""[s] of wall time between looks at the clock, so that the period also holds when ROS time runs faster."""


@dataclass(frozen=True)
class AvoidanceNodeSettings(AvoidanceSettings):
    """The avoider's settings and those of its node, which launch files set."""

    veh: str = text()
    msgs_package: str = text()


class AvoidanceNode:
    """Holds the latest inputs and the memory under one lock; `_decide` is the one place that decides."""

    def __init__(self) -> None:
        self._settings = node.private_settings(AvoidanceNodeSettings)
        self._messages = find_messages(self._settings.msgs_package)
        self._frame = border.footprint_frame(self._settings.veh)
        self._lock = threading.Lock()
        self._clock = node.ClockWatch()
        self._inputs, self._memory = Inputs(), Memory()
        self._decided, self._decided_wall = 0, 0.0
        self._decision = Decision(State.FAULT, 0.0, 0.0, 'stopping: no obstacle list yet')
        self._rate = node.Rate()
        self._publisher = rospy.Publisher('~lane_control', LaneControl, queue_size=1)
        self._flag = rospy.Publisher('~obstacle_avoidance_active_flag', self._messages.BoolStamped, queue_size=1)
        self._markers = rospy.Publisher('~markers', MarkerArray, queue_size=1)
        self._health = node.Health(self._settings.veh, self._diagnose)
        self._live = LiveSettings(ObstacleAvoidanceConfig, AvoidanceNodeSettings, self._tune)
        node.every(LOOK, self._on_look)
        rospy.Subscriber('~lane_pose', self._messages.LanePose, self._on_lane_pose, queue_size=1)
        rospy.Subscriber('~own_lane_pose', self._messages.LanePose, self._on_own_lane_pose, queue_size=1)
        rospy.Subscriber('~car_cmd', self._messages.Twist2DStamped, self._on_car_cmd, queue_size=10)
        rospy.Subscriber('~turn', String, self._on_turn, queue_size=1)
        rospy.Subscriber('~posearray', PoseArray, node.callback(self._on_obstacles), queue_size=1)

    def _tune(self, settings: AvoidanceNodeSettings) -> None:
        with self._lock:
            self._settings = settings

    def _on_lane_pose(self, msg: Any) -> None:
        pose = node.stamped_lane_pose(msg, 'lane pose')
        if pose is not None:
            with self._lock:
                self._inputs = replace(self._inputs, lane_pose=pose)

    def _on_own_lane_pose(self, msg: Any) -> None:
        pose = node.stamped_lane_pose(msg, 'own lane pose')
        if pose is not None:
            with self._lock:
                self._inputs = replace(self._inputs, own_lane_pose=pose)

    def _on_car_cmd(self, msg: Any) -> None:
        """A command counts from when it is heard: its stamp may be that of the picture that it rests on."""
        try:
            command = border.command_from_msg(msg)
        except border.BorderError as error:
            node.dropped('car command', error)
            return
        now = border.nanoseconds(rospy.Time.now())
        with self._lock:
            self._inputs = replace(self._inputs, commands=remembered(self._inputs.commands, Stamped(now, command)))

    def _on_turn(self, msg: String) -> None:
        if msg.data and msg.data not in TURNS:
            node.dropped('turn', ValueError('%r, expected one of: %s, or nothing' % (msg.data, ', '.join(TURNS))))
            return
        with self._lock:
            turn = Stamped(border.nanoseconds(rospy.Time.now()), msg.data) if msg.data else None
            self._inputs = replace(self._inputs, turn=turn)

    def _on_obstacles(self, msg: PoseArray) -> None:
        try:
            seen = Stamped(border.nanoseconds(msg.header.stamp), border.obstacles_from_pose_array(msg, self._frame))
        except border.BorderError as error:
            node.dropped('obstacle list', error)
            return
        with self._lock:
            self._inputs = replace(self._inputs, obstacles=seen)
            self._decide(self._clock.look())
        self._rate.tick()

    def _on_look(self) -> None:
        with self._lock:
            clock = self._clock.look()
            if age(self._decided, clock.now) >= PERIOD or clock.wall - self._decided_wall >= PERIOD or clock.backwards:
                self._decide(clock)

    def _decide(self, clock: node.ClockReading) -> None:
        if clock.backwards:
            rospy.logwarn('%s: time ran backwards', rospy.get_name())
            self._memory = restamped(self._memory, clock.now)
        inputs = replace(self._inputs, clock_stood=clock.stood)
        before = self._decision
        decision, self._memory = decide(inputs, self._memory, clock.now, self._settings)
        self._decision, self._decided, self._decided_wall = decision, clock.now, clock.wall
        stamp = 0 if inputs.obstacles is None else inputs.obstacles.stamp
        self._publisher.publish(border.lane_control_from_decision(decision, stamp))
        self._flag.publish(border.flag_from_decision(decision, stamp, self._messages.BoolStamped))
        if decision.state is not before.state:
            rospy.loginfo('%s: %s, %s', rospy.get_name(), decision.state.name, decision.reason)
        if self._markers.get_num_connections() and self._memory.lane is not None:
            view = view_in_picture(decision, inputs.commands, clock.now, stamp, self._settings)
            view = view or view_of(decision, self._memory.lane.pose, self._settings)
            self._markers.publish(markers_from_decision(decision, view, stamp, self._frame))

    def _diagnose(self, status: Any) -> None:
        with self._lock:
            decision, inputs = self._decision, self._inputs
        now = border.nanoseconds(rospy.Time.now())
        faulty = decision.state is State.FAULT
        status.summary(node.ERROR if faulty else node.OK, in_words(decision.state, decision.reason))
        status.add('obstacle lists [1/s]', '%.1f' % self._rate.read())
        ages = (
            ('obstacle list', inputs.obstacles),
            ('lane pose', inputs.lane_pose),
            ('own lane pose', inputs.own_lane_pose),
        )
        for name, value in ages:
            status.add(name + ' age [s]', node.figure(None if value is None else age(value.stamp, now), '%.3f'))
        status.add('last reason', decision.reason)
        status.add('stage', self._settings.stage)
        status.add('d_ref [m]', node.figure(decision.d_ref, '%.3f'))
        status.add('v_ref [m/s]', node.figure(decision.v_ref, '%.2f'))
        for name, number in decision.numbers.items():
            status.add(name, node.figure(number, '%.3f'))


def main() -> None:
    """Entry point."""
    node.run('obstacle_avoidance_node', AvoidanceNode)
