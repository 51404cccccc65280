"""What rviz shows: obstacles, the region in which they count, the path chosen. Stamped, in the robot frame."""

from typing import Any, Dict, Sequence

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from obst_avoid.core.avoidance.corridor import View
from obst_avoid.core.avoidance.known import footprint_centre
from obst_avoid.core.types import Array, Decision, Obstacle, State
from obst_avoid.ros.border import BorderError, ros_time

RED, GREEN = ColorRGBA(0.9, 0.1, 0.1, 0.9), ColorRGBA(0.1, 0.8, 0.2, 0.9)
YELLOW, BLUE = ColorRGBA(1.0, 0.8, 0.0, 1.0), ColorRGBA(0.2, 0.5, 1.0, 1.0)
PALE = ColorRGBA(0.75, 0.9, 0.75, 1.0)
REASON_PLACE, REASON_LETTERS = (-0.1, 0.0, 0.0), 0.026
HEALTH_PLACE, HEALTH_LETTERS = (-0.34, 0.0, 0.0), 0.016
"""[m] Behind the robot, where no road is hidden, and the height of the letters."""
HEIGHT = 0.06
"""[m] of an obstacle's cylinder; the detector does not measure heights."""
RIM = 0.04
"""[m] that the disc under the obstacle that decides is wider than it."""
LIFETIME = 1.0
"""[s] after which rviz drops a marker when its publisher died."""
HEALTH_LIFETIME = 5.0
"""[s] The same for what is said once a second."""
STATE_COLOR = {State.CLEAR: GREEN, State.SLOWING: YELLOW, State.AVOIDING: YELLOW, State.STOPPED: RED, State.FAULT: RED}


def markers_from_obstacles(obstacles: Sequence[Obstacle], shown_before: int, stamp: int, frame_id: str) -> MarkerArray:
    """One cylinder an obstacle, red inside our lane, green outside, its diameter true; as many as were shown before and
    are not any more are deleted.
    """
    header = Header(stamp=ros_time(stamp), frame_id=frame_id)
    markers = []
    for i, obstacle in enumerate(obstacles):
        x, y = footprint_centre(obstacle)
        marker = _marker(header, 'obstacles', i, Marker.CYLINDER, GREEN if obstacle.in_lane is False else RED)
        marker.pose.position = Point(x, y, HEIGHT / 2)
        marker.scale = Vector3(2 * obstacle.radius, 2 * obstacle.radius, HEIGHT)
        markers.append(marker)
    markers += [_deleted(header, 'obstacles', i) for i in range(len(obstacles), shown_before)]
    return MarkerArray(markers)


def markers_from_decision(decision: Decision, view: View, stamp: int, frame_id: str) -> MarkerArray:
    """The corridor in which obstacles count, the path chosen, the obstacle that decides, and the reason as text."""
    header = Header(stamp=ros_time(stamp), frame_id=frame_id)
    color = STATE_COLOR[decision.state]
    region = _line(header, 'region', color, view.region)
    path = _line(header, 'path', BLUE, view.way)
    reason = _marker(header, 'reason', 0, Marker.TEXT_VIEW_FACING, color)
    reason.pose.position = Point(*REASON_PLACE)
    reason.scale.z = REASON_LETTERS
    reason.text = '%s\n%s' % (decision.state.name, decision.reason.replace(', ', ',\n'))
    if view.deciding is None:
        return MarkerArray([region, path, reason, _deleted(header, 'deciding', 0)])
    x, y, radius = view.deciding
    deciding = _marker(header, 'deciding', 0, Marker.CYLINDER, color)
    deciding.color = ColorRGBA(color.r, color.g, color.b, 0.4)
    deciding.pose.position = Point(x, y, 0.002)
    deciding.scale = Vector3(2 * radius + RIM, 2 * radius + RIM, 0.004)
    return MarkerArray([region, path, reason, deciding])


def markers_from_health(words: str, level: int, frame_id: str) -> MarkerArray:
    """How the nodes are, as text behind the robot, in the colour of the worst. level: as in DiagnosticStatus."""
    color = RED if level >= DiagnosticStatus.ERROR else YELLOW if level == DiagnosticStatus.WARN else PALE
    marker = _marker(Header(frame_id=frame_id), 'health', 0, Marker.TEXT_VIEW_FACING, color)  # stamp 0: always valid
    marker.pose.position = Point(*HEALTH_PLACE)
    marker.scale.z = HEALTH_LETTERS
    marker.lifetime = rospy.Duration(HEALTH_LIFETIME)
    marker.text = words
    return MarkerArray([marker])


def view_from_markers(msg: MarkerArray) -> View:
    """The inverse of markers_from_decision, as to what it shows. Raises BorderError."""
    shown = _shown(msg)
    deciding = None
    if 'deciding' in shown:
        at, radius = shown['deciding'].pose.position, (shown['deciding'].scale.x - RIM) / 2
        deciding = (at.x, at.y, radius)
        _require_finite('deciding', deciding)
    return View(_points_of(shown['region']), _points_of(shown['path']), deciding)


def state_from_markers(msg: MarkerArray) -> State:
    """The inverse of markers_from_decision, as to the decision's state. Raises BorderError."""
    name = _shown(msg)['reason'].text.split('\n')[0]
    if name not in State.__members__:
        raise BorderError('the markers have state %r, expected one of: %s' % (name, ', '.join(State.__members__)))
    return State[name]


def reason_from_markers(msg: MarkerArray) -> str:
    """The inverse of markers_from_decision, as to the decision's reason, on one line. Raises BorderError."""
    return ' '.join(_shown(msg)['reason'].text.split('\n')[1:])


def _shown(msg: MarkerArray) -> Dict[str, Marker]:
    """The markers of a decision by namespace, without those that are deleted."""
    shown = {marker.ns: marker for marker in msg.markers if marker.action == Marker.ADD}
    missing = [name for name in ('region', 'path', 'reason') if name not in shown]
    if missing:
        raise BorderError('the markers have no %s, expected a decision' % missing[0])
    return shown


def _points_of(marker: Marker) -> Array:
    """(N, 2) [m] columns x, y."""
    points = np.array([(point.x, point.y) for point in marker.points], dtype=np.float64).reshape(-1, 2)
    _require_finite(marker.ns, points)
    return points


def _require_finite(name: str, numbers: Any) -> None:
    if not np.isfinite(numbers).all():
        raise BorderError('the marker %s has numbers that are none, expected finite ones' % name)


def _marker(header: Header, namespace: str, identity: int, shape: int, color: ColorRGBA) -> Marker:
    return Marker(
        header=header,
        ns=namespace,
        id=identity,
        type=shape,
        action=Marker.ADD,
        pose=Pose(Point(), Quaternion(0, 0, 0, 1)),
        color=color,
        lifetime=rospy.Duration(LIFETIME),
    )


def _deleted(header: Header, namespace: str, identity: int) -> Marker:
    return Marker(header=header, ns=namespace, id=identity, action=Marker.DELETE)


def _line(header: Header, namespace: str, color: ColorRGBA, points: Array) -> Marker:
    marker = _marker(header, namespace, 0, Marker.LINE_STRIP, color)
    marker.scale.x = 0.006
    marker.points = [Point(x, y, 0.003) for x, y in points.tolist()]
    return marker
