"""core.detection.paper.shape: the report's inertia criteria, on shapes turned to every orientation."""

import math
from dataclasses import replace
from typing import Any, List

import numpy as np
import pytest

from obst_avoid.core.detection.paper.settings import PaperSettings
from obst_avoid.core.detection.paper.shape import Blob, confidence, find_blobs
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.types import Box, Kind
from unit.scenes import SCALE, blob, mask_of, rectangle, smear

DASH = rectangle(0.05, 0.025)
STOP_LINE = rectangle(0.22, 0.048)
DUCKIE = smear(0.04, 0.06, 0.2)
"""A duckie of 5 cm, 0.3 m ahead of a camera 0.108 m high: round, so its far end is wider."""
CONE = smear(0.03, 0.0, 0.25)
"""A cone of 5 cm, 0.3 m ahead of the camera: its top is a point."""
ANGLES = range(0, 180, 15)


@pytest.fixture
def paper(detection_settings: DetectionSettings) -> PaperSettings:
    """As shipped, in pixels of SCALE."""
    return replace(detection_settings.paper, reference_scale=SCALE)


def the_blob(outline: Any, kind: Kind, degrees: float, paper: PaperSettings, pixels_per_metre: float = SCALE) -> Blob:
    """The blob that a shape makes. A cone's tip may fall apart into specks beside it, which are refused."""
    found = find_blobs(mask_of(outline, degrees, pixels_per_metre), kind, pixels_per_metre, paper)
    largest, *specks = sorted(found, key=lambda one: -one.area)
    assert all(speck.refused for speck in specks)
    return largest


def test_an_empty_mask_has_no_blobs(paper: PaperSettings) -> None:
    assert find_blobs(np.zeros((48, 640), np.uint8), Kind.DUCKIE, SCALE, paper) == []


def test_a_full_mask_is_one_blob(paper: PaperSettings) -> None:
    (found,) = find_blobs(np.full((48, 64), 255, np.uint8), Kind.DUCKIE, SCALE, paper)
    assert (found.box, found.area) == (Box(0, 0, 64, 48), 64 * 48)


def test_box_pixels_and_eigenvalues_of_a_rectangle(paper: PaperSettings) -> None:
    mask = np.zeros((40, 60), np.uint8)
    mask[10:16, 20:50] = 255
    (found,) = find_blobs(mask, Kind.DUCKIE, SCALE, paper)
    assert found.box == Box(left=20, top=10, right=50, bottom=16)
    assert found.area == 6 * 30
    assert {tuple(pixel) for pixel in found.pixels} == {(u, v) for u in range(20, 50) for v in range(10, 16)}
    # variance of n equal steps: (n^2 - 1) / 12
    assert (found.major, found.minor) == pytest.approx(((30**2 - 1) / 12, (6**2 - 1) / 12))
    assert found.ratio == pytest.approx(found.major / found.minor)


def test_pixels_that_touch_at_a_corner_belong_together(paper: PaperSettings) -> None:
    mask = np.zeros((40, 40), np.uint8)
    mask[0:10, 0:10] = mask[10:20, 10:20] = 255
    mask[30:36, 30:36] = 255
    assert [found.area for found in find_blobs(mask, Kind.DUCKIE, SCALE, paper)] == [200, 36]


# The report's figures "Segmented Cone", "Stop Line", "Middle Line" and "Duck"


@pytest.mark.parametrize('degrees', ANGLES)
def test_a_cone_passes_and_a_stop_line_does_not(paper: PaperSettings, degrees: int) -> None:
    cone, line = (the_blob(outline, Kind.CONE, degrees, paper) for outline in (CONE, STOP_LINE))
    assert cone.refused == ''
    assert line.refused == 'ratio of eigenvalues %.0f, more than 50 for a cone' % line.ratio
    assert cone.ratio > 3 * line.ratio


@pytest.mark.parametrize('degrees', ANGLES)
def test_a_duckie_passes_and_a_dash_does_not(paper: PaperSettings, degrees: int) -> None:
    duckie, dash = (the_blob(outline, Kind.DUCKIE, degrees, paper) for outline in (DUCKIE, DASH))
    assert duckie.refused == ''
    assert dash.refused.startswith(('first eigenvalue ', 'area '))
    assert duckie.major > 5 * max(dash.major, 0.05**2 / 12 * SCALE**2)


@pytest.mark.parametrize('outline', [DUCKIE, CONE, STOP_LINE], ids=['duckie', 'cone', 'stop line'])
def test_the_eigenvalues_do_not_depend_on_the_orientation(paper: PaperSettings, outline: Any) -> None:
    turned = [the_blob(outline, Kind.DUCKIE, degrees, paper) for degrees in ANGLES]
    majors = np.array([found.major for found in turned])
    np.testing.assert_allclose(majors, majors.mean(), rtol=0.12)  # shapes a few pixels wide, with stairs


@pytest.mark.parametrize('pixels_per_metre', [100.0, 140.0, 280.0, 420.0])
@pytest.mark.parametrize('degrees', [0, 30, 75])
def test_decisions_do_not_depend_on_the_scale_of_the_bird_view(
    paper: PaperSettings, pixels_per_metre: float, degrees: int
) -> None:
    decisions = [
        bool(the_blob(outline, kind, degrees, paper, pixels_per_metre).refused)
        for outline, kind in ((CONE, Kind.CONE), (STOP_LINE, Kind.CONE), (DUCKIE, Kind.DUCKIE), (DASH, Kind.DUCKIE))
    ]
    assert decisions == [False, True, False, True]


@pytest.mark.parametrize('pixels_per_metre', [100.0, 280.0, 420.0])
def test_sizes_are_told_in_pixels_of_the_reference(paper: PaperSettings, pixels_per_metre: float) -> None:
    here, there = (the_blob(DUCKIE, Kind.DUCKIE, 0, paper, scale) for scale in (SCALE, pixels_per_metre))
    assert (there.area, there.major) == pytest.approx((here.area, here.major), rel=0.15)
    assert there.minor == pytest.approx(here.minor, rel=0.3)


# Refusals


def filled(height: int, width: int) -> np.ndarray:
    """A mask with one rectangle. [px]"""
    mask = np.zeros((height + 4, width + 4), np.uint8)
    mask[2 : 2 + height, 2 : 2 + width] = 255
    return mask


@pytest.mark.parametrize(
    'mask, kind, refused',
    [
        pytest.param(filled(1, 1), Kind.DUCKIE, 'area 1 px^2, at least 20', id='one pixel'),
        pytest.param(filled(1, 19), Kind.CONE, 'area 19 px^2, at least 20', id='just too small'),
        pytest.param(
            filled(4, 5), Kind.DUCKIE, 'first eigenvalue 2 px^2, more than 20 for a duckie', id='just large enough'
        ),
        pytest.param(
            filled(2, 15), Kind.DUCKIE, 'first eigenvalue 19 px^2, more than 20 for a duckie', id='15 px long'
        ),
        pytest.param(filled(2, 16), Kind.DUCKIE, '', id='16 px long'),
        pytest.param(filled(1, 60), Kind.CONE, 'one pixel wide: its ratio of eigenvalues says nothing', id='a row'),
        pytest.param(filled(60, 1), Kind.CONE, 'one pixel wide: its ratio of eigenvalues says nothing', id='a column'),
        pytest.param(
            np.eye(60, dtype=np.uint8),
            Kind.CONE,
            'one pixel wide: its ratio of eigenvalues says nothing',
            id='diagonal',
        ),
        pytest.param(filled(20, 20), Kind.CONE, 'ratio of eigenvalues 1, more than 50 for a cone', id='a square'),
        pytest.param(
            filled(8, 56), Kind.CONE, 'ratio of eigenvalues 50, more than 50 for a cone', id='just not long enough'
        ),
        pytest.param(filled(8, 57), Kind.CONE, '', id='just long enough'),
    ],
)
def test_each_refusal_has_its_reason(paper: PaperSettings, mask: np.ndarray, kind: Kind, refused: str) -> None:
    (found,) = find_blobs(mask, kind, SCALE, paper)
    assert (found.refused, found.kind) == (refused, kind)


def test_a_streak_one_pixel_wide_has_an_infinite_ratio(paper: PaperSettings) -> None:
    (found,) = find_blobs(filled(1, 60), Kind.CONE, SCALE, paper)
    assert (found.minor, found.ratio) == (0.0, math.inf)


# Confidence


@pytest.mark.parametrize(
    'found, expected',
    [
        pytest.param(blob(0, 0, major=100.0), 0.5, id='a duckie at the sure limit'),
        pytest.param(blob(0, 0, major=300.0), 0.75, id='a large duckie'),
        pytest.param(blob(0, 0, kind=Kind.CONE, major=100.0, minor=2.0), 0.5, id='a cone at the limit'),
        pytest.param(blob(0, 0, kind=Kind.CONE, major=100.0, minor=1.0), 2 / 3, id='a slender cone'),
    ],
)
def test_confidence_ranks_from_0_to_1(paper: PaperSettings, found: Blob, expected: float) -> None:
    assert confidence(found, paper) == pytest.approx(expected)


def test_more_of_the_criterion_is_more_confidence(paper: PaperSettings) -> None:
    ranked: List[float] = [confidence(blob(0, 0, major=major), paper) for major in (21, 60, 100, 1e4, 1e9)]
    assert ranked == sorted(ranked) and 0 < ranked[0] and ranked[-1] <= 1
