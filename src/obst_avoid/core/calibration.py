"""Duckietown's calibration files: found, read, checked and scaled.

Two files make a calibration, `camera_intrinsic/<vehicle>.yaml` (ROS camera_calibration format) and
`camera_extrinsic/<vehicle>.yaml` (`homography`, nine numbers). What cannot be right is refused here, so that no
later stage has to ask.
"""

import math
import os
from dataclasses import dataclass, replace
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from obst_avoid.core.matrices import inverted
from obst_avoid.core.settings import SettingsError, read_yaml
from obst_avoid.core.types import Array

EXTRINSIC_SIZE = (640, 480)
"""Picture size that the old format's homography speaks of, whatever the intrinsic file says."""

ROBOT_FOLDER = '/data/config/calibrations'
FLEET_VARIABLE = 'DUCKIEFLEET_ROOT'

LARGEST_ROLL = math.radians(6)
FOCAL_LENGTH = (0.2, 3.0)
"""Bounds of f / picture width: fields of view from 136 to 19 degrees; a Duckiebot's lens has 0.5."""
FOCAL_RATIO = (0.8, 1.25)
"""Bounds of fx / fy: camera pixels are square within a few per cent."""
PROJECTION_RATIO = (0.5, 2.0)
"""The same for the rectified picture, which may be stretched: the fleet has 0.8 to 1.0."""
LARGEST_CONDITION = 1e8
"""Of a homography, scaled to a largest entry of 1; the fleet has 1e3 to 3e3. Beyond, the picture maps onto a line."""
CAMERA_HEIGHT = (0.04, 0.30)
"""Bounds in m beyond which a camera's height above the road is worth a warning; the fleet has 0.08 to 0.14."""


class CalibrationError(ValueError):
    """A calibration that must not be used. The message names file, field, value and what was expected."""


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class Calibration:
    """One camera on one robot, for one picture size.

    camera_matrix: (3, 3), K of the picture as it comes. distortion: (5,), plumb_bob.
    rectification, projection: (3, 3), so that a rectified pixel is projection @ rectification @ ray.
    homography: (3, 3), from a rectified pixel (u, v, 1) to the road (x, y, 1) in m, robot frame; scaled so that
    the third coordinate is positive on the road's side of the horizon.
    source: the extrinsic file, for messages. warnings: what looks odd without being wrong.
    """

    vehicle: str
    width: int
    height: int
    camera_matrix: Array
    distortion: Array
    rectification: Array
    projection: Array
    homography: Array
    source: str
    warnings: Tuple[str, ...] = ()


def find_calibration(
    vehicle: str,
    calibration_dir: str = '',
    default_dir: Optional[str] = None,
    environ: Optional[Mapping[str, str]] = None,
) -> Calibration:
    """Load a robot's calibration from the first folder of Duckietown's search order that has it.

    calibration_dir: searched first, '' for none. default_dir: the package's own `default` calibration, used last
    and only when given. environ: where DUCKIEFLEET_ROOT is looked up, os.environ by default.
    Raises CalibrationError when no folder has the robot, or for the first fault found in its files.
    """
    if not vehicle or vehicle != os.path.basename(vehicle) or vehicle.startswith('.'):
        raise CalibrationError('vehicle = %r, expected the plain name of a robot' % vehicle)
    if calibration_dir and not os.path.isdir(calibration_dir):
        raise CalibrationError('calibration_dir = %s, expected an existing folder' % calibration_dir)
    fleet = (os.environ if environ is None else environ).get(FLEET_VARIABLE)
    folders = [calibration_dir] if calibration_dir else []
    folders += [ROBOT_FOLDER] + ([os.path.join(fleet, 'calibrations')] if fleet else [])
    for folder in folders:
        if any(os.path.exists(path) for path in _files(folder, vehicle)):
            return load_calibration(folder, vehicle)
    if default_dir is not None:
        return replace(load_calibration(default_dir, 'default'), vehicle=vehicle)
    raise CalibrationError(
        'no calibration of %s, expected camera_intrinsic/%s.yaml and camera_extrinsic/%s.yaml in one of: %s'
        % (vehicle, vehicle, vehicle, ', '.join(folders))
    )


def load_calibration(folder: str, vehicle: str) -> Calibration:
    """Load and check `<folder>/camera_{intrinsic,extrinsic}/<vehicle>.yaml`. Raises CalibrationError."""
    intrinsic_path, extrinsic_path = _files(folder, vehicle)
    intrinsic, extrinsic = _mapping(intrinsic_path), _mapping(extrinsic_path)
    width, height = _size(intrinsic, 'image_width', intrinsic_path), _size(intrinsic, 'image_height', intrinsic_path)
    model = intrinsic.get('distortion_model', 'plumb_bob')
    if model != 'plumb_bob':
        raise CalibrationError('%s: distortion_model = %r, expected plumb_bob' % (intrinsic_path, model))
    camera_matrix = _matrix(intrinsic, 'camera_matrix', (3, 3), intrinsic_path)
    distortion = _matrix(intrinsic, 'distortion_coefficients', (1, 5), intrinsic_path).ravel()
    rectification = _matrix(intrinsic, 'rectification_matrix', (3, 3), intrinsic_path)
    projection = _matrix(intrinsic, 'projection_matrix', (3, 4), intrinsic_path)[:, :3]
    _check_lens(camera_matrix, 'camera_matrix', width, height, FOCAL_RATIO, intrinsic_path)
    _check_lens(projection, 'projection_matrix', width, height, PROJECTION_RATIO, intrinsic_path)
    if np.linalg.det(rectification) < 0 or np.abs(rectification @ rectification.T - np.eye(3)).max() > 0.01:
        raise CalibrationError(
            '%s: rectification_matrix = %s, expected a rotation' % (intrinsic_path, _short(rectification))
        )
    homography = _homography(extrinsic, projection, width, height, extrinsic_path)
    calibration = Calibration(
        vehicle, width, height, camera_matrix, distortion, rectification, projection, homography, extrinsic_path
    )
    calibration = replace(calibration, homography=_check_view(calibration))
    return replace(calibration, warnings=tuple(_oddities(calibration)))


def scaled(calibration: Calibration, width: int, height: int) -> Calibration:
    """The same camera with pictures of another size and the same aspect, as cv2.resize makes them.

    Raises CalibrationError when the aspect differs: then it is not known what was cut off.
    """
    if (width, height) == (calibration.width, calibration.height):
        return calibration
    sx, sy = width / calibration.width, height / calibration.height
    if abs(sx / sy - 1) > 0.005:
        raise CalibrationError(
            'the picture is %dx%d, expected the aspect of %dx%d as in %s'
            % (width, height, calibration.width, calibration.height, calibration.source)
        )
    resize = _resize(sx, sy)
    return replace(
        calibration,
        width=width,
        height=height,
        camera_matrix=resize @ calibration.camera_matrix,
        projection=resize @ calibration.projection,
        homography=calibration.homography @ inverted(resize),
    )


def extrinsic_content(calibration: Calibration, resolution_independent: bool) -> Dict[str, Any]:
    """What an extrinsic file has to say so that this calibration is read from it, in either of Duckietown's formats."""
    if resolution_independent:
        homography = calibration.homography @ calibration.projection
    else:
        sx, sy = calibration.width / EXTRINSIC_SIZE[0], calibration.height / EXTRINSIC_SIZE[1]
        homography = calibration.homography @ _resize(sx, sy)
    numbers: List[float] = (homography / homography[2, 2]).ravel().tolist()
    content: Dict[str, Any] = {'homography': numbers}
    return {'format': 'resolution-independent', **content} if resolution_independent else content


def horizon_row(homography: Array, u: float) -> float:
    """Row of the horizon in the rectified picture at column u; homography as in Calibration."""
    return float(-(homography[2, 0] * u + homography[2, 2]) / homography[2, 1])


def camera_roll(calibration: Calibration) -> float:
    """[rad] by which the horizon is turned clockwise as the camera sees it."""
    line = calibration.projection.T @ calibration.homography[2]
    return float(-math.atan2(line[0], line[1]))


def camera_from_robot(calibration: Calibration) -> Tuple[Array, Array]:
    """The camera's pose: rotation (3, 3) and translation (3,) [m] so that p_camera = rotation @ p_robot + translation.

    The homography of a plane holds two columns of the rotation and the translation (Zhang 2000); the rotation is
    the nearest to them. The camera frame is the rectified one.
    """
    columns = inverted(calibration.projection) @ inverted(calibration.homography)
    columns = columns / (0.5 * (np.linalg.norm(columns[:, 0]) + np.linalg.norm(columns[:, 1])))
    ahead = calibration.homography @ (calibration.width / 2, calibration.height - 1, 1)
    if (columns @ (ahead / ahead[2]))[2] < 0:
        columns = -columns
    first, second = columns[:, 0], columns[:, 1]
    u, _, vt = np.linalg.svd(np.stack([first, second, np.cross(first, second)], axis=1))
    return u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt, columns[:, 2]


def camera_position(calibration: Calibration) -> Array:
    """(3,) [m] the camera's place in the robot frame."""
    rotation, translation = camera_from_robot(calibration)
    position: Array = -rotation.T @ translation
    return position


def _files(folder: str, vehicle: str) -> Tuple[str, str]:
    return (
        os.path.join(folder, 'camera_intrinsic', vehicle + '.yaml'),
        os.path.join(folder, 'camera_extrinsic', vehicle + '.yaml'),
    )


def _mapping(path: str) -> Mapping[str, Any]:
    try:
        content = read_yaml(path)
    except SettingsError as error:
        raise CalibrationError(str(error)) from error
    if not isinstance(content, Mapping):
        raise CalibrationError('%s is not a mapping, expected the fields of a calibration file' % path)
    return content


def _size(content: Mapping[str, Any], name: str, path: str) -> int:
    value = content.get(name)
    if type(value) is not int or value < 16:
        raise CalibrationError('%s: %s = %r, expected a whole number of pixels >= 16' % (path, name, value))
    return value


def _matrix(content: Mapping[str, Any], name: str, shape: Tuple[int, int], path: str) -> Array:
    """Read numbers row by row, flat or nested, with or without ROS's rows/cols/data around them."""
    value = content.get(name)
    data = value.get('data') if isinstance(value, Mapping) else value
    wanted = '%d numbers' % (shape[0] * shape[1])
    try:
        matrix = np.array(data, dtype=np.float64).reshape(shape)
    except (OverflowError, TypeError, ValueError) as error:
        shown = 'missing' if value is None else '= %s' % _short(data)
        raise CalibrationError('%s: %s %s, expected %s' % (path, name, shown, wanted)) from error
    if not np.isfinite(matrix).all():
        raise CalibrationError('%s: %s = %s, expected %s, all finite' % (path, name, _short(data), wanted))
    return matrix


def _short(value: Any) -> str:
    shown = ' '.join(str(np.round(value, 4).tolist() if isinstance(value, np.ndarray) else value).split())
    return shown if len(shown) <= 80 else shown[:77] + '...'


def _check_lens(matrix: Array, name: str, width: int, height: int, ratio: Sequence[float], path: str) -> None:
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    low, high = FOCAL_LENGTH[0] * width, FOCAL_LENGTH[1] * width
    if not (low <= fx <= high and low <= fy <= high and ratio[0] <= fx / fy <= ratio[1]):
        raise CalibrationError(
            '%s: %s has focal lengths %.0f and %.0f px, expected %.0f to %.0f px for a picture %d px wide, '
            'in a ratio of %g to %g' % (path, name, fx, fy, low, high, width, ratio[0], ratio[1])
        )
    if not (0.2 * width < cx < 0.8 * width and 0.2 * height < cy < 0.8 * height):
        raise CalibrationError(
            '%s: %s has its centre at (%.0f, %.0f), expected it near the middle of a picture of %dx%d'
            % (path, name, cx, cy, width, height)
        )


def _homography(extrinsic: Mapping[str, Any], projection: Array, width: int, height: int, path: str) -> Array:
    """From rectified pixels of a width x height picture to the road, from either of Duckietown's formats."""
    homography = _matrix(extrinsic, 'homography', (3, 3), path)
    if np.linalg.cond(homography / np.abs(homography).max(initial=1e-300)) > LARGEST_CONDITION:
        raise CalibrationError('%s: homography = %s, expected an invertible matrix' % (path, _short(homography)))
    frame = extrinsic.get('frame', 'robot')
    if frame != 'robot':
        raise CalibrationError('%s: frame = %r, expected robot' % (path, frame))
    form = extrinsic.get('format')
    if form == 'resolution-independent':  # maps the rectified ray (x / z, y / z, 1)
        result: Array = homography @ inverted(projection)
        return result
    if form is not None:
        raise CalibrationError(
            '%s: format = %r, expected resolution-independent, or no format for pixels' % (path, form)
        )
    sx, sy = width / EXTRINSIC_SIZE[0], height / EXTRINSIC_SIZE[1]
    if abs(sx / sy - 1) > 0.005:
        raise CalibrationError(
            '%s: homography is for 640x480 pixels, expected an intrinsic calibration of that aspect, not %dx%d'
            % (path, width, height)
        )
    return homography @ inverted(_resize(sx, sy))


def _resize(sx: float, sy: float) -> Array:
    """Pixel coordinates of a resized picture from those of the original; pixel centres are whole numbers."""
    return np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]], dtype=np.float64)


def _check_view(calibration: Calibration) -> Array:
    """Refuse a homography that no camera on a Duckiebot can have; return it with the sign that Calibration asks for."""
    homography, path = calibration.homography, calibration.source
    middle, bottom = (calibration.width - 1) / 2, calibration.height - 1

    def refuse(found: str, expected: str) -> CalibrationError:
        return CalibrationError('%s: homography %s, expected %s' % (path, found, expected))

    homography = homography * np.sign((homography @ (middle, bottom, 1))[2])
    rows = np.linspace(bottom, bottom - 0.2 * calibration.height, 3)
    road = np.stack([homography @ (middle, row, 1) for row in rows])
    if (road[:, 2] <= 0).any():
        raise refuse('has no horizon above row %d at the middle column' % rows[2], 'a camera that looks ahead and down')
    x = road[:, 0] / road[:, 2]
    sides = np.stack([homography @ (column, rows[1], 1) for column in (middle - 1, middle + 1)])
    left, right = sides[:, 1] / sides[:, 2]
    grows, upright = bool((np.diff(x) > 0).all()), bool(left > right)
    span = 'x = %.3f m at the bottom row and %.3f m at row %d' % (x[0], x[2], rows[2])
    if not grows and not upright:
        raise refuse(
            'is upside down, %s, left of the middle y is smaller' % span,
            'x to grow towards the horizon and y to the left',
        )
    if not upright:
        raise refuse(
            'is mirrored, y = %.4f m left of the middle and %.4f m right of it' % (left, right), 'y to grow to the left'
        )
    if not grows:
        raise refuse('sees the road from below, %s' % span, 'a camera above the road, x to grow towards the horizon')
    if homography[2, 1] <= 0:
        raise refuse('has no horizon above row %d at the middle column' % rows[2], 'a camera that looks ahead and down')
    roll = camera_roll(replace(calibration, homography=homography))
    if abs(roll) > LARGEST_ROLL:
        raise refuse(
            'has the camera rolled by %.1f degrees' % math.degrees(roll), 'at most %.0f' % math.degrees(LARGEST_ROLL)
        )
    if not -0.2 < x[0] < 1.0:
        raise refuse('has %s' % span, 'the road shortly before the robot at the bottom row')
    return homography


def _oddities(calibration: Calibration) -> List[str]:
    odd = []
    path = calibration.source
    height = camera_position(calibration)[2]
    if not CAMERA_HEIGHT[0] <= height <= CAMERA_HEIGHT[1]:
        odd.append(
            '%s: homography puts the camera %.3f m above the road, expected %g to %g m'
            % ((path, height) + CAMERA_HEIGHT)
        )
    columns = inverted(calibration.projection) @ inverted(calibration.homography)
    first, second = np.linalg.norm(columns[:, 0]), np.linalg.norm(columns[:, 1])
    if not 0.8 <= first / second <= 1.25:
        odd.append('%s: homography stretches x by %.2f against y, expected about 1' % (path, first / second))
    roll = math.degrees(camera_roll(calibration))
    if abs(roll) > 3:
        odd.append('%s: homography has the camera rolled by %.1f degrees, expected less than 3' % (path, roll))
    return odd
