"""core.calibration: both file formats, the search order, and what must be refused with which sentence."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, Optional, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core import calibration as code
from obst_avoid.core.calibration import (
    Calibration,
    CalibrationError,
    camera_from_robot,
    camera_position,
    camera_roll,
    find_calibration,
    horizon_row,
    load_calibration,
    scaled,
)
from obst_avoid.core.geometry import ground_from_pixel
from unit.cameras import ROBOT, Camera, calibration_of, extrinsic_file, intrinsic_file, load_camera, write_files

CAMERA = Camera()
ON_THE_ROAD = np.array([[0.2, 0.0, 0], [0.5, 0.1, 0], [0.5, -0.2, 0], [1.2, 0.3, 0]])


def refusal(folder: Path, camera: Camera = CAMERA, **changes: Any) -> str:
    """The sentence that refuses a camera, without the folder."""
    with pytest.raises(CalibrationError) as refused:
        load_camera(folder, camera, **changes)
    return str(refused.value).replace(str(folder) + '/', '')


def ground_of(calibration: Calibration, camera: Camera) -> np.ndarray:
    """ON_THE_ROAD, projected by the made-up camera and back by the code under test."""
    return ground_from_pixel(calibration.homography, camera.rectified_from_robot(ON_THE_ROAD))


def matrix(rows: int, cols: int, data: Any) -> Dict[str, Any]:
    """A matrix as ROS's camera_calibration writes it."""
    return {'rows': rows, 'cols': cols, 'data': data}


# Formats


@pytest.mark.parametrize('form', ['flat', 'nested', 'resolution-independent'])
@pytest.mark.parametrize(
    'camera',
    [
        pytest.param(CAMERA, id='default'),
        pytest.param(replace(CAMERA, roll=-4.0, yaw=3.0, left=0.01), id='rolled, turned and beside the middle'),
        pytest.param(replace(CAMERA, twist=2.0), id='rectified by a rotation'),
        pytest.param(CAMERA.resized(320, 240), id='320x240'),
        pytest.param(CAMERA.resized(1296, 972), id='1296x972'),
    ],
)
def test_all_formats_give_the_same_ground(tmp_path: Path, camera: Camera, form: str) -> None:
    loaded = load_camera(tmp_path, camera, form)
    assert (loaded.width, loaded.height) == (camera.width, camera.picture_height)
    np.testing.assert_allclose(ground_of(loaded, camera), ON_THE_ROAD[:, :2], atol=1e-9)


def test_a_resolution_independent_homography_fits_any_aspect(tmp_path: Path) -> None:
    wide = replace(CAMERA, picture_height=360)
    np.testing.assert_allclose(
        ground_of(load_camera(tmp_path, wide, 'resolution-independent'), wide), ON_THE_ROAD[:, :2], atol=1e-9
    )


@pytest.mark.parametrize('factor', [-1.0, 1000.0, 0.001])
def test_a_homography_has_no_scale_of_its_own(tmp_path: Path, factor: float) -> None:
    loaded = load_camera(tmp_path, CAMERA, extrinsic={'homography': (factor * CAMERA.homography).ravel().tolist()})
    np.testing.assert_allclose(ground_of(loaded, CAMERA), ON_THE_ROAD[:, :2], atol=1e-9)
    assert (loaded.homography @ (320, 479, 1))[2] > 0


@pytest.mark.parametrize('form', ['flat', 'resolution-independent'])
def test_the_frame_may_be_said(tmp_path: Path, form: str) -> None:
    loaded = load_camera(tmp_path, CAMERA, form, extrinsic={'frame': 'robot'})
    np.testing.assert_allclose(ground_of(loaded, CAMERA), ON_THE_ROAD[:, :2], atol=1e-9)


def test_fields_of_the_intrinsic_file_arrive(tmp_path: Path) -> None:
    camera = replace(CAMERA, twist=2.0)
    loaded = load_camera(tmp_path, camera)
    np.testing.assert_allclose(loaded.camera_matrix, camera.k)
    np.testing.assert_allclose(loaded.distortion, camera.distortion)
    np.testing.assert_allclose(loaded.rectification, camera.rectification)
    np.testing.assert_allclose(loaded.projection, camera.p)
    assert (loaded.vehicle, loaded.source) == (ROBOT, str(tmp_path / 'camera_extrinsic' / (ROBOT + '.yaml')))
    assert loaded.warnings == ()


def test_numbers_may_be_nested_or_bare(tmp_path: Path) -> None:
    loaded = load_camera(tmp_path, CAMERA, intrinsic={'camera_matrix': CAMERA.k.tolist()})
    np.testing.assert_allclose(loaded.camera_matrix, CAMERA.k)


def test_the_shipped_camera_stands_where_its_file_says(calibration: Calibration) -> None:
    np.testing.assert_allclose(camera_position(calibration), [0.066, 0, 0.108], atol=1e-6)
    rotation, _ = camera_from_robot(calibration)
    assert math.degrees(math.asin(-rotation[2, 2])) == pytest.approx(21, abs=0.01)
    assert calibration.warnings == ()


# The camera's pose


@pytest.mark.parametrize(
    'height, pitch, roll, yaw', [(0.108, 21, 0, 0), (0.09, 12, 4, -5), (0.14, 35, -5, 8), (0.06, 2, 1, 0)]
)
def test_the_pose_comes_back_from_the_homography(height: float, pitch: float, roll: float, yaw: float) -> None:
    camera = Camera(height=height, pitch=pitch, roll=roll, yaw=yaw, ahead=0.05, left=-0.02)
    calibration = calibration_of(camera)
    np.testing.assert_allclose(camera_position(calibration), camera.position, atol=1e-9)
    rotation, translation = camera_from_robot(calibration)
    np.testing.assert_allclose(rotation, camera.rotation, atol=1e-9)
    np.testing.assert_allclose(translation, -camera.rotation @ camera.position, atol=1e-9)
    assert math.degrees(camera_roll(calibration)) == pytest.approx(roll, abs=1e-9)


def test_the_horizon_is_where_the_far_road_goes() -> None:
    camera = Camera(roll=4.0)
    (left, right) = camera.rectified_from_robot([[1e9, 1e9, 0], [1e9, -1e9, 0]])
    calibration = calibration_of(camera)
    assert left[1] < right[1], 'turned clockwise, the horizon falls to the right'
    for u, row in (left, right):
        assert horizon_row(calibration.homography, u) == pytest.approx(row, abs=1e-3)


# Search order


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Dict[str, Path]:
    """The places of the search order, empty; the robot's own folder is moved out of /data."""
    places = {name: tmp_path / name for name in ('given', 'robot', 'fleet', 'default')}
    for place in places.values():
        place.mkdir()
    monkeypatch.setattr(code, 'ROBOT_FOLDER', str(places['robot']))
    return places


def found_in(folders: Dict[str, Path], given: str = '', default: Optional[str] = None) -> Calibration:
    """The search as a node starts it."""
    return find_calibration(ROBOT, given, default, {'DUCKIEFLEET_ROOT': str(folders['fleet'])})


def fill(folder: Path, height: float, name: str = ROBOT) -> None:
    """Put a camera of a certain height there, so that it can be told from the others."""
    camera = Camera(height=height)
    write_files(folder, intrinsic_file(camera), extrinsic_file(camera), name)


def test_nothing_found_names_the_files_and_folders(folders: Dict[str, Path]) -> None:
    with pytest.raises(CalibrationError) as refused:
        found_in(folders, str(folders['given']))
    assert str(refused.value) == (
        'no calibration of duck1, expected camera_intrinsic/duck1.yaml and camera_extrinsic/duck1.yaml in one of: '
        '%s, %s, %s' % (folders['given'], folders['robot'], folders['fleet'] / 'calibrations')
    )


def test_without_a_fleet_folder_only_the_others_are_searched(folders: Dict[str, Path]) -> None:
    with pytest.raises(CalibrationError) as refused:
        find_calibration(ROBOT, environ={})
    assert str(refused.value).endswith('in one of: %s' % folders['robot'])


def test_the_fleet_folder_comes_from_the_environment(folders: Dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    fill(folders['fleet'] / 'calibrations', 0.11)
    monkeypatch.setenv('DUCKIEFLEET_ROOT', str(folders['fleet']))
    assert camera_position(find_calibration(ROBOT))[2] == pytest.approx(0.11)


def test_the_first_folder_of_the_order_wins(folders: Dict[str, Path]) -> None:
    fill(folders['default'], 0.08, 'default')
    heights = []
    for place, height in (
        (folders['fleet'] / 'calibrations', 0.09),
        (folders['robot'], 0.10),
        (folders['given'], 0.11),
    ):
        fill(place, height)
        found = found_in(folders, str(folders['given']), str(folders['default']))
        heights.append(round(camera_position(found)[2], 6))
    assert heights == [0.09, 0.10, 0.11]


def test_the_default_is_used_last_and_under_the_robots_name(folders: Dict[str, Path]) -> None:
    fill(folders['default'], 0.08, 'default')
    found = found_in(folders, str(folders['given']), str(folders['default']))
    assert camera_position(found)[2] == pytest.approx(0.08)
    assert (found.vehicle, found.source.endswith('camera_extrinsic/default.yaml')) == (ROBOT, True)


def test_the_default_is_used_only_when_allowed(folders: Dict[str, Path]) -> None:
    fill(folders['default'], 0.08, 'default')
    with pytest.raises(CalibrationError, match='no calibration of duck1'):
        found_in(folders, str(folders['given']))


@pytest.mark.parametrize('missing', ['camera_intrinsic', 'camera_extrinsic'])
def test_half_a_calibration_is_not_replaced_by_another_folders(folders: Dict[str, Path], missing: str) -> None:
    fill(folders['given'], 0.11)
    fill(folders['robot'], 0.10)
    path = folders['given'] / missing / (ROBOT + '.yaml')
    path.unlink()
    with pytest.raises(CalibrationError) as refused:
        found_in(folders, str(folders['given']))
    assert str(refused.value) == '%s cannot be read: No such file or directory' % path


def test_a_given_folder_must_exist(folders: Dict[str, Path]) -> None:
    fill(folders['robot'], 0.10)
    with pytest.raises(CalibrationError) as refused:
        found_in(folders, '/absent/folder')
    assert str(refused.value) == 'calibration_dir = /absent/folder, expected an existing folder'


@pytest.mark.parametrize('vehicle', ['', '.', '..', '.hidden', 'a/b', '/etc/passwd', '../duck1', 'duck1/'])
def test_a_robots_name_cannot_lead_out_of_the_folder(folders: Dict[str, Path], vehicle: str) -> None:
    with pytest.raises(CalibrationError) as refused:
        find_calibration(vehicle, str(folders['given']))
    assert str(refused.value) == 'vehicle = %r, expected the plain name of a robot' % vehicle


# Files that cannot be right


def test_files_that_do_not_parse_name_the_line(tmp_path: Path) -> None:
    write_files(
        tmp_path, intrinsic_file(CAMERA), 'a: 1\n<<<<<<< HEAD\nhomography: [1]\n=======\nhomography: [2]\n>>>>>>> x\n'
    )
    with pytest.raises(CalibrationError) as refused:
        load_calibration(str(tmp_path), ROBOT)
    assert str(refused.value) == '%s/camera_extrinsic/duck1.yaml does not parse as YAML at line 3' % tmp_path


@pytest.mark.parametrize('content', ['', '[1, 2]', 'homography'], ids=['empty', 'a list', 'text'])
@pytest.mark.parametrize('which', ['intrinsic', 'extrinsic'])
def test_a_file_must_be_a_mapping(tmp_path: Path, which: str, content: str) -> None:
    files: Dict[str, Any] = {'intrinsic': intrinsic_file(CAMERA), 'extrinsic': extrinsic_file(CAMERA)}
    files[which] = content
    write_files(tmp_path, files['intrinsic'], files['extrinsic'])
    with pytest.raises(CalibrationError) as refused:
        load_calibration(str(tmp_path), ROBOT)
    path = '%s/camera_%s/duck1.yaml' % (tmp_path, which)
    assert str(refused.value) == path + ' is not a mapping, expected the fields of a calibration file'


IDENTITY = np.eye(3).ravel().tolist()


@pytest.mark.parametrize(
    'changes, message',
    [
        pytest.param(
            {'image_width': None}, 'image_width = None, expected a whole number of pixels >= 16', id='no width'
        ),
        pytest.param({'image_width': 640.0}, 'image_width = 640.0, expected a whole number', id='width is a float'),
        pytest.param({'image_width': True}, 'image_width = True, expected a whole number', id='width is a bool'),
        pytest.param({'image_height': 15}, 'image_height = 15, expected a whole number of pixels >= 16', id='tiny'),
        pytest.param({'image_height': '480'}, "image_height = '480', expected a whole number", id='height is text'),
        pytest.param({'distortion_model': 'fisheye'}, "distortion_model = 'fisheye', expected plumb_bob", id='fisheye'),
        pytest.param({'camera_matrix': None}, 'camera_matrix missing, expected 9 numbers', id='no camera matrix'),
        pytest.param({'camera_matrix': matrix(3, 3, None)}, 'camera_matrix = None, expected 9 numbers', id='no data'),
        pytest.param({'camera_matrix': [1, 2]}, 'camera_matrix = [1, 2], expected 9 numbers', id='two numbers of nine'),
        pytest.param({'camera_matrix': ['x'] * 9}, 'camera_matrix = [', id='letters'),
        pytest.param(
            {'camera_matrix': [[1, 2, 3], [4, 5], [6]]}, 'camera_matrix = [[1, 2, 3], [4, 5], [6]], ', id='ragged'
        ),
        pytest.param({'camera_matrix': {'a': 1}}, 'camera_matrix = None, expected 9 numbers', id='another mapping'),
        pytest.param({'camera_matrix': [math.nan] * 9}, 'expected 9 numbers, all finite', id='NaN'),
        pytest.param({'camera_matrix': [10**400] * 9}, 'expected 9 numbers', id='beyond all floats'),
        pytest.param(
            {'distortion_coefficients': matrix(1, 4, [0.1] * 4)},
            'distortion_coefficients = [0.1, 0.1, 0.1, 0.1], expected 5 numbers',
            id='four coefficients',
        ),
        pytest.param(
            {'distortion_coefficients': [0.1, math.inf, 0, 0, 0]},
            'distortion_coefficients = [0.1, inf, 0, 0, 0], expected 5 numbers, all finite',
            id='infinite distortion',
        ),
        pytest.param(
            {'rectification_matrix': None}, 'rectification_matrix missing, expected 9 numbers', id='no rectification'
        ),
        pytest.param(
            {'rectification_matrix': (2 * np.eye(3)).tolist()},
            'rectification_matrix = [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], expected a rotation',
            id='rectification scales',
        ),
        pytest.param(
            {'rectification_matrix': np.diag([2, 0.5, 1]).tolist()},
            'rectification_matrix = [[2.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0]], expected a rotation',
            id='rectification stretches, though its determinant is 1',
        ),
        pytest.param({'projection_matrix': IDENTITY}, 'projection_matrix = [1.0, 0.0, ', id='nine numbers of twelve'),
        pytest.param(
            {'camera_matrix': [11454, 0, 320, 0, 1445, 240, 0, 0, 1]},
            'camera_matrix has focal lengths 11454 and 1445 px, expected 128 to 1920 px for a picture 640 px wide, '
            'in a ratio of 0.8 to 1.25',
            id='absurd focal length',
        ),
        pytest.param(
            {'camera_matrix': [320, 0, 320, 0, 500, 240, 0, 0, 1]},
            'camera_matrix has focal lengths 320 and 500 px, expected 128 to 1920 px',
            id='pixels far from square',
        ),
        pytest.param(
            {'camera_matrix': [-320, 0, 320, 0, -320, 240, 0, 0, 1]},
            'camera_matrix has focal lengths -320 and -320 px',
            id='negative focal length',
        ),
        pytest.param(
            {'projection_matrix': [60, 0, 320, 0, 0, 60, 240, 0, 0, 0, 1, 0]},
            'projection_matrix has focal lengths 60 and 60 px, expected 128 to 1920 px',
            id='absurd rectified focal length',
        ),
        pytest.param(
            {'camera_matrix': [320, 0, 20, 0, 320, 240, 0, 0, 1]},
            'camera_matrix has its centre at (20, 240), expected it near the middle of a picture of 640x480',
            id='centre at the edge',
        ),
    ],
)
def test_each_bad_intrinsic_field_is_named(tmp_path: Path, changes: Dict[str, Any], message: str) -> None:
    assert message in refusal(tmp_path, intrinsic=changes)
    assert refusal(tmp_path, intrinsic=changes).startswith('camera_intrinsic/duck1.yaml: ')


@pytest.mark.parametrize(
    'changes, message',
    [
        pytest.param({'homography': None}, 'homography missing, expected 9 numbers', id='missing'),
        pytest.param(
            {'homography': [1, 2, 3]}, 'homography = [1, 2, 3], expected 9 numbers', id='three numbers of nine'
        ),
        pytest.param({'homography': [1.0] * 10}, 'homography = [1.0, 1.0, 1.0,', id='ten numbers'),
        pytest.param({'homography': [math.nan] + [1.0] * 8}, 'expected 9 numbers, all finite', id='NaN'),
        pytest.param({'homography': [0] * 9}, 'homography = [[0.0, 0.0, 0.0], ', id='zeros'),
        pytest.param({'homography': [1] * 9}, 'expected an invertible matrix', id='singular'),
        pytest.param({'frame': 'camera'}, "frame = 'camera', expected robot", id='frame'),
        pytest.param(
            {'format': 'v2'}, "format = 'v2', expected resolution-independent, or no format for pixels", id='format'
        ),
    ],
)
def test_each_bad_extrinsic_field_is_named(tmp_path: Path, changes: Dict[str, Any], message: str) -> None:
    assert message in refusal(tmp_path, extrinsic=changes)
    assert refusal(tmp_path, extrinsic=changes).startswith('camera_extrinsic/duck1.yaml: ')


def test_a_pixel_homography_does_not_fit_another_aspect(tmp_path: Path) -> None:
    assert refusal(tmp_path, replace(CAMERA, picture_height=360)) == (
        'camera_extrinsic/duck1.yaml: homography is for 640x480 pixels, expected an intrinsic calibration of that '
        'aspect, not 640x360'
    )


# Cameras that cannot be right


def turned_ground(camera: Camera, x: float, y: float) -> Dict[str, Any]:
    """An extrinsic file whose road axes point the wrong way."""
    return {'homography': (np.diag([x, y, 1]) @ camera.homography).ravel().tolist()}


@pytest.mark.parametrize(
    'camera, extrinsic, found, expected',
    [
        pytest.param(
            CAMERA, turned_ground(CAMERA, -1, -1), 'is upside down, x = ', 'y to the left', id='chessboard upside down'
        ),
        pytest.param(CAMERA, turned_ground(CAMERA, 1, -1), 'is mirrored, y = ', 'y to grow to the left', id='mirrored'),
        pytest.param(
            Camera(height=-0.1, pitch=-70),
            None,
            'sees the road from below, x = ',
            'a camera above the road, x to grow towards the horizon',
            id='under the road, looking up',
        ),
        pytest.param(Camera(height=-0.1), None, 'is upside down', 'x to grow towards the horizon', id='under the road'),
        pytest.param(
            Camera(pitch=-32), None, 'has no horizon above row 383', 'a camera that looks ahead', id='looks up'
        ),
        pytest.param(
            Camera(pitch=93), None, 'has no horizon above row 383', 'a camera that looks ahead', id='looks back'
        ),
        pytest.param(Camera(roll=8), None, 'has the camera rolled by 8.0 degrees', 'at most 6', id='rolled clockwise'),
        pytest.param(Camera(roll=-8), None, 'has the camera rolled by -8.0 degrees', 'at most 6', id='rolled back'),
        pytest.param(
            Camera(ahead=1.5), None, 'has x = ', 'the road shortly before the robot', id='far ahead of the robot'
        ),
        pytest.param(
            Camera(ahead=-0.6), None, 'has x = ', 'the road shortly before the robot', id='far behind the robot'
        ),
    ],
)
def test_an_implausible_camera_is_refused(
    tmp_path: Path, camera: Camera, extrinsic: Optional[Dict[str, Any]], found: str, expected: str
) -> None:
    message = refusal(tmp_path, camera, extrinsic=extrinsic)
    assert message.startswith('camera_extrinsic/duck1.yaml: homography ' + found)
    assert expected in message.split(', expected ', 1)[1]


@pytest.mark.parametrize(
    'camera',
    [
        pytest.param(Camera(roll=5), id='rolled by 5 degrees'),
        pytest.param(Camera(roll=-5), id='rolled by -5 degrees'),
        pytest.param(Camera(pitch=0), id='level'),
        pytest.param(Camera(pitch=-10), id='looks up a little'),
        pytest.param(Camera(pitch=45), id='looks down: no horizon in the picture'),
        pytest.param(Camera(yaw=10), id='looks left'),
        pytest.param(Camera(height=0.04), id='low'),
        pytest.param(Camera(height=0.3, pitch=40), id='high'),
    ],
)
def test_an_unusual_camera_is_accepted(tmp_path: Path, camera: Camera) -> None:
    np.testing.assert_allclose(ground_of(load_camera(tmp_path, camera), camera), ON_THE_ROAD[:, :2], atol=1e-9)


@pytest.mark.parametrize(
    'camera, warning',
    [
        pytest.param(Camera(roll=4), 'has the camera rolled by 4.0 degrees, expected less than 3', id='rolled'),
        pytest.param(
            Camera(height=0.4, pitch=50), 'puts the camera 0.400 m above the road, expected 0.04 to 0.3 m', id='high'
        ),
        pytest.param(Camera(height=0.03), 'puts the camera 0.030 m above the road, expected 0.04 to 0.3 m', id='low'),
    ],
)
def test_what_is_odd_is_a_warning(tmp_path: Path, camera: Camera, warning: str) -> None:
    path = tmp_path / 'camera_extrinsic' / 'duck1.yaml'
    assert load_camera(tmp_path, camera).warnings == ('%s: homography %s' % (path, warning),)


def test_a_road_stretched_in_one_direction_is_a_warning(tmp_path: Path) -> None:
    loaded = load_camera(tmp_path, CAMERA, extrinsic=turned_ground(CAMERA, 1.5, 1))
    (warning,) = loaded.warnings
    assert 'homography stretches x by 0.67 against y, expected about 1' in warning


# Other picture sizes


@pytest.mark.parametrize('size', [(320, 240), (160, 120), (1280, 960)])
def test_a_resized_picture_shows_the_same_road(size: Tuple[int, int]) -> None:
    # cv2.resize itself says which pixel of the original each pixel of the resized picture shows
    original = calibration_of(CAMERA)
    u, v = np.meshgrid(np.arange(640.0), np.arange(480.0))
    shown = cv2.resize(np.dstack([u, v]).astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    factor = size[0] / 640
    inside = [(int(column * factor), int(row * factor)) for column, row in ((100, 250), (320, 300), (500, 400))]
    resized = scaled(original, *size)
    assert (resized.width, resized.height) == size
    np.testing.assert_allclose(
        ground_from_pixel(resized.homography, np.array(inside, dtype=np.float64)),
        ground_from_pixel(
            original.homography, np.array([shown[row, column] for column, row in inside], dtype=np.float64)
        ),
        atol=1e-5,
    )


def test_a_resized_camera_projects_as_a_camera_of_that_size() -> None:
    resized, made = scaled(calibration_of(CAMERA), 320, 240), CAMERA.resized(320, 240)
    np.testing.assert_allclose(resized.camera_matrix, made.k, atol=1e-9)
    np.testing.assert_allclose(resized.projection, made.p, atol=1e-9)
    np.testing.assert_allclose(camera_position(resized), made.position, atol=1e-9)


def test_the_same_size_needs_no_scaling() -> None:
    original = calibration_of(CAMERA)
    assert scaled(original, 640, 480) is original


@pytest.mark.parametrize('size', [(640, 360), (480, 480), (1920, 1080)])
def test_a_picture_of_another_aspect_is_refused(size: Tuple[int, int]) -> None:
    with pytest.raises(CalibrationError) as refused:
        scaled(calibration_of(CAMERA), *size)
    assert str(refused.value) == (
        'the picture is %dx%d, expected the aspect of 640x480 as in camera_extrinsic/duck1.yaml' % size
    )
