"""Which detection belongs to which label: the rules of real/tools/score.py, one picture at a time, pure.

Boxes are (left, top, width, height) in pixels of the picture as it came. A label is relevant, or ignored for a reason;
a detection is a hit, or one of STATES. docs/evaluation.md explains the rules.
"""

import math
from dataclasses import dataclass
from typing import Callable, Dict, List, Optional, Sequence, Set, Tuple

import numpy as np

from obst_avoid.core.types import Kind

Rectangle = Tuple[float, float, float, float]
"""left, top, width, height [px]."""

KINDS = tuple(kind.value for kind in Kind)
ROBOT = 'duckiebot'

MIN_HEIGHT = 16
"""[px] a lower box is too small to count."""
MIN_BOTTOM, NEAR_BOTTOM, FAR_BOTTOM = 180, 200, 100
"""Rows: what ends above MIN_BOTTOM is too far to count, above FAR_BOTTOM not even looked at as a side figure."""
MIN_IOU = 0.3
GROWTH = 0.25
"""Of the labelled width and height: how far beside and below the box a foot may lie."""
FOOT_TOP = 0.35
"""Upper part of a labelled box in which no foot may lie: it would belong to a thing behind."""
AREA_FACTOR = 4.0
KIND_BONUS = 0.1
"""In IoU: so much better is a partner of the right kind."""
COVERED = 0.5
GRID = 24
"""Points along each side of a box when its covered part is measured."""
RIDING_DEPTH, RIDING_OVERLAP, RIDING_ABOVE = 0.6, 0.3, 0.3
"""A duckie rides when its foot is above this part of a robot's box, and this part of it lies on the robot's box, which
is taken higher by that part of its height: a rider looks out above it."""
BORDER = 2
"""[px] a box that comes so near to the picture's edge is cut by it."""
NARROWEST = {'duckie': 0.45, 'cone': 0.28}
"""Width over height of a box at the left or right edge: narrower ones are cut by more than half."""
LOWEST = {'duckie': 0.5, 'cone': 0.4}
"""Height over width of a box at the lower edge: lower ones are cut by more than half."""
EGO, OPPOSITE, SIDE, OBSTACLE = 'Ego Lane', 'Opposite Lane', 'Side Lane', 'Obstacle'
ROAD = frozenset([EGO, OPPOSITE, 'Intersection', 'Middle Lane', 'Road End'])
GAP = range(4, 160, 8)
"""[px] to the left and right: a point with road on both sides lies in the gap that the middle line leaves."""

HIT, IGNORED, DUPLICATE, LOOSE, FAR, FALSE = 'hit', 'ignored', 'duplicate', 'loose', 'far', 'fa'
STATES = (HIT, IGNORED, DUPLICATE, LOOSE, FAR, FALSE)
SMALL, CROWD, RIDING, CUT = 'small', 'iscrowd', 'riding', 'cut'


@dataclass(frozen=True)
class Label:
    """A labelled box. category: any, only KINDS are looked for.

    x, y: [m] point of its footprint nearest the robot. radius: [m]. in_lane: as in Obstacle. None: not told.
    """

    category: str
    box: Rectangle
    iscrowd: bool = False
    riding: bool = False
    x: Optional[float] = None
    y: Optional[float] = None
    radius: Optional[float] = None
    in_lane: Optional[bool] = None


@dataclass(frozen=True)
class Found:
    """A detection, as in a detections file."""

    kind: str
    box: Rectangle
    confidence: float = 1.0
    in_lane: Optional[bool] = None
    x: Optional[float] = None
    y: Optional[float] = None
    radius: Optional[float] = None


@dataclass(frozen=True)
class Polygon:
    """A piece of the road. points: corners (u, v) [px]."""

    label: str
    points: Tuple[Tuple[float, float], ...]


@dataclass(frozen=True)
class JudgedLabel:
    """A labelled duckie or cone. ignored: why it does not count, '' when it does. partner: index of the detection.

    where: 'ego', 'otherlane', 'offroad' by the lane polygons, None without. inside: in our lane; None: not known.
    far_found: True or False for one that only the side figure for far ones counts, else None.
    """

    label: Label
    ignored: str
    partner: Optional[int]
    where: Optional[str]
    inside: Optional[bool]
    far_found: Optional[bool]


@dataclass(frozen=True)
class JudgedFound:
    """A detection. counts: a false alarm where the labels would show an obstacle. side_wrong: of a hit.

    on_object: a false alarm on a labelled robot, sign and so on. on_obstacle: in a polygon named Obstacle.
    """

    found: Found
    state: str
    counts: bool = False
    on_object: bool = False
    on_obstacle: bool = False
    side_wrong: bool = False


@dataclass(frozen=True)
class Judged:
    """One picture. complete: all its duckies and cones are labelled. on_lanes: it has lane polygons."""

    labels: Tuple[JudgedLabel, ...]
    found: Tuple[JudgedFound, ...]
    complete: bool
    on_lanes: bool

    @property
    def judges_false_alarms(self) -> bool:
        """Whether a false alarm can be told from something that nobody labelled."""
        return self.complete or self.on_lanes


def judge(
    labels: Sequence[Label],
    found: Sequence[Found],
    size: Tuple[int, int],
    polygons: Optional[Sequence[Polygon]] = None,
    complete: bool = True,
) -> Judged:
    """Compare the labels of one picture with what was found in it. size: width, height [px]."""
    wanted, reasons = _wanted(labels, size)
    relevant = [index for index, why in enumerate(reasons) if not why]
    partners = _partners([wanted[index] for index in relevant], found)
    partner_of = {relevant[index]: detection for index, detection in partners.items()}
    judged_labels = []
    for index, (label, why) in enumerate(zip(wanted, reasons)):
        where = inside = None
        if not why:
            where, inside = _place(label, polygons)
        far = _far_found(label, found) if why == FAR else None
        judged_labels.append(JudgedLabel(label, why, partner_of.get(index), where, inside, far))
    label_of = {detection: judged_labels[index] for index, detection in partner_of.items()}
    others = [label.box for label in labels if label.category not in KINDS]
    judged_found = tuple(
        _judge_hit(item, label_of[index])
        if index in label_of
        else _judge_rest(item, wanted, reasons, others, size[1], polygons, complete)
        for index, item in enumerate(found)
    )
    return Judged(tuple(judged_labels), judged_found, complete, polygons is not None)


def ignored_because(label: Label, size: Tuple[int, int], robots: Sequence[Rectangle]) -> str:
    """Why a labelled duckie or cone does not count, '' when it does. size: width, height. robots: boxes."""
    _, top, _, height = label.box
    if label.iscrowd:
        return CROWD
    if height < MIN_HEIGHT:
        return SMALL
    if top + height < MIN_BOTTOM:
        return FAR
    if label.riding or (label.category == Kind.DUCKIE.value and any(_rides_on(label.box, robot) for robot in robots)):
        return RIDING
    return CUT if _cut(label, size) else ''


def matches(found: Rectangle, label: Rectangle) -> bool:
    """Whether a detection may be this labelled thing at all."""
    return iou(found, label) >= MIN_IOU or foot_matches(found, label)


def iou(first: Rectangle, second: Rectangle) -> float:
    """Intersection over union."""
    width = min(first[0] + first[2], second[0] + second[2]) - max(first[0], second[0])
    height = min(first[1] + first[3], second[1] + second[3]) - max(first[1], second[1])
    if width <= 0 or height <= 0:
        return 0.0
    both = width * height
    return both / (first[2] * first[3] + second[2] * second[3] - both)


def foot_matches(found: Rectangle, label: Rectangle) -> bool:
    """Whether a detection's foot stands where the labelled thing's does, and their areas are alike."""
    u, v = _foot(found)
    left, top, width, height = label
    beside, below = GROWTH * width, GROWTH * height
    if not left - beside <= u <= left + width + beside or not top + FOOT_TOP * height <= v <= top + height + below:
        return False
    ratio = found[2] * found[3] / (width * height)
    return 1 / AREA_FACTOR < ratio < AREA_FACTOR


def covered(box: Rectangle, others: Sequence[Rectangle]) -> float:
    """Share of a box that lies in any of the others, measured on a grid of points."""
    near = [other for other in others if _touch(box, other)]
    if not near:
        return 0.0
    steps = (np.arange(GRID) + 0.5) / GRID
    columns, rows = box[0] + steps * box[2], box[1] + steps * box[3]
    inside = np.zeros((GRID, GRID), dtype=bool)
    for left, top, width, height in near:
        across = (columns >= left) & (columns <= left + width)
        down = (rows >= top) & (rows <= top + height)
        inside |= down[:, None] & across[None, :]
    return float(inside.mean())


def in_polygon(u: float, v: float, points: Sequence[Tuple[float, float]]) -> bool:
    """Whether a point lies in a polygon: a ray from it to the right crosses its sides an odd number of times."""
    odd = False
    begin_u, begin_v = points[-1]
    for end_u, end_v in points:
        if (begin_v > v) != (end_v > v) and u < begin_u + (v - begin_v) * (end_u - begin_u) / (end_v - begin_v):
            odd = not odd
        begin_u, begin_v = end_u, end_v
    return odd


def on_road(u: float, v: float, polygons: Sequence[Polygon]) -> bool:
    """Whether a point lies on the road, or in the gap between two pieces of it, which the middle line leaves."""
    if _on(u, v, polygons, ROAD):
        return True
    if _on(u, v, polygons, {SIDE}):
        return False
    return all(any(_on(u + side * step, v, polygons, ROAD) for step in GAP) for side in (-1, 1))


def _wanted(labels: Sequence[Label], size: Tuple[int, int]) -> Tuple[List[Label], List[str]]:
    """Labelled duckies and cones, and why each is ignored."""
    robots = [label.box for label in labels if label.category == ROBOT]
    wanted = [label for label in labels if label.category in KINDS]
    return wanted, [ignored_because(label, size, robots) for label in wanted]


def _rides_on(box: Rectangle, robot: Rectangle) -> bool:
    """In 47 pairs of the real pictures, riders' feet are at -0.05 to 0.5 of the robot's height, others' beyond 0.7."""
    left, top, width, height = robot
    across = min(box[0] + box[2], left + width) - max(box[0], left)
    down = min(box[1] + box[3], top + height) - max(box[1], top - RIDING_ABOVE * height)
    if across <= 0 or down <= 0:
        return False
    high = (box[1] + box[3] - top) / height < RIDING_DEPTH
    return high and across * down > RIDING_OVERLAP * box[2] * box[3]


def _cut(label: Label, size: Tuple[int, int]) -> bool:
    left, top, width, height = label.box
    at_side = left <= BORDER or left + width >= size[0] - BORDER
    if at_side and width / height < NARROWEST[label.category]:
        return True
    return top + height >= size[1] - BORDER and height / width < LOWEST[label.category]


def _partners(labels: Sequence[Label], found: Sequence[Found]) -> Dict[int, int]:
    """Index of each label's detection, one to one: the surest choose first, by overlap; then who is left, by foot."""
    order = sorted(range(len(found)), key=lambda index: -found[index].confidence)
    partners: Dict[int, int] = {}
    chosen: Set[int] = set()
    by_overlap: Callable[[Rectangle, Rectangle], bool] = lambda box, label: iou(box, label) >= MIN_IOU  # noqa: E731
    for rule in (by_overlap, foot_matches):
        for index in order:
            if index in chosen:
                continue
            item = found[index]
            free = [i for i, label in enumerate(labels) if i not in partners and rule(item.box, label.box)]
            if free:
                partners[max(free, key=lambda i: _quality(item, labels[i]))] = index
                chosen.add(index)
    return partners


def _quality(found: Found, label: Label) -> float:
    """How well they fit: by overlap, then kind; nearer feet break ties."""
    (u, v), (label_u, label_v) = _foot(found.box), _foot(label.box)
    apart = math.hypot(u - label_u, v - label_v)
    return iou(found.box, label.box) + KIND_BONUS * (found.kind == label.category) + 1.0 / (1000 + apart)


def _place(label: Label, polygons: Optional[Sequence[Polygon]]) -> Tuple[Optional[str], Optional[bool]]:
    """Where a label's foot stands by the lane polygons, and whether the thing stands in our lane.

    The label's own word comes first. On an intersection, a stop line or the middle line the polygons do not tell sides.
    """
    if polygons is None:
        return None, label.in_lane
    u, v = _foot(label.box)
    v -= 1
    inside: Optional[bool] = None
    if _on(u, v, polygons, {EGO}):
        where, inside = 'ego', True
    elif on_road(u, v, polygons):
        where, inside = 'otherlane', False if _on(u, v, polygons, {OPPOSITE}) else None
    else:
        where, inside = 'offroad', False
    return where, inside if label.in_lane is None else label.in_lane


def _far_found(label: Label, found: Sequence[Found]) -> Optional[bool]:
    """Whether one too far to count was found; a detection may serve several. None: even too far for that."""
    if label.box[1] + label.box[3] < FAR_BOTTOM:
        return None
    return any(matches(item.box, label.box) for item in found)


def _judge_hit(found: Found, label: JudgedLabel) -> JudgedFound:
    wrong = label.inside is not None and found.in_lane is not None and label.inside != found.in_lane
    return JudgedFound(found, HIT, side_wrong=wrong)


def _judge_rest(
    found: Found,
    wanted: Sequence[Label],
    reasons: Sequence[str],
    others: Sequence[Rectangle],
    height: int,
    polygons: Optional[Sequence[Polygon]],
    complete: bool,
) -> JudgedFound:
    """A detection that has no relevant partner. reasons: why each wanted label is ignored."""
    box = found.box
    ignored = [label.box for label, why in zip(wanted, reasons) if why]
    relevant = [label.box for label, why in zip(wanted, reasons) if not why]
    if any(matches(box, other) or covered(box, [other]) >= COVERED for other in ignored):
        return JudgedFound(found, IGNORED)
    if any(matches(box, other) for other in relevant):
        return JudgedFound(found, DUPLICATE)
    if covered(box, ignored + relevant) >= COVERED:
        return JudgedFound(found, LOOSE)
    if box[1] + box[3] < MIN_BOTTOM:
        return JudgedFound(found, FAR)
    u, v = _foot(box)
    middle = v - box[3] / 2
    on_object = any(left <= u <= left + w and top <= middle <= top + h for left, top, w, h in others)
    if complete or polygons is None:
        return JudgedFound(found, FALSE, counts=complete, on_object=on_object)
    on_obstacle = _on(u, v - 1, polygons, {OBSTACLE})
    counts = not on_obstacle and on_road(u, min(v - 1, height - 2), polygons)
    return JudgedFound(found, FALSE, counts, on_object, on_obstacle)


def _on(u: float, v: float, polygons: Sequence[Polygon], labels: 'Set[str] | frozenset[str]') -> bool:
    return any(polygon.label in labels and in_polygon(u, v, polygon.points) for polygon in polygons)


def _foot(box: Rectangle) -> Tuple[float, float]:
    """Middle of the lower edge."""
    return box[0] + box[2] / 2, box[1] + box[3]


def _touch(first: Rectangle, second: Rectangle) -> bool:
    across = first[0] <= second[0] + second[2] and second[0] <= first[0] + first[2]
    return across and first[1] <= second[1] + second[3] and second[1] <= first[1] + first[3]
