"""core.settings on the shipped files: no key can be lost or misspelt without being named."""

import copy
import math
from typing import Any, Dict, Iterator, List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from unit import shipped

from obst_avoid.core.settings import SettingsError, load

NODES = ['avoidance', 'detection', 'lane_control']
WHERE = '/duck1/some_node'


def keys_of(mapping: Dict[str, Any], path: Tuple[str, ...] = ()) -> Iterator[Tuple[str, ...]]:
    """The path of every key of a nested mapping."""
    for key, value in mapping.items():
        yield path + (key,)
        if isinstance(value, dict):
            yield from keys_of(value, path + (key,))


def parent_of(mapping: Dict[str, Any], path: Tuple[str, ...]) -> Dict[str, Any]:
    """The mapping that holds a key."""
    for key in path[:-1]:
        mapping = mapping[key]
    return mapping


def changed(data: Any) -> Tuple[Any, Dict[str, Any], Tuple[str, ...]]:
    """A node's settings class, a copy of its mapping and one key of it."""
    settings, mapping = shipped.mappings()[data.draw(st.sampled_from(NODES))]
    mapping = copy.deepcopy(mapping)
    return settings, mapping, data.draw(st.sampled_from(list(keys_of(mapping))))


def refusal(settings: Any, mapping: Any) -> str:
    """What load says when it refuses."""
    with pytest.raises(SettingsError) as refused:
        load(settings, mapping, WHERE)
    return str(refused.value)


@given(data=st.data())
def test_any_lost_key_is_named_in_full(data: Any) -> None:
    settings, mapping, path = changed(data)
    del parent_of(mapping, path)[path[-1]]
    assert refusal(settings, mapping) == '%s/%s is missing' % (WHERE, '/'.join(path))


@given(data=st.data(), name=st.text(st.characters(whitelist_categories=('Ll',)), max_size=12))
def test_any_renamed_key_is_named_in_full(data: Any, name: str) -> None:
    settings, mapping, path = changed(data)
    parent = parent_of(mapping, path)
    new = data.draw(st.sampled_from([name, path[-1] + 's', path[-1][1:], path[-1].upper()]))
    if new in parent:
        return
    parent[new] = parent.pop(path[-1])
    message = refusal(settings, mapping)
    assert message.startswith('%s/%s is not a setting' % (WHERE, '/'.join(path[:-1] + (new,))))


@given(data=st.data(), value=st.sampled_from([None, math.nan, math.inf, [], {}, [None], '\x00', -1e30, object()]))
def test_any_useless_value_is_named_in_full(data: Any, value: Any) -> None:
    settings, mapping, path = changed(data)
    parent_of(mapping, path)[path[-1]] = value
    assert refusal(settings, mapping).startswith('%s/%s' % (WHERE, '/'.join(path)))


@given(data=st.data())
def test_a_good_mapping_loads_in_any_order_of_keys(data: Any) -> None:
    settings, mapping = shipped.mappings()[data.draw(st.sampled_from(NODES))]
    keys: List[str] = data.draw(st.permutations(list(mapping)))
    assert load(settings, {key: mapping[key] for key in keys}, WHERE) == load(settings, mapping, WHERE)
