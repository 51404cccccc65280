"""What is known to stand on the road: obstacles over time, carried with the robot's motion, seen or not.

A report's obstacles have no names. Each known one takes the nearest reported one; what is reported and not known begins
anew. One that should be seen and is not is kept for a while, one that cannot be seen (too near, beside) until the robot
has passed it. One before the bumper that cannot be seen is never forgotten: nobody can see either that it has gone.
"""

import math
from dataclasses import dataclass, replace
from typing import List, Optional, Sequence, Tuple

import numpy as np

from obst_avoid.core.age import age
from obst_avoid.core.avoidance.settings import AvoidanceSettings, KnownSettings
from obst_avoid.core.geometry import lane_from_robot
from obst_avoid.core.motion import Motion, carried
from obst_avoid.core.types import Kind, LanePose, Obstacle, Stamped

LEAST_WATCHED, LEAST_LOOKS = 0.4, 5
"""Of the time watched, and how often: less of it tells no speed."""
ANOTHER_PLACE = 3.0
"""Standard deviations between a look and what was known, beyond which the latter is forgotten."""
CORRELATED = 2.0
"""Of a slope's error: looks that follow each other err alike."""


@dataclass(frozen=True)
class Known:
    """One obstacle. x, y: [m] middle of its footprint, robot frame, at the time of the whole. radius: [m].

    number: its name; no other known one has it. kind, in_lane: as last reported. seen, begun: [ns] stamps of the last
    and of the first report that had it. left, left_error: [m] of the lane's centre and standard deviation, over time;
    None: not yet. What stands keeps it, whatever the robot does. placed: [ns] stamp of the last look at it. lefts:
    (stamp [ns], left [m]) of single looks, the last while.
    """

    x: float
    y: float
    radius: float
    in_lane: Optional[bool]
    seen: int
    begun: int
    left: Optional[float] = None
    left_error: float = math.inf
    placed: int = 0
    lefts: Tuple[Tuple[int, float], ...] = ()
    kind: Optional[Kind] = None
    number: int = 0

    @property
    def obstacle(self) -> Obstacle:
        """As one of a report."""
        distance = math.hypot(self.x, self.y)
        nearer = max(distance - self.radius, 0.0) / max(distance, 1e-9)
        return Obstacle(self.kind, self.x * nearer, self.y * nearer, self.radius, self.in_lane)


def footprint_centre(obstacle: Obstacle) -> Tuple[float, float]:
    """Middle of an obstacle's footprint, (x, y) in m: one radius behind its nearest point, on the same ray."""
    distance = math.hypot(obstacle.x, obstacle.y)
    if distance < 1e-9:  # no direction: straight ahead
        return obstacle.radius, 0.0
    factor = 1 + obstacle.radius / distance
    return obstacle.x * factor, obstacle.y * factor


def moved(known: Sequence[Known], motion: Optional[Motion]) -> Tuple[Known, ...]:
    """Where they are after the robot has moved; None: nobody knows how it did, so they stay."""
    if motion is None:
        return tuple(known)
    places = [carried(motion, item.x, item.y) for item in known]
    return tuple(replace(item, x=x, y=y) for item, (x, y) in zip(known, places))


def reported(
    known: Sequence[Known],
    report: Stamped[Sequence[Obstacle]],
    lane: Optional[LanePose],
    settings: KnownSettings,
    unknown_way: float = 0.0,
) -> Tuple[Known, ...]:
    """What is known after one more report.

    known: carried to the report's stamp. lane: as our own lines show it before the robot then, None: they do not.
    unknown_way: [m] that the robot may have come since the report before, where nobody says how it moves.
    """
    centres = [footprint_centre(obstacle) for obstacle in report.value]
    pairs = sorted(
        (math.hypot(item.x - x, item.y - y), index, number)
        for index, item in enumerate(known)
        for number, (x, y) in enumerate(centres)
    )
    taken: List[int] = []
    after: List[Optional[Known]] = list(known)
    updated: List[int] = []
    for distance, index, number in pairs:
        x, y = centres[number]
        gate = settings.gate + settings.gate_growth * math.hypot(x, y) + unknown_way
        if distance > gate or index in updated or number in taken:
            continue
        updated.append(index)
        taken.append(number)
        after[index] = _seen(known[index], report.value[number], centres[number], report.stamp, settings)
    first = max((item.number for item in known), default=-1) + 1
    rest = sorted((centre, number) for number, centre in enumerate(centres) if number not in taken)
    new = []
    for rank, ((x, y), number) in enumerate(rest):
        one, at = report.value[number], report.stamp
        new.append(Known(x, y, one.radius, one.in_lane, at, at, kind=one.kind, number=first + rank))
    items = [item for item in after if item is not None] + new
    return tuple(
        _placed(item, report.stamp, lane, settings) if lane is not None and item.seen == report.stamp else item
        for item in items
    )


def remaining(known: Sequence[Known], now: int, moving: bool, settings: AvoidanceSettings) -> Tuple[Known, ...]:
    """Those that still count at now [ns]: not passed, not gone, and not out of sight for ever.

    moving: it is known how the robot moves, so that what is out of sight is passed some time.
    """
    return tuple(item for item in known if _remains(item, now, moving, settings))


def error_of(item: Known, settings: KnownSettings) -> float:
    """[m] standard deviation of its place across the line of sight."""
    return settings.position_error + settings.position_growth * math.hypot(item.x, item.y)


def left_speed(item: Known, settings: KnownSettings) -> float:
    """[m/s] towards the lane's left at which it moves; 0 as long as it may as well stand.

    The slope of a straight through where it was, by least squares; its error is by how much they scatter about it.
    """
    if len(item.lefts) < LEAST_LOOKS or age(item.lefts[0][0], item.lefts[-1][0]) < LEAST_WATCHED * settings.watch:
        return 0.0
    times = np.array([age(item.lefts[0][0], stamp) for stamp, _ in item.lefts])
    lefts = np.array([left for _, left in item.lefts])
    times = times - times.mean()
    spread = float(times @ times)
    slope = float(times @ lefts) / spread
    scatter = lefts - lefts.mean() - slope * times
    error = math.sqrt(float(scatter @ scatter) / (len(times) - 2) / spread) * CORRELATED
    moves = max(settings.moving, settings.moving_certainty * error) < abs(slope) < settings.fastest
    return slope if moves else 0.0


def _seen(item: Known, obstacle: Obstacle, centre: Tuple[float, float], stamp: int, settings: KnownSettings) -> Known:
    gain = settings.gain
    return replace(
        item,
        x=item.x + gain * (centre[0] - item.x),
        y=item.y + gain * (centre[1] - item.y),
        radius=item.radius + gain * (obstacle.radius - item.radius),
        in_lane=obstacle.in_lane,
        kind=obstacle.kind,
        seen=stamp,
    )


def _placed(item: Known, stamp: int, lane: LanePose, settings: KnownSettings) -> Known:
    """With one more look at its place in the lane: a Kalman filter of one number. What is too near to be seen is
    carried by whoever reports it, and tells no more about that.
    """
    if item.x < settings.near:
        return replace(item, lefts=())
    along, left = lane_from_robot(item.x, item.y, lane)
    bent = settings.shape_bend * along**2 / 2
    error = math.hypot(
        error_of(item, settings), math.hypot(settings.shape_error + settings.shape_direction * along, bent)
    )
    straight = abs(lane.curvature) < settings.watch_bend  # in a bend places in the lane change with its shape
    kept = tuple(old for old in item.lefts if age(old[0], stamp) <= settings.watch) if straight else ()
    item = replace(item, lefts=(*kept, (stamp, left)))
    if item.left is None:
        return replace(item, left=left, left_error=error, placed=stamp)
    if abs(left - item.left) > ANOTHER_PLACE * math.hypot(error, item.left_error):  # it has walked, or was mistaken
        return replace(item, left=left, left_error=error, placed=stamp)
    seconds = max(age(item.placed, stamp), 0.0)
    before = item.left_error**2 + settings.walking**2 * seconds
    noise = error**2 * max(1.0, 2 * settings.error_time / max(seconds, 1e-3))
    gain = before / (before + noise)
    return replace(
        item, left=item.left + gain * (left - item.left), left_error=math.sqrt((1 - gain) * before), placed=stamp
    )


def _remains(item: Known, now: int, moving: bool, settings: AvoidanceSettings) -> bool:
    unseen = age(item.seen, now)
    if item.x + item.radius < -settings.robot_behind:
        return False
    if in_sight(item, settings):
        return unseen <= settings.stop_hold
    if before_bumper(item, 0.0, settings):
        return True
    return unseen <= (settings.known.out_of_sight_moving if moving else settings.known.out_of_sight)


def in_sight(item: Known, settings: AvoidanceSettings) -> bool:
    """Whether it can be seen from here; things vanish at the picture's lower edge with their nearest point."""
    front = item.obstacle
    return front.x >= settings.known.near and abs(math.atan2(item.y, item.x)) < settings.known.view


def before_bumper(item: Known, overlap: float, settings: AvoidanceSettings) -> bool:
    """Whether its middle lies ahead of the bumper, and it reaches by more than overlap [m] into the robot's width."""
    return item.x > settings.robot_ahead and abs(item.y) - item.radius < settings.robot_width / 2 - overlap
