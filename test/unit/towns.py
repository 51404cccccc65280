"""Small towns for tests, and their measures worked out by hand for a tile of 0.585 m and a lane of 0.22 m."""

import cmath
import math
from typing import Tuple

from obst_avoid.core.settings import read_yaml
from obst_avoid.sim.light import Light
from obst_avoid.sim.town import Route, Town, WorldPose, town_from_mapping
from unit.shipped import CONFIG

SIZE, LANE = 0.585, 0.22
MIDDLE = 0.2925
"""[m] the road's middle, from the tile's border."""
OFFSET = 0.1225
"""[m] from the road's middle to the lane's: half of the yellow line's 25 mm and half of the lane."""
TIGHT, WIDE = 0.17, 0.415
"""[m] radius of a turn to the right and to the left."""
DULL = Light(lamps=(), glare=0.0, unevenness=0.0)
"""Light from everywhere: no shadow of a lamp, no glare, the same at every place."""


def town(*rows: str, dashed: bool = True) -> Town:
    """A checked town of the given rows, from north to south."""
    mapping = {'tile_size': SIZE, 'lane_width': LANE, 'dashed': dashed, 'tiles': '\n'.join(rows)}
    return town_from_mapping(mapping, 'town')


def shipped_town(name: str) -> Town:
    """One of config/towns."""
    return town_from_mapping(read_yaml(str(CONFIG / 'towns' / (name + '.yaml'))), name)


def walked(route: Route, along: float) -> Tuple[complex, float]:
    """Where the lane's centre is, x + iy in m, and its heading in rad: from chord to chord.

    A way of length s that turns evenly by a has a chord of s * sin(a / 2) / (a / 2) in its middle heading.
    """
    place, heading = complex(route.segments[0].x, route.segments[0].y), route.segments[0].heading
    for segment in route.segments:
        length = min(along, segment.length)
        half = segment.curvature * length / 2
        chord = length * (math.sin(half) / half if half else 1)
        place += chord * cmath.exp(1j * (heading + half))
        heading += 2 * half
        along -= length
        if along <= 0:
            break
    return place, heading


def beside(place: complex, heading: float, d: float, phi: float) -> WorldPose:
    """The pose d m left of a place, turned phi rad left of its heading."""
    moved = place + d * 1j * cmath.exp(1j * heading)
    return WorldPose(moved.real, moved.imag, heading + phi)


def turned(heading: float, other: float) -> float:
    """[rad] between two headings, from -pi to pi."""
    return math.remainder(heading - other, 2 * math.pi)
