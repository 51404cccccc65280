"""Settings files as people read and write them."""

from pathlib import Path

import pytest
import yaml

from obst_avoid.core.settings_text import changed, described, flat, value_at, with_values

TEXT = """# Settings of a node.
stage: stop_only          # of commissioning: stop_only, avoid_single,
                          # avoid_all

# The lane.
lane_width: 0.22          # m
known:                    # obstacles over time
  gate: 0.06              # m between '#' and "#"
  words: 'a # b'          # no comment inside
  none: 1
yellow:
  low: [15, 100, 200]     # hue, saturation, value
list:                     # of things
  - a
  - b
"""
CONFIG = Path(__file__).resolve().parents[2] / 'config'


def comments(text):
    return {item.path: item.comment for item in described(text)}


def test_each_value_has_the_comment_beside_it():
    found = comments(TEXT)
    assert found[('stage',)] == 'of commissioning: stop_only, avoid_single, avoid_all'
    assert found[('lane_width',)] == 'm'
    assert found[('known',)] == 'obstacles over time'
    assert found[('known', 'gate')] == 'm between \'#\' and "#"'
    assert found[('known', 'words')] == 'no comment inside'
    assert found[('known', 'none')] == ''
    assert found[('yellow',)] == ''
    assert found[('yellow', 'low')] == 'hue, saturation, value'
    assert found[('list',)] == 'of things'


def test_values_and_groups_in_order():
    items = {item.path: item.value for item in described(TEXT)}
    assert list(items)[:4] == [('stage',), ('lane_width',), ('known',), ('known', 'gate')]
    assert items[('stage',)] == 'stop_only'
    assert items[('known',)] is None
    assert items[('known', 'words')] == 'a # b'
    assert items[('list',)] == ['a', 'b']


@pytest.mark.parametrize('text', ['', '# nothing\n'])
def test_an_empty_file_has_no_values(text):
    assert described(text) == []
    assert with_values(text, {}) == text


def test_a_value_is_changed_where_it_stands():
    text = with_values(TEXT, {('lane_width',): 0.25, ('yellow', 'low'): [1, 2, 3], ('stage',): 'avoid_all'})
    assert yaml.safe_load(text) == {
        **yaml.safe_load(TEXT),
        'lane_width': 0.25,
        'yellow': {'low': [1, 2, 3]},
        'stage': 'avoid_all',
    }
    assert [line for line in text.splitlines() if line not in TEXT.splitlines()] == [
        'stage: avoid_all          # of commissioning: stop_only, avoid_single,',
        'lane_width: 0.25          # m',
        '  low: [1, 2, 3]     # hue, saturation, value',
    ]


@pytest.mark.parametrize('value', [True, 1e-7, 3, 'a: b', -0.5, 'yes', [0.1, 0.2]])
def test_what_was_written_is_read_again(value):
    assert yaml.safe_load(with_values(TEXT, {('known', 'none'): value}))['known']['none'] == value


def test_a_path_that_is_not_there():
    with pytest.raises(KeyError, match='nowhere'):
        with_values(TEXT, {('nowhere',): 1})


def test_flat_names_lead_back_to_the_values():
    settings = yaml.safe_load(TEXT)
    names = flat(settings)
    assert names['yellow_low_saturation'] == ('yellow', 'low', 1)
    assert value_at(settings, names['yellow_low_saturation']) == 100
    other = changed(settings, names['yellow_low_saturation'], 7)
    assert other['yellow']['low'] == [15, 7, 200]
    assert settings['yellow']['low'] == [15, 100, 200], 'the settings before are as they were'


@pytest.mark.parametrize('path', sorted(CONFIG.glob('*.yaml')), ids=lambda path: path.name)
def test_the_package_s_own_files(path):
    text = path.read_text(encoding='utf-8')
    items = described(text)
    content = yaml.safe_load(text)
    assert items
    for item in items:
        held = value_at(content, item.path)
        assert item.value == (None if isinstance(held, dict) else held)
    values = {item.path: item.value for item in items if isinstance(item.value, (bool, int, float))}
    assert yaml.safe_load(with_values(text, values)) == content
