"""viz.overlay: what a tracker remembers and no picture shows; what the avoider makes of the road."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import math
from dataclasses import replace
from typing import Any, Optional, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from obst_avoid.core.avoidance.corridor import View, view_of
from obst_avoid.core.bird_view import BirdView, BirdViewSettings, bird_from_ground, footprint_box, make_bird_view
from obst_avoid.core.types import Box, Decision, Kind, LanePose, Obstacle, State
from obst_avoid.viz.overlay import (
    GAP,
    STATE_COLORS,
    WAY,
    banner,
    draw_on_bird_view,
    draw_on_picture,
    draw_plan_on_bird_view,
    draw_plan_on_picture,
    headline,
    placed,
)
from unit.cameras import Camera, calibration_of
from unit.shipped import avoidance_settings

SETTINGS = BirdViewSettings(crop_distance=1.7, horizon_margin=0.021)
LEFT_BUMPED = Camera(pitch=15, roll=4, yaw=6, left=0.02)
CAMERAS = {'level': Camera(), 'bumped': LEFT_BUMPED, 'small': Camera().resized(320, 240)}
VIEWS = {name: make_bird_view(calibration_of(camera), SETTINGS) for name, camera in CAMERAS.items()}
VIEW = VIEWS['level']
GREY = 90
HALF = 0.1
"""[m] of the corridors that are drawn by hand."""


@pytest.mark.parametrize('x, drawn', [(0.5, True), (0.02, False), (-0.15, False)])
def test_a_remembered_obstacle_is_drawn_where_it_would_be_seen(x: float, drawn: bool) -> None:
    remembered = Obstacle(None, x, 0.0, 0.03, True, bird_box=footprint_box(VIEW, x, 0.0, 0.03))
    picture = np.full((480, 640, 3), 90, dtype=np.uint8)
    assert (draw_on_picture(picture, [remembered], VIEW) != picture).any() == drawn
    bird = np.full((VIEW.height, VIEW.width, 3), 90, dtype=np.uint8)
    draw_on_bird_view(bird, [remembered])  # a box below the bird view is no error


boxes = st.builds(
    lambda left, top, width, height: Box(left, top, left + width, top + height),
    *(st.floats(-50, 700), st.floats(-50, 500), st.floats(1, 300), st.floats(1, 300)),
)


@given(st.lists(boxes, max_size=12), st.sampled_from([(320, 240), (640, 480), (1296, 972)]), st.sampled_from([0, 40]))
def test_no_label_lies_on_another_or_leaves_the_picture(named: Any, frame: Tuple[int, int], free: int) -> None:
    sizes = [(90 * frame[0] // 640 + 3 * i, 20 * frame[0] // 640) for i in range(len(named))]
    areas = [(*at, at[0] + size[0], at[1] + size[1]) for at, size in zip(placed(sizes, named, frame, free), sizes)]
    for index, (left, top, right, bottom) in enumerate(areas):
        assert left >= 0 and top >= free and right <= frame[0] and bottom <= frame[1]
        for other in areas[:index]:
            assert right <= other[0] or other[2] <= left or bottom <= other[1] or other[3] <= top


def test_a_label_that_is_alone_stands_above_its_box() -> None:
    assert placed([(90, 20)], [Box(300, 200, 340, 240)], (640, 480)) == [(300, 180)]
    assert placed([(90, 20)], [Box(600, 5, 640, 240)], (640, 480), free=30) == [(550, 30)]


def test_where_there_is_no_room_labels_are_written_all_the_same() -> None:
    assert placed([(90, 20)] * 3, [Box(0, 0, 9, 9)] * 3, (100, 25)) == [(0, 0)] * 3
    crowd = [Obstacle(Kind.CONE, 0.5, 0.0, 0.03, True, image_box=Box(5, 5, 9, 9))] * 50
    for shape in ((480, 640, 3), (12, 16, 3)):
        draw_on_picture(np.full(shape, GREY, dtype=np.uint8), crowd, VIEW)


@pytest.mark.parametrize('width, height', [(320, 240), (640, 480), (1296, 972)])
def test_a_reason_that_is_too_long_for_a_line_goes_on_in_the_next(width: int, height: int) -> None:
    picture = np.full((height, width, 3), GREY, dtype=np.uint8)
    short, few = headline(picture, 'CLEAR')
    long, rows = headline(picture, 'STOPPED: stopping: ' + 10 * 'obstacle ')
    assert few < rows < height / 2
    for drawn, of in ((short, few), (long, rows)):
        assert (drawn[of:] == GREY).all() and (drawn[:of, 0] != GREY).all()
        assert (drawn[:of, -GAP:] == drawn[0, 0]).all(), 'no letter is cut off'
    assert (banner(picture, 'CLEAR')[: height - few] == GREY).all()


def corridor(
    begin: float = 0.0, end: float = 1.0, left: float = 0.0, deciding: Optional[Tuple[float, float, float]] = None
) -> View:
    """Straight ahead, so far to the left [m]; the path is its middle."""
    corners = [(begin, HALF), (end, HALF), (end, -HALF), (begin, -HALF), (begin, HALF)]
    shift = np.array([0.0, left])
    return View(np.array(corners) + shift, np.array([(begin, 0.0), (end, 0.0)]) + shift, deciding)


def grey(view: BirdView) -> Tuple[Any, Any]:
    """A camera picture and a bird view of nothing."""
    size = (view.calibration.height, view.calibration.width, 3)
    return np.full(size, GREY, dtype=np.uint8), np.full((view.height, view.width, 3), GREY, dtype=np.uint8)


def colors_at(name: str, plan: View, state: State, ground: Any) -> Tuple[Any, Any]:
    """What is drawn where the camera, by its pose and lens, sees points of the ground, (N, 2) in m: in the picture, and
    in the bird view.
    """
    view, ground = VIEWS[name], np.asarray(ground, dtype=np.float64)
    picture, bird = grey(view)
    seen = CAMERAS[name].image_from_robot(np.column_stack([ground, np.zeros(len(ground))]))
    found = []
    for drawn, pixels in (
        (draw_plan_on_picture(picture, plan, state, view), seen),
        (draw_plan_on_bird_view(bird, plan, state, view), bird_from_ground(view, ground)),
    ):
        u, v = np.round(pixels).astype(int).T
        found.append(drawn[v, u].astype(int))
    return found[0], found[1]


def nearer(color: Any, than: int, to: Any) -> Any:
    """(N,) by how much colours are nearer to one than grey is."""
    goal = np.array(to)
    return np.abs(than - goal).sum() - np.abs(color - goal).sum(axis=-1)


@pytest.mark.parametrize('name', CAMERAS)
@pytest.mark.parametrize('left', [-0.05, 0.0, 0.05])
def test_the_corridor_lies_where_the_camera_sees_it(name: str, left: float) -> None:
    inside = [(x, left + y) for x in (0.3, 0.5, 0.7) for y in (-0.085, -0.05, 0.05, 0.085)]
    outside = [(x, left + y) for x in (0.3, 0.5, 0.7) for y in (-0.125, 0.125)] + [
        (1.1, left - 0.05),
        (1.1, left + 0.05),
    ]
    for state in State:
        for colors in colors_at(name, corridor(left=left), state, inside):
            shift = nearer(colors, GREY, STATE_COLORS[state])
            assert (shift > 5).all(), 'in the colour of the state'
            assert (np.abs(colors - GREY) < 100).all(), 'the picture shines through'
        for colors in colors_at(name, corridor(left=left), state, outside):
            assert (colors == GREY).all()


@pytest.mark.parametrize('name', CAMERAS)
def test_the_path_and_what_decides(name: str) -> None:
    plan = corridor(deciding=(0.6, 0.06, 0.03))
    for colors in colors_at(name, plan, State.CLEAR, [(x, 0.0) for x in (0.3, 0.5, 0.8)]):
        assert (nearer(colors, GREY, WAY) > 100).all()
    foot = [(0.6, 0.06), (0.615, 0.06), (0.6, 0.075)]
    beside = [(0.5, 0.06), (0.7, 0.06), (0.6, -0.06)]
    stop = STATE_COLORS[State.STOPPED]
    for at, by in zip(colors_at(name, plan, State.STOPPED, foot), colors_at(name, plan, State.STOPPED, beside)):
        assert nearer(at, GREY, stop).min() > 1.5 * nearer(by, GREY, stop).max()


def test_what_cannot_be_seen_is_not_drawn() -> None:
    nowhere = np.empty((0, 2))
    for plan in (
        View(nowhere, nowhere, None),
        View(np.zeros((1, 2)), np.zeros((1, 2)), (-0.5, 0.0, 0.03)),
        corridor(-1.0, 0.05, deciding=(0.0, 0.0, 0.02)),
        corridor(-3.0, -1.0),
        corridor(0.2, 0.6, left=3.0, deciding=(0.5, -3.0, 0.05)),
        corridor(3.0, 5.0),
    ):
        for name, view in VIEWS.items():
            picture, bird = grey(view)
            assert (draw_plan_on_picture(picture, plan, State.CLEAR, view) == GREY).all(), name
            assert (draw_plan_on_bird_view(bird, plan, State.CLEAR, view) == GREY).all(), name


def test_a_corridor_that_begins_behind_the_camera_fills_the_picture_to_its_lower_edge() -> None:
    picture, _ = grey(VIEW)
    drawn = draw_plan_on_picture(picture, corridor(-5.0, 0.5), State.SLOWING, VIEW)
    columns = slice(VIEW.calibration.width // 2 + 10, VIEW.calibration.width // 2 + 60)
    assert (drawn[-8, columns] != GREY).any(axis=1).all()
    assert (drawn[:190] == GREY).all(), 'nothing is folded back to the horizon'
    edge = np.abs(drawn[-8, columns].astype(int) - drawn[-9, columns])
    assert edge.max() == 0, 'the cut is no edge of the corridor'


wild = st.builds(
    LanePose, d=st.floats(-3, 3), phi=st.floats(-math.pi, math.pi), curvature=st.floats(-6, 6)
)  # fmt: skip


@given(wild, st.floats(-0.5, 0.5), st.tuples(*[st.floats(-2, 2)] * 2, st.floats(1e-3, 1)), st.sampled_from(State))
def test_wild_plans_are_drawn_or_not(pose: LanePose, d_ref: float, foot: Any, state: State) -> None:
    plan = replace(view_of(Decision(state, d_ref, 0.0, ''), pose, avoidance_settings()), deciding=foot)
    for view in VIEWS.values():
        for picture, draw in zip(grey(view), (draw_plan_on_picture, draw_plan_on_bird_view)):
            assert draw(picture, plan, state, view).shape == picture.shape
            assert (picture == GREY).all(), 'the picture itself is not drawn on'


@given(st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 2), max_size=9))
def test_numbers_of_any_size_are_drawn_or_not(points: Any) -> None:
    line = np.array(points, dtype=np.float64).reshape(-1, 2)
    plan = View(line, line, (*points[0], 1e300) if points else None)
    for picture, draw in zip(grey(VIEW), (draw_plan_on_picture, draw_plan_on_bird_view)):
        draw(picture, plan, State.CLEAR, VIEW)
