"""core.detection.robust.judgement: which regions are things, with forests that say what the test wants."""

import math
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust import trees
from obst_avoid.core.detection.robust.features import NAMES
from obst_avoid.core.detection.robust.judgement import LEAST_RADIUS, MOST, MOST_RADIUS, Candidate, judge
from obst_avoid.core.detection.robust.regions import Regions
from obst_avoid.core.detection.robust.settings import RobustSettings
from obst_avoid.core.detection.robust.trees import Forest
from obst_avoid.core.detection.robust.view import View, make_view
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.geometry import image_from_rectified, pixel_from_ground
from obst_avoid.core.types import Kind
from unit.cameras import Camera, calibration_of

CAMERA = calibration_of(Camera())
ODDS, CONE, FOOT, RADIUS = 'brightness00', 'green00', 'blue00', 'own00'
"""Measurements that stand for the answers of the four forests."""
Rectangle = Tuple[float, float, float, float]


def stairs(name: str) -> Forest:
    """A forest that gives back a measurement between -12 and 12, rounded down to sixteenths."""
    steps = np.arange(-12, 12, 1 / 16)
    count = len(steps)
    nodes = np.array([0, 1, 2])
    return Forest(
        np.tile([NAMES.index(name), 0, 0], (count, 1)),
        np.column_stack([steps + 1 / 16, np.zeros((count, 2))]).astype(np.float32),
        np.tile([1, 1, 2], (count, 1)),
        np.tile([2, *nodes[1:]], (count, 1)),
        np.tile(np.array([0, 0, 1 / 16], np.float32), (count, 1)),
        -12.0,
        1,
    )


@pytest.fixture(autouse=True)
def _said(monkeypatch: pytest.MonkeyPatch) -> None:
    """The forests say what stands in a region's values."""
    forests = {'thing': stairs(ODDS), 'cone': stairs(CONE), 'foot': stairs(FOOT), 'radius': stairs(RADIUS)}
    monkeypatch.setattr(trees, 'shipped', lambda: forests)


@pytest.fixture
def settings(detection_settings: DetectionSettings) -> RobustSettings:
    """As shipped."""
    return detection_settings.robust


def regions_of(boxes: Sequence[Rectangle]) -> Regions:
    """Regions of which only the boxes matter."""
    box = np.array(boxes, dtype=float).reshape(-1, 4)
    zeros, nothing = np.zeros(len(box), dtype=int), np.zeros((1, 1), np.uint8)
    middle = box[:, :2] + box[:, 2:] / 2
    return Regions(zeros, zeros, zeros, zeros, box, box[:, 2] * box[:, 3], middle, [], nothing, nothing, nothing)


def odds(confidence: float) -> float:
    """The logarithm of the odds."""
    return math.log(confidence / (1 - confidence))


def judged(
    settings: RobustSettings,
    boxes: Sequence[Rectangle],
    confidences: Optional[Sequence[float]] = None,
    calibration: Calibration = CAMERA,
    **answers: float,
) -> List[Candidate]:
    """Candidates of regions with these boxes of the working picture; answers: of the other forests, to all."""
    view = make_view(calibration)
    confidences = [0.9] * len(boxes) if confidences is None else confidences
    values = np.zeros((len(boxes), len(NAMES)), np.float32)
    values[:, NAMES.index(ODDS)] = [odds(value) + 1e-3 for value in confidences]
    said: Dict[str, float] = {CONE: -1.0, FOOT: 0.0, RADIUS: 0.0, 'width': math.log2(0.05), 'ahead': 0.5, **answers}
    for name, value in said.items():
        values[:, NAMES.index(name)] = value + (1e-4 if name in (CONE, FOOT, RADIUS) else 0)
    return judge(regions_of(boxes), values, view, calibration, settings)


def box_at(x: float, y: float, view: View, width: float = 20.0, height: float = 20.0) -> Rectangle:
    """The box of the working picture whose lower edge's middle is a point of the road, [m]."""
    pixel = image_from_rectified(CAMERA, pixel_from_ground(CAMERA.homography, np.array([[x, y]])))[0]
    u, v = (pixel + 0.5) / view.scale
    return u - width / 2, v - height, width, height


def rows_of(found: Sequence[Candidate]) -> List[int]:
    """Their numbers among the regions."""
    return [one.row for one in found]


def test_the_stairs_are_what_they_say() -> None:
    values = np.zeros((3, len(NAMES)), np.float32)
    values[:, NAMES.index(ODDS)] = (-3.0, 0.26, 5.5)
    assert trees.summed(stairs(ODDS), values).tolist() == [-3.0, 0.25, 5.5]


def test_no_region_no_candidate(settings: RobustSettings) -> None:
    assert judged(settings, []) == []


def test_what_is_hopeless_everywhere_is_no_candidate(settings: RobustSettings) -> None:
    assert judged(settings, [(100, 150, 20, 20), (200, 150, 20, 20)], [0.001, 0.01]) == []


def test_candidates_have_at_least_the_weak_confidence_and_the_best_comes_first(settings: RobustSettings) -> None:
    weak = settings.weak_confidence
    boxes = [(30 * i + 10, 150, 20, 20) for i in range(6)]
    confidences = [0.3, weak / 2, 0.98, weak * 1.5, weak * 0.8, 0.6]
    found = judged(settings, boxes, confidences)
    assert rows_of(found) == [2, 5, 0, 3]
    for one in found:
        assert one.confidence == pytest.approx(confidences[one.row], rel=0.1)


@pytest.mark.parametrize(
    'boxes, confidences, kept',
    [
        pytest.param([(100, 150, 20, 20), (100, 150, 20, 20)], [0.7, 0.8], [1], id='the same box'),
        pytest.param([(100, 150, 40, 40), (110, 160, 10, 10)], [0.8, 0.7], [0], id='a part of it'),
        pytest.param([(100, 150, 40, 40), (110, 160, 10, 10)], [0.7, 0.8], [1], id='it around a part'),
        pytest.param([(100, 150, 20, 20), (114, 150, 20, 20)], [0.8, 0.7], [0, 1], id='three tenths shared'),
        pytest.param([(100, 150, 20, 20), (112, 150, 20, 20)], [0.8, 0.7], [0], id='four tenths shared'),
        pytest.param([(100, 150, 20, 20), (100, 170, 20, 20)], [0.8, 0.7], [0, 1], id='one above the other'),
        pytest.param(
            [(100, 150, 20, 20), (110, 150, 20, 20), (120, 150, 20, 20)], [0.7, 0.9, 0.8], [1], id='on the best one'
        ),
        pytest.param(
            [(100, 150, 20, 20), (110, 150, 20, 20), (120, 150, 20, 20)],
            [0.9, 0.8, 0.7],
            [0, 2],
            id='what was dropped drops nothing',
        ),
        pytest.param([(100, 150, 20, 20), (100, 150, 20, 20)], [0.8, 0.8], [0], id='equally sure: the first'),
    ],
)
def test_what_lies_on_a_better_one_is_dropped(
    settings: RobustSettings, boxes: List[Rectangle], confidences: List[float], kept: List[int]
) -> None:
    assert settings.overlap == 0.35  # the cases count on it
    assert rows_of(judged(settings, boxes, confidences)) == kept


def test_there_are_at_most_so_many(settings: RobustSettings) -> None:
    boxes = [(12 * (i % 25), 120 + 12 * (i // 25), 10, 10) for i in range(75)]
    confidences = list(np.linspace(0.5, 0.95, 75))
    assert rows_of(judged(settings, boxes, confidences))[:3] == [74, 73, 72]
    assert len(judged(settings, boxes, confidences)) == MOST


@pytest.mark.parametrize('x, y', [(0.3, 0.0), (0.5, 0.1), (0.8, -0.2), (1.6, 0.3)])
@pytest.mark.parametrize('size', [(640, 480), (320, 240), (1280, 960)], ids='%dx%d'.__mod__)
def test_a_candidate_stands_where_its_foot_is(
    settings: RobustSettings, x: float, y: float, size: Tuple[int, int]
) -> None:
    calibration = calibration_of(Camera().resized(*size))
    box = box_at(x, y, make_view(CAMERA))
    (found,) = judged(settings, [box], calibration=calibration)
    assert (found.x, found.y) == pytest.approx((x, y), abs=0.01 * x)
    assert found.kind is Kind.DUCKIE
    scale = size[0] / 320
    left, top, width, height = (scale * value for value in box)
    assert (found.box.left, found.box.top, found.box.right, found.box.bottom) == pytest.approx(
        (left, top, left + width, top + height)
    )


def test_the_foot_forest_moves_it_by_shares_of_its_height(settings: RobustSettings) -> None:
    view = make_view(CAMERA)
    left, top, width, height = box_at(0.5, 0.05, view, height=24.0)
    for share in (-0.25, 0.0, 0.25):
        (found,) = judged(settings, [(left, top - share * height, width, height)], **{FOOT: share})
        assert (found.x, found.y) == pytest.approx((0.5, 0.05), abs=0.003)
    low, high = (judged(settings, [(left, top, width, height)], **{FOOT: share})[0].x for share in (0.5, 3.0))
    assert low == high, 'by half of it at most'


def test_the_cone_forest_decides_the_kind(settings: RobustSettings) -> None:
    for value, kind in ((-0.5, Kind.DUCKIE), (0.5, Kind.CONE)):
        (found,) = judged(settings, [(100, 150, 20, 20)], **{CONE: value})
        assert found.kind is kind


def test_a_radius_is_half_of_what_is_seen_at_the_foot(settings: RobustSettings) -> None:
    view = make_view(CAMERA)
    for x in (0.4, 0.8):
        (found,) = judged(settings, [box_at(x, 0.0, view)], ahead=0.5, width=math.log2(0.05))
        assert found.radius == pytest.approx(0.025 * x / 0.5, rel=0.02)


@pytest.mark.parametrize(
    'value, radius', [(0.0, 0.025), (-1.0, 0.0125), (1.0, 0.05), (8.0, MOST_RADIUS), (-8.0, LEAST_RADIUS)]
)
def test_the_radius_forest_doubles_and_halves_within_limits(
    settings: RobustSettings, value: float, radius: float
) -> None:
    (found,) = judged(settings, [box_at(0.5, 0.0, make_view(CAMERA))], **{RADIUS: value})
    assert found.radius == pytest.approx(radius, rel=0.02)


def test_what_stands_above_the_horizon_or_too_far_is_dropped(settings: RobustSettings) -> None:
    view = make_view(CAMERA)
    horizon = int(np.flatnonzero(view.nearness[:, 160] > 0)[0])
    far = box_at(settings.farthest * 1.2, 0.0, view, height=8.0)
    near = box_at(settings.farthest * 0.8, -0.6, view, height=8.0)
    boxes = [
        (20, horizon - 30, 20, 20),
        (60, horizon - 20.0, 20, 20),
        far,
        near,
        (200, 150, 20, 20),
    ]
    found = judged(settings, boxes, [0.9, 0.9, 0.9, 0.9, 0.8])
    assert set(rows_of(found)) == {3, 4}
    for one in found:
        assert math.isfinite(one.x)
        assert math.isfinite(one.y)


def test_what_is_cut_by_the_lower_edge_says_so_and_ignores_the_foot_forest(settings: RobustSettings) -> None:
    boxes: List[Any] = [(100, 200, 30, 40), (200, 190, 30, 49)]
    plain, moved = (judged(settings, boxes, [0.9, 0.8], **{FOOT: share}) for share in (0.0, -0.25))
    assert [one.cut for one in plain] == [one.cut for one in moved] == [True, False]
    assert plain[0] == moved[0]
    assert plain[1].x < moved[1].x


def test_the_top_is_where_the_line_of_sight_over_it_meets_the_road(settings: RobustSettings) -> None:
    view = make_view(CAMERA)
    foot, top = box_at(0.5, 0.0, view), box_at(0.9, 0.0, view)
    height = foot[1] - top[1]
    (found,) = judged(settings, [box_at(0.5, 0.0, view, height=height)])
    assert found.top_distance == pytest.approx(0.9, rel=0.01)
    (tall,) = judged(settings, [box_at(0.5, 0.0, view, height=100)])
    assert tall.top_distance == math.inf
