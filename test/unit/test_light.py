"""sim.light: where lamps stand, how even the ground's brightness is, and where glossy tape mirrors a lamp."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from obst_avoid.sim.light import COLORS, Lamp, Light, ground_light, mirrored

LAMP_AHEAD = Light(lamps=(Lamp(0.0, 0.3, 0.5),), glare=1.0)


def to_camera(azimuth: float, elevation: float) -> Any:
    """(1, 3) unit vector from the ground to a camera that stands in a direction of the robot frame."""
    cos = math.cos(elevation)
    return np.array([[cos * math.cos(azimuth), cos * math.sin(azimuth), math.sin(elevation)]])


@pytest.mark.parametrize(
    'azimuth, elevation, expected',
    [
        (0.0, 0.0, (1, 0, 0)),
        (math.pi / 2, 0.0, (0, 1, 0)),
        (2.0, math.pi / 2, (0, 0, 1)),
        (math.pi, math.pi / 4, (-math.sqrt(0.5), 0, math.sqrt(0.5))),
    ],
    ids=['east', 'north', 'above', 'west, half way up'],
)
def test_a_lamp_is_where_its_angles_say(azimuth: float, elevation: float, expected: Any) -> None:
    assert Lamp(azimuth, elevation, 0.5).direction == pytest.approx(expected, abs=1e-12)


def test_what_the_lamps_leave_comes_from_everywhere() -> None:
    assert Light(lamps=()).ambient == 1
    assert Light(lamps=(Lamp(0, 1, 0.45), Lamp(1, 1, 0.2))).ambient == pytest.approx(0.35)


@pytest.mark.parametrize('name', COLORS)
def test_the_strongest_channel_of_a_colour_is_1(name: str) -> None:
    assert max(COLORS[name]) == 1 and min(COLORS[name]) > 0


def test_the_ground_is_evenly_bright_without_unevenness() -> None:
    field = ground_light(Light(unevenness=0.0), (30, 40))
    assert field.shape == (30, 40) and field.dtype == np.float32
    np.testing.assert_array_equal(field, 1)


@pytest.mark.parametrize('unevenness', [0.05, 0.2])
def test_unevenness_is_the_standard_deviation_about_1(unevenness: float) -> None:
    field = ground_light(Light(unevenness=unevenness), (60, 80))
    assert field.mean() == pytest.approx(1, abs=0.01) and field.std() == pytest.approx(unevenness, rel=0.1)


def test_even_the_most_uneven_light_is_never_dark() -> None:
    field = ground_light(Light(unevenness=2.0), (60, 80))
    assert field.min() == 0.25 and field.max() == 2


def test_light_and_shade_have_no_hard_edges() -> None:
    field = ground_light(Light(unevenness=0.2), (60, 80))
    assert max(np.abs(np.diff(field, axis=axis)).max() for axis in (0, 1)) < 0.1


def test_a_seed_gives_one_pattern_and_another_seed_another() -> None:
    first, again, other = (ground_light(Light(seed=seed), (20, 20)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.05


def test_no_glare_no_mirror_and_no_lamp_neither() -> None:
    assert mirrored(replace(LAMP_AHEAD, glare=0.0), to_camera(math.pi, 0.3), 0.0) == 0
    assert mirrored(Light(lamps=(), glare=1.0), to_camera(math.pi, 0.3), 0.0) == 0
    assert mirrored(LAMP_AHEAD, np.empty((0, 3)), 0.0).shape == (0,)


def test_a_mirror_throws_a_lamp_ahead_back_at_its_own_angle() -> None:
    angles = np.linspace(0.1, 0.9, 81)
    small = replace(LAMP_AHEAD, lamps=(Lamp(0.0, 0.3, 0.5, size=0.02),))
    seen = mirrored(small, np.concatenate([to_camera(math.pi, angle) for angle in angles]), 0.0)
    # flatter looks mirror more, which draws the maximum a little below the lamp's own 0.3
    assert 0.24 < angles[seen.argmax()] <= 0.3
    assert seen.max() > 100 * seen[-1]


@pytest.mark.parametrize('azimuth', [0.0, math.pi / 2, -math.pi / 2], ids=['from behind', 'from the left', 'right'])
def test_other_sides_mirror_little(azimuth: float) -> None:
    best = mirrored(LAMP_AHEAD, to_camera(math.pi, 0.3), 0.0)
    assert mirrored(LAMP_AHEAD, to_camera(azimuth, 0.3), 0.0) < 0.02 * best


def test_lamps_stand_in_the_world_not_on_the_robot() -> None:
    north = replace(LAMP_AHEAD, lamps=(Lamp(math.pi / 2, 0.3, 0.5),))
    expected = mirrored(LAMP_AHEAD, to_camera(math.pi, 0.3), 0.0)
    np.testing.assert_allclose(mirrored(north, to_camera(math.pi, 0.3), math.pi / 2), expected, rtol=1e-6)
    assert mirrored(north, to_camera(math.pi, 0.3), 0.0) < 0.02 * expected


def test_glare_is_in_proportion_to_its_setting_and_the_lamp() -> None:
    look = to_camera(math.pi, 0.3)
    full = mirrored(LAMP_AHEAD, look, 0.0)
    np.testing.assert_allclose(mirrored(replace(LAMP_AHEAD, glare=0.5), look, 0.0), full / 2, rtol=1e-6)
    weak = replace(LAMP_AHEAD, lamps=(Lamp(0.0, 0.3, 0.25),))
    np.testing.assert_allclose(mirrored(weak, look, 0.0), full / 2, rtol=1e-6)
    both = replace(LAMP_AHEAD, lamps=LAMP_AHEAD.lamps * 2)
    np.testing.assert_allclose(mirrored(both, look, 0.0), full * 2, rtol=1e-6)
