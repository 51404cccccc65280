"""lane_controller_node: a small lane follower for stacks without one that tracks d_ref and v_ref."""

import threading
from dataclasses import dataclass
from typing import Any, Optional, Tuple

import rospy

from obst_avoid.cfg import LaneControllerConfig
from obst_avoid.core.age import age, fresh
from obst_avoid.core.lane_control import LaneControlSettings, Reference, control, learning
from obst_avoid.core.lane_estimate import LaneEstimate, believed, followed
from obst_avoid.core.motion import remembered
from obst_avoid.core.settings import text
from obst_avoid.core.types import Command, LanePose, Stamped
from obst_avoid.msg import LaneControl
from obst_avoid.ros import border, node
from obst_avoid.ros.live import LiveSettings
from obst_avoid.ros.messages import find_messages

PERIOD = 0.05
"""[s] after which a command is published again when no lane pose came: wheels must not run on an old one."""
LOOK = 0.01


@dataclass(frozen=True)
class ControllerNodeSettings(LaneControlSettings):
    """The controller's settings and those of its node, which launch files set."""

    veh: str = text()
    msgs_package: str = text()


class ControllerNode:
    """Commands on each lane pose and on each LaneControl, and by a slow timer."""

    def __init__(self) -> None:
        self._settings = node.private_settings(ControllerNodeSettings)
        self._messages = find_messages(self._settings.msgs_package)
        self._lock = threading.Lock()
        self._clock = node.ClockWatch()
        self._lane: Optional[LaneEstimate] = None
        self._commands: Tuple[Stamped[Command], ...] = ()
        self._reference: Optional[Stamped[Reference]] = None
        self._commanded, self._commanded_wall = 0, 0.0
        self._learned = 0.0
        self._command, self._reason = Command(0.0, 0.0), 'nothing yet'
        self._rate = node.Rate()
        self._publisher = rospy.Publisher('~car_cmd', self._messages.Twist2DStamped, queue_size=1)
        self._health = node.Health(self._settings.veh, self._diagnose)
        self._ending = False
        rospy.on_shutdown(self._stop_for_good)
        self._live = LiveSettings(LaneControllerConfig, ControllerNodeSettings, self._tune)
        node.every(LOOK, self._on_look)
        rospy.Subscriber('~lane_pose', self._messages.LanePose, self._on_lane_pose, queue_size=1)
        rospy.Subscriber('~own_lane_pose', self._messages.LanePose, self._on_own_lane_pose, queue_size=1)
        rospy.Subscriber('~lane_control', LaneControl, self._on_lane_control, queue_size=1)

    def _tune(self, settings: ControllerNodeSettings) -> None:
        with self._lock:
            self._settings = settings

    def _on_lane_pose(self, msg: Any) -> None:
        self._follow(node.stamped_lane_pose(msg, 'lane pose'), None)
        self._rate.tick()

    def _on_own_lane_pose(self, msg: Any) -> None:
        self._follow(None, node.stamped_lane_pose(msg, 'own lane pose'))

    def _follow(self, filtered: Optional[Stamped[LanePose]], own: Optional[Stamped[LanePose]]) -> None:
        settings = self._settings
        with self._lock:
            clock = self._look()
            limit, ahead = settings.lane_pose_age_limit, settings.future_limit
            poses = (fresh(pose, clock.now, limit, ahead) for pose in (filtered, own))
            self._lane = followed(self._lane, *poses, self._commands, settings.lane_estimate)
            self._act(clock)

    def _on_lane_control(self, msg: LaneControl) -> None:
        try:
            reference = border.reference_from_lane_control(msg)
        except border.BorderError as error:
            node.dropped('lane control', error)
            return
        with self._lock:
            clock = self._look()
            self._reference = Stamped(clock.now, reference)
            self._act(clock)

    def _on_look(self) -> None:
        with self._lock:
            clock = self._look()
            if (
                age(self._commanded, clock.now) >= PERIOD
                or clock.wall - self._commanded_wall >= PERIOD
                or clock.backwards
            ):
                self._act(clock)

    def _stop_for_good(self) -> None:
        """The wheels keep the last command that they heard."""
        with self._lock:
            self._ending = True
            stamp = border.nanoseconds(rospy.Time.now())
            self._publisher.publish(border.msg_from_command(Command(0.0, 0.0), stamp, self._messages.Twist2DStamped))

    def _look(self) -> node.ClockReading:
        clock = self._clock.look()
        if clock.backwards:  # what was believed is of a time that has not come yet
            self._lane, self._commands = None, ()
        return clock

    def _act(self, clock: node.ClockReading) -> None:
        if self._ending:
            return
        pose = believed(self._lane, self._commands, clock.now, self._settings.lane_estimate)
        seconds = max(0.0, age(self._commanded, clock.now)) if self._commanded else 0.0
        self._learned = learning(self._learned, pose, self._reference, self._command.v * seconds, self._settings)
        command, reason = control(pose, self._reference, clock.stood, clock.now, self._settings, self._learned)
        self._commands = remembered(self._commands, Stamped(clock.now, command))
        self._command, self._reason = command, reason
        self._commanded, self._commanded_wall = clock.now, clock.wall
        self._publisher.publish(border.msg_from_command(command, clock.now, self._messages.Twist2DStamped))

    def _diagnose(self, status: Any) -> None:
        with self._lock:
            command, reason, lane, reference = self._command, self._reason, self._lane, self._reference
        blind = reason.startswith('stopping') and 'asked' not in reason
        numbers = reason, node.figure(command.v, '%.2f'), node.figure(command.omega, '%.2f')
        status.summary(node.WARN if blind else node.OK, '%s; v %s m/s, omega %s rad/s' % numbers)
        status.add('lane poses [1/s]', '%.1f' % self._rate.read())
        now = border.nanoseconds(rospy.Time.now())
        filtered, own = (None, None) if lane is None else (lane.filter_stamp, lane.own_stamp)
        said = None if reference is None else reference.stamp
        for name, stamp in (('lane pose', filtered), ('own lane pose', own), ('lane control', said)):
            status.add(name + ' age [s]', node.figure(None if stamp is None else age(stamp, now), '%.3f'))
        status.add('last reason', reason)
        status.add('v [m/s]', node.figure(command.v, '%.2f'))
        status.add('omega [rad/s]', node.figure(command.omega, '%.2f'))
        status.add('learned bend [1/m]', node.figure(self._learned, '%.2f'))


def main() -> None:
    """Entry point."""
    node.run('lane_controller_node', ControllerNode)
