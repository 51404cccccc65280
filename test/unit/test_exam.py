"""sim.exam: an index and a seed make one question, what it shows is placed fairly, and mistakes are named."""

import copy
import math
from dataclasses import replace
from typing import Any, Callable, Dict, Iterator, List

import numpy as np
import pytest

from obst_avoid.core.settings import SettingsError, load, read_yaml
from obst_avoid.core.types import Kind
from obst_avoid.sim.exam import ExamSettings, Question, Span, ask
from obst_avoid.sim.light import COLORS
from obst_avoid.sim.renderer import Renderer
from obst_avoid.sim.things import footprint
from obst_avoid.sim.town import follow, lane_strip, locate
from unit.cameras import Camera, calibration_of
from unit.drives import simulation
from unit.shipped import CONFIG
from unit.towns import shipped_town

EXAM = read_yaml(str(CONFIG / 'exam.yaml'))
TOWNS = {name: shipped_town(name) for name in ('straight', 'solid', 'town')}
SENSOR = simulation().sensor
COUNT = 60
LAYOUTS = ['straight', 'curve_left', 'curve_right', 'solid_line', 'intersection']
LIGHTS = ['white', 'warm', 'pink', 'blue', 'green', 'red']


def exam(**changes: Any) -> ExamSettings:
    """The shipped exam with some of its spans changed."""
    settings: ExamSettings = load(ExamSettings, EXAM, 'exam.yaml')
    return replace(settings, **changes)


class Eyes:
    """Stands in for a renderer: it draws nothing and remembers what it was asked for."""

    focal_length = 320.0

    def __init__(self) -> None:
        self.calls: List[Any] = []

    def render(self, *call: Any) -> Any:
        self.calls.append(call)
        return np.full((8, 8, 3), 100, dtype=np.uint8)

    def names(self, *_: Any) -> Any:
        return np.zeros((8, 8), dtype=np.uint8)


def asked(index: int, seed: int = 1, settings: Any = None) -> Any:
    """(question, scene, path, factors) of a picture that is not drawn."""
    eyes: Any = Eyes()
    question = ask(index, seed, settings or exam(), SENSOR, TOWNS, eyes)
    return (question, *eyes.calls[-1])


def test_layouts_and_lights_take_turns() -> None:
    questions = [asked(index)[0] for index in range(31)]
    assert [question.layout for question in questions] == LAYOUTS * 6 + LAYOUTS[:1]
    assert [question.color for question in questions] == [name for name in LIGHTS for _ in range(5)] + ['white']


@pytest.fixture(scope='module')
def many() -> List[Any]:
    """Questions without their pictures."""
    return [asked(index) for index in range(COUNT)]


def test_obstacles_keep_apart_and_clutter_off_our_lane(many: List[Any]) -> None:
    counts, clutter = set(), 0
    for question, scene, path, _ in many:
        things = list(question.things)
        assert list(scene.things[: len(things)]) == things
        counts.add(len(things))
        areas = [footprint(thing) for thing in scene.things]
        for index, area in enumerate(areas):
            assert not any(area.intersects(other) for other in areas[:index])
        layout = exam().layouts[question.layout]
        route = follow(TOWNS[layout.map], layout.column, layout.row, layout.heading, layout.turns, 12.0)
        along, _ = locate(route, path[0], layout.along.low, window=3.0)
        lane = lane_strip(route, max(along - 0.2, 0.0), along + 2.5)
        others = scene.things[len(things) :]
        clutter += len(others)
        assert all(thing.kind is None and not footprint(thing).intersects(lane) for thing in others)
    assert counts == {0, 1, 2, 3, 4}
    assert clutter > COUNT


def test_values_lie_in_their_spans(many: List[Any]) -> None:
    things = [thing for question, *_ in many for thing in question.things]
    assert {thing.kind for thing in things} == {Kind.DUCKIE, Kind.CONE}
    assert all(0.03 <= thing.height <= 0.08 for thing in things)
    assert 0.0 < np.mean([thing.lying for thing in things]) < 0.4
    for question, scene, path, _ in many:
        pose = question.truth.lane_pose
        assert abs(pose.d) <= 0.0601 and abs(pose.phi) <= 0.3001
        assert 0.02 <= question.strength <= 1.5 and 0 <= question.glare <= 0.8 and 0 <= question.blur <= 20
        assert scene.light.strength == question.strength and scene.light.color == COLORS[question.color]
        assert len(path) == 2 and (path[0].x, path[0].y) == (path[1].x, path[1].y)
        turn = abs(math.remainder(path[1].heading - path[0].heading, 2 * math.pi))
        assert 320 * turn == pytest.approx(question.blur, abs=1e-6), 'a turn of so many pixels'
    sharp = np.mean([question.blur == 0 for question, *_ in many])
    assert sharp == pytest.approx(0.4, abs=0.2)
    strengths = np.log([question.strength for question, *_ in many])
    assert np.median(strengths) == pytest.approx((math.log(0.02) + math.log(1.5)) / 2, abs=0.6), 'evenly in stops'


@pytest.mark.parametrize('near, far', [(0.3, 0.4), (1.0, 1.2)])
def test_distances_are_ahead_of_the_robot(near: float, far: float) -> None:
    settings = exam(
        distance=Span(near, far), left=Span(0, 0), obstacles=Span(1, 1), d=Span(0, 0), phi=Span(0, 0),
        layouts={'straight': exam().layouts['straight']},
    )  # fmt: skip
    for index in range(10):
        question, _, path, _ = asked(index, settings=settings)
        (thing,) = question.things
        assert near <= thing.x - path[0].x <= far
        assert thing.y == pytest.approx(path[0].y, abs=1e-9)


@pytest.fixture(scope='module')
def renderer() -> Iterator[Renderer]:
    """Of a small camera."""
    one = Renderer(calibration_of(Camera().resized(320, 240)))
    yield one
    one.close()


def same(one: Question, other: Question) -> bool:
    """Picture and truth, bit by bit."""
    masks = zip(one.truth.obstacles, other.truth.obstacles)
    return (
        (one.picture == other.picture).all()
        and one.things == other.things
        and one.truth.lane_pose == other.truth.lane_pose
        and all((a.mask == b.mask).all() and (a.box, a.x, a.in_lane) == (b.box, b.x, b.in_lane) for a, b in masks)
    )


def test_the_same_question_again(renderer: Renderer) -> None:
    settings = exam(layouts={'straight': exam().layouts['straight']}, obstacles=Span(3, 3), distance=Span(0.3, 0.6))

    def question(index: int, seed: int) -> Question:
        return ask(index, seed, settings, SENSOR, TOWNS, renderer)

    one = question(0, 1)
    assert one.picture.shape == (240, 320, 3) and one.picture.dtype == np.uint8
    assert any(obstacle.box for obstacle in one.truth.obstacles)
    other = question(1, 1)
    assert same(question(0, 1), one)
    assert not same(other, one) and other.things != one.things
    assert question(0, 2).things != one.things


def changed(name: str, value: Any) -> Dict[str, Any]:
    """The shipped exam with one value changed, 'layouts/straight/map' for one within another."""
    content = copy.deepcopy(EXAM)
    inner, *path = content, *name.split('/')
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = value
    return content


WRONG = [
    ('blur', {'from': 2, 'to': 1}, 'blur = .*, expected {from: number, to: number}'),
    ('blur', {'from': 2}, 'blur = .*, expected {from: number, to: number}'),
    ('blur', 3.0, 'blur = 3.0, expected {from: number, to: number}'),
    ('blur', {'from': 'a', 'to': 'b'}, 'blur = .*, expected {from: number, to: number}'),
    ('blur', {'from': 0, 'to': math.inf}, 'blur = .*, expected {from: number, to: number}'),
    ('blur', {'from': math.nan, 'to': 1}, 'blur = .*, expected {from: number, to: number}'),
    ('strength', {'from': 0, 'to': 1}, 'strength = .*, expected {from: number, to: number}, both from 0.0001 to 100'),
    ('height', {'from': 0.0, 'to': 0.1}, 'height = .*, expected {from: number, to: number}, both from 0.01 to 0.4'),
    ('glare', {'from': 0.0, 'to': 5.0}, 'glare = .*, expected {from: number, to: number}, both from 0 to 1'),
    ('colors', ['white', 'mauve'], r"colors = \['white', 'mauve'\], expected a list of: "),
    ('colors', [], r'colors = \[\], expected a list of: '),
    ('sorts', 'duckie', "sorts = 'duckie', expected a list of: duckie, cone"),
    ('sorts', ['cat'], r"sorts = \['cat'\], expected a list of: duckie, cone"),
    ('layouts', {}, 'layouts = {}, expected a mapping of names to layouts'),
    ('layouts', ['straight'], 'layouts = .*, expected a mapping of names to layouts'),
    ('layouts/straight', 'town', 'layouts/straight = .*, expected a mapping of settings'),
    ('layouts/straight/colour', 1, 'layouts/straight/colour is not a setting'),
    ('layouts/straight/heading', 'up', "layouts/straight/heading = 'up', expected one of"),
    ('layouts/straight/turns', ['back'], 'layouts/straight/turns = .*, expected a list of'),
    ('layouts/straight/along', 1.0, 'layouts/straight/along = 1.0, expected {from'),
    ('sharp', 2, 'sharp = 2, expected a number'),
    ('extra', 2, 'extra is not a setting'),
]


@pytest.mark.parametrize('name, value, words', WRONG, ids=['%s = %s' % case[:2] for case in WRONG])
def test_mistakes_are_named(name: str, value: Any, words: str) -> None:
    with pytest.raises(SettingsError, match='exam.yaml/' + words):
        load(ExamSettings, changed(name, value), 'exam.yaml')


@pytest.mark.parametrize('draw', [Span.draw, Span.draw_count], ids=['numbers', 'counts'])
def test_spans_include_their_ends(draw: Callable[..., Any]) -> None:
    random = np.random.RandomState(1)
    values = [draw(Span(1, 4), random) for _ in range(200)]
    assert 1 <= min(values) < 1.05 and 3.95 < max(values) <= 4
    assert draw(Span(2, 2), random) == 2
    if draw is Span.draw_count:
        assert set(values) == {1, 2, 3, 4}
