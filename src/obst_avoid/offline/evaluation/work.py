"""The work in parallel: tasks for Dask's workers, what they do, and the store of what is finished.

A task carries all that it needs, about PICTURES pictures or one recording, so that workers may be on other machines,
as long as they see the pictures under the same paths. Its result is plain, small and adds up in any order.
"""

import contextlib
import hashlib
import heapq
import itertools
import json
import logging
import os
import signal
import sqlite3
import sys
import tempfile
import time
import zlib
from collections import Counter
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

import cv2

import obst_avoid
from obst_avoid.core import detection
from obst_avoid.core.age import age
from obst_avoid.core.calibration import Calibration, CalibrationError
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.picture import PictureError, decode_jpeg
from obst_avoid.core.types import Array, Obstacle
from obst_avoid.offline.detect_images import json_from_obstacle
from obst_avoid.offline.evaluation import recordings
from obst_avoid.offline.evaluation.labels import Detected, LabelledPicture, found_from
from obst_avoid.offline.evaluation.matching import FALSE, HIT, Judged, JudgedFound, JudgedLabel, judge
from obst_avoid.offline.evaluation.tally import (
    BLUR_FIELD,
    SPEED_FIELD,
    Groups,
    add,
    bands_of_label,
    count_picture,
    groups_of_picture,
    tally_of_label,
)
from obst_avoid.offline.pictures import read_jpeg
from obst_avoid.offline.recording import CAR_CMD, JPEG, RAW, Recorded, Recording, messages
from obst_avoid.offline.tool import ToolError, why_os
from obst_avoid.ros import border

PICTURES, PICTURES_OF_FILES = 50, 250
"""A task: with detection, some seconds of work; with results from files, a fraction of one."""
IN_FLIGHT = 4
"""Tasks a worker: none waits for work, and memory does not grow with the number of tasks."""
HERE = '127.0.0.1'
"""Nobody else can reach what this machine's workers do."""
PARTS = ('scheduler', 'worker', 'nanny')
"""Of Dask, each with a web page by default."""
START_SECONDS = 30
"""To find a scheduler and its first worker."""
MOST_BROKEN = 1000
"""Of broken pictures that are named; more are counted only."""
WAITING = 8
"""Times as many pictures as are kept may wait for the choice of the worst, which takes time."""
MISSED, FALSE_ALARMS, SIDE = 'missed', 'false', 'side'
SORTS = (MISSED, FALSE_ALARMS, SIDE)
"""Of what can be wrong in a picture."""

Result = Dict[str, Any]


@dataclass(frozen=True)
class Run:
    """One of the detectors, or detections files, that are compared. calibration, settings: None with a file.

    what: it is, for a person. key: the same only for the same calibration and settings. arguments: for show_steps.
    """

    name: str
    what: str = ''
    key: str = ''
    arguments: Tuple[str, ...] = ()
    calibration: Optional[Calibration] = None
    settings: Optional[DetectionSettings] = None


@dataclass(frozen=True)
class Job:
    """What all tasks have in common. by: fields by which pictures are grouped. worst: pictures that are kept."""

    runs: Tuple[Run, ...]
    min_confidence: float = 0.0
    by: Tuple[str, ...] = ()
    worst: int = 24
    sheets: str = ''


@dataclass(frozen=True)
class Task:
    """Labelled pictures that stand alone, or those of a recording, or, without labels, a recording for one of the runs.

    name: the same only for the same work. prefix: of the sheets' names.
    """

    name: str
    pictures: Tuple[LabelledPicture, ...] = ()
    recording: Optional[Recording] = None
    run: int = 0
    prefix: str = ''

    @property
    def paths(self) -> List[str]:
        """What is not evaluated when the task fails."""
        if self.recording is not None:
            return [self.recording.path]
        return [picture.name if picture.source is None else picture.source.path for picture in self.pictures]


@dataclass(frozen=True)
class Looked:
    """A labelled picture and what each run found in it. speed: [m/s] of the robot; None: not known."""

    picture: LabelledPicture
    detected: Tuple[Detected, ...]
    speed: Optional[float] = None


@dataclass
class Broken:
    """What could not be evaluated: how much, and the first of it by path and reason."""

    count: int = 0
    entries: List[Dict[str, str]] = field(default_factory=list)

    def add(self, path: str, why: str) -> None:
        """One more."""
        self.count += 1
        if len(self.entries) < MOST_BROKEN:
            self.entries.append({'path': path, 'why': why})


def label_tasks(
    pictures: Iterable[LabelledPicture], files: bool, recording_of: Callable[[str], Recording]
) -> Iterator[Task]:
    """Labelled pictures in tasks. files: their detections come from files. recording_of: by its path.

    Without files, pictures that were not found are left out.
    """
    if files:
        for part in _chunks(pictures, PICTURES_OF_FILES):
            yield _named(Task('', part))
        return
    known = (picture for picture in pictures if picture.source is not None)
    for path, group in itertools.groupby(known, key=lambda picture: picture.source and picture.source.recording):
        if path is None:
            for part in _chunks(group, PICTURES):
                yield _named(Task('', part))
        else:
            yield _named(Task('', tuple(group), recording_of(path)))


def recording_tasks(found: Sequence[Recording], runs: Sequence[Run]) -> Iterator[Task]:
    """Recordings without labels, each a task for each run."""
    for index, recording in enumerate(found):
        stem = os.path.splitext(os.path.basename(os.path.normpath(recording.path)))[0]
        for run, item in enumerate(runs):
            prefix = '_'.join(['%03d' % (index + 1), stem, *([item.name] if len(runs) > 1 else [])])
            yield _named(Task('', recording=recording, run=run, prefix=prefix))


def _named(task: Task) -> Task:
    """With a name made of all that is not the call's: which pictures, and their files' sizes and times."""
    names = [(picture.name, picture.source) for picture in task.pictures]
    content = repr((names, task.recording, task.run, task.prefix, [_state(path) for path in task.paths]))
    return replace(task, name=hashlib.sha256(content.encode()).hexdigest())


def _state(path: str) -> Tuple[int, int]:
    try:
        status = os.stat(path)
    except OSError:
        return (0, 0)
    return (status.st_size, status.st_mtime_ns)


def _chunks(items: Iterable[LabelledPicture], size: int) -> Iterator[Tuple[LabelledPicture, ...]]:
    iterator = iter(items)
    return iter(lambda: tuple(itertools.islice(iterator, size)), ())


# What workers do


def evaluate_pictures(job: Job, task: Task) -> Result:
    """The work of a task with labels."""
    broken = Broken()
    runs: List[Dict[str, Any]] = [{'groups': {}, 'bands': {}, 'worst': []} for _ in job.runs]
    comparison = empty_comparison(job) if len(job.runs) == 2 else None
    pictures = 0
    for looked in _look(job, task, broken):
        pictures += 1
        judged = [_judge(job, looked, detected) for detected in looked.detected]
        for index, (result, run) in enumerate(zip(judged, runs)):
            _count(job, looked, result, looked.detected[index].milliseconds, run)
            run['worst'] += _if_wrong(job, looked, [index], judged)
            if len(run['worst']) > WAITING * job.worst:
                run['worst'] = keep_worst(run['worst'], job.worst)
        if comparison is not None:
            _compare(job, looked, judged, comparison)
    for run in runs:
        run['worst'] = [_described(entry) for entry in keep_worst(run['worst'], job.worst)]
    if comparison is not None:
        comparison['pictures'] = [_described(entry) for entry in comparison['pictures']]
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
                obstacles, _ = detection.detect(detector, decoded, None)
                detected.append(_detected(obstacles, time.perf_counter() - begin))
            _check_size(picture, decoded)
        except (PictureError, CalibrationError, ToolError, OSError) as error:
            broken.add(path, _why(error))
            continue
        yield Looked(picture, tuple(detected))


def _look_at_recording(job: Job, task: Task, broken: Broken) -> Iterator[Looked]:
    """All pictures of a recording through detectors that remember; the labelled ones come back."""
    recording = task.recording
    assert recording is not None
    wanted = {picture.source.number: picture for picture in task.pictures if picture.source is not None}
    number, newest = -1, None
    command: Optional[Tuple[int, float]] = None
    try:
        detectors = [_detector(run, None) for run in job.runs]
        for item in messages(recording, motion=True):
            if item.role == CAR_CMD:
                command = (item.time, _speed(item.msg, command))
            if item.role not in (JPEG, RAW):
                continue
            number += 1
            stamp = border.nanoseconds(item.msg.header.stamp)
            if newest is not None and stamp < newest:
                detectors = [detection.restarted(detector) for detector in detectors]
            newest = stamp
            picture = wanted.get(number)
            try:
                detected = []
                for index, detector in enumerate(detectors):
                    begin = time.perf_counter()
                    decoded = _picture_of(item)
                    obstacles, detectors[index] = detection.detect(detector, decoded, stamp)
                    detected.append(_detected(obstacles, time.perf_counter() - begin))
                if picture is not None:
                    _check_size(picture, decoded)
            except (PictureError, CalibrationError, ToolError) as error:
                name = recording.files[number] if recording.files else '%s, %.3f s' % (recording.path, stamp / 1e9)
                broken.add(name, _why(error))
                continue
            if picture is not None:
                fresh = command is not None and age(command[0], item.time) <= recordings.COMMAND_AGE
                yield Looked(picture, tuple(detected), command[1] if command is not None and fresh else None)
    except (ToolError, CalibrationError, OSError) as error:
        broken.add(recording.path, _why(error))


def _speed(msg: Any, before: Optional[Tuple[int, float]]) -> float:
    try:
        return abs(border.command_from_msg(msg).v)
    except border.BorderError:
        return before[1] if before else 0.0


def _picture_of(item: Recorded) -> Array:
    """(H, W, 3) uint8 BGR. Raises PictureError."""
    if item.role == JPEG:
        return border.picture_from_compressed_image(item.msg)
    return border.picture_from_image(item.msg)


def _check_size(picture: LabelledPicture, decoded: Array) -> None:
    height, width = decoded.shape[:2]
    if (width, height) != (picture.width, picture.height):
        raise ToolError('%dx%d, expected %dx%d as in the labels' % (width, height, picture.width, picture.height))


def _why(error: BaseException) -> str:
    return why_os(error) if isinstance(error, OSError) else str(error)


def _detected(obstacles: Sequence[Obstacle], seconds: float) -> Detected:
    """As if it had been written to a detections file and read again, rounded in the same way."""
    found = (found_from(json_from_obstacle(obstacle)) for obstacle in obstacles)
    return Detected(tuple(item for item in found if item is not None), round(1e3 * seconds, 3))


_detectors: Dict[Any, detection.Detector] = {}
"""A worker's own: what is too costly to make for each task."""


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


def _count(job: Job, looked: Looked, judged: Judged, milliseconds: Optional[float], run: Dict[str, Any]) -> None:
    fields = looked.picture.fields
    tally: Counter = Counter()  # type: ignore[type-arg]
    count_picture(tally, judged, milliseconds)
    speed, blur = fields.get(SPEED_FIELD, looked.speed), fields.get(BLUR_FIELD)
    for label in judged.labels:
        if label.ignored:
            continue
        one = tally_of_label(label, judged)
        tally.update(one)
        for name, value in bands_of_label(label.label, speed, blur):
            run['bands'].setdefault(name, {}).setdefault(value, Counter()).update(one)
    for name, value in groups_of_picture(fields, job.by, judged.on_lanes):
        run['groups'].setdefault(name, {}).setdefault(value, Counter()).update(tally)


# The worst pictures


def keep_worst(entries: Sequence[Dict[str, Any]], most: int) -> List[Dict[str, Any]]:
    """Of pictures, those among which choose_worst may choose: at most twice as many, however many are added later."""
    if len(entries) <= most:
        return list(entries)
    kept = {entry['name']: entry for entry in heapq.nsmallest(most, entries, key=_rank)}
    for entry in itertools.chain(*_thirds(entries, most)):
        kept[entry['name']] = entry
    return list(kept.values())


def choose_worst(entries: Sequence[Dict[str, Any]], most: int) -> List[Dict[str, Any]]:
    """The worst pictures, worst first; of each sort of error a third, where there are so many. Ties go by name."""
    chosen: Dict[str, Dict[str, Any]] = {}
    for entry in itertools.chain(*_thirds(entries, most), sorted(entries, key=_rank)):
        if len(chosen) < most:
            chosen.setdefault(entry['name'], entry)
    return sorted(chosen.values(), key=_rank)


def _thirds(entries: Sequence[Dict[str, Any]], most: int) -> List[List[Dict[str, Any]]]:
    third = most // len(SORTS)
    return [
        heapq.nsmallest(
            third, (entry for entry in entries if entry[sort]), key=lambda entry: (-entry[sort], *_rank(entry))
        )
        for sort in SORTS
    ]


def _rank(entry: Mapping[str, Any]) -> Tuple[int, str]:
    return -entry['score'], entry['name']


def _if_wrong(job: Job, looked: Looked, runs: Sequence[int], judged: Sequence[Judged]) -> List[Dict[str, Any]]:
    """The picture, when something is wrong in it. runs: which are looked at."""
    missed = false = side = 0
    for index in runs:
        missed += sum(not label.ignored and label.partner is None for label in judged[index].labels)
        false += sum(item.counts for item in judged[index].found)
        side += sum(item.side_wrong for item in judged[index].found)
    if not missed + false + side:
        return []
    return [_entry(job, looked, runs, judged, missed + false + side, {MISSED: missed, FALSE_ALARMS: false, SIDE: side})]


def _entry(
    job: Job, looked: Looked, runs: Sequence[int], judged: Sequence[Judged], score: int, sorts: Mapping[str, int]
) -> Dict[str, Any]:
    """What is needed to rank a picture; 'judged' becomes words in _described, for the few that are kept."""
    chosen = [(job.runs[index].name, judged[index]) for index in runs]
    return {'name': looked.picture.name, 'score': score, **sorts, 'judged': (looked.picture, chosen)}


def _described(entry: Mapping[str, Any]) -> Dict[str, Any]:
    """A picture for JSON, with its labels and detections."""
    picture, chosen = entry['judged']
    source = picture.source
    in_bag = None
    if source is not None and source.stamp is not None:
        in_bag = {'path': source.recording, 'stamp': source.stamp, 'time': source.time}
    labels = []
    for index, label in enumerate(chosen[0][1].labels):
        states = {name: _state_of(judged.labels[index]) for name, judged in chosen}
        missing = [name for name, state in states.items() if state == MISSED]
        labels.append(
            {
                'kind': label.label.category,
                'bbox': [round(value, 2) for value in label.label.box],
                'state': MISSED if missing else states[chosen[0][0]],
                'states': states,
                'why': label.ignored or ('missed by %s' % ', '.join(missing) if missing and len(chosen) > 1 else ''),
            }
        )
    return {
        **{key: entry[key] for key in ('name', 'score', *SORTS)},
        'path': None if source is None or in_bag is not None else source.path,
        'in_bag': in_bag,
        'why': _words(chosen),
        'labels': labels,
        'runs': {name: [_drawn(item) for item in judged.found] for name, judged in chosen},
    }


def _state_of(label: JudgedLabel) -> str:
    return 'ignored' if label.ignored else MISSED if label.partner is None else HIT


def _drawn(item: JudgedFound) -> Dict[str, Any]:
    found = item.found
    return {
        'kind': found.kind,
        'bbox': [round(value, 2) for value in found.box],
        'confidence': found.confidence,
        'state': item.state,
        'side_wrong': item.side_wrong,
        'counts': item.counts,
    }


def _words(chosen: Sequence[Tuple[str, Judged]]) -> str:
    """What is wrong in a picture, by run when there are several."""
    parts = []
    for name, judged in chosen:
        missed = Counter(label.label.category for label in judged.labels if not label.ignored and label.partner is None)
        words = ['%s missed' % _plural(number, kind) for kind, number in sorted(missed.items())]
        false = sum(item.counts for item in judged.found)
        words += ['%s' % _plural(false, 'false alarm')] if false else []
        unjudged = sum(item.state == FALSE and not item.counts for item in judged.found)
        words += ['%s that may be unlabelled' % _plural(unjudged, 'detection')] if unjudged else []
        side = sum(item.side_wrong for item in judged.found)
        words += ['%d on the wrong side of the line' % side] if side else []
        sentence = ', '.join(words) or 'nothing wrong'
        parts.append('%s: %s' % (name, sentence) if len(chosen) > 1 else sentence)
    return '; '.join(parts)


def _plural(number: int, noun: str) -> str:
    return '%d %s%s' % (number, noun, '' if number == 1 else 's')


# Two runs side by side


def empty_comparison(job: Job) -> Dict[str, Any]:
    """Of nothing yet."""
    names = [run.name for run in job.runs]
    zeros = dict.fromkeys(names, 0)
    return {'both': 0, 'only': dict(zeros), 'neither': 0, 'false_alarms': dict(zeros), 'pictures': []}


def _compare(job: Job, looked: Looked, judged: Sequence[Judged], into: Dict[str, Any]) -> None:
    """Add a picture. Its labels are relevant for both runs or for none."""
    names = [run.name for run in job.runs]
    only = [0, 0]
    for first, second in zip(judged[0].labels, judged[1].labels):
        if first.ignored:
            continue
        found = (first.partner is not None, second.partner is not None)
        if found[0] == found[1]:
            into['both' if found[0] else 'neither'] += 1
        else:
            only[found.index(True)] += 1
    false = [sum(item.counts for item in result.found) for result in judged]
    for name, number, alarms in zip(names, only, false):
        into['only'][name] += number
        into['false_alarms'][name] += alarms
    differing = sum(only) + abs(false[0] - false[1])
    if differing:
        sorts = {MISSED: sum(only), FALSE_ALARMS: abs(false[0] - false[1]), SIDE: 0}
        entry = _entry(job, looked, (0, 1), judged, differing, sorts)
        into['pictures'] = heapq.nsmallest(job.worst, [*into['pictures'], entry], key=_rank)


def add_comparison(into: Dict[str, Any], other: Mapping[str, Any], most: int) -> None:
    """Add the comparison of other pictures."""
    for key in ('both', 'neither'):
        into[key] += other[key]
    for key in ('only', 'false_alarms'):
        for name, number in other[key].items():
            into[key][name] += number
    into['pictures'] = heapq.nsmallest(most, [*into['pictures'], *other['pictures']], key=_rank)


# All results together


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


# Doing it


Done = Tuple[Task, Optional[Result], str]
"""A task with its result, or with None and why it failed."""


def work_here(function: Callable[[Job, Task], Result], job: Job, tasks: Iterable[Task]) -> Iterator[Done]:
    """Do the tasks one by one in this process."""
    threads = cv2.getNumThreads()
    try:
        for task in tasks:
            try:
                result, why = function(job, task), ''
            except Exception as error:  # as from a worker: one bad task does not end the others
                result, why = None, _failed(error)
            yield task, result, why
    finally:
        cv2.setNumThreads(threads)


def _failed(error: BaseException) -> str:
    return '%s: %s' % (type(error).__name__, ' '.join(str(error).split())[:200])


def work_through(
    client: Any,
    function: Callable[[Job, Task], Result],
    job: Job,
    tasks: Iterable[Task],
) -> Iterator[Done]:
    """Let the workers do the tasks, a bounded number at a time.

    A task whose worker dies is given to another one, as often as Dask's allowed-failures says.
    """
    from distributed import as_completed

    waiting = iter(tasks)
    workers = max(1, len(client.scheduler_info()['workers']))
    running: Dict[str, Task] = {}
    finished = as_completed(loop=client.loop)

    def submit() -> None:
        task = next(waiting, None)
        if task is not None and task.name not in running:
            running[task.name] = task
            finished.add(client.submit(function, job, task, key='evaluate-' + task.name, pure=False))

    for _ in range(IN_FLIGHT * workers):
        submit()
    for future in finished:
        task = running.pop(future.key[len('evaluate-') :])
        error = future.exception()
        result = None if error is not None else future.result()
        future.release()
        submit()
        yield task, result, '' if error is None else _failed(error)


@contextlib.contextmanager
def workers_of(jobs: int, scheduler: str) -> Iterator[Any]:
    """Workers on the cores of this machine, or those of a scheduler by its address. Raises ToolError.

    Dask is imported here: it takes a second, and what needs no workers does not wait for it.
    """
    import dask
    from distributed import Client, LocalCluster

    logging.getLogger('distributed').setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        if scheduler:
            try:
                client = stack.enter_context(Client(scheduler, timeout=START_SECONDS, set_as_default=False))
                client.wait_for_workers(1, timeout=START_SECONDS)
            except (OSError, ValueError, TimeoutError) as error:
                words = ' '.join(str(error).split())[:200] or type(error).__name__
                raise ToolError('no Dask scheduler with workers at %s: %s' % (scheduler, words)) from error
        else:
            stack.enter_context(_built_package_first())
            stack.enter_context(dask.config.set({'distributed.%s.http.routes' % name: [] for name in PARTS}))
            space = stack.enter_context(tempfile.TemporaryDirectory(prefix='evaluate_'))
            with _interrupts_ignored():
                cluster = LocalCluster(
                    n_workers=jobs,
                    threads_per_worker=1,
                    processes=True,
                    host=HERE,
                    dashboard_address=HERE + ':0',  # None would open its port to the network, without a dashboard
                    worker_dashboard_address=HERE + ':0',
                    local_directory=space,
                    silence_logs=logging.CRITICAL,
                )
            stack.enter_context(cluster)
            client = stack.enter_context(Client(cluster, set_as_default=False))
        yield client


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ctrl-C goes to all processes of a terminal: those that are started in here leave it to this one to end them."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def _built_package_first() -> Iterator[None]:
    """Take the source folder out of the search path, which worker processes inherit.

    Catkin's package in the devel space puts it first when it is imported; a process that begins with it there finds
    only the half of the package that is no messages.
    """
    roots = {os.path.dirname(path) for path in obst_avoid.__path__} if len(obst_avoid.__path__) > 1 else set()
    source = os.path.dirname(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))))
    before = list(sys.path)
    sys.path[:] = [path for path in before if not (path == source and source in roots)]
    try:
        yield
    finally:
        sys.path[:] = before


# What is finished


def open_store(path: str, call: Mapping[str, str]) -> sqlite3.Connection:
    """The results of finished tasks, kept for this call alone. call: what the results depend on, by its name.

    Raises ToolError in one sentence when the file holds another call's results, or is none of ours.
    """
    store = sqlite3.connect(path)
    try:
        store.executescript(
            'PRAGMA synchronous = NORMAL;'
            'CREATE TABLE IF NOT EXISTS call (name TEXT PRIMARY KEY, value TEXT);'
            'CREATE TABLE IF NOT EXISTS finished (task TEXT PRIMARY KEY, result BLOB);'
        )
        before = dict(store.execute('SELECT name, value FROM call'))
        if not before:
            store.executemany('INSERT INTO call VALUES (?, ?)', sorted(call.items()))
            store.commit()
    except sqlite3.Error as error:
        raise ToolError('%s cannot be used: %s' % (path, error)) from error
    differing = sorted(name for name in {*before, *call} if before.get(name) != call.get(name))
    if before and differing:
        words = ', '.join(differing)
        raise ToolError('%s holds an evaluation with other %s, expected a new folder' % (os.path.dirname(path), words))
    return store


def finished_count(store: sqlite3.Connection) -> int:
    """How many tasks are finished."""
    return int(store.execute('SELECT count(*) FROM finished').fetchone()[0])


def finished_result(store: sqlite3.Connection, task: Task) -> Optional[Result]:
    """The result of a task from an earlier call."""
    row = store.execute('SELECT result FROM finished WHERE task = ?', (task.name,)).fetchone()
    return None if row is None else json.loads(zlib.decompress(row[0]))


def store_result(store: sqlite3.Connection, task: Task, result: Result) -> None:
    """Keep a result at once: what is stored survives an interruption."""
    blob = zlib.compress(json.dumps(result).encode(), 1)
    store.execute('INSERT OR REPLACE INTO finished VALUES (?, ?)', (task.name, blob))
    store.commit()
