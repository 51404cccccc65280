"""bench's last part: the real nodes in a ROS graph of their own, with pictures at a camera's rate."""

import argparse
import json
import os
import pickle
import re
import select
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from typing import Any, Dict, Iterator, List, Sequence, Tuple
from xmlrpc.client import ServerProxy

from obst_avoid.core.age import NANOSECONDS
from obst_avoid.offline.bench_nodes import CAMERA, LISTENER, START_WAIT
from obst_avoid.offline.graph import Graph, launched
from obst_avoid.offline.measure import cpu_seconds, percentiles, resident
from obst_avoid.offline.tool import ToolError

RATE = 30.0
WARM_UP = 30
"""Pictures before those that count."""
SETTLED = 5.0
"""[s] after which a node's memory is read first, and half of the time when that is less."""
ANSWER_WAIT = 1.0
"""[s] after the last picture for its answer."""
LOOK = 0.2
"""[s] between looks whether a node has died."""
DIED = 'process has died'
DETECTOR, AVOIDER = 'obstacle_detection_node', 'obstacle_avoidance_node'
NODES = (DETECTOR, AVOIDER)

Arrivals = Sequence[Tuple[int, int]]
"""Stamp of each message and when it came, both [ns]."""


def bench_graph(options: argparse.Namespace, jpegs: Sequence[bytes]) -> Dict[str, Any]:
    """Run obst_avoid.launch for options.graph_seconds; prints a table and returns its figures.

    Raises ToolError when the graph does not answer.
    """
    veh = options.vehicle or 'bench'
    arguments = {
        'veh': veh,
        'calibration_dir': options.calibration and os.path.abspath(options.calibration),
        'allow_default_calibration': str(not options.vehicle).lower(),
        'profile': options.profile,
        'stage': options.stage,
    }
    call = ['obst_avoid.launch'] + ['%s:=%s' % (name, value) for name, value in arguments.items() if value]
    with tempfile.TemporaryDirectory() as folder, ExitStack() as ended:
        log = ended.enter_context(open(os.path.join(folder, 'log.txt'), 'ab'))
        with launched(call, log.fileno()) as graph:  # all that takes part is gone when this block is left
            run = _Run(graph, log.name, ended)
            stamps, heard, used = run.measure(veh, jpegs, options.graph_seconds)
    figures: Dict[str, Any] = {'seconds': options.graph_seconds, **counts(stamps, **heard), **used}
    _print(figures)
    return figures


def counts(stamps: Sequence[int], posearray: Arrivals, lane_control: Arrivals) -> Dict[str, Any]:
    """What became of the pictures.

    stamps: [ns] of those that were published, in order. Answers to pictures before them do not count.
    answered: decided upon. twice: times that the detector worked on a picture again. repeated: decisions on the
    picture of the decision before, by the avoider's timer. oldest_ms: age of a decision's picture, at most.
    """
    end = stamps[-1] + NANOSECONDS / RATE
    seen = [stamp for stamp, _ in posearray if stamp >= stamps[0]]
    decided = [(stamp, time) for stamp, time in lane_control if stamp >= stamps[0]]
    first: Dict[int, int] = {}
    for stamp, arrived in decided:
        first.setdefault(stamp, arrived)
    again = [(stamp, arrived) for stamp, arrived in decided if first[stamp] < arrived <= end]
    if not first:
        raise ToolError('the graph does not answer: none of %d pictures was decided upon' % len(stamps))
    return {
        'published': len(stamps),
        'answered': len(first),
        'dropped': len(set(stamps) - set(first)),
        'twice': len(seen) - len(set(seen)),
        'repeated': len(again),
        'latency': percentiles([(arrived - stamp) / 1e6 for stamp, arrived in first.items()]),
        'oldest_ms': round(max((arrived - stamp) / 1e6 for stamp, arrived in [*first.items(), *again]), 3),
    }


class _Run:
    """Talks with the graph. Whatever it starts ends with the graph, and is waited for by `ended` after that."""

    def __init__(self, graph: Graph, log_path: str, ended: ExitStack) -> None:
        self._graph, self._log_path, self._ended = graph, log_path, ended

    def measure(
        self, veh: str, jpegs: Sequence[bytes], seconds: float
    ) -> Tuple[List[int], Dict[str, Arrivals], Dict[str, Any]]:
        """Stamps that were published, what was heard, and what the nodes used."""
        pictures_path = os.path.join(os.path.dirname(self._log_path), 'pictures')
        with open(pictures_path, 'wb') as file:
            pickle.dump(list(jpegs), file)
        sizes = ['--rate=%s' % RATE, '--warm-up=%d' % WARM_UP, '--count=%d' % max(1, round(seconds * RATE))]
        listener = self._start(LISTENER, veh)
        camera = self._start(CAMERA, veh, '--pictures=' + pictures_path, *sizes)
        for process in (listener, camera):
            self._line(process, 2 * START_WAIT)
        try:
            pids = {name: self._pid('/%s/%s' % (veh, name)) for name in NODES}
            _go_on(camera)
            self._line(camera, START_WAIT)
            begin, before = time.monotonic(), {name: cpu_seconds(pid) for name, pid in pids.items()}
            for _ in self._looks(min(SETTLED, seconds / 2)):
                time.sleep(LOOK)
            memory = resident(pids[DETECTOR])
            stamps = self._line(camera, seconds + START_WAIT)
            wall = time.monotonic() - begin
            used = {
                'cpu_share': {name: round((cpu_seconds(pids[name]) - before[name]) / wall, 4) for name in NODES},
                'memory_mb': {'begin': round(memory, 1), 'end': round(resident(pids[DETECTOR]), 1)},
            }
            time.sleep(ANSWER_WAIT)
            _go_on(listener)
            heard = self._line(listener, START_WAIT)
            _go_on(camera)
            return stamps, heard, used
        except OSError as error:
            raise self._silent('a process is gone, %s' % error) from error

    def _start(self, role: str, veh: str, *arguments: str) -> 'subprocess.Popen[bytes]':
        with open(self._log_path, 'ab') as log:
            process = subprocess.Popen(
                [sys.executable, '-m', 'obst_avoid.offline.bench_nodes', role, veh, *arguments],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, bufsize=0, env=self._graph.environment,
            )  # fmt: skip
        return self._ended.enter_context(process)

    def _line(self, process: 'subprocess.Popen[bytes]', limit: float) -> Any:
        """What a process says next."""
        assert process.stdout is not None
        for _ in self._looks(limit):
            if select.select([process.stdout], [], [], LOOK)[0]:
                line = process.stdout.readline()
                if line:
                    return json.loads(line)
                break
        raise self._silent('no connection to detector and avoider, expected one within %.0f s' % START_WAIT)

    def _looks(self, seconds: float) -> Iterator[None]:
        """Go on for so long, as long as all nodes live."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if self._graph.process.poll() is not None:
                raise self._silent('roslaunch ended')
            if any(DIED in line for line in self._lines()):
                raise self._silent('a node died')
            yield

    def _pid(self, node: str) -> int:
        _, _, uri = ServerProxy(self._graph.environment['ROS_MASTER_URI']).lookupNode('/bench', node)
        return int(ServerProxy(uri).getPid('/bench')[2])

    def _lines(self) -> List[str]:
        with open(self._log_path, encoding='utf-8', errors='replace') as log:
            return list(log)

    def _silent(self, why: str) -> ToolError:
        """In one sentence, with what the nodes said of it."""
        lines = self._lines()
        marked = [line for mark in ('[FATAL]', '[ERROR]', 'Error', DIED) for line in lines if mark in line]
        said = re.sub(r'\x1b\[[0-9;]*m', '', marked[0]).split(', cmd')[0].strip() if marked else ''
        return ToolError('the graph does not answer: %s%s' % (why, said and ', after: ' + said))


def _go_on(process: 'subprocess.Popen[bytes]') -> None:
    assert process.stdin is not None
    process.stdin.write(b'\n')


def _print(figures: Dict[str, Any]) -> None:
    latency = figures['latency']
    title = 'in the ROS graph, %g s at %g Hz' % (figures['seconds'], RATE)
    print('\n%-38s %8s %8s %8s' % (title, 'median', 'p95', 'p99'))
    print('%-38s %8.1f %8.1f %8.1f' % ('from stamp to lane_control, ms', *latency.values()))
    print('%-38s %8.1f' % ('oldest picture decided upon, ms', figures['oldest_ms']))
    for name, words in (
        ('published', 'pictures published'),
        ('answered', 'answered'),
        ('dropped', 'dropped'),
        ('twice', 'processed twice'),
        ('repeated', 'decided upon again, by the timer'),
    ):
        print('%-38s %8d' % (words, figures[name]))
    for name, share in figures['cpu_share'].items():
        print('%-38s %8.1f %%' % (name + ', of a core', 100 * share))
    memory = figures['memory_mb']
    print('%-38s %8.1f   (%.1f at the end)' % ('memory of the detector, MB', memory['begin'], memory['end']))
