"""What /diagnostics says of one robot's nodes, in a few lines for rviz."""

from dataclasses import dataclass
from typing import Dict, List, Mapping, Tuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

SILENT = 3.0
"""[s] of wall time after which a node has fallen silent; each reports once a second."""
WIDTH = 80
"""Letters in a line at most."""
SHORT = {
    'obstacle_detection_node': 'detector',
    'obstacle_avoidance_node': 'avoider',
    'lane_controller_node': 'controller',
    'daffy_adapter_node': 'adapter',
    'car_cmd_guard_node': 'guard',
    'simulator_node': 'simulator',
    'obstacle_detection_visual_node': 'visualizer',
}
"""In the order in which they are shown."""


@dataclass(frozen=True)
class Heard:
    """A node's line in /diagnostics. wall: [s], monotonic, when it came. values: by key."""

    level: int
    message: str
    values: Mapping[str, str]
    wall: float


def heard_of(msg: DiagnosticArray, veh: str, wall: float) -> Dict[str, Heard]:
    """What a message says of a robot's nodes, by the last part of a node's name."""
    found = {}
    for status in msg.status:
        name = status.name.split(':')[0].split('/')[-1]
        if status.hardware_id == veh and name:
            values = {item.key: item.value for item in status.values}
            found[name] = Heard(min(int(status.level), DiagnosticStatus.ERROR), status.message, values, wall)
    return found


def health_of(heard: Mapping[str, Heard], wall: float) -> Tuple[str, int]:
    """A line for each node and for each calibration in use, and the worst level."""
    if not heard:
        return 'no diagnostics yet', DiagnosticStatus.WARN
    lines: List[str] = []
    worst = DiagnosticStatus.OK
    known = list(SHORT)
    for name in sorted(heard, key=lambda name: (known.index(name) if name in SHORT else len(known), name)):
        item, short = heard[name], SHORT.get(name, name)
        silent = wall - item.wall
        if silent > SILENT:
            lines += _wrapped('%s: SILENT for %.0f s' % (short, silent))
            worst = max(worst, DiagnosticStatus.ERROR)
        else:
            lines += _wrapped('%s: %s%s' % (short, _WORD[item.level], item.message))
            worst = max(worst, item.level)
    users: Dict[str, List[str]] = {}
    for name, item in heard.items():
        if item.values.get('calibration'):
            users.setdefault(item.values['calibration'], []).append(SHORT.get(name, name))
    for path, names in users.items():
        whose = ' of %s' % ', '.join(names) if len(users) > 1 else ''
        lines += _wrapped('calibration%s: %s' % (whose, path))
    return '\n'.join(lines), worst


_WORD = {DiagnosticStatus.OK: '', DiagnosticStatus.WARN: 'WARNING ', DiagnosticStatus.ERROR: 'ERROR '}


def _wrapped(words: str) -> List[str]:
    """Lines of WIDTH letters; the second and further ones are indented. A path is cut where it has to be."""
    lines, indent = [], ''
    while len(indent + words) > WIDTH:
        room = WIDTH - len(indent)
        at = max(words.rfind(' ', 1, room + 1), words.rfind('/', 1, room + 1))
        at = at if at > 0 else room
        lines.append(indent + words[:at])
        words, indent = words[at:].strip(), '    '
    return [*lines, indent + words]
