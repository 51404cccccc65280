"""How well the detector keeps track in a drive, against the truth: confirmed in time, lost, invented."""

import math
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Optional, Sequence, Tuple

from obst_avoid.core.types import Obstacle

NEAR = 1.0
"""[m] from the robot within which an obstacle has to be known."""
SAME, SAME_GROWTH = 0.1, 0.15
"""[m], and [m per m of distance], between what is reported and what is there."""


@dataclass(frozen=True)
class Sighting:
    """One obstacle so far.

    since: [s] of the first picture that showed it within NEAR. after: [s] from then until it was reported, None: not
    yet. lost: how often it was missing from a report after that, in view and near. seen: it is in the latest report.
    """

    since: float
    after: Optional[float] = None
    lost: int = 0
    seen: bool = False


@dataclass(frozen=True)
class Sightings:
    """Of one drive.

    of: by the obstacle's number. invented: how often the detector began to report what is not there. wrong: how many
    such things the latest report holds.
    """

    of: Dict[int, Sighting]
    invented: int = 0
    wrong: int = 0


def looked(
    before: Sightings,
    time: float,
    there: Sequence[Tuple[bool, Obstacle]],
    report: Sequence[Obstacle],
    in_view: Callable[[float, float], bool],
) -> Sightings:
    """The sightings after one more report.

    there: every obstacle of the drive, and whether it stands there now. in_view: by the camera's picture alone; what
    hides behind another one counts as missing.
    """
    numbers = [n for n, (here, _) in enumerate(there) if here or (n in before.of and before.of[n].seen)]  # just gone
    pairs = [numbers[index] for index in _paired([there[number][1] for number in numbers], report)]
    of = dict(before.of)
    for number, (here, obstacle) in enumerate(there):
        relevant = here and obstacle.x > 0 and math.hypot(obstacle.x, obstacle.y) <= NEAR
        if not relevant or not in_view(obstacle.x, obstacle.y):
            continue
        known, seen = of.get(number, Sighting(time)), number in pairs
        if known.after is None and seen:
            known = replace(known, after=time - known.since)
        of[number] = replace(known, seen=seen, lost=known.lost + (known.seen and not seen))
    wrong = len(report) - len(pairs)
    return Sightings(of, before.invented + max(wrong - before.wrong, 0), wrong)


def _paired(there: Sequence[Obstacle], report: Sequence[Obstacle]) -> List[int]:
    """Numbers of the obstacles that the report has, each reported one standing for the nearest."""
    distances = sorted(
        (math.hypot(true.x - one.x, true.y - one.y), number, index)
        for number, true in enumerate(there)
        for index, one in enumerate(report)
    )
    numbers: List[int] = []
    used: List[int] = []
    for distance, number, index in distances:
        reach = SAME + SAME_GROWTH * math.hypot(there[number].x, there[number].y)
        if distance <= reach and number not in numbers and index not in used:
            numbers.append(number)
            used.append(index)
    return numbers
