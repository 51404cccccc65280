"""What the fit means: each quantity as the file has it and as the lines show it, and what that does to obstacles."""

import math
from dataclasses import dataclass, replace
from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np

from obst_avoid.core.calibration import (
    Calibration,
    camera_from_robot,
    camera_position,
    camera_roll,
    horizon_row,
)
from obst_avoid.core.geometry import pixel_from_ground
from obst_avoid.core.types import Array
from obst_avoid.offline.calibration.fit import LANE_WIDTH, Correction, Fit, corrected_homography, fit, ground_or_far
from obst_avoid.offline.calibration.paint import WHITE_WIDTH, YELLOW_WIDTH, Line, find_lines, rows_of

ROUNDS = 2
"""Times that lines are looked for: the second time with what the first found, since a wrong scale hides lines."""
NEAR, FAR = 0.3, 0.6
"""[m] ahead where the effect on an obstacle is told."""
BEND = 1.5, 3.5
"""[px] of a picture 480 high by which lines may miss their fitted curves: more says that the lens model is wrong; much
more, that what was found is no lane. Own calibrations leave 0.3 to 1.2, another robot's lens 1.5 to 3."""
DRAWS = 100
"""Random corrections, drawn from their covariance, for the uncertainty of what follows from them."""

FITS, OFF, UNKNOWN = 'fits', 'off', 'unknown'
GOOD, BAD, UNCLEAR = 'fits', 'does not fit', 'not enough evidence'


@dataclass(frozen=True)
class Quantity:
    """One thing that was checked. file, seen, spread, tolerance: in unit; spread is one standard deviation.

    verdict: FITS, OFF or UNKNOWN.
    """

    name: str
    unit: str
    file: float
    seen: float
    spread: float
    tolerance: float
    verdict: str


@dataclass(frozen=True, eq=False)
class Check:
    """The whole answer. verdict: GOOD, BAD or UNCLEAR. reasons: sentences for a person.

    quantities: what was compared. obstacles: [(distance, dx, dy, spread_x, spread_y)] in m: an obstacle straight
    ahead at distance is reported dx farther and dy more to the left than it is. fit: None when no lane line was found.
    corrected: the calibration with the seen tilt and height, where the evidence suffices and something is off.
    lines: what was found in each picture.
    """

    verdict: str
    reasons: Tuple[str, ...]
    quantities: Tuple[Quantity, ...]
    obstacles: Tuple[Tuple[float, float, float, float, float], ...]
    fit: Optional[Fit]
    corrected: Optional[Calibration]
    lines: Tuple[Sequence[Line], ...]


def examine(calibration: Calibration, pictures: Sequence[Array]) -> Tuple[Optional[Fit], Tuple[Sequence[Line], ...]]:
    """Look for lines in pictures (H, W, 3) of the calibration's size, and fit the camera to them."""
    fitted: Optional[Fit] = None
    lines: List[Sequence[Line]] = []
    for _ in range(ROUNDS):
        correction = fitted.correction if fitted else Correction()
        trial = replace(calibration, homography=corrected_homography(calibration, correction))
        try:
            rows = rows_of(trial)
        except ValueError:  # the first round's answer looks away from the road
            break
        found = [find_lines(picture, rows, trial.homography) for picture in pictures]
        again = fit(calibration, found, correction)
        if again is None or (fitted is not None and len(again.edges.pixels) < len(fitted.edges.pixels)):
            break
        fitted, lines = again, list(found)
    return fitted, tuple(lines)


def judge(
    calibration: Calibration,
    fitted: Optional[Fit],
    lines: Tuple[Sequence[Line], ...] = (),
    yaw: Optional[Tuple[float, float]] = None,
) -> Check:
    """Compare what the file says with what was fitted. yaw: [rad] further left than in the file, and its spread."""
    if fitted is None:
        reason = 'no lane line was found in %d picture%s' % (len(lines), '' if len(lines) == 1 else 's')
        return Check(UNCLEAR, (reason,), (), (), None, None, lines)
    noise = fitted.noise * 480 / calibration.height
    if noise > BEND[1] or fitted.at_limit:
        reason = (
            'the lines found are no lane that a camera like this one can see (%.1f px apart, expected below %.1f)'
            % (noise, BEND[1])
            if noise > BEND[1]
            else 'the best fit lies at the edge of what is tried: 12 degrees of roll, 15 of pitch, 45 % of height'
        )
        return Check(UNCLEAR, (reason,), (), (), fitted, None, lines)
    quantities = _quantities(calibration, fitted, yaw)
    unknown = [item.name for item in quantities if item.verdict == UNKNOWN and item.name in MUST_BE_KNOWN]
    off = [item for item in quantities if item.verdict == OFF]
    reasons = []
    if off and not unknown:
        verdict = BAD
    elif unknown:
        verdict = UNCLEAR
        reasons.append('%s cannot be told from these pictures' % _listed(unknown))
    else:
        verdict = GOOD
    reasons += [_sentence(item) for item in off if item.name in CAMERA] if verdict == BAD else []
    if BEND[0] < noise <= BEND[1]:
        reasons.append(
            'lines miss their curves by %.1f px (expected below %.1f): the intrinsic file does not quite fit '
            'this lens, or the road is not flat' % (noise, BEND[0])
        )
    corrected = None
    if verdict == BAD:
        correction = replace(fitted.correction, yaw=yaw[0] if yaw and _verdict(yaw[0], yaw[1], YAW) == OFF else 0.0)
        corrected = replace(calibration, homography=corrected_homography(calibration, correction))
    obstacles = () if verdict == UNCLEAR else _obstacles(calibration, fitted, yaw)
    return Check(verdict, tuple(reasons), quantities, obstacles, fitted, corrected, lines)


ROLL, PITCH, HEIGHT, YAW = math.radians(1.0), math.radians(0.7), 0.06, math.radians(1.5)
"""What a calibration may be off: each moves an obstacle at 0.6 m by at most 4 cm, a fifth of a lane."""
MUST_BE_KNOWN = ('roll', 'pitch', 'camera height')
CAMERA = (*MUST_BE_KNOWN, 'yaw')
"""What a calibration can be corrected in; the other quantities follow from these."""


def _quantities(calibration: Calibration, fitted: Fit, yaw: Optional[Tuple[float, float]]) -> Tuple[Quantity, ...]:
    """Everything that is compared, the camera's own angles first."""
    best = _with(calibration, fitted.correction)
    draws = [_with(calibration, drawn) for drawn in _draws(fitted)]
    lanes = np.random.RandomState(3).normal(fitted.lane[0], fitted.lane[1], DRAWS)
    lane = fitted.lane[0]

    def compared(
        name: str, unit: str, factor: float, value: Callable[[Calibration], float], tolerance: float
    ) -> Quantity:
        """A quantity of the camera: from its calibration, in radians or metres."""
        file, seen = value(calibration), value(best)
        spread = float(np.std([value(drawn) for drawn in draws]))
        verdict = _verdict(seen - file, spread, tolerance)
        return Quantity(name, unit, file * factor, seen * factor, spread * factor, tolerance * factor, verdict)

    def shown(
        name: str, unit: str, value: Callable[[Calibration, float], float], right: float, tolerance: float
    ) -> Quantity:
        """A quantity of the road: what it is, beside what the file's bird view makes of it."""
        file = value(best, lane)
        spread = float(np.std([value(drawn, other) for drawn, other in zip(draws, lanes)]))
        return Quantity(name, unit, file, right, spread, tolerance, _verdict(file - right, spread, tolerance))

    def width(name: str, x: float, y: float, wide: float, tolerance: float) -> Quantity:
        """A width across the road; 0 for the lane's."""
        return shown(
            name, 'm', lambda seen, drawn: _width(calibration, seen, x, y, wide or drawn), wide or lane, tolerance
        )

    degrees, half = 180 / math.pi, LANE_WIDTH / 2
    height = float(camera_position(calibration)[2])
    quantities = [
        compared('roll', 'deg', degrees, camera_roll, ROLL),
        compared('pitch', 'deg', degrees, camera_pitch, PITCH),
        compared('camera height', 'm', 1.0, lambda item: float(camera_position(item)[2]), HEIGHT * height),
    ]
    if yaw is not None:
        file = camera_yaw(calibration)
        values = (value * degrees for value in (file, file + yaw[0], yaw[1], YAW))
        quantities.append(Quantity('yaw', 'deg', *values, verdict=_verdict(yaw[0], yaw[1], YAW)))
    rows = calibration.projection[1, 1] * PITCH / math.cos(camera_pitch(calibration)) ** 2
    return (
        *quantities,
        compared('horizon row', 'px', 1.0, lambda item: horizon_row(item.homography, item.width / 2), rows),
        width('lane width at %.1f m' % NEAR, NEAR, 0.0, 0.0, 0.1 * LANE_WIDTH),
        width('lane width at %.1f m' % FAR, FAR, 0.0, 0.0, 0.1 * LANE_WIDTH),
        width('white tape at %.1f m' % NEAR, NEAR, -half, WHITE_WIDTH, 0.1 * WHITE_WIDTH),
        width('yellow tape at %.1f m' % NEAR, NEAR, half, YELLOW_WIDTH, 0.1 * YELLOW_WIDTH),
        shown('angle between the lines', 'deg', lambda seen, drawn: _converging(calibration, seen, drawn), 0.0, 2.5),
    )


def camera_pitch(calibration: Calibration) -> float:
    """[rad] by which the camera looks down."""
    return float(math.asin(-camera_from_robot(calibration)[0][2, 2]))


def camera_yaw(calibration: Calibration) -> float:
    """[rad] by which the camera looks to the left of the robot's front."""
    axis = camera_from_robot(calibration)[0][2]
    return float(math.atan2(axis[1], axis[0]))


def _with(calibration: Calibration, correction: Correction) -> Calibration:
    return replace(calibration, homography=corrected_homography(calibration, correction))


def _draws(fitted: Fit) -> List[Correction]:
    """Corrections as they may be as well, by the fit's covariance."""
    mean = (fitted.correction.roll, fitted.correction.pitch, fitted.correction.height)
    drawn = np.random.RandomState(2).multivariate_normal(mean, fitted.covariance, DRAWS)
    return [Correction(roll, pitch, 0.0, max(height, 0.2)) for roll, pitch, height in drawn]


def _misplaced(file: Calibration, seen: Calibration, ground: Array) -> Array:
    """Where the file puts (N, 2) true road points, if the camera really is as seen."""
    return ground_or_far(file.homography, pixel_from_ground(seen.homography, ground))


def _width(file: Calibration, seen: Calibration, x: float, y: float, width: float) -> float:
    """[m] that the file makes of a width across the road, about a point of it."""
    sides = _misplaced(file, seen, np.array([[x, y + width / 2], [x, y - width / 2]]))
    return float(np.hypot(*(sides[0] - sides[1])))


def _converging(file: Calibration, seen: Calibration, lane: float) -> float:
    """[deg] by which the file makes the lane's two lines converge ahead."""
    half = lane / 2
    left, right = (_misplaced(file, seen, np.array([[NEAR, y], [FAR, y]])) for y in (half, -half))
    angles = [math.atan2(line[1, 1] - line[0, 1], line[1, 0] - line[0, 0]) for line in (left, right)]
    return math.degrees(angles[1] - angles[0])


def _obstacles(
    calibration: Calibration, fitted: Fit, yaw: Optional[Tuple[float, float]]
) -> Tuple[Tuple[float, float, float, float, float], ...]:
    """By how much the file misplaces obstacles straight ahead."""
    turn, turn_spread = yaw or (0.0, 0.0)
    turns = np.random.RandomState(4).normal(turn, turn_spread, DRAWS)
    best = _with(calibration, replace(fitted.correction, yaw=turn))
    draws = [_with(calibration, replace(item, yaw=other)) for item, other in zip(_draws(fitted), turns)]
    found = []
    for distance in (NEAR, FAR):
        ground = np.array([[distance, 0.0]])
        moved = _misplaced(calibration, best, ground) - ground
        spread = np.std([_misplaced(calibration, drawn, ground)[0] for drawn in draws], axis=0)
        found.append((distance, *(float(value) for value in (*moved[0], *spread))))
    return tuple(found)


def _verdict(difference: float, spread: float, tolerance: float) -> str:
    """OFF beyond the tolerance, when it is sure; FITS when the answer is sharp enough to say so."""
    if abs(difference) > max(tolerance, 2 * spread):
        return OFF
    return FITS if abs(difference) <= tolerance and spread <= tolerance else UNKNOWN


def _sentence(item: Quantity) -> str:
    return '%s: the file has %s, the lines show %s' % (item.name, number(item, item.file), number(item, item.seen))


def number(item: Quantity, value: float) -> str:
    """A value of a quantity as a person reads it."""
    digits = {'deg': 1, 'px': 0, 'm': 3}[item.unit]
    rounded = round(value, digits) + 0.0  # no minus before a zero
    return '%.*f %s' % (digits, rounded, 'degrees' if item.unit == 'deg' else item.unit)


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else '%s and %s' % (', '.join(words[:-1]), words[-1])
