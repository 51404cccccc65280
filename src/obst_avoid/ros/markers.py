"""What rviz shows: obstacles, the region in which they count, the path chosen. Stamped, in the robot frame."""

from typing import List, Sequence, Tuple

import rospy
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from obst_avoid.core.avoidance.region import footprint_centre, region_outline
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.geometry import robot_from_lane
from obst_avoid.core.types import Decision, LanePose, Obstacle, State
from obst_avoid.ros.border import ros_time

RED, GREEN = ColorRGBA(0.9, 0.1, 0.1, 0.9), ColorRGBA(0.1, 0.8, 0.2, 0.9)
YELLOW, BLUE = ColorRGBA(1.0, 0.8, 0.0, 1.0), ColorRGBA(0.2, 0.5, 1.0, 1.0)
HEIGHT = 0.06
"""[m] of an obstacle's cylinder; the detector does not measure heights."""
LIFETIME = 1.0
"""[s] after which rviz drops a marker when its publisher died."""
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


def markers_from_decision(
    decision: Decision, pose: LanePose, settings: AvoidanceSettings, stamp: int, frame_id: str
) -> MarkerArray:
    """The region in which obstacles count, the path chosen, the obstacle that decides, and the reason as text."""
    header = Header(stamp=ros_time(stamp), frame_id=frame_id)
    color = STATE_COLOR[decision.state]
    outline = region_outline(settings)
    region = _line(header, 'region', color, [*outline, outline[0]])
    path = _line(
        header, 'path', BLUE, [robot_from_lane(x, decision.d_ref, pose) for x in (0.0, 0.25, settings.box_length)]
    )
    reason = _marker(header, 'reason', 0, Marker.TEXT_VIEW_FACING, color)
    reason.pose.position = Point(-0.1, 0.0, 0.1)
    reason.scale.z = 0.025
    reason.text = '%s\n%s' % (decision.state.name, decision.reason.replace(', ', ',\n'))
    if decision.obstacle is None:
        return MarkerArray([region, path, reason, _deleted(header, 'deciding', 0)])
    x, y = footprint_centre(decision.obstacle)
    deciding = _marker(header, 'deciding', 0, Marker.CYLINDER, color)
    deciding.color = ColorRGBA(color.r, color.g, color.b, 0.4)
    deciding.pose.position = Point(x, y, 0.002)
    width = 2 * (decision.obstacle.radius + settings.margin)
    deciding.scale = Vector3(width, width, 0.004)
    return MarkerArray([region, path, reason, deciding])


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


def _line(header: Header, namespace: str, color: ColorRGBA, points: List[Tuple[float, float]]) -> Marker:
    marker = _marker(header, namespace, 0, Marker.LINE_STRIP, color)
    marker.scale.x = 0.006
    marker.points = [Point(x, y, 0.003) for x, y in points]
    return marker
