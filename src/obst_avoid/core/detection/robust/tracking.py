"""Tracking on the ground: what single pictures show becomes what stands on the road.

Things are associated in metres, with the robot's motion taken out. How sure a track is grows with time, not with the
number of pictures: pictures 33 ms apart show the same false blob. What is out of sight near the bumper is carried on
until the robot has passed it; what should be seen and is not dies within a fraction of a second.

Positions and their errors are kept along and across the ray from the robot: a picture tells the distance badly and the
direction well, and both turn with the robot.
"""

import functools
import math
from dataclasses import dataclass
from typing import Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple, Union

from obst_avoid.core.age import age
from obst_avoid.core.motion import Motion, carried
from obst_avoid.core.settings import number
from obst_avoid.core.types import Kind, Obstacle

Visible = Callable[[float, float], bool]
"""Whether a foot at x, y [m] is in the picture: inside the camera's view, and not below the lowest row."""

SUREST = 0.99
"""A single picture is never surer than this, nor surer of the opposite: its probability was learned on other roads."""
NEAREST = 0.05
"""[m] A foot nearer than this has no direction."""
RECOVERING = 0.5
"""Confidence of a sighting with which a track that counts may recover from a jump."""
COVERING = 0.5
"""Confidence of a sighting that may hide what stands behind it."""
LOOK_STEP = 0.03
"""[m] between two looks that are kept for the height: nearer ones have the same errors."""
MOST_LOOKS = 10
LEAST_SPREAD = 0.03
"""[m] standard deviation of the distances below which they tell nothing of the height."""


@dataclass(frozen=True)
class TrackingSettings:
    """config/obstacle_detection_node.yaml has values, units, reasons. command_delay: for who computes the motion."""

    longest_gap: float = number('s', above=0)
    command_delay: float = number('s', at_least=0)
    confirmed: float = number('probability', above=0.5, below=1)
    released: float = number('probability', above=0, below=1)
    forgotten: float = number('probability', above=0, below=0.5)
    first: float = number('probability', above=0, below=1)
    neutral: float = number('probability', above=0, below=1)
    missed: float = number('probability', above=0, below=1)
    looks: float = number('ratio', at_least=1)
    correlation_time: float = number('s', above=0)
    gate: float = number('standard deviations', above=0)
    reach: float = number('ratio', at_least=0)
    foot_error: float = number('m at 1 m', above=0)
    foot_error_least: float = number('m', above=0)
    across_error: float = number('rad', above=0)
    moved_error: float = number('ratio', at_least=0)
    bend_error: float = number('1/m', at_least=0)
    walking: float = number('m/s', at_least=0)
    unknown_speed: float = number('m/s', above=0)
    unknown_turn: float = number('rad/s', above=0)
    memory: float = number('s', above=0)
    unknown_side: float = number('ratio', at_least=0, at_most=1)
    overlap: float = number('ratio', above=0, at_most=1)
    hold: float = number('s', above=0)
    longest_hold: float = number('s', above=0)
    near: float = number('m', above=0)
    behind: float = number('m', above=0)
    height_row_error: float = number('rad', above=0)
    height_least: float = number('m', above=0)
    height_evidence: float = number('log-odds', at_least=0)


@dataclass(frozen=True)
class Sighting:
    """One thing in one picture. obstacle: its confidence is the probability that it is real, as far as a picture tells.

    top_distance: [m] where the line of sight over its top meets the road, from the robot frame's origin; inf at or
    above the horizon; None: not known. cut: its foot lies below the picture's lowest row: it is nearer than it seems.
    """

    obstacle: Obstacle
    top_distance: Optional[float] = None
    cut: bool = False


@dataclass(frozen=True)
class CameraPlace:
    """Of the camera, robot frame. ahead: [m] of the axle. height: [m] above the road."""

    ahead: float
    height: float


class Look(NamedTuple):
    """One look at a thing that the robot approaches, all [m] and from the road below the camera.

    driven: how much nearer it has come since the first look, by the robot's motion. foot, top: where the lines of sight
    to its foot and over its top meet the road.
    """

    driven: float
    foot: float
    top: float


@dataclass(frozen=True)
class Height:
    """A height estimate [m] and its standard deviation; slope: of top over foot, 1 for paint, and its deviation."""

    height: float
    error: float
    slope: float
    slope_error: float


class Votes(NamedTuple):
    """Sums of what pictures said, near ones more than far ones, fading with time. side_unknown: said nothing of it."""

    total: float
    duckie: float
    cone: float
    inside: float
    outside: float
    side_unknown: float


NO_VOTES = Votes(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Track(NamedTuple):
    """One thing over several pictures. A tuple: made anew in each picture, faster than a dataclass.

    x, y: [m] the point of its footprint nearest the robot now. along, across: [m] standard deviations of it, on the ray
    from the robot and across it. evidence: log-odds that it is real, without its height. height_evidence: log-odds on
    top. confirmed: it counts. born, seen, stamp: [ns] first picture with it, last one with it, last one.
    hidden: it was not seen in the last picture, and need not have been. adrift: [s] since it was last seen during which
    nobody knew how the robot moved. last: as it was last seen.
    to_left, to_right: as in Obstacle. looks, driven: for its height, see Look.
    """

    x: float
    y: float
    radius: float
    along: float
    across: float
    evidence: float
    height_evidence: float
    confirmed: bool
    votes: Votes
    born: int
    seen: int
    stamp: int
    hidden: bool
    adrift: float
    last: Obstacle
    to_left: Optional[float]
    to_right: Optional[float]
    looks: Tuple[Look, ...]
    driven: float

    @property
    def odds(self) -> float:
        """Log-odds that it is real."""
        return self.evidence + self.height_evidence


class _Shown(NamedTuple):
    """A sighting and what is often asked of it. along, across: [m] standard deviations of its foot."""

    sighting: Sighting
    x: float
    y: float
    radius: float
    distance: float
    confidence: float
    along: float
    across: float


class _Place(NamedTuple):
    """Where a track should be in a picture, and its errors there, as in Track.

    ahead, left: the direction of its ray, a unit vector. passed: it is behind the robot.
    """

    x: float
    y: float
    distance: float
    ahead: float
    left: float
    along: float
    across: float
    driven: Optional[float]
    passed: bool


def track(
    tracks: Sequence[Track],
    sightings: Sequence[Sighting],
    stamp: int,
    motion: Optional[Motion],
    visible: Visible,
    settings: TrackingSettings,
    camera: Optional[CameraPlace] = None,
) -> List[Track]:
    """Continue the tracks of the picture before with what the next one shows.

    stamp: [ns] of this picture. motion: of the robot since the picture before; None: not known. camera: None leaves the
    height from motion out. A gap longer than settings.longest_gap, or time that ran backwards, begins anew, but for
    what was out of sight near a robot whose motion is known.
    Returns the tracks, nearest first; which of them count says confirmed.
    """
    seconds = age(tracks[0].stamp, stamp) if tracks else 0.0
    if not 0 <= seconds <= settings.longest_gap:
        kept = 0 < seconds and motion is not None  # what stands before the bumper is still there after a hiccup
        tracks = [item for item in tracks if kept and item.confirmed and item.hidden and _near(item, settings)]
        seconds = seconds if tracks else 0.0
    share = 1 - math.exp(-seconds / settings.correlation_time)
    shown = _distinct(sightings, settings)
    places = [_place(item, motion, seconds, settings, camera) for item in tracks]
    found = _associated(places, shown, settings)
    _recover(found, tracks, places, shown, settings)
    after = [_continued(tracks[i], places[i], shown[j], stamp, share, settings, camera) for i, j in found.items()]
    seen = [shown[j] for j in found.values()]
    others = [_begun(one, stamp, settings) for j, one in enumerate(shown) if j not in found.values()]
    others += [
        _missed(item, places[i], stamp, share, seen, visible, settings)
        for i, item in enumerate(tracks)
        if i not in found and not places[i].passed
    ]
    after = [item for item in _without_doubles(after, others, settings) if _alive(item, stamp, settings)]
    return sorted(after, key=lambda item: (math.hypot(item.x, item.y), item.x, item.y))


def confirmed(tracks: Sequence[Track], settings: TrackingSettings) -> List[Obstacle]:
    """The tracks that count, nearest first, as they stand at the last picture.

    One that was not seen in it has no bird_box (bird_view.footprint_box makes one) and, if it is out of sight, no
    image_box; in sight, the image_box is where it was last seen.
    """
    obstacles = []
    for item in tracks:
        if item.confirmed:
            missing = item.seen != item.stamp
            obstacles.append(
                Obstacle(
                    Kind.CONE if item.votes.cone > item.votes.duckie else Kind.DUCKIE,
                    item.x,
                    item.y,
                    item.radius,
                    _side(item.votes, settings),
                    _probability(item.odds),
                    None if missing else item.last.bird_box,
                    None if item.hidden else item.last.image_box,
                    item.to_left,
                    item.to_right,
                )
            )
    return obstacles


def height_from_motion(looks: Sequence[Look], camera_height: float, row_error: float) -> Optional[Height]:
    """How high a thing is, by how its far end moves over the road while the robot approaches.

    camera_height: [m]. row_error: [rad] of a foot's and of a top's line of sight.
    The line of sight over a top of height H meets the road at camera_height / (camera_height - H) times the top's own
    distance: it runs ahead of the foot, while the far end of paint (H = 0) comes as near as its foot does. So the slope
    of the top's distance over the foot's tells the height, whatever the thing's length on the road. The foot's distance
    is taken from the robot's motion, and only the angle between foot and top from each picture: a nod of the camera
    moves both.
    Returns None where the looks are too few or too close to each other.
    """
    usable = [look for look in looks if look.foot > NEAREST and look.top >= look.foot]
    if len(usable) < 3:
        return None
    weights = [look.foot**-4 for look in usable]  # a row is more metres far away, with the square of the distance
    start = sum(w * (look.foot + look.driven) for w, look in zip(weights, usable)) / sum(weights)
    feet = [max(start - look.driven, NEAREST) for look in usable]
    tops = [
        1
        / max(1 / foot - 1 / look.foot + 1 / look.top, 0.1 / foot)  # not beyond 10 times the foot: the horizon is near
        for foot, look in zip(feet, usable)
    ]
    error = math.sqrt(2) * row_error / camera_height  # [1/m] of the difference between both ends' inverse distances
    line = tops
    for _ in range(2):  # the error of a top grows with its distance, which the line tells better than the top itself
        weights = [1 / (error * value * value) ** 2 for value in line]
        total = sum(weights)
        foot_mean = sum(w * foot for w, foot in zip(weights, feet)) / total
        top_mean = sum(w * top for w, top in zip(weights, tops)) / total
        spread = sum(w * (foot - foot_mean) ** 2 for w, foot in zip(weights, feet))
        if spread < LEAST_SPREAD**2 * total:
            return None
        slope = sum(w * (foot - foot_mean) * (top - top_mean) for w, foot, top in zip(weights, feet, tops)) / spread
        line = [max(top_mean + slope * (foot - foot_mean), foot) for foot in feet]
    slope_error = 1 / math.sqrt(spread)
    bounded = max(slope, 0.5)
    return Height(
        camera_height * (1 - 1 / bounded), camera_height * slope_error / bounded**2, slope, slope_error
    )  # fmt: skip


def evidence_of_height(height: Height, camera_height: float, settings: TrackingSettings) -> float:
    """Log-odds of a thing at least settings.height_least high against paint, within settings.height_evidence."""
    error = math.hypot(height.slope_error, 0.1)  # shapes change while one comes nearer: a tenth is nothing
    least = camera_height / (camera_height - min(settings.height_least, 0.9 * camera_height))
    against_paint = max(0.0, height.slope - 1) / error
    against_thing = max(0.0, least - height.slope) / error
    limit = settings.height_evidence
    return max(-limit, min(limit, (against_paint**2 - against_thing**2) / 2))


def _logit(probability: float) -> float:
    bounded = min(max(probability, 1 - SUREST), SUREST)
    return math.log(bounded / (1 - bounded))


_level = functools.lru_cache(maxsize=None)(_logit)
"""The same for the few probabilities of the settings."""


def _probability(odds: float) -> float:
    return 1 / (1 + math.exp(-odds))


def _gained(evidence: float, probability: float, share: float, settings: TrackingSettings) -> float:
    """The evidence after one more picture.

    It follows what pictures say with settings.correlation_time, towards what settings.looks independent pictures would
    say together: a blob that is half convincing stays so, however often it is seen.
    """
    goal = settings.looks * (_logit(probability) - _level(settings.neutral))
    return evidence + share * (goal - evidence)


def _errors(distance: float, settings: TrackingSettings) -> Tuple[float, float]:
    """[m] standard deviations of a foot in one picture, along the ray and across it."""
    return settings.foot_error_least + settings.foot_error * distance * distance, (
        settings.foot_error_least / 2 + settings.across_error * distance
    )


def _same_place(one: Union[_Shown, Track], other: Union[_Shown, Track], settings: TrackingSettings) -> bool:
    """Whether two feet may be one thing's: on nearly the same ray, as far apart on it as a foot's error may be."""
    x, y = one.x + other.x, one.y + other.y  # twice the middle
    length = math.hypot(x, y)
    dx, dy = other.x - one.x, other.y - one.y
    largest = max(one.radius, other.radius)
    if abs(dy * x - dx * y) > settings.overlap * largest * length:
        return False
    along, _ = _errors(length / 2, settings)
    return abs(dx * x + dy * y) <= 2 * (largest + along) * length


def _distinct(sightings: Sequence[Sighting], settings: TrackingSettings) -> List[_Shown]:
    """One sighting a thing: a detector may see a duckie and a cone in one blob. The surest counts."""
    shown = []
    for sighting in sightings:
        obstacle = sighting.obstacle
        distance = math.hypot(obstacle.x, obstacle.y)
        errors = _errors(distance, settings)
        shown.append(_Shown(sighting, obstacle.x, obstacle.y, obstacle.radius, distance, obstacle.confidence, *errors))
    shown.sort(key=lambda one: (-one.confidence, one.distance, one.x, one.y))
    kept: List[_Shown] = []
    for one in shown:
        for other in kept:
            if _same_place(one, other, settings):
                break
        else:
            kept.append(one)
    return kept


def _without_doubles(seen: Sequence[Track], others: Sequence[Track], settings: TrackingSettings) -> List[Track]:
    """One track a thing. seen: continued by a sighting each, so they are several things. Of the others, a track that
    stands where a surer one stands is the same thing; and where it is the surer one itself, the one seen there goes.
    Two that are out of sight were two when they were seen.
    """
    kept = list(seen)
    for item in sorted(others, key=lambda item: (-item.odds, item.born, item.x, item.y)):
        doubles = [other for other in kept if not (item.hidden and other.hidden) and _same_place(item, other, settings)]
        if not any(other.odds >= item.odds for other in doubles):
            kept = [other for other in kept if other not in doubles] if doubles else kept
            kept.append(item)
    return kept


def _place(
    item: Track, motion: Optional[Motion], seconds: float, settings: TrackingSettings, camera: Optional[CameraPlace]
) -> _Place:
    """Where a thing that stands still should be after the robot's motion, and how sure that is.

    What is out of sight is not taken to walk: with time its place would fit any blob that is in sight.
    """
    x, y, along, across = item.x, item.y, item.along, item.across
    before = max(math.hypot(x, y), NEAREST)
    growth = 0.0 if item.hidden else settings.walking * seconds
    driven: Optional[float] = None
    if motion is None:
        distance, ahead, left = before, x / before, y / before
        growth += settings.unknown_speed * seconds
        turned = settings.unknown_turn * seconds
    else:
        # its centre stands still; the point nearest the robot is one radius before it
        outwards = 1 + item.radius / before
        centre_x, centre_y = carried(motion, outwards * x, outwards * y)
        far = max(math.hypot(centre_x, centre_y), NEAREST)
        ahead, left = centre_x / far, centre_y / far
        distance = max(far - item.radius, NEAREST)
        x, y = distance * ahead, distance * left
        below = 0.0 if camera is None else camera.ahead
        driven = item.driven + math.hypot(item.x - below, item.y) - math.hypot(x - below, y)
        path = math.hypot(motion.x, motion.y)
        growth += settings.moved_error * path
        turned = settings.moved_error * abs(motion.turn) + settings.bend_error * path
        cos, sin = math.cos(motion.turn), math.sin(motion.turn)
        swung = (
            (cos * left + sin * ahead) * item.x - (cos * ahead - sin * left) * item.y
        ) / before  # sine of the angle
        if abs(swung) > 0.02:  # the ray has turned on the road: along and across mix
            part = min(swung * swung, 1.0)
            along, across = (
                math.sqrt((1 - part) * along * along + part * across * across),
                math.sqrt((1 - part) * across * across + part * along * along),
            )
    passed = x + item.radius * ahead < -settings.behind - item.radius
    return _Place(x, y, distance, ahead, left, along + growth, across + growth + turned * distance, driven, passed)


def _associated(places: Sequence[_Place], shown: Sequence[_Shown], settings: TrackingSettings) -> Dict[int, int]:
    """Which track continues with which sighting: nearest pairs first, in standard deviations; the kind may change."""
    pairs = []
    limit = settings.gate * settings.gate
    for i, place in enumerate(places):
        if place.passed:
            continue
        _, _, _, ahead, left, error_along, error_across, _, _ = place
        for j, (sighting, x, y, _, _, _, noise_along, noise_across) in enumerate(shown):
            dx, dy = x - place.x, y - place.y
            across = dy * ahead - dx * left
            off = across * across / (error_across * error_across + noise_across * noise_across)
            if off > limit:
                continue
            along = dx * ahead + dy * left
            if along < 0 or not sighting.cut:
                off += along * along / (error_along * error_along + noise_along * noise_along)
            if off <= limit:
                pairs.append((off, place.distance, i, j))
    pairs.sort()
    found: Dict[int, int] = {}
    taken = set()
    for _, _, i, j in pairs:
        if i not in found and j not in taken:
            found[i] = j
            taken.add(j)
    return found


def _recover(
    found: Dict[int, int],
    tracks: Sequence[Track],
    places: Sequence[_Place],
    shown: Sequence[_Shown],
    settings: TrackingSettings,
) -> None:
    """Associate what counts and is missing with a sighting that is nobody's, a little farther away than it should be:
    the wheels obey late, the camera nods, and a second track of one thing would be a second thing. But what stands
    beyond a line is not what stood in our lane. Adds to found.
    """
    missing = [i for i, item in enumerate(tracks) if item.confirmed and i not in found and not places[i].passed]
    if not missing:
        return
    taken = set(found.values())
    free = [j for j, one in enumerate(shown) if j not in taken and one.confidence >= RECOVERING]
    pairs = sorted(
        (math.hypot(shown[j].x - places[i].x, shown[j].y - places[i].y), places[i].distance, i, j)
        for i in missing
        for j in free
    )
    for off, distance, i, j in pairs:
        beside = shown[j].sighting.obstacle.in_lane is False and _side(tracks[i].votes, settings) is not False
        if off <= settings.reach * distance and not beside and i not in found and j not in taken:
            found[i] = j
            taken.add(j)


def _begun(one: _Shown, stamp: int, settings: TrackingSettings) -> Track:
    obstacle = one.sighting.obstacle
    return Track(
        x=obstacle.x,
        y=obstacle.y,
        radius=obstacle.radius,
        along=one.along,
        across=one.across,
        evidence=min(_logit(obstacle.confidence), _level(settings.first)),
        height_evidence=0.0,
        confirmed=False,
        votes=_voted(NO_VOTES, one, 0.0),
        born=stamp,
        seen=stamp,
        stamp=stamp,
        hidden=False,
        adrift=0.0,
        last=obstacle,
        to_left=obstacle.to_left,
        to_right=obstacle.to_right,
        looks=(),
        driven=0.0,
    )


def _continued(
    item: Track,
    place: _Place,
    one: _Shown,
    stamp: int,
    share: float,
    settings: TrackingSettings,
    camera: Optional[CameraPlace],
) -> Track:
    """The track after a picture that shows it: a Kalman filter along the ray and one across it."""
    sighting = one.sighting
    obstacle = sighting.obstacle
    trust = max(one.confidence, 0.1)  # what is hardly seen is badly placed
    dx, dy = one.x - place.x, one.y - place.y
    off_along, off_across = dx * place.ahead + dy * place.left, dy * place.ahead - dx * place.left
    clamped = sighting.cut and off_along > 0  # it tells only that the foot is nearer than the picture's lowest row
    off_along = 0.0 if clamped else off_along
    # a place that is off by more than its error can explain was not known as well as it seemed
    along, gain_along = _filtered(max(place.along, abs(off_along) / settings.gate), one.along, trust)
    across, gain_across = _filtered(max(place.across, abs(off_across) / settings.gate), one.across, trust)
    if clamped:
        along = place.along
    move_along, move_across = gain_along * off_along, gain_across * off_across
    x = place.x + move_along * place.ahead - move_across * place.left
    y = place.y + move_along * place.left + move_across * place.ahead
    keep = math.exp(-age(item.seen, stamp) / settings.memory)
    votes = item.votes if sighting.cut else _voted(item.votes, one, keep)
    weight = 0.0 if sighting.cut else 1 - keep * item.votes.total / votes.total
    driven = 0.0 if place.driven is None else place.driven
    looks, height_evidence = item.looks if place.driven is not None else (), item.height_evidence
    far = sighting.top_distance
    new = not looks or abs(driven - looks[-1].driven) >= LOOK_STEP
    if new and camera is not None and far is not None and not sighting.cut:
        reach = math.hypot(one.x - camera.ahead, one.y)  # from the road below the camera
        looks = (*looks[-MOST_LOOKS + 1 :], Look(driven, reach, reach + far - one.distance))
        height = height_from_motion(looks, camera.height, settings.height_row_error)
        if height is not None:
            height_evidence = evidence_of_height(height, camera.height, settings)
    evidence = _gained(item.evidence, one.confidence, share, settings)
    if not item.confirmed:  # weak sightings before a sure one do not hold it up
        evidence = max(evidence, min(_logit(one.confidence), _level(settings.first)))
    return Track(
        x=x,
        y=y,
        radius=item.radius + weight * (obstacle.radius - item.radius),
        along=along,
        across=across,
        evidence=evidence,
        height_evidence=height_evidence,
        confirmed=_counts(item.confirmed, evidence + height_evidence, settings),
        votes=votes,
        born=item.born,
        seen=stamp,
        stamp=stamp,
        hidden=False,
        adrift=0.0,
        last=obstacle,
        to_left=item.to_left if obstacle.to_left is None else obstacle.to_left,
        to_right=item.to_right if obstacle.to_right is None else obstacle.to_right,
        looks=looks,
        driven=driven,
    )


def _missed(
    item: Track,
    place: _Place,
    stamp: int,
    share: float,
    seen: Sequence[_Shown],
    visible: Visible,
    settings: TrackingSettings,
) -> Track:
    """The track after a picture that does not show it, which counts against it only where it should be seen."""
    hidden = not _in_sight(place, item.radius, visible) or any(
        _covers(other, place) for other in seen if other.confidence >= COVERING
    )
    evidence = item.evidence if hidden else _gained(item.evidence, settings.missed, share, settings)
    return Track(
        x=place.x,
        y=place.y,
        radius=item.radius,
        along=place.along,
        across=place.across,
        evidence=evidence,
        height_evidence=item.height_evidence,
        confirmed=item.confirmed and _counts(True, evidence + item.height_evidence, settings),
        votes=item.votes,
        born=item.born,
        seen=item.seen,
        stamp=stamp,
        hidden=hidden,
        adrift=item.adrift + (age(item.stamp, stamp) if place.driven is None else 0.0),
        last=item.last,
        to_left=item.to_left,
        to_right=item.to_right,
        looks=item.looks if place.driven is not None else (),
        driven=place.driven or 0.0,
    )


def _filtered(error: float, noise: float, trust: float) -> Tuple[float, float]:
    """Standard deviation after a measurement, and the measurement's share."""
    variance, noise_variance = error * error, noise * noise / trust
    gain = variance / (variance + noise_variance)
    return math.sqrt((1 - gain) * variance), gain


def _counts(before: bool, odds: float, settings: TrackingSettings) -> bool:
    """With hysteresis: it takes more to begin to count than to go on."""
    return odds >= _level(settings.released if before else settings.confirmed)


def _in_sight(place: _Place, radius: float, visible: Visible) -> bool:
    """Whether a foot is surely in the picture, its sides and its error included."""
    nearer = max(place.distance - 2 * place.along, NEAREST)
    aside = radius + 2 * place.across
    dx, dy = aside * place.left, aside * place.ahead
    return (
        visible(place.x, place.y)
        and visible(nearer * place.ahead, nearer * place.left)
        and visible(place.x + dx, place.y - dy)
        and visible(place.x - dx, place.y + dy)
    )


def _covers(one: _Shown, place: _Place) -> bool:
    """Whether a thing stands before the place and its image is in the way."""
    top = one.sighting.top_distance
    reach = 2 * one.distance if top is None else top
    return one.distance < place.distance < reach and abs(one.y * place.ahead - one.x * place.left) < one.radius


def _voted(votes: Votes, one: _Shown, keep: float) -> Votes:
    """Add what one picture says, weighted by its confidence and its nearness. keep: of what was said before."""
    obstacle, distance = one.sighting.obstacle, max(one.distance, 0.2)
    weight = max(one.confidence, 1 - SUREST) / (distance * distance)
    return Votes(
        keep * votes.total + weight,
        keep * votes.duckie + weight * (obstacle.kind is Kind.DUCKIE),
        keep * votes.cone + weight * (obstacle.kind is Kind.CONE),
        keep * votes.inside + weight * (obstacle.in_lane is True),
        keep * votes.outside + weight * (obstacle.in_lane is False),
        keep * votes.side_unknown + weight * (obstacle.in_lane is None),
    )


def _side(votes: Votes, settings: TrackingSettings) -> Optional[bool]:
    """Inside unless more says outside."""
    if settings.unknown_side * votes.side_unknown > max(votes.inside, votes.outside) or not (
        votes.inside or votes.outside
    ):
        return None
    return votes.inside >= votes.outside


def _alive(item: Track, stamp: int, settings: TrackingSettings) -> bool:
    """Out of sight, a thing near the robot is remembered as long as the robot's motion tells where it is."""
    if item.odds < _level(settings.forgotten):
        return False
    limit = settings.longest_hold if item.confirmed and _near(item, settings) else settings.hold
    return age(item.seen, stamp) <= limit and item.adrift <= settings.hold


def _near(item: Track, settings: TrackingSettings) -> bool:
    return math.hypot(item.x, item.y) < settings.near
