"""The town: tiles, the paint's measures, and the lanes through it.

World frame: x east, y north, z up, origin at the south-west corner of the map, m. Traffic keeps to the right.
Measures: Duckietown's appearance specification.
"""

import math
from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np
from shapely.geometry import LineString, Polygon

from obst_avoid.core.settings import SettingsError, checked, flag, load, number
from obst_avoid.core.types import Array, LanePose

WHITE_WIDTH, YELLOW_WIDTH, RED_WIDTH = 0.048, 0.025, 0.048
"""[m] of the tape."""
DASH = 2 / 3
"""Share of a dash in the yellow line's period of about 75 mm."""

ROADS: Dict[str, str] = {
    ' ': '', '.': '', '─': 'EW', '│': 'NS', '┌': 'ES', '┐': 'SW', '└': 'EN', '┘': 'NW',
    '├': 'ENS', '┤': 'NSW', '┬': 'ESW', '┴': 'ENW', '┼': 'ENSW',
}  # fmt: skip
"""A tile's character shows its roads; these are the sides that they reach."""
SIDES: Dict[str, Tuple[int, int]] = {'E': (1, 0), 'N': (0, 1), 'W': (-1, 0), 'S': (0, -1)}
"""Steps (x, y) over each side."""
HEADINGS = {'east': 'E', 'north': 'N', 'west': 'W', 'south': 'S'}
TURNS = {'straight': 0, 'left': 1, 'right': -1}
"""Quarter turns to the left."""
_AROUND = 'ENWS'


class TownError(SettingsError):
    """A map or a route that cannot be. The message names the place and what was expected."""


@dataclass(frozen=True)
class Town:
    """A map. tile_size, lane_width: [m], the lane between the lines' inner edges. dashed: the yellow line, else solid.

    tiles: rows from north to south.
    """

    tile_size: float = number('m', at_least=0.4, at_most=1.0)
    lane_width: float = number('m', above=0.1)
    dashed: bool = flag()
    tiles: Tuple[str, ...] = checked(lambda value, where: _tiles(value, where))

    @property
    def size(self) -> Tuple[float, float]:
        """[m] of the map, (x, y)."""
        return len(self.tiles[0]) * self.tile_size, len(self.tiles) * self.tile_size

    @property
    def lane_offset(self) -> float:
        """[m] from the road's middle to the lane's."""
        return (YELLOW_WIDTH + self.lane_width) / 2

    def tile(self, column: int, row: int) -> str:
        """The character of a tile; row 0 is the southernmost. Beyond the map: empty."""
        if 0 <= row < len(self.tiles) and 0 <= column < len(self.tiles[0]):
            return self.tiles[len(self.tiles) - 1 - row][column]
        return ' '


@dataclass(frozen=True)
class Segment:
    """A piece of a lane's centre line with constant curvature.

    x, y: [m] where it begins. heading: [rad] there. length: [m]. curvature: [1/m], positive to the left.
    crossing: True inside an intersection, where no line bounds the lane.
    """

    x: float
    y: float
    heading: float
    length: float
    curvature: float
    crossing: bool


@dataclass(frozen=True)
class Route:
    """The lane that a robot follows. segments: end to end. starts: [m] along the route where each begins."""

    segments: Tuple[Segment, ...]
    starts: Tuple[float, ...]
    lane_width: float

    @property
    def length(self) -> float:
        """[m] of all segments."""
        return self.starts[-1] + self.segments[-1].length


@dataclass(frozen=True)
class WorldPose:
    """A place in the world. x, y: [m]. heading: [rad] from east to the left."""

    x: float
    y: float
    heading: float


def town_from_mapping(mapping: object, where: str) -> Town:
    """A checked town from the content of a YAML file. Raises SettingsError or TownError."""
    town = load(Town, mapping, where)
    half = YELLOW_WIDTH / 2 + town.lane_width + WHITE_WIDTH
    if 2 * half > town.tile_size:
        raise TownError(
            '%s/lane_width = %g, expected at most %.3f m on tiles of %g m'
            % (where, town.lane_width, town.lane_width - half + town.tile_size / 2, town.tile_size)
        )
    for row in range(len(town.tiles)):
        for column in range(len(town.tiles[0])):
            for side in ROADS[town.tile(column, row)]:
                dx, dy = SIDES[side]
                neighbour = town.tile(column + dx, row + dy)
                inside = 0 <= column + dx < len(town.tiles[0]) and 0 <= row + dy < len(town.tiles)
                if inside and _opposite(side) not in ROADS[neighbour]:
                    raise TownError(
                        '%s: the road of tile %r at column %d, row %d from the south ends at its %s side, '
                        'expected the next tile to go on' % (where, town.tile(column, row), column, row, side)
                    )
    return town


def follow(town: Town, column: int, row: int, heading: str, turns: Sequence[str] = (), length: float = 50.0) -> Route:
    """The lane from the entry of a tile on, at least `length` m of it, or to where the road leaves the map.

    heading: in which the tile is entered, a key of HEADINGS. turns: keys of TURNS, one an intersection; after the
    last one the road is followed straight on where it can be, else right, else left.
    Raises TownError when there is no such road or no such turn.
    """
    if heading not in HEADINGS:
        raise TownError('heading = %r, expected one of: %s' % (heading, ', '.join(HEADINGS)))
    out, left_turns = HEADINGS[heading], list(turns)
    segments: List[Segment] = []
    while sum(segment.length for segment in segments) < length:
        roads = ROADS[town.tile(column, row)]
        came = _opposite(out)
        if came not in roads:
            if segments:
                break
            raise TownError('no road enters the tile at column %d, row %d heading %s' % (column, row, heading))
        crossing = len(roads) > 2
        possible = {turn: _turned(out, quarter) for turn, quarter in TURNS.items() if _turned(out, quarter) in roads}
        if crossing and left_turns:
            turn = left_turns.pop(0)
            if turn not in possible:
                raise TownError(
                    'turn %r at the intersection in column %d, row %d, expected one of: %s'
                    % (turn, column, row, ', '.join(possible))
                )
        else:
            turn = next(name for name in ('straight', 'right', 'left') if name in possible)
        segments.append(_segment(town, column, row, out, TURNS[turn], crossing))
        out = possible[turn]
        column, row = column + SIDES[out][0], row + SIDES[out][1]
    starts = np.concatenate([[0.0], np.cumsum([segment.length for segment in segments])[:-1]])
    return Route(tuple(segments), tuple(float(start) for start in starts), town.lane_width)


def pose_at(route: Route, along: float, d: float = 0.0, phi: float = 0.0) -> WorldPose:
    """The world pose at `along` m of the route, d m left of the lane's centre, turned phi rad left of it."""
    index = _index(route, along)
    segment, rest = route.segments[index], along - route.starts[index]
    heading = segment.heading + segment.curvature * rest
    if segment.curvature:
        radius = 1 / segment.curvature
        x = segment.x + radius * (math.sin(heading) - math.sin(segment.heading))
        y = segment.y - radius * (math.cos(heading) - math.cos(segment.heading))
    else:
        x, y = segment.x + rest * math.cos(heading), segment.y + rest * math.sin(heading)
    return WorldPose(x - d * math.sin(heading), y + d * math.cos(heading), heading + phi)


def locate(route: Route, pose: WorldPose, near: float, window: float = 0.6) -> Tuple[float, LanePose]:
    """Where a pose is on the route: (m along it, lane pose with the lane's curvature there).

    near: [m] along the route where it was last; the route may cross itself, so only `window` m around it counts.
    """
    best: Optional[Tuple[float, float, LanePose]] = None
    for index in range(_index(route, near - window), _index(route, near + window) + 1):
        segment = route.segments[index]
        rest, d, heading = _local(segment, pose.x, pose.y)
        distance = abs(d) + abs(rest - min(max(rest, 0.0), segment.length))
        if best is None or distance < best[0]:
            phi = math.remainder(pose.heading - heading, 2 * math.pi)
            best = (distance, route.starts[index] + rest, LanePose(d, phi, segment.curvature))
    assert best is not None
    return best[1], best[2]


def turn_ahead(route: Route, along: float, within: float) -> Optional[str]:
    """The turn, a key of TURNS, that the route takes at the intersection where it is or which begins within so many m;
    None: there is none.
    """
    for segment, start in zip(route.segments, route.starts):
        if segment.crossing and start <= along + within and along < start + segment.length:
            return next(name for name, quarter in TURNS.items() if quarter == np.sign(segment.curvature))
    return None


def lane_strip(route: Route, begin: float, end: float) -> Polygon:
    """The lane between its lines from `begin` to `end` m along the route, as a polygon of the world."""
    begin, end = max(begin, 0.0), min(end, route.length)
    stops = np.linspace(begin, end, max(2, int((end - begin) / 0.01)))
    poses = [pose_at(route, float(stop)) for stop in stops]
    return LineString([(pose.x, pose.y) for pose in poses]).buffer(route.lane_width / 2, cap_style=2)


def crossing_at(town: Town, x: float, y: float) -> bool:
    """True inside an intersection's tile."""
    tile = town.tile(int(x // town.tile_size), int(y // town.tile_size))
    return len(ROADS[tile]) > 2


def robot_from_world(points: Array, pose: WorldPose) -> Array:
    """(N, 2) points of the world in the robot frame, m."""
    offset = np.asarray(points, dtype=np.float64) - (pose.x, pose.y)
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    robot: Array = offset @ np.array([[cos, -sin], [sin, cos]])
    return robot


def world_from_robot(points: Array, pose: WorldPose) -> Array:
    """The inverse of robot_from_world."""
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    world: Array = np.asarray(points, dtype=np.float64) @ np.array([[cos, sin], [-sin, cos]]) + (pose.x, pose.y)
    return world


def _tiles(value: object, where: str) -> Tuple[str, ...]:
    rows = value.strip('\n').split('\n') if isinstance(value, str) else []
    width = max((len(row) for row in rows), default=0)
    if not width:
        raise TownError('%s = %r, expected rows of tiles drawn with %s' % (where, value, ''.join(ROADS)))
    for number_, row in enumerate(rows):
        for column, tile in enumerate(row):
            if tile not in ROADS:
                raise TownError(
                    '%s has %r in line %d, column %d, expected one of: %s'
                    % (where, tile, number_ + 1, column + 1, ' '.join(ROADS))
                )
    return tuple(row.ljust(width) for row in rows)


def _opposite(side: str) -> str:
    return _turned(side, 2)


def _turned(side: str, quarters: int) -> str:
    return _AROUND[(_AROUND.index(side) + quarters) % 4]


def _segment(town: Town, column: int, row: int, out: str, quarters: int, crossing: bool) -> Segment:
    """The lane through a tile that is entered heading over `out` and left after so many quarter turns to the left."""
    size, offset = town.tile_size, town.lane_offset
    heading = _AROUND.index(out) * math.pi / 2
    dx, dy = SIDES[out]
    x = (column + 0.5) * size - dx * size / 2 + dy * offset  # to the right of (dx, dy) is (dy, -dx)
    y = (row + 0.5) * size - dy * size / 2 - dx * offset
    if not quarters:
        return Segment(x, y, heading, size, 0.0, crossing)
    radius = size / 2 + quarters * offset
    return Segment(x, y, heading, radius * math.pi / 2, quarters / radius, crossing)


def _index(route: Route, along: float) -> int:
    return max(int(np.searchsorted(route.starts, along, side='right')) - 1, 0)


def _local(segment: Segment, x: float, y: float) -> Tuple[float, float, float]:
    """(m along the segment's line, m left of it, its heading there); beyond its ends the line goes on."""
    dx, dy = x - segment.x, y - segment.y
    cos, sin = math.cos(segment.heading), math.sin(segment.heading)
    along, left = cos * dx + sin * dy, -sin * dx + cos * dy
    if not segment.curvature:
        return along, left, segment.heading
    radius = 1 / segment.curvature
    turned = math.atan2(along, (radius - left) * math.copysign(1, radius))
    distance = radius - math.copysign(math.hypot(along, radius - left), radius)
    return turned * abs(radius), distance, segment.heading + turned * math.copysign(1, radius)
