"""car_cmd_guard_node: wheels keep the last command that they heard; when commands fall silent, they are told to stand.

A controller that is killed can say nothing any more. This node only listens, until then. Beside today's stack it does
the same for daffy_adapter_node, whose last request that stack's controller keeps.
"""

import threading
import time
from dataclasses import dataclass
from typing import Any, Optional, Tuple

import rospy

from obst_avoid.core.daffy import Pace
from obst_avoid.core.settings import flag, number, text
from obst_avoid.core.types import Command
from obst_avoid.ros import border, node
from obst_avoid.ros.messages import DUCKIETOWN, find_classes, find_messages

LOOK = 0.02
"""[s] of wall time between looks, and between the commands that it gives."""


@dataclass(frozen=True)
class GuardNodeSettings:
    """config/car_cmd_guard_node.yaml has values, units and reasons."""

    silence_limit: float = number('s', above=0)
    insist: float = number('s', above=0)
    adapter: bool = flag()
    veh: str = text()
    msgs_package: str = text()


class Silence:
    """Of somebody who has to go on speaking while the robot drives; on the wall's clock, since programs may be gone."""

    def __init__(self, what: str, settings: GuardNodeSettings) -> None:
        self._what, self._settings = what, settings
        self._heard: Optional[float] = None
        self._driving, self._stopping, self._stops = False, False, 0

    def hear(self, driving: bool) -> None:
        """driving: whether what was said makes the robot drive."""
        self._heard, self._driving, self._stopping = time.monotonic(), driving, False

    def lasts(self) -> bool:
        """Whether the robot has to be told now that it shall stand."""
        silent = 0.0 if self._heard is None else time.monotonic() - self._heard
        limit = self._settings.silence_limit
        if not self._driving or silent < limit:
            return False
        if not self._stopping:
            self._stopping, self._stops = True, self._stops + 1
            rospy.logwarn('%s: no %s for %.2f s, telling the robot to stand', rospy.get_name(), self._what, silent)
        if silent > limit + self._settings.insist:
            self._driving = False
        return True

    @property
    def was_driving(self) -> bool:
        """When it was heard last, and nobody has insisted long enough since."""
        return self._driving

    def say(self, status: Any) -> Tuple[int, str]:
        """Level and words for /diagnostics."""
        silent = None if self._heard is None else time.monotonic() - self._heard
        status.add(self._what + ' age [s]', node.figure(silent, '%.2f'))
        status.add(self._what + ': stops', self._stops)
        if self._stopping:
            return node.ERROR, 'no %s for %.1f s, told the robot to stand' % (self._what, silent)
        words = 'no %s yet' % self._what if silent is None else 'the last %s %.2f s ago' % (self._what, silent)
        return node.OK, words + ('; stopped the robot %d times' % self._stops if self._stops else '')


class GuardNode:
    """Listens to the lane controller; beside today's stack to daffy_adapter_node too, in whose place it then speaks."""

    def __init__(self) -> None:
        self._settings = node.private_settings(GuardNodeSettings)
        self._messages = find_messages(self._settings.msgs_package)
        self._lock = threading.Lock()
        self._commands, self._requests = (Silence(what, self._settings) for what in ('command', 'request'))
        self._publisher = rospy.Publisher('~car_cmd', self._messages.Twist2DStamped, queue_size=1)
        self._health = node.Health(self._settings.veh, self._diagnose)
        if self._settings.adapter:
            (self._reading,) = find_classes(self._settings.msgs_package or DUCKIETOWN, 'StopLineReading')
            self._readings = rospy.Publisher('~obstacle_distance_reading', self._reading, queue_size=1)
        rospy.on_shutdown(self._stop_for_good)
        node.every(LOOK, self._on_look)
        rospy.Subscriber('~car_cmd', self._messages.Twist2DStamped, self._on_car_cmd, queue_size=1)
        if self._settings.adapter:
            rospy.Subscriber('~obstacle_distance_reading', self._reading, self._on_reading, queue_size=1)

    def _on_car_cmd(self, msg: Any) -> None:
        self._hear(self._commands, msg, not msg.v == msg.omega == 0)

    def _on_reading(self, msg: Any) -> None:
        self._hear(self._requests, msg, not msg.at_stop_line)

    def _hear(self, silence: Silence, msg: Any, driving: bool) -> None:
        if msg._connection_header['callerid'] != rospy.get_name():
            with self._lock:
                silence.hear(driving)

    def _on_look(self) -> None:
        with self._lock:
            if self._commands.lasts():
                self._stop()
            if self._requests.lasts():
                self._ask_to_stand()

    def _stop_for_good(self) -> None:
        """Nobody watches after this; a controller that works says otherwise at once."""
        with self._lock:
            if self._commands.was_driving:
                self._stop()

    def _stop(self) -> None:
        stamp = border.nanoseconds(rospy.Time.now())
        self._publisher.publish(border.msg_from_command(Command(0.0, 0.0), stamp, self._messages.Twist2DStamped))

    def _ask_to_stand(self) -> None:
        """Of the stack's lane controller, which keeps the last request for ever."""
        self._readings.publish(
            border.stop_line_reading(Pace.STAND, border.nanoseconds(rospy.Time.now()), self._reading)
        )

    def _diagnose(self, status: Any) -> None:
        watched = [self._commands, self._requests] if self._settings.adapter else [self._commands]
        with self._lock:
            said = [silence.say(status) for silence in watched]
        status.summary(max(level for level, _ in said), '; '.join(words for _, words in said))


def main() -> None:
    """Entry point."""
    node.run('car_cmd_guard_node', GuardNode)
