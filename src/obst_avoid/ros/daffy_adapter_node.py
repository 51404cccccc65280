"""daffy_adapter_node: between the avoider and today's Duckietown lane controller, which knows neither d_ref nor v_ref.

The controller acts only when it hears a lane pose. So where the lane filter has fallen silent, it is told of the last
pose again, together with the stop.
"""

import copy
import threading
import time
from dataclasses import dataclass, replace
from typing import Any, Optional

import rospy
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from obst_avoid.core.age import age
from obst_avoid.core.daffy import Asked, DaffySettings, Pace, acts, asked
from obst_avoid.core.lane_control import Reference
from obst_avoid.core.settings import flag, text
from obst_avoid.core.types import LanePose, Stamped
from obst_avoid.msg import LaneControl
from obst_avoid.ros import border, node
from obst_avoid.ros.messages import DUCKIETOWN, find_classes

PERIOD = 0.1
"""[s] after which the request is published again; the controller keeps the last one for ever."""
LOOK = 0.02
LAST_WORD = 0.05
"""[s] of wall time between the last request and the last pose, which travel apart."""


@dataclass(frozen=True)
class AdapterNodeSettings(DaffySettings):
    """The adapter's settings and those of its node, which launch files set."""

    hard_stop: bool = flag()
    follower: str = text()
    veh: str = text()
    msgs_package: str = text()


class AdapterNode:
    """Passes each lane pose on, moved by d_ref, and says on each LaneControl what the controller shall do."""

    def __init__(self) -> None:
        self._settings = node.private_settings(AdapterNodeSettings)
        package = self._settings.msgs_package or DUCKIETOWN
        kinds = ('LanePose', 'BoolStamped', 'StopLineReading', 'FSMState')
        self._lane_pose_class, self._flag_class, self._reading_class, mode_class = find_classes(package, *kinds)
        self._lock = threading.Lock()
        self._clock = node.ClockWatch()
        self._on, self._mode = True, None  # type: bool, Optional[str]
        self._pose: Optional[Stamped[LanePose]] = None
        self._pose_msg: Any = None
        self._reference: Optional[Stamped[Reference]] = None
        self._asked = Asked(Pace.STAND, 0.0, 'nothing yet')
        self._said, self._said_wall, self._passed_wall = 0, 0.0, 0.0
        self._ending = False
        self._rate = node.Rate()
        self._readings = rospy.Publisher('~obstacle_distance_reading', self._reading_class, queue_size=1)
        self._poses = rospy.Publisher('~lane_pose', self._lane_pose_class, queue_size=1)
        self._emergency = None
        if self._settings.hard_stop:
            self._emergency = rospy.Publisher('~emergency_stop', self._flag_class, queue_size=1, latch=True)
        self._emergency_said, self._pressed = False, False  # by us; by somebody else, which is not released
        self._health = node.Health(self._settings.veh, self._diagnose)
        rospy.on_shutdown(self._stop_for_good)
        node.every(LOOK, self._on_look)
        rospy.Service('~switch', SetBool, self._on_switch)
        if self._emergency is not None:
            rospy.Subscriber('~emergency_stop', self._flag_class, self._on_emergency, queue_size=1)
        rospy.Subscriber('~mode', mode_class, self._on_mode, queue_size=1)
        rospy.Subscriber('~lane_control', LaneControl, node.callback(self._on_lane_control), queue_size=1)
        rospy.Subscriber('~lane_filter_pose', self._lane_pose_class, node.callback(self._on_lane_pose), queue_size=1)

    def _on_lane_pose(self, msg: Any) -> None:
        pose = node.stamped_lane_pose(msg, 'lane pose')
        if pose is None:
            return
        with self._lock:
            self._pose, self._pose_msg = pose, msg
            self._act(self._clock.look())
            self._pass_on(msg)
        self._rate.tick()

    def _on_lane_control(self, msg: LaneControl) -> None:
        try:
            reference = border.reference_from_lane_control(msg)
        except border.BorderError as error:
            node.dropped('lane control', error)
            return
        with self._lock:
            clock = self._clock.look()
            self._reference = Stamped(clock.now, reference)
            self._act(clock)

    def _on_mode(self, msg: Any) -> None:
        with self._lock:
            self._mode = msg.state
            self._act(self._clock.look())

    def _on_emergency(self, msg: Any) -> None:
        if msg._connection_header['callerid'] != rospy.get_name():
            with self._lock:
                self._pressed = bool(msg.data)
                self._emergency_said = self._emergency_said and self._pressed  # released for us, too: say it again

    def _on_switch(self, request: SetBoolRequest) -> SetBoolResponse:
        with self._lock:
            self._on = bool(request.data)
            self._act(self._clock.look())
        return SetBoolResponse(success=True, message='on' if request.data else 'off')

    def _on_look(self) -> None:
        with self._lock:
            clock = self._clock.look()
            if age(self._said, clock.now) >= PERIOD or clock.wall - self._said_wall >= PERIOD or clock.backwards:
                self._act(clock)
            silent = clock.wall - self._passed_wall
            if self._asked.pace is Pace.STAND and self._pose_msg is not None and silent >= PERIOD:
                self._pass_on(self._pose_msg)  # the filter is silent, and the controller acts on poses only

    def _act(self, clock: node.ClockReading) -> None:
        """Say what the controller shall do."""
        if self._ending:
            return
        if acts(self._on, self._mode, self._settings):
            heard = self._is_followed()
            self._asked = asked(self._pose, self._reference, heard, clock.stood, clock.now, self._settings)
        else:
            why = 'switched off' if not self._on else 'mode %s' % self._mode
            self._asked = Asked(Pace.FULL, 0.0, 'passing lane poses on as they are: %s' % why)
        self._say(clock.now)
        self._said, self._said_wall = clock.now, clock.wall

    def _is_followed(self) -> bool:
        """Whether the lane controller hears the moved lane pose; others may listen, a recorder for example."""
        followers = [connection.endpoint_id for connection in self._poses.impl.connections]
        return any(name.split('/')[-1] == self._settings.follower for name in followers)

    def _say(self, now: int) -> None:
        self._readings.publish(border.stop_line_reading(self._asked.pace, now, self._reading_class))
        stand = self._asked.pace is Pace.STAND and acts(self._on, self._mode, self._settings)
        if self._emergency is not None and stand is not self._emergency_said:
            self._emergency_said = stand
            if stand or not self._pressed:
                self._emergency.publish(border.flag(stand, now, self._flag_class))

    def _pass_on(self, msg: Any) -> None:
        """A lane pose to the controller, moved by d_ref."""
        self._passed_wall = time.monotonic()
        moved = copy.copy(msg)
        moved.d = msg.d - self._asked.d_ref
        self._poses.publish(moved)

    def _stop_for_good(self) -> None:
        """The controller keeps the last request, and the wheels the last command."""
        with self._lock:
            self._ending = True
            self._asked = replace(self._asked, pace=Pace.STAND, reason='ending')
            self._say(border.nanoseconds(rospy.Time.now()))
            if self._pose_msg is not None:
                time.sleep(LAST_WORD)
                self._pass_on(self._pose_msg)

    def _diagnose(self, status: Any) -> None:
        with self._lock:
            said, pose, reference = self._asked, self._pose, self._reference
        blind = said.pace is Pace.STAND and said.reason.startswith('stopping')
        status.summary(node.WARN if blind else node.OK, said.reason)
        status.add('lane poses [1/s]', '%.1f' % self._rate.read())
        now = border.nanoseconds(rospy.Time.now())
        for name, value in (('lane pose', pose), ('lane control', reference)):
            status.add(name + ' age [s]', node.figure(None if value is None else age(value.stamp, now), '%.3f'))
        status.add('last reason', said.reason)
        status.add('pace', said.pace.value)
        status.add('d_ref [m]', node.figure(said.d_ref, '%.3f'))
        status.add('mode', self._mode or 'none')
        status.add('the lane controller follows', 'yes' if self._is_followed() else 'no')


def main() -> None:
    """Entry point."""
    node.run('daffy_adapter_node', AdapterNode)
