"""The avoider in closed loops: whole drives through the shipped scenarios, without pictures (sim.perceived)."""

from dataclasses import replace
from pathlib import Path
from typing import Any, List

import pytest

from obst_avoid.core import detection
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.lane_control import LaneControlSettings
from obst_avoid.core.types import State
from obst_avoid.sim.episode import Frame, Outcome, Robot, run
from obst_avoid.sim.scenario import load_scenario
from unit.drives import TOWNS, simulation
from unit.shipped import CONFIG

FAMILIES = sorted((CONFIG / 'scenarios').glob('*.yaml'))


@pytest.fixture
def robot(
    calibration: Calibration,
    detection_settings: DetectionSettings,
    avoidance_settings: AvoidanceSettings,
    lane_control_settings: LaneControlSettings,
) -> Robot:
    """As shipped; of the detector only the camera's view counts."""
    detector = detection.start(calibration, replace(detection_settings, profile='paper'))
    return Robot(detector, avoidance_settings, lane_control_settings)


def drive(path: Path, seed: int, robot: Robot, watch: Any = lambda frame: None, **instead: Any) -> Outcome:
    """One drive at 15 pictures a second."""
    scenario = load_scenario(str(path), seed, TOWNS, instead)
    return run(scenario, robot, replace(simulation(), picture_rate=15.0), None, watch)


@pytest.mark.parametrize('seed', [1, 2])
@pytest.mark.parametrize('path', FAMILIES, ids=lambda path: path.stem)
def test_every_family(path: Path, seed: int, robot: Robot) -> None:
    outcome = drive(path, seed, robot)
    assert outcome.contact is None and outcome.success, outcome.why
    assert outcome.off_lane == 0
    if path.stem == 'empty_road':
        assert (outcome.activations, outcome.stops) == (0, 0)
    if path.stem in ('outside', 'outside_curve'):
        assert outcome.stops == 0
    if path.stem == 'leaves':
        assert outcome.restart is not None and outcome.restart <= 2.0


@pytest.mark.parametrize('name', ['blocking_straight', 'curve_left', 'two_obstacles', 'outside', 'passable_narrow'])
def test_without_our_own_lines_nothing_is_touched(name: str, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    from obst_avoid.sim import perceived

    monkeypatch.setattr(perceived, '_lane_pose', lambda world, place: None)
    outcome = drive(CONFIG / 'scenarios' / (name + '.yaml'), 3, robot)
    assert outcome.contact is None, outcome.why


def test_stage_stop_only_never_steers(robot: Robot) -> None:
    frames: List[Frame] = []
    rules = replace(robot.avoidance, stage='stop_only')
    outcome = drive(CONFIG / 'scenarios/passable_side.yaml', 1, replace(robot, avoidance=rules), frames.append)
    assert outcome.contact is None and outcome.stops == 1
    assert all(frame.decision.d_ref == 0 and frame.decision.state is not State.AVOIDING for frame in frames)


def test_the_opposite_lane_is_used_where_the_stage_allows_it(robot: Robot) -> None:
    frames: List[Frame] = []
    rules = replace(robot.avoidance, stage='avoid_all_opposite_lane')
    path = CONFIG / 'scenarios/blocking_straight.yaml'
    outcome = drive(path, 1, replace(robot, avoidance=rules), frames.append, duration=30.0)
    assert outcome.contact is None and outcome.driven > 2.3
    stood = next(index for index, frame in enumerate(frames) if frame.decision.state is State.STOPPED)
    assert max(frame.decision.d_ref for frame in frames[:stood]) == 0, 'it stands and looks first'
    assert max(frame.world.lane_pose.d for frame in frames) > 0.15
    assert abs(frames[-1].world.lane_pose.d) < 0.03, 'and it comes back'
