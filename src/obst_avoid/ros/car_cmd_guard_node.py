"""car_cmd_guard_node: wheels keep the last command that they heard; when commands fall silent, they are told to stand.

A controller that is killed can say nothing any more. This node only listens, until then.
"""

import threading
import time
from dataclasses import dataclass
from typing import Any, Optional

import rospy

from obst_avoid.core.settings import number, text
from obst_avoid.core.types import Command
from obst_avoid.ros import border, node
from obst_avoid.ros.messages import find_messages

LOOK = 0.02
"""[s] of wall time between looks, and between the commands that it gives."""


@dataclass(frozen=True)
class GuardNodeSettings:
    """config/car_cmd_guard_node.yaml has values, units and reasons."""

    silence_limit: float = number('s', above=0)
    insist: float = number('s', above=0)
    veh: str = text()
    msgs_package: str = text()


class GuardNode:
    """Knows when the last command was heard, on the wall's clock: it guards against programs that are gone."""

    def __init__(self) -> None:
        self._settings = node.private_settings(GuardNodeSettings)
        self._messages = find_messages(self._settings.msgs_package)
        self._lock = threading.Lock()
        self._heard: Optional[float] = None
        self._driving, self._stopping, self._stops = False, False, 0
        self._publisher = rospy.Publisher('~car_cmd', self._messages.Twist2DStamped, queue_size=1)
        self._health = node.Health(self._settings.veh, self._diagnose)
        rospy.on_shutdown(self._stop_for_good)
        node.every(LOOK, self._on_look)
        rospy.Subscriber('~car_cmd', self._messages.Twist2DStamped, self._on_car_cmd, queue_size=1)

    def _on_car_cmd(self, msg: Any) -> None:
        if msg._connection_header['callerid'] == rospy.get_name():
            return
        with self._lock:
            self._heard, self._driving, self._stopping = time.monotonic(), not msg.v == msg.omega == 0, False

    def _on_look(self) -> None:
        with self._lock:
            silent = 0.0 if self._heard is None else time.monotonic() - self._heard
            limit = self._settings.silence_limit
            if not self._driving or silent < limit:
                return
            if not self._stopping:
                self._stopping, self._stops = True, self._stops + 1
                rospy.logwarn('%s: no command for %.2f s, telling the wheels to stand', rospy.get_name(), silent)
            if silent > limit + self._settings.insist:
                self._driving = False
            self._stop()

    def _stop_for_good(self) -> None:
        """Nobody watches after this; a controller that works says otherwise at once."""
        with self._lock:
            if self._driving:
                self._stop()

    def _stop(self) -> None:
        stamp = border.nanoseconds(rospy.Time.now())
        self._publisher.publish(border.msg_from_command(Command(0.0, 0.0), stamp, self._messages.Twist2DStamped))

    def _diagnose(self, status: Any) -> None:
        with self._lock:
            heard, stopping, stops = self._heard, self._stopping, self._stops
        silent = None if heard is None else time.monotonic() - heard
        if stopping:
            status.summary(node.ERROR, 'no command for %.1f s, told the wheels to stand' % silent)
        else:
            what = 'no command yet' if silent is None else 'the last command %.2f s ago' % silent
            status.summary(node.OK, what + ('; stopped the wheels %d times' % stops if stops else ''))
        status.add('command age [s]', node.figure(silent, '%.2f'))
        status.add('stops', stops)


def main() -> None:
    """Entry point."""
    node.run('car_cmd_guard_node', GuardNode)
