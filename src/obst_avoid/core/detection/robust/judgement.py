"""Which regions are things that stand on the road, which kind they are, where their foot is and how wide they are."""

from dataclasses import dataclass
from typing import List

import numpy as np

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust import trees
from obst_avoid.core.detection.robust.features import NAMES
from obst_avoid.core.detection.robust.settings import RobustSettings
from obst_avoid.core.detection.robust.view import View
from obst_avoid.core.geometry import rectified_from_image
from obst_avoid.core.types import Array, Box, Kind

MOST_PROMISING = 250
"""Regions on which everything is measured, the best ones: so a picture full of blobs takes no longer than any."""
MOST = 40
"""Candidates that are looked at further, the best ones: more things do not fit on a road."""
LEAST_RADIUS, MOST_RADIUS = 0.01, 0.12
"""[m] of anything that stands on the road as an obstacle."""


@dataclass(frozen=True)
class Candidate:
    """A region that may be a thing.

    box: [px] in the camera picture. confidence: probability that it is one, as far as one picture tells. x, y: [m] the
    point of its footprint nearest the robot. radius: [m]. top_distance: [m] on the road under the line of sight over
    its top, inf above the horizon. cut: its foot is below the picture. row: its number among the promising regions.
    """

    kind: Kind
    box: Box
    confidence: float
    x: float
    y: float
    radius: float
    top_distance: float
    cut: bool
    row: int


def promising(quick: Array) -> Array:
    """Numbers, (M,) int, of the regions that deserve a closer look. quick: (N, len(QUICK)) of measure_all."""
    odds = trees.summed(trees.shipped()['first'], quick)
    chosen: Array = np.flatnonzero(odds > -np.inf)
    if len(chosen) > MOST_PROMISING:
        chosen = np.sort(chosen[np.argpartition(-odds[chosen], MOST_PROMISING)[:MOST_PROMISING]])
    return chosen


def judge(box: Array, values: Array, view: View, calibration: Calibration, settings: RobustSettings) -> List[Candidate]:
    """The regions with at least weak confidence that do not lie on a better one, best first.

    box: (M, 4) of Regions.box. values: (M, F) of measure. calibration: of the camera picture.
    """
    least = settings.weak_confidence
    forests = trees.shipped()
    odds = trees.summed(forests['thing'], values)
    chosen = _best(box, odds, float(np.log(least / (1 - least))), settings.overlap)
    if not chosen:
        return []
    box, rows = box[chosen], values[chosen]
    cone = trees.summed(forests['cone'], rows)
    foot = box[:, 1] + box[:, 3] * (1 + np.clip(trees.summed(forests['foot'], rows), -0.5, 0.5))
    cut = box[:, 1] + box[:, 3] >= view.height
    foot = np.where(cut, box[:, 1] + box[:, 3], foot)
    middle = box[:, 0] + box[:, 2] / 2
    pixels = np.concatenate([np.column_stack([middle, foot]), np.column_stack([middle, box[:, 1]])])
    ground = _ground(pixels * view.scale - 0.5, calibration)
    (feet, tops) = ground[: len(box)], ground[len(box) :]
    ahead = rows[:, NAMES.index('ahead')]
    seen_width = rows[:, NAMES.index('width')] / ahead * np.where(cut, ahead, feet[:, 0])
    radius = np.clip(seen_width / 2 * 2.0 ** trees.summed(forests['radius'], rows), LEAST_RADIUS, MOST_RADIUS)
    confidence = 1 / (1 + np.exp(-odds[chosen]))
    found = []
    for index, region in enumerate(chosen):
        if not 0 < feet[index, 0] <= settings.farthest:
            continue  # above the horizon it stands nowhere on the road
        left, top, width, height = (float(value) * view.scale for value in box[index])
        found.append(
            Candidate(
                Kind.CONE if cone[index] > 0 else Kind.DUCKIE,
                Box(left, top, left + width, top + height),
                float(confidence[index]),
                float(feet[index, 0]),
                float(feet[index, 1]),
                float(radius[index]),
                float(np.hypot(*tops[index])),
                bool(cut[index]),
                region,
            )
        )
    return found


def _best(box: Array, odds: Array, least: float, overlap: float) -> List[int]:
    """Greedy: the best region, then the best that does not lie on it, and so on."""
    order = np.argsort(-odds, kind='stable')
    order = order[odds[order] >= least]
    kept: List[int] = []
    low, high = box[:, :2], box[:, :2] + box[:, 2:]
    area = box[:, 2] * box[:, 3]
    free = np.ones(len(order), dtype=bool)
    for at, index in enumerate(order):
        if not free[at]:
            continue
        kept.append(int(index))
        if len(kept) == MOST:
            break
        common = np.minimum(high[order], high[index]) - np.maximum(low[order], low[index])
        shared = np.prod(np.maximum(common, 0), axis=1)
        free &= shared <= overlap * np.minimum(area[order], area[index])
    return kept


def _ground(pixels: Array, calibration: Calibration) -> Array:
    """(N, 2) pixels of the camera picture to (N, 2) x, y in m; inf at and above the horizon."""
    rectified = rectified_from_image(calibration, pixels)
    points = np.column_stack([rectified, np.ones(len(rectified))]) @ calibration.homography.T
    with np.errstate(divide='ignore', invalid='ignore'):
        ground: Array = np.where(points[:, 2:] > 1e-9, points[:, :2] / points[:, 2:], np.inf)
    return ground
