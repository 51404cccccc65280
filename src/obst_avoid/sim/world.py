"""The simulated world between two instants: the robot moves, things come, cross and go, the camera takes pictures.

`Place` is what stays as it is during a drive, `World` what changes. Time is in s since the beginning.
"""

import functools
import math
from dataclasses import dataclass, replace
from typing import List, Optional, Tuple

import numpy as np

from obst_avoid.core.age import NANOSECONDS
from obst_avoid.core.picture import encode_jpeg
from obst_avoid.core.settings import SettingsError
from obst_avoid.core.types import Array, Command, LanePose, Obstacle
from obst_avoid.sim.pose_errors import PoseErrors, measured
from obst_avoid.sim.renderer import Renderer, Scene
from obst_avoid.sim.scenario import Scenario, place
from obst_avoid.sim.sensor import SensorState, adapted, developed, mean_signal, settled, signal_factors
from obst_avoid.sim.settings import SimulationSettings
from obst_avoid.sim.things import Thing, footprint
from obst_avoid.sim.town import locate, pose_at, turn_ahead
from obst_avoid.sim.truth import obstacles_of
from obst_avoid.sim.vehicle import STILL, Vehicle, body, driven, moved, told

BEGIN = 1000
"""[s] of simulated ROS time at the start of a drive."""
STEP = 0.005
"""[s] of one step of the world; contact is looked for in each."""
GROUND_SEEDS = 4
"""Different textures of a town; drawing one takes a second."""
TURN_SAID = 1.0
"""[m] before an intersection from where on the stack says which way the robot will take."""
NEARBY = 0.6
"""[m] from the axle within which contact is possible at once."""


@dataclass(frozen=True)
class Place:
    """What stays during a drive. random: the one source of chance, in the order of use."""

    scenario: Scenario
    settings: SimulationSettings
    pose_errors: PoseErrors
    random: 'np.random.RandomState'


@dataclass(frozen=True)
class Actor:
    """What an obstacle is doing. here: it is there. left: [m] of the lane's centre."""

    here: bool
    left: float
    crossing: bool = False
    gone: bool = False


@dataclass(frozen=True)
class Contact:
    """The robot touched an obstacle. time: [s]. x, y: [m] of the axle, world frame. thing: what it touched."""

    time: float
    x: float
    y: float
    thing: Thing


@dataclass(frozen=True)
class World:
    """What changes. time: [s]. along: [m] on the route. stood: [s] since the robot last moved, 0 before it ever did.

    lane_pose: the truth. wander: see pose_errors.measured.
    """

    time: float
    vehicle: Vehicle
    along: float
    lane_pose: LanePose
    actors: Tuple[Actor, ...]
    sensor: SensorState
    wander: float = 0.0
    pictures: int = 0
    stood: float = 0.0
    drove: bool = False
    contact: Optional[Contact] = None


def begin(scenario: Scenario, settings: SimulationSettings) -> Tuple[Place, World]:
    """The world before its first step. Raises SettingsError when the scenario names unknown pose errors."""
    name = scenario.settings.pose_errors
    if name not in settings.pose_errors:
        raise SettingsError('pose_errors = %r, expected one of: %s' % (name, ', '.join(settings.pose_errors)))
    random = np.random.RandomState(scenario.seed + 1)
    start = scenario.settings.start
    pose = pose_at(scenario.route, scenario.start, start.d, start.phi)
    along, lane_pose = locate(scenario.route, pose, scenario.start)
    actors = tuple(Actor(item.appears_within == item.appears_at == 0, item.left) for item in scenario.obstacles)
    trim = settings.vehicle.trim * random.uniform(-1, 1)
    world = World(0.0, Vehicle(pose, trim=trim), along, lane_pose, actors, SensorState(0.01, 1.0))
    return Place(scenario, settings, settings.pose_errors[name], random), world


def command(world: World, place_: Place, wheels: Command) -> World:
    """The world after the robot has heard a command."""
    return replace(world, vehicle=told(world.vehicle, wheels, world.time, place_.settings.vehicle))


def step(world: World, place_: Place) -> World:
    """The world one STEP later. The first contact is kept."""
    settings = place_.settings.vehicle
    vehicle = moved(world.vehicle, world.time, STEP, settings, place_.random)
    along, lane_pose = locate(place_.scenario.route, vehicle.pose, world.along)
    still = abs(vehicle.v) < STILL
    drove = world.drove or not still
    stood = world.stood + STEP if still and drove else 0.0
    actors = tuple(
        _acted(actor, index, along, stood, world.time + STEP, place_) for index, actor in enumerate(world.actors)
    )
    world = replace(
        world, time=world.time + STEP, vehicle=vehicle, along=along, lane_pose=lane_pose, actors=actors, stood=stood,
        drove=drove,
    )  # fmt: skip
    return world if world.contact else replace(world, contact=_contact(world, place_))


def stamp(time: float) -> int:
    """[ns] of simulated ROS time, which does not begin at 0: that would mean that no time is known."""
    return BEGIN * NANOSECONDS + int(round(time * NANOSECONDS))


def obstacles(world: World, place_: Place) -> List[Thing]:
    """The obstacles that are there now."""
    scenario = place_.scenario
    pairs = zip(scenario.obstacles, world.actors)
    return [place(item, scenario, actor.left) for item, actor in pairs if actor.here]


def truth(world: World, place_: Place) -> List[Obstacle]:
    """The same as a perfect detector would report them."""
    return [obstacle for here, obstacle in everything(world, place_) if here]


def everything(world: World, place_: Place) -> List[Tuple[bool, Obstacle]]:
    """All obstacles of the scenario, and whether each stands there now."""
    scenario = place_.scenario
    return [
        (actor.here, obstacle)
        for item, actor in zip(scenario.obstacles, world.actors)
        for obstacle in obstacles_of(
            [place(item, scenario, actor.left)], scenario.town, scenario.route, world.along, world.vehicle.pose
        )
    ]


def gap(world: World, place_: Place) -> float:
    """[m] between the robot's body and the nearest obstacle; inf without one."""
    robot = body(world.vehicle.pose, place_.settings.vehicle)
    return min((robot.distance(footprint(thing)) for thing in obstacles(world, place_)), default=math.inf)


def lane_pose(world: World, place_: Place) -> Tuple[LanePose, World]:
    """What the lane filter says of this instant; it arrives pose_errors.delay later."""
    pose, wander = measured(world.lane_pose, world.wander, place_.pose_errors, place_.random)
    return pose, replace(world, wander=wander)


def turn(world: World, place_: Place) -> Optional[str]:
    """What a stack that knows its way says of the next intersection, a key of town.TURNS; None: there is none near, or
    nobody says.
    """
    if not place_.scenario.settings.turn_said:
        return None
    return turn_ahead(place_.scenario.route, world.along, TURN_SAID)


def picture(world: World, place_: Place, renderer: Renderer) -> Tuple[Array, World]:
    """The picture whose exposure ends now: (H, W, 3) uint8 BGR."""
    scene = scene_of(world, place_)
    if not world.pictures:
        pose = world.vehicle.pose
        look = functools.partial(renderer.render, scene, [pose])
        world = replace(world, sensor=settled(look, place_.settings.sensor))
    sensor, settings = world.sensor, place_.settings.sensor
    vehicle = world.vehicle
    path = [driven(vehicle.pose, vehicle.v, vehicle.omega, -sensor.exposure), vehicle.pose]
    encoded = renderer.render(scene, path, signal_factors(sensor, settings))
    after = adapted(sensor, mean_signal(encoded), 1 / place_.settings.picture_rate, settings)
    shown = developed(encoded, sensor, place_.scenario.seed + world.pictures)
    return shown, replace(world, sensor=after, pictures=world.pictures + 1)


def jpeg(shown: Array, place_: Place) -> bytes:
    """As the camera sends it."""
    return encode_jpeg(shown, place_.settings.jpeg_quality)


def scene_of(world: World, place_: Place) -> Scene:
    """What the camera can see now."""
    scenario = place_.scenario
    things = tuple(obstacles(world, place_)) + scenario.clutter
    return Scene(scenario.town, things, scenario.light, seed=scenario.seed % GROUND_SEEDS)


def _acted(actor: Actor, index: int, along: float, stood: float, now: float, place_: Place) -> Actor:
    item = place_.scenario.obstacles[index]
    distance = place_.scenario.start + item.along - along
    here, crossing, left = actor.here, actor.crossing, actor.left
    near = 0 < item.appears_within and distance <= item.appears_within
    if near or 0 < item.appears_at <= now:
        here = True
    waited = 0 < item.leaves_after_stop <= stood
    gone = actor.gone or (here and (waited or 0 < item.leaves_at <= now))
    if item.crosses_within and distance <= item.crosses_within:
        crossing = True
    if crossing:
        way = item.to_left - left
        left += math.copysign(min(abs(way), item.crossing_speed * STEP), way)
    return Actor(here and not gone, left, crossing, gone)


def _contact(world: World, place_: Place) -> Optional[Contact]:
    pose = world.vehicle.pose
    near = [thing for thing in obstacles(world, place_) if math.hypot(thing.x - pose.x, thing.y - pose.y) < NEARBY]
    if not near:
        return None
    robot = body(pose, place_.settings.vehicle)
    touched = next((thing for thing in near if robot.intersects(footprint(thing))), None)
    return None if touched is None else Contact(world.time, pose.x, pose.y, touched)
