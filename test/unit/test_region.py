"""core.avoidance.region: which obstacles count."""

import math
from dataclasses import replace
from typing import Optional

import numpy as np
import pytest

from obst_avoid.core.avoidance.region import footprint_centre, in_region, region_outline
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.types import Obstacle


@pytest.fixture
def settings(avoidance_settings: AvoidanceSettings) -> AvoidanceSettings:
    """A box of 0.5 m ahead and 0.125 m to each side."""
    return replace(avoidance_settings, box_length=0.5, box_width=0.25)


def standing(x: float, y: float, radius: float, in_lane: Optional[bool] = True) -> Obstacle:
    """An obstacle whose footprint is a circle around (x, y)."""
    distance = math.hypot(x, y)
    return Obstacle(None, x * (1 - radius / distance), y * (1 - radius / distance), radius, in_lane)


@pytest.mark.parametrize(
    'x, y, radius, centre',
    [
        pytest.param(0.4, 0.0, 0.03, (0.43, 0.0), id='ahead'),
        pytest.param(0.0, -0.2, 0.05, (0.0, -0.25), id='to the right'),
        pytest.param(0.3, 0.4, 0.05, (0.33, 0.44), id='on its ray'),
        pytest.param(0.0, 0.0, 0.03, (0.03, 0.0), id='at the axle'),
        pytest.param(1e-310, 0.0, 0.03, (0.03, 0.0), id='at the axle but for rounding'),
    ],
)
def test_the_footprint_is_one_radius_behind_its_nearest_point(x: float, y: float, radius: float, centre: tuple) -> None:
    assert footprint_centre(Obstacle(None, x, y, radius, True)) == pytest.approx(centre, abs=1e-12)


@pytest.mark.parametrize(
    'x, y, radius, counts',
    [
        pytest.param(0.3, 0.0, 0.03, True, id='in the middle'),
        pytest.param(0.52, 0.0, 0.03, True, id='reaches in from ahead'),
        pytest.param(0.54, 0.0, 0.03, False, id='just ahead of the box'),
        pytest.param(0.3, 0.15, 0.03, True, id='reaches in from the left'),
        pytest.param(0.3, 0.16, 0.03, False, id='just left of the box'),
        pytest.param(0.3, -0.15, 0.03, True, id='reaches in from the right'),
        pytest.param(0.3, -0.16, 0.03, False, id='just right of the box'),
        pytest.param(0.52, 0.145, 0.03, True, id='reaches the corner'),
        pytest.param(0.523, 0.148, 0.03, False, id='touches both edges prolonged, but not the corner'),
        pytest.param(0.05, 0.0, 0.02, True, id='right before the axle'),
        pytest.param(-0.05, 0.0, 0.02, False, id='behind the axle'),
        pytest.param(0.7, 0.0, 0.3, True, id='a very large one'),
    ],
)
def test_an_obstacle_counts_when_its_footprint_touches_the_box(
    settings: AvoidanceSettings, x: float, y: float, radius: float, counts: bool
) -> None:
    assert in_region(standing(x, y, radius), settings) is counts


@pytest.mark.parametrize('in_lane, counts', [(True, True), (None, True), (False, False)])
def test_only_what_surely_stands_outside_the_lane_is_left_out(
    settings: AvoidanceSettings, in_lane: Optional[bool], counts: bool
) -> None:
    assert in_region(standing(0.3, 0.0, 0.03, in_lane), settings) is counts


def test_the_outline_is_what_counts(settings: AvoidanceSettings) -> None:
    np.testing.assert_allclose(region_outline(settings), [[0, 0.125], [0.5, 0.125], [0.5, -0.125], [0, -0.125]])
