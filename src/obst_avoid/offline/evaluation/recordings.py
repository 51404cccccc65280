"""Label-free checks: what can be said of a detector by recordings alone.

A recording, bag or folder, goes through a detector as a sequence. Counted are detections per picture and per metre,
flicker (found, lost, found again), and, of a recording that is declared empty, false alarms. Contact sheets show
everything that was found. Memory does not grow with the recording.
"""

import math
import os
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

import cv2

from obst_avoid.core import detection
from obst_avoid.core.age import age
from obst_avoid.core.calibration import CalibrationError
from obst_avoid.core.motion import LONGEST_HOLD, chord, remembered
from obst_avoid.core.picture import PictureError
from obst_avoid.core.types import Array, Box, Command, Obstacle, Stamped
from obst_avoid.offline.evaluation.figures import milliseconds, share
from obst_avoid.offline.evaluation.tally import Tally, count_value
from obst_avoid.offline.recording import CAR_CMD, JPEG, RAW, TRUE_POSE, Recording, messages, picture_of
from obst_avoid.ros import border
from obst_avoid.viz.overlay import FONT, INSIDE, OUTSIDE, SHADE, TEXT, UNKNOWN, contact_sheet

MEMORY = 1.0
"""[s] after which what was lost counts as gone: at 0.2 m/s a thing a good arm's length ahead is then beside the robot
or about to be, and what stands there may be another.
"""
GATE = 0.05
"""[m] how far from where it should be a thing is still the same one: two duckies side by side are farther apart."""
GATE_SHARE = 0.1
"""Of the distance, on top of GATE: a body that nods by 1 degree moves a thing 0.6 m ahead by 6 cm."""
COMMAND_ERROR = 0.1
"""[m/s] by which the gate grows while a thing is lost, motion known: half the cruising speed, since the wheels of an
uncalibrated robot do only roughly as they are told.
"""
UNKNOWN_SPEED = 0.4
"""[m/s] the same where nobody says how the robot moved: the fastest Duckiebots, or a turn of 1 rad/s at 0.4 m."""
LEAST_METRES = 0.1
"""[m] below which "per metre" says nothing: the robot stood."""
KEPT_SENTENCES = 100
"""Of broken pictures, a recording."""
COLUMNS, ROWS = 8, 6
"""Of tiles on a contact sheet."""
TILE = (176, 132)
"""[px] width, height: a stamp of 20 digits fits above."""
CAPTION = 18
"""[px] height of the line under a tile."""
MARGIN = 0.75
"""Of a box's longer side, around it, so that one sees what it is part of."""
MOST_SHEETS = 400
"""Of a recording, 19200 tiles, about 100 MB: nobody looks at more, and the disk stays free. What is more is counted."""
SHEET_QUALITY = 85


@dataclass(frozen=True)
class Pose:
    """Where the robot is, in a frame that stands still. x, y: [m]. heading: [rad]."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0


@dataclass(frozen=True)
class Odometry:
    """Where the robot should be by what it was told. time: [ns] of pose. told: [ns] when it was told the command."""

    pose: Pose
    command: Command
    time: int
    told: int


@dataclass(frozen=True)
class Sighting:
    """One detection. kind: duckie, cone, or unknown. x, y: [m] robot frame, nearest point."""

    kind: str
    x: float
    y: float


@dataclass(frozen=True)
class Seen:
    """What was found in one picture. stamp: [ns]. step: where the robot is now, seen from where it was at the picture
    before; None: not known.
    """

    stamp: int
    sightings: Tuple[Sighting, ...]
    step: Optional[Pose] = None


@dataclass(frozen=True)
class Track:
    """A thing over several pictures.

    sighting: the last one, moved to where it should be now. stamp: [ns] of it. seen: pictures with it.
    missing: pictures without it since then. missed: pictures without it between two sightings. gaps: how often lost
    and found again. changes: how often its kind changed.
    """

    sighting: Sighting
    stamp: int
    seen: int = 1
    missing: int = 0
    missed: int = 0
    gaps: int = 0
    changes: int = 0


@dataclass(frozen=True)
class Flicker:
    """How steadily things were found.

    tracks: things followed. flashes: of them seen in one picture only, and not in the next. gaps: lost, and found
    again within MEMORY near the place where they should be. missed: pictures in which a thing was missing between its
    first and its last sighting. between: all pictures between them. changes: of kind. judged: tracks without those
    that began in the last picture.
    """

    tracks: int = 0
    judged: int = 0
    flashes: int = 0
    gaps: int = 0
    missed: int = 0
    between: int = 0
    changes: int = 0


@dataclass(frozen=True)
class RecordingChecked:
    """The counts of one recording.

    pictures: looked at. broken: not usable, and why (the first KEPT_SENTENCES). seconds: from the first picture to
    the last. metres: driven, by metres_from (truth, commands); None: not known. found: detections by kind and side
    (inside, outside, unknown: of the lane). with_any: pictures with detections. longest_run: of pictures in a row with
    detections, and the first and last one's name. milliseconds: a tally of the time a picture takes. sheets: file
    names. unshown: detections on no sheet, because there are too many.
    """

    path: str
    pictures: int
    broken: int
    why_broken: List[str]
    seconds: float
    metres: Optional[float]
    metres_from: Optional[str]
    found: Dict[str, Dict[str, int]]
    with_any: int
    longest_run: int
    longest_from: str
    longest_to: str
    flicker: Flicker
    milliseconds: Dict[str, int]
    sheets: List[str]
    unshown: int


def check(
    recording: Recording,
    detector: detection.Detector,
    complain: Callable[[str], None],
    sheets: str = '',
    prefix: str = '',
) -> RecordingChecked:
    """Run a recording through a detector, as a sequence, and count.

    complain: gets one sentence for each picture or message that is skipped. sheets: existing folder for the contact
    sheets, '' for none; prefix: begins their names, as <prefix>_001.jpg.
    Raises ToolError when a bag is damaged, OSError when a sheet cannot be written.
    """
    counts = _Counts()
    tiles = Sheets(sheets, prefix)
    flickered = flicker(_looked_at(recording, detector, complain, counts, tiles))
    tiles.close()
    return RecordingChecked(
        path=recording.path,
        pictures=counts.pictures,
        broken=counts.broken,
        why_broken=counts.why_broken,
        seconds=round((counts.last - counts.first) / 1e9, 3),
        metres=round(counts.metres, 3) if recording.motion else None,
        metres_from=_metres_from(recording),
        found={kind: dict(sorted(sides.items())) for kind, sides in sorted(counts.found.items())},
        with_any=counts.with_any,
        longest_run=counts.longest[0],
        longest_from=counts.longest[1],
        longest_to=counts.longest[2],
        flicker=flickered,
        milliseconds=dict(counts.milliseconds),
        sheets=tiles.names,
        unshown=tiles.unshown,
    )


def from_json(content: Mapping[str, Any]) -> RecordingChecked:
    """The inverse of dataclasses.asdict."""
    return RecordingChecked(**dict(content, flicker=Flicker(**content['flicker'])))


@dataclass
class _Counts:
    """What is counted while the pictures pass. Times in ns. run: of pictures with detections, and the first's name."""

    pictures: int = 0
    broken: int = 0
    why_broken: List[str] = field(default_factory=list)
    first: int = 0
    last: int = 0
    metres: float = 0.0
    found: Dict[str, Dict[str, int]] = field(default_factory=dict)
    with_any: int = 0
    run: Tuple[int, str] = (0, '')
    longest: Tuple[int, str, str] = (0, '', '')
    milliseconds: Tally = field(default_factory=Tally)  # type: ignore[type-arg]

    def take(self, name: str, now: int, obstacles: Sequence[Obstacle], seconds: float) -> None:
        """Count one picture."""
        self.first = self.first if self.pictures else now
        self.last = now
        self.pictures += 1
        count_value(self.milliseconds, 'milliseconds', 1e3 * seconds)
        _add(self.found, Counter((_kind(obstacle), _side(obstacle)) for obstacle in obstacles))
        self.with_any += bool(obstacles)
        self.run = (self.run[0] + 1, self.run[1] or name) if obstacles else (0, '')
        if self.run[0] > self.longest[0]:
            self.longest = (*self.run, name)


def _looked_at(
    recording: Recording,
    detector: detection.Detector,
    complain: Callable[[str], None],
    counts: _Counts,
    tiles: 'Sheets',
) -> Iterator[Seen]:
    """The pictures one by one, counted and cut out by the way."""
    odometry: Optional[Odometry] = None
    true_pose: Optional[Pose] = None
    before: Optional[Pose] = None
    commands: Tuple[Stamped[Command], ...] = ()
    for item in messages(recording, motion=True):
        if item.role == CAR_CMD:
            try:
                command = border.command_from_msg(item.msg)
                odometry = told(odometry, command, item.time)
                commands = remembered(commands, Stamped(item.time, command))
            except border.BorderError as error:
                complain('%.3f s: %s' % (item.time / 1e9, error))
        elif item.role == TRUE_POSE:
            true_pose = _pose_from_msg(item.msg)
        if item.role not in (JPEG, RAW):
            continue
        stamp = border.nanoseconds(item.msg.header.stamp)
        name = item.msg.header.frame_id if recording.files else '%d_%09d.jpg' % (stamp // 10**9, stamp % 10**9)
        begin = time.perf_counter()
        try:
            picture = picture_of(item)
            scene, detector = detection.detect(detector, picture, stamp, commands)
        except (PictureError, CalibrationError) as error:
            counts.broken += 1
            sentence = '%s: %s' % (name, error)
            complain(sentence)
            counts.why_broken += [sentence] if len(counts.why_broken) < KEPT_SENTENCES else []
            continue
        counts.take(name, item.time, scene.obstacles, time.perf_counter() - begin)
        for obstacle in scene.obstacles:
            tiles.take(name, picture, obstacle)
        odometry = None if odometry is None else driven(odometry, item.time)
        now = true_pose if TRUE_POSE in recording.motion else None if odometry is None else odometry.pose
        step = None if now is None or before is None else relative(before, now)
        before = now
        counts.metres += 0.0 if step is None else math.hypot(step.x, step.y)
        yield Seen(stamp, tuple(Sighting(_kind(found), found.x, found.y) for found in scene.obstacles), step)


def _metres_from(recording: Recording) -> Optional[str]:
    if TRUE_POSE in recording.motion:
        return 'truth'
    return 'commands' if CAR_CMD in recording.motion else None


def _pose_from_msg(msg: Any) -> Pose:
    turn = msg.pose.orientation
    return Pose(msg.pose.position.x, msg.pose.position.y, 2 * math.atan2(turn.z, turn.w))


def _kind(obstacle: Obstacle) -> str:
    return 'unknown' if obstacle.kind is None else obstacle.kind.value


def _side(obstacle: Obstacle) -> str:
    return 'unknown' if obstacle.in_lane is None else 'inside' if obstacle.in_lane else 'outside'


def told(odometry: Optional[Odometry], command: Command, now: int) -> Odometry:
    """Take a command that comes at a time [ns]. odometry: None before the first."""
    pose = Pose() if odometry is None else driven(odometry, now).pose
    return Odometry(pose, command, now, now)


def driven(odometry: Odometry, now: int) -> Odometry:
    """Let the robot drive on, an arc, as it was last told. now: [ns]."""
    seconds = max(0.0, min(age(odometry.time, now), LONGEST_HOLD - age(odometry.told, odometry.time)))
    pose, command = odometry.pose, odometry.command
    turn, length = command.omega * seconds, chord(command.v, command.omega, seconds)
    middle = pose.heading + turn / 2
    moved = Pose(pose.x + length * math.cos(middle), pose.y + length * math.sin(middle), pose.heading + turn)
    return replace(odometry, pose=moved, time=now)


def relative(before: Pose, after: Pose) -> Pose:
    """One pose seen from another."""
    dx, dy = after.x - before.x, after.y - before.y
    cos, sin = math.cos(before.heading), math.sin(before.heading)
    return Pose(cos * dx + sin * dy, cos * dy - sin * dx, after.heading - before.heading)


def flicker(pictures: Iterable[Seen]) -> Flicker:
    """Follow things from picture to picture, and count how often they are lost and found again.

    A stamp that runs backwards begins a new drive, as it does for the detector.
    """
    result = Flicker()
    tracks: List[Track] = []
    newest: Optional[int] = None
    for seen in pictures:
        if newest is not None and seen.stamp < newest:
            result, tracks = _counted(result, tracks), []
        newest = seen.stamp
        tracks, ended = follow(tracks, seen)
        result = _counted(result, ended)
    return _counted(result, tracks)


def follow(tracks: Sequence[Track], seen: Seen) -> Tuple[List[Track], List[Track]]:
    """Find the things of the pictures before in the next one.

    Each track takes at most one sighting, nearest pairs first, in metres on the road, the robot's own motion taken
    out. The kind does not matter for it. Returns the tracks that go on and those that have ended.
    """
    moved = [replace(track, sighting=_moved(track.sighting, seen.step)) for track in tracks]
    ended = [track for track in moved if age(track.stamp, seen.stamp) > MEMORY]
    moved = [track for track in moved if age(track.stamp, seen.stamp) <= MEMORY]
    pairs = []
    for i, track in enumerate(moved):
        gate = _gate(track, age(track.stamp, seen.stamp), seen.step is not None)
        for j, sighting in enumerate(seen.sightings):
            off = math.hypot(sighting.x - track.sighting.x, sighting.y - track.sighting.y)
            if off <= gate:
                pairs.append((off, i, j))
    found: Dict[int, int] = {}
    taken = set()
    for _, i, j in sorted(pairs):
        if i not in found and j not in taken:
            found[i] = j
            taken.add(j)
    alive = [
        _continued(track, seen.sightings[found[i]], seen.stamp)
        if i in found
        else replace(track, missing=track.missing + 1)
        for i, track in enumerate(moved)
    ]
    new = [Track(sighting, seen.stamp) for j, sighting in enumerate(seen.sightings) if j not in taken]
    return alive + new, ended


def _gate(track: Track, seconds: float, motion_known: bool) -> float:
    """[m] around the place where a thing should be, so many seconds after it was last seen."""
    distance = math.hypot(track.sighting.x, track.sighting.y)
    return GATE + GATE_SHARE * distance + (COMMAND_ERROR if motion_known else UNKNOWN_SPEED) * seconds


def _moved(sighting: Sighting, step: Optional[Pose]) -> Sighting:
    """Where a thing that stands still is after the robot's step."""
    if step is None:
        return sighting
    place = relative(step, Pose(sighting.x, sighting.y))
    return replace(sighting, x=place.x, y=place.y)


def _continued(track: Track, sighting: Sighting, stamp: int) -> Track:
    return Track(
        sighting,
        stamp,
        seen=track.seen + 1,
        missed=track.missed + track.missing,
        gaps=track.gaps + bool(track.missing),
        changes=track.changes + (sighting.kind != track.sighting.kind),
    )


def _counted(result: Flicker, ended: Iterable[Track]) -> Flicker:
    for track in ended:
        judged = track.seen > 1 or track.missing > 0
        result = Flicker(
            tracks=result.tracks + 1,
            judged=result.judged + judged,
            flashes=result.flashes + (judged and track.seen == 1),
            gaps=result.gaps + track.gaps,
            missed=result.missed + track.missed,
            between=result.between + max(track.seen - 2, 0) + track.missed,
            changes=result.changes + track.changes,
        )
    return result


class Sheets:
    """Writes contact sheets as they fill; at most one sheet is kept in memory."""

    def __init__(self, folder: str, prefix: str) -> None:
        """folder: '' writes none."""
        self._folder = folder
        self._prefix = prefix
        self._panels: List[Tuple[str, Array]] = []
        self.names: List[str] = []
        self.unshown = 0

    def take(self, name: str, picture: Array, obstacle: Obstacle) -> None:
        """Cut one detection out. name: of the picture. Raises OSError when a full sheet cannot be written."""
        if not self._folder or obstacle.image_box is None or len(self.names) >= MOST_SHEETS:
            self.unshown += bool(self._folder)
            return
        self._panels.append((os.path.splitext(name)[0][-20:], tile(picture, obstacle)))
        if len(self._panels) == COLUMNS * ROWS:
            self.close()

    def close(self) -> None:
        """Write what is left. Raises OSError."""
        if not self._panels:
            return
        name = '%s_%03d.jpg' % (self._prefix, len(self.names) + 1)
        path = os.path.join(self._folder, name)
        sheet = contact_sheet(self._panels, COLUMNS, TILE[0])
        with open(path, 'wb') as file:  # cv2.imwrite would only return False on a full disk
            file.write(cv2.imencode('.jpg', sheet, [cv2.IMWRITE_JPEG_QUALITY, SHEET_QUALITY])[1].tobytes())
        self.names.append(name)
        self._panels = []


def tile(picture: Array, obstacle: Obstacle) -> Array:
    """A detection cut out of its picture, with what stands around it, and a line of words below.

    picture: (H, W, 3) uint8, BGR. The obstacle has an image_box. Returns (TILE height + CAPTION, TILE width, 3) uint8.
    """
    box = obstacle.image_box
    assert box is not None
    left, top, right, bottom = window(box, picture.shape[1], picture.shape[0])
    drawn: Array = cv2.resize(picture[top:bottom, left:right], TILE, interpolation=cv2.INTER_LINEAR)
    scale = TILE[0] / (right - left), TILE[1] / (bottom - top)
    corners = [
        (round((u - left) * scale[0]), round((v - top) * scale[1]))
        for u, v in ((box.left, box.top), (box.right, box.bottom))
    ]
    color = UNKNOWN if obstacle.in_lane is None else INSIDE if obstacle.in_lane else OUTSIDE
    cv2.rectangle(drawn, corners[0], corners[1], color, 1)
    drawn = cv2.copyMakeBorder(drawn, 0, CAPTION, 0, 0, cv2.BORDER_CONSTANT, value=SHADE)
    words = '%s %.2f m  conf. %.2f' % (_kind(obstacle), math.hypot(obstacle.x, obstacle.y), obstacle.confidence)
    cv2.putText(drawn, words, (2, TILE[1] + CAPTION - 5), FONT, 0.4, TEXT, 1, cv2.LINE_AA)
    return drawn


def window(box: Box, width: int, height: int) -> Tuple[int, int, int, int]:
    """left, top, right, bottom [px] around a box with MARGIN, in TILE's shape, inside a picture of a size [px]."""
    side = max(box.right - box.left, box.bottom - box.top)
    wide = min((1 + 2 * MARGIN) * side * max(1.0, TILE[0] / TILE[1]), width, height * TILE[0] / TILE[1])
    wide = max(wide, min(TILE[0] / 4, width))  # a box of a few pixels is not blown up to a blur
    high = min(wide * TILE[1] / TILE[0], height)
    left = min(max((box.left + box.right - wide) / 2, 0), width - wide)
    top = min(max((box.top + box.bottom - high) / 2, 0), height - high)
    return int(left), int(top), max(int(left + wide), int(left) + 1), max(int(top + high), int(top) + 1)


def figures(checked: Sequence[RecordingChecked], empty: bool) -> Dict[str, Any]:
    """What the counts say: of all recordings together, and of each. empty: every detection is a false alarm."""
    return {'total': _figures(checked, empty), 'recordings': [_figures([item], empty) for item in checked]}


def _figures(checked: Sequence[RecordingChecked], empty: bool) -> Dict[str, Any]:
    found: Dict[str, Dict[str, int]] = {}
    times: Tally = Tally()  # type: ignore[type-arg]
    for item in checked:
        _add(found, {(kind, side): number for kind, sides in item.found.items() for side, number in sides.items()})
        times.update(item.milliseconds)
    kinds = {kind: sum(sides.values()) for kind, sides in found.items()}
    detections, pictures = sum(kinds.values()), sum(item.pictures for item in checked)
    moving = [item for item in checked if item.metres is not None]
    metres = sum(item.metres or 0.0 for item in moving) if moving else None
    on_the_way = sum(number for item in moving for sides in item.found.values() for number in sides.values())
    per_metre = round(on_the_way / metres, 4) if metres is not None and metres >= LEAST_METRES else None
    longest = max(checked, key=lambda item: item.longest_run, default=None)
    any_found = share(sum(item.with_any for item in checked), pictures)
    per_picture = round(detections / pictures, 4) if pictures else None
    alarms = {
        'count': detections,
        'kinds': kinds,
        'pictures_with_any': any_found,
        'per_picture': per_picture,
        'per_metre': per_metre,
        'longest_run': 0 if longest is None else longest.longest_run,
        'longest_in': '' if longest is None or not longest.longest_run else _name(longest),
        'longest_from': '' if longest is None else longest.longest_from,
        'longest_to': '' if longest is None else longest.longest_to,
    }
    return {
        'name': _name(checked[0]) if len(checked) == 1 else '%d recordings' % len(checked),
        'path': checked[0].path if len(checked) == 1 else '',
        'pictures': pictures,
        'broken': sum(item.broken for item in checked),
        'why_broken': [sentence for item in checked for sentence in item.why_broken][:KEPT_SENTENCES],
        'seconds': round(sum(item.seconds for item in checked), 3),
        'metres': None if metres is None else round(metres, 3),
        'metres_from': sorted({item.metres_from for item in checked if item.metres_from}),
        'detections': detections,
        'found': found,
        'pictures_with_any': any_found,
        'per_picture': per_picture,
        'per_metre': per_metre,
        'flicker': _flicker_figures([item.flicker for item in checked]),
        'false_alarms': alarms if empty else None,
        'milliseconds': milliseconds(times),
        'sheets': [name for item in checked for name in item.sheets],
        'unshown': sum(item.unshown for item in checked),
    }


def _add(found: Dict[str, Dict[str, int]], more: Mapping[Tuple[str, str], int]) -> None:
    for (kind, side), number in more.items():
        sides = found.setdefault(kind, {})
        sides[side] = sides.get(side, 0) + number


def _name(item: RecordingChecked) -> str:
    return os.path.basename(os.path.normpath(item.path))


def _flicker_figures(flickers: Sequence[Flicker]) -> Dict[str, Any]:
    sums = {name: sum(getattr(item, name) for item in flickers) for name in Flicker.__dataclass_fields__}
    return {
        'tracks': sums['tracks'],
        'flashes': share(sums['flashes'], sums['judged']),
        'gaps': sums['gaps'],
        'gaps_per_track': round(sums['gaps'] / sums['tracks'], 4) if sums['tracks'] else None,
        'missing': share(sums['missed'], sums['between']),
        'kind_changes': sums['changes'],
    }
