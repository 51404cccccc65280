"""What the tests of the graph share: waiting on wall time, collecting messages, pictures, programs.

Nodes start late and stall on a busy machine, so nothing here counts on a time: tests wait for what must happen, and
only its absence fails, after a limit that is generous.
"""

import functools
import os
import socket
import subprocess
import sys
import threading
import time
import unittest
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple, TypeVar

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from roslaunch.config import ROSLaunchConfig
from roslaunch.xmlloader import XmlLoader
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header

from obst_avoid.core.calibration import Calibration, load_calibration
from obst_avoid.core.picture import encode_jpeg
from obst_avoid.core.types import Kind

sys.path.append(str(Path(__file__).resolve().parents[1]))  # a rostest finds its own folder only
from unit.drawn import RobotPose, Scene, Thing, draw

T = TypeVar('T')

REPOSITORY = Path(__file__).resolve().parents[2]
START = 40.0
"""[s] for nodes to come up while other processes take the machine."""
ANSWER = 15.0
"""[s] for something that normally takes a fraction of a second."""
PERIOD = 0.05
"""[s] between two messages that are published by hand: a quarter of the shortest age limit."""

DUCKIE = Thing(Kind.DUCKIE, 0.5, 0.0)
SCENE = Scene((DUCKIE, Thing(Kind.CONE, 0.6, -0.27, 0.07)))
"""A duckie in the lane, and a cone beyond the white line."""


class Prepared(unittest.TestCase):
    """Tests that look at one recorded run. `prepare` is called once, in the first test's setUp: rosunit reports an
    error in setUpClass as nothing but a number.
    """

    _prepared = False
    _failure: Optional[BaseException] = None

    @classmethod
    def prepare(cls) -> None:
        """Make what the tests look at."""
        raise NotImplementedError

    def setUp(self) -> None:
        cls = type(self)
        if not cls._prepared:
            cls._prepared = True
            try:
                cls.prepare()
            except BaseException as error:
                cls._failure = error
                raise
        if cls._failure is not None:
            self.fail('nothing to look at: %s' % cls._failure)


def wait_for(look: Callable[[], T], seconds: float, what: str) -> T:
    """Look until there is something, and return it. Fails after so many seconds of wall time."""
    end = time.monotonic() + seconds
    while True:
        found = look()
        if found:
            return found
        if time.monotonic() > end:
            raise AssertionError('%s: not within %.0f s' % (what, seconds))
        time.sleep(0.02)


class Arrived(NamedTuple):
    """A message and when it came. wall: [s], monotonic."""

    wall: float
    msg: Any


class Inbox:
    """Keeps all messages of one topic in order."""

    def __init__(self, topic: str, cls: Any) -> None:
        self.topic = topic
        self._lock = threading.Lock()
        self._arrived: List[Arrived] = []
        self._subscriber = rospy.Subscriber(topic, cls, self._put)

    def _put(self, msg: Any) -> None:
        with self._lock:
            self._arrived.append(Arrived(time.monotonic(), msg))

    def connected(self) -> 'Inbox':
        """Wait until somebody publishes on the topic."""
        wait_for(self._subscriber.get_num_connections, START, 'a publisher of ' + self.topic)
        return self

    def arrived(self) -> List[Arrived]:
        """All so far."""
        with self._lock:
            return list(self._arrived)

    def all(self) -> List[Any]:
        """All messages so far."""
        return [item.msg for item in self.arrived()]

    def wait(self, wanted: Callable[[Any], Any], what: str, seconds: float = ANSWER, since: int = 0) -> Any:
        """Wait for the first message that is as wanted, among those after the first `since`."""
        return wait_for(
            lambda: next((msg for msg in self.all()[since:] if wanted(msg)), None), seconds, self.topic + ': ' + what
        )

    def wait_new(self, wanted: Callable[[Any], Any], what: str, seconds: float = ANSWER) -> Any:
        """Wait for a message that is as wanted and comes after this call."""
        return self.wait(wanted, what, seconds, since=len(self.all()))

    def close(self) -> None:
        """Listen no more."""
        self._subscriber.unregister()


def publisher(topic: str, cls: Any) -> rospy.Publisher:
    """A publisher that somebody listens to, so that the first message is not lost."""
    made = rospy.Publisher(topic, cls, queue_size=10)
    wait_for(made.get_num_connections, START, 'a subscriber of ' + topic)
    return made


class Repeating:
    """Calls a function every PERIOD in a thread, as lane filter and detector publish, until the block is left."""

    def __init__(self, function: Callable[[], None]) -> None:
        self._function = function
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._loop, daemon=True)

    def _loop(self) -> None:
        while not self._stop.wait(PERIOD):
            self._function()

    def __enter__(self) -> 'Repeating':
        self._thread.start()
        return self

    def __exit__(self, *_: Any) -> None:
        self._stop.set()
        self._thread.join()


class Diagnostics:
    """The nodes' lines in /diagnostics."""

    def __init__(self) -> None:
        self._inbox = Inbox('/diagnostics', DiagnosticArray)

    def wait(self, node: str, wanted: Callable[[DiagnosticStatus], Any], what: str) -> DiagnosticStatus:
        """Wait for a new line of one node, by its full name, that is as wanted."""
        before = len(self._inbox.all())
        return wait_for(
            lambda: next((line for line in self._lines(node, before) if wanted(line)), None),
            ANSWER,
            '/diagnostics of %s: %s' % (node, what),
        )

    def _lines(self, node: str, since: int) -> List[DiagnosticStatus]:
        lines = [status for msg in self._inbox.all()[since:] for status in msg.status]
        return [status for status in lines if status.name.lstrip('/').startswith(node.lstrip('/') + ':')]


def value_of(status: DiagnosticStatus, key: str) -> str:
    """One value of a diagnostics line, '' when it is not there."""
    return next((item.value for item in status.values if item.key == key), '')


def nanoseconds(msg: Any) -> int:
    """The stamp of a message, exactly; written down anew here, since the border is what is tested."""
    return int(msg.header.stamp.secs) * 10**9 + int(msg.header.stamp.nsecs)


def stamp_of(number: int) -> rospy.Time:
    """A stamp with digits that no float would keep, 33 ms after the one of the number before."""
    at = 1_500_000_000_123_456_789 + 33_333_333 * number
    return rospy.Time(at // 10**9, at % 10**9)


def pose_array(obstacles: Sequence[Tuple[float, float, float]], stamp: rospy.Time, frame_id: str) -> PoseArray:
    """An obstacle list as it is on the wire. obstacles: x, y and z, where z < 0 is outside the lane. [m]"""
    poses = [Pose(Point(x, y, z), Quaternion(100, 160, 300, 330)) for x, y, z in obstacles]
    return PoseArray(Header(stamp=stamp, frame_id=frame_id), poses)


def compressed_image(data: bytes, stamp: rospy.Time) -> CompressedImage:
    """Bytes as the camera would send them, whatever they are."""
    return CompressedImage(Header(stamp=stamp, frame_id='camera'), 'jpeg', data)


@functools.lru_cache(maxsize=None)
def default_calibration() -> Calibration:
    """The package's own camera, 640x480. Always the same object: drawing for another one begins anew, slowly."""
    return load_calibration(str(REPOSITORY / 'config' / 'calibrations'), 'default')


@functools.lru_cache(maxsize=None)
def picture_of(scene: Scene = SCENE, seed: int = 0) -> Any:
    """A drawn picture, (480, 640, 3) uint8, BGR, from the middle of the lane. Not to be written to."""
    picture = draw(scene, default_calibration(), RobotPose(), seed)
    picture.setflags(write=False)
    return picture


def jpeg_of(scene: Scene = SCENE, seed: int = 0) -> bytes:
    """The same as the camera sends it."""
    return encode_jpeg(picture_of(scene, seed))


def process_of(node: str) -> int:
    """Process id that a node says it has: another one after a restart, an exception when it is gone."""
    code, _, pid = rospy.core.xmlrpcapi(rosgraph.Master('/test').lookupNode(node)).getPid('/test')
    assert code == 1, '%s does not answer' % node
    return int(pid)


def publishers_of(topic: str) -> List[str]:
    """Names of the nodes that publish on a topic, as the master knows them."""
    return _nodes_at(topic, 0)


def subscribers_of(topic: str) -> List[str]:
    """Names of the nodes that listen to a topic, as the master knows them."""
    return _nodes_at(topic, 1)


def _nodes_at(topic: str, side: int) -> List[str]:
    found = rosgraph.Master('/test').getSystemState()[side]
    return next((list(nodes) for name, nodes in found if name == topic), [])


def load_launch(name: str, **arguments: str) -> ROSLaunchConfig:
    """A launch file as roslaunch understands it: nodes with their remaps, and parameters by their full names."""
    config = ROSLaunchConfig()
    argv = ['%s:=%s' % item for item in arguments.items()]
    XmlLoader(resolve_anon=False).load(str(REPOSITORY / 'launch' / name), config, argv=argv, verbose=False)
    return config


class Ended(NamedTuple):
    """How a program ended. output: stdout and stderr as they came."""

    code: int
    output: str


def run_program(call: Sequence[str], seconds: float, environment: Optional[Dict[str, str]] = None) -> Ended:
    """Run a program to its end. Fails when it goes on for longer than so many seconds."""
    try:
        ended = subprocess.run(
            list(call),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=seconds,
            check=False,
            env=dict(os.environ, **(environment or {})),
        )
    except subprocess.TimeoutExpired as error:
        raise AssertionError('%s goes on after %.0f s: %r' % (' '.join(call), seconds, error.output)) from error
    return Ended(ended.returncode, ended.stdout.decode(errors='replace'))


def free_port() -> int:
    """A port for a master of our own."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])
