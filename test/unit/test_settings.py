"""core.settings: each kind of field, and every message that a person may have to read."""

import copy
import math
from dataclasses import FrozenInstanceError, dataclass
from pathlib import Path
from typing import Any, Dict, Tuple

import pytest

from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.settings import (
    SettingsError,
    choice,
    flag,
    group,
    integer,
    integers,
    load,
    number,
    read_yaml,
    text,
)
from unit import shipped

NODE = '/duck1/some_node'


@dataclass(frozen=True)
class Inner:
    """A nested group."""

    depth: float = number('m', at_least=0, at_most=2)


@dataclass(frozen=True)
class Sample:
    """One field of each kind."""

    width: float = number('m', above=0)
    share: float = number('fraction', above=0, below=0.5)
    offset: float = number('m')
    frames: int = integer(1)
    low: Tuple[int, int, int] = integers(3, 0, 255)
    profile: str = choice('paper', 'robust')
    frame: str = text()
    rviz: bool = flag()
    inner: Inner = group(Inner)


GOOD: Dict[str, Any] = {
    'width': 2,
    'share': 0.25,
    'offset': -1.5,
    'frames': 3,
    'low': [0, 100, 255],
    'profile': 'robust',
    'frame': '',
    'rviz': True,
    'inner': {'depth': 0},
}


def message_of(mapping: Any, settings: Any = Sample, where: str = NODE) -> str:
    """What load says when it refuses."""
    with pytest.raises(SettingsError) as refused:
        load(settings, mapping, where)
    return str(refused.value)


@pytest.mark.parametrize(
    'mapping, shown',
    [
        pytest.param(None, 'None', id='an empty file'),
        pytest.param([], '[]', id='an empty list'),
        pytest.param('width', "'width'", id='text'),
    ],
)
def test_what_is_not_a_mapping_is_refused(mapping: Any, shown: str) -> None:
    assert message_of(mapping) == '%s = %s, expected a mapping of settings' % (NODE, shown)


def test_an_empty_mapping_lacks_its_first_setting() -> None:
    assert message_of({}) == NODE + '/width is missing'


def test_a_good_mapping_becomes_typed_values() -> None:
    loaded = load(Sample, GOOD, NODE)
    assert loaded == Sample(2.0, 0.25, -1.5, 3, (0, 100, 255), 'robust', '', True, Inner(0.0))
    assert isinstance(loaded.width, float) and isinstance(loaded.low, tuple)


def test_loaded_settings_cannot_be_changed() -> None:
    with pytest.raises(FrozenInstanceError):
        load(Sample, GOOD, NODE).width = 1.0  # type: ignore[misc]


def test_loading_leaves_the_mapping_alone() -> None:
    mapping = copy.deepcopy(GOOD)
    load(Sample, mapping, NODE)
    assert mapping == GOOD


@pytest.mark.parametrize('name', sorted(GOOD))
def test_each_missing_setting_is_named(name: str) -> None:
    mapping = {key: value for key, value in GOOD.items() if key != name}
    assert message_of(mapping) == '%s/%s is missing' % (NODE, name)


@pytest.mark.parametrize(
    'name, value, expected',
    [
        pytest.param('width', 0, '0, expected a number > 0 (m)', id='on an open limit'),
        pytest.param('width', -0.2, '-0.2, expected a number > 0 (m)', id='below the limit'),
        pytest.param('width', True, 'True, expected a number > 0 (m)', id='a bool is no number'),
        pytest.param('width', '0.2', "'0.2', expected a number > 0 (m)", id='text is no number'),
        pytest.param('width', None, 'None, expected a number > 0 (m)', id='nothing is no number'),
        pytest.param('width', [0.2], '[0.2], expected a number > 0 (m)', id='a list is no number'),
        pytest.param('width', math.nan, 'nan, expected a number > 0 (m)', id='NaN'),
        pytest.param('width', math.inf, 'inf, expected a number > 0 (m)', id='infinity'),
        pytest.param('offset', -math.inf, '-inf, expected a number (m)', id='minus infinity, no limits'),
        pytest.param('share', 0.5, '0.5, expected a number > 0 and < 0.5 (fraction)', id='on an open upper limit'),
        pytest.param('share', 0.0, '0.0, expected a number > 0 and < 0.5 (fraction)', id='on an open lower limit'),
        pytest.param('frames', 0, '0, expected a whole number >= 1', id='whole number too small'),
        pytest.param('frames', 2.0, '2.0, expected a whole number >= 1', id='a float is no whole number'),
        pytest.param('frames', True, 'True, expected a whole number >= 1', id='a bool is no whole number'),
        pytest.param('low', [0, 1], '[0, 1], expected 3 whole numbers from 0 to 255', id='two numbers of three'),
        pytest.param('low', [0, 1, 256], '[0, 1, 256], expected 3 whole numbers from 0 to 255', id='one too large'),
        pytest.param('low', [0, -1, 2], '[0, -1, 2], expected 3 whole numbers from 0 to 255', id='one too small'),
        pytest.param('low', [0, 1.0, 2], '[0, 1.0, 2], expected 3 whole numbers from 0 to 255', id='one float'),
        pytest.param('low', [0, True, 2], '[0, True, 2], expected 3 whole numbers from 0 to 255', id='one bool'),
        pytest.param('low', 7, '7, expected 3 whole numbers from 0 to 255', id='one number instead of a list'),
        pytest.param('profile', 'Paper', "'Paper', expected one of: paper, robust", id='another name'),
        pytest.param('profile', None, 'None, expected one of: paper, robust', id='no name'),
        pytest.param('profile', ['paper'], "['paper'], expected one of: paper, robust", id='a list of names'),
        pytest.param('frame', 3, '3, expected text', id='a number is no text'),
        pytest.param('frame', None, 'None, expected text', id='nothing is no text'),
        pytest.param('rviz', 1, '1, expected true or false', id='a number is no flag'),
        pytest.param('rviz', 'true', "'true', expected true or false", id='text is no flag'),
        pytest.param('inner', 0.2, '0.2, expected a mapping of settings', id='a number is no group'),
        pytest.param('inner', None, 'None, expected a mapping of settings', id='an empty group'),
    ],
)
def test_each_bad_value_is_shown_with_what_was_expected(name: str, value: Any, expected: str) -> None:
    assert message_of(dict(GOOD, **{name: value})) == '%s/%s = %s' % (NODE, name, expected)


@pytest.mark.parametrize('depth', [0, 2, 0.0, 2.0])
def test_closed_limits_belong_to_the_range(depth: float) -> None:
    assert load(Sample, dict(GOOD, inner={'depth': depth}), NODE).inner.depth == depth


@pytest.mark.parametrize(
    'inner, message',
    [
        pytest.param({}, '/inner/depth is missing', id='missing'),
        pytest.param({'depth': 2.1}, '/inner/depth = 2.1, expected a number >= 0 and <= 2 (m)', id='too large'),
        pytest.param({'depth': -1e-9}, '/inner/depth = -1e-09, expected a number >= 0 and <= 2 (m)', id='too small'),
        pytest.param({'dept': 1}, '/inner/dept is not a setting, did you mean depth?', id='misspelt'),
    ],
)
def test_nested_settings_are_named_in_full(inner: Any, message: str) -> None:
    assert message_of(dict(GOOD, inner=inner)) == NODE + message


def test_a_misspelt_setting_gets_a_hint() -> None:
    mapping = {key: value for key, value in GOOD.items() if key != 'width'}
    assert message_of(dict(mapping, widthh=0.2)) == NODE + '/widthh is not a setting, did you mean width?'


@pytest.mark.parametrize('name', ['zzz', 7, None, True])
def test_an_unknown_setting_far_from_all_names_gets_their_list(name: Any) -> None:
    names = 'frame, frames, inner, low, offset, profile, rviz, share, width'
    assert message_of({**GOOD, name: 1}) == '%s/%s is not a setting, expected one of: %s' % (NODE, name, names)


def test_a_whole_number_beyond_all_floats_is_refused_like_infinity() -> None:
    assert message_of(dict(GOOD, width=10**400)).endswith(', expected a number > 0 (m)')


def test_the_message_of_the_house_style() -> None:
    mapping = dict(shipped.mappings()['avoidance'][1], lane_width=-0.2)
    message = message_of(mapping, AvoidanceSettings, '/duck1/obstacle_avoidance_node')
    assert message == '/duck1/obstacle_avoidance_node/lane_width = -0.2, expected a number > 0 (m)'


def test_a_colour_of_the_shipped_settings_is_named_in_full() -> None:
    mapping = copy.deepcopy(shipped.mappings()['detection'][1])
    mapping['paper']['yellow']['low'][0] = 300
    message = message_of(mapping, DetectionSettings, '/duck1/obstacle_detection_node')
    assert message.startswith('/duck1/obstacle_detection_node/paper/yellow/low = [300, 100, 200], expected 3 whole')


@pytest.mark.parametrize('node', ['avoidance', 'detection', 'lane_control'])
def test_the_shipped_settings_load(node: str) -> None:
    settings, mapping = shipped.mappings()[node]
    loaded = load(settings, mapping, node)
    assert isinstance(loaded, settings)
    with pytest.raises(FrozenInstanceError):
        setattr(loaded, sorted(mapping)[0], None)


def test_an_empty_yaml_file_holds_nothing(tmp_path: Path) -> None:
    path = tmp_path / 'empty.yaml'
    path.write_text('')
    assert read_yaml(str(path)) is None


def test_a_yaml_file_is_read_as_utf8(tmp_path: Path) -> None:
    path = tmp_path / 'good.yaml'
    path.write_bytes('frame: Zürich\nlow: [1, 2]\n'.encode())
    assert read_yaml(str(path)) == {'frame': 'Zürich', 'low': [1, 2]}


@pytest.mark.parametrize(
    'content, line',
    [
        pytest.param(b'a: [1, 2\n', ' at line 2', id='an open bracket'),
        pytest.param(b'a: 1\n<<<<<<< HEAD\nb: 2\n', ' at line 3', id='a merge conflict'),
        pytest.param(b'a: !!python/object/apply:os.getcwd []\n', ' at line 1', id='code'),
        pytest.param(b'a: \xff\xfe\n', '', id='not UTF-8'),
        pytest.param(b'a: \x00\n', '', id='a NUL'),
        pytest.param(b'[' * 20000, '', id='deeper than Python can go'),
        pytest.param(b'date: 2018-13-45\n', '', id='a date that does not exist'),
    ],
)
def test_a_file_that_does_not_parse_is_one_sentence(tmp_path: Path, content: bytes, line: str) -> None:
    path = tmp_path / 'bad.yaml'
    path.write_bytes(content)
    with pytest.raises(SettingsError) as refused:
        read_yaml(str(path))
    assert str(refused.value) == '%s does not parse as YAML%s' % (path, line)


def test_a_file_that_is_absent_or_a_folder_cannot_be_read(tmp_path: Path) -> None:
    for path, why in ((tmp_path / 'absent.yaml', 'No such file or directory'), (tmp_path, 'Is a directory')):
        with pytest.raises(SettingsError) as refused:
            read_yaml(str(path))
        assert str(refused.value) == '%s cannot be read: %s' % (path, why)
