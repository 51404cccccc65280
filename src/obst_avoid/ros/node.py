"""What all nodes share: start with checked parameters, threads that never die in silence, a watch on the clock."""

import os
import sys
import threading
import time
import traceback
from dataclasses import dataclass
from http.client import HTTPException
from typing import Any, Callable, Dict, Generic, Optional, Type, TypeVar
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error as XmlrpcError

import diagnostic_updater
import rosgraph
import rospkg
import rospy
from diagnostic_msgs.msg import DiagnosticStatus

from obst_avoid.core.calibration import Calibration, CalibrationError, find_calibration
from obst_avoid.core.settings import SettingsError, load
from obst_avoid.core.types import LanePose, Stamped
from obst_avoid.ros.border import BorderError, lane_pose_from_msg, nanoseconds
from obst_avoid.ros.messages import MessagesError

_broken = threading.Event()
_warned: Dict[str, float] = {}
REPEAT = 2.0
"""[s] of wall time between two warnings of one kind."""
MASTER_PERIOD = 1.0
"""[s] of wall time between two looks at the master."""
LOOKS = 10
"""Looks at the master between two at the parameters, which live tuning may have changed."""
UNREACHABLE = (OSError, rosgraph.MasterException, HTTPException, XmlrpcError, ExpatError)
"""What a call of the master raises when there is none, or no more."""

S = TypeVar('S')
T = TypeVar('T')


class NodeError(RuntimeError):
    """A node cannot start or go on. The message is one sentence for a person."""


def run(name: str, start: Callable[[], Any]) -> None:
    """Start a node and spin. One that cannot start, or that broke later, says why and exits with 1."""
    rospy.init_node(name)
    try:
        node = start()
    except (SettingsError, CalibrationError, MessagesError, NodeError) as error:
        rospy.logfatal('%s: %s', rospy.get_name(), error)
        sys.exit(1)
    every(MASTER_PERIOD, MasterWatch().look)
    rospy.spin()
    del node
    if _broken.is_set():
        sys.exit(1)


def private_settings(settings: Type[S]) -> S:
    """The node's private parameters as a settings object, checked whole. Raises SettingsError."""
    return load(settings, rospy.get_param('~', {}), rospy.get_name())


def path_of_user(path: str) -> str:
    """A path as the user meant it: roslaunch starts nodes in ~/.ros, but PWD still names where it was called."""
    return os.path.join(os.environ.get('PWD', ''), path) if path else ''


def calibration_of(veh: str, calibration_dir: str, allow_default: bool) -> Calibration:
    """The robot's calibration by Duckietown's search order; logs which one, and what looks odd in it."""
    own = rospkg.RosPack().get_path('obst_avoid') + '/config/calibrations'
    calibration = find_calibration(veh, path_of_user(calibration_dir), own if allow_default else None)
    rospy.loginfo('%s: calibration from %s', rospy.get_name(), calibration.source)
    for warning in calibration.warnings:
        rospy.logwarn('%s: %s', rospy.get_name(), warning)
    return calibration


def in_background(function: Callable[[], None]) -> None:
    """Run function again and again in a thread until the node ends; it does its own waiting.

    An exception that nobody expected ends the node, loudly: a dead thread in a living node would fall silent for
    ever, and whoever listens stops the robot only when the node is gone or its answers are.
    """

    def loop() -> None:
        while not ending():
            function()

    _guarded(loop)


def once(function: Callable[[], None]) -> None:
    """Run function in a thread, then end the node. A NodeError is said in one sentence."""

    def run_and_end() -> None:
        function()
        rospy.signal_shutdown('done')

    _guarded(run_and_end)


def every(period: float, function: Callable[[], None]) -> None:
    """Call function about every period seconds of wall time, which goes on when ROS time stands still."""

    def step() -> None:
        time.sleep(period)
        if not ending():
            function()

    in_background(step)


def ending() -> bool:
    """Whether the node has begun to end. rospy closes its topics some time before is_shutdown says so."""
    return bool(rospy.core.is_shutdown_requested())


def callback(function: Callable[[Any], None]) -> Callable[[Any], None]:
    """For a subscriber whose callback publishes: a topic that is closed because the node ends is no error."""

    def guarded(msg: Any) -> None:
        try:
            function(msg)
        except rospy.ROSException:
            if not ending():
                raise

    return guarded


def _guarded(function: Callable[[], None]) -> None:
    def target() -> None:
        try:
            function()
        except NodeError as error:
            _end('%s' % error)
        except Exception:  # the last line of defence; it ends the node
            if ending():  # what a thread meets then, a closed topic for example, is no fault of its own
                return
            _end('ending after an unexpected error:\n%s' % traceback.format_exc())

    threading.Thread(target=target, daemon=True).start()


class MasterWatch:
    """Notices that the master was restarted.

    A node that a new master does not know goes on with the links that it has, but whoever starts later never finds it.
    So it ends, for roslaunch to start it again; and since the new master has lost all parameters, it leaves there what
    its namespace had when it last looked, as far as nobody else has: a node that ended while there was no master could
    not. While there is no master at all it goes on.
    """

    def __init__(self) -> None:
        self._master = rosgraph.Master(rospy.get_name())
        self._parameters = self._read()
        self._missing, self._looks = 0, 0

    def look(self) -> None:
        """Once every MASTER_PERIOD."""
        try:
            self._looks += 1
            read = self._read() if self._looks % LOOKS == 0 else {}
            self._missing = 0 if self._is_known() else self._missing + 1
            if self._missing == 0:  # only now: what was read may have been a new master's
                self._parameters.update(read)
            if self._missing < 2 or ending():  # one may be a look at a node that is just beginning, or ending
                return
            for name, value in self._parameters.items():
                if not self._master.hasParam(name):
                    self._master.setParam(name, value)
        except UNREACHABLE:
            return
        raise NodeError('the master was restarted, ending to be started again')

    def _read(self) -> Dict[str, Any]:
        namespace = rospy.get_namespace()
        everything = rospy.get_param(namespace, {}).items()
        ours = {namespace + name: value for name, value in everything if _is_ours(value)}
        return {**ours, '/use_sim_time': rospy.get_param('/use_sim_time', False)}

    def _is_known(self) -> bool:
        try:
            self._master.lookupNode(rospy.get_name())
        except rosgraph.MasterError:
            return False
        return True


def _is_ours(parameters: Any) -> bool:
    """Whether these are what our launch files give a node: the stack's own come with its own launch files."""
    return isinstance(parameters, dict) and 'veh' in parameters and bool({'msgs_package', 'input'} & set(parameters))


def _end(why: str) -> None:
    rospy.logfatal('%s: %s', rospy.get_name(), why)
    _broken.set()
    rospy.signal_shutdown('broken')


class Newest(Generic[T]):
    """Hands the newest value from a callback to a worker; older ones that were not taken are dropped and counted."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._value: Optional[T] = None
        self.dropped = 0

    def put(self, value: T) -> None:
        """Called by the subscriber's thread; never waits for work."""
        with self._condition:
            self.dropped += self._value is not None
            self._value = value
            self._condition.notify()

    def take(self, timeout: float) -> Optional[T]:
        """The newest value that was not taken yet, or None after timeout seconds of wall time."""
        with self._condition:
            if self._value is None:
                self._condition.wait(timeout)
            value, self._value = self._value, None
            return value


@dataclass(frozen=True)
class ClockReading:
    """now: ROS time [ns]. wall: [s], monotonic. stood: [s] of wall time since ROS time moved. backwards: it jumped."""

    now: int
    wall: float
    stood: float
    backwards: bool


class ClockWatch:
    """Notices that ROS time stands still or ran backwards. Wall time is used here and for nothing else."""

    def __init__(self) -> None:
        self._now, self._moved = 0, time.monotonic()

    def look(self) -> ClockReading:
        """Read the clock. Call from one thread, or under one lock."""
        now, wall = nanoseconds(rospy.Time.now()), time.monotonic()
        backwards = now < self._now
        if now != self._now:
            self._now, self._moved = now, wall
        return ClockReading(now, wall, wall - self._moved, backwards)


class Health:
    """The node's line in /diagnostics: rates, ages, the last reason. Written once a second."""

    def __init__(self, hardware_id: str, fill: Callable[['diagnostic_updater.DiagnosticStatusWrapper'], None]) -> None:
        self._updater = diagnostic_updater.Updater()
        self._updater.setHardwareID(hardware_id)
        self._updater.add('state', lambda status: fill(status) or status)
        every(1.0, self._updater.force_update)


def figure(value: Optional[float], form: str) -> str:
    """A number for /diagnostics, 'none' where there is none; never -0.00."""
    if value is None:
        return 'none'
    words = form % value
    return words.lstrip('-') if not words.strip('-0.') else words


OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Rate:
    """Counts events; the rate is taken over the time between two readings. Thread-safe enough for one reader."""

    def __init__(self) -> None:
        self._count, self._read, self._since = 0, 0, time.monotonic()

    def tick(self) -> None:
        """One more."""
        self._count += 1

    def read(self) -> float:
        """[1/s] since the last reading."""
        now, count = time.monotonic(), self._count
        rate = (count - self._read) / max(now - self._since, 1e-3)
        self._read, self._since = count, now
        return rate


def stamped_lane_pose(msg: Any, what: str) -> Optional[Stamped[LanePose]]:
    """A lane pose with its stamp; None, and a warning that calls it by what, when it must not be used."""
    try:
        return Stamped(nanoseconds(msg.header.stamp), lane_pose_from_msg(msg))
    except BorderError as error:
        dropped(what, error)
        return None


def dropped(what: str, error: Exception) -> str:
    """Say, at most every REPEAT seconds for each kind, that a message was not used. Returns the sentence."""
    sentence = '%s dropped: %s' % (what, error)
    if time.monotonic() - _warned.get(what, -REPEAT) >= REPEAT:  # rospy's throttle knows only this line, not what
        _warned[what] = time.monotonic()
        rospy.logwarn('%s: %s', rospy.get_name(), sentence)
    return sentence
