"""What stands on a rendered road: duckies, cones and what a detector may mistake for one. No files, all procedural.

Each thing is a handful of closed surfaces that may run into each other: only their outside is ever seen.
"""

import functools
import math
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.types import Array

Triple = Tuple[float, float, float]
Profile = Sequence[Tuple[float, float]]

PAINT: Dict[str, Tuple[int, int, int, float]] = {
    'yellow rubber': (250, 205, 40, 0.5),
    'orange rubber': (236, 112, 24, 0.5),
    'eye': (14, 14, 16, 0.9),
    'glint': (240, 240, 240, 0.3),
    'cone': (240, 100, 30, 0.3),
    'cone band': (235, 235, 230, 0.3),
    'cone base': (34, 34, 36, 0.15),
    'acrylic': (24, 36, 92, 0.8),
    'tyre': (26, 26, 27, 0.1),
    'hub': (150, 152, 155, 0.3),
    'battery': (45, 46, 50, 0.4),
    'brass': (150, 128, 96, 0.7),
    'board': (24, 98, 52, 0.3),
    'chip': (30, 30, 32, 0.3),
    'bumper': (228, 228, 224, 0.4),
    'number plate': (245, 205, 50, 0.3),
    'camera': (22, 22, 24, 0.4),
    'sign red': (190, 28, 36, 0.3),
    'paper': (235, 235, 232, 0.1),
    'ink': (22, 22, 22, 0.1),
    'wood': (204, 166, 122, 0.1),
    'cardboard': (172, 132, 94, 0.0),
    'tape': (198, 166, 128, 0.5),
    'skin': (220, 168, 142, 0.15),
    'soil': (72, 58, 46, 0.0),
    'grass': (74, 128, 46, 0.1),
    'young grass': (98, 152, 60, 0.1),
    'ball': (32, 82, 190, 0.1),
    'grey metal': (140, 142, 145, 0.3),
}
"""sRGB, 0 to 255, then gloss."""
STEP = 0.15
"""Longest side of a quad on a flat face: its diagonal stays below the 0.22 that bending by a lens allows."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface. vertices, normals: (N, 3) float32, m, outward unit normals. albedo: (N, 3) float32, linear RGB 0 to 1.
    gloss: (N,) float32, 0 matt to 1 glossy. triangles: (M, 3) int32, counter-clockwise seen from outside.
    """

    vertices: Array
    normals: Array
    albedo: Array
    gloss: Array
    triangles: Array


@functools.lru_cache(maxsize=None)
def mesh_of(sort: str, lying: bool = False) -> Mesh:
    """Height 1 m upright, standing on z = 0, facing +x, its footprint centred on the origin.

    lying: tipped over on its left side (a cone lies on the edge of its base and its tip), same scale, touching z = 0,
    footprint centred. The arrays are shared and read-only. Raises ValueError for an unknown sort.
    """
    if sort not in _BUILDERS:
        raise ValueError("unknown sort of thing '%s', expected one of: %s" % (sort, ', '.join(SORTS)))
    mesh = _joined(_BUILDERS[sort]())
    mesh = replace(mesh, vertices=mesh.vertices / np.float32(np.ptp(mesh.vertices[:, 2])))
    if lying:
        turn = _tipping(mesh.vertices)
        mesh = replace(mesh, vertices=mesh.vertices @ turn.T, normals=mesh.normals @ turn.T)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    mesh = replace(mesh, vertices=mesh.vertices - np.append((low + high)[:2] / 2, low[2]))
    for array in (mesh.vertices, mesh.normals, mesh.albedo, mesh.gloss, mesh.triangles):
        array.setflags(write=False)
    return mesh


def coarse(mesh: Mesh, cell: float) -> Mesh:
    """The same with less detail: vertices that share a cube of `cell` m and a colour become one (vertex clustering)."""
    keys = np.concatenate([np.floor(mesh.vertices / cell), np.round(4 * mesh.albedo)], axis=1).astype(np.int64)
    _, group, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    group = group.ravel()

    def mean(values: Array) -> Array:
        total = np.zeros((len(counts), *values.shape[1:]), dtype=np.float64)
        np.add.at(total, group, values)
        shape = (-1,) + (1,) * (values.ndim - 1)
        averaged: Array = (total / counts.reshape(shape)).astype(np.float32)
        return averaged

    normals = mean(mesh.normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
    triangles = group[mesh.triangles].astype(np.int32)
    first, second, third = triangles.T
    kept = (first != second) & (second != third) & (first != third)
    return Mesh(mean(mesh.vertices), normals, mean(mesh.albedo), mean(mesh.gloss), np.unique(triangles[kept], axis=0))


@functools.lru_cache(maxsize=None)
def footprint_of(sort: str, lying: bool = False) -> Array:
    """(K, 2) convex hull, counter-clockwise, of the vertical projection of the mesh onto the ground, unit height."""
    hull: Array = _hull(mesh_of(sort, lying).vertices[:, :2])
    hull.setflags(write=False)
    return hull


def _hull(points: Array) -> Array:
    """Counter-clockwise convex hull. points: (N, 2)."""
    hull: Array = cv2.convexHull(np.ascontiguousarray(points, np.float32), clockwise=False)[:, 0]
    return hull


def _tipping(vertices: Array) -> Array:
    """(3, 3) the turn about x that lays a thing on its left side.

    Seen along x, the thing comes to rest on the longest edge of its silhouette's hull that looks to the left.
    """
    hull = _hull(vertices[:, 1:])
    edges = np.roll(hull, -1, axis=0) - hull
    leftward = edges[edges[:, 1] > np.abs(edges[:, 0])].astype(np.float64)
    lengths = np.hypot(leftward[:, 0], leftward[:, 1])
    cos, sin = leftward[lengths.argmax()] / lengths.max()
    return np.array([(1, 0, 0), (0, cos, sin), (0, -sin, cos)], np.float32)


def _joined(parts: Sequence[Mesh]) -> Mesh:
    """All parts as one mesh."""
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.albedo for part in parts]),
        np.concatenate([part.gloss for part in parts]),
        np.concatenate([part.triangles + start for part, start in zip(parts, starts)]).astype(np.int32),
    )


def _smooth(points: Array, triangles: Array, paint: str) -> Mesh:
    """One smooth surface of one paint: points at one place become one vertex. points: (N, 3)."""
    _, first, place = np.unique(np.round(points * 1e5).astype(np.int64), axis=0, return_index=True, return_inverse=True)
    vertices, triangles = points[first], place.reshape(-1)[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    facing = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for corner in triangles.T:
        np.add.at(normals, corner, facing)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    red, green, blue, gloss = PAINT[paint]
    albedo = np.tile(_linear(np.array([red, green, blue]) / 255), (len(vertices), 1))
    shine = np.full(len(vertices), gloss, np.float32)
    return Mesh(vertices.astype(np.float32), normals.astype(np.float32), albedo, shine, triangles.astype(np.int32))


def _linear(srgb: Array) -> Array:
    """Linear light from sRGB, both 0 to 1 (IEC 61966-2-1)."""
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return np.asarray(linear, np.float32)


def _grid_triangles(rows: int, columns: int) -> Array:
    """(2 (rows - 1) (columns - 1), 3) indices; outside is where rows x columns points."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    halves: Array = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    return halves.reshape(-1, 3)


def _cube(counts: Tuple[int, int, int]) -> List[Tuple[Array, Array]]:
    """Points and triangles of each face of the cube from -1 to 1. counts: quads along x, y, z."""
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            points = np.empty((counts[u] + 1, counts[v] + 1, 3))
            points[..., axis] = side
            points[..., u] = side * np.linspace(-1, 1, counts[u] + 1)[:, None]
            points[..., v] = np.linspace(-1, 1, counts[v] + 1)
            faces.append((points.reshape(-1, 3), _grid_triangles(counts[u] + 1, counts[v] + 1)))
    return faces


def _sphere(quads: int) -> Tuple[Array, Array]:
    """Unit vectors and triangles, 12 quads^2 of them: a cube blown up."""
    faces = _cube((quads, quads, quads))
    points = np.tan(np.concatenate([points for points, _ in faces]) * math.pi / 4)
    triangles = np.concatenate([face + i * (quads + 1) ** 2 for i, (_, face) in enumerate(faces)])
    return points / np.linalg.norm(points, axis=1, keepdims=True), triangles


def _nose_up(points: Array, degrees: float) -> Array:
    """Turned about y so that +x rises."""
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turned: Array = points @ np.array([(cos, 0, sin), (0, 1, 0), (-sin, 0, cos)])
    return turned


def _ellipsoid(centre: Triple, radii: Triple, paint: str, quads: int, nose_up: float = 0.0) -> Mesh:
    """nose_up: degrees."""
    directions, triangles = _sphere(quads)
    return _smooth(_nose_up(directions * radii, nose_up) + centre, triangles, paint)


def _melted(balls: Sequence[Tuple[Triple, Triple]], core: Triple, sharpness: float, quads: int) -> Tuple[Array, Array]:
    """Points and triangles of ellipsoids that flow into each other, as far as seen from a core inside.

    balls: each a centre and its radii. sharpness: the higher, the narrower the fillets between them.
    """
    directions, triangles = _sphere(quads)
    reach = np.linspace(0, 1.2, 301)
    points = core + reach[:, None, None] * directions
    depth = -np.ones(points.shape[:2])
    for centre, radii in balls:
        depth += np.exp(-sharpness * (np.linalg.norm((points - centre) / np.array(radii), axis=-1) - 1))
    last = len(reach) - 1 - np.argmax(depth[::-1] > 0, axis=0)
    rays = np.arange(len(directions))
    inner, outer = depth[last, rays], depth[last + 1, rays]
    distance = reach[last] + reach[1] * inner / (inner - outer)
    return core + distance[:, None] * directions, triangles


def _box(centre: Triple, size: Triple, paint: str, nose_up: float = 0.0) -> List[Mesh]:
    """nose_up: degrees."""
    x, y, z = (max(1, math.ceil(side / STEP - 1e-9)) for side in size)
    half = np.array(size) / 2
    return [
        _smooth(_nose_up(points * half, nose_up) + centre, triangles, paint) for points, triangles in _cube((x, y, z))
    ]


def _lathed(profile: Profile, paint: str, slices: int, spine: Sequence[Tuple[float, float]] = ((0, 0),)) -> Mesh:
    """A smooth surface turned about the z axis. profile: radius and z, upwards outside. spine: x, y of each ring."""
    radius, z = np.array(profile, np.float64).T
    angle = 2 * math.pi * (np.arange(slices + 1)[:, None] + 0.5) / slices
    x, y = np.array(spine, np.float64).T
    points = np.stack(np.broadcast_arrays(x + radius * np.cos(angle), y + radius * np.sin(angle), z), axis=-1)
    return _smooth(points.reshape(-1, 3), _grid_triangles(slices + 1, len(profile)), paint)


def _divided(start: Tuple[float, float], end: Tuple[float, float]) -> Profile:
    """The straight profile between two points, in steps short enough."""
    steps = max(1, math.ceil(math.hypot(end[0] - start[0], end[1] - start[1]) / STEP - 1e-9))
    return [(float(r), float(z)) for r, z in np.linspace(start, end, steps + 1)]


def _cylinder(centre: Triple, radius: float, length: float, axis: str, paint: str, slices: int) -> List[Mesh]:
    """axis: 'x', 'y' or 'z'."""
    corners = [(0.0, -length / 2), (radius, -length / 2), (radius, length / 2), (0.0, length / 2)]
    places = 'zxy'.index(axis)  # rolling x, y, z is a rotation
    return [
        replace(
            part,
            vertices=np.roll(part.vertices, places, axis=1) + np.array(centre, np.float32),
            normals=np.roll(part.normals, places, axis=1),
        )
        for part in (_lathed(_divided(a, b), paint, slices) for a, b in zip(corners, corners[1:]))
    ]


def _duckie() -> List[Mesh]:
    body, breast = ((-0.055, 0.0, 0.27), (0.465, 0.38, 0.27)), ((0.10, 0.0, 0.31), (0.33, 0.35, 0.28))
    head = ((0.12, 0.0, 0.71), (0.285, 0.285, 0.275))
    points, triangles = _melted([body, breast, head], (0.06, 0.0, 0.48), 9.0, 9)
    behind = np.maximum(-0.15 - points[:, 0], 0)
    points[:, 2] += 1.8 * behind**2  # the tail
    points[:, 1] *= 1 - 3.0 * behind**2
    points[:, 2] = np.maximum(points[:, 2], 0.03)
    parts = [
        _smooth(points, triangles, 'yellow rubber'),
        _ellipsoid((0.40, 0.0, 0.665), (0.14, 0.15, 0.045), 'orange rubber', 4, nose_up=14),
        _ellipsoid((0.38, 0.0, 0.625), (0.13, 0.125, 0.04), 'orange rubber', 3, nose_up=-6),
    ]
    for side in (-1, 1):
        parts.append(_ellipsoid((-0.03, 0.338 * side, 0.35), (0.22, 0.075, 0.13), 'yellow rubber', 4, nose_up=-14))
        parts.append(_ellipsoid((0.318, 0.14 * side, 0.79), (0.055, 0.055, 0.07), 'eye', 3))
        parts.append(_ellipsoid((0.365, 0.148 * side, 0.815), (0.018, 0.018, 0.018), 'glint', 2))
    return parts


def _cone(middle: str = 'cone') -> List[Mesh]:
    foot, low, high, shoulder = (0.27, 0.06), (0.188, 0.45), (0.146, 0.65), (0.08, 0.96)
    tip = [(0.08 * math.cos(t), 0.96 + 0.04 * math.sin(t)) for t in np.linspace(0, math.pi / 2, 5)]
    return [
        *_box((0.0, 0.0, 0.03), (0.75, 0.75, 0.06), 'cone base'),
        _lathed(_divided(foot, low), 'cone', 28),
        _lathed(_divided(low, high), middle, 28),
        _lathed([*_divided(high, shoulder), *tip[1:]], 'cone', 28),
    ]


def _duckiebot() -> List[Mesh]:
    parts = [
        *_box((-0.02, 0.0, 0.30), (1.30, 0.80, 0.04), 'acrylic'),
        *_box((0.0, 0.0, 0.43), (0.75, 0.50, 0.20), 'battery'),
        *_box((-0.05, 0.0, 0.60), (1.15, 0.80, 0.04), 'acrylic'),
        *_box((-0.15, 0.0, 0.68), (0.70, 0.48, 0.03), 'board'),
        *_box((-0.05, 0.05, 0.71), (0.18, 0.18, 0.05), 'chip'),
        *_box((-0.42, 0.10, 0.74), (0.16, 0.14, 0.12), 'hub'),
        *_box((-0.42, -0.10, 0.74), (0.16, 0.14, 0.12), 'hub'),
        *_box((-0.71, 0.0, 0.32), (0.08, 1.00, 0.26), 'bumper'),
        *_box((-0.755, 0.0, 0.33), (0.015, 0.36, 0.14), 'number plate'),
        *_box((0.48, 0.0, 0.72), (0.03, 0.24, 0.26), 'acrylic'),
        *_box((0.535, 0.0, 0.885), (0.03, 0.24, 0.20), 'acrylic', nose_up=-35),
        *_box((0.60, 0.0, 0.87), (0.06, 0.24, 0.24), 'camera', nose_up=-20),
        *_cylinder((0.66, 0.0, 0.85), 0.07, 0.12, 'x', 'camera', 12),
        _ellipsoid((-0.50, 0.0, 0.14), (0.13, 0.13, 0.14), 'hub', 3),
    ]
    for side in (-1, 1):
        parts += _cylinder((0.20, 0.515 * side, 0.275), 0.275, 0.20, 'y', 'tyre', 24)
        parts += _cylinder((0.20, 0.515 * side, 0.275), 0.15, 0.21, 'y', 'hub', 12)
        for x in (-0.55, 0.42):
            parts += _cylinder((x, 0.33 * side, 0.45), 0.025, 0.28, 'z', 'brass', 8)
    return parts


def _sign() -> List[Mesh]:
    parts = [
        *_box((0.0, 0.0, 0.02), (0.24, 0.30, 0.04), 'wood'),
        *_cylinder((0.0, 0.0, 0.45), 0.03, 0.86, 'z', 'wood', 10),
        *_cylinder((0.04, 0.0, 0.80), 0.2165, 0.02, 'x', 'paper', 8),
        *_cylinder((0.05, 0.0, 0.80), 0.185, 0.014, 'x', 'sign red', 8),
        *_box((0.04, 0.0, 0.46), (0.02, 0.28, 0.28), 'paper'),
        *_box((0.05, 0.0, 0.46), (0.008, 0.22, 0.22), 'ink'),
    ]
    for y, z in ((-1, 1), (0, 1), (1, 0), (-1, -1), (0, 0), (1, -1)):
        parts += _box((0.055, 0.055 * y, 0.46 + 0.055 * z), (0.006, 0.052, 0.052), 'paper')
    return parts


def _cardboard() -> List[Mesh]:
    tape = _box((0.0, 0.0, 0.885), (1.204, 0.14, 0.234), 'tape')
    return [*_box((0.0, 0.0, 0.5), (1.2, 0.9, 1.0), 'cardboard'), *tape]


def _hand() -> List[Mesh]:
    palm, wrist = ((0.0, 0.0, 0.46), (0.34, 0.36, 0.20)), ((-0.30, 0.0, 0.62), (0.22, 0.20, 0.20))
    forearm = ((-0.45, 0.0, 0.78), (0.22, 0.20, 0.22))
    parts = [
        _smooth(*_melted([palm, wrist, forearm], (-0.2, 0.0, 0.55), 7.0, 9), 'skin'),
        _ellipsoid((0.12, 0.37, 0.36), (0.30, 0.09, 0.10), 'skin', 4, nose_up=-30),
    ]
    for y, reach in ((0.25, 0.0), (0.085, 0.06), (-0.085, 0.04), (-0.25, -0.04)):
        parts.append(_ellipsoid((0.36 + reach, y, 0.42), (0.22, 0.085, 0.095), 'skin', 3, nose_up=-20))
        parts.append(_ellipsoid((0.52 + reach, y, 0.24), (0.21, 0.075, 0.08), 'skin', 3, nose_up=-68))
    return parts


def _grass() -> List[Mesh]:
    random = np.random.RandomState(7)
    points, triangles = _sphere(6)
    parts = [_smooth(np.maximum(points, (-1, -1, 0)) * (0.40, 0.40, 0.10), triangles, 'soil')]
    t = np.linspace(0, 1, 7)
    for i in range(48):
        heading, lean = 2.4 * i, 0.05 + 0.45 * i / 48  # the golden angle spreads them evenly
        start, height = 0.25 * math.sqrt(i / 48), random.uniform(0.7, 1.0) - 0.3 * i / 48
        out = start + lean * t**2
        spine = np.stack([out * math.cos(heading), out * math.sin(heading)], axis=1)
        profile = np.stack([0.032 * (1 - t**3), 0.02 + height * t], axis=1)
        parts.append(_lathed(profile.tolist(), 'young grass' if i % 3 else 'grass', 3, spine.tolist()))
    return parts


_BUILDERS: Dict[str, Callable[[], List[Mesh]]] = {
    'duckie': _duckie,
    'cone': _cone,
    'banded_cone': functools.partial(_cone, 'cone band'),
    'duckiebot': _duckiebot,
    'sign': _sign,
    'wood': functools.partial(_box, (0.0, 0.0, 0.5), (0.8, 0.6, 1.0), 'wood'),
    'cardboard': _cardboard,
    'hand': _hand,
    'grass': _grass,
    'ball': lambda: [_ellipsoid((0.0, 0.0, 0.5), (0.5, 0.5, 0.5), 'ball', 6)],
    'post': functools.partial(_cylinder, (0.0, 0.0, 0.5), 0.03, 1.0, 'z', 'grey metal', 14),
}
SORTS: Tuple[str, ...] = tuple(_BUILDERS)
