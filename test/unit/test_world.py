"""sim.world: things come, cross and go as told, no contact is missed, and pictures are taken as a camera takes them."""

import math
from pathlib import Path
from typing import Any, Callable, Iterator, List, Optional, Tuple

import numpy as np
import pytest

from obst_avoid.core.types import Command, Kind, LanePose
from obst_avoid.sim import world as worlds
from obst_avoid.sim.renderer import Renderer
from obst_avoid.sim.world import STEP, Place, World
from unit.cameras import Camera, calibration_of
from unit.drives import LANE, LIGHT, START, mapping, quiet, scenario_of, simulation, thing

GO, HALT = Command(0.2, 0.0), Command(0.0, 0.0)
BEGIN = 0.3
"""[m] east of the world's origin where the robot's axle is at first."""

Watch = Callable[[World], None]


@pytest.fixture
def begun(tmp_path: Path) -> Callable[..., Tuple[Place, World]]:
    """Makes a world with the given obstacles and a robot without errors."""

    def make(*obstacles: Any, seed: int = 1, settings: Any = None, **changes: Any) -> Tuple[Place, World]:
        return worlds.begin(scenario_of(tmp_path, mapping(*obstacles, **changes), seed), settings or quiet())

    return make


def course(world: World, place: Place, seconds: float, command: Optional[Command] = None) -> List[World]:
    """The world after each step; the command is given once, at the beginning."""
    world = world if command is None else worlds.command(world, place, command)
    found = []
    for _ in range(round(seconds / STEP)):
        world = worlds.step(world, place)
        found.append(world)
    return found


def driven(time: float) -> float:
    """[m] after so many seconds of GO: 0.05 s of delay, then the speed nears 0.2 m/s with 0.08 s."""
    since = max(time - 0.05, 0.0)
    return 0.2 * (since - 0.08 * (1 - math.exp(-since / 0.08)))


def test_the_beginning(begun: Any) -> None:
    place, world = begun(start={**START, 'd': 0.02, 'phi': -0.1})
    assert (world.time, world.along) == (0.0, pytest.approx(BEGIN))
    assert (world.pictures, world.stood, world.drove, world.contact) == (0, 0.0, False, None)
    pose = world.vehicle.pose
    assert (pose.x, pose.y, pose.heading) == pytest.approx((BEGIN, LANE + 0.02, -0.1))
    assert (world.lane_pose.d, world.lane_pose.phi) == pytest.approx((0.02, -0.1))
    assert worlds.gap(world, place) == math.inf and worlds.truth(world, place) == []


def test_it_drives_as_far_as_it_must(begun: Any) -> None:
    place, world = begun()
    states = course(world, place, 3.0, GO)
    assert states[-1].time == pytest.approx(3.0)
    for state in states[::50]:
        assert state.along - BEGIN == pytest.approx(driven(state.time), abs=1e-3)
        assert state.vehicle.pose.x == pytest.approx(state.along)


def test_a_thing_appears_within_its_distance(begun: Any) -> None:
    place, world = begun(thing(1.0, appears_within=0.6), thing(2.0))
    assert [item.x for item in worlds.obstacles(world, place)] == [pytest.approx(2.3)]
    states = course(world, place, 3.0, GO)
    for state in states:
        assert len(worlds.obstacles(state, place)) == (2 if state.along - BEGIN >= 0.4 else 1)
    assert len(worlds.obstacles(states[-1], place)) == 2
    assert worlds.obstacles(states[-1], place)[0].x == pytest.approx(1.3)


@pytest.mark.parametrize('left, to_left', [(-0.3, 0.2), (0.25, -0.15)], ids=['to the left', 'to the right'])
def test_a_thing_crosses_at_its_speed(begun: Any, left: float, to_left: float) -> None:
    place, world = begun(thing(1.0, left, crosses_within=0.7, to_left=to_left, crossing_speed=0.1))
    states = course(world, place, 8.0, GO)
    begins = next(state.time for state in states if state.along - BEGIN >= 0.3)
    way = abs(to_left - left)
    for state in states:
        (item,) = worlds.obstacles(state, place)
        crossed = min(max(0.1 * (state.time - begins), 0.0), way)
        assert item.y - LANE == pytest.approx(left + math.copysign(crossed, to_left - left), abs=6e-4)
        assert item.x == pytest.approx(1.3)
    assert states[-1].actors[0].left == pytest.approx(to_left)


@pytest.mark.parametrize('appears_within', [0.0, 1.0])
def test_a_thing_leaves_after_the_robot_stood_and_stays_away(begun: Any, appears_within: float) -> None:
    place, world = begun(thing(1.5, leaves_after_stop=0.5, appears_within=appears_within), thing(2.0))
    before = course(world, place, 1.0)
    driving = course(before[-1], place, 4.0, GO)
    assert len(worlds.obstacles(before[-1], place)) == (1 if appears_within else 2), 'it never drove'
    assert len(worlds.obstacles(driving[-1], place)) == 2
    standing = course(driving[-1], place, 2.0, HALT)
    for state in standing:
        assert len(worlds.obstacles(state, place)) == (1 if state.stood >= 0.5 else 2)
    assert [item.x for item in worlds.obstacles(standing[-1], place)] == [pytest.approx(2.3)]
    assert all(len(worlds.obstacles(state, place)) == 1 for state in course(standing[-1], place, 2.0, GO))


def test_standing_and_driving(begun: Any) -> None:
    place, world = begun()
    world = course(world, place, 0.5)[-1]
    assert (world.drove, world.stood) == (False, 0.0), 'not before it ever moved'
    world = course(world, place, 1.0, GO)[-1]
    assert (world.drove, world.stood) == (True, 0.0)
    world = course(world, place, 1.0, HALT)[-1]
    # 0.05 s of delay, then 0.08 s * ln 40 until it is slower than 5 mm/s
    assert (world.drove, world.stood) == (True, pytest.approx(1.0 - 0.05 - 0.08 * math.log(40), abs=2 * STEP))
    world = course(world, place, 1.0, GO)[-1]
    assert (world.drove, world.stood) == (True, 0.0)


def test_driving_into_a_ball(begun: Any) -> None:
    place, world = begun(thing(0.5, sort='ball', height=0.06))
    states = course(world, place, 2.5, GO)
    touched = [state.contact for state in states if state.contact is not None]
    # the bumper is 66 mm ahead, the ball 30 mm thick
    way = 0.5 - 0.066 - 0.03
    assert touched[0].time == pytest.approx(0.05 + 0.08 + way / 0.2, abs=0.01)
    assert (touched[0].x, touched[0].y) == pytest.approx((BEGIN + way, LANE), abs=2e-3)
    assert (touched[0].thing.sort, touched[0].thing.x) == ('ball', pytest.approx(0.8))
    assert len(touched) > 50 and all(contact is touched[0] for contact in touched), 'the first one is kept'
    last_free = [state for state in states if state.contact is None][-1]
    assert 0 < worlds.gap(last_free, place) <= 0.2 * STEP + 1e-6, 'found in the very step'


def test_a_ball_rolls_into_a_standing_robot(begun: Any) -> None:
    ball = thing(0.0, -0.3, sort='ball', height=0.06, crosses_within=1.0, to_left=0.5, crossing_speed=0.1)
    place, world = begun(ball)
    contact = course(world, place, 2.5)[-1].contact
    # to the side of the robot, 75 mm from its middle, and 30 mm of ball
    assert contact is not None and contact.time == pytest.approx((0.3 - 0.075 - 0.03) / 0.1, abs=0.01)
    assert contact.thing.y == pytest.approx(LANE - 0.105, abs=1e-3)


@pytest.mark.parametrize('left, hit', [(0.104, True), (0.106, False), (-0.104, True), (-0.106, False)])
def test_contact_is_a_matter_of_millimetres(begun: Any, left: float, hit: bool) -> None:
    # half a robot and half a cone are 105 mm
    place, world = begun(thing(0.4, left))
    last = course(world, place, 0.9, Command(1.0, 0.0))[-1]
    assert last.along > BEGIN + 0.6
    assert (last.contact is not None) is hit


@pytest.mark.parametrize(
    'things, expected',
    [
        ([], math.inf),
        ([thing(0.5)], 0.5 - 0.066 - 0.03),
        ([thing(0.0, -0.3)], 0.3 - 0.075 - 0.03),
        ([thing(0.5), thing(0.0, -0.3)], 0.195),
        ([thing(0.136, 0.145)], math.hypot(0.04, 0.04)),
        ([thing(0.5), thing(0.2, appears_within=0.1)], 0.404),
    ],
    ids=['nothing', 'ahead', 'beside', 'the nearer', 'ahead and beside', 'not there yet'],
)
def test_the_gap_is_measured_from_the_body(begun: Any, things: Any, expected: float) -> None:
    place, world = begun(*things)
    assert worlds.gap(world, place) == pytest.approx(expected, abs=1e-6)


def test_the_truth_is_in_the_robot_frame(begun: Any) -> None:
    place, world = begun(thing(0.5), thing(0.8, -0.3, sort='duckie', height=0.05), thing(0.6, sort='ball'))
    cone, duckie = worlds.truth(world, place)
    assert (cone.kind, cone.in_lane, duckie.kind, duckie.in_lane) == (Kind.CONE, True, Kind.DUCKIE, False)
    assert (cone.x, cone.y, cone.radius) == pytest.approx((0.47, 0.0, 0.03))


def test_the_lane_filter(begun: Any) -> None:
    place, world = begun(start={**START, 'd': 0.023, 'phi': 0.07})
    assert worlds.lane_pose(world, place)[0] == world.lane_pose == LanePose(pytest.approx(0.023), pytest.approx(0.07))
    place, world = begun(pose_errors='real', start={**START, 'd': 0.023, 'phi': 0.07})
    pose, after = worlds.lane_pose(world, place)
    assert after.wander != 0 and after.lane_pose == world.lane_pose
    assert pose.d / 0.02 == pytest.approx(round(pose.d / 0.02))


def test_a_seed_says_it_all(begun: Any) -> None:
    def last(seed: int) -> World:
        place, world = begun(seed=seed, settings=simulation(), pose_errors='real')
        world = worlds.lane_pose(course(world, place, 0.5, GO)[-1], place)[1]
        return course(world, place, 0.5)[-1]

    one, again, other = last(1), last(1), last(2)
    assert one == again
    assert one.vehicle.pose != other.vehicle.pose and one.vehicle.trim != other.vehicle.trim
    assert 0 < abs(one.vehicle.trim) <= 0.15


@pytest.fixture(scope='module')
def renderer() -> Iterator[Renderer]:
    """Of a small camera."""
    one = Renderer(calibration_of(Camera().resized(320, 240)))
    yield one
    one.close()


def test_the_first_picture_is_of_a_settled_camera(begun: Any, renderer: Renderer) -> None:
    place, world = begun(thing(0.5), light={**LIGHT, 'strength': 0.3, 'color': 'warm'})
    first, world = worlds.picture(world, place, renderer)
    settled = world.sensor
    second, world = worlds.picture(world, place, renderer)
    assert world.pictures == 2 and first.shape == (240, 320, 3) and first.dtype == np.uint8
    assert not 0.009 < settled.exposure * settled.gain < 0.011, 'this light asks for another one than the first guess'
    assert world.sensor.exposure * world.sensor.gain == pytest.approx(settled.exposure * settled.gain, rel=0.01)
    assert world.sensor.balance == pytest.approx(settled.balance, rel=0.01)
    assert np.abs(first.astype(float) - second).mean() < 8
    assert (first != second).any(), 'each has its own noise'


def test_pictures_are_the_same_for_a_seed(begun: Any, renderer: Renderer) -> None:
    pictures = []
    for seed in (1, 1, 2):
        place, world = begun(thing(0.5), seed=seed, clutter=2)
        pictures.append(worlds.jpeg(worlds.picture(world, place, renderer)[0], place))
    assert pictures[0] == pictures[1] and pictures[0] != pictures[2]


class Eyes:
    """Stands in for a renderer and remembers what it was asked for."""

    def __init__(self) -> None:
        self.asked: List[Any] = []

    def render(self, *call: Any) -> Any:
        self.asked.append(call)
        return np.full((8, 8, 3), 100, dtype=np.uint8)


def test_a_picture_shows_the_way_of_its_exposure(begun: Any) -> None:
    place, world = begun(thing(1.0), thing(1.0, appears_within=0.1), clutter=3)
    world, eyes = course(world, place, 1.0, GO)[-1], Eyes()
    shown, after = worlds.picture(world, place, eyes)
    assert shown.shape == (8, 8, 3) and after.pictures == 1
    scene, (opened, closed), _ = eyes.asked[-1]
    assert closed == world.vehicle.pose
    exposed = [call for call in eyes.asked[:-1] if len(call[1]) == 1]
    assert len(exposed) == len(eyes.asked) - 1, 'the camera settles while the robot stands'
    world = after
    _, after = worlds.picture(world, place, eyes)
    scene, (opened, closed), _ = eyes.asked[-1]
    assert closed.x - opened.x == pytest.approx(0.2 * world.sensor.exposure, rel=0.01)
    assert [item.sort for item in scene.things[:1]] == ['cone'] and len(scene.things) == 4
