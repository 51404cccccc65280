"""A ROS graph of a tool's own: a launch file on a master of its own, which is gone when the tool goes on."""

import os
import signal
import socket
import subprocess
import time
import uuid
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Dict, Iterator, List, Sequence

MARK = 'OBST_AVOID_GRAPH'
"""Environment variable that roslaunch hands on to the master and all nodes, which are in sessions of their own: what
is left when roslaunch itself was killed is known by it.
"""
END_WAIT = 20.0
"""[s] of wall time for roslaunch to end its nodes; it gives each 15 s, and kills it 2 s later."""
LAST_WAIT = 3.0
"""[s] of wall time between asking the rest to end and killing it."""


@dataclass(frozen=True)
class Graph:
    """process: roslaunch. Its stdout, the nodes' own words too, is to be read or goes where it was sent.

    environment: for other programs that take part.
    """

    process: 'subprocess.Popen[str]'
    environment: Dict[str, str]


@contextmanager
def launched(call: Sequence[str], output: int = subprocess.PIPE) -> Iterator[Graph]:
    """Run a launch file of the package. However the block is left, all that runs in the graph ends.

    call: name of the launch file and its arguments. output: where the nodes' words go, as subprocess has it.
    SIGTERM ends the block as Ctrl-C does.
    """
    # A shell has those that it starts in the background ignore SIGINT: so would the nodes, and roslaunch would wait.
    handlers = {sign: signal.signal(sign, signal.default_int_handler) for sign in (signal.SIGINT, signal.SIGTERM)}
    port, mark = _free_port(), uuid.uuid4().hex
    environment = {
        **os.environ,
        'ROS_MASTER_URI': 'http://localhost:%d' % port,
        'ROS_HOSTNAME': 'localhost',  # nobody else shall reach it
        'PYTHONUNBUFFERED': '1',  # or the nodes' words come when all is over
        MARK: mark,
    }
    try:
        process = subprocess.Popen(
            ['roslaunch', '--port', str(port), 'obst_avoid', *call],
            stdout=output,
            stderr=subprocess.STDOUT,
            text=True,
            errors='replace',
            env=environment,
        )
        try:
            yield Graph(process, environment)
        finally:
            _end(process, mark)
    finally:
        for sign, handler in handlers.items():
            signal.signal(sign, handler)


def _end(process: 'subprocess.Popen[str]', mark: str) -> None:
    try:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=END_WAIT)  # reads on, or a full pipe would hold it
    except subprocess.TimeoutExpired:
        pass
    finally:  # also when somebody is impatient and presses Ctrl-C again
        _kill(mark)
        process.wait()


def _kill(mark: str) -> None:
    """End what still runs in the graph; normally nothing does."""
    for sign in (signal.SIGTERM, signal.SIGKILL):
        for pid in _marked(mark):
            with suppress(ProcessLookupError):
                os.kill(pid, sign)
        end = time.monotonic() + LAST_WAIT
        while _marked(mark) and time.monotonic() < end:
            time.sleep(0.05)


def _marked(mark: str) -> List[int]:
    """Processes with the mark in the environment that they were started with. A zombie has none."""
    words, found = ('%s=%s' % (MARK, mark)).encode(), []
    for name in os.listdir('/proc'):
        if not name.isdigit():
            continue
        try:
            with open('/proc/%s/environ' % name, 'rb') as file:
                if words in file.read().split(b'\0'):
                    found.append(int(name))
        except OSError:  # another user's, or gone meanwhile
            continue
    return found


def _free_port() -> int:
    """For a master of our own, beside one that may be running."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])
