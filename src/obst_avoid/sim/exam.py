"""Random single pictures with their truth: what a detector is measured on."""

import functools
import math
from dataclasses import dataclass, replace
from typing import Any, Dict, List, Sequence, Tuple

import numpy as np

from obst_avoid.core.settings import SettingsError, checked, choice, integer, load, number, text
from obst_avoid.core.types import Array
from obst_avoid.sim.backdrop import RGB, Surfaces
from obst_avoid.sim.light import COLORS
from obst_avoid.sim.meshes import SORTS
from obst_avoid.sim.renderer import Renderer, Scene
from obst_avoid.sim.scenario import CLUTTER, LightSettings, make_light, turns_field
from obst_avoid.sim.sensor import SensorSettings, SensorState, developed, settled, signal_factors
from obst_avoid.sim.things import Thing, footprint
from obst_avoid.sim.town import HEADINGS, Route, Town, WorldPose, follow, lane_strip, pose_at
from obst_avoid.sim.truth import Truth, truth_of

ROAD = 12.0
"""[m] of the lane that is followed."""


@dataclass(frozen=True)
class Span:
    """A range of values, both ends included."""

    low: float
    high: float

    def draw(self, random: 'np.random.RandomState') -> float:
        """Evenly."""
        return float(random.uniform(self.low, self.high))

    def draw_count(self, random: 'np.random.RandomState') -> int:
        """A whole number, evenly."""
        return int(random.randint(int(self.low), int(self.high) + 1))


def span(low: float, high: float) -> Any:
    """A field that holds a range, {from: number, to: number} in YAML, within the given limits."""
    return checked(lambda value, where: _span(value, where, low, high))


def names_of(known: Sequence[str]) -> Any:
    """A field that holds a list of known names."""
    return checked(lambda value, where: _names(value, where, known))


@dataclass(frozen=True)
class LayoutSettings:
    """A piece of road, see scenario.StartSettings."""

    map: str = text()
    column: int = integer(at_least=0)
    row: int = integer(at_least=0)
    heading: str = choice(*HEADINGS)
    turns: Tuple[str, ...] = turns_field()
    along: Span = span(0, 50)


@dataclass(frozen=True)
class ExamSettings:
    """config/exam.yaml has values, units and reasons."""

    layouts: Dict[str, LayoutSettings] = checked(lambda value, where: _layouts(value, where))
    colors: Tuple[str, ...] = names_of(tuple(COLORS))
    strength: Span = span(1e-4, 100)
    lamps: Span = span(1, 3)
    glare: Span = span(0, 1)
    unevenness: Span = span(0, 0.5)
    headlight: Span = span(0, 10)
    headlit: float = number('share', at_least=0, at_most=1)
    pink: Span = span(0, 1)
    exposure_error: Span = span(-6, 6)
    blur: Span = span(0, 60)
    sharp: float = number('share', at_least=0, at_most=1)
    obstacles: Span = span(0, 20)
    sorts: Tuple[str, ...] = names_of(SORTS)
    height: Span = span(0.01, 0.4)
    distance: Span = span(0, 5)
    left: Span = span(-3, 3)
    lying: float = number('share', at_least=0, at_most=1)
    clutter: Span = span(0, 30)
    d: Span = span(-0.3, 0.3)
    phi: Span = span(-1.5, 1.5)
    tint: float = number('ratio', at_least=0, at_most=1)


@dataclass(frozen=True, eq=False)
class Question:
    """One picture, its truth, and how it was made. picture: (H, W, 3) uint8 BGR. blur: [px]. things: by index of
    truth.obstacles.
    """

    picture: Array
    truth: Truth
    layout: str
    color: str
    strength: float
    blur: float
    glare: float
    things: Tuple[Thing, ...]
    sensor: SensorState
    exposure_error: float


def ask(
    index: int,
    seed: int,
    settings: ExamSettings,
    sensor: SensorSettings,
    towns: Dict[str, Town],
    renderer: Renderer,
) -> Question:
    """The index-th picture of an exam; the same for the same arguments. towns: by the maps' names."""
    random = np.random.RandomState((seed * 1_000_003 + index) % (1 << 32))
    names = list(settings.layouts)
    name = names[index % len(names)]
    color = settings.colors[(index // len(names)) % len(settings.colors)]
    strength = math.exp(random.uniform(math.log(settings.strength.low), math.log(settings.strength.high)))
    blur = 0.0 if random.uniform() < settings.sharp else settings.blur.draw(random)
    return _question(name, color, strength, blur, settings, sensor, towns, renderer, random)


def sheet_question(
    name: str,
    color: str,
    blur: float,
    settings: ExamSettings,
    sensor: SensorSettings,
    towns: Dict[str, Town],
    renderer: Renderer,
) -> Question:
    """A picture of a set layout, light and blur; everything else as one seed has it, for comparing with the eye."""
    few = replace(settings, obstacles=Span(4, 4), distance=Span(0.3, 1.0), left=Span(-0.2, 0.25), headlit=0.0)
    return _question(name, color, 0.6, blur, few, sensor, towns, renderer, np.random.RandomState(5))


def _question(
    name: str,
    color: str,
    strength: float,
    blur: float,
    settings: ExamSettings,
    sensor: SensorSettings,
    towns: Dict[str, Town],
    renderer: Renderer,
    random: 'np.random.RandomState',
) -> Question:
    layout = settings.layouts[name]
    route = follow(towns[layout.map], layout.column, layout.row, layout.heading, layout.turns, ROAD)
    along = layout.along.draw(random)
    pose = pose_at(route, along, settings.d.draw(random), settings.phi.draw(random))
    glare = settings.glare.draw(random)
    own = settings.headlight.draw(random) if random.uniform() < settings.headlit else 0.0
    lamps, unevenness = settings.lamps.draw_count(random), settings.unevenness.draw(random)
    light = make_light(LightSettings(color, strength, lamps, glare, unevenness, own, None, None), random)
    obstacles = _obstacles(route, along, settings, random)
    things = tuple(obstacles + _clutter(route, along, settings, obstacles, random))
    pink = settings.pink.draw(random)
    shading = (0.8 - 0.3 * pink, 0.8 + 0.6 * pink, 0.8)
    scene = Scene(towns[layout.map], things, light, _surfaces(settings.tint, random), shading, int(random.randint(4)))
    turn = random.choice([-1, 1]) * blur / renderer.focal_length
    path = [WorldPose(pose.x, pose.y, pose.heading - turn / 2), WorldPose(pose.x, pose.y, pose.heading + turn / 2)]
    state = settled(functools.partial(renderer.render, scene, [pose]), sensor)
    exposure_error = settings.exposure_error.draw(random)
    factor = 2**exposure_error
    factors = signal_factors(state, sensor)
    encoded = renderer.render(scene, path, (factors[0] * factor, factors[1] * factor, factors[2] * factor))
    picture = developed(encoded, state, int(random.randint(1 << 30)))
    truth = truth_of(renderer, scene, route, along, pose)
    return Question(picture, truth, name, color, strength, blur, glare, tuple(obstacles), state, exposure_error)


def _obstacles(route: Route, along: float, settings: ExamSettings, random: 'np.random.RandomState') -> List[Thing]:
    """Obstacles that do not stand in each other."""
    found: List[Thing] = []
    for _ in range(settings.obstacles.draw_count(random)):
        sort = settings.sorts[random.randint(len(settings.sorts))]
        at = pose_at(route, along + settings.distance.draw(random), settings.left.draw(random))
        tint = tuple(1 - settings.tint * random.uniform() for _ in range(3))
        thing = Thing(
            sort, at.x, at.y, random.uniform(-math.pi, math.pi), settings.height.draw(random),
            bool(random.uniform() < settings.lying), (tint[0], tint[1], tint[2]),
        )  # fmt: skip
        if not any(footprint(thing).intersects(footprint(other)) for other in found):
            found.append(thing)
    return found


def _clutter(
    route: Route, along: float, settings: ExamSettings, obstacles: Sequence[Thing], random: 'np.random.RandomState'
) -> List[Thing]:
    """Things beside our lane that are no obstacles to us."""
    lane = lane_strip(route, max(along - 0.3, 0.0), along + 3.0).buffer(0.05)
    found: List[Thing] = []
    for _ in range(settings.clutter.draw_count(random)):
        sort, height = CLUTTER[random.randint(len(CLUTTER))]
        at = pose_at(route, along + random.uniform(0.3, 2.0), random.choice([-1, 1]) * random.uniform(0.2, 1.0))
        thing = Thing(sort, at.x, at.y, random.uniform(-math.pi, math.pi), height * random.uniform(0.7, 1.3))
        taken = [lane] + [footprint(other).buffer(0.02) for other in [*obstacles, *found]]
        if not any(footprint(thing).intersects(area) for area in taken):
            found.append(thing)
    return found


def _surfaces(tint: float, random: 'np.random.RandomState') -> Surfaces:
    """Paint and ground of another room, one of a few: laying out a new one takes a while."""
    own = np.random.RandomState(random.randint(6))
    plain = Surfaces()

    def varied(color: RGB, by: float) -> RGB:
        red, green, blue = (float(np.clip(value * own.uniform(1 - by, 1 + by), 0, 0.95)) for value in color)
        return red, green, blue

    grey = own.uniform(0.6, 2.2)
    asphalt = (plain.asphalt[0] * grey, plain.asphalt[1] * grey, plain.asphalt[2] * grey)
    return Surfaces(
        varied(asphalt, 0.06), varied(plain.white, 0.06), varied(plain.yellow, tint), varied(plain.red, tint),
        varied(plain.floor, 0.35),
    )  # fmt: skip


def _span(value: Any, where: str, low: float, high: float) -> Span:
    good = isinstance(value, dict) and set(value) == {'from', 'to'}
    good = good and all(type(end) in (int, float) and math.isfinite(end) for end in value.values())
    if not good or not low <= value['from'] <= value['to'] <= high:
        wanted = '{from: number, to: number}, both from %g to %g' % (low, high)
        raise SettingsError('%s = %r, expected %s' % (where, value, wanted))
    return Span(value['from'], value['to'])


def _names(value: Any, where: str, known: Sequence[str]) -> Tuple[str, ...]:
    if not isinstance(value, list) or not value or any(name not in known for name in value):
        raise SettingsError('%s = %r, expected a list of: %s' % (where, value, ', '.join(known)))
    return tuple(value)


def _layouts(value: Any, where: str) -> Dict[str, LayoutSettings]:
    if not isinstance(value, dict) or not value:
        raise SettingsError('%s = %r, expected a mapping of names to layouts' % (where, value))
    return {str(name): load(LayoutSettings, layout, '%s/%s' % (where, name)) for name, layout in value.items()}
