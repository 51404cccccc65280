import functools
from dataclasses import fields

import cv2
import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration, scaled
from obst_avoid.core.detection.robust import native
from obst_avoid.core.detection.robust.lines import (
    LEAST_CROSSINGS,
    LINEAR,
    MOST_CROSSINGS,
    Crossings,
    Line,
    LineSampling,
    curves,
    find_crossings,
    find_lines,
    make_sampling,
)
from obst_avoid.core.types import Array
from unit import drawn
from unit.cameras import Camera, calibration_of
from unit.shipped import default_calibration

ROAD = LINEAR[list(drawn.ASPHALT)]
HALF = drawn.LANE_WIDTH / 2
WHITE_RIGHT = -HALF - drawn.WHITE_WIDTH / 2
YELLOW = HALF + drawn.YELLOW_WIDTH / 2
WHITE_LEFT = HALF + drawn.YELLOW_WIDTH + drawn.LANE_WIDTH + drawn.WHITE_WIDTH / 2
MIDDLES = {'white right': WHITE_RIGHT, 'yellow': YELLOW, 'white left': WHITE_LEFT}
"""[m] left of our lane's middle."""


@functools.lru_cache(maxsize=1)
def calibration() -> Calibration:
    return default_calibration()


@functools.lru_cache(maxsize=1)
def sampling() -> LineSampling:
    return make_sampling(calibration())


@functools.lru_cache(maxsize=16)
def lines_at(d: float = 0.0, phi: float = 0.0, stop_line: float = float('inf')):
    picture = drawn.draw(drawn.Scene(stop_line=stop_line), calibration(), drawn.RobotPose(0, d, phi))
    return find_lines(picture, sampling(), ROAD)


@pytest.mark.parametrize('yaw', [-8.0, 8.0])
@pytest.mark.parametrize('roll', [-5.5, 0.0, 5.5])
@pytest.mark.parametrize('pitch', [15.0, 21.0])
def test_a_camera_that_looks_aside_has_samples_where_it_sees_them(yaw, roll, pitch):
    """Some of the nearest row's road lies behind it."""
    camera = Camera(pitch=pitch, roll=roll, yaw=yaw)
    made = make_sampling(calibration_of(camera))
    count = len(made.scan)
    assert count > 10000
    assert made.ground.shape == (count, 2)
    assert made.map_part.shape == made.whole.shape == (1, count)
    assert np.isfinite(made.ground).all()
    assert (np.diff(made.scan) >= 0).all()
    pixels = made.map_pixel[0].astype(float)
    assert (pixels >= 0).all()
    assert (pixels <= (camera.width - 1, camera.picture_height - 1)).all()
    expected = camera.image_from_robot(np.column_stack([made.ground, np.zeros(count)]))
    off = expected - pixels  # what is left of a pixel is in map_part
    assert off.min() > -0.1
    assert off.max() < 1.1


def left_of_middle(line: Line, d: float, phi: float) -> float:
    """[m] of a line's crossings left of our lane's middle, on the average, by the robot's true pose."""
    return float(np.mean(d + np.sin(phi) * line.x + np.cos(phi) * line.y))


@pytest.mark.parametrize('d', [-0.08, 0.0, 0.05])
@pytest.mark.parametrize('phi', [-0.4, 0.0, 0.25])
def test_lines_lie_where_they_were_drawn(d, phi):
    """Within 3 mm, less than a sample."""
    found = {name: [] for name in MIDDLES}
    for line in lines_at(d, phi):
        middle = left_of_middle(line, d, phi)
        name = min(MIDDLES, key=lambda one: abs(MIDDLES[one] - middle))
        assert middle == pytest.approx(MIDDLES[name], abs=0.003), name
        found[name].append(line)
    assert len(found['white right']) == len(found['yellow']) == 1, found
    for name, lines in found.items():
        for line in lines:
            assert np.arctan(line.b) == pytest.approx(-phi, abs=0.03), name
            assert line.width == pytest.approx(0.025 if name == 'yellow' else 0.048, rel=0.25), name


def test_yellow_is_less_blue_than_white():
    lines = sorted(lines_at(), key=lambda line: line.width)
    assert lines[0].blueness < 0.5
    assert all(line.blueness > 0.85 for line in lines[1:])


def test_a_line_knows_where_it_was_seen():
    for line in lines_at():
        assert line.count == len(line.x) == len(line.y) >= LEAST_CROSSINGS
        assert (line.begin, line.end) == (line.x[0], line.x[-1])
        assert 0.1 < line.begin < line.end < 1.4
        assert line.residual < 0.004
        assert (np.linalg.eigvalsh(line.covariance) > 0).all()


def test_a_red_stop_line_is_none():
    straight, stopped = lines_at(), lines_at(stop_line=0.4)
    ahead = [line for line in stopped if abs(line.b) > 1]
    assert not ahead
    assert len(stopped) <= len(straight) + 1


def mirrored(picture: Array) -> Array:
    return np.ascontiguousarray(picture[:, ::-1])


def test_a_mirrored_picture_has_mirrored_crossings():
    """The default camera looks straight ahead from the robot's middle, which half a pixel lies beside the picture's."""
    picture = drawn.draw(drawn.Scene(), calibration(), drawn.RobotPose(0, 0.03, 0.1))
    one, other = find_crossings(picture, sampling(), ROAD), find_crossings(mirrored(picture), sampling(), ROAD)
    assert len(one.x) == pytest.approx(len(other.x), abs=0.1 * len(one.x))
    apart = np.hypot(one.x[:, None] - other.x, one.y[:, None] + other.y).min(axis=1)
    assert np.median(apart) < 0.004


def light(picture: Array, blue: float, green: float, red: float) -> Array:
    """The same picture in light of another colour."""
    linear = (LINEAR[picture] * (blue, green, red)).clip(0, 1)
    return np.rint(255 * linear ** (1 / 2.2)).astype(np.uint8)


@pytest.mark.parametrize(
    'color',
    [(1, 1, 1), (0.4, 0.7, 1), (0.7, 0.45, 1), (1, 0.33, 0.16), (0.22, 1, 0.22), (0.2, 0.16, 1), (0.05, 0.05, 0.05)],
    ids=['white', 'warm', 'pink', 'blue', 'green', 'red', 'dim'],
)
def test_lines_are_found_in_light_of_any_color(color):
    picture = light(drawn.draw(drawn.Scene(), calibration(), drawn.RobotPose()), *color)
    lines = find_lines(picture, sampling(), ROAD * color)
    middles = [left_of_middle(line, 0, 0) for line in lines]
    for wanted in (WHITE_RIGHT, YELLOW):
        assert min(abs(middle - wanted) for middle in middles) < 0.004, middles


def test_half_a_picture_gives_the_same_lines():
    picture = drawn.draw(drawn.Scene(), calibration(), drawn.RobotPose())
    half = cv2.resize(picture, (320, 240), interpolation=cv2.INTER_AREA)
    small = make_sampling(scaled(calibration(), 320, 240))
    middles = [left_of_middle(line, 0, 0) for line in find_lines(half, small, ROAD)]
    for wanted in (WHITE_RIGHT, YELLOW):
        assert min(abs(middle - wanted) for middle in middles) < 0.006, middles


@pytest.mark.parametrize('value', [0, 60, 255])
def test_a_plain_picture_has_no_lines(value):
    picture = np.full((480, 640, 3), value, np.uint8)
    assert find_lines(picture, sampling(), LINEAR[[value] * 3]) == []


@pytest.mark.parametrize('road', [ROAD, np.zeros(3), np.ones(3)], ids=['right', 'black', 'white'])
def test_noise_does_no_harm(road):
    random = np.random.RandomState(3)
    for _ in range(3):
        find_lines(random.randint(0, 256, (480, 640, 3)).astype(np.uint8), sampling(), road)
    grain = np.clip(60 + 4 * random.standard_normal((480, 640, 3)), 0, 255).astype(np.uint8)
    assert find_lines(grain, sampling(), ROAD) == []


def test_a_road_that_is_not_known_gives_no_lines():
    picture = drawn.draw(drawn.Scene(), calibration(), drawn.RobotPose())
    with np.errstate(invalid='ignore'):
        assert find_lines(picture, sampling(), np.full(3, np.nan)) == []


def test_a_picture_gives_the_same_answer_twice():
    picture = drawn.draw(drawn.Scene(), calibration(), drawn.RobotPose(0, 0.02, -0.1))
    one, other = find_lines(picture, sampling(), ROAD), find_lines(picture, make_sampling(calibration()), ROAD)
    assert [(line.a, line.b, line.c) for line in one] == [(line.a, line.b, line.c) for line in other]


# Compiled and not


def same_numbers(one, other) -> None:
    """Of two lines, or of all crossings of a picture: within what differs when sums are added in another order."""
    for field in fields(one):
        here, there = (np.asarray(getattr(each, field.name), dtype=float) for each in (one, other))
        assert here.shape == there.shape, field.name
        np.testing.assert_allclose(here, there, rtol=1e-5, atol=1e-5, err_msg=field.name)


def by_both(monkeypatch, find):
    """What find gives with the compiled path, and without."""
    if native.LIBRARY is None:
        pytest.skip('the compiled path is not built')
    compiled = find()
    with monkeypatch.context() as without:
        without.setattr(native, 'LIBRARY', None)
        return compiled, find()


def noisy(picture: Array) -> Array:
    grain = np.random.RandomState(1).normal(0, 8, picture.shape)
    return np.clip(picture + grain, 0, 255).astype(np.uint8)


@pytest.mark.parametrize('size', [(640, 480), (320, 240)], ids='%dx%d'.__mod__)
@pytest.mark.parametrize('d, phi, stop_line', [(0, 0, 9), (-0.07, -0.35, 9), (0.06, 0.3, 9), (0.01, 0.05, 0.5)])
def test_numpy_finds_the_same_lines(monkeypatch, d, phi, stop_line, size):
    camera = scaled(calibration(), *size)
    made = make_sampling(camera)
    picture = drawn.draw(drawn.Scene(stop_line=stop_line), camera, drawn.RobotPose(0, d, phi))
    for seen, color in (
        (picture, (1, 1, 1)),
        (noisy(picture), (1, 1, 1)),
        (light(picture, 0.7, 0.45, 1), (0.7, 0.45, 1)),
    ):
        crossings = by_both(monkeypatch, lambda seen=seen, color=color: find_crossings(seen, made, ROAD * color))
        assert len(crossings[0].x) > 50
        same_numbers(*crossings)
        lines = by_both(monkeypatch, lambda seen=seen, color=color: find_lines(seen, made, ROAD * color))
        assert len(lines[0]) == len(lines[1]) >= 2
        for one, other in zip(*lines):
            same_numbers(one, other)


def test_numpy_finds_as_much_in_noise(monkeypatch):
    random = np.random.RandomState(2)
    count = 0
    for size in (1, 3, 8, 30, 60):
        coarse = random.randint(0, 256, (480 // size, 640 // size, 3)).astype(np.uint8)
        picture = cv2.resize(coarse, (640, 480), interpolation=cv2.INTER_NEAREST)
        crossings = by_both(monkeypatch, lambda seen=picture: find_crossings(seen, sampling(), ROAD))
        same_numbers(*crossings)
        count += len(crossings[0].x)
        lines = by_both(monkeypatch, lambda seen=picture: find_lines(seen, sampling(), ROAD))
        assert len(lines[0]) == len(lines[1])
        for one, other in zip(*lines):
            same_numbers(one, other)
    assert count > 50


@pytest.mark.parametrize('count', [0, 1, LEAST_CROSSINGS - 1, LEAST_CROSSINGS, 30, 64, 65, 128, MOST_CROSSINGS])
def test_numpy_finds_the_same_curves_among_crossings(monkeypatch, count):
    """Up to as many as a picture may have; some lie on lines, some anywhere."""
    found = 0
    for seed in range(10):
        random = np.random.RandomState(seed)
        x = np.sort(random.uniform(0.15, 1.2, count))
        which = random.randint(0, 1 + seed % 4, count)
        y = random.uniform(-0.3, 0.3, 4)[which] + random.uniform(-0.5, 0.5, 4)[which] * x
        y = np.where(random.rand(count) < 0.25, random.uniform(-0.5, 0.5, count), y + random.normal(0, 0.002, count))
        across = np.column_stack([np.zeros(count), np.full(count, 0.04)])
        made = Crossings(np.searchsorted(sampling().ahead, x), x, y, across, random.uniform(0.2, 3, (count, 3)))
        lines = by_both(monkeypatch, lambda made=made: curves(made, sampling().trials))
        assert len(lines[0]) == len(lines[1])
        for one, other in zip(*lines):
            same_numbers(one, other)
        found += len(lines[0])
    assert found >= (0 if count < 30 else 10)
