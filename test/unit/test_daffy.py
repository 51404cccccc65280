"""core.daffy: what today's lane controller is asked for is never faster than what the avoider wants."""

from typing import Optional

import pytest
from hypothesis import given
from property.strategies import numbers

from obst_avoid.core.daffy import DaffySettings, Pace, acts, asked, pace_of
from obst_avoid.core.lane_control import Reference
from obst_avoid.core.settings import SettingsError, load, read_yaml
from obst_avoid.core.types import LanePose, Stamped
from unit.shipped import CONFIG

NOW = 1_700_000_000_000_000_000
MS = 1_000_000
FACTOR = {Pace.FULL: 1.0, Pace.SLOW: 0.25, Pace.STAND: 0.0}


@pytest.fixture(scope='module')
def settings() -> DaffySettings:
    """As shipped."""
    content = dict(read_yaml(str(CONFIG / 'daffy_adapter_node.yaml')))
    del content['hard_stop'], content['follower']  # the node's own
    loaded: DaffySettings = load(DaffySettings, content, 'daffy')
    return loaded


def ask(
    settings: DaffySettings,
    reference: Optional[Reference],
    pose: Optional[int] = 0,
    told: int = 0,
    heard: bool = True,
    stood: float = 0.0,
) -> Pace:
    """pose, told: age in ms, None: never."""
    lane_pose = None if pose is None else Stamped(NOW - pose * MS, LanePose(0.0, 0.0))
    return asked(lane_pose, reference and Stamped(NOW - told * MS, reference), heard, stood, NOW, settings).pace


@pytest.mark.parametrize(
    'reference, pace',
    [
        pytest.param(Reference(False, 0.0, 0.2), Pace.FULL, id='clear'),
        pytest.param(Reference(False, 0.0, 0.0), Pace.FULL, id='not active: its numbers do not count'),
        pytest.param(Reference(True, 0.0, 0.2), Pace.FULL, id='active at full speed'),
        pytest.param(Reference(True, 0.0, 0.12), Pace.SLOW, id='between the two: the slower'),
        pytest.param(Reference(True, 0.0, 0.05), Pace.SLOW, id='slow'),
        pytest.param(Reference(True, 0.0, 0.02), Pace.STAND, id='slower than slow'),
        pytest.param(Reference(True, 0.0, 0.0), Pace.STAND, id='stop'),
    ],
)
def test_the_pace(settings: DaffySettings, reference: Reference, pace: Pace) -> None:
    assert ask(settings, reference) is pace


@given(speed=numbers(0.0, 1.0))
def test_never_faster_than_wanted(settings: DaffySettings, speed: float) -> None:
    assert FACTOR[pace_of(speed, settings)] * settings.full_speed <= speed + settings.speed_tolerance


@pytest.mark.parametrize(
    'faults',
    [
        pytest.param({'pose': None}, id='no lane pose'),
        pytest.param({'pose': 401}, id='an old lane pose'),
        pytest.param({'pose': -200}, id='a lane pose of the future'),
        pytest.param({'told': 401}, id='an old lane control'),
        pytest.param({'stood': 0.6}, id='a clock that stands still'),
    ],
)
def test_doubt_stops(settings: DaffySettings, faults: dict) -> None:
    assert ask(settings, Reference(False, 0.0, 0.2), **faults) is Pace.STAND
    assert ask(settings, None) is Pace.STAND


def test_an_offset_that_nobody_follows_stops(settings: DaffySettings) -> None:
    assert ask(settings, Reference(True, 0.03, 0.12), heard=False) is Pace.STAND
    assert ask(settings, Reference(True, -0.03, 0.12), heard=False) is Pace.STAND
    assert ask(settings, Reference(True, 0.004, 0.12), heard=False) is Pace.SLOW
    assert ask(settings, Reference(False, 0.03, 0.2), heard=False) is Pace.FULL


@pytest.mark.parametrize(
    'on, mode, expected',
    [
        (True, None, True),
        (True, 'LANE_FOLLOWING', True),
        (True, 'JOYSTICK_CONTROL', False),
        (False, None, False),
        (False, 'LANE_FOLLOWING', False),
    ],
)
def test_when_it_acts(settings: DaffySettings, on: bool, mode: Optional[str], expected: bool) -> None:
    assert acts(on, mode, settings) is expected


@pytest.mark.parametrize('modes', ['LANE_FOLLOWING', [1], [''], None])
def test_modes_are_names(modes: object) -> None:
    content = {**read_yaml(str(CONFIG / 'daffy_adapter_node.yaml')), 'modes': modes}
    del content['hard_stop'], content['follower']
    with pytest.raises(SettingsError, match='daffy/modes = .*, expected a list of names'):
        load(DaffySettings, content, 'daffy')
