"""What can be tuned: the same settings, files and ranges as in dynamic_reconfigure, checked as at a start."""

import ast
import os
from dataclasses import dataclass, fields
from typing import Any, Dict, List, Mapping, Sequence, Tuple, Type

from obst_avoid.cfg import LaneControllerConfig, ObstacleAvoidanceConfig, ObstacleDetectionConfig
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.lane_control import LaneControlSettings
from obst_avoid.core.settings import SettingsError, load
from obst_avoid.core.settings_text import changed, described, flat, value_at, with_values
from obst_avoid.offline import tool

DETECTOR, AVOIDER, CONTROLLER = 'obstacle_detection_node', 'obstacle_avoidance_node', 'lane_controller_node'
Values = Mapping[str, Mapping[str, Any]]
"""Each node's settings, nested as in its YAML files."""


@dataclass(frozen=True)
class Node:
    """files: in a folder of settings. config: module that dynamic_reconfigure generated from cfg/."""

    files: Sequence[str]
    settings: Type[Any]
    config: Any


NODES = {
    DETECTOR: Node(('obstacle_detection_node.yaml', 'bird_view.yaml'), DetectionSettings, ObstacleDetectionConfig),
    AVOIDER: Node(('obstacle_avoidance_node.yaml', 'lane_estimate.yaml'), AvoidanceSettings, ObstacleAvoidanceConfig),
    CONTROLLER: Node(('lane_controller_node.yaml', 'lane_estimate.yaml'), LaneControlSettings, LaneControllerConfig),
}
OTHERS = {
    'car_cmd_guard_node': 'car_cmd_guard_node.yaml',
    'daffy_adapter_node': 'daffy_adapter_node.yaml',
    'simulator_node': 'simulation.yaml',
}
"""Nodes that cannot be tuned, and their files, which launch files read too."""


@dataclass(frozen=True)
class Tunable:
    """One number, word or switch. name: flat. kind: double, int, bool or str. choices: of a word."""

    node: str
    name: str
    kind: str
    about: str
    low: Any
    high: Any
    choices: Tuple[str, ...] = ()


def tunables(node: str) -> List[Tunable]:
    """What can be changed of a node, in order."""
    found = []
    for item in NODES[node].config.config_description['parameters']:
        words = [word['value'] for word in ast.literal_eval(item['edit_method'])['enum']] if item['edit_method'] else []
        found.append(
            Tunable(node, item['name'], item['type'], item['description'], item['min'], item['max'], tuple(words))
        )
    return found


def read(config: str) -> Values:
    """The settings of a folder, or the package's own, checked. Raises SettingsError."""
    values = {}
    for name, node in NODES.items():
        values[name] = {}
        for file in node.files:
            values[name].update(tool.node_yaml(config, file))
    check(values)
    return values


def from_parameters(parameters: Mapping[str, Any], node: str) -> Dict[str, Any]:
    """A node's settings among its parameters, without those that its launch file gives it."""
    known = {item.name for item in fields(NODES[node].settings)}
    return {name: value for name, value in parameters.items() if name in known}


def check(values: Values) -> None:
    """Raises SettingsError for the first thing that no node would start with."""
    for node in values:
        settings_of(values, node)


def settings_of(values: Values, node: str) -> Any:
    """A node's settings object. Raises SettingsError."""
    return load(NODES[node].settings, values[node], node)


def get(values: Values, item: Tunable) -> Any:
    """The value of a tunable."""
    return value_at(values[item.node], flat(values[item.node])[item.name])


def with_change(values: Values, item: Tunable, value: Any) -> Values:
    """The settings with another value of a tunable, checked. Raises SettingsError."""
    if item.kind == 'int' and isinstance(value, float) and value.is_integer():
        value = int(value)  # a page knows only numbers
    path = flat(values[item.node])[item.name]
    after = {**values, item.node: changed(values[item.node], path, value)}
    settings_of(after, item.node)
    return after


def differences(before: Values, after: Values) -> List[Tuple[Tunable, Any, Any]]:
    """(tunable, before, after) of what was changed."""
    found = []
    for node in after:
        for item in tunables(node):
            old, new = get(before, item), get(after, item)
            if old != new:
                found.append((item, old, new))
    return found


def files_of(values: Values) -> Dict[str, str]:
    """Name of each file that is written with values, and the node whose they are."""
    found: Dict[str, str] = {}
    for name, node in NODES.items():
        for file in node.files:
            if name in values:
                found.setdefault(file, name)
    found.update({file: name for name, file in OTHERS.items() if name in values})
    return found


def existing(values: Values, folder: str) -> List[str]:
    """Files that a folder has already, and that would be written over."""
    return [name for name in sorted(files_of(values)) if os.path.lexists(os.path.join(folder, name))]


def save(values: Values, config: str, folder: str) -> List[str]:
    """Write a folder of settings that --config and config:= take: the files of config, or the package's own, with
    their comments, and the values as they are now. Files of other nodes are added, and left alone where they are.
    Returns the paths. Raises OSError, SettingsError.
    """
    os.makedirs(folder, exist_ok=True)
    written, ours = [], files_of(values)
    everything = {*(file for node in NODES.values() for file in node.files), *OTHERS.values()}
    for file in sorted(everything):
        path, source = os.path.join(folder, file), tool.settings_file(config, file)
        if file not in ours and os.path.lexists(path):
            continue
        if not os.path.exists(source):  # of a folder for tools
            source = tool.settings_file('', file)
        with open(source, encoding='utf-8') as opened:
            text = opened.read()
        now = values[ours[file]] if file in ours else {}
        other = {item.path: value_at(now, item.path) for item in described(text) if _differs(item, now)}
        with tool.whole(path) as part, open(part, 'w', encoding='utf-8') as out:
            out.write(with_values(text, other))
        written.append(path)
    return written


def _differs(item: Any, now: Mapping[str, Any]) -> bool:
    if item.value is None:  # a group
        return False
    try:
        return bool(value_at(now, item.path) != item.value)
    except KeyError as error:
        if not now:  # nobody has said anything about this node
            return False
        raise SettingsError('%s is missing' % '/'.join(item.path)) from error
