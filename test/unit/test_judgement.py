"""core.detection.robust.judgement: which regions are things, with forests that say what the test wants."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import math
from dataclasses import replace
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust import trees
from obst_avoid.core.detection.robust.features import NAMES, QUICK
from obst_avoid.core.detection.robust.judgement import (
    LEAST_RADIUS,
    MOST,
    MOST_PROMISING,
    MOST_RADIUS,
    Candidate,
    judge,
    promising,
)
from obst_avoid.core.detection.robust.settings import RobustSettings
from obst_avoid.core.detection.robust.trees import NODE, Forest
from obst_avoid.core.detection.robust.view import WIDTH, View, make_view
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.geometry import image_from_rectified, pixel_from_ground
from obst_avoid.core.types import Kind
from unit.cameras import Camera, calibration_of

CAMERA = calibration_of(Camera())
HEIGHT = 180
"""[px] of the working picture."""
FIRST, ODDS, CONE, FOOT, RADIUS = 'fill', 'brightness00', 'green00', 'blue00', 'own00'
"""Measurements that stand for the answers of the five forests."""
HOPELESS = -5.0
"""Below it the first forest drops what it looks at."""
Rectangle = Tuple[float, float, float, float]


def stairs(name: str) -> Forest:
    """A forest that gives back a measurement between -12 and 12, rounded down to sixteenths."""
    steps = np.arange(-12, 12, 1 / 16)
    nodes = np.zeros((len(steps), 3), dtype=NODE)
    nodes['left'] = nodes['right'] = np.arange(3)
    nodes['feature'][:, 0], nodes['value'][:, 0] = NAMES.index(name), steps + 1 / 16
    nodes['left'][:, 0], nodes['right'][:, 0], nodes['depth'][:, 0] = 1, 2, 1
    nodes['value'][:, 2] = 1 / 16
    return Forest(nodes, -12.0, np.zeros(0, np.int32), np.zeros(0, np.float32))


@pytest.fixture(autouse=True)
def _said(monkeypatch: pytest.MonkeyPatch) -> None:
    """The forests say what stands in a region's values."""
    names = {'first': FIRST, 'thing': ODDS, 'cone': CONE, 'foot': FOOT, 'radius': RADIUS}
    forests = {forest: stairs(name) for forest, name in names.items()}
    trees_of_first = np.int32([len(forests['first'].nodes)])
    forests['first'] = replace(forests['first'], stages=trees_of_first, hopeless=np.float32([HOPELESS]))
    monkeypatch.setattr(trees, 'shipped', lambda: forests)


@pytest.fixture
def settings(detection_settings: DetectionSettings) -> RobustSettings:
    """As shipped."""
    return detection_settings.robust


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
    said: Dict[str, float] = {CONE: -1.0, FOOT: 0.0, RADIUS: 0.0, 'width': 0.05, 'ahead': 0.5, **answers}
    for name, value in said.items():
        values[:, NAMES.index(name)] = value + (1e-4 if name in (CONE, FOOT, RADIUS) else 0)
    return judge(np.array(boxes, dtype=float).reshape(-1, 4), values, view, calibration, settings)


def box_at(x: float, y: float, view: View, width: float = 20.0, height: float = 20.0) -> Rectangle:
    """The box of the working picture whose lower edge's middle is a point of the road, [m]."""
    pixel = image_from_rectified(CAMERA, pixel_from_ground(CAMERA.homography, np.array([[x, y]])))[0]
    u, v = (pixel + 0.5) / view.scale
    return u - width / 2, v - height, width, height


def rows_of(found: Sequence[Candidate]) -> List[int]:
    """Their numbers among the promising regions."""
    return [one.row for one in found]


def test_the_stairs_are_what_they_say() -> None:
    values = np.zeros((3, len(NAMES)), np.float32)
    values[:, NAMES.index(ODDS)] = (-3.0, 0.26, 5.5)
    assert trees.summed(stairs(ODDS), values).tolist() == [-3.0, 0.25, 5.5]


def looked_at(answers: Sequence[float]) -> Any:
    """What is promising of regions to which the first forest answers so."""
    quick = np.zeros((len(answers), len(QUICK)), np.float32)
    quick[:, QUICK.index(FIRST)] = answers
    chosen = promising(quick)
    assert chosen.dtype.kind == 'i'
    return chosen


def test_what_is_not_hopeless_is_promising() -> None:
    assert looked_at([]).tolist() == []
    assert looked_at([-6.0, -9.0]).tolist() == []
    assert looked_at([3.0, -5.25, -4.75, -8.0, HOPELESS, -11.0, 9.0]).tolist() == [0, 2, 4, 6]


@pytest.mark.parametrize('more', [0, 1, 500])
def test_only_the_best_of_many_are_promising_in_their_order(more: int) -> None:
    """A picture full of blobs takes no longer than any."""
    answers = np.random.RandomState(more).permutation(np.linspace(-4.9, 11, MOST_PROMISING + more))
    answers = np.insert(answers, [0, 10, 20], -7.0)
    chosen = looked_at(answers)
    assert len(chosen) == MOST_PROMISING
    assert (np.diff(chosen) > 0).all()
    left = np.delete(answers, chosen)
    assert np.floor(16 * answers[chosen].min()) >= np.floor(16 * left.max())  # the stairs have sixteenths


def test_no_region_no_candidate(settings: RobustSettings) -> None:
    assert judged(settings, []) == []


def test_what_is_hopeless_everywhere_is_no_candidate(settings: RobustSettings) -> None:
    assert judged(settings, [(100, 130, 20, 20), (200, 130, 20, 20)], [0.001, 0.01]) == []


def test_candidates_have_at_least_the_weak_confidence_and_the_best_comes_first(settings: RobustSettings) -> None:
    weak = settings.weak_confidence
    boxes = [(30 * i + 10, 140, 20, 20) for i in range(6)]
    confidences = [0.3, weak / 2, 0.98, weak * 1.5, weak * 0.8, 0.6]
    found = judged(settings, boxes, confidences)
    assert rows_of(found) == [2, 5, 0, 3]
    for one in found:
        assert one.confidence == pytest.approx(confidences[one.row], rel=0.1)


@pytest.mark.parametrize(
    'boxes, confidences, kept',
    [
        pytest.param([(100, 130, 20, 20), (100, 130, 20, 20)], [0.7, 0.8], [1], id='the same box'),
        pytest.param([(100, 130, 40, 40), (110, 140, 10, 10)], [0.8, 0.7], [0], id='a part of it'),
        pytest.param([(100, 130, 40, 40), (110, 140, 10, 10)], [0.7, 0.8], [1], id='it around a part'),
        pytest.param([(100, 130, 20, 20), (114, 130, 20, 20)], [0.8, 0.7], [0, 1], id='three tenths shared'),
        pytest.param([(100, 130, 20, 20), (112, 130, 20, 20)], [0.8, 0.7], [0], id='four tenths shared'),
        pytest.param([(100, 130, 20, 20), (100, 150, 20, 20)], [0.8, 0.7], [0, 1], id='one above the other'),
        pytest.param(
            [(100, 130, 20, 20), (110, 130, 20, 20), (120, 130, 20, 20)], [0.7, 0.9, 0.8], [1], id='on the best one'
        ),
        pytest.param(
            [(100, 130, 20, 20), (110, 130, 20, 20), (120, 130, 20, 20)],
            [0.9, 0.8, 0.7],
            [0, 2],
            id='what was dropped drops nothing',
        ),
        pytest.param([(100, 130, 20, 20), (100, 130, 20, 20)], [0.8, 0.8], [0], id='equally sure: the first'),
    ],
)
def test_what_lies_on_a_better_one_is_dropped(
    settings: RobustSettings, boxes: List[Rectangle], confidences: List[float], kept: List[int]
) -> None:
    assert settings.overlap == 0.35  # the cases count on it
    assert rows_of(judged(settings, boxes, confidences)) == kept


def test_there_are_at_most_so_many(settings: RobustSettings) -> None:
    boxes = [(12 * (i % 19), 110 + 12 * (i // 19), 10, 10) for i in range(75)]
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
    scale = size[0] / WIDTH
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
        (found,) = judged(settings, [(100, 130, 20, 20)], **{CONE: value})
        assert found.kind is kind


def test_a_radius_is_half_of_what_is_seen_at_the_foot(settings: RobustSettings) -> None:
    view = make_view(CAMERA)
    for x in (0.4, 0.8):
        (found,) = judged(settings, [box_at(x, 0.0, view)], ahead=0.5, width=0.05)
        assert found.radius == pytest.approx(0.025 * x / 0.5, rel=0.02)


def test_a_radius_of_what_is_cut_is_half_of_what_is_seen_where_it_is_cut(settings: RobustSettings) -> None:
    (found,) = judged(settings, [(100, HEIGHT - 40, 30, 40)], ahead=0.25, width=0.06)
    assert found.cut
    assert found.radius == pytest.approx(0.03, rel=1e-3)


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
    horizon = int(np.flatnonzero(view.nearness[:, WIDTH // 2] > 0)[0])
    far = box_at(settings.farthest * 1.2, 0.0, view, height=8.0)
    near = box_at(settings.farthest * 0.8, -0.6, view, height=8.0)
    boxes = [
        (20, horizon - 30, 20, 20),
        (60, horizon - 20.0, 20, 20),
        far,
        near,
        (200, 130, 20, 20),
    ]
    found = judged(settings, boxes, [0.9, 0.9, 0.9, 0.9, 0.8])
    assert set(rows_of(found)) == {3, 4}
    for one in found:
        assert math.isfinite(one.x)
        assert math.isfinite(one.y)


def test_what_is_cut_by_the_lower_edge_says_so_and_ignores_the_foot_forest(settings: RobustSettings) -> None:
    boxes: List[Any] = [(100, HEIGHT - 40, 30, 40), (200, HEIGHT - 50, 30, 49)]
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
