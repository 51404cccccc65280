"""Live tuning of a running node by dynamic_reconfigure (rqt_reconfigure, dynparam, tune).

A node's settings are the same as at its start: nested, as in its YAML file, and checked whole by the same class. What
dynamic_reconfigure calls paper_yellow_low_hue is the first number of paper/yellow/low.
"""

from typing import Any, Callable, Dict, Type, TypeVar

import rospy
from dynamic_reconfigure.server import Server

from obst_avoid.core.calibration import CalibrationError
from obst_avoid.core.settings import SettingsError, load
from obst_avoid.core.settings_text import changed, flat, value_at
from obst_avoid.ros.node import UNREACHABLE

S = TypeVar('S')


class LiveSettings(Server):  # type: ignore[misc]
    """Takes changes while the node runs. One that is refused is named in the log, and the settings before go on."""

    def __init__(self, config: Any, settings: Type[S], apply: Callable[[S], None]) -> None:
        """config: module that dynamic_reconfigure has generated. apply: is given each whole, checked settings object,
        the first one before this returns; it may raise SettingsError or CalibrationError and change nothing then.
        """
        self._class, self._apply = settings, apply
        self._nested: Dict[str, Any] = rospy.get_param('~', {})
        self._written = dict(self._nested)
        self._paths = flat(self._nested)
        super().__init__(config, self._on_change)

    def _on_change(self, config: Any, _: int) -> Any:
        nested = self._nested
        for name in self.type.defaults:
            nested = changed(nested, self._paths[name], config[name])
        try:
            self._apply(load(self._class, nested, rospy.get_name()))
        except (SettingsError, CalibrationError) as error:
            rospy.logwarn('%s: not changed: %s', rospy.get_name(), error)
            config.update(self._flat())
            return config
        told = [name for name in self.type.defaults if value_at(self._nested, self._paths[name]) != config[name]]
        for name in told:
            rospy.loginfo('%s: %s is %s now', rospy.get_name(), '/'.join(map(str, self._paths[name])), config[name])
        self._nested = nested
        return config

    def _flat(self) -> Dict[str, Any]:
        defaults = self.type.defaults.items()  # their types are those on the wire; YAML may say 1 for 1.0
        return {name: type(default)(value_at(self._nested, self._paths[name])) for name, default in defaults}

    # What Server does with parameters, in the way of nested ones.

    def _copy_from_parameter_server(self) -> None:
        self.config.update(self._flat())

    def _copy_to_parameter_server(self) -> None:
        """So that a node that is started again goes on as it was tuned."""
        for top, value in self._nested.items():
            if value != self._written[top]:
                try:
                    rospy.set_param('~' + top, value)
                    self._written[top] = value
                except UNREACHABLE as error:  # the change itself holds
                    rospy.logwarn('%s: %s is lost when the node ends: %s', rospy.get_name(), top, error)

    def _clamp(self, config: Any) -> None:
        """A value out of range is refused with a sentence, not changed to another one in silence."""
