"""What all command-line tools share: their settings, their errors, their exit codes.

Exit code 0: success. 1: failure, one sentence on stderr. 2: wrong use, from argparse.
"""

import argparse
import contextlib
import json
import os
import re
import sys
from decimal import Decimal
from typing import Any, Callable, Dict, Iterable, Iterator, List, Optional, Sequence, TypeVar

import cv2
import rospkg
from tqdm import tqdm

from obst_avoid.core.age import NANOSECONDS
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.calibration import Calibration, CalibrationError, find_calibration, load_calibration
from obst_avoid.core.detection.settings import PROFILES, DetectionSettings
from obst_avoid.core.lane_control import LaneControlSettings
from obst_avoid.core.settings import SettingsError, load, read_yaml
from obst_avoid.core.types import Array

T = TypeVar('T')

PICTURE_ENDINGS = ('.jpg', '.jpeg', '.png')


class ToolError(RuntimeError):
    """A tool cannot do what was asked. The message is one sentence for a person."""


def run(main: Callable[[argparse.Namespace], int], parser: argparse.ArgumentParser, arguments: Any = None) -> int:
    """Parse and run; expected errors become one sentence on stderr and exit code 1."""
    options = parser.parse_args(arguments)
    try:
        return main(options)
    except (ToolError, SettingsError, CalibrationError) as error:
        print('%s: %s' % (parser.prog, error), file=sys.stderr)
    except OSError as error:
        print('%s: %s' % (parser.prog, why_os(error)), file=sys.stderr)
    except KeyboardInterrupt:
        print('%s: interrupted' % parser.prog, file=sys.stderr)
    return 1


def why_os(error: OSError) -> str:
    """What the system refused, and for which file if it says so."""
    return ': '.join(str(part) for part in (error.filename, error.strerror or error) if part)


def rate(value: str) -> float:
    """Argument type: pictures a second, 0.001 to 1000."""
    number = float(value)
    if not 0.001 <= number <= 1000:
        raise argparse.ArgumentTypeError('%s, expected 0.001 to 1000 (pictures a second)' % value)
    return number


def count(value: str) -> int:
    """Argument type: a whole number >= 1."""
    number = int(value)
    if number < 1:
        raise argparse.ArgumentTypeError('%s, expected a whole number >= 1' % value)
    return number


def seed(value: str) -> int:
    """Argument type: a whole number from 0 on."""
    number = int(value)
    if not 0 <= number < 1 << 31:
        raise argparse.ArgumentTypeError('%s, expected a whole number from 0 to 2147483647' % value)
    return number


def new_file(path: str) -> str:
    """Check before the work that a file can be written after it, and that nothing is lost by it."""
    if os.path.exists(path):
        raise ToolError('%s exists, expected a new file' % path)
    return writable(path)


def writable(path: str) -> str:
    """Check before the work that a file can be written after it."""
    folder = os.path.dirname(os.path.abspath(path))
    if os.path.isdir(path) or not os.path.isdir(folder):
        raise ToolError('%s cannot be written, expected a file in an existing folder' % path)
    return path


@contextlib.contextmanager
def whole(path: str) -> Iterator[str]:
    """The name under which to write a file that gets its own when it is whole; a disk may be full."""
    if os.path.exists(path) and not os.path.isfile(path):  # /dev/stdout for example
        yield path
        return
    path = os.path.realpath(path)  # a link goes on leading there
    part = '%s.%d.part' % (path, os.getpid())
    try:
        yield part
        os.replace(part, path)
    finally:
        if os.path.exists(part):
            os.remove(part)


def write_json(path: str, content: Any, indent: Optional[int] = 1) -> None:
    """A file of JSON. Raises OSError."""
    with whole(path) as part, open(part, 'w', encoding='utf-8') as file:
        json.dump(content, file, indent=indent, allow_nan=False)


def write_picture(path: str, picture: Array) -> None:
    """A file of the format that its ending names. Raises OSError, where cv2.imwrite would only return False."""
    data = cv2.imencode(os.path.splitext(path)[1], picture)[1].tobytes()
    with whole(path) as part, open(part, 'wb') as file:
        file.write(data)


def add_calibration_arguments(parser: argparse.ArgumentParser) -> None:
    """--calibration and --vehicle, the same in every tool."""
    parser.add_argument(
        '--calibration', metavar='DIR', default='', help='folder with camera_intrinsic/ and camera_extrinsic/'
    )
    parser.add_argument('--vehicle', metavar='NAME', default='', help='robot whose calibration is used')
    parser.add_argument('--config', metavar='DIR', default='', help="folder of settings (default: the package's own)")
    parser.add_argument('--profile', choices=PROFILES, help='detector, instead of the one that the settings name')


def default_calibration() -> Calibration:
    """The package's own made-up camera."""
    return load_calibration(os.path.join(package_folder(), 'config/calibrations'), 'default')


def calibration_of(options: argparse.Namespace) -> Calibration:
    """The calibration that the options name; without any, the package's default one."""
    if not options.calibration and not options.vehicle:
        calibration = default_calibration()
        print('no --calibration given: using the default one, positions are rough', file=sys.stderr)
    elif not options.vehicle:
        raise ToolError('--vehicle is missing, expected the name of a robot in %s' % options.calibration)
    else:
        calibration = find_calibration(options.vehicle, options.calibration)
    for warning in calibration.warnings:
        print('warning: %s' % warning, file=sys.stderr)
    return calibration


def detection_settings(options: argparse.Namespace) -> DetectionSettings:
    """The detector's settings as its node would get them."""
    content: Dict[str, Any] = {}
    for name in ('obstacle_detection_node.yaml', 'bird_view.yaml'):
        content.update(node_yaml(options.config, name))
    if options.profile:
        content['profile'] = options.profile
    return load(DetectionSettings, content, 'obstacle_detection_node')


def avoidance_settings(config: str, stage: Optional[str]) -> AvoidanceSettings:
    """The avoider's settings of the given folder or the package's own, with another stage if one is given."""
    content = {**node_yaml(config, 'obstacle_avoidance_node.yaml'), **node_yaml(config, 'lane_estimate.yaml')}
    if stage:
        content['stage'] = stage
    return load(AvoidanceSettings, content, 'obstacle_avoidance_node')


def lane_control_settings(config: str) -> LaneControlSettings:
    """The lane controller's, the same."""
    content = {**node_yaml(config, 'lane_controller_node.yaml'), **node_yaml(config, 'lane_estimate.yaml')}
    return load(LaneControlSettings, content, 'lane_controller_node')


def node_yaml(config: str, name: str) -> Dict[str, Any]:
    """One settings file, from the given folder or the package's own."""
    path = settings_file(config, name)
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise SettingsError('%s is not a mapping, expected settings' % path)
    return content


def settings_file(config: str, name: str) -> str:
    """Where a settings file lies: in the given folder, or among the package's own."""
    return os.path.join(config or os.path.join(package_folder(), 'config'), name)


def package_folder() -> str:
    """Where config/ and launch/ lie."""
    return str(rospkg.RosPack().get_path('obst_avoid'))


def in_order(names: Iterable[str]) -> List[str]:
    """Sorted as people count: picture_2 before picture_10, 9_5.jpg before 10_0.jpg, and 10.25.jpg before 10.5.jpg: a
    name that is a decimal number is one.
    """

    def counted(name: str) -> Any:
        parts = re.split(r'(^[0-9]+\.[0-9]+(?=\.[A-Za-z]+$)|[0-9]+)', name)  # every second one is a number
        return [Decimal(part) if index % 2 else part for index, part in enumerate(parts)], name

    return sorted(names, key=counted)


def picture_files(paths: Sequence[str]) -> List[str]:
    """The picture files among files and folders, in order; a file that was named is taken whatever its ending."""
    files: List[str] = []
    for path in paths:
        if os.path.isdir(path):
            inside = in_order(name for name in os.listdir(path) if name.lower().endswith(PICTURE_ENDINGS))
            files += [os.path.join(path, name) for name in inside]
        elif os.path.exists(path):
            files.append(path)
        else:
            raise ToolError('%s does not exist, expected a picture or a folder of pictures' % path)
    if not files:
        raise ToolError(
            'no picture in %s, expected files that end in %s' % (', '.join(paths), ', '.join(PICTURE_ENDINGS))
        )
    return files


def short_names(files: List[str]) -> Dict[str, str]:
    """Short names: the file's own, and as much of its path as tells it from the others."""
    plain = [os.path.basename(path) for path in files]
    if len(set(plain)) == len(plain):
        return dict(zip(files, plain))
    root = os.path.commonpath([os.path.dirname(os.path.abspath(path)) for path in files])
    return {path: os.path.relpath(os.path.abspath(path), root) for path in files}


def progress(items: Iterable[T], words: str, total: Any = None) -> Iterable[T]:
    """Show a progress bar on a terminal."""
    bar: Iterable[T] = tqdm(items, desc=words, total=total, disable=None, leave=False)
    return bar


def stamp_of_frame(index: int, rate: float) -> int:
    """[ns] of the index-th picture of a folder, from 1 s on: stamp 0 means "no picture yet"."""
    return NANOSECONDS + round(index * NANOSECONDS / rate)
