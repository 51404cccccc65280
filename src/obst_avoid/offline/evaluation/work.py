"""What a worker does with a task, and the sum of all results, which are plain, small and add up in any order."""

import time
from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

import cv2

from obst_avoid.core import detection
from obst_avoid.core.age import age
from obst_avoid.core.calibration import CalibrationError
from obst_avoid.core.motion import LONGEST_HOLD, remembered
from obst_avoid.core.picture import PictureError, decode_jpeg
from obst_avoid.core.types import Array, Command, Obstacle, Stamped
from obst_avoid.offline.detect_images import in_sight, json_from_obstacle
from obst_avoid.offline.evaluation import recordings
from obst_avoid.offline.evaluation.labels import Detected, LabelledPicture, found_from
from obst_avoid.offline.evaluation.matching import Judged, judge
from obst_avoid.offline.evaluation.tally import (
    BLUR_FIELD,
    SPEED_FIELD,
    Groups,
    Tally,
    add,
    add_to,
    bands_of_label,
    count_picture,
    groups_of_picture,
    tally_of_label,
)
from obst_avoid.offline.evaluation.tasks import Broken, Job, Looked, Result, Run, Task
from obst_avoid.offline.evaluation.worst import (
    add_comparison,
    compare,
    described,
    empty_comparison,
    if_wrong,
    keep_worst,
)
from obst_avoid.offline.pictures import read_jpeg
from obst_avoid.offline.recording import CAR_CMD, JPEG, RAW, Recorded, Recording, messages, picture_of, readable
from obst_avoid.offline.tool import ToolError, why_os
from obst_avoid.ros import border

WAITING = 8
"""Times as many pictures as are kept may wait for the choice of the worst, which takes time."""
Places = Tuple[Tuple[str, str], ...]
"""Name and value of each group of a picture, or of each band of a label."""
_detectors: Dict[Any, detection.Detector] = {}
"""A worker's own: what is too costly to make for each task."""


def evaluate_pictures(job: Job, task: Task) -> Result:
    """The work of a task with labels."""
    broken = Broken()
    runs: List[Dict[str, Any]] = [{'groups': {}, 'bands': {}, 'worst': []} for _ in job.runs]
    sums = [_Sums() for _ in job.runs]
    comparison = empty_comparison(job) if len(job.runs) == 2 else None
    pictures = 0
    for looked in _look(job, task, broken):
        try:
            judged = [_judge(job, looked, detected) for detected in looked.detected]
            counted = [_counted(job, looked, *pair) for pair in zip(judged, looked.detected)]
        except Exception as error:  # an odd value that no check has foreseen: it costs this picture only
            broken.add(_path(looked.picture), '%s: %s' % (type(error).__name__, error))
            continue
        pictures += 1
        for index, run in enumerate(runs):
            sums[index].take(counted[index])
            run['worst'] += if_wrong(job, looked, [index], judged)
            if len(run['worst']) > WAITING * job.worst:
                run['worst'] = keep_worst(run['worst'], job.worst)
        if comparison is not None:
            compare(job, looked, judged, comparison)
    for run, kept in zip(runs, sums):
        run.update(groups=_spread(kept.groups), bands=_spread(kept.bands))
        run['worst'] = [described(entry) for entry in keep_worst(run['worst'], job.worst)]
    if comparison is not None:
        comparison['pictures'] = [described(entry) for entry in comparison['pictures']]
    return {'pictures': pictures, 'broken': asdict(broken), 'runs': runs, 'comparison': comparison}


def check_recording(job: Job, task: Task) -> Result:
    """The work of a task without labels."""
    cv2.setNumThreads(1)
    recording, broken = task.recording, Broken()
    assert recording is not None
    try:
        detector = _detector(job.runs[task.run], None)
        checked = recordings.check(recording, detector, _forget, job.sheets, task.prefix)
    except (ToolError, CalibrationError, OSError) as error:
        broken.add(recording.path, _why(error))
        return {'pictures': 0, 'broken': asdict(broken), 'run': task.run, 'checked': None}
    return {'pictures': checked.pictures, 'broken': asdict(broken), 'run': task.run, 'checked': asdict(checked)}


def _forget(sentence: str) -> None:
    """Broken pictures come back with the result."""


def _look(job: Job, task: Task, broken: Broken) -> Iterator[Looked]:
    if job.runs[0].settings is None:
        nothing = Detected((), None)
        for picture in task.pictures:
            yield Looked(picture, tuple(item or nothing for item in picture.detected))
        return
    cv2.setNumThreads(1)  # the workers are as many as the cores
    yield from _look_at_files(job, task, broken) if task.recording is None else _look_at_recording(job, task, broken)


def _look_at_files(job: Job, task: Task, broken: Broken) -> Iterator[Looked]:
    """Each picture alone, as detect_images does it."""
    for picture in task.pictures:
        assert picture.source is not None
        path = picture.source.path
        try:
            jpeg = read_jpeg(path)
            detected = []
            for run in job.runs:
                begin = time.perf_counter()
                decoded = decode_jpeg(jpeg)
                detector = _detector(run, decoded)
                scene, _ = detection.detect(detector, decoded, None)
                detected.append(_detected(scene.obstacles, time.perf_counter() - begin))
            _check_size(picture, decoded)
        except (PictureError, CalibrationError, ToolError, OSError) as error:
            broken.add(path, _why(error))
            continue
        yield Looked(picture, tuple(detected))


def _look_at_recording(job: Job, task: Task, broken: Broken) -> Iterator[Looked]:
    """All pictures of a recording through detectors that remember; the labelled ones come back."""
    recording = task.recording
    assert recording is not None
    unseen = {picture.source.number: picture for picture in task.pictures if picture.source is not None}
    number, why = -1, 'not in the recording'
    commands: Tuple[Stamped[Command], ...] = ()
    try:
        detectors = [_detector(run, None) for run in job.runs]
        for item in messages(recording, motion=True):
            if item.role == CAR_CMD:
                commands = _told(commands, item)
            if item.role not in (JPEG, RAW):
                continue
            number += 1
            stamp = border.nanoseconds(item.msg.header.stamp)
            picture = unseen.pop(number, None)
            try:
                detected = []
                for index, detector in enumerate(detectors):
                    begin = time.perf_counter()
                    decoded = picture_of(item)
                    scene, detectors[index] = detection.detect(detector, decoded, stamp, commands)
                    detected.append(_detected(scene.obstacles, time.perf_counter() - begin))
                if picture is not None:
                    _check_size(picture, decoded)
            except (PictureError, CalibrationError, ToolError) as error:
                broken.add(_name_in(recording, number, stamp), _why(error))
                continue
            if picture is not None:
                fresh = commands and age(commands[-1].stamp, item.time) <= LONGEST_HOLD
                yield Looked(picture, tuple(detected), abs(commands[-1].value.v) if fresh else None)
    except (ToolError, CalibrationError, OSError) as error:
        broken.add(recording.path, _why(error))
        why = 'not reached: its recording cannot be read to the end'
    for number, picture in unseen.items():
        stamp = picture.source.stamp if picture.source is not None else None
        broken.add(_name_in(recording, number or 0, stamp or 0), why)


def _name_in(recording: Recording, number: int, stamp: int) -> str:
    """Of a recording's picture. stamp: [ns] in a bag."""
    if recording.files:
        return readable(recording.files[number])
    return '%s, %.3f s' % (recording.path, stamp / 1e9)


def _path(picture: LabelledPicture) -> str:
    return picture.name if picture.source is None else picture.source.path


def _told(commands: Sequence[Stamped[Command]], item: Recorded) -> Tuple[Stamped[Command], ...]:
    """The commands so far and one more. One that cannot be used is none."""
    try:
        return remembered(commands, Stamped(item.time, border.command_from_msg(item.msg)))
    except border.BorderError:
        return tuple(commands)


def _check_size(picture: LabelledPicture, decoded: Array) -> None:
    height, width = decoded.shape[:2]
    if (width, height) != (picture.width, picture.height):
        raise ToolError('%dx%d, expected %dx%d as in the labels' % (width, height, picture.width, picture.height))


def _why(error: BaseException) -> str:
    return why_os(error) if isinstance(error, OSError) else str(error)


def _detected(obstacles: Sequence[Obstacle], seconds: float) -> Detected:
    """As if it had been written to a detections file and read again, rounded in the same way."""
    found = (found_from(json_from_obstacle(obstacle)) for obstacle in in_sight(obstacles))
    return Detected(tuple(item for item in found if item is not None), round(1e3 * seconds, 3))


def _detector(run: Run, picture: Optional[Array]) -> detection.Detector:
    """A detector without memories, for pictures of that size. Raises CalibrationError."""
    assert run.calibration is not None and run.settings is not None
    size = None if picture is None else picture.shape[:2]
    key = (run.key, size)
    if key not in _detectors:
        detector = detection.start(run.calibration, run.settings)
        if picture is not None:
            _, detector = detection.detect(detector, picture, None)
        _detectors[key] = detector
    return _detectors[key]


def _judge(job: Job, looked: Looked, detected: Detected) -> Judged:
    picture = looked.picture
    found = [item for item in detected.found if item.confidence >= job.min_confidence]
    return judge(picture.labels, found, (picture.width, picture.height), picture.polygons, picture.complete)


@dataclass(frozen=True)
class _Counted:
    """A picture's tally and its groups, and its labels' tallies and bands."""

    tally: Dict[str, int]
    groups: Places
    labels: List[Tuple[Dict[str, int], Places]]


@dataclass(frozen=True)
class _Sums:
    """Tallies by all the groups, or bands, at once to which they belong: each is added once, and spread at the end."""

    groups: Dict[Places, Dict[str, int]] = field(default_factory=dict)
    bands: Dict[Places, Dict[str, int]] = field(default_factory=dict)

    def take(self, counted: _Counted) -> None:
        """Add a picture."""
        add_to(self.groups.setdefault(counted.groups, {}), counted.tally)
        for tally, bands in counted.labels:
            add_to(self.bands.setdefault(bands, {}), tally)


def _spread(sums: Dict[Places, Dict[str, int]]) -> Groups:
    found: Groups = {}
    for places, tally in sums.items():
        for name, value in places:
            add_to(found.setdefault(name, {}).setdefault(value, {}), tally)
    return found


def _counted(job: Job, looked: Looked, judged: Judged, detected: Detected) -> _Counted:
    fields = looked.picture.fields
    tally: Tally = Counter()  # type: ignore[type-arg]
    count_picture(tally, judged, detected.milliseconds)
    speed, blur = fields.get(SPEED_FIELD, looked.speed), fields.get(BLUR_FIELD)
    labels = []
    for label in judged.labels:
        if not label.ignored:
            one = tally_of_label(label, judged)
            add_to(tally, one)
            labels.append((one, tuple(bands_of_label(label.label, speed, blur))))
    return _Counted(tally, tuple(groups_of_picture(fields, job.by, judged.on_lanes)), labels)


@dataclass
class Total:
    """The sum of results. bands, groups, worst, checked (recordings without labels): by run."""

    job: Job
    pictures: int = 0
    broken: Broken = field(default_factory=Broken)
    groups: List[Groups] = field(default_factory=list)
    bands: List[Groups] = field(default_factory=list)
    worst: List[List[Dict[str, Any]]] = field(default_factory=list)
    comparison: Optional[Dict[str, Any]] = None
    checked: List[List[Dict[str, Any]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for kept in (self.groups, self.bands):
            kept.extend({} for _ in self.job.runs)
        for lists in (self.worst, self.checked):
            lists.extend([] for _ in self.job.runs)
        self.comparison = empty_comparison(self.job) if len(self.job.runs) == 2 else None

    def add(self, result: Result) -> None:
        """Add one task's result; the order does not matter."""
        self.pictures += result['pictures']
        for entry in result['broken']['entries']:
            self.broken.add(entry['path'], entry['why'])
        self.broken.count += result['broken']['count'] - len(result['broken']['entries'])
        for index, run in enumerate(result.get('runs', [])):
            add(self.groups[index], run['groups'])
            add(self.bands[index], run['bands'])
            self.worst[index] = keep_worst(self.worst[index] + run['worst'], self.job.worst)
        if self.comparison is not None and result.get('comparison'):
            add_comparison(self.comparison, result['comparison'], self.job.worst)
        if result.get('checked'):
            self.checked[result['run']].append(result['checked'])
