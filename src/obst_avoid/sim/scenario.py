"""Scenarios: a YAML file says what is there, what happens, and what counts as success.

Any value may be random: `{from: 0.5, to: 0.7}` is a number between, `{any: [duckie, cone]}` one of a list. A file with
random values is a family; a seed makes one scenario of it.
"""

import math
import os
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Optional, Tuple

import numpy as np

from obst_avoid.core.settings import SettingsError, checked, choice, flag, group, integer, load, number, read_yaml, text
from obst_avoid.sim.light import COLORS, Lamp, Light
from obst_avoid.sim.meshes import SORTS
from obst_avoid.sim.things import Thing, footprint
from obst_avoid.sim.town import HEADINGS, TURNS, Route, Town, follow, lane_strip, pose_at, town_from_mapping

MUSTS = ('stop', 'pass', 'drive', 'arrive', 'touch_nothing')
CLUTTER = (
    ('duckiebot', 0.12), ('sign', 0.2), ('wood', 0.07), ('cardboard', 0.1), ('hand', 0.07), ('grass', 0.04),
    ('ball', 0.06),
)  # fmt: skip
"""Sorts and heights [m]."""
ROAD = 50.0
"""[m] of a road that goes on for ever, at least."""
ROAD_END = 0.35
"""[m] before the end of a road that leaves the map, where a drive is over."""


def turns_field() -> Any:
    """A field that holds turns at intersections."""
    return checked(lambda value, where: _turns(value, where))


@dataclass(frozen=True)
class StartSettings:
    """Where the robot starts. column, row: of a tile, from the south-west. along: [m] from the tile's entry."""

    column: int = integer(at_least=0)
    row: int = integer(at_least=0)
    heading: str = choice(*HEADINGS)
    along: float = number('m', at_least=0)
    d: float = number('m', above=-0.5, below=0.5)
    phi: float = number('rad', above=-1.6, below=1.6)


@dataclass(frozen=True)
class ObstacleSettings:
    """One thing on or beside the road.

    along: [m] ahead of the start, along the route. left: [m] of the lane's centre. appears_within, crosses_within: [m]
    from its place to the robot's axle, along the route; 0: it is there from the start, it stays. to_left: [m] where it
    crosses to, at crossing_speed. leaves_after_stop: [s] that the robot stood; 0: never.
    appears_at, leaves_at: [s] since the start; 0: at once, never.
    """

    sort: str = choice(*SORTS)
    height: float = number('m', at_least=0.02, at_most=0.4)
    along: float = number('m', at_least=0)
    left: float = number('m', above=-3, below=3)
    yaw: float = number('rad')
    lying: bool = flag()
    appears_within: float = number('m', at_least=0)
    appears_at: float = number('s', at_least=0)
    crosses_within: float = number('m', at_least=0)
    to_left: float = number('m', above=-3, below=3)
    crossing_speed: float = number('m/s', at_least=0)
    leaves_after_stop: float = number('s', at_least=0)
    leaves_at: float = number('s', at_least=0)


_PLAIN_LIGHT = {'azimuth': None, 'elevation': None}
_PLAIN_OBSTACLE = {
    'yaw': 0.0, 'lying': False, 'appears_within': 0.0, 'crosses_within': 0.0, 'to_left': 0.0, 'crossing_speed': 0.0,
    'leaves_after_stop': 0.0, 'appears_at': 0.0, 'leaves_at': 0.0,
}  # fmt: skip


@dataclass(frozen=True)
class LightSettings:
    """What Light is made of. color: of the lamps. strength: 1 is a bright room. lamps: how many, up to 3.

    azimuth, elevation: [rad] where the first lamp stands in the world; None: anywhere. The others: see Light.
    """

    color: str = choice(*COLORS)
    strength: float = number('ratio', above=0)
    lamps: int = checked(lambda value, where: _lamps(value, where))
    glare: float = number('ratio', at_least=0, at_most=1)
    unevenness: float = number('ratio', at_least=0, at_most=0.5)
    headlight: float = number('ratio', at_least=0)
    azimuth: Optional[float] = checked(lambda value, where: _optional(value, where, 7.0))
    elevation: Optional[float] = checked(lambda value, where: _optional(value, where, 1.57))


@dataclass(frozen=True)
class SuccessSettings:
    """must: stop (before the obstacle, and stay), pass (the obstacle, inside the lane), drive (without a stop),
    arrive (stops are allowed), touch_nothing. goal: [m] along the route from the start at which the drive is over.
    smallest_gap, largest_gap: [m] between bumper and obstacle after a stop.
    """

    must: str = choice(*MUSTS)
    goal: float = number('m', above=0)
    smallest_gap: float = number('m', at_least=0)
    largest_gap: float = number('m', above=0)


@dataclass(frozen=True)
class ScenarioSettings:
    """The content of a scenario file, random values drawn. seed: of the first episode that is measured."""

    about: str = text()
    seed: int = integer(at_least=0)
    map: str = text()
    start: StartSettings = group(StartSettings)
    turns: Tuple[str, ...] = turns_field()
    obstacles: Tuple[ObstacleSettings, ...] = checked(lambda value, where: _obstacles(value, where))
    clutter: int = integer(at_least=0)
    light: LightSettings = checked(lambda value, where: _light(value, where))
    pose_errors: str = text()
    turn_said: bool = flag()
    duration: float = number('s', above=0)
    success: SuccessSettings = group(SuccessSettings)


@dataclass(frozen=True)
class Scenario:
    """Everything that an episode needs to know of its world. seed: of all that is random in it."""

    name: str
    settings: ScenarioSettings
    town: Town
    route: Route
    start: float
    obstacles: Tuple[ObstacleSettings, ...]
    clutter: Tuple[Thing, ...]
    light: Light
    seed: int


def load_scenario(path: str, seed: int, towns: str, instead: Optional[Mapping[str, Any]] = None) -> Scenario:
    """One scenario of a file.

    towns: folder of maps; a map that ends in .yaml is a file beside the scenario. instead: values that replace the
    file's, by name, 'light/color' for one within another.

    Raises SettingsError, also for a map or a route that cannot be.
    """
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise SettingsError('%s is not a mapping, expected a scenario' % path)
    content = _replaced(content, instead)
    random = np.random.RandomState(seed)
    settings = load(ScenarioSettings, _drawn(content, random, path), path)
    beside = os.path.join(os.path.dirname(os.path.abspath(path)), settings.map)
    town_path = beside if settings.map.endswith('.yaml') else os.path.join(towns, settings.map + '.yaml')
    town = town_from_mapping(read_yaml(town_path), town_path)
    start = settings.start
    length = max(ROAD, start.along + settings.success.goal + 1.0)
    route = follow(town, start.column, start.row, start.heading, settings.turns, length)
    _check_room(settings, route, path)
    name = os.path.splitext(os.path.basename(path))[0]
    return Scenario(
        name, settings, town, route, start.along, settings.obstacles,
        tuple(_clutter(settings, route, random)), make_light(settings.light, random), seed,
    )  # fmt: skip


def _check_room(settings: ScenarioSettings, route: Route, where: str) -> None:
    """Everything lies on the road. Raises SettingsError."""
    start, room = settings.start.along, route.length - ROAD_END
    wanted = [('start/along', 0.0), ('success/goal', settings.success.goal)]
    wanted += [('obstacles/%d/along' % index, item.along) for index, item in enumerate(settings.obstacles)]
    for name, along in wanted:
        if start + along > room:
            raise SettingsError(
                '%s/%s lies %.2f m along the road, expected less than %.2f m' % (where, name, start + along, room)
            )


def place(obstacle: ObstacleSettings, scenario: Scenario, left: float) -> Thing:
    """The obstacle as a thing of the world, `left` m left of the lane's centre."""
    pose = pose_at(scenario.route, scenario.start + obstacle.along, left)
    return Thing(obstacle.sort, pose.x, pose.y, pose.heading + obstacle.yaw, obstacle.height, obstacle.lying)


def make_light(settings: LightSettings, random: 'np.random.RandomState') -> Light:
    """Lamps in random places, the first one the strongest; the more glare, the lower they may hang."""
    lamps: List[Lamp] = []
    for index in range(settings.lamps):
        share = 0.42 / 2**index * random.uniform(0.7, 1.2)
        elevation = random.uniform(1.2 - 0.9 * settings.glare, 1.4)
        azimuth, size = random.uniform(-math.pi, math.pi), random.uniform(0.05, 0.3)
        if index == 0:
            azimuth = azimuth if settings.azimuth is None else settings.azimuth
            elevation = elevation if settings.elevation is None else settings.elevation
        lamps.append(Lamp(azimuth, elevation, share, size))
    return Light(
        COLORS[settings.color], settings.strength, tuple(lamps), settings.glare, settings.unevenness,
        settings.headlight, int(random.randint(1 << 30)),
    )  # fmt: skip


def _clutter(settings: ScenarioSettings, route: Route, random: 'np.random.RandomState') -> List[Thing]:
    """Things beside the road, none of them on our lane."""
    things: List[Thing] = []
    lane = lane_strip(route, 0.0, min(route.length, settings.start.along + settings.success.goal + 3.0)).buffer(0.1)
    for _ in range(20 * settings.clutter):
        if len(things) == settings.clutter:
            break
        sort, height = CLUTTER[random.randint(len(CLUTTER))]
        along = random.uniform(0.3, min(settings.success.goal + 2.0, route.length - settings.start.along - 0.1))
        left = random.choice([random.uniform(-1.2, -0.25), random.uniform(0.5, 1.4)])
        pose = pose_at(route, settings.start.along + along, left)
        thing = Thing(sort, pose.x, pose.y, random.uniform(-math.pi, math.pi), height * random.uniform(0.8, 1.2))
        if not footprint(thing).intersects(lane):
            things.append(thing)
    return things


def _replaced(content: Dict[Any, Any], instead: Optional[Mapping[str, Any]]) -> Dict[Any, Any]:
    for name, value in (instead or {}).items():
        first, _, rest = name.partition('/')
        inner = content.get(first)
        content = {**content, first: _replaced(inner, {rest: value}) if rest and isinstance(inner, dict) else value}
    return content


def _drawn(content: Any, random: 'np.random.RandomState', where: str) -> Any:
    """The content with random values drawn, in the order of the file."""
    if isinstance(content, dict):
        if set(content) == {'from', 'to'}:
            low, high = content['from'], content['to']
            if not all(type(value) in (int, float) and math.isfinite(value) for value in (low, high)) or low > high:
                raise SettingsError('%s = %r, expected two numbers, from <= to' % (where, content))
            return float(random.uniform(low, high))
        if set(content) == {'any'}:
            if not isinstance(content['any'], list) or not content['any']:
                raise SettingsError('%s = %r, expected a list to choose from' % (where, content))
            return _drawn(content['any'][random.randint(len(content['any']))], random, where)
        drawn: Dict[Any, Any] = {
            name: _drawn(value, random, '%s/%s' % (where, name)) for name, value in content.items()
        }
        return drawn
    if isinstance(content, list):
        return [_drawn(value, random, '%s/%d' % (where, index)) for index, value in enumerate(content)]
    return content


def _optional(value: Any, where: str, largest: float) -> Optional[float]:
    usable = value is None or (
        isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= largest
    )
    if not usable:
        raise SettingsError('%s = %r, expected a number up to %g (rad), or nothing' % (where, value, largest))
    return None if value is None else float(value)


def _lamps(value: Any, where: str) -> int:
    if type(value) is not int or not 1 <= value <= 3:
        raise SettingsError('%s = %r, expected 1, 2 or 3' % (where, value))
    return value


def _light(value: Any, where: str) -> LightSettings:
    if not isinstance(value, dict):
        raise SettingsError('%s = %r, expected a mapping of settings' % (where, value))
    return load(LightSettings, {**_PLAIN_LIGHT, **value}, where)


def _turns(value: Any, where: str) -> Tuple[str, ...]:
    if not isinstance(value, list) or any(turn not in TURNS for turn in value):
        raise SettingsError('%s = %r, expected a list of: %s' % (where, value, ', '.join(TURNS)))
    return tuple(value)


def _obstacles(value: Any, where: str) -> Tuple[ObstacleSettings, ...]:
    if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        raise SettingsError('%s = %r, expected a list of obstacles' % (where, value))
    return tuple(
        load(ObstacleSettings, {**_PLAIN_OBSTACLE, **item}, '%s/%d' % (where, index))
        for index, item in enumerate(value)
    )
