"""Our lane in one picture: which lines bound it, where the robot is in it, and on which side of them a thing stands.

Traffic keeps to the right: our lane has the yellow line on its left and a white line on its right. Colour alone does
not say which line is which in coloured light, so all that lines can be is weighed together: colour, width of the
tape, distance from and angle to each other, and where the robot would be.
"""

import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from obst_avoid.core.detection.robust.lines import WHITE_WIDTH, YELLOW_WIDTH, Line
from obst_avoid.core.types import LanePose

LANE_WIDTH, LANE_WIDTH_ERROR = 0.22, 0.02
"""[m] between the inner edges, and its standard deviation: Duckietown's rules allow 0.20 to 0.25 m."""
WIDTH_KEPT = 0.012
"""[m] standard deviation of a lane's width along the lane, once it is measured."""
BEND_UNKNOWN, BEND_KEPT = 0.6, 0.7
"""[1/m] and ratio of its curvature: so much may a line bend otherwise where it is not seen; over e m, that times e²."""
AIM_UNKNOWN = 0.04
"""[rad] error of a line's direction at its end, beyond what its crossings say."""
CALIBRATION_ERROR = 0.004, 0.012
"""[m] and [m per m ahead] standard deviation of any line's place, by the calibration and the tape's own."""
LARGEST_GAP = 1.0
"""[m] that a line is followed beyond what is seen of it."""
FARTHEST_BEGIN = 0.6
"""[m] from the robot at which a line may be seen first."""
TURN_LEFT = 0.28
"""[m] radius of the yellow line in a turn to the left, the sharpest."""
CORNER = 0.08
"""[m] before its end from which a right line may have turned right: it is a corner there, which our lane goes round."""
INSIDE, OUTSIDE = 1.0, 1.5
"""Standard deviations that a footprint has to be clear of a line; who says outside too early drives into it."""
JOIN_ASIDE, JOIN_ANGLE = 0.025, 0.25
"""[m], [rad]: so well has a curve to go on where another one ends, at no distance; both grow with the distance."""
JOIN_REACH = 0.35
"""[m] over which it may."""
CAMERA_AHEAD = 0.07
"""[m] of the camera before the axle, about; robots differ by a centimetre."""
RADIAL, SMEAR = 0.1, 0.3
"""[rad] from the ray away from the camera, and [m], within which a curve is taken for a thing that stands there."""
D_PRIOR, PHI_PRIOR = 0.07, 0.35
"""[m], [rad] standard deviations of where robots are in their lane."""
YELLOWNESS = 0.72
"""Blue against the rest, relative to the road's: between yellow, 0.1 to 0.6, and white, 0.85 to 1.1, in white light."""
CERTAIN = 4.0
"""Log-likelihood of a line being of one kind, beyond which it is not tried as the other."""
TWO_COLORS, TRUSTED_COUNT = 1.7, 8
"""Ratio of two lines' blueness that shows that one is white and one yellow; crossings that such lines have."""
TAPE_ERROR = 0.25
"""Of a tape's width: logarithm of its ratio to the true one; the calibration may be wrong."""
BEGIN_PRIOR = 0.25
"""[m] from the robot, about, that lines are seen; what begins farther away may be another road's."""
MOST_FOR_COUNTS = 4.0
"""What the counts of crossings say for two lines at most, see _lane; all else speaks against them."""
MANY = 15
"""Crossings of a line beyond which more of them say nothing more."""
LARGEST_D, LARGEST_PHI = 0.22, 1.0
"""[m], [rad] beyond which the answer is that it is not known."""
LEAST_SCORE = 0.5
"""Of a lane; log-likelihood."""
LANE_WIDTH_SEEN, NARROWEST_LANE, WIDEST_LANE = 0.03, 0.12, 0.36
"""[m] standard deviation of a lane's width as it is seen, by a wrong calibration too, and its bounds."""
ANGLE_BETWEEN = 0.15
"""[rad] standard deviation of the angle between the lines of a lane as they are seen."""
PHI_ERROR = 0.03
"""[rad] standard deviation of a line's direction that its crossings do not show."""
ALONE = 2.5
"""Cost of a lane of which one line only is seen."""


@dataclass(frozen=True, eq=False)
class Boundary:
    """One line that bounds our lane: its curves from near to far. half_width: [m] of the tape."""

    pieces: Tuple[Line, ...]
    half_width: float


@dataclass(frozen=True, eq=False)
class Lane:
    """Our lane in one picture.

    left, right: its lines, None if not seen. pose: of the robot in it, from the inner edges, with its covariance.
    width: [m] between the inner edges; width_error: its standard deviation. how: which lines it rests on. score: how
    much better it explains the picture than nothing, a log-likelihood.
    """

    left: Optional[Boundary]
    right: Optional[Boundary]
    pose: LanePose
    width: float
    width_error: float
    how: str
    score: float


@dataclass(frozen=True)
class Side:
    """Where a thing stands. in_lane: False when all of its footprint is beyond the inner edge of a line, None unknown.

    to_left, to_right: [m] from the footprint's edge to the inner edge of each line, positive inside the lane, None
    unknown. left_error, right_error: their standard deviations.
    """

    in_lane: Optional[bool]
    to_left: Optional[float]
    to_right: Optional[float]
    left_error: float = math.inf
    right_error: float = math.inf


def lane_of(lines: Sequence[Line]) -> Optional[Lane]:
    """The lane that explains the lines best; None when none does well enough."""
    chains = [chain for chain in _chains(lines) if chain[0].begin < FARTHEST_BEGIN]
    best: Optional[Lane] = None
    tapes = _tapes(chains)
    lefts = [None] + [index for index, tape in enumerate(tapes) if tape > -CERTAIN]
    rights = [None] + [index for index, tape in enumerate(tapes) if tape < CERTAIN]
    for left, right in ((left, right) for left in lefts for right in rights if left != right):
        score = (0.0 if left is None else tapes[left]) - (0.0 if right is None else tapes[right])
        if best is not None and score + MOST_FOR_COUNTS < best.score:
            continue  # whatever else speaks for it
        lane = _lane(None if left is None else chains[left], None if right is None else chains[right], score)
        if lane is not None and (best is None or lane.score > best.score):
            best = lane
    if best is None or best.score < LEAST_SCORE or abs(best.pose.d) > LARGEST_D or abs(best.pose.phi) > LARGEST_PHI:
        return None
    return best


def side_of(lane: Lane, x: float, y: float, radius: float) -> Side:
    """On which side of our lane's lines a thing stands.

    x, y: [m] the point of its footprint nearest the robot, robot frame; its centre is one radius farther on the ray.
    """
    farther = 1 + radius / max(math.hypot(x, y), 1e-3)
    x, y = farther * x, farther * y
    to_left, left_error = _to_edge(lane, x, y, left=True)
    to_right, right_error = _to_edge(lane, x, y, left=False)
    beyond = to_left + radius < -OUTSIDE * left_error or to_right + radius < -OUTSIDE * right_error
    within = to_left + radius > INSIDE * left_error and to_right + radius > INSIDE * right_error
    return Side(
        False if beyond else True if within else None,
        to_left - radius if math.isfinite(left_error) else None,
        to_right - radius if math.isfinite(right_error) else None,
        left_error,
        right_error,
    )


def _to_edge(lane: Lane, x: float, y: float, left: bool) -> Tuple[float, float]:
    """[m] of a point to a line's inner edge, positive on the lane's side, and its error, inf if unknown.

    From the line itself or, where that is not seen, from the other line and the lane's width.
    """
    own, other = (lane.left, lane.right) if left else (lane.right, lane.left)
    distance, error = 0.0, math.inf
    if own is not None:
        distance, error = _inside(own, x, y, left, lane.width)
    if other is not None:
        across, across_error = _inside(other, x, y, not left, lane.width)
        across_error = math.hypot(across_error, math.hypot(lane.width_error, WIDTH_KEPT))
        if across_error < error:
            distance, error = lane.width - across, across_error
    return distance, error


def _inside(boundary: Boundary, x: float, y: float, left: bool, lane_width: float) -> Tuple[float, float]:
    """[m] of a point to the inner edge of a boundary, and its error; by the piece that it lies beside."""
    piece = boundary.pieces[0]
    if len(boundary.pieces) > 1:
        piece = min(boundary.pieces, key=lambda one: 10 * _beyond(one, x, y) + abs(_right_of(one, x, y)))
    right_of, error = _right_of(piece, x, y), _error(piece, x, y)
    past = _past(piece, x, y) + AIM_UNKNOWN * abs(right_of)  # as far as the line's direction may be wrong
    if past > 0 and (past > TURN_LEFT or past**2 > -2 * TURN_LEFT * right_of > 0):
        error = max(error, -right_of)  # the road may have turned left, and our lane with it
    if past > -CORNER:
        error = max(error, right_of - (lane_width if left else 0.0))
    return (right_of if left else -right_of) - boundary.half_width, error


def _right_of(line: Line, x: float, y: float) -> float:
    """[m] of a point to the right of a curve, exactly."""
    f = line.a + line.b * x + line.c * (x * x + y * y) / 2 - y
    slope = math.sqrt(max(line.b**2 + 1 - 2 * line.a * line.c, 1e-6))
    return 2 * f / (slope + math.sqrt(max(slope * slope + 2 * line.c * f, 0.0)))


def _error(line: Line, x: float, y: float) -> float:
    """[m] standard deviation of _right_of: of the fit, and of what the line may do where it is not seen."""
    step = np.array([1.0, x, (x * x + y * y) / 2])
    fit = float(step @ line.covariance @ step)
    beyond = _beyond(line, x, y)
    if beyond > LARGEST_GAP:
        return math.inf
    constant, growth = CALIBRATION_ERROR
    return math.sqrt(fit + (constant + growth * x) ** 2 + (AIM_UNKNOWN * beyond + _bend_unknown(line) * beyond**2) ** 2)


def _bend_unknown(line: Line) -> float:
    """[1/m] standard deviation of a line's curvature where it is not seen: a bend may end, a straight may begin one."""
    return BEND_UNKNOWN + BEND_KEPT * abs(line.c)


def _beyond(line: Line, x: float, y: float) -> float:
    """[m] along the line from its nearest seen end to a point; 0 between the ends."""
    before = -_along(line, x - float(line.x[0]), y - float(line.y[0]), float(line.x[0]), float(line.y[0]))
    return max(_past(line, x, y), before, 0.0)


def _past(line: Line, x: float, y: float) -> float:
    """[m] along the line from its far end to a point; negative before it."""
    end_x, end_y = float(line.x[-1]), float(line.y[-1])
    return _along(line, x - end_x, y - end_y, end_x, end_y)


def _along(line: Line, dx: float, dy: float, x: float, y: float) -> float:
    """[m] of a step (dx, dy) in the curve's direction at (x, y)."""
    ahead, aside = 1 - line.c * y, line.b + line.c * x
    return (ahead * dx + aside * dy) / math.hypot(ahead, aside)


def _chains(lines: Sequence[Line]) -> List[Tuple[Line, ...]]:
    """Curves that go on as each other, from near to far: a road's line is straight and then bends."""
    rest = sorted(lines, key=lambda line: line.begin)
    chains = []
    while rest:
        chain = [rest.pop(0)]
        while True:
            following = [line for line in rest if _continues(chain[-1], line)]
            if not following:
                break
            chain.append(min(following, key=lambda line: abs(_right_of(chain[-1], float(line.x[0]), float(line.y[0])))))
            rest.remove(chain[-1])
        chains.append(tuple(chain))
    return chains


def _continues(near: Line, far: Line) -> bool:
    """Whether a curve is the same line's, farther on."""
    x, y = float(far.x[0]), float(far.y[0])
    gap = _beyond(near, x, y)
    if far.end <= near.end or gap > JOIN_REACH or _radial(far):
        return False
    if abs(_right_of(near, x, y)) > JOIN_ASIDE + 2 * gap**2 + 0.1 * gap:
        return False
    ahead, aside = 1 - near.c * y, near.b + near.c * x
    turn = math.atan2(far.b + far.c * x, 1 - far.c * y) - math.atan2(aside, ahead)
    return abs(turn) < JOIN_ANGLE + 3 * gap and (_yellow((near,)) > 0) == (_yellow((far,)) > 0)


def _radial(line: Line) -> bool:
    """Whether a short curve points away from the camera, as whatever stands upright is smeared on the road."""
    x, y = float(line.x[0]) - CAMERA_AHEAD, float(line.y[0])
    dx, dy = float(line.x[-1] - line.x[0]), float(line.y[-1] - line.y[0])
    length = math.hypot(dx, dy)
    return length < SMEAR and abs(x * dy - y * dx) < RADIAL * length * math.hypot(x, y)


def _yellow(chain: Sequence[Line], middle: float = YELLOWNESS, certainty: float = 2.0) -> float:
    """Log-likelihood of a line being yellow rather than white, by its colour and by the tape's width.

    middle: blueness of what is as likely yellow as white. certainty: the most that colour says.
    """
    count = sum(line.count for line in chain)
    blueness = sum(line.count * line.blueness for line in chain) / count
    by_color = max(-certainty, min(certainty, 8 * math.log(middle / max(blueness, 1e-3))))
    by_width = max(-3.0, min(3.0, 8 * math.log(math.sqrt(WHITE_WIDTH * YELLOW_WIDTH) / chain[0].width)))
    return by_color + by_width


def _tapes(chains: Sequence[Sequence[Line]]) -> List[float]:
    """_yellow of each line. Where one picture has two sorts of colour, they are compared with each other."""
    colors = [chain[0].blueness for chain in chains if chain[0].count >= TRUSTED_COUNT]
    low, high = min(colors, default=1.0), max(colors, default=1.0)
    if high > TWO_COLORS * low:
        return [_yellow(chain, math.sqrt(max(low * high, 1e-6)), 3.0) for chain in chains]
    return [_yellow(chain) for chain in chains]


@dataclass(frozen=True)
class _Estimate:
    """What one line says of the robot in its lane, by the curve through its nearest crossings.

    inside: [m] from the robot to the inner edge. phi: [rad]. curvature: [1/m] of the lane's middle. spread: variances
    of inside, phi and curvature, and the covariance of the robot's d and phi, by the crossings alone.
    """

    inside: float
    phi: float
    curvature: float
    spread: Tuple[float, float, float, float]


def _estimate(boundary: Boundary, left: bool, lane_width: float) -> _Estimate:
    """The curve goes on unchanged to the robot; what that may be wrong by is the same for both lines, see _pose."""
    line = boundary.pieces[0]
    sign = 1.0 if left else -1.0
    inside = sign * _right_of(line, 0.0, 0.0) - boundary.half_width
    slope = 1 + line.b**2
    curvature = line.c / math.sqrt(max(slope - 2 * line.a * line.c, 1e-6))
    curvature = curvature / max(1 + sign * curvature * (lane_width / 2 + boundary.half_width), 0.2)
    (aa, ab, _), (_, bb, _), (_, _, cc) = line.covariance.tolist()
    spread = aa / slope + CALIBRATION_ERROR[0] ** 2, bb / slope**2 + PHI_ERROR**2, cc, ab / slope**1.5
    return _Estimate(inside, -math.atan(line.b), curvature, spread)


def _lane(left: Optional[Sequence[Line]], right: Optional[Sequence[Line]], score: float) -> Optional[Lane]:
    """The lane between two lines, one of which may not be seen; None when it cannot be one.

    score: what the tapes' kinds say for it, a log-likelihood.
    """
    sides = [_boundary(left, YELLOW_WIDTH), _boundary(right, WHITE_WIDTH)]
    seen = [side for side in sides if side is not None]
    for side, tape in zip(sides, (YELLOW_WIDTH, WHITE_WIDTH)):
        if side is not None:
            near = side.pieces[0]
            score += min(near.count, MANY) / (MANY / 2) - 0.5 * (near.begin / BEGIN_PRIOR) ** 2
            score -= 0.5 * (math.log(near.width / tape) / TAPE_ERROR) ** 2
    width, width_error, how = LANE_WIDTH, LANE_WIDTH_ERROR, 'yellow line' if right is None else 'white line'
    if len(seen) == 2:
        width, width_error, how = _width_between(*seen), WIDTH_KEPT, 'both lines'
        if not NARROWEST_LANE < width < WIDEST_LANE:
            return None
        score -= 0.5 * ((width - LANE_WIDTH) / LANE_WIDTH_SEEN) ** 2
    else:
        score -= ALONE
    estimates = [_estimate(side, side is sides[0], width) for side in seen]
    begins = [side.pieces[0].begin for side in seen]
    score -= 0.5 * ((estimates[0].phi - estimates[-1].phi) / (ANGLE_BETWEEN + max(begins) - min(begins))) ** 2
    bend = max(_bend_unknown(side.pieces[0]) for side in seen)
    signs = [1.0 if side is sides[0] else -1.0 for side in seen]
    pose = _pose(estimates, signs, width, width_error, bend, min(begins))
    score -= 0.5 * (pose.d / D_PRIOR) ** 2 + 0.5 * (pose.phi / PHI_PRIOR) ** 2
    return Lane(sides[0], sides[1], pose, width, width_error, how, score)


def _boundary(chain: Optional[Sequence[Line]], tape: float) -> Optional[Boundary]:
    """A line as a bound of our lane. tape: [m] its width by the rules, which a wrong calibration changes somewhat."""
    if chain is None:
        return None
    return Boundary(tuple(chain), max(0.7 * tape, min(1.4 * tape, chain[0].width)) / 2)


def _width_between(left: Boundary, right: Boundary) -> float:
    """[m] between the inner edges where both lines are seen first."""
    one, other = left.pieces[0], right.pieces[0]
    at = int(np.abs(other.x - max(one.begin, other.begin)).argmin())
    return _right_of(one, float(other.x[at]), float(other.y[at])) - left.half_width - right.half_width


def _pose(
    estimates: Sequence[_Estimate], signs: Sequence[float], width: float, width_error: float, bend: float, begin: float
) -> LanePose:
    """The robot's pose from one line, or from two by the weight of what is known of each.

    signs: 1 of the left line, -1 of the right one. bend: [1/m] standard deviation of the lane's curvature over the
    first [m], begin, where no line is seen: there both lines err alike.
    """
    weights = 1 / np.array([estimate.spread[:3] for estimate in estimates])
    shares = (weights / weights.sum(axis=0)).tolist()
    d = phi = curvature = d_variance = phi_variance = both = 0.0
    for estimate, sign, (d_share, phi_share, bend_share) in zip(estimates, signs, shares):
        d += d_share * sign * (width / 2 - estimate.inside)
        phi += phi_share * estimate.phi
        curvature += bend_share * estimate.curvature
        d_variance += d_share**2 * estimate.spread[0]
        phi_variance += phi_share**2 * estimate.spread[1]
        both += d_share * phi_share * estimate.spread[3]
    if len(estimates) == 1:
        d_variance += (width_error / 2) ** 2
    d_variance += (bend * begin**2 / 2 + AIM_UNKNOWN * begin) ** 2
    phi_variance += (bend * begin) ** 2
    both -= bend**2 * begin**3 / 2
    return LanePose(d, phi, curvature, (d_variance, both, both, phi_variance))
