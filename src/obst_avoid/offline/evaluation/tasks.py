"""What there is to do: tasks that carry all they need, about PICTURES pictures or one recording each.

Workers may be on other machines, as long as they see the pictures under the same paths.
"""

import hashlib
import itertools
import os
from dataclasses import dataclass, field, replace
from typing import Any, Callable, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.offline.evaluation.labels import Detected, LabelledPicture
from obst_avoid.offline.recording import Recording

PICTURES, PICTURES_OF_FILES = 50, 250
"""A task: with detection, some seconds of work; with results from files, a fraction of one."""
MOST_BROKEN = 1000
"""Of broken pictures that are named; more are counted only."""
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
        """One more. why: without the path, which stands before it anyway."""
        why = why[len(path) :].lstrip(': ') if why.startswith(path) else why
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
