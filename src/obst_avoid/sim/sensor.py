"""A cheap camera's sensor: exposure and white balance that follow the picture slowly, noise, tone curve.

Pictures travel from the renderer encoded as the square root of the signal, 0 to 255: in it, photon noise has the
same strength everywhere.
"""

import functools
import math
from dataclasses import dataclass, replace
from typing import Callable, Tuple

import cv2
import numpy as np

from obst_avoid.core.settings import number
from obst_avoid.core.types import Array

FULL_WELL = 4000.0
"""Electrons at full signal with gain 1; a small sensor binned to 640x480. More gain needs fewer."""
READ_NOISE = 1.2
"""Grey levels of the encoded picture at gain 1, everywhere."""
SETTLING = 6
"""Pictures after which exposure and white balance change no more."""
_BANK = 1 << 21


@dataclass(frozen=True)
class SensorSettings:
    """config/simulation.yaml has values, units and reasons."""

    target: float = number('share of full signal', above=0, below=1)
    shortest_exposure: float = number('s', above=0)
    longest_exposure: float = number('s', above=0)
    largest_gain: float = number('ratio', at_least=1)
    balance: float = number('ratio', at_least=0, at_most=1)
    largest_balance: float = number('ratio', at_least=1)
    adapting: float = number('s', above=0)
    sensitivity: float = number('1/s', above=0)


@dataclass(frozen=True)
class SensorState:
    """What the camera has set itself to. exposure: [s]. gain: >= 1. balance: factors of red, green, blue."""

    exposure: float
    gain: float
    balance: Tuple[float, float, float] = (1.0, 1.0, 1.0)


def signal_factors(state: SensorState, settings: SensorSettings) -> Tuple[float, float, float]:
    """From radiance to signal, red, green, blue; a signal of 1 saturates."""
    factor = settings.sensitivity * state.exposure * state.gain
    return factor * state.balance[0], factor * state.balance[1], factor * state.balance[2]


def adapted(state: SensorState, signal: Tuple[float, float, float], dt: float, settings: SensorSettings) -> SensorState:
    """The camera's next setting. signal: mean of the picture's red, green, blue signal. dt: [s] since the last one.

    Exposure goes for a set mean signal, gain helps when the exposure is at its limit; white balance goes part of the
    way to a grey mean. Both only move by a share of the way, as automatic modes do.
    """
    share = 1 - math.exp(-dt / settings.adapting)
    red, green, blue = (max(value, 1e-4) for value in signal)
    wanted = settings.target / (0.3 * red + 0.6 * green + 0.1 * blue)
    level = state.exposure * state.gain * min(max(wanted, 0.2), 5.0) ** share
    exposure = min(max(level, settings.shortest_exposure), settings.longest_exposure)
    gain = min(max(level / exposure, 1.0), settings.largest_gain)
    limit = settings.largest_balance
    raw = [value / factor for value, factor in zip((red, green, blue), state.balance)]
    goals = [min(max((raw[1] / value) ** settings.balance, 1 / limit), limit) for value in raw]
    balance = [before * (goal / before) ** share for before, goal in zip(state.balance, goals)]
    return replace(state, exposure=exposure, gain=gain, balance=(balance[0], balance[1], balance[2]))


def settled(look: Callable[[Tuple[float, float, float]], Array], settings: SensorSettings) -> SensorState:
    """The setting of a camera that has looked at one thing for long. look: from signal factors to what it sees."""
    state = SensorState(0.01, 1.0)
    for _ in range(SETTLING):
        state = adapted(state, mean_signal(look(signal_factors(state, settings))), 10 * settings.adapting, settings)
    return state


def mean_signal(encoded: Array) -> Tuple[float, float, float]:
    """Mean red, green and blue signal of an encoded (H, W, 3) uint8 BGR picture, from every eighth pixel."""
    some = encoded[::8, ::8].reshape(-1, 3).astype(np.float32) / 255
    blue, green, red = (some * some).mean(axis=0)
    return float(red), float(green), float(blue)


def developed(encoded: Array, state: SensorState, seed: int) -> Array:
    """The picture as the camera gives it: noise added, tone curve applied. (H, W, 3) uint8 BGR, both."""
    sigma = math.hypot(255 * 0.5 * math.sqrt(state.gain / FULL_WELL), READ_NOISE * math.sqrt(state.gain))
    size = encoded.size
    bank = _noise_bank(max(_BANK, 2 * size))
    begin = (seed * 7919) % (len(bank) - size)
    noise = bank[begin : begin + size].reshape(encoded.shape)
    noisy = cv2.addWeighted(noise, sigma / 16, encoded, 1.0, 0.0, dtype=cv2.CV_8U)
    picture: Array = cv2.LUT(noisy, _tone())
    return picture


@functools.lru_cache(maxsize=2)
def _noise_bank(size: int) -> Array:
    """(size,) int16 of standard deviation 16."""
    bank: Array = np.rint(16 * np.random.RandomState(1).standard_normal(size)).astype(np.int16)
    return bank


@functools.lru_cache(maxsize=1)
def _tone() -> Array:
    """(256,) uint8 from the encoded signal to what a JPEG holds: sRGB's curve with a little contrast."""
    signal = (np.arange(256) / 255.0) ** 2
    srgb = np.where(signal <= 0.0031308, 12.92 * signal, 1.055 * signal ** (1 / 2.4) - 0.055)
    contrast = srgb + 0.06 * np.sin(2 * np.pi * (srgb - 0.5))
    tone: Array = np.rint(255 * np.clip(contrast, 0, 1)).astype(np.uint8)
    return tone
