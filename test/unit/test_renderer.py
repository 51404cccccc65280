"""sim.renderer and sim.lens: road and things appear where OpenCV's lens model says, for made-up and real cameras."""

import itertools
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, Iterator, List, Tuple
from unittest import mock

import moderngl
import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration, load_calibration
from obst_avoid.sim import paint
from obst_avoid.sim.backdrop import Surfaces
from obst_avoid.sim.lens import Lens, lay_out
from obst_avoid.sim.light import Lamp, Light
from obst_avoid.sim.renderer import Renderer, RenderError, Scene
from obst_avoid.sim.things import Thing
from obst_avoid.sim.town import WorldPose
from unit.cameras import Camera, calibration_of
from unit.towns import DULL, MIDDLE, SIZE, town
from unit.views import (
    Eye,
    corners_of,
    eye_of_calibration,
    eye_of_camera,
    overlap,
    robot_points,
    sampled,
    silhouette,
)

CAMERAS = {
    'level': Camera(),
    'rolled': Camera(roll=2.0, pitch=30.0, height=0.12),
    'turned': Camera(yaw=4.0, left=0.01, pitch=15.0),
    'rectified': Camera(twist=3.0, roll=-2.0),
    '320x240': Camera().resized(320, 240),
    '1296x972': Camera(roll=1.5).resized(1296, 972),
    'other lens': Camera(distortion=(-0.32, 0.11, 0.004, -0.006, -0.012), roll=2.0, yaw=-3.0),
}
REAL = ['bamboo17', 'redrover', 'megaman']
ROAD = town('───┼──')
STOP = 3 * SIZE
"""[m] where the intersection begins, on the way east."""
WHITE_ON_BLACK = Surfaces((0.0,) * 3, (0.6,) * 3, (0.6,) * 3, (0.6,) * 3, (0.0,) * 3)
BRIGHT = (1.5, 1.5, 1.5)
START = WorldPose(1.0, 0.2, 0.3)


def place(ahead: float, left: float, pose: WorldPose = START) -> Tuple[float, float]:
    """A point of the robot frame in the world."""
    cos, sin = np.cos(pose.heading), np.sin(pose.heading)
    return float(pose.x + cos * ahead - sin * left), float(pose.y + sin * ahead + cos * left)


def thing(sort: str, ahead: float, left: float, **more: Any) -> Thing:
    """A thing at a place of the robot frame at START."""
    return Thing(sort, *place(ahead, left), **more)


@pytest.fixture(scope='module', params=[*CAMERAS, 'default', *REAL])
def eye(request: Any, tmp_path_factory: pytest.TempPathFactory) -> Eye:
    """What OpenCV says of each camera."""
    name = request.param
    if name in CAMERAS:
        return eye_of_camera(CAMERAS[name])
    if name == 'default':
        return eye_of_calibration(request.getfixturevalue('calibration'))
    folder, real = tmp_path_factory.mktemp(name), request.getfixturevalue('shared') / 'real' / 'calibrations' / name
    for kind in ('camera_intrinsic', 'camera_extrinsic'):
        (folder / kind).mkdir()
        shutil.copyfile(str(real / (kind + '.yaml')), str(folder / kind / (name + '.yaml')))
    return eye_of_calibration(load_calibration(str(folder), name))


@pytest.fixture(scope='module')
def lens(eye: Eye) -> Lens:
    """Laid out once, since that takes most of the time."""
    return lay_out(eye.calibration)


@pytest.fixture(scope='module')
def renderer_of_eye(eye: Eye, lens: Lens) -> Iterator[Renderer]:
    """Its renderer."""
    with mock.patch('obst_avoid.sim.renderer.lay_out', return_value=lens):
        renderer = Renderer(eye.calibration)
    yield renderer
    renderer.close()


@pytest.fixture(scope='module')
def level() -> Iterator[Renderer]:
    """The renderer of a camera without roll or yaw."""
    renderer = Renderer(calibration_of(CAMERAS['level']))
    yield renderer
    renderer.close()


def test_the_real_cameras_are_good_ones(shared: Path) -> None:
    index = json.loads((shared / 'real' / 'calibrations' / 'index.json').read_text())
    assert {entry['folder'] for entry in index if entry['ok']}.issuperset(REAL)


# The road


def paint_edges() -> Any:
    """(N, 5) points x, y [m] of paint edges of ROAD, the outward normal there, and how wide paint or gap are."""
    edges: List[Tuple[float, float, int, int, float]] = []
    for x in np.arange(STOP - 1.4, STOP - 0.01, 0.02):  # white lines: 0.22 m beside the yellow one, 48 mm wide
        edges += [(x, 0.012, 0, -1, 0.048), (x, 0.06, 0, 1, 0.048), (x, 0.525, 0, -1, 0.048), (x, 0.573, 0, 1, 0.048)]
    for dash in range(24):  # 8 periods a tile: a sixth of gap, two thirds of dash, a sixth of gap
        begin, end = (dash + 1 / 6) * SIZE / 8, (dash + 5 / 6) * SIZE / 8
        for y in np.arange(MIDDLE - 0.008, MIDDLE + 0.009, 0.004):
            edges += [(begin, y, -1, 0, 0.024), (end, y, 1, 0, 0.024)]
        for x in np.arange(begin + 0.018, end - 0.017, 0.006):
            edges += [(x, MIDDLE - 0.0125, 0, -1, 0.025), (x, MIDDLE + 0.0125, 0, 1, 0.025)]
    for y in np.arange(0.075, 0.27, 0.02):
        edges += [(STOP, y, -1, 0, 0.048), (STOP + 0.048, y, 1, 0, 0.048)]
    return np.array(edges)


def edge_errors(eye: Eye, picture: Any, pose: WorldPose) -> Any:
    """(N,) [px] by which edges of the rendered paint lie outside of where OpenCV projects them, along their normal."""
    edges = paint_edges()
    flat, zero = np.column_stack([edges[:, :2], np.zeros(len(edges))]), np.zeros(len(edges))
    outward = np.column_stack([edges[:, 2:4], zero])
    tangent = np.column_stack([-edges[:, 3], edges[:, 2], zero]) * 0.002

    def seen(points: Any) -> Any:
        return eye.project(robot_points(points, pose))

    pixels, direction = seen(flat), seen(flat + tangent) - seen(flat - tangent)
    normals = np.column_stack([-direction[:, 1], direction[:, 0]]) / np.linalg.norm(direction, axis=1)[:, None]
    inside = ((seen(flat - outward * edges[:, 4:]) - pixels) * normals).sum(axis=1)
    normals *= -np.sign(inside)[:, None]
    robot = robot_points(flat, pose)
    reach = 3 * max(1.0, eye.size[0] / 640)
    wide = (np.abs(inside) > 2 * reach + 2) & (robot[:, 0] > 0.08) & eye.sees(robot)
    steps = np.linspace(-reach, reach, 121)
    errors = []
    for pixel, normal in zip(pixels[wide], normals[wide]):
        profile = sampled(picture, pixel + steps[:, None] * normal)
        half = (np.median(profile[:20]) + np.median(profile[-20:])) / 2
        assert profile[:20].min() > half + 30 and profile[-20:].max() < half - 30, 'no edge near %s' % pixel
        errors.append(np.interp(-half, -profile, steps))
    return np.array(errors)


def test_each_pixel_of_the_road_lies_where_opencv_sees_it(eye: Eye, lens: Lens) -> None:
    v, u = np.nonzero(lens.on_ground)
    points = np.column_stack([lens.ground[v, u], np.zeros(len(u))])
    assert np.abs(eye.project(points) - np.column_stack([u, v])).max() < 0.05
    assert 0.5 < lens.on_ground.mean() < 0.9


def test_paint_appears_where_opencv_projects_it(eye: Eye, renderer_of_eye: Renderer) -> None:
    poses = [WorldPose(STOP - 0.42, 0.17, 0.0), WorldPose(STOP - 0.6, 0.2, 0.45), WorldPose(STOP - 0.4, 0.3, -0.5)]
    scene = Scene(ROAD, (), DULL, WHITE_ON_BLACK, seed=77)
    with mock.patch.object(paint, '_cloud', lambda _random, shape, _scales: np.zeros(shape, np.float32)):  # no wear
        pictures = [renderer_of_eye.render(scene, [pose], BRIGHT)[..., 1] for pose in poses]
    errors = np.concatenate([edge_errors(eye, picture, pose) for picture, pose in zip(pictures, poses)])
    assert len(errors) > 200
    # paint is drawn with 1.1 mm a pixel, four times as much as a pixel of 1296x972 shows close to the robot
    assert np.abs(errors).max() < 0.5 * max(1.0, eye.size[0] / 640)
    assert abs(errors.mean()) < 0.05


# Things

SOLID = ['ball', 'wood', 'cone', 'duckie', 'duckiebot', 'sign', 'post']
SPOTS = [(0.3, 0.0, False), (0.25, -0.12, True), (0.5, 0.2, False)]


def test_things_cover_the_pixels_that_opencv_projects_them_to(eye: Eye, renderer_of_eye: Renderer) -> None:
    if eye.calibration.vehicle in REAL:
        pytest.skip('a measured homography is not quite that of any pose: above the road nothing to compare with')
    compared = 0
    for sort, (ahead, left, lying) in itertools.product(SOLID, SPOTS):
        one = thing(sort, ahead, left, yaw=5 * left, height=0.07, lying=lying)
        expected, corners = silhouette(eye, one, START), eye.project(robot_points(corners_of(one), START))
        if expected.sum() < 200:
            continue
        mask = renderer_of_eye.names(Scene(ROAD, (one,), DULL), START) == 1
        assert overlap(mask, expected) > 0.93, one
        (v, u), low, high = np.nonzero(mask), corners.min(axis=0), corners.max(axis=0)
        # the first whole pixel within: 0 to 1 px, and a little where a triangle is thinner than a pixel
        gaps = np.array([u.min() - low[0], v.min() - low[1], high[0] - u.max(), high[1] - v.max()])
        assert (gaps > -0.02).all() and (gaps < 1.25).all(), (one, gaps)
        compared += 1
    assert compared > 10


def test_a_post_stands_on_its_point_of_the_road(eye: Eye, renderer_of_eye: Renderer) -> None:
    around = np.linspace(0, 2 * np.pi, 60)
    for ahead, left in ((0.25, 0.0), (0.3, 0.1), (0.35, -0.12)):
        mask = renderer_of_eye.names(Scene(ROAD, (thing('post', ahead, left, height=0.06),), DULL), START) == 1
        circle = [ahead, left, 0] + 0.03 * 0.06 * np.column_stack([np.cos(around), np.sin(around), 0 * around])
        lowest = eye.project(circle)
        v, u = np.nonzero(mask)
        assert v.max() + 0.5 == pytest.approx(lowest[:, 1].max(), abs=0.55)
        columns = u[v == v.max()]
        assert columns.min() > lowest[:, 0].min() - 0.1 and columns.max() < lowest[:, 0].max() + 0.1


def test_the_nearer_thing_hides_the_farther_in_any_order(level: Renderer) -> None:
    near, far = thing('ball', 0.3, 0.0, height=0.06), thing('wood', 0.5, 0.02, height=0.08)
    eye = eye_of_camera(CAMERAS['level'])
    first, last = silhouette(eye, near, START), silhouette(eye, far, START)
    assert (first & last).sum() > 200
    names = level.names(Scene(ROAD, (near, far), DULL), START)
    other = level.names(Scene(ROAD, (far, near), DULL), START)
    np.testing.assert_array_equal(names, np.array([0, 2, 1])[other])
    assert overlap(names == 1, first) > 0.97 and overlap(names == 2, last & ~first) > 0.95
    pictures = [level.render(Scene(ROAD, order, DULL), [START], BRIGHT) for order in ((near, far), (far, near))]
    np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize('ahead, left', [(-0.3, 0.0), (0.0, 0.0), (0.3, 0.9), (0.3, -0.9), (8.0, 0.0), (-8.0, 3.0)])
def test_what_is_behind_or_beside_is_not_seen(level: Renderer, ahead: float, left: float) -> None:
    assert not level.names(Scene(ROAD, (thing('duckie', ahead, left),), DULL), START).any()


def test_no_things_no_names(level: Renderer) -> None:
    names = level.names(Scene(ROAD, (), DULL), START)
    assert names.shape == (480, 640) and names.dtype == np.uint8 and not names.any()


@pytest.mark.parametrize('sort', ['ball', 'cone', 'duckie'])
def test_a_mirrored_scene_has_a_mirrored_mask(level: Renderer, sort: str) -> None:
    left, right = (
        level.names(Scene(ROAD, (thing(sort, 0.3, 0.08 * side, yaw=START.heading + 0.4 * side),), DULL), START)
        for side in (1, -1)
    )
    assert (left > 0).sum() > 500 and overlap(left > 0, right[:, ::-1] > 0) > 0.985


def test_a_thing_is_drawn_where_it_is_named(level: Renderer) -> None:
    one = thing('ball', 0.3, 0.05)
    scene = Scene(ROAD, (one,), DULL)
    mask = level.names(scene, START) > 0
    tinted = Scene(ROAD, (replace(one, tint=(3.0, 3.0, 3.0)),), DULL)
    with_it, brighter = (level.render(each, [START], BRIGHT).astype(int) for each in (scene, tinted))
    np.testing.assert_array_equal((brighter != with_it).any(axis=2), mask)


# The picture


def signal_of(picture: Any) -> Any:
    """Linear signal of an encoded picture."""
    return (picture.astype(np.float64) / 255) ** 2


def test_a_turn_smears_an_edge_by_as_far_as_it_moves(level: Renderer) -> None:
    eye = eye_of_camera(CAMERAS['level'])
    black = replace(WHITE_ON_BLACK, white=(0.0,) * 3, yellow=(0.0,) * 3, red=(0.0,) * 3, floor=(0.6,) * 3)
    scene = Scene(ROAD, (), DULL, black, seed=78)
    first, middle, last = (WorldPose(1.0, 0.2, turn) for turn in (-0.02, 0.0, 0.02))
    border = np.array([[1.4, 0.0, 0.0], [1.41, 0.0, 0.0]])  # the map's southern border: road beside bright floor
    point, further = eye.project(robot_points(border, middle))
    normal = np.array([further[1] - point[1], point[0] - further[0]]) / np.linalg.norm(further - point)
    ends = [eye.project(robot_points(border[:1], pose))[0] for pose in (first, last)]
    expected = abs((ends[1] - ends[0]) @ normal)
    steps = np.arange(-20, 20, 0.1)
    spread = []
    for path in ([middle], [first, last]):
        profile = sampled(signal_of(level.render(scene, path, BRIGHT))[..., 1], point + steps[:, None] * normal)
        share = np.abs(np.diff(profile))
        share[share < 0.002] = 0  # the vignette's slope
        share /= share.sum()
        mean = (share * steps[1:]).sum()
        assert mean == pytest.approx(0, abs=0.5)
        spread.append((share * (steps[1:] - mean) ** 2).sum())
    smear = (12 * (spread[1] - spread[0])) ** 0.5  # an even smear of length L has a variance of L^2 / 12
    assert expected > 6
    assert smear == pytest.approx(expected, rel=0.1)


def test_motion_blur_keeps_the_brightness_and_rest_has_none(level: Renderer) -> None:
    scene = Scene(ROAD, (thing('duckie', 0.3, 0.0),))
    ends = [WorldPose(START.x, START.y, START.heading + turn) for turn in (-0.03, 0.03)]
    sharp, blurred = (level.render(scene, path, (1.0, 1.0, 1.0)) for path in ([START], ends))
    assert (sharp != blurred).any()
    assert signal_of(blurred).mean() == pytest.approx(signal_of(sharp).mean(), rel=0.02)
    np.testing.assert_array_equal(sharp, level.render(scene, [START, START], (1.0, 1.0, 1.0)))


def test_a_turn_moves_the_road_by_so_many_pixels(level: Renderer) -> None:
    eye = eye_of_camera(CAMERAS['level'])
    points = np.array([[0.25, 0, 0], [0.4, 0.1, 0], [0.4, -0.1, 0], [1.0, 0, 0]])
    other = WorldPose(0.02, 0.01, 0.1)
    moved = eye.project(robot_points(points, other)) - eye.project(points)
    smear = level.smear(WorldPose(0, 0, 0), other)
    assert smear == pytest.approx(np.linalg.norm(moved, axis=1).max(), rel=0.01)
    assert level.smear(START, START) == 0


SIDE_LAMP = Light(lamps=(Lamp(START.heading + np.pi / 2, 0.7, 0.6, size=0.05),), glare=0.0, unevenness=0.0)
"""From the robot's left."""


def brightness_on_road(renderer: Renderer, scene: Scene, points: Any) -> Any:
    """(N,) linear green signal at points (x, y) [m] of the robot frame, the mean of 3x3 pixels."""
    picture = signal_of(renderer.render(scene, [START], BRIGHT))[..., 1]
    pixels = eye_of_camera(CAMERAS['level']).project([[x, y, 0.0] for x, y in points])
    around = [(u, v) for u in (-1, 0, 1) for v in (-1, 0, 1)]
    return np.mean([sampled(picture, pixels + shift) for shift in around], axis=0)


def test_a_shadow_falls_away_from_the_lamp(level: Renderer) -> None:
    ball = thing('ball', 0.35, 0.0, height=0.06)
    points = [(0.35, -0.055), (0.35, 0.06), (0.35, -0.2)]  # a lamp 40 degrees up: the shadow reaches 0.08 m
    bare, shaded, twice = (
        brightness_on_road(level, Scene(ROAD, things, SIDE_LAMP), points) for things in ((), (ball,), (ball, ball))
    )
    shadow, lit, beyond = shaded / bare
    assert 0.3 < shadow < 0.6
    assert lit == pytest.approx(1, abs=0.03) and beyond == pytest.approx(1, abs=0.03)
    np.testing.assert_allclose(twice, shaded, rtol=0.02)


@pytest.mark.parametrize(
    'azimuth, glare, whitens', [(0.0, 1.0, True), (0.0, 0.0, False), (np.pi, 1.0, False)],
    ids=['lamp ahead', 'no glare', 'lamp behind'],
)  # fmt: skip
def test_glare_whitens_tape_under_a_low_lamp_ahead(
    level: Renderer, azimuth: float, glare: float, whitens: bool
) -> None:
    light = Light(lamps=(Lamp(azimuth, 0.2, 0.6, size=0.3),), glare=glare, unevenness=0.0)
    pose = WorldPose(1.0, 0.2, 0.0)
    picture = signal_of(level.render(Scene(ROAD, (), light), [pose], BRIGHT))
    dashes = [[(dash + 0.5) * SIZE / 8, MIDDLE, 0.0] for dash in range(21, 24)]
    colors = sampled(picture, eye_of_camera(CAMERAS['level']).project(robot_points(dashes, pose)))
    blueness = np.median(colors[:, 0] / colors[:, 2])
    assert blueness > 0.15 if whitens else blueness < 0.08


def test_brightness_follows_factors_colour_and_strength(level: Renderer) -> None:
    scene = Scene(ROAD, (thing('wood', 0.3, 0.0),), DULL)
    half = signal_of(level.render(scene, [START], (0.5, 0.5, 0.5))).mean(axis=(0, 1))
    dim = Light(lamps=(), glare=0.0, unevenness=0.0, strength=0.5, color=(1.0, 0.5, 0.25))
    tinted = signal_of(level.render(replace(scene, light=dim), [START], (1.0, 1.0, 1.0))).mean(axis=(0, 1))
    np.testing.assert_allclose(tinted / half, [0.25, 0.5, 1.0], rtol=0.03)


def test_the_same_input_gives_the_same_picture(level: Renderer) -> None:
    scene, other = Scene(ROAD, (thing('duckie', 0.3, 0.0), thing('cone', 0.4, 0.1))), Scene(town('──'), seed=3)
    path = [START, WorldPose(1.01, 0.2, 0.35)]
    before = level.render(scene, path, BRIGHT)
    level.render(other, path, BRIGHT)
    np.testing.assert_array_equal(level.render(scene, path, BRIGHT), before)
    level.names(scene, START)
    np.testing.assert_array_equal(level.render(scene, path, BRIGHT), before)
    fresh = Renderer(calibration_of(CAMERAS['level']))
    np.testing.assert_array_equal(fresh.render(scene, path, BRIGHT), before)
    # two renderers at once do not disturb each other
    np.testing.assert_array_equal(level.render(scene, path, BRIGHT), before)
    fresh.close()
    np.testing.assert_array_equal(level.render(scene, path, BRIGHT), before)


def test_smooth_edges_change_edges_only(level: Renderer) -> None:
    scene = Scene(ROAD, (thing('wood', 0.3, 0.0, height=0.07),), DULL)
    smooth = Renderer(calibration_of(CAMERAS['level']), samples=4)
    changed = np.abs(smooth.render(scene, [START], BRIGHT).astype(int) - level.render(scene, [START], BRIGHT)).max(
        axis=2
    )
    np.testing.assert_array_equal(smooth.names(scene, START), level.names(scene, START))
    smooth.close()
    mask = level.names(scene, START) > 0
    assert 20 < (changed > 8).sum() < 0.2 * mask.sum()


def test_without_opengl_one_sentence(calibration: Calibration) -> None:
    failing = mock.patch.object(moderngl, 'create_context', side_effect=Exception('no EGL here'))
    with failing, pytest.raises(RenderError) as caught:
        Renderer(calibration)
    message = str(caught.value)
    assert 'no EGL here' in message and 'expected Mesa: ' in message and '\n' not in message


def test_the_ground_is_unevenly_bright_only_where_the_light_is(level: Renderer) -> None:
    uneven, poses = replace(DULL, unevenness=0.4), [WorldPose(x, 0.2, 0.0) for x in np.arange(0.2, 3.0, 0.4)]
    ratios = []
    for pose in poses:
        first, again, other = (level.render(Scene(ROAD, (), each), [pose], BRIGHT) for each in (DULL, DULL, uneven))
        np.testing.assert_array_equal(first, again)
        ratios.append(signal_of(other)[300:].mean() / signal_of(first)[300:].mean())
    assert 0.1 < np.std(ratios) < 0.8


def test_nothing_is_seen_beyond_the_lens() -> None:
    # k1 = -0.5 folds at r = 0.82, inside the picture: things that stand aside must not come back in the dark ring.
    camera = Camera(distortion=(-0.5, 0.0, 0.0, 0.0, 0.0))
    renderer = Renderer(calibration_of(camera))
    ring = np.hypot(*np.meshgrid(np.arange(640) - 319.5, np.arange(480) - 239.5)) > 0.56 * camera.focal
    things = tuple(Thing('ball', 1.0 + 0.1, 0.17 + y, height=0.1) for y in (-0.4, -0.2, 0.2, 0.4))
    scene, pose = Scene(town('────────'), things), WorldPose(1.0, 0.17, 0.0)
    assert ring.mean() > 0.3
    assert not renderer.render(scene, [pose], (1.0, 1.0, 1.0))[ring].any()
    names = renderer.names(scene, pose)
    assert not names[ring].any()
    renderer.close()
