"""sim.scenario: the shipped scenarios are what they say, chance is repeatable, and mistakes are named."""

import functools
import json
from pathlib import Path
from typing import Any, Callable, Dict, List

import pytest

from obst_avoid.core.settings import SettingsError
from obst_avoid.sim.light import COLORS
from obst_avoid.sim.scenario import Scenario, load_scenario, place
from obst_avoid.sim.things import Thing, footprint
from obst_avoid.sim.town import Route, lane_strip
from obst_avoid.sim.world import begin
from unit.drives import START, TOWNS, mapping, scenario_of, simulation, thing
from unit.shipped import CONFIG

SHIPPED = [*sorted((CONFIG / 'scenarios').glob('*.yaml')), CONFIG / 'demo.yaml']
SEEDS = range(1, 21)
IN_LANE = {'outside': (), 'outside_curve': (), 'demo': (0, 4)}
"""Indices of the obstacles that stand in our lane, where it is not all of them; those that cross come into it."""


def loaded(path: Path) -> List[Scenario]:
    """A shipped scenario with many seeds."""
    return [load_scenario(str(path), seed, TOWNS) for seed in SEEDS]


@functools.lru_cache(maxsize=None)
def lane_of(route: Route) -> Any:
    """Where our lane is, far enough for any scenario."""
    return lane_strip(route, 0.0, 9.0)


def things_of(scenario: Scenario) -> List[Thing]:
    """The obstacles where they first stand."""
    return [place(obstacle, scenario, obstacle.left) for obstacle in scenario.obstacles]


@pytest.mark.parametrize('path', SHIPPED, ids=lambda path: path.stem)
def test_shipped_scenarios(path: Path) -> None:
    for scenario in loaded(path):
        assert scenario.name == path.stem
        _, world = begin(scenario, simulation())
        assert world.contact is None and world.along == pytest.approx(scenario.start, abs=0.01)
        strip, goal = lane_of(scenario.route), scenario.settings.success.goal
        assert scenario.start + goal < 8.0
        assert scenario.start + goal < scenario.route.length - 0.35, 'the goal comes before the end of the road'
        for index, (item, at) in enumerate(zip(scenario.obstacles, things_of(scenario))):
            assert 0.3 < item.along < goal, 'neither under the robot nor behind the goal'
            crosses = item.crosses_within > 0
            inside = index in IN_LANE.get(scenario.name, range(9)) and not crosses
            assert footprint(at).intersects(strip) is inside
            if crosses:
                there = place(item, scenario, item.to_left)
                assert not footprint(there).intersects(strip) and item.left * item.to_left < 0
        assert not any(footprint(item).intersects(strip) for item in scenario.clutter)


def test_what_must_stop_the_robot_leaves_no_room() -> None:
    # 0.22 m of lane, 0.15 m of robot
    for name in ('blocking_straight', 'curve_left', 'curve_right', 'intersection', 'sudden'):
        for scenario in loaded(CONFIG / 'scenarios' / (name + '.yaml')):
            (item,) = scenario.obstacles
            assert scenario.settings.success.must == 'stop'
            assert abs(item.left) < 0.035


def test_one_seed_is_one_scenario() -> None:
    path = str(CONFIG / 'scenarios' / 'outside.yaml')
    one, again, other = (load_scenario(path, seed, TOWNS) for seed in (4, 4, 5))
    assert one == again
    assert one.obstacles != other.obstacles and one.light != other.light and one.start != other.start


class TestRandomValues:
    def drawn(self, folder: Path, value: Any, count: int = 40) -> List[Any]:
        """The obstacle's place to the left with many seeds."""
        content = mapping(thing(1.0, value))
        return [scenario_of(folder, content, seed).obstacles[0].left for seed in range(count)]

    def test_from_to(self, tmp_path: Path) -> None:
        values = self.drawn(tmp_path, {'from': -0.1, 'to': 0.3})
        assert -0.1 <= min(values) < -0.06 and 0.26 < max(values) <= 0.3
        assert len(set(values)) == 40

    def test_from_a_value_to_the_same(self, tmp_path: Path) -> None:
        assert set(self.drawn(tmp_path, {'from': 0.1, 'to': 0.1}, 3)) == {0.1}

    def test_any(self, tmp_path: Path) -> None:
        assert set(self.drawn(tmp_path, {'any': [0.1, 0.2, 0.3]})) == {0.1, 0.2, 0.3}

    def test_any_of_spans(self, tmp_path: Path) -> None:
        values = self.drawn(tmp_path, {'any': [{'from': -0.2, 'to': -0.1}, {'from': 0.1, 'to': 0.2}]})
        assert all(0.1 <= abs(value) <= 0.2 for value in values)
        assert {value > 0 for value in values} == {True, False}

    def test_in_lists_and_of_lists(self, tmp_path: Path) -> None:
        content = mapping(
            map='town', start={**START, 'column': 1, 'row': 3}, turns={'any': [['right', 'left'], ['straight']]}
        )
        turns = {scenario_of(tmp_path, content, seed).settings.turns for seed in range(20)}
        assert turns == {('right', 'left'), ('straight',)}

    def test_values_are_independent(self, tmp_path: Path) -> None:
        span = {'from': 0.1, 'to': 0.9}
        found = scenario_of(tmp_path, mapping(thing(span, span), thing(span, span))).obstacles
        assert len({value for item in found for value in (item.along, item.left)}) == 4


@pytest.mark.parametrize(
    'instead, look, expected',
    [
        ({'light/color': 'red'}, lambda s: s.light.color, COLORS['red']),
        ({'pose_errors': 'real'}, lambda s: s.settings.pose_errors, 'real'),
        ({'light/color': {'any': ['blue']}}, lambda s: s.light.color, COLORS['blue']),
        ({'success/goal': 1.0, 'success/must': 'drive'}, lambda s: s.settings.success.goal, 1.0),
        (None, lambda s: s.light.color, COLORS['white']),
    ],
    ids=['inner', 'outer', 'random', 'two', 'none'],
)
def test_values_instead_of_the_files(
    instead: Any, look: Callable[[Scenario], Any], expected: Any, tmp_path: Path
) -> None:
    plain, scenario = scenario_of(tmp_path, mapping(thing(1.0))), scenario_of(tmp_path, mapping(thing(1.0)), 1, instead)
    assert look(scenario) == expected
    assert scenario.obstacles == plain.obstacles and scenario.light.strength == plain.light.strength


def test_an_obstacle_stands_along_the_lane(tmp_path: Path) -> None:
    content = mapping(thing(0.5, 0.1, yaw=0.3, lying=True), thing(1.0, -0.2, sort='duckie', height=0.05))
    one, other = things_of(scenario_of(tmp_path, content))
    assert (one.x, one.y, one.yaw, one.height, one.lying) == pytest.approx((0.8, 0.27, 0.3, 0.08, True))
    assert (other.sort, other.x, other.y) == ('duckie', pytest.approx(1.3), pytest.approx(-0.03))


def test_a_map_beside_the_scenario(tmp_path: Path) -> None:
    (tmp_path / 'own.yaml').write_text('{tile_size: 0.6, lane_width: 0.2, dashed: true, tiles: "──────"}', 'utf-8')
    assert scenario_of(tmp_path, mapping(map='own.yaml')).route.length == pytest.approx(3.6)


LIGHT: Dict[str, Any] = mapping()['light']
WRONG = {
    'goal behind the end': (
        mapping(success={'must': 'drive', 'goal': 9.0}),
        r'success/goal lies .* expected less than 4.33 m',
    ),
    'obstacle behind the end': (mapping(thing(4.2)), r'obstacles/0/along lies .* expected less than 4.33 m'),
    'start behind the end': (
        mapping(start={'column': 0, 'row': 0, 'heading': 'east', 'along': 40.0, 'd': 0.0, 'phi': 0.0}),
        r'start/along lies 40.00 m .* expected less',
    ),
    'lamps': (mapping(light={**mapping()['light'], 'lamps': 5}), r'light/lamps = 5, expected 1, 2 or 3'),
    'unknown setting': (mapping(colour=1), 'colour is not a setting'),
    'unknown setting of an obstacle': (mapping(thing(1.0, colour=1)), 'obstacles/0/colour is not a setting'),
    'missing': ({'about': '', 'seed': 1}, 'map is missing'),
    'from > to': (mapping(clutter={'from': 3, 'to': 1}), r'clutter = .*, expected two numbers, from <= to'),
    'from text': (mapping(duration={'from': 'a', 'to': 'b'}), r'duration = .*, expected two numbers'),
    'to infinity': (mapping(duration={'from': 0.0, 'to': float('inf')}), r'duration = .*, expected two numbers'),
    'from true': (mapping(duration={'from': True, 'to': 2}), r'duration = .*, expected two numbers'),
    'any of nothing': (mapping(thing({'any': []})), r'obstacles/0/along = .*, expected a list to choose from'),
    'any of text': (mapping(clutter={'any': 'abc'}), r'clutter = .*, expected a list to choose from'),
    'map': (mapping(map='nowhere'), r'nowhere\.yaml cannot be read: No such file'),
    'sort': (mapping(thing(1.0, sort='cat')), "obstacles/0/sort = 'cat', expected one of: duckie, cone"),
    'color': (mapping(light={**LIGHT, 'color': 'mauve'}), "light/color = 'mauve', expected one of"),
    'must': (mapping(success={'must': 'fly'}), "success/must = 'fly', expected one of: stop, pass"),
    'turn': (mapping(turns=['back']), r"turns = \['back'\], expected a list of"),
    'turns': (mapping(turns='left'), "turns = 'left', expected a list of"),
    'impossible turn': (
        mapping(map='town', start={**START, 'column': 2, 'row': 3}, turns=['left']),
        "turn 'left' at the intersection in column 4, row 3, expected one of",
    ),
    'no road': (mapping(start={**START, 'heading': 'north'}), 'no road enters the tile at column 0, row 0'),
    'beyond the map': (mapping(start={**START, 'row': 7}), 'no road enters the tile at column 0, row 7'),
    'obstacles': (mapping(obstacles={'sort': 'cone'}), 'obstacles = .*, expected a list of obstacles'),
    'an obstacle': (mapping(obstacles=['cone']), r"obstacles = \['cone'\], expected a list of obstacles"),
    'a list': ('- about: a list', 'is not a mapping, expected a scenario'),
    'nothing': ('', 'is not a mapping, expected a scenario'),
    'no YAML': ('{', 'does not parse as YAML'),
}


@pytest.mark.parametrize('content, words', WRONG.values(), ids=list(WRONG))
def test_mistakes_are_named(content: Any, words: str, tmp_path: Path) -> None:
    text = content if isinstance(content, str) else json.dumps(content).replace('Infinity', '.inf')
    with pytest.raises(SettingsError, match=words) as raised:
        scenario_of(tmp_path, text)
    assert '\n' not in str(raised.value)


def test_unknown_pose_errors(tmp_path: Path) -> None:
    scenario = scenario_of(tmp_path, mapping(pose_errors='perfect'))
    with pytest.raises(SettingsError, match="^pose_errors = 'perfect', expected one of: clean, real$"):
        begin(scenario, simulation())


@pytest.mark.parametrize('clutter', [0, 1, 5])
def test_clutter_is_as_much_as_asked_for(clutter: int, tmp_path: Path) -> None:
    found = [len(scenario_of(tmp_path, mapping(clutter=clutter), seed).clutter) for seed in range(5)]
    assert found == [clutter] * 5
