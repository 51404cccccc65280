"""A long drive round the simulated town in the ROS graph: nothing may grow or slow down, or stop for nothing."""

import argparse
import math
import os
import tempfile
import threading
import time
from typing import Any, Dict, List, Optional, Tuple
from xmlrpc.client import ServerProxy

import numpy as np
import yaml

from obst_avoid.offline import tool
from obst_avoid.offline.graph import launched
from obst_avoid.offline.measure import resident
from obst_avoid.offline.tool import ToolError

VEH = 'soak'
NODES = ('obstacle_detection_node', 'obstacle_avoidance_node', 'lane_controller_node', 'car_cmd_guard_node')
SPEED = 0.2
"""[m/s] at most: the road shall not end before the time is up."""
SLOWEST = 0.06
"""[m/s] on average, the stops included; a robot that comes less far stands for nothing."""
APART = 7.0
"""[m] between two duckies that stand in the way and walk off when the robot has stopped."""
SETTLED = 20.0
"""[s] after which memory is read first."""
LOOK = 2.0
"""[s] of wall time between two readings."""
APPEARS = 1.2
"""[m] ahead of the robot where each is set down: the way goes round the town again and again, past the same places."""
NEAR = 0.6
"""[m] between robot and obstacle; a stop that begins farther from all of them has no cause."""
FOR_NOTHING = 0.015
"""[1/m] stops without a cause, at most: measured are four in 570 m, at yellow dashes in tight curves."""
GROWTH, SPARE = 1.05, 5.0
"""Ratio, and [MB] or [ms], by which the end may exceed the beginning."""


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog='soak', description=__doc__)
    parser.add_argument('--minutes', type=float, default=20.0, metavar='M', help='of wall time (default: 20)')
    parser.add_argument('--output', metavar='FILE', help='write the figures there, as JSON')
    return tool.run(_main, parser, arguments)


def scenario(minutes: float) -> Dict[str, Any]:
    """The demo's town, with a duckie in the way every APART metres."""
    content: Dict[str, Any] = tool.node_yaml('', 'demo.yaml')
    goal = max(2.0, 60 * minutes * SPEED)
    alongs = np.arange(APART / 2, goal - 1, APART)
    things = [
        {
            'sort': 'duckie',
            'height': 0.06,
            'along': float(along),
            'left': 0.0,
            'appears_within': APPEARS,
            'leaves_after_stop': 2.0,
        }
        for along in alongs
    ]
    success = {**content['success'], 'goal': float(goal)}
    return {**content, 'obstacles': things, 'duration': 120.0 * minutes + 60.0, 'success': success}


class Heard:
    """What the graph says. stops: [m] to the nearest obstacle when each began, and in words where it was and why.
    latencies: [ms] of each answer. metres: driven. decision: the last one, for a person.
    """

    def __init__(self) -> None:
        import rospy
        from geometry_msgs.msg import PoseStamped
        from std_msgs.msg import Float32

        from obst_avoid.msg import LaneControl

        self.stops: List[Tuple[float, str]] = []
        self.faults: List[str] = []
        self.latencies: List[float] = []
        self.metres, self.decision = 0.0, 'none'
        self._place: Optional[Tuple[float, float]] = None
        self._gap, self._before, self._answered = float('inf'), LaneControl.CLEAR, False
        self._stopped = LaneControl.STOPPED, LaneControl.FAULT
        self._lock = threading.Lock()
        rospy.Subscriber('/%s/simulator_node/truth/gap' % VEH, Float32, self._on_gap)
        rospy.Subscriber('/%s/simulator_node/truth/pose' % VEH, PoseStamped, self._on_pose)
        rospy.Subscriber('/%s/simulator_node/latency' % VEH, Float32, self._on_latency)
        rospy.Subscriber('/%s/obstacle_avoidance_node/lane_control' % VEH, LaneControl, self._on_lane_control)

    def _on_gap(self, msg: Any) -> None:
        self._gap = msg.data

    def _on_pose(self, msg: Any) -> None:
        place = msg.pose.position.x, msg.pose.position.y
        if self._place is not None:
            self.metres += math.dist(place, self._place)
        self._place = place

    def _on_latency(self, msg: Any) -> None:
        self.latencies.append(1e3 * msg.data)

    def _on_lane_control(self, msg: Any) -> None:
        with self._lock:
            self.decision = 'state %d, %s' % (msg.state, msg.reason)
            stopped, fault = self._stopped
            self._answered = self._answered or msg.state not in self._stopped
            if self._answered and msg.state == stopped != self._before:
                self.stops.append((self._gap, 'after %.1f m: %s' % (self.metres, msg.reason)))
            if self._answered and msg.state == fault != self._before:
                self.faults.append(msg.reason)
            self._before = msg.state


def _main(options: argparse.Namespace) -> int:
    if options.output:
        tool.writable(options.output)
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, 'soak.yaml')
        with open(path, 'w', encoding='utf-8') as file:
            yaml.safe_dump(scenario(options.minutes), file)
        call = ['simulation.launch', 'veh:=' + VEH, 'scenario:=' + path, 'ends:=true']
        with open(os.path.join(folder, 'log.txt'), 'wb') as log, launched(call, log.fileno()) as graph:
            for name in ('ROS_MASTER_URI', 'ROS_HOSTNAME'):
                os.environ[name] = graph.environment[name]
            figures = _watched(graph.process, 60 * options.minutes)
    for name, value in figures.items():
        print('%-40s %s' % (name, value))
    if options.output:
        tool.write_json(options.output, figures)
    wrong = judged(figures)
    if wrong:
        raise ToolError('; '.join(wrong))
    return 0


def _watched(process: Any, seconds: float) -> Dict[str, Any]:
    import rospy

    rospy.init_node('soak', anonymous=True, disable_signals=True)
    heard = Heard()
    end, begin = time.monotonic() + seconds, time.monotonic() + min(SETTLED, seconds / 2)
    memory: List[Dict[str, float]] = []
    started = time.monotonic()
    bar = tool.progress(range(int(seconds / LOOK)), 'driving', int(seconds / LOOK))
    for _ in bar:
        time.sleep(LOOK)
        if process.poll() is not None or time.monotonic() > end:
            break
        if time.monotonic() >= begin:
            memory.append(_memory())
    if not memory or not heard.latencies:
        raise ToolError('the graph does not answer within %.0f s, expected detector and avoider' % seconds)
    quarter = max(1, len(heard.latencies) // 4)
    first, last = heard.latencies[:quarter], heard.latencies[-quarter:]
    return {
        'minutes asked for': round(seconds / 60, 2),
        'minutes': round((time.monotonic() - started) / 60, 2),
        'pictures answered': len(heard.latencies),
        'memory at the beginning [MB]': memory[0],
        'memory at the end [MB]': memory[-1],
        'latency of the first quarter, p95 [ms]': round(float(np.percentile(first, 95)), 1),
        'latency of the last quarter, p95 [ms]': round(float(np.percentile(last, 95)), 1),
        'metres': round(heard.metres, 1),
        'decision at the end': heard.decision,
        'stops': len(heard.stops),
        'stops without a cause': [words for gap, words in heard.stops if gap > NEAR],
        'faults': heard.faults,
    }


def judged(figures: Dict[str, Any]) -> List[str]:
    """What went wrong, in words."""
    wrong = []
    if figures['minutes'] < 0.95 * figures['minutes asked for']:
        wrong.append('it ended after %.1f of %.1f minutes' % (figures['minutes'], figures['minutes asked for']))
    expected = int(60 * figures['minutes'] * SLOWEST / APART)
    if figures['stops'] < expected:
        place = 'on %.1f m, and at the end %s' % (figures['metres'], figures['decision at the end'])
        wrong.append('%d stops, expected at least %d, %s' % (figures['stops'], expected, place))
    for name, before in figures['memory at the beginning [MB]'].items():
        after = figures['memory at the end [MB]'].get(name)
        if after is None:
            wrong.append('%s is gone' % name)
        elif after > GROWTH * before + SPARE:
            wrong.append('%s grew from %.1f to %.1f MB' % (name, before, after))
    before, after = (figures['latency of the %s quarter, p95 [ms]' % which] for which in ('first', 'last'))
    if after > 1.5 * before + SPARE:
        wrong.append('answers took %.1f ms at the beginning and %.1f ms at the end' % (before, after))
    stops = figures['stops without a cause']
    if len(stops) > max(1.0, figures['metres'] * FOR_NOTHING):
        wrong.append('%d stops without a cause: %s' % (len(stops), stops[0]))
    if figures['faults']:
        wrong.append('%d faults: %s' % (len(figures['faults']), figures['faults'][0]))
    return wrong


def _memory() -> Dict[str, float]:
    """[MB] of each node that runs."""
    master, used = ServerProxy(os.environ['ROS_MASTER_URI']), {}
    for node in NODES:
        code, _, uri = master.lookupNode('/soak', '/%s/%s' % (VEH, node))  # type: ignore[misc]
        if code == 1:
            used[node] = round(resident(int(ServerProxy(str(uri)).getPid('/soak')[2])), 1)  # type: ignore[index, call-overload]
    return used
