"""sim.vehicle: arcs, delay, lag, trim and noise as set, and a body of the right size."""

import cmath
import math
from typing import Any, List

import numpy as np
import pytest

from obst_avoid.core.types import Command
from obst_avoid.sim.things import Thing, footprint
from obst_avoid.sim.town import WorldPose
from obst_avoid.sim.vehicle import Vehicle, VehicleSettings, body, driven, moved, told
from unit.drives import exact

DT = 0.005
ORIGIN = WorldPose(0.0, 0.0, 0.0)
AT_ONCE = {'command_delay': 0.0, 'speed_lag': 1e-6, 'turn_lag': 1e-6}


def course(vehicle: Vehicle, seconds: float, settings: VehicleSettings, dt: float = DT, seed: int = 1) -> List[Vehicle]:
    """The vehicle after each step, from 0 s on."""
    random, states = np.random.RandomState(seed), []
    for index in range(round(seconds / dt)):
        vehicle = moved(vehicle, index * dt, dt, settings, random)
        states.append(vehicle)
    return states


@pytest.mark.parametrize('omega', [0.5, -0.5, 3.0, -1e-3])
@pytest.mark.parametrize('dt', [2.0, 0.005, -1.5])
def test_the_path_is_an_arc(omega: float, dt: float) -> None:
    radius, end = 0.2 / omega, 0.3 + omega * dt
    left = driven(WorldPose(1.0, 2.0, 0.3), 0.2, omega, dt)
    hand = (1 + radius * (math.sin(end) - math.sin(0.3)), 2 - radius * (math.cos(end) - math.cos(0.3)), end)
    assert (left.x, left.y, left.heading) == pytest.approx(hand, abs=1e-10)


@pytest.mark.parametrize('omega', [0.0, 1e-12, -1e-9])
def test_without_a_turn_it_is_a_line(omega: float) -> None:
    left = driven(WorldPose(1.0, 2.0, math.pi / 6), 0.2, omega, 3.0)
    assert (left.x, left.y, left.heading) == pytest.approx((1 + 0.6 * math.sqrt(0.75), 2.3, math.pi / 6), abs=1e-8)


@pytest.mark.parametrize('v, omega', [(0.2, 0.0), (0.2, 2.0), (-0.1, -1.0), (0.0, 1.0)])
def test_driving_back_in_time_returns(v: float, omega: float) -> None:
    start = WorldPose(-1.0, 0.5, 2.0)
    back = driven(driven(start, v, omega, 0.7), v, omega, -0.7)
    assert (back.x, back.y, back.heading) == pytest.approx((-1.0, 0.5, 2.0), abs=1e-12)


def test_a_command_counts_after_its_delay() -> None:
    settings = exact(command_delay=0.05)
    states = course(told(Vehicle(ORIGIN), Command(0.2, 1.0), 0.0, settings), 0.1, settings)
    assert [state.v > 0 for state in states] == [False] * 10 + [True] * 10
    assert [state.omega > 0 for state in states] == [False] * 10 + [True] * 10
    assert states[9].pose == ORIGIN


def test_the_newest_command_that_is_due_counts() -> None:
    settings = exact(**{**AT_ONCE, 'command_delay': 0.05})
    vehicle = Vehicle(ORIGIN)
    for now, speed in ((0.0, 0.1), (0.01, 0.2), (0.012, 0.3), (0.03, 0.4)):
        vehicle = told(vehicle, Command(speed, 0.0), now, settings)
    states = course(vehicle, 0.1, settings)
    expected = [0.0] * 10 + [0.1] * 2 + [0.2] + [0.3] * 3 + [0.4] * 4
    assert [state.v for state in states] == pytest.approx(expected, abs=1e-9)
    assert len(states[-1].commands) == 1, 'what is over is forgotten'


@pytest.mark.parametrize('lag', [0.05, 0.2])
def test_lags_are_of_first_order(lag: float) -> None:
    for name, command in (('speed_lag', Command(0.2, 0.0)), ('turn_lag', Command(0.0, 2.0))):
        settings = exact(command_delay=0.0, **{name: lag})
        states = course(told(Vehicle(ORIGIN), command, 0.0, settings), 3 * lag, settings)
        for constants in (1, 2, 3):
            state = states[round(constants * lag / DT) - 1]
            share = state.v / 0.2 if command.v else state.omega / 2.0
            assert share == pytest.approx([0.632, 0.865, 0.950][constants - 1], abs=1e-3)


@pytest.mark.parametrize('trim', [0.15, -0.15, 0.0])
@pytest.mark.parametrize('speed', [0.1, 0.3])
def test_trim_is_a_curvature(trim: float, speed: float) -> None:
    settings = exact(command_delay=0.0)
    state = course(told(Vehicle(ORIGIN, trim=trim), Command(speed, 0.0), 0.0, settings), 2.0, settings)[-1]
    assert state.omega / state.v == pytest.approx(trim, abs=1e-9)
    assert state.pose.heading == pytest.approx(trim * speed * 2.0, rel=0.1)


def test_what_stands_does_not_turn() -> None:
    settings = exact(speed_noise=0.5, turn_noise=5.0)
    assert all(state.pose == ORIGIN for state in course(Vehicle(ORIGIN, trim=2.0), 1.0, settings))


def test_without_noise_chance_has_no_say() -> None:
    settings = exact()
    vehicle = told(Vehicle(ORIGIN, trim=0.1), Command(0.2, 0.5), 0.0, settings)
    one, other = (course(vehicle, 1.0, settings, seed=seed) for seed in (1, 2))
    assert one == other
    noisy = exact(speed_noise=0.05, turn_noise=0.08)
    one, again, other = (course(vehicle, 1.0, noisy, seed=seed)[-1] for seed in (1, 1, 2))
    assert one == again and one.pose != other.pose


def test_noise_has_the_strength_and_the_memory_that_is_set() -> None:
    settings = exact(**AT_ONCE, speed_noise=0.05, turn_noise=0.08, noise_time=0.3)
    states = course(told(Vehicle(ORIGIN), Command(0.1, 0.0), 0.0, settings), 400.0, settings, dt=0.02)[1:]
    speed, turn = np.array([state.v for state in states]) / 0.1 - 1, np.array([state.omega for state in states])
    assert (speed.mean(), turn.mean()) == pytest.approx((0, 0), abs=0.008)
    assert speed.std() == pytest.approx(0.05, rel=0.1)
    assert turn.std() == pytest.approx(0.08 * 0.1 / 0.2, rel=0.1), 'it shrinks with the speed'
    for noise in (speed, turn):
        assert np.corrcoef(noise[:-15], noise[15:])[0, 1] == pytest.approx(math.exp(-1), abs=0.1), 'after 0.3 s'


@pytest.mark.parametrize('degrees', [0, 90, 30, -135])
def test_the_body_has_its_four_corners(degrees: float) -> None:
    turn = cmath.exp(1j * math.radians(degrees))
    corners = [1 + 2j + turn * (ahead + 1j * left) for ahead in (0.066, -0.114) for left in (0.075, -0.075)]
    found = list(body(WorldPose(1.0, 2.0, math.radians(degrees)), exact()).exterior.coords)[:-1]
    assert len(found) == 4
    assert all(min(abs(complex(*point) - corner) for point in found) < 1e-12 for corner in corners)


@pytest.mark.parametrize('heading', [0.0, 0.7, math.pi])
@pytest.mark.parametrize(
    'x, y, yaw, away',
    [
        (0.0, 0.105, 0.0, (0, 1)),
        (0.0, -0.105, 0.0, (0, -1)),
        (-0.08, 0.075 + 0.0424264, math.pi / 4, (0, 1)),
        (0.096, 0.0, 0.0, (1, 0)),
        (-0.144, 0.05, 0.0, (-1, 0)),
        (0.066 + 0.0424264, 0.03, math.pi / 4, (1, 0)),
        (0.066 + 0.0212132, 0.075 + 0.0212132, math.pi / 4, (0.7072, 0.7072)),
    ],
    ids=['left', 'right', 'left, its edge', 'bumper', 'tail', 'bumper, its edge', 'corner to side'],
)
def test_touching_and_a_millimetre_apart(x: float, y: float, yaw: float, away: Any, heading: float) -> None:
    # a cone of 80 mm has a base of 60 mm by 60 mm, 42.4 mm from its middle to its edges
    robot = body(WorldPose(1.0, 2.0, heading), exact())
    for gap, touches in ((-1e-5, True), (1e-3, False)):
        at = 1 + 2j + cmath.exp(1j * heading) * complex(x + gap * away[0], y + gap * away[1])
        cone = footprint(Thing('cone', at.real, at.imag, heading + yaw, 0.08))
        assert robot.intersects(cone) is touches
        assert robot.distance(cone) == pytest.approx(max(gap, 0.0), abs=1e-6)
