import functools
import math
from dataclasses import replace

import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust.lane import Lane, lane_of, side_of
from obst_avoid.core.detection.robust.lines import Line, find_lines, make_sampling
from obst_avoid.core.geometry import ground_from_pixel, pixel_from_ground, rectified_from_image
from obst_avoid.core.types import Array
from unit import drawn, scenes
from unit.cameras import Camera, calibration_of
from unit.shipped import default_calibration
from unit.test_lines import ROAD, calibration, lines_at, sampling

HALF = drawn.LANE_WIDTH / 2


def line(
    y: float, phi: float = 0.0, curvature: float = 0.0, yellow: bool = False, begin: float = 0.15, end: float = 1.0
):
    """A made-up line: y [m] left of the robot, turned left by phi [rad] there."""
    x = np.linspace(begin, end, 25)
    a, b, c = y, math.tan(phi), 0.0
    at = a + b * x
    if curvature:
        middle_x, middle_y = -math.sin(phi) / curvature, y + math.cos(phi) / curvature
        at = middle_y - np.sqrt(1 / curvature**2 - (x - middle_x) ** 2) * math.copysign(1, curvature)
        a, b, c = (middle_x**2 + middle_y**2 - 1 / curvature**2) / (2 * middle_y), -middle_x / middle_y, 1 / middle_y
    covariance = np.diag([1e-6, 1e-5, 1e-4])
    width, blueness = (0.025, 0.3) if yellow else (0.048, 1.0)
    return Line(a, b, c, covariance, begin, end, 25, 0.001, width, blueness, 4.0, x, at)


YELLOW, WHITE, FAR_WHITE = HALF + 0.0125, -HALF - 0.024, HALF + 0.025 + 0.22 + 0.024
"""[m] left of our lane's middle."""


def straight(d: float = 0.0) -> Lane:
    lane = lane_of([line(YELLOW - d, yellow=True), line(WHITE - d), line(FAR_WHITE - d)])
    assert lane is not None
    return lane


def test_no_lines_no_lane():
    assert lane_of([]) is None


@pytest.mark.parametrize('d', [-0.1, -0.03, 0.0, 0.07, 0.1])
@pytest.mark.parametrize('phi', [-0.5, -0.1, 0.0, 0.3])
def test_the_lane_pose_of_a_drawn_road(d, phi):
    lane = lane_of(lines_at(d, phi))
    assert lane is not None
    assert lane.pose.d == pytest.approx(d, abs=0.008)
    assert lane.pose.phi == pytest.approx(phi, abs=0.03)
    assert lane.pose.curvature == pytest.approx(0, abs=0.3)
    assert lane.pose.covariance is not None
    dd, dphi, phid, phiphi = lane.pose.covariance
    assert dphi == phid and dphi**2 < dd * phiphi
    assert abs(lane.pose.d - d) < 4 * math.sqrt(dd) and abs(lane.pose.phi - phi) < 4 * math.sqrt(phiphi)


def test_both_lines_measure_the_lane():
    lane = straight()
    assert lane.left is not None and lane.right is not None
    assert lane.width == pytest.approx(0.22, abs=1e-6)
    assert lane.how == 'both lines'


@pytest.mark.parametrize('yellow', [True, False])
def test_one_line_is_enough(yellow):
    d = 0.02
    lane = lane_of([line(YELLOW - d, yellow=True) if yellow else line(WHITE - d)])
    assert lane is not None
    assert (lane.left is not None, lane.right is not None) == (yellow, not yellow)
    assert lane.pose.d == pytest.approx(d, abs=1e-6)
    assert lane.pose.covariance[0] > straight().pose.covariance[0]


def test_the_far_white_line_is_not_ours():
    lane = lane_of([line(FAR_WHITE)])
    assert lane is None
    lane = lane_of([line(YELLOW, yellow=True), line(FAR_WHITE)])
    assert lane is not None and lane.right is None


def test_the_lanes_width_tells_lines_apart_whose_colors_do_not():
    """In blue light, or where glare whitens it, yellow paint looks as white paint does."""
    lane = lane_of([replace(line(YELLOW, yellow=True), blueness=0.95), line(WHITE), line(FAR_WHITE)])
    assert lane is not None and lane.how == 'both lines'
    assert lane.pose.d == pytest.approx(0, abs=1e-6)


def test_colors_are_compared_with_each_other():
    """A road that is taken for bluer than it is makes all paint yellow."""
    lines = [line(YELLOW, yellow=True), line(WHITE), line(FAR_WHITE)]
    for factor in (0.4, 2.5):
        lane = lane_of([replace(one, blueness=factor * one.blueness) for one in lines])
        assert lane is not None and lane.how == 'both lines'
        assert lane.pose.d == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize('curvature', [-2.5, -1.0, 1.0, 2.4])
def test_the_lane_bends_as_its_lines_do(curvature):
    """Both lines have the lane's middle of curvature."""
    lines = [
        line(y, curvature=curvature / (1 - curvature * y), yellow=yellow, end=0.24)
        for y, yellow in ((YELLOW, True), (WHITE, False))
    ]
    lane = lane_of(lines)
    assert lane is not None
    assert lane.pose.curvature == pytest.approx(curvature, rel=0.02)
    assert lane.pose.d == pytest.approx(0, abs=0.002)
    assert lane.pose.phi == pytest.approx(0, abs=0.002)


RADIUS = 0.03
SIDES = {
    'in the middle': (0.4, 0.0, True),
    'on the yellow line, partly inside': (0.4, HALF + 0.02, True),
    'just beyond the yellow line': (0.4, HALF + 0.05, False),
    'in the opposite lane': (0.4, 0.25, False),
    'on the white line, partly inside': (0.4, -HALF - 0.02, True),
    'beyond the white line': (0.4, -HALF - 0.06, False),
    'far to the right': (0.5, -0.4, False),
}


def nearest(x: float, y: float, radius: float):
    """The point of a footprint nearest the robot. x, y: [m] its middle."""
    share = 1 - radius / math.hypot(x, y)
    return x * share, y * share, radius


@pytest.mark.parametrize('name', SIDES)
def test_side_of_a_straight_lane(name):
    x, y, wanted = SIDES[name]
    side = side_of(straight(), *nearest(x, y, RADIUS))
    assert side.in_lane is wanted
    assert side.to_left == pytest.approx(HALF - y - RADIUS, abs=1e-6)
    assert side.to_right == pytest.approx(HALF + y - RADIUS, abs=1e-6)


@pytest.mark.parametrize('name', SIDES)
def test_side_by_one_line_where_it_is_clear(name):
    """The unseen line is about where the lane's width puts it."""
    x, y, wanted = SIDES[name]
    for lines in ([line(YELLOW, yellow=True)], [line(WHITE)]):
        lane = lane_of(lines)
        assert lane is not None
        assert side_of(lane, *nearest(x, y, RADIUS)).in_lane in (wanted, None)


def test_what_stands_beyond_all_lines_is_unknown():
    lane = lane_of([line(YELLOW, yellow=True, end=0.5), line(WHITE, end=0.5)])
    assert lane is not None
    assert side_of(lane, 0.55, 0.0, RADIUS).in_lane is True
    assert side_of(lane, 1.2, 0.0, RADIUS).in_lane is None
    assert side_of(lane, 3.0, 0.0, RADIUS).to_left is None


def test_beside_the_end_of_the_right_line_is_unknown():
    """It may be a corner, and our lane goes round it."""
    lane = lane_of([line(YELLOW, yellow=True, end=0.5), line(WHITE, end=0.5)])
    assert lane is not None
    assert side_of(lane, 0.3, -0.25, RADIUS).in_lane is False
    assert side_of(lane, 0.5, -0.25, RADIUS).in_lane is None


def test_a_line_that_bends_farther_on_is_followed():
    """A straight of 0.5 m, then a turn to the left of radius 0.4 m."""
    far = line(0.0, begin=0.5)
    x = np.linspace(0.5, 0.75, 12)
    pieces = []
    for y, yellow in ((YELLOW, True), (WHITE, False)):
        radius = 0.4 - y
        at = 0.4 - np.sqrt(radius**2 - (x - 0.5) ** 2)  # a circle about (0.5, 0.4)
        c = 1 / 0.4
        b, a = -0.5 * c, (radius**2 - 0.5**2 - 0.4**2) / -2 * c
        assert a + b * x + c * (x * x + at * at) / 2 == pytest.approx(at)
        near = line(y, yellow=yellow, end=0.48)
        pieces += [near, replace(far, a=a, b=b, c=c, begin=0.5, end=0.75, count=12, width=near.width,
                                 blueness=near.blueness, x=x, y=at)]  # fmt: skip
    lane = lane_of(pieces)
    assert lane is not None and lane.right is not None
    assert len(lane.right.pieces) == 2
    turned = math.radians(30)
    inside = 0.5 + 0.4 * math.sin(turned), 0.4 - 0.4 * math.cos(turned)
    beyond = 0.5 + 0.57 * math.sin(turned), 0.4 - 0.57 * math.cos(turned)
    assert side_of(lane, *nearest(*inside, RADIUS)).in_lane is True
    assert side_of(lane, *nearest(*beyond, RADIUS)).in_lane is not True


@functools.lru_cache(maxsize=1)
def road_of_pixels() -> Array:
    """(480, 640, 2) [m] x, y of the road that the pixels of the default camera show; NaN above the horizon."""
    camera: Calibration = default_calibration()
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = rectified_from_image(camera, np.column_stack([u.ravel(), v.ravel()]).astype(float))
    below = np.column_stack([pixels, np.ones(len(pixels))]) @ camera.homography[2] > 0
    ground = np.full((len(pixels), 2), np.nan)
    ground[below] = ground_from_pixel(camera.homography, pixels[below])
    return ground.reshape(camera.height, camera.width, 2)


def bent_picture(curvature: float, d: float, phi: float) -> Array:
    """A road that bends evenly all along."""
    ground = road_of_pixels()
    x = np.cos(phi) * ground[..., 0] - np.sin(phi) * ground[..., 1]
    y = np.sin(phi) * ground[..., 0] + np.cos(phi) * ground[..., 1] + d
    radius = 1 / curvature
    left = radius - math.copysign(1, radius) * np.hypot(x, y - radius)
    along = abs(radius) * np.arctan2(x, np.abs(radius - y))
    picture = np.full(ground.shape[:2] + (3,), drawn.WALL, np.uint8)
    picture[np.isfinite(left)] = drawn.ASPHALT
    for middle in (WHITE, FAR_WHITE):
        picture[np.abs(left - middle) < 0.024] = drawn.WHITE
    picture[(np.abs(left - YELLOW) < 0.0125) & (along % 0.075 < 0.05)] = drawn.YELLOW
    return picture


@pytest.mark.parametrize(
    'curvature, d, phi', [(2.4, 0.0, 0.0), (1.5, 0.04, 0.2), (-1.5, -0.03, -0.15), (-3.0, 0.0, 0.0)]
)
def test_the_lane_pose_in_a_bend(curvature, d, phi):
    lane = lane_of(find_lines(bent_picture(curvature, d, phi), sampling(), ROAD))
    assert lane is not None
    assert lane.pose.d == pytest.approx(d, abs=0.015)
    assert lane.pose.phi == pytest.approx(phi, abs=0.1)
    assert lane.pose.curvature == pytest.approx(curvature, rel=0.25)


def test_duckies_and_cones_are_no_lines():
    things = (scenes.duckie(0.3, 0.05), scenes.duckie(0.5, 0.12), scenes.cone(0.4, -0.1), scenes.cone(0.6, 0.3, 0.08))
    picture = drawn.draw(drawn.Scene(things), calibration(), drawn.RobotPose(0, -0.02, 0.05))
    lane = lane_of(find_lines(picture, sampling(), ROAD))
    assert lane is not None
    assert lane.pose.d == pytest.approx(-0.02, abs=0.008)
    assert lane.pose.phi == pytest.approx(0.05, abs=0.03)


@pytest.mark.parametrize('pitch, roll', [(4, 0), (-4, 0), (0, 3), (2, -3)])
def test_a_wrong_calibration_keeps_the_sides(pitch, roll):
    """Lines do not look parallel then. pitch, roll: [deg] by which the file is wrong."""
    picture = drawn.draw(drawn.Scene(), calibration_of(Camera()), drawn.RobotPose())
    wrong = calibration_of(Camera(pitch=Camera().pitch + pitch, roll=roll))
    lane = lane_of(find_lines(picture, make_sampling(wrong), ROAD))
    assert lane is not None and lane.how == 'both lines'
    for x, y, wanted in SIDES.values():
        true = np.array([nearest(x, y, RADIUS)[:2]])
        seen = ground_from_pixel(wrong.homography, pixel_from_ground(calibration_of(Camera()).homography, true))[0]
        assert side_of(lane, float(seen[0]), float(seen[1]), RADIUS).in_lane in (wanted, None)


@pytest.mark.parametrize('value', [0, 255])
def test_a_plain_picture_has_no_lane(value):
    picture = np.full((480, 640, 3), value, np.uint8)
    assert lane_of(find_lines(picture, sampling(), ROAD)) is None
