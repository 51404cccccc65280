"""Live settings where the parameter server fails; rostest_live_tuning has the rest."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

from typing import Any, Dict, List

import pytest
import rospy

from obst_avoid.ros.live import LiveSettings


def test_a_change_holds_without_a_master_and_is_kept_as_soon_as_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    live: Any = LiveSettings.__new__(LiveSettings)
    live._nested, live._written = {'margin': 0.03, 'stage': 'stop_only'}, {'margin': 0.02, 'stage': 'stop_only'}
    said: List[str] = []
    monkeypatch.setattr(rospy, 'logwarn', lambda form, *words: said.append(form % words))

    def refuse(name: str, value: Any) -> None:
        raise ConnectionRefusedError('no master')

    monkeypatch.setattr(rospy, 'set_param', refuse)
    live._copy_to_parameter_server()
    assert len(said) == 1 and said[0].endswith('margin is lost when the node ends: no master')
    kept: Dict[str, Any] = {}
    monkeypatch.setattr(rospy, 'set_param', kept.__setitem__)
    live._copy_to_parameter_server()
    assert kept == {'~margin': 0.03}
    kept.clear()
    live._copy_to_parameter_server()
    assert kept == {}
