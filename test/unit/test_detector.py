"""core.detection.paper.detector: drawn pictures in, obstacles out."""

import math
from dataclasses import replace
from typing import Any, Dict, List, Optional, Tuple

import numpy as np
import pytest

from obst_avoid.core.bird_view import BirdView, BirdViewSettings, bird_from_ground, make_bird_view
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.paper.detector import PaperState, detect, search_line
from obst_avoid.core.detection.paper.settings import PaperSettings
from obst_avoid.core.detection.paper.shape import Blob
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.types import Box, Kind, Obstacle, no_trace
from unit import drawn
from unit.cameras import Camera, calibration_of
from unit.scenes import cone, duckie, picture_of

CAMERA = Camera()
TELE = Camera(focal=420.0, projection=(420.0, 420.0), distortion=(0.0,) * 5)
"""Sees half as much road to each side, so that its bird view has nearly twice the pixels a metre."""
CALIBRATIONS = {
    'default': calibration_of(CAMERA),
    'tele': calibration_of(TELE),
    'small': calibration_of(CAMERA.resized(320, 240)),
}
CAMERAS = {'default': CAMERA, 'tele': TELE, 'small': CAMERA.resized(320, 240)}
BIRD_VIEW = BirdViewSettings(crop_distance=1.7, horizon_margin=0.021)
COLORS = {Kind.DUCKIE: drawn.DUCK, Kind.CONE: drawn.CONE}
ORANGE_RED = (30, 60, 210)
"""BGR of a stop line as it looks in warm light: within the filter for cones."""
MS = 1_000_000


@pytest.fixture
def calibration() -> Calibration:
    """The made-up camera that most tests here look through."""
    return CALIBRATIONS['default']


@pytest.fixture
def view(calibration: Calibration) -> BirdView:
    """Its bird view."""
    return make_bird_view(calibration, BIRD_VIEW)


@pytest.fixture
def paper(detection_settings: DetectionSettings) -> PaperSettings:
    """As shipped, each picture corrected by itself."""
    return replace(detection_settings.paper, color_correction='per_picture')


def alone(picture: np.ndarray, calibration: Calibration, paper: PaperSettings, trace: Any = no_trace) -> List[Obstacle]:
    """The obstacles of one picture that stands alone."""
    view = make_bird_view(calibration, BIRD_VIEW)
    return detect(picture, view, paper, PaperState(), None, trace)[0]


def blobs_of(picture: np.ndarray, calibration: Calibration, paper: PaperSettings) -> List[Blob]:
    """All blobs of one picture, the refused ones too."""
    stages: Dict[str, Any] = {}
    alone(picture, calibration, paper, stages.__setitem__)
    found: List[Blob] = stages['blobs']
    return found


def shadow(camera: Camera, thing: drawn.Thing) -> np.ndarray:
    """(N, 2) [m] what a thing covers of the road, seen from the camera: the smear of the bird view, by geometry."""
    points = np.concatenate([body for color, body in drawn._parts(thing) if color == COLORS[thing.kind]])
    share = camera.height / (camera.height - points[:, 2:])
    covered: np.ndarray = (camera.position + (points - camera.position) * share)[:, :2]
    return covered


# Where


def test_an_empty_road_has_no_obstacles(paper: PaperSettings) -> None:
    for name in ('small', 'tele', 'default'):
        assert alone(picture_of(CALIBRATIONS[name]), CALIBRATIONS[name], paper) == []


@pytest.mark.parametrize('value', [0, 128, 255])
def test_a_flat_picture_has_no_obstacles(paper: PaperSettings, value: int) -> None:
    assert alone(np.full((480, 640, 3), value, np.uint8), CALIBRATIONS['default'], paper) == []


@pytest.mark.parametrize('x', [0.3, 0.45, 0.6, 0.9])
@pytest.mark.parametrize('make, error', [(cone, 0.02), (duckie, 0.035)], ids=['cone', 'duckie'])
def test_a_thing_straight_ahead_is_found_where_it_stands(
    paper: PaperSettings, make: Any, error: float, x: float
) -> None:
    # a duckie's belly hides its foot: what is seen lowest is about 3 cm behind the nearest point of its footprint
    thing = make(x, 0.0)
    (found,) = alone(picture_of(CALIBRATIONS['default'], (thing,)), CALIBRATIONS['default'], paper)
    assert (found.kind, found.in_lane) == (thing.kind, True)
    assert math.hypot(found.x - (x - thing.radius), found.y) < error
    assert found.radius == pytest.approx(thing.radius, abs=0.01)


@pytest.mark.parametrize('x, y', [(0.4, -0.05), (0.5, 0.05), (0.55, -0.25), (0.8, 0.1)])
@pytest.mark.parametrize('make', [cone, duckie])
@pytest.mark.parametrize('camera', ['default', 'tele', 'small'])
def test_place_and_radius_are_those_of_the_box_around_the_smear(
    paper: PaperSettings, make: Any, x: float, y: float, camera: str
) -> None:
    # The report takes the middle of the box's lower edge and half its width: beside the robot's axis, where the smear
    # leans outwards, that is up to 0.1 m beside the thing. Profile paper keeps it; this pins it down.
    thing = make(x, y)
    (found,) = alone(picture_of(CALIBRATIONS[camera], (thing,)), CALIBRATIONS[camera], paper)
    smear = shadow(CAMERAS[camera], thing)
    left, right = smear[:, 1].max(), smear[:, 1].min()
    assert found.kind is thing.kind
    assert found.x == pytest.approx(smear[:, 0].min(), abs=0.015)
    assert found.y == pytest.approx((left + right) / 2, abs=0.015)
    assert found.radius == pytest.approx((left - right) / 2, abs=0.015)


def test_place_and_radius_belong_to_the_box_on_the_wire(paper: PaperSettings) -> None:
    calibration = CALIBRATIONS['default']
    view = make_bird_view(calibration, BIRD_VIEW)
    (found,) = alone(picture_of(calibration, (duckie(0.5, 0.05),)), calibration, paper)
    box = found.bird_box
    assert box is not None
    (u, v) = bird_from_ground(view, np.array([[found.x, found.y]]))[0]
    assert (u, v) == pytest.approx(((box.left + box.right - 1) / 2, box.bottom - 0.5))
    assert found.radius * view.pixels_per_metre == pytest.approx((box.right - box.left) / 2)


@pytest.mark.parametrize('make', [cone, duckie])
@pytest.mark.parametrize('x, y', [(0.35, 0.0), (0.5, -0.08)])
@pytest.mark.parametrize('camera', ['small', 'default'])
def test_the_box_in_the_picture_is_where_the_camera_sees_the_thing(
    paper: PaperSettings, make: Any, x: float, y: float, camera: str
) -> None:
    thing = make(x, y)
    (found,) = alone(picture_of(CALIBRATIONS[camera], (thing,)), CALIBRATIONS[camera], paper)
    body = np.concatenate([points for color, points in drawn._parts(thing) if color == COLORS[thing.kind]])
    seen = CAMERAS[camera].image_from_robot(body)
    box = found.image_box
    assert box is not None
    expected = [*seen.min(axis=0), *(seen.max(axis=0) + 1)]
    # a cone ends in a point that is too thin to be orange: its box begins lower
    allowed = 0.006 * CAMERAS[camera].width + (0.25 * (expected[3] - expected[1]) if thing.kind is Kind.CONE else 0)
    np.testing.assert_allclose([box.left, box.top, box.right, box.bottom], expected, atol=allowed)


def test_several_things_are_all_found(paper: PaperSettings) -> None:
    things = (duckie(0.35, -0.05), duckie(0.7, 0.02), cone(0.5, -0.3), cone(0.45, 0.25))
    found = alone(picture_of(CALIBRATIONS['default'], things), CALIBRATIONS['default'], paper)
    assert sorted(one.kind.value for one in found if one.kind) == ['cone', 'cone', 'duckie', 'duckie']


# The report's figures in whole pictures: the road turned below a thing


@pytest.mark.parametrize('heading', range(-180, 1, 20))
def test_a_duckie_passes_and_the_dashes_do_not_at_any_orientation(paper: PaperSettings, heading: int) -> None:
    turn = math.radians(heading)
    # half a metre ahead of the robot, 0.1 m beside the dashes, its smear pointing away from them
    pose = drawn.RobotPose(-0.5 * math.cos(turn), 0.0225 - 0.5 * math.sin(turn), turn)
    calibration = CALIBRATIONS['default']
    picture = drawn.draw(drawn.Scene((duckie(0.0, 0.0225),)), calibration, pose)
    # farther than 1 m the picture has no rows for the gaps, and dashes run together: the report's own limit
    found = [one for one in alone(picture, calibration, paper) if one.x < 1.0]
    assert [one.kind for one in found] == [Kind.DUCKIE]
    assert math.hypot(found[0].x - 0.5, found[0].y) < 0.03
    refused = [one for one in blobs_of(picture, calibration, paper) if one.kind is Kind.DUCKIE and one.refused]
    assert refused, 'dashes must have been seen'


@pytest.mark.parametrize('heading', range(90, 271, 20))
def test_a_cone_passes_and_a_stop_line_does_not_at_any_orientation(
    paper: PaperSettings, monkeypatch: pytest.MonkeyPatch, heading: int
) -> None:
    monkeypatch.setattr(drawn, 'RED', ORANGE_RED)
    turn = math.radians(heading)
    # 0.45 m ahead of the robot, 0.1 m before the stop line's near edge, its smear pointing away from the line
    pose = drawn.RobotPose(2.9 - 0.45 * math.cos(turn), -0.45 * math.sin(turn), turn)
    calibration = CALIBRATIONS['default']
    picture = drawn.draw(drawn.Scene((cone(2.9, 0.0),), stop_line=3.0), calibration, pose)
    found = [one for one in alone(picture, calibration, paper) if one.x < 1.0]
    assert [one.kind for one in found] == [Kind.CONE]
    assert math.hypot(found[0].x - 0.45, found[0].y) < 0.03
    lines = [one for one in blobs_of(picture, calibration, paper) if one.kind is Kind.CONE and one.area > 150]
    assert lines and all(line.refused.startswith('ratio of eigenvalues') for line in lines)


def test_two_cameras_of_very_different_scale_decide_the_same(
    paper: PaperSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawn, 'RED', ORANGE_RED)
    things = (duckie(0.4, -0.04), cone(0.6, 0.03), cone(0.7, -0.25))
    scales, decisions = [], []
    for name in ('default', 'tele'):
        scales.append(make_bird_view(CALIBRATIONS[name], BIRD_VIEW).pixels_per_metre)
        picture = drawn.draw(drawn.Scene(things, stop_line=0.25), CALIBRATIONS[name], drawn.RobotPose())
        decisions.append([one for one in alone(picture, CALIBRATIONS[name], paper) if one.x < 1.0])
    assert scales[1] > 1.8 * scales[0]
    kinds = [sorted((one.kind.value, one.in_lane) for one in found if one.kind) for found in decisions]
    assert kinds[0] == kinds[1] == [('cone', False), ('cone', True), ('duckie', True)]
    for here, there in zip(*(sorted(found, key=lambda one: one.x) for found in decisions)):
        assert (there.x, there.y, there.radius) == pytest.approx((here.x, here.y, here.radius), abs=0.02)
        if here.kind is Kind.DUCKIE:
            assert there.confidence == pytest.approx(here.confidence, abs=0.05), 'from its first eigenvalue'


# Which side of the white line


@pytest.mark.parametrize('make', [cone, duckie])
@pytest.mark.parametrize(
    'x, y, in_lane',
    [
        pytest.param(0.4, -0.03, True, id='in our lane'),
        pytest.param(0.5, 0.06, True, id='at the centre line'),
        pytest.param(0.6, -0.22, False, id='beyond the right line'),
        pytest.param(0.8, -0.3, False, id='far beyond the right line'),
        pytest.param(0.6, 0.2, True, id='in the opposite lane: nothing white in between'),
        pytest.param(1.0, 0.44, False, id='beyond the left line'),
    ],
)
@pytest.mark.parametrize('camera', ['tele', 'default'])
def test_what_stands_beyond_a_white_line_is_outside(
    paper: PaperSettings, make: Any, x: float, y: float, in_lane: bool, camera: str
) -> None:
    thing = make(x, y)
    found = alone(picture_of(CALIBRATIONS[camera], (thing,)), CALIBRATIONS[camera], paper)
    # a duckie's beak, seen through the long lens, passes for a cone of its own
    assert [one.in_lane for one in found if one.kind is thing.kind] == [in_lane]


def test_a_speck_of_white_is_no_line(paper: PaperSettings) -> None:
    calibration = CALIBRATIONS['default']
    picture = picture_of(calibration, (duckie(0.5, 0.0),)).copy()
    u, v = np.rint(CAMERA.image_from_robot([[0.3, 0.0, 0.0]])[0]).astype(int)
    for half, in_lane in ((2, True), (16, False)):
        picture[v - half : v + half, u - 20 : u + 20] = drawn.WHITE
        found = alone(picture, calibration, paper)
        assert [one.in_lane for one in found] == [in_lane]


def test_the_search_line_runs_from_the_robot_to_the_foot_of_the_box() -> None:
    view = make_bird_view(CALIBRATIONS['default'], BIRD_VIEW)
    box = Box(400, 100, 421, 121)
    line = search_line(box, view)
    assert tuple(line[-1]) == (410, 120)
    assert (np.abs(np.diff(line, axis=0)).max(axis=1) <= 1).all(), 'no pixel is left out'
    assert line[0, 1] == view.height - 1, 'it begins at the edge of the view'
    start = bird_from_ground(view, np.zeros((1, 2)))[0]
    ray, foot = line - start, np.array([410, 120]) - start
    assert np.abs(ray[:, 0] * foot[1] - ray[:, 1] * foot[0]).max() / np.linalg.norm(foot) <= 1, 'it is straight'


@pytest.mark.parametrize('box', [Box(0, 0, 5, 5), Box(635, 0, 640, 5), Box(0, 211, 5, 216), Box(300, 215, 340, 216)])
def test_the_search_line_stays_in_the_view(view: BirdView, box: Box) -> None:
    line = search_line(box, view)
    assert line.shape[1] == 2 and (line >= 0).all() and (line < (view.width, view.height)).all()


# Sequences

SURE, UNSURE = (duckie(0.6, 0.0),), (duckie(0.5, 0.0, 0.03),)
"""Blobs of a first eigenvalue above and below 100 px^2, see the first test that uses them."""


@pytest.fixture
def look(calibration: Calibration, view: BirdView, paper: PaperSettings) -> Any:
    """Feeds (milliseconds, things) pictures through one detector and says what was found in each."""

    def feed(*pictures: Tuple[int, Tuple[drawn.Thing, ...]]) -> List[List[str]]:
        state, answers = PaperState(), []
        for stamp, things in pictures:
            found, state = detect(picture_of(calibration, things), view, paper, state, stamp * MS)
            answers.append([one.kind.value for one in found if one.kind])
        return answers

    return feed


def test_the_two_duckies_are_a_sure_and_an_unsure_one(calibration: Calibration, paper: PaperSettings) -> None:
    for things, sure in ((SURE, True), (UNSURE, False)):
        (found,) = (one for one in blobs_of(picture_of(calibration, things), calibration, paper) if not one.refused)
        assert (found.major > paper.sure_eigenvalue) is sure


CONE = (cone(0.5, 0.0),)


@pytest.mark.parametrize(
    'pictures, answers',
    [
        pytest.param([(0, ()), (100, ())], [[], []], id='empty road'),
        pytest.param([(0, CONE), (100, ()), (200, CONE)], [['cone'], [], ['cone']], id='a cone counts at once'),
        pytest.param([(0, SURE), (100, SURE), (200, SURE)], [[], ['duckie'], ['duckie']], id='a large duckie: twice'),
        pytest.param(
            [(0, UNSURE), (100, UNSURE), (200, UNSURE)], [[], [], ['duckie']], id='a small duckie: three times'
        ),
        pytest.param([(0, SURE), (500, SURE)], [[], ['duckie']], id='half a second between pictures'),
        pytest.param([(0, SURE), (501, SURE), (601, SURE)], [[], [], ['duckie']], id='a gap begins anew'),
        pytest.param(
            [(900, SURE), (1000, SURE), (100, SURE), (200, SURE)],
            [[], ['duckie'], [], ['duckie']],
            id='time jumps back',
        ),
        pytest.param([(0, SURE), (0, SURE)], [[], []], id='the same picture twice is not two'),
        pytest.param(
            [(0, SURE), (100, ()), (200, SURE), (300, SURE)], [[], [], [], ['duckie']], id='gone for one picture'
        ),
    ],
)
def test_sequences(look: Any, pictures: List[Tuple[int, Tuple[drawn.Thing, ...]]], answers: List[List[str]]) -> None:
    assert look(*pictures) == answers


def test_a_picture_that_stands_alone_needs_no_second(calibration: Calibration, paper: PaperSettings) -> None:
    for things in (SURE, UNSURE, CONE):
        assert len(alone(picture_of(calibration, things), calibration, paper)) == 1


# Colour correction


def dimmed(picture: np.ndarray, gain: float) -> np.ndarray:
    """The same picture in less light."""
    return np.rint(picture * gain).astype(np.uint8)


@pytest.mark.parametrize('how, found', [('none', 0), ('once', 1), ('per_picture', 1)])
def test_a_dim_picture_needs_the_correction(
    calibration: Calibration, paper: PaperSettings, how: str, found: int
) -> None:
    picture = dimmed(picture_of(calibration, SURE), 0.5)
    assert len(alone(picture, calibration, replace(paper, color_correction=how))) == found


@pytest.mark.parametrize(
    'how, second',
    [
        pytest.param('none', 'as it is', id='none'),
        pytest.param('once', 'by the first', id='once'),
        pytest.param('per_picture', 'by itself', id='per picture'),
    ],
)
def test_the_correction_of_the_second_picture(
    calibration: Calibration, view: BirdView, paper: PaperSettings, how: str, second: str
) -> None:
    settings = replace(paper, color_correction=how)
    bright = picture_of(calibration, SURE)
    dim = dimmed(bright, 0.5)
    state: PaperState = PaperState()
    stages: List[Dict[str, Any]] = []
    for stamp, picture in enumerate((bright, dim)):
        stages.append({})
        _, state = detect(picture, view, settings, state, stamp, stages[-1].__setitem__)
    alone_stages: Dict[str, Any] = {}
    detect(dim, view, settings, PaperState(), 0, alone_stages.__setitem__)
    corrected = stages[1]['corrected'].astype(int)
    wanted = {
        'as it is': dim,
        'by the first': stages[0]['corrected'] * 0.5,
        'by itself': alone_stages['corrected'],
    }
    # the offset is not halved with the light, so "by the first" fits only on average
    distances = {name: float(np.abs(corrected - picture).mean()) for name, picture in wanted.items()}
    assert min(distances, key=lambda name: distances[name]) == second, distances
    assert (state.correction is not None) is (how == 'once')


def test_a_picture_without_contrast_is_not_taken_for_the_correction(
    calibration: Calibration, view: BirdView, paper: PaperSettings
) -> None:
    once = replace(paper, color_correction='once')
    covered = np.full((480, 640, 3), 20, np.uint8)
    state: Optional[PaperState] = PaperState()
    assert state is not None
    _, state = detect(covered, view, once, state, 0)
    assert state.correction is None
    _, state = detect(dimmed(picture_of(calibration, SURE), 0.5), view, once, state, 100 * MS)
    first = state.correction
    assert first is not None
    _, state = detect(picture_of(calibration, SURE), view, once, state, 200 * MS)
    assert state.correction is first
    _, state = detect(picture_of(calibration, SURE), view, once, state, 100 * MS)
    assert state.correction is first, 'time running backwards is no reason to look at the light anew'


@pytest.mark.parametrize('how', ['none', 'per_picture'])
def test_a_kept_correction_ends_when_the_setting_changes(
    calibration: Calibration, view: BirdView, paper: PaperSettings, how: str
) -> None:
    bright = picture_of(calibration, SURE)
    _, state = detect(dimmed(bright, 0.5), view, replace(paper, color_correction='once'), PaperState(), 0)
    assert state.correction is not None
    changed = replace(paper, color_correction=how)
    here: Dict[str, Any] = {}
    there: Dict[str, Any] = {}
    detect(bright, view, changed, state, 100 * MS, here.__setitem__)
    detect(bright, view, changed, PaperState(), 100 * MS, there.__setitem__)
    np.testing.assert_array_equal(here['corrected'], there['corrected'])


# Tracing


def test_each_stage_is_shown(calibration: Calibration, view: BirdView, paper: PaperSettings) -> None:
    stages: Dict[str, Any] = {}
    found, _ = detect(picture_of(calibration, SURE), view, paper, PaperState(), None, stages.__setitem__)
    assert list(stages) == ['corrected', 'cropped', 'bird_view', 'hsv', 'colors', 'blobs', 'tracked', 'obstacles']
    assert stages['cropped'].shape == (480 - view.crop_row, 640, 3)
    assert stages['bird_view'].shape == stages['hsv'].shape == (view.height, 640, 3)
    assert sorted(stages['colors']) == ['orange', 'white', 'yellow']
    assert stages['obstacles'] == found


def test_the_picture_is_left_alone(calibration: Calibration, paper: PaperSettings) -> None:
    picture = picture_of(calibration, SURE).copy()
    before = picture.copy()
    alone(picture, calibration, paper)
    np.testing.assert_array_equal(picture, before)
