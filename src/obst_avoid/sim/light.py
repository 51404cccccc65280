"""Light in the town: its colour and strength, where it comes from, and what it does on the ground."""

import math
from dataclasses import dataclass
from typing import Dict, Tuple

import numpy as np

from obst_avoid.core.types import Array

COLORS: Dict[str, Tuple[float, float, float]] = {
    'white': (1.0, 1.0, 1.0),
    'warm': (1.0, 0.70, 0.40),
    'pink': (1.0, 0.45, 0.70),
    'blue': (0.16, 0.33, 1.0),
    'green': (0.22, 1.0, 0.22),
    'red': (1.0, 0.16, 0.20),
}
"""Linear RGB of lamps, the strongest channel 1."""
HEADLIGHT_COLOR = (0.85, 0.92, 1.0)
"""Linear RGB of a white light-emitting diode."""


@dataclass(frozen=True)
class Lamp:
    """One lamp or window, far away. azimuth, elevation: [rad] where it stands in the world.

    share: of the light on the ground that comes from it. size: [rad] half its width; a large one casts soft shadows.
    """

    azimuth: float
    elevation: float
    share: float
    size: float = 0.1

    @property
    def direction(self) -> Tuple[float, float, float]:
        """Unit vector towards it, world frame."""
        cos = math.cos(self.elevation)
        return cos * math.cos(self.azimuth), cos * math.sin(self.azimuth), math.sin(self.elevation)


@dataclass(frozen=True)
class Light:
    """All light. color: linear RGB, the strongest channel 1. strength: 1 is a bright room.

    lamps: what their shares leave of 1 comes from everywhere. glare: how much of the lamps glossy tape mirrors,
    0 none, 1 so that it whitens. unevenness: standard deviation of the ground's brightness, of furniture and windows.
    headlight: the robot's own lamps, on the ground 0.3 m ahead, in the units of strength.
    """

    color: Tuple[float, float, float] = COLORS['white']
    strength: float = 1.0
    lamps: Tuple[Lamp, ...] = (Lamp(1.0, 1.0, 0.45), Lamp(-2.0, 0.7, 0.2))
    glare: float = 0.2
    unevenness: float = 0.15
    headlight: float = 0.0
    seed: int = 0

    @property
    def ambient(self) -> float:
        """Share of the light that comes from everywhere."""
        return 1.0 - sum(lamp.share for lamp in self.lamps)


def headlight(light: Light, ahead: Array, left: Array) -> Array:
    """Strength of the robot's own lamps at points of the ground, m in the robot frame; the shape of its arguments."""
    squared = ahead * ahead + left * left
    beam = np.clip(ahead, 0, None) / np.sqrt(squared + 1e-6)
    shone: Array = light.headlight * (0.09 + 0.02) / (squared + 0.02) * beam**2
    return shone


def ground_light(light: Light, cells: Tuple[int, int]) -> Array:
    """(rows, columns) float32 brightness of the ground over the map, 1 on the average: soft pools and shades."""
    random = np.random.RandomState(light.seed)
    rows, columns = cells
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    field = np.zeros(cells, dtype=np.float32)
    for _ in range(12):
        cx, cy, size = random.uniform(0, columns), random.uniform(0, rows), random.uniform(0.08, 0.3) * max(cells)
        field += random.choice([-1, 1]) * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * size**2))
    field -= field.mean()
    brightness: Array = np.clip(1 + light.unevenness * field / max(float(field.std()), 1e-6), 0.25, 2.0)
    return brightness.astype(np.float32)


def mirrored(light: Light, to_camera: Array, heading: float) -> Array:
    """How much of the lamps a glossy ground mirrors into the camera.

    to_camera: (N, 3) unit vectors from the ground to the camera, robot frame. heading: [rad] of the robot.
    Returns (N,) float32, in units of the light on the ground. Blinn-Phong with Schlick's Fresnel factor.
    """
    total = np.zeros(len(to_camera), dtype=np.float32)
    fresnel = 0.06 + 0.94 * (1 - np.clip(to_camera[:, 2], 0, 1)) ** 5
    for lamp in light.lamps:
        x, y, z = lamp.direction
        cos, sin = math.cos(heading), math.sin(heading)
        half = to_camera + np.array([cos * x + sin * y, -sin * x + cos * y, z])
        half_z = half[:, 2] / np.linalg.norm(half, axis=1)
        sharpness = 12 / max(lamp.size, 0.02)
        total += (lamp.share * sharpness / 20 * fresnel * half_z**sharpness).astype(np.float32)
    return light.glare * 3 * total
