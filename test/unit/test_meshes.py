"""sim.meshes: every thing stands on the road, is closed to the eye, lean, and of its own colour."""

import re
from typing import Any

import numpy as np
import pytest

from obst_avoid.sim.meshes import SORTS, Mesh, footprint_of, mesh_of

LONGEST_EDGE = 0.22
MOST_TRIANGLES = {'duckie': 2000, 'cone': 1200, 'banded_cone': 1200}
YELLOW, ORANGE = (40, 65), (5, 40)
"""[degrees] of hue."""

each_sort = pytest.mark.parametrize('sort', SORTS)
upright_and_lying = pytest.mark.parametrize('lying', [False, True], ids=['upright', 'lying'])


def corners_of(mesh: Mesh) -> Any:
    """(M, 3, 3) float64: triangle, corner, coordinate."""
    return mesh.vertices.astype(np.float64)[mesh.triangles]


def facing_of(mesh: Mesh) -> Any:
    """(M, 3) normal of each triangle by the order of its corners, as long as its area."""
    a, b, c = corners_of(mesh).transpose(1, 0, 2)
    return np.cross(b - a, c - a) / 2


def edges_of(mesh: Mesh) -> Any:
    """(M, 3) lengths."""
    corners = corners_of(mesh)
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)


def share_of_hue(mesh: Mesh, hues: Any, seen_from: Any = None) -> float:
    """Share of the area that is vivid and of such a hue: of the whole surface, or of what faces one side."""
    red, green, blue = mesh.albedo[mesh.triangles[:, 0]].astype(np.float64).T ** (1 / 2.2)
    high, low = np.maximum(np.maximum(red, green), blue), np.minimum(np.minimum(red, green), blue)
    hue = 60 * (green - blue) / np.maximum(high - low, 1e-9)  # where red is strongest
    vivid = (red == high) & (high > 0.4) & (high - low > 0.5 * high)
    area = np.linalg.norm(facing_of(mesh), axis=1)
    if seen_from is not None:
        area = np.maximum(facing_of(mesh) @ np.array(seen_from, np.float64), 0)
    return float(area[vivid & (hues[0] < hue) & (hue < hues[1])].sum() / area.sum())


def parts_of(mesh: Mesh) -> Any:
    """(M,) a number for each triangle, the same for all that hang together."""
    _, place = np.unique(np.round(mesh.vertices, 4), axis=0, return_inverse=True)
    triangles = place.reshape(-1)[mesh.triangles]
    label = np.arange(triangles.max() + 1)
    while True:
        before = label.copy()
        np.minimum.at(label, triangles, label[triangles].min(axis=1, keepdims=True))
        if (label == before).all():
            return label[triangles[:, 0]]


def test_the_sorts() -> None:
    assert set(SORTS) == {
        *('duckie', 'cone', 'banded_cone', 'duckiebot', 'sign'),
        *('wood', 'cardboard', 'hand', 'grass', 'ball', 'post'),
    }


def test_an_unknown_sort_is_named_with_the_known_ones() -> None:
    message = "unknown sort of thing 'cow', expected one of: " + ', '.join(SORTS)
    with pytest.raises(ValueError, match='^%s$' % re.escape(message)):
        mesh_of('cow')
    with pytest.raises(ValueError, match='^%s$' % re.escape(message)):
        footprint_of('cow')


@upright_and_lying
@each_sort
def test_shapes_and_types(sort: str, lying: bool) -> None:
    mesh = mesh_of(sort, lying)
    count = len(mesh.vertices)
    for array in (mesh.vertices, mesh.normals, mesh.albedo):
        assert (array.shape, array.dtype) == ((count, 3), np.float32)
    assert (mesh.gloss.shape, mesh.gloss.dtype) == ((count,), np.float32)
    assert (mesh.triangles.shape[1:], mesh.triangles.dtype) == ((3,), np.int32)


@upright_and_lying
@each_sort
def test_every_vertex_is_used_and_every_triangle_has_an_area(sort: str, lying: bool) -> None:
    mesh = mesh_of(sort, lying)
    assert set(mesh.triangles.ravel()) == set(range(len(mesh.vertices)))
    assert np.linalg.norm(facing_of(mesh), axis=1).min() > 1e-7


@upright_and_lying
@each_sort
def test_what_callers_share_is_read_only(sort: str, lying: bool) -> None:
    mesh = mesh_of(sort, lying)
    assert mesh is mesh_of(sort, lying)
    arrays = (mesh.vertices, mesh.normals, mesh.albedo, mesh.gloss, mesh.triangles, footprint_of(sort, lying))
    assert not any(array.flags.writeable for array in arrays)


@upright_and_lying
@each_sort
def test_it_stands_on_the_ground(sort: str, lying: bool) -> None:
    assert mesh_of(sort, lying).vertices[:, 2].min() == pytest.approx(0, abs=1e-6)


@each_sort
def test_upright_it_is_1_m_high(sort: str) -> None:
    assert mesh_of(sort).vertices[:, 2].max() == pytest.approx(1, abs=1e-6)


@each_sort
def test_lying_it_is_the_same_thing(sort: str) -> None:
    assert edges_of(mesh_of(sort, lying=True)) == pytest.approx(edges_of(mesh_of(sort)), abs=1e-5)


@pytest.mark.parametrize('sort', ['duckie', 'cone', 'banded_cone', 'sign', 'post'])
def test_lying_it_is_lower(sort: str) -> None:
    assert mesh_of(sort, lying=True).vertices[:, 2].max() < 0.9


@pytest.mark.parametrize('sort', ['cone', 'banded_cone'])
def test_a_lying_cone_touches_the_ground_with_base_and_tip(sort: str) -> None:
    mesh = mesh_of(sort, lying=True)
    touching = mesh.vertices[mesh.vertices[:, 2] < 0.002]
    assert np.ptp(touching[:, 1]) > 0.9
    assert share_of_hue(mesh, ORANGE) == pytest.approx(share_of_hue(mesh_of(sort), ORANGE), abs=1e-6)


@upright_and_lying
@each_sort
def test_triangles_and_normals_face_outward(sort: str, lying: bool) -> None:
    mesh = mesh_of(sort, lying)
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1, abs=1e-5)
    facing, corners = facing_of(mesh), corners_of(mesh)
    area = np.linalg.norm(facing, axis=1)
    agree = (facing * mesh.normals[mesh.triangles].mean(axis=1)).sum(axis=1) > 0
    assert area[agree].sum() > 0.98 * area.sum()
    parts = parts_of(mesh)
    for part in np.unique(parts):
        inside = corners[parts == part]
        middle = inside.reshape(-1, 3).mean(axis=0)
        assert (facing[parts == part] * (inside[:, 0] - middle)).sum() > 0  # thrice the volume


@upright_and_lying
@each_sort
def test_fine_enough_to_be_bent_yet_lean(sort: str, lying: bool) -> None:
    mesh = mesh_of(sort, lying)
    assert edges_of(mesh).max() <= LONGEST_EDGE
    assert len(mesh.triangles) <= MOST_TRIANGLES.get(sort, 2500)


@each_sort
def test_albedo_and_gloss_are_shares(sort: str) -> None:
    mesh = mesh_of(sort)
    for array in (mesh.albedo, mesh.gloss):
        assert np.isfinite(array).all() and array.min() >= 0 and array.max() <= 1


def test_albedo_is_linear() -> None:
    # sRGB 250, 205, 40: by the formula of IEC 61966-2-1
    behind = mesh_of('duckie').vertices[:, 0].argmin()
    assert mesh_of('duckie').albedo[behind] == pytest.approx([0.9560, 0.6105, 0.0212], abs=1e-4)


@upright_and_lying
@each_sort
def test_the_footprint_is_the_hull_of_what_is_above(sort: str, lying: bool) -> None:
    hull, points = footprint_of(sort, lying).astype(np.float64), mesh_of(sort, lying).vertices[:, :2].astype(np.float64)
    assert 3 <= len(hull) <= 40
    edges = np.roll(hull, -1, axis=0) - hull
    left = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
    beyond = ((points[:, None] - hull) * left).sum(axis=2)
    assert beyond.min() > -1e-6  # on the left of every edge: it holds all, convex, counter-clockwise
    assert {tuple(corner) for corner in hull} <= {tuple(point) for point in points}
    assert hull.min(axis=0) + hull.max(axis=0) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(
    'sort, length, width',
    [
        pytest.param('duckie', (1.0, 1.1), (0.85, 0.9), id='duckie'),
        pytest.param('cone', (0.7, 0.8), (0.7, 0.8), id='cone'),
        pytest.param('duckiebot', (1.45, 1.55), (1.2, 1.3), id='duckiebot'),
        pytest.param('sign', (0.1, 0.3), (0.38, 0.42), id='sign'),
        pytest.param('wood', (0.8, 0.8), (0.6, 0.6), id='wood'),
        pytest.param('cardboard', (1.2, 1.21), (0.9, 0.9), id='cardboard'),
        pytest.param('post', (0.05, 0.06), (0.05, 0.06), id='post'),
    ],
)
def test_proportions(sort: str, length: Any, width: Any) -> None:
    for size, (least, most) in zip(np.ptp(footprint_of(sort), axis=0), (length, width)):
        assert least - 0.005 <= size <= most + 0.005


def test_it_faces_ahead() -> None:
    duckie, sign = mesh_of('duckie'), mesh_of('sign')
    orange = duckie.vertices[duckie.albedo[:, 1] < 0.5 * duckie.albedo[:, 0]]
    assert orange[:, 0].min() > 0.1
    red = sign.vertices[sign.albedo[:, 1] < 0.1 * sign.albedo[:, 0]]
    top = sign.vertices[sign.vertices[:, 2] > 0.65]
    assert red[:, 0].max() == top[:, 0].max()


def test_a_duckie_is_yellow_from_every_side() -> None:
    for side in ((-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)):
        assert share_of_hue(mesh_of('duckie'), YELLOW, side) > 0.7


@pytest.mark.parametrize('sort, least, most', [('cone', 0.8, 0.95), ('banded_cone', 0.6, 0.8)])
def test_a_cone_is_orange_on_a_dark_base(sort: str, least: float, most: float) -> None:
    mesh = mesh_of(sort)
    assert least < share_of_hue(mesh, ORANGE, (-1, 0, 0)) < most
    assert mesh.albedo[mesh.vertices[:, 2] < 0.05].max() < 0.03


def test_the_band_is_white_and_round_the_middle() -> None:
    mesh = mesh_of('banded_cone')
    white = mesh.vertices[mesh.albedo.min(axis=1) > 0.7]
    assert (white[:, 2].min(), white[:, 2].max()) == pytest.approx((0.45, 0.65), abs=1e-3)
    assert mesh_of('cone').albedo.min(axis=1).max() < 0.1


@each_sort
def test_only_duckies_are_yellow_and_only_cones_and_beaks_orange(sort: str) -> None:
    mesh = mesh_of(sort)
    if sort == 'duckiebot':
        assert 0 < share_of_hue(mesh, YELLOW) < 0.02  # its number plate
    elif sort != 'duckie':
        assert share_of_hue(mesh, YELLOW) == 0
    if sort not in ('duckie', 'cone', 'banded_cone'):
        assert share_of_hue(mesh, ORANGE) == 0
