"""check_calibration: whether a robot's calibration files fit what its camera sees of a lane."""

import argparse
import math
import os
import shutil
import sys
import time
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import rosgraph
import rospy
import yaml
from sensor_msgs.msg import CompressedImage, Image

from obst_avoid.core.calibration import (
    Calibration,
    CalibrationError,
    extrinsic_content,
    find_calibration,
    load_calibration,
    scaled,
)
from obst_avoid.core.picture import PictureError
from obst_avoid.core.settings import read_yaml
from obst_avoid.core.types import Array, Command
from obst_avoid.offline import tool
from obst_avoid.offline.calibration.fit import Fit, yaw_from_motion
from obst_avoid.offline.calibration.judge import UNCLEAR, Check, examine, judge
from obst_avoid.offline.calibration.picture import draw, table_rows
from obst_avoid.offline.evaluation.recordings import Odometry, Pose, driven, told
from obst_avoid.offline.pictures import read_picture
from obst_avoid.offline.recording import CAR_CMD, JPEG, RAW, TOPICS, Recorded, Recording, messages, open_bag, picture_of
from obst_avoid.ros import border

STEP = 0.12
"""[m] of road between two pictures of a drive: nearer ones show the same paint."""
PAUSE = 0.4
"""[s] between two pictures of a recording that does not say how the robot moved, and of a live camera."""
BLOCK = 6
"""Pictures of a drive that are taken one after the other, since the yaw needs neighbours."""
ALIGNED = math.radians(1.0)
"""[rad] standard deviation of a robot that a person put parallel to the lane."""
PATIENCE = 5.0
"""[s] of wall time without a picture after which a live camera is given up."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture of the lane. time: [s] and driven: [m] since the recording's begin; None where nobody knows."""

    name: str
    picture: Array
    time: Optional[float] = None
    driven: Optional[float] = None


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='check_calibration',
        description='Say whether calibration files fit what the camera sees of a lane, and by how much they are off. '
        'Take 5 to 30 pictures from within a lane, with both lines in view, straight ahead and turned a little. '
        'Exit code 0: they fit, or they do not; 1: it cannot be told, or something failed.',
    )
    parser.add_argument('--vehicle', metavar='NAME', required=True, help='robot whose calibration is checked')
    parser.add_argument(
        '--calibration', metavar='DIR', default='', help='folder with camera_intrinsic/ and camera_extrinsic/'
    )
    parser.add_argument(
        '--pictures', metavar='N', type=tool.count, default=30, help='pictures to look at, at most (default: 30)'
    )
    parser.add_argument('--aligned', action='store_true', help='the robot stood parallel to a straight lane: check yaw')
    parser.add_argument('--live', action='store_true', help='take the pictures from the running robot')
    parser.add_argument('--robot', metavar='NAME', default='', help='whose pictures are taken, if a bag has several')
    parser.add_argument(
        '--output', metavar='DIR',
        help='write check.png and check.json there, and corrected calibration files where the evidence suffices',
    )  # fmt: skip
    parser.add_argument('paths', metavar='PATH', nargs='*', help='pictures, folders of pictures, bags')
    options = parser.parse_args(arguments)
    if bool(options.paths) == options.live:
        parser.error('expected either pictures, folders or bags, or --live')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    calibration = find_calibration(options.vehicle, options.calibration)
    for warning in calibration.warnings:
        print('warning: %s' % warning, file=sys.stderr)
    if options.output:
        _prepare_output(options.output, calibration)
    broken: List[str] = []
    shots = _live(options, broken.append) if options.live else _recorded(options, broken.append)
    for sentence in broken:
        print('check_calibration: %s' % sentence, file=sys.stderr)
    if not shots:
        raise tool.ToolError('no picture could be used, expected at least one')
    size = shots[0].picture.shape[1], shots[0].picture.shape[0]
    fitting = scaled(calibration, *size)
    pictures = [shot.picture for shot in shots]
    fitted, lines = examine(fitting, pictures)
    check = judge(fitting, fitted, lines or ((),) * len(shots), _yaw(fitted, shots, options.aligned))
    _say(check, calibration, size, len(shots))
    if options.output:
        draw(check, fitting, pictures, [shot.name for shot in shots], os.path.join(options.output, 'check.png'))
        content = content_of(check, calibration, size, [shot.name for shot in shots], broken)
        tool.write_json(os.path.join(options.output, 'check.json'), content)
        print(os.path.join(options.output, 'check.png'))
        if check.corrected is not None:
            _write_corrected(check, calibration, options.output, len(shots))
    return 1 if check.verdict == UNCLEAR else 0


def content_of(
    check: Check, calibration: Calibration, size: Tuple[int, int], names: Sequence[str], broken: Sequence[str]
) -> Dict[str, Any]:
    """The answer for JSON."""
    content: Dict[str, Any] = {
        'vehicle': calibration.vehicle,
        'source': calibration.source,
        'verdict': check.verdict,
        'reasons': list(check.reasons),
        'pictures': list(names),
        'broken': list(broken),
        'picture_size': {'file': [calibration.width, calibration.height], 'seen': list(size)},
        'quantities': [
            {
                'name': item.name, 'unit': item.unit, 'file': round(item.file, 5), 'seen': round(item.seen, 5),
                'difference': round(item.seen - item.file, 5), 'ci95': round(1.96 * item.spread, 5),
                'tolerance': round(item.tolerance, 5), 'verdict': item.verdict,
            }
            for item in check.quantities
        ],
        'obstacles': [
            {
                'distance': distance, 'reported_too_far_by': round(dx, 4), 'reported_too_far_left_by': round(dy, 4),
                'ci95': [round(1.96 * spread_x, 4), round(1.96 * spread_y, 4)],
            }
            for distance, dx, dy, spread_x, spread_y in check.obstacles
        ],
    }  # fmt: skip
    if check.fit is not None:
        fit = check.fit
        content['lines'] = {
            'pictures_with_lines': len(fit.pictures), 'white': fit.tapes[0], 'yellow': fit.tapes[1],
            'edge_points': len(fit.edges.pixels), 'apart_px': round(fit.noise, 3),
            'lane_width': [round(value, 4) for value in fit.lane],
        }  # fmt: skip
    if check.corrected is not None:
        content['corrected_homography'] = extrinsic_content(check.corrected, False)['homography']
    return content


def _say(check: Check, calibration: Calibration, size: Tuple[int, int], count: int) -> None:
    verdict = UNCLEAR if check.verdict == UNCLEAR else 'the calibration %s' % check.verdict
    print('%s: %s' % (calibration.vehicle, verdict))
    for reason in check.reasons:
        print('  %s' % reason)
    if check.verdict == UNCLEAR:
        print('  expected: pictures from within a lane, both lines in view, a few of them turned by 5 to 15 degrees')
    seen = 'lines in %d of %d pictures' % (len(check.fit.pictures) if check.fit else 0, count)
    print('  %s; pictures are %dx%d, the file is for %dx%d' % (seen, *size, calibration.width, calibration.height))
    if check.quantities:
        print('  %-22s %13s %13s %11s  %s' % ('', 'by the file', 'by the lines', '+- (95 %)', 'verdict'))
        for *cells, verdict, _ in table_rows(check):
            print('  %-22s %13s %13s %11s  %s' % (*cells, verdict))
    for distance, dx, dy, spread_x, spread_y in check.obstacles:
        print(
            '  an obstacle %.1f m straight ahead is reported %.0f cm too %s (+-%.0f) and %.0f cm too far %s (+-%.0f)'
            % (
                distance, abs(100 * dx), 'far' if dx > 0 else 'near', 196 * spread_x,
                abs(100 * dy), 'left' if dy > 0 else 'right', 196 * spread_y,
            )
        )  # fmt: skip


def _prepare_output(folder: str, calibration: Calibration) -> None:
    """Nothing that exists is written over, least of all the calibration under test. Said before the work."""
    os.makedirs(folder, exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise tool.ToolError('%s cannot be written, expected a folder for the results' % folder)
    for name in ('check.png', 'check.json', *_corrected_files(calibration.vehicle)):
        path = os.path.join(folder, name)
        if os.path.exists(path):
            raise tool.ToolError('%s exists, expected a new folder' % path)


def _corrected_files(vehicle: str) -> Tuple[str, str]:
    name = vehicle + '.yaml'
    return os.path.join('camera_intrinsic', name), os.path.join('camera_extrinsic', name)


def _write_corrected(check: Check, calibration: Calibration, output: str, count: int) -> None:
    """The intrinsic file as it is, and an extrinsic file with the homography that fits; both are loaded once more."""
    assert check.corrected is not None and check.fit is not None
    intrinsic, extrinsic = _corrected_files(calibration.vehicle)
    folder = os.path.dirname(os.path.dirname(calibration.source))
    for name in (intrinsic, extrinsic):
        os.makedirs(os.path.dirname(os.path.join(output, name)), exist_ok=True)
    shutil.copyfile(os.path.join(folder, intrinsic), os.path.join(output, intrinsic))
    independent = read_yaml(os.path.join(folder, extrinsic)).get('format') == 'resolution-independent'
    content = extrinsic_content(scaled(check.corrected, calibration.width, calibration.height), independent)
    path = os.path.join(output, extrinsic)
    with open(path, 'w', encoding='utf-8') as file:
        file.write(
            '# Corrected by check_calibration from the lane lines of %d pictures; was: %s\n'
            % (count, calibration.source)
        )
        yaml.safe_dump(content, file, default_flow_style=None)
    try:
        load_calibration(output, calibration.vehicle)
    except CalibrationError as error:
        os.remove(path)
        print('check_calibration: no corrected file: %s' % error, file=sys.stderr)
        return
    print('corrected, to be used with --calibration %s: %s' % (output, path))


def _yaw(fitted: Optional[Fit], shots: Sequence[Shot], aligned: bool) -> Optional[Tuple[float, float]]:
    """[rad] that the camera looks further left than its file says, and the spread; None where nothing tells it."""
    if fitted is None:
        return None
    if aligned:
        weights = 1 / fitted.heading_spread**2
        spread = math.hypot(1 / math.sqrt(weights.sum()), ALIGNED)  # the person's error is the same in all pictures
        return float((fitted.headings * weights).sum() / weights.sum()), spread
    if any(shot.driven is None for shot in shots):
        return None
    return yaw_from_motion(fitted, [shot.time or 0.0 for shot in shots], [shot.driven or 0.0 for shot in shots])


def _recorded(options: argparse.Namespace, complain: Callable[[str], None]) -> List[Shot]:
    """Pictures of files, folders and bags, as evenly as the number allows."""
    bags = [path for path in options.paths if path.endswith('.bag')]
    files = [path for path in options.paths if path not in bags]
    most = max(1, options.pictures // (len(bags) + bool(files)))
    shots = [shot for path in bags for shot in _of_bag(path, options.robot, most, complain)]
    chosen = _evenly(tool.picture_files(files), most) if files else []
    read = [_of_file(path, complain) for path in tool.progress(chosen, 'reading')]
    return _of_one_size(shots + [shot for shot in read if shot is not None], complain)


def _of_file(path: str, complain: Callable[[str], None]) -> Optional[Shot]:
    try:
        return Shot(os.path.basename(path), read_picture(path))
    except PictureError as error:
        complain(str(error))
    except OSError as error:
        complain(tool.why_os(error))
    return None


def _of_bag(path: str, robot: str, most: int, complain: Callable[[str], None]) -> List[Shot]:
    """Pictures of a drive, each a piece of road farther than the one before; several blocks of neighbours."""
    try:
        recording = open_bag(path, robot)
        chosen, moving = _chosen_of(recording, most)
        return _read(recording, chosen, moving, complain)
    except tool.ToolError as error:
        complain(str(error))
    return []


def _chosen_of(recording: Recording, most: int) -> Tuple[Dict[int, Tuple[float, float]], bool]:
    """Time [s] and way [m] of the pictures that are taken, by number, and whether the way is known."""
    moving = CAR_CMD in recording.motion
    candidates: List[Tuple[int, float, float]] = []
    begin, way, index = None, 0.0, 0
    odometry: Optional[Odometry] = None
    for item in messages(recording, True):
        begin = item.time if begin is None else begin
        if item.role == CAR_CMD:
            odometry = told(odometry, _command(item.msg), item.time)
        elif item.role in (JPEG, RAW):
            now = (item.time - begin) / 1e9
            last = candidates[-1] if candidates else None
            if odometry is not None:
                odometry = driven(odometry, item.time)
                way += math.hypot(odometry.pose.x, odometry.pose.y)
                odometry = replace(odometry, pose=Pose())
            if last is None or (way - last[2] >= STEP if moving else now - last[1] >= PAUSE):
                candidates.append((index, now, way))
            index += 1
    blocks = [candidates[at : at + BLOCK] for at in range(0, len(candidates), BLOCK)]
    taken = _evenly(blocks, max(1, most // BLOCK))
    return {number: (now, way) for block in taken for number, now, way in block[:most]}, moving


def _read(
    recording: Recording, chosen: Dict[int, Tuple[float, float]], moving: bool, complain: Callable[[str], None]
) -> List[Shot]:
    shots = []
    name = os.path.basename(recording.path)
    pictures = (item for item in messages(recording) if item.role in (JPEG, RAW))
    for index, item in enumerate(tool.progress(pictures, 'reading', recording.pictures)):
        if index not in chosen:
            continue
        now, way = chosen[index]
        try:
            picture = picture_of(item)
        except PictureError as error:
            complain('%s, picture %d: %s' % (recording.path, index, error))
            continue
        shots.append(Shot('%s, picture %d' % (name, index), picture, now, way if moving else None))
    return shots


def _command(msg: Any) -> Command:
    """What the robot was told; nothing, when the message is broken."""
    try:
        return border.command_from_msg(msg)
    except border.BorderError:
        return Command(0.0, 0.0)


def _live(options: argparse.Namespace, complain: Callable[[str], None]) -> List[Shot]:
    """Pictures of the running robot, PAUSE apart; compressed ones where there are any."""
    if not rosgraph.is_master_online():  # init_node would wait for it for ever
        raise tool.ToolError('no ROS master at %s, expected a running robot' % rosgraph.get_master_uri())
    rospy.init_node('check_calibration', anonymous=True, disable_signals=True)
    topics = {role: '/%s/%s' % (options.vehicle, TOPICS[role]) for role in (RAW, JPEG)}
    published = [name for name, _ in rospy.get_published_topics()]
    role = RAW if topics[RAW] in published and topics[JPEG] not in published else JPEG
    topic = topics[role]
    shots: List[Shot] = []
    for number in tool.progress(range(options.pictures), 'taking pictures'):
        try:
            msg = rospy.wait_for_message(topic, Image if role == RAW else CompressedImage, PATIENCE)
            shots.append(Shot('%s, picture %d' % (topic, number), picture_of(Recorded(role, 0, msg))))
        except rospy.ROSException:
            complain('no picture on %s for %.0f s' % (topic, PATIENCE))
            break
        except PictureError as error:
            complain('%s: %s' % (topic, error))
        time.sleep(PAUSE)
    return _of_one_size(shots, complain)


def _of_one_size(shots: Sequence[Shot], complain: Callable[[str], None]) -> List[Shot]:
    """Those of the commonest size; one camera has one."""
    if not shots:
        return []
    wanted = Counter(shot.picture.shape for shot in shots).most_common(1)[0][0]
    kept = [shot for shot in shots if shot.picture.shape == wanted]
    for shot in shots:
        if shot.picture.shape != wanted:
            height, width = shot.picture.shape[:2]
            complain(
                '%s: %dx%d, expected %dx%d as in %s' % (shot.name, width, height, wanted[1], wanted[0], kept[0].name)
            )
    return kept


def _evenly(items: Sequence[Any], most: int) -> List[Any]:
    """At most so many, evenly spread, in order."""
    if len(items) <= most:
        return list(items)
    return [items[int(number * len(items) / most)] for number in range(most)]
