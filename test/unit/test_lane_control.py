"""core.lane_control: signs, limits, stops, and that a simulated robot arrives where it shall."""

import math
from dataclasses import replace
from typing import List, Optional, Tuple

import pytest

from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.lane_control import LaneControlSettings, Reference, control, learning
from obst_avoid.core.types import Command, LanePose, Stamped

NOW = 1_700_000_000_000_000_000
MS = 1_000_000
FOLLOW = Reference(False, 0.5, 0.5)
"""Not active: its numbers must not count."""


@pytest.fixture
def settings(lane_control_settings: LaneControlSettings) -> LaneControlSettings:
    """As shipped, with the limits that the cases name."""
    return replace(
        lane_control_settings,
        cruise_speed=0.2,
        largest_speed=0.5,
        largest_omega=4.0,
        lane_pose_age_limit=0.4,
        reference_age_limit=0.4,
        clock_age_limit=0.5,
        future_limit=0.1,
    )


def command(pose: LanePose, reference: Reference, settings: LaneControlSettings) -> Command:
    """With fresh inputs."""
    return control(Stamped(NOW, pose), Stamped(NOW, reference), 0.0, NOW, settings)[0]


@pytest.mark.parametrize(
    'pose, reference, turn',
    [
        pytest.param(LanePose(0, 0), FOLLOW, 0, id='in the middle, straight'),
        pytest.param(LanePose(0.05, 0), FOLLOW, -1, id='left of the middle: turns right'),
        pytest.param(LanePose(-0.05, 0), FOLLOW, 1, id='right of the middle: turns left'),
        pytest.param(LanePose(0, 0.2), FOLLOW, -1, id='turned left: turns right'),
        pytest.param(LanePose(0, -0.2), FOLLOW, 1, id='turned right: turns left'),
        pytest.param(LanePose(0, 0, 3.0), FOLLOW, 1, id='the lane bends left: turns left'),
        pytest.param(LanePose(0, 0, -3.0), FOLLOW, -1, id='the lane bends right: turns right'),
        pytest.param(LanePose(0, 0), Reference(True, 0.03, 0.1), 1, id='shall go left'),
        pytest.param(LanePose(0, 0), Reference(True, -0.03, 0.1), -1, id='shall go right'),
        pytest.param(LanePose(0.03, 0), Reference(True, 0.03, 0.1), 0, id='is where it shall be'),
        pytest.param(LanePose(0.05, 0), Reference(True, 0.03, 0.1), -1, id='is farther left than it shall be'),
    ],
)
def test_which_way_it_turns(settings: LaneControlSettings, pose: LanePose, reference: Reference, turn: int) -> None:
    omega = command(pose, reference, settings).omega
    assert omega == pytest.approx(0, abs=1e-12) if turn == 0 else omega * turn > 0


@pytest.mark.parametrize(
    'reference, speed, reason',
    [
        pytest.param(FOLLOW, 0.2, 'tracking d_ref +0.000 m at 0.20 m/s', id='not active: cruises'),
        pytest.param(Reference(True, -0.03, 0.12), 0.12, 'tracking d_ref -0.030 m at 0.12 m/s', id='active'),
        pytest.param(Reference(True, 0.03, 0.0), 0.0, 'stopping: asked to by the avoider', id='asked to stop'),
        pytest.param(Reference(True, 0.03, -0.1), 0.0, 'stopping: asked to by the avoider', id='never backwards'),
        pytest.param(Reference(True, 0.0, 0.9), 0.5, 'tracking d_ref +0.000 m at 0.50 m/s', id='asked to race'),
        pytest.param(Reference(False, 0.0, 0.0), 0.2, 'tracking', id='not active, speed of no meaning'),
    ],
)
def test_speed_and_reason(settings: LaneControlSettings, reference: Reference, speed: float, reason: str) -> None:
    answer, why = control(Stamped(NOW, LanePose(0.02, 0.1)), Stamped(NOW, reference), 0.0, NOW, settings)
    assert answer.v == speed and why.startswith(reason)
    assert (answer.omega == 0) is (speed == 0)


def aged(milliseconds: Optional[int], value: object) -> Optional[Stamped]:
    """Stamped so many milliseconds ago; None: never came."""
    return None if milliseconds is None else Stamped(NOW - milliseconds * MS, value)


@pytest.mark.parametrize(
    'pose, reference, clock_stood, reason',
    [
        pytest.param(None, None, 0.0, 'no lane pose yet', id='nothing came'),
        pytest.param(None, 0, 0.0, 'no lane pose yet', id='no lane pose'),
        pytest.param(0, None, 0.0, 'no lane control yet', id='no lane control'),
        pytest.param(401, 0, 0.0, 'lane pose is 0.40 s old, limit 0.40 s', id='old lane pose'),
        pytest.param(0, 401, 0.0, 'lane control is 0.40 s old, limit 0.40 s', id='old lane control'),
        pytest.param(-101, 0, 0.0, 'lane pose is stamped 0.10 s in the future, limit 0.10 s', id='lane pose ahead'),
        pytest.param(
            0, -101, 0.0, 'lane control is stamped 0.10 s in the future, limit 0.10 s', id='lane control ahead'
        ),
        pytest.param(0, 0, 0.6, 'the clock has stood still for 0.6 s, limit 0.5 s', id='the clock stands'),
    ],
)
def test_doubt_stops(
    settings: LaneControlSettings, pose: Optional[int], reference: Optional[int], clock_stood: float, reason: str
) -> None:
    answer, why = control(aged(pose, LanePose(0.05, 0.2)), aged(reference, FOLLOW), clock_stood, NOW, settings)
    assert answer == Command(0.0, 0.0)
    assert why.startswith('stopping: ') and why.endswith(reason)


def test_inputs_at_their_limits_are_fresh(settings: LaneControlSettings) -> None:
    for old, clock in ((400, 0.5), (-100, 0.0)):
        assert control(aged(old, LanePose(0, 0)), aged(old, FOLLOW), clock, NOW, settings)[0].v == 0.2


@pytest.mark.parametrize('pose, omega', [(LanePose(-9, 0), 4.0), (LanePose(9, 0), -4.0), (LanePose(0, 0, 99), 4.0)])
def test_the_turn_rate_is_limited(settings: LaneControlSettings, pose: LanePose, omega: float) -> None:
    assert command(pose, FOLLOW, settings) == Command(0.2, omega)


def test_in_a_bend_it_follows_the_bend(settings: LaneControlSettings) -> None:
    answer = command(LanePose(0, 0, 2.5), FOLLOW, settings)
    assert answer.omega == pytest.approx(0.2 * 2.5)


def driven(
    pose: LanePose, reference: Reference, metres: float, settings: LaneControlSettings, delay: int = 0
) -> List[Tuple[float, float]]:
    """(d, phi) at every centimetre of a robot that does what it is told, on a straight. delay: [cm] of the pose."""
    d, phi, step = pose.d, pose.phi, 0.01
    path = [(d, phi)]
    for i in range(int(metres / step)):
        known = path[max(0, i - delay)]
        answer = command(LanePose(*known), reference, settings)
        seconds = step / answer.v
        d, phi = d + step * math.sin(phi), phi + answer.omega * seconds
        path.append((d, phi))
    return path


@pytest.mark.parametrize('d', [-0.08, 0.0, 0.08])
@pytest.mark.parametrize('phi', [-0.4, 0.0, 0.4])
@pytest.mark.parametrize('reference', [FOLLOW, Reference(True, 0.035, 0.12), Reference(True, -0.035, 0.05)])
def test_it_arrives_at_the_offset(settings: LaneControlSettings, d: float, phi: float, reference: Reference) -> None:
    path = driven(LanePose(d, phi), reference, 1.5, settings)
    wanted = reference.d_ref if reference.active else 0.0
    assert path[-1] == pytest.approx((wanted, 0.0), abs=0.002)


@pytest.mark.parametrize('start', [-0.05, 0.05])
def test_it_does_not_overshoot(settings: LaneControlSettings, start: float) -> None:
    offsets = [d / start for d, _ in driven(LanePose(start, 0.0), FOLLOW, 1.5, settings)]
    assert min(offsets) > -0.05, 'damping 1'
    assert offsets[int(3 * settings.convergence_length / 0.01)] < 0.25, 'a quarter is left after three lengths'


def test_it_stays_stable_with_the_delay_of_the_stack(settings: LaneControlSettings) -> None:
    # 0.3 s at 0.2 m/s are 6 cm
    path = driven(LanePose(0.05, 0.0), FOLLOW, 2.0, settings, delay=6)
    assert max(abs(d) for d, _ in path[100:]) < 0.005


def test_the_avoider_plans_with_the_controllers_own_length(
    avoidance_settings: AvoidanceSettings, lane_control_settings: LaneControlSettings
) -> None:
    assert lane_control_settings.convergence_length == avoidance_settings.convergence_length
    assert lane_control_settings.damping == 1, 'core.avoidance.path'


def taught(pose: LanePose, reference: Reference, settings: LaneControlSettings, learned: float = 0.0) -> float:
    """After 10 cm."""
    return learning(learned, Stamped(NOW, pose), Stamped(NOW, reference), 0.1, settings)


@pytest.mark.parametrize(
    'pose, reference, way',
    [
        pytest.param(LanePose(0.01, 0), FOLLOW, -1, id='stays left: turns right'),
        pytest.param(LanePose(-0.01, 0), FOLLOW, 1, id='stays right: turns left'),
        pytest.param(LanePose(0, 0.2), FOLLOW, 0, id='a heading teaches nothing'),
        pytest.param(LanePose(0.03, 0), Reference(True, 0.03, 0.1), 0, id='where it shall be'),
        pytest.param(LanePose(0.02, 0), Reference(True, 0.03, 0.1), 1, id='right of where it shall be'),
        pytest.param(LanePose(0.05, 0), FOLLOW, 0, id='a great offset teaches nothing'),
    ],
)
def test_it_learns_from_offsets_that_stay(
    settings: LaneControlSettings, pose: LanePose, reference: Reference, way: int
) -> None:
    found = taught(pose, reference, settings)
    assert found == pytest.approx(0, abs=1e-12) if way == 0 else found * way > 0


def test_what_it_learns_is_limited_and_forgotten(settings: LaneControlSettings) -> None:
    learned = 0.0
    for _ in range(1000):
        learned = taught(LanePose(-0.01, 0), FOLLOW, settings, learned)
    assert learned == settings.largest_learned
    assert learning(learned, None, Stamped(NOW, FOLLOW), 0.1, settings) == 0.0
    assert learning(learned, Stamped(NOW, LanePose(0, 0)), None, 0.1, settings) == 0.0
    still = learning(learned, Stamped(NOW, LanePose(0.01, 0)), Stamped(NOW, FOLLOW), 0.0, settings)
    assert still == learned, 'a robot that stands learns nothing'


@pytest.mark.parametrize('pull, lie', [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.05), (0.15, -0.04)])
def test_a_robot_that_pulls_or_is_told_a_wrong_heading_comes_to_the_middle(
    settings: LaneControlSettings, pull: float, lie: float
) -> None:
    # pull: [rad/m] beyond what it is told. lie: [rad] by which its heading is said wrongly. 4 m
    d, phi, learned, offsets = 0.03, 0.0, 0.0, []
    for _ in range(400):
        said, reference = Stamped(NOW, LanePose(d, phi + lie)), Stamped(NOW, FOLLOW)
        learned = learning(learned, said, reference, 0.01, settings)
        told = control(said, reference, 0.0, NOW, settings, learned)[0]
        d += 0.01 * math.sin(phi)
        phi += 0.01 * (told.omega / told.v + pull)
        offsets.append(d)
    assert abs(offsets[-1]) < 0.001
    assert min(offsets) > -0.02 and max(offsets) < 0.035
