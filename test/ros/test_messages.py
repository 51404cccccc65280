"""Which package the three messages that Duckietown's stack defines too are taken from."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import importlib
import sys
from pathlib import Path

import pytest

from obst_avoid import msg as own
from obst_avoid.ros.messages import MessagesError, find_messages

CLASSES = ('LanePose', 'BoolStamped', 'Twist2DStamped')


@pytest.fixture
def _without_duckietown(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if no duckietown_msgs were installed, whatever this machine has."""
    for name in [name for name in sys.modules if name.split('.')[0] == 'duckietown_msgs']:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'duckietown_msgs', None)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a made-up duckietown_msgs that is installed."""
    for name in ('duckietown_msgs', 'duckietown_msgs.msg'):
        monkeypatch.delitem(sys.modules, name, raising=False)
    folder = tmp_path / 'duckietown_msgs'
    folder.mkdir()
    (folder / '__init__.py').write_text('')
    (folder / 'msg.py').write_text('\n'.join('class %s:\n    pass' % name for name in CLASSES))
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    yield folder
    for name in ('duckietown_msgs', 'duckietown_msgs.msg'):
        sys.modules.pop(name, None)


@pytest.mark.usefixtures('_without_duckietown')
def test_our_own_where_there_is_nothing_else() -> None:
    found = find_messages('')
    assert (found.LanePose, found.BoolStamped, found.Twist2DStamped) == (
        own.LanePose,
        own.BoolStamped,
        own.Twist2DStamped,
    )


@pytest.mark.usefixtures('package')
def test_the_robots_where_they_are_installed() -> None:
    found = find_messages('')
    theirs = importlib.import_module('duckietown_msgs.msg')
    for name in CLASSES:
        assert getattr(found, name) is getattr(theirs, name)


@pytest.mark.usefixtures('package')
def test_a_package_that_is_asked_for_by_name() -> None:
    assert find_messages('obst_avoid').LanePose is own.LanePose
    assert find_messages('duckietown_msgs').LanePose is not own.LanePose


@pytest.mark.usefixtures('_without_duckietown')
@pytest.mark.parametrize('name', ['duckietown_msgs', 'no_such_msgs', 'std_msgs', 'os', 'no such package'])
def test_packages_without_the_messages(name: str) -> None:
    with pytest.raises(MessagesError, match='msgs_package = %s, expected a package with messages' % name):
        find_messages(name)


def test_robots_messages_that_lack_one_are_not_mixed_with_ours(package: Path) -> None:
    (package / 'msg.py').write_text('class LanePose:\n    pass')
    with pytest.raises(MessagesError, match='duckietown_msgs.*BoolStamped'):
        find_messages('duckietown_msgs')
    assert find_messages('').LanePose is own.LanePose
