"""sim.episode: the programs hear of things as late as on a robot, and an episode ends with the right verdict."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np
import pytest

from obst_avoid.core import detection
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.lane_control import LaneControlSettings
from obst_avoid.core.types import Command, Decision, Kind, Obstacle, Scene, State
from obst_avoid.sim import episode
from obst_avoid.sim import world as worlds
from obst_avoid.sim.episode import Frame, Outcome, Robot, run
from obst_avoid.sim.renderer import Renderer
from obst_avoid.sim.world import STEP, Contact, Place, World
from unit.cameras import Camera, calibration_of
from unit.drives import START, mapping, quiet, scenario_of, thing
from unit.shipped import avoidance_settings, detection_settings, lane_control_settings

CONE_AHEAD = Obstacle(Kind.CONE, 0.35, 0.0, 0.03, True)
MS = 1_000_000
"""[ns]"""
SEEN = np.full((16, 16, 3), 90, dtype=np.uint8)

Sight = Callable[[List[Obstacle], World], List[Obstacle]]


def perfect(truth: List[Obstacle], world: World) -> List[Obstacle]:
    """Sees what there is."""
    return [item for item in truth if item.x > 0]


def blind(truth: List[Obstacle], world: World) -> List[Obstacle]:
    """Sees nothing."""
    return []


@pytest.fixture
def play(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    avoidance_settings: AvoidanceSettings,
    lane_control_settings: LaneControlSettings,
) -> Callable[..., Outcome]:
    """Plays an episode with a made-up detector: it is given the truth and answers what it likes."""
    detector = detection.start(calibration_of(Camera()), replace(detection_settings(), profile='paper'))
    robot = Robot(detector, avoidance_settings, lane_control_settings)

    def make(
        content: Dict[str, Any],
        sight: Sight = perfect,
        watch: Any = lambda frame: None,
        tell: Any = lambda asked: None,
        **changes: Any,
    ) -> Outcome:
        shown: List[Any] = []

        def picture(world: World, place: Place, renderer: Any) -> Tuple[Any, World]:
            shown.append(sight(worlds.truth(world, place), world))
            return SEEN, replace(world, pictures=world.pictures + 1)

        monkeypatch.setattr(worlds, 'picture', picture)
        monkeypatch.setattr(detection, 'detect', lambda detector, *asked: (Scene(shown[-1]), tell(asked) or detector))
        settings = quiet(**{'picture_rate': 10.0, **changes})
        return run(scenario_of(tmp_path, content), robot, settings, object(), watch)  # type: ignore[arg-type]

    return make


def test_it_stops_before_a_cone(play: Any) -> None:
    outcome = play(mapping(thing(0.9)))
    assert (outcome.success, outcome.contact, outcome.stops, outcome.false_stops) == (True, None, 1, 0)
    assert outcome.stop_gap == pytest.approx(0.34, abs=0.015)  # stop_distance
    assert outcome.why == 'stands %.2f m before the obstacle' % outcome.stop_gap
    assert outcome.smallest_gap == pytest.approx(outcome.stop_gap, abs=1e-3)
    assert outcome.driven == pytest.approx(0.9 - 0.03 - 0.066 - outcome.stop_gap, abs=2e-3)
    # a moment for the first answer, the way, its last 0.11 m more slowly, and 2 s of standing
    assert outcome.seconds == pytest.approx(0.06 + 0.13 + outcome.driven / 0.2 + 0.6 + 2.1, abs=0.3)
    assert (outcome.activations, outcome.in_the_way, outcome.off_lane) == (1, True, 0.0)
    assert (outcome.scenario, outcome.seed) == ('test', 1)


def test_a_blind_robot_hits_it(play: Any) -> None:
    outcome = play(mapping(thing(0.5, sort='duckie', height=0.05)), blind)
    assert not outcome.success and outcome.contact is not None
    expected = 'touched a duckie at %.2f s, x %.2f m, y 0.17 m' % (outcome.contact.time, outcome.contact.x)
    assert outcome.why == expected
    assert outcome.contact.time == pytest.approx(outcome.seconds, abs=1e-3)
    assert (outcome.stops, outcome.stop_gap, outcome.in_the_way) == (0, None, True)


def ghost(truth: List[Obstacle], world: World) -> List[Obstacle]:
    """Sees a cone that is not there for half a second."""
    return [CONE_AHEAD] if 1.5 < world.time < 2.0 else []


@pytest.mark.parametrize('must, success', [('drive', False), ('arrive', True), ('pass', True), ('stop', False)])
def test_a_stop_for_nothing(play: Any, must: str, success: bool) -> None:
    outcome = play(mapping(success={'must': must, 'goal': 0.6}), ghost)
    words = {'drive': 'stopped 1 times for nothing', 'stop': 'drove past the obstacle'}.get(must, 'arrived')
    assert (outcome.success, outcome.why) == (success, words)
    assert (outcome.stops, outcome.false_stops, outcome.activations, outcome.in_the_way) == (1, 1, 1, False)
    assert outcome.driven == pytest.approx(0.6, abs=2e-3)
    assert outcome.smallest_gap == float('inf')


@pytest.mark.parametrize('left, along, false_stops', [(0.0, 1.0, 0), (-0.3, 1.0, 1), (0.0, 2.4, 1)])
def test_a_stop_counts_as_false_without_an_obstacle_near(
    play: Any, left: float, along: float, false_stops: int
) -> None:
    # the ghost appears after 0.3 m, so the cone is 0.7 m or 2.1 m ahead
    outcome = play(mapping(thing(along, left), success={'must': 'drive', 'goal': 0.5}), ghost)
    assert (outcome.stops, outcome.false_stops) == (1, false_stops)


@pytest.mark.parametrize(
    'must, success', [('arrive', False), ('pass', False), ('drive', False), ('touch_nothing', True)]
)
def test_patience_ends(play: Any, must: str, success: bool) -> None:
    outcome = play(mapping(thing(0.7), success={'must': must}), patience=3.0)
    assert outcome.success is success
    assert outcome.why.startswith('stands for 3 s: stopping: 1 obstacle in the lane')


@pytest.mark.parametrize('must, success', [('arrive', False), ('stop', False), ('touch_nothing', True)])
def test_time_runs_out(play: Any, must: str, success: bool) -> None:
    outcome = play(mapping(duration=1.0, success={'must': must}), blind)
    assert (outcome.success, outcome.seconds) == (success, pytest.approx(1.0, abs=STEP))
    assert re.match(r'ran out of time after 0\.1\d m: clear: no obstacle in the lane$', outcome.why)


@pytest.mark.parametrize('smallest, largest, success', [(0.3, 0.45, True), (0.05, 0.2, False), (0.42, 0.45, False)])
def test_the_gap_must_be_right(play: Any, smallest: float, largest: float, success: bool) -> None:
    outcome = play(mapping(thing(0.7), success={'smallest_gap': smallest, 'largest_gap': largest}))
    assert (outcome.success, outcome.why[:9]) == (success, 'stands 0.')


def test_time_beyond_a_line(play: Any) -> None:
    outcome = play(mapping(start={**START, 'd': 0.2}, success={'must': 'drive', 'goal': 0.8}), blind)
    assert (outcome.success, outcome.why[:17]) == (False, 'left the lane for')
    # from 0.2 m back to 0.11 m; 0.15 m of convergence length at 0.2 m/s
    assert 0.3 < outcome.off_lane < 2.0
    assert play(mapping(success={'must': 'drive', 'goal': 0.3}), blind).off_lane == 0.0


class Spy:
    """Notes the simulated time, in ns, of each call, and what was asked."""

    def __init__(self, function: Any, now: int) -> None:
        self._function, self._now = function, now
        self.calls: List[Tuple[int, Any]] = []

    def __call__(self, *asked: Any) -> Any:
        self.calls.append((asked[self._now], asked))
        return self._function(*asked)

    @property
    def times(self) -> Any:
        """[s] since the beginning."""
        return (np.array([now for now, _ in self.calls]) - 1000 * 10**9) / 1e9


@pytest.fixture
def graph(play: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Tuple[Spy, Spy, List[Frame]]]:
    """Plays two seconds; returns what the avoider and the controller were asked, and the frames."""

    def make(pose_errors: str = 'clean', **changes: Any) -> Tuple[Spy, Spy, List[Frame]]:
        decide, control = Spy(episode.decide, 2), Spy(episode.control, 3)
        monkeypatch.setattr(episode, 'decide', decide)
        monkeypatch.setattr(episode, 'control', control)
        frames: List[Frame] = []
        play(mapping(duration=2.0, pose_errors=pose_errors), blind, frames.append, **changes)
        return decide, control, frames

    return make


def test_a_picture_is_answered_after_its_delay(graph: Any) -> None:
    decide, _, frames = graph(picture_delay=0.085, picture_rate=20.0)
    assert [frame.time for frame in frames] == pytest.approx(0.085 + 0.05 * np.arange(39), abs=STEP)
    asked = [(now, call[0].obstacles.stamp) for now, call in decide.calls if call[0].obstacles is not None]
    assert [now - stamp for now, stamp in asked] == pytest.approx([85 * MS] * 39, abs=6 * MS)
    assert [frame.world.pictures for frame in frames][:3] == [2, 3, 4], 'the next one is taken meanwhile'


def test_the_avoider_speaks_without_pictures(graph: Any) -> None:
    decide, _, frames = graph(picture_rate=1.0)
    assert len(frames) == 2
    assert decide.times[0] == pytest.approx(0.1, abs=STEP) or decide.times[0] == pytest.approx(0.06, abs=STEP)
    assert np.diff(decide.times).max() <= 0.1 + STEP + 1e-6
    silent = decide.times[(decide.times > 0.07) & (decide.times < 1.0)]
    assert np.diff(silent) == pytest.approx(0.1, abs=STEP + 1e-6)


def test_the_controller_speaks_every_50_ms(graph: Any) -> None:
    _, control, _ = graph('real', picture_rate=1.0)
    assert np.diff(control.times).max() <= 0.05 + STEP + 1e-6
    assert 30 < len(control.times) < 100


def test_lane_poses_come_late(graph: Any) -> None:
    decide, control, _ = graph('real')
    heard = [(now, call[0]) for now, call in control.calls if call[0] is not None]
    first = {pose.stamp: now for now, pose in reversed(heard)}
    assert len(first) >= 18
    assert [now - stamp for stamp, now in first.items()] == pytest.approx([100 * MS] * len(first), abs=6 * MS)
    stamps = np.array(sorted(first))
    assert np.diff(stamps) == pytest.approx([100 * MS] * (len(first) - 1), abs=6 * MS), '10 a second'
    known = {call[0].lane_pose.stamp for _, call in decide.calls if call[0].lane_pose is not None}
    assert known <= set(first)


def test_clean_lane_poses_come_at_once(graph: Any) -> None:
    _, control, _ = graph('clean')
    first = {call[0].stamp: now for now, call in reversed(control.calls) if call[0] is not None}
    assert [now - stamp for stamp, now in first.items()] == pytest.approx([0] * len(first), abs=MS)
    assert 55 <= len(first) <= 61, '30 a second'


def test_the_detector_is_told_how_the_robot_moves(play: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    gave, asked = Spy(episode.control, 3), []
    monkeypatch.setattr(episode, 'control', gave)
    play(mapping(duration=3.0), blind, tell=asked.append)
    assert len(asked) == 31
    for _, stamp, commands in asked:
        recent = [now for now, _ in gave.calls if now <= stamp and now >= stamp - 2_000 * MS]
        assert [command.stamp for command in commands if command.stamp >= stamp - 2_000 * MS] == recent
    assert {command.value.v for command in asked[10][2]} == {0.0, 0.2}


def test_before_the_first_answer_it_stands(graph: Any) -> None:
    _, _, frames = graph(picture_delay=0.25, picture_rate=10.0)
    assert frames[0].world.time == pytest.approx(0.25, abs=STEP)
    assert frames[0].world.vehicle.v == 0 and not frames[0].world.drove
    assert frames[-1].world.vehicle.v > 0.15


def decision(state: State) -> Decision:
    """Of a state."""
    return Decision(state, 0.0, 0.0, 'because')


def judged(
    folder: Path,
    success: Dict[str, Any],
    along: float = 0.9,
    state: State = State.STOPPED,
    stops: int = 0,
    **world: Any,
) -> Optional[Tuple[bool, str]]:
    """The verdict on a world with a cone 1.1 m from the start, at 0.3 m; the robot has come to `along` m."""
    place, begun = worlds.begin(scenario_of(folder, mapping(thing(1.1), success=success)), quiet())
    begun = replace(begun, along=along, vehicle=replace(begun.vehicle, pose=replace(begun.vehicle.pose, x=along)))
    tally = episode._Tally()
    tally.stops = stops
    return episode._verdict(replace(begun, **world), place, tally, decision(state))


VERDICTS = {
    'goes on': ({}, {}, None),
    'stands, not long enough': ({}, {'stood': 1.9}, None),
    'stands': ({}, {'stood': 2.0}, (True, 'stands 0.40 m before the obstacle')),
    'stands too near': ({'smallest_gap': 0.41}, {'stood': 2.0}, (False, 'stands 0.40 m before the obstacle')),
    'stands too far': ({'largest_gap': 0.39}, {'stood': 2.0}, (False, 'stands 0.40 m before the obstacle')),
    'stands far away': ({}, {'stood': 2.0, 'along': 0.31}, None),
    'stands by fault': ({}, {'stood': 2.0, 'state': State.FAULT}, None),
    'stands and must not': ({'must': 'arrive'}, {'stood': 9.9}, None),
    'stands to the end': ({'must': 'arrive'}, {'stood': 10.0}, (False, 'stands for 10 s: because')),
    'stands, nothing touched': ({'must': 'touch_nothing'}, {'stood': 10.0}, (True, 'stands for 10 s: because')),
    'by fault to the end': ({}, {'stood': 10.0, 'state': State.FAULT}, (False, 'stands for 10 s: because')),
    'drove past': ({'goal': 0.5}, {}, (False, 'drove past the obstacle')),
    'arrived': ({'must': 'arrive', 'goal': 0.5}, {'stops': 2}, (True, 'arrived')),
    'passed': ({'must': 'pass', 'goal': 0.5}, {}, (True, 'arrived')),
    'nothing touched': ({'must': 'touch_nothing', 'goal': 0.5}, {}, (True, 'arrived')),
    'drove': ({'must': 'drive', 'goal': 0.5}, {}, (True, 'arrived')),
    'drove with stops': ({'must': 'drive', 'goal': 0.5}, {'stops': 2}, (False, 'stopped 2 times for nothing')),
    'not there yet': ({'must': 'drive', 'goal': 0.7}, {}, None),
    'time is over': ({'must': 'arrive'}, {'time': 20.0}, (False, 'ran out of time after 0.60 m: because')),
    'time is over, untouched': (
        {'must': 'touch_nothing'}, {'time': 20.0}, (True, 'ran out of time after 0.60 m: because'),
    ),
}  # fmt: skip


@pytest.mark.parametrize('success, case, expected', VERDICTS.values(), ids=list(VERDICTS))
def test_verdicts(success: Any, case: Any, expected: Any, tmp_path: Path) -> None:
    assert judged(tmp_path, success, **case) == expected


@pytest.mark.parametrize('must', ['stop', 'pass', 'drive', 'arrive', 'touch_nothing'])
def test_a_contact_is_never_a_success(must: str, tmp_path: Path) -> None:
    place, world = worlds.begin(scenario_of(tmp_path, mapping(thing(1.0))), quiet())
    contact = Contact(1.234, 0.5, 0.17, worlds.obstacles(world, place)[0])
    expected = (False, 'touched a cone at 1.23 s, x 0.50 m, y 0.17 m')
    assert judged(tmp_path, {'must': must, 'goal': 0.1}, contact=contact) == expected


@pytest.mark.parametrize('d, lost', [(0.59, False), (0.61, True), (-0.61, True)])
def test_off_the_road(d: float, lost: bool, tmp_path: Path) -> None:
    _, world = worlds.begin(scenario_of(tmp_path, mapping()), quiet())
    found = judged(tmp_path, {'must': 'touch_nothing'}, lane_pose=replace(world.lane_pose, d=d))
    assert found == ((False, 'lost the road') if lost else None)


def test_the_tally() -> None:
    tally, outside = episode._Tally(), replace(CONE_AHEAD, in_lane=False)
    world: Any = None
    steps = [
        (State.FAULT, [], 9.0), (State.CLEAR, [outside], 0.5), (State.AVOIDING, [CONE_AHEAD], 0.3),
        (State.STOPPED, [CONE_AHEAD], 0.2), (State.STOPPED, [CONE_AHEAD], 0.1), (State.CLEAR, [], 0.4),
        (State.STOPPED, [outside, replace(CONE_AHEAD, x=1.1)], 0.6), (State.FAULT, [], 0.7),
        (State.STOPPED, [replace(CONE_AHEAD, in_lane=None)], 0.8),
    ]  # fmt: skip
    ways = []
    for state, truth, gap in steps:
        tally.look(decision(state), truth, gap, world)
        ways.append(tally.in_the_way)
    assert ways == [False, False, True, True, True, True, True, True, True]
    assert (tally.stops, tally.false_stops, tally.activations) == (3, 1, 2)
    assert (tally.smallest_gap, tally.stop_gap) == (0.1, 0.8)


def test_stamps_are_exact() -> None:
    assert [worlds.stamp(index * STEP) for index in (0, 1, 199, 200, 12345)] == [
        1000 * 10**9, 1000 * 10**9 + 5 * MS, 1000 * 10**9 + 995 * MS, 1001 * 10**9, 1061 * 10**9 + 725 * MS,
    ]  # fmt: skip


def test_a_real_episode(tmp_path: Path) -> None:
    calibration = calibration_of(Camera().resized(320, 240))
    robot = Robot(
        detection.start(calibration, replace(detection_settings(), profile='paper')),
        avoidance_settings(),
        lane_control_settings(),
    )
    content = mapping(thing(0.65, sort='duckie', height=0.06, yaw=2.5), start={**START, 'along': 0.5})
    scenario, settings = scenario_of(tmp_path, content), quiet(picture_rate=10.0, calm=0.5)
    runs = []
    for _ in range(2):
        renderer, frames = Renderer(calibration), []
        try:
            runs.append((run(scenario, robot, settings, renderer, frames.append), frames))
        finally:
            renderer.close()
    (one, frames), (other, others) = runs
    assert one == other
    assert [frame.jpeg for frame in frames] == [frame.jpeg for frame in others]
    assert (one.success, one.stops, one.false_stops) == (True, 1, 0), one.why
    assert 0.1 < one.stop_gap < 0.45
    assert any(frame.obstacles for frame in frames) and frames[-1].decision.state is State.STOPPED
    assert frames[-1].command == Command(0.0, 0.0)


def test_it_is_counted_what_the_detector_knew(play: Any) -> None:
    seen = play(mapping(thing(0.9))).sightings
    assert (seen.of[0].after, seen.of[0].lost, seen.invented) == (0.0, 0, 0)
    missed = play(mapping(thing(0.5, sort='duckie', height=0.05)), blind).sightings
    assert (missed.of[0].after, missed.invented) == (None, 0)
    assert play(mapping(success={'must': 'arrive', 'goal': 0.6}), ghost).sightings.invented == 1
