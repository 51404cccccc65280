"""sim.sensor: exposure, gain and white balance follow the picture within limits; noise is as strong as it should be."""

import math
from dataclasses import replace
from typing import Any, Tuple
from unittest import mock

import numpy as np
import pytest

from obst_avoid.sim import sensor
from obst_avoid.sim.sensor import SensorSettings, SensorState, adapted, developed, mean_signal, signal_factors

SETTINGS = SensorSettings(
    target=0.2,
    shortest_exposure=0.001,
    longest_exposure=0.02,
    largest_gain=4.0,
    balance=0.7,
    largest_balance=2.0,
    adapting=0.5,
    sensitivity=100.0,
)
START = SensorState(0.005, 1.0)
LONG = 100.0
"""[s] after which everything has settled."""

RGB = Tuple[float, float, float]


def grey(level: float) -> RGB:
    """The mean signal of a grey picture."""
    return level, level, level


def settled(state: SensorState, radiance: RGB, dt: float = LONG, steps: int = 60) -> SensorState:
    """The state after many pictures of the same radiance."""
    for _ in range(steps):
        red, green, blue = (value * f for value, f in zip(radiance, signal_factors(state, SETTINGS)))
        state = adapted(state, (red, green, blue), dt, SETTINGS)
    return state


def test_the_target_is_kept() -> None:
    kept = adapted(START, grey(0.2), 0.1, SETTINGS)
    assert (kept.exposure, kept.gain, *kept.balance) == pytest.approx((0.005, 1, 1, 1, 1))


@pytest.mark.parametrize('level, ratio', [(0.1, 2.0), (0.4, 0.5), (0.15, 4 / 3)])
def test_in_the_end_the_exposure_reaches_the_target(level: float, ratio: float) -> None:
    assert adapted(START, grey(level), LONG, SETTINGS).exposure == pytest.approx(0.005 * ratio)


def test_green_counts_most() -> None:
    # 0.3 * 0.1 + 0.6 * 0.2 + 0.1 * 0.5 = 0.2
    assert adapted(START, (0.1, 0.2, 0.5), LONG, SETTINGS).exposure == pytest.approx(0.005)


def test_half_way_after_0_69_time_constants() -> None:
    half = adapted(START, grey(0.1), 0.5 * math.log(2), SETTINGS)
    assert half.exposure == pytest.approx(0.005 * math.sqrt(2))  # half of the way to twice, as a ratio
    assert adapted(START, grey(0.1), 0.0, SETTINGS) == START


def test_two_short_steps_make_a_long_one() -> None:
    once = adapted(START, grey(0.1), 0.4, SETTINGS)
    half = adapted(START, grey(0.1), 0.2, SETTINGS)
    twice = adapted(half, grey(0.1 * half.exposure / START.exposure), 0.2, SETTINGS)
    assert twice.exposure == pytest.approx(once.exposure)


@pytest.mark.parametrize('level, ratio', [(0.001, 5.0), (0.0, 5.0), (10.0, 0.2)], ids=['dark', 'black', 'bright'])
def test_one_picture_changes_the_exposure_five_times_at_most(level: float, ratio: float) -> None:
    state = adapted(SensorState(0.003, 1.0), grey(level), LONG, replace(SETTINGS, shortest_exposure=1e-6))
    assert state.exposure == pytest.approx(0.003 * ratio)


@pytest.mark.parametrize(
    'radiance, exposure, gain',
    [
        (0.5, 0.004, 1.0),  # 0.2 = 0.5 * 100 * exposure
        (0.1, 0.02, 1.0),
        (0.05, 0.02, 2.0),
        (0.001, 0.02, 4.0),
        (100.0, 0.001, 1.0),
    ],
    ids=['exposure alone', 'its limit', 'gain', 'limit of gain', 'shortest exposure'],
)
@pytest.mark.parametrize('start', [START, SensorState(0.02, 4.0)], ids=['from the middle', 'from the limit'])
def test_gain_only_when_the_exposure_is_at_its_limit(
    start: SensorState, radiance: float, exposure: float, gain: float
) -> None:
    state = settled(start, grey(radiance))
    assert (state.exposure, state.gain) == pytest.approx((exposure, gain), rel=1e-3)


def test_white_balance_goes_part_of_the_way() -> None:
    # red is twice as strong as green, blue half as strong: 70 % of the way, as a ratio
    red, green, blue = settled(START, (0.2, 0.1, 0.05)).balance
    assert (red, green, blue) == pytest.approx((2**-0.7, 1, 2**0.7), rel=1e-3)


def test_white_balance_is_limited() -> None:
    assert settled(START, (0.8, 0.1, 0.01)).balance == pytest.approx((0.5, 1, 2), rel=1e-3)


def test_white_balance_takes_as_long_as_exposure() -> None:
    red, _, blue = adapted(START, (0.2, 0.1, 0.05), 0.5 * math.log(2), SETTINGS).balance
    assert (red, blue) == pytest.approx((2**-0.35, 2**0.35))


@pytest.mark.parametrize('balance, expected', [(0.0, 1.0), (1.0, 0.5)], ids=['off', 'whole way'])
def test_the_share_of_white_balance(balance: float, expected: float) -> None:
    state = adapted(START, (0.2, 0.1, 0.1), LONG, replace(SETTINGS, balance=balance))
    assert state.balance[0] == pytest.approx(expected)


def test_signal_factors_are_products() -> None:
    state = SensorState(0.01, 2.0, (1.5, 1.0, 0.5))
    assert signal_factors(state, SETTINGS) == pytest.approx((3.0, 2.0, 1.0))
    assert signal_factors(replace(state, exposure=0.005), SETTINGS) == pytest.approx((1.5, 1.0, 0.5))
    assert signal_factors(replace(state, gain=1.0), SETTINGS) == pytest.approx((1.5, 1.0, 0.5))


def test_mean_signal_is_the_mean_of_squares_in_red_green_blue() -> None:
    picture = np.zeros((480, 640, 3), dtype=np.uint8)
    picture[:, :320] = (51, 102, 255)  # blue, green, red; half of the picture
    assert mean_signal(picture) == pytest.approx((0.5, 0.08, 0.02), rel=1e-4)


def tone(levels: Any) -> Any:
    """The developed values of encoded levels without noise."""
    with mock.patch.object(sensor, 'READ_NOISE', 0.0), mock.patch.object(sensor, 'FULL_WELL', 1e12):
        return developed(np.asarray(levels, dtype=np.uint8).reshape(1, -1, 1).repeat(3, axis=2), START, 0)[0, :, 0]


def test_the_tone_curve_rises_from_black_to_white() -> None:
    values = tone(np.arange(256)).astype(int)
    assert values[0] == 0 and values[-1] == 255
    assert (np.diff(values) >= 0).all() and len(np.unique(values)) > 180


def test_the_tone_curve_is_about_that_of_srgb() -> None:
    signal = (np.arange(256) / 255) ** 2
    srgb = 255 * np.where(signal < 0.0031308, 12.92 * signal, 1.055 * signal ** (1 / 2.4) - 0.055)
    assert np.abs(tone(np.arange(256)) - srgb).max() < 20


@pytest.mark.parametrize('gain, sigma', [(1.0, 2.35), (4.0, 4.69), (8.0, 6.63)])
@pytest.mark.parametrize('level', [90, 170])
def test_noise_is_as_strong_as_electrons_and_electronics_make_it(level: int, gain: float, sigma: float) -> None:
    # of the square root of photons 255 / 2 * sqrt(gain / 4000), of reading 1.2 * sqrt(gain): 2.02 and 1.2 at gain 1
    picture = developed(np.full((480, 640, 3), level, dtype=np.uint8), SensorState(0.01, gain), 3).astype(float)
    below, above = tone([level - 10, level + 10]).astype(float)
    slope = (above - below) / 20
    assert picture.std() / slope == pytest.approx(sigma, rel=0.06)
    assert picture.mean() == pytest.approx(tone([level])[0], abs=0.8)


def test_noise_is_the_same_for_a_seed_and_another_for_another() -> None:
    encoded = np.full((120, 160, 3), 128, dtype=np.uint8)
    first, again, other = (developed(encoded, START, seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.5


def test_noise_of_neighbours_has_nothing_in_common() -> None:
    picture = developed(np.full((480, 640, 3), 128, dtype=np.uint8), START, 1).astype(float)
    picture -= picture.mean()
    shifts = (picture[1:] * picture[:-1], picture[:, 1:] * picture[:, :-1], picture[..., 1:] * picture[..., :-1])
    assert max(abs(product.mean()) for product in shifts) < 0.02 * picture.var()


@pytest.mark.parametrize('size', [(320, 240), (640, 480), (1296, 972)], ids='%dx%d'.__mod__)
@pytest.mark.parametrize('seed', [0, 264, 10**6])
def test_every_picture_size_has_noise(size: Tuple[int, int], seed: int) -> None:
    encoded = np.full((size[1], size[0], 3), 128, dtype=np.uint8)
    picture = developed(encoded, START, seed)
    assert picture.shape == encoded.shape and picture.dtype == np.uint8 and picture.std() > 1
