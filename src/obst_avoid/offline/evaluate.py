"""evaluate: labels against detections, or recordings without labels, as numbers and as a page."""

import argparse
import contextlib
import hashlib
import itertools
import json
import os
import sqlite3
import sys
from argparse import Namespace
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import rosbag
import rospkg

from obst_avoid.core.detection.settings import PROFILES
from obst_avoid.core.picture import PictureError
from obst_avoid.core.types import Array
from obst_avoid.offline import tool
from obst_avoid.offline.evaluation import (
    figures,
    finished,
    labels,
    matching,
    recordings,
    tally,
    tasks,
    work,
    workers,
    worst,
)
from obst_avoid.offline.pictures import read_picture
from obst_avoid.offline.recording import (
    Recorded,
    Recording,
    named_pictures,
    open_bag,
    open_folder,
    picture_of,
    readable,
)
from obst_avoid.offline.tool import ToolError
from obst_avoid.ros import border

STORE, NUMBERS, PAGE, SHEETS = 'work.sqlite', 'evaluation.json', 'evaluation.html', 'sheets'
SEQUENCE_RATE = 30.0
"""Pictures a second of a folder that is run as a sequence."""
MOST_NAMES = 100
"""Of missing pictures and bad entries in the numbers, and of broken ones on stderr."""
BAG_ENDING = '.bag'
HINT = 'PATHs stand before all options, or behind "--": --profile paper -- pictures/'
"""An option that takes one or two values would take a PATH behind them for another value."""
NOT_UTF8 = 'its name is not UTF-8, expected another one'


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='evaluate',
        description='Compare labels with detections, those of files or of a run over PATHs; or, without labels, run '
        'over recordings and say how steady the detections are. Writes evaluation.json and evaluation.html. The same '
        'call again goes on where it was interrupted.',
        epilog=HINT,
    )
    parser.add_argument('--labels', metavar='FILE', help='COCO labels; without: PATHs are only watched')
    parser.add_argument('--lanes', metavar='FILE', help='lane polygons (default: *_lanes.json, lane_polygons.json)')
    parser.add_argument('--detections', metavar='FILE', nargs='+', help='one or two files as detect_images writes them')
    profiles = '{%s}' % ','.join(PROFILES)
    parser.add_argument('--profile', metavar=profiles, type=profile, nargs='+', help='one or two detectors to run')
    parser.add_argument('--calibration', metavar='DIR', default='', help='folder with camera_{intrinsic,extrinsic}/')
    parser.add_argument('--vehicle', metavar='NAME', default='', help='robot whose calibration is used')
    parser.add_argument(
        '--robot', metavar='NAME', default='', help='whose topics are read, if a bag has several robots'
    )
    parser.add_argument('--config', metavar='DIR', nargs='+', help='one or two folders of settings (default: our own)')
    parser.add_argument(
        '--min-confidence', metavar='C', type=confidence, default=0.0, help='leave out what is less sure'
    )
    parser.add_argument('--sequence', action='store_true', help="a folder's pictures follow each other, 30 a second")
    parser.add_argument('--empty', action='store_true', help='nothing stands in the recordings: all found is false')
    parser.add_argument('--by', metavar='FIELD', nargs='+', help='of the labelled pictures, to group them by')
    parser.add_argument('--worst', metavar='N', type=tool.count, default=24, help='pictures on the page (default: 24)')
    parser.add_argument(
        '--jobs', metavar='N', type=tool.count, help='processes (default: one a core, for --detections 1)'
    )
    parser.add_argument('--scheduler', metavar='ADDRESS', default='', help='of Dask, as tcp://10.0.0.1:8786')
    parser.add_argument('--output', metavar='DIR', required=True, help='folder to write, new or of the same call')
    parser.add_argument('paths', metavar='PATH', nargs='*', help='pictures, folders of pictures, and bags')
    return tool.run(lambda options: _main(parser, options), parser, arguments)


def profile(value: str) -> str:
    """Argument type: one of PROFILES."""
    if value not in PROFILES:
        words = (value, ' or '.join(PROFILES), HINT)
        raise argparse.ArgumentTypeError('%s is no profile, expected %s; %s' % words)
    return value


def confidence(value: str) -> float:
    """Argument type: 0 to 1."""
    number = float(value)
    if not 0 <= number <= 1:
        raise argparse.ArgumentTypeError('%s, expected 0 to 1' % value)
    return number


def _main(parser: argparse.ArgumentParser, options: Namespace) -> int:
    wrong = _wrong_use(options)
    if wrong:
        parser.error(wrong)
    figures.binomial_test()
    for path in _named(options):
        if readable(path) != path:
            raise ToolError('%s: %s' % (readable(path), NOT_UTF8))
    for path in options.paths:
        if not os.path.exists(path):
            raise ToolError('%s does not exist, expected a picture, a folder of pictures or a bag' % path)
    runs = _runs(options)
    with contextlib.closing(_store(options, runs)) as store:
        return _with_labels(options, runs, store) if options.labels else _without_labels(options, runs, store)


def _wrong_use(options: Namespace) -> str:
    """What is wrong with the call, '' when nothing is."""
    for name in ('detections', 'profile', 'config'):
        if len(getattr(options, name) or []) > 2:
            return '--%s: expected one or two; %s' % (name, HINT)
    if options.jobs and options.scheduler:
        return '--jobs is for this machine, a scheduler has its own workers: expected one of them'
    if not options.labels:
        for name in ('detections', 'lanes', 'by', 'min_confidence'):
            if getattr(options, name):
                return '--%s needs --labels' % name.replace('_', '-')
        return '' if options.paths else 'nothing to evaluate, expected --labels, or recordings as PATH; %s' % HINT
    if options.empty:
        return '--empty is for recordings without labels, expected it without --labels'
    if not options.detections:
        return '' if options.paths else '--labels needs --detections, or PATHs to run over; %s' % HINT
    for name in ('profile', 'config', 'calibration', 'vehicle', 'sequence'):
        if getattr(options, name):
            return '--%s is for a run, --detections are results already: expected one of them' % name
    return ''


def _named(options: Namespace) -> List[str]:
    """All files and folders of the call."""
    single = [options.labels, options.lanes, options.calibration, options.output]
    return [path for path in single if path] + (options.detections or []) + (options.config or []) + options.paths


# What is compared


def _runs(options: Namespace) -> List[tasks.Run]:
    if options.detections:
        names = _different([os.path.splitext(os.path.basename(path))[0] for path in options.detections])
        return [tasks.Run(name, 'detections of %s' % path) for name, path in zip(names, options.detections)]
    calibration = tool.calibration_of(options)
    profiles, configs = options.profile or [None], options.config or ['']
    count = max(len(profiles), len(configs))
    pairs = list(zip(*(values * (count // len(values)) for values in (profiles, configs))))
    settings = [tool.detection_settings(Namespace(profile=profile, config=config)) for profile, config in pairs]
    names = [item.profile for item in settings]
    if len(configs) > 1 and len(set(names)) < len(names):
        names = [os.path.basename(os.path.normpath(config)) for config in configs]
    camera = []
    if options.vehicle:
        camera = [
            *(['--calibration', options.calibration] if options.calibration else []),
            '--vehicle',
            options.vehicle,
        ]
    found = []
    for name, item, (_, config) in zip(_different(names), settings, pairs):
        what = 'profile %s' % item.profile
        what += ', settings %s' % config if config else ''
        what += ', calibration of %s' % options.vehicle if options.vehicle else ', default calibration'
        arguments = (*camera, *(['--config', config] if config else []), '--profile', item.profile)
        key = hashlib.sha256(repr((calibration, item)).encode()).hexdigest()
        found.append(tasks.Run(name, what, key, arguments, calibration, item))
    return found


def _different(names: Sequence[str]) -> List[str]:
    """One name each, even when both are called the same."""
    return list(names) if len(set(names)) == len(names) else ['%s (%d)' % (n, i + 1) for i, n in enumerate(names)]


def _store(options: Namespace, runs: Sequence[tasks.Run]) -> sqlite3.Connection:
    """Make or open the output folder. Raises ToolError when another evaluation is in it."""
    os.makedirs(options.output, exist_ok=True)
    path = os.path.join(options.output, STORE)
    if os.listdir(options.output) and not os.path.exists(path):
        raise ToolError('%s is not empty, expected a new folder, or that of the same call' % options.output)
    names = ('min_confidence', 'sequence', 'empty', 'by', 'worst', 'robot')
    call = {
        'options': json.dumps({name: getattr(options, name) for name in names}),
        'PATHs': json.dumps([os.path.abspath(path) for path in options.paths]),
        'labels': _hash([options.labels] if options.labels else []),
        'lanes': _hash([path for path in [_lanes(options)] if path]),
        'detections': _hash(options.detections or []),
        'settings or calibration': json.dumps([(run.name, run.key) for run in runs]),
        'code': _hash(_code()),
    }
    return finished.open_store(path, call)


def _lanes(options: Namespace) -> Optional[str]:
    """The file of lane polygons, named or beside the labels."""
    if options.lanes or not options.labels:
        return options.lanes
    beside = os.path.join(os.path.dirname(os.path.abspath(options.labels)), 'lane_polygons.json')
    names = (os.path.splitext(options.labels)[0] + '_lanes.json', beside)
    return next((path for path in names if os.path.exists(path)), None)


def _hash(paths: Sequence[str]) -> str:
    """Of the files' content."""
    digest = hashlib.sha256()
    for path in paths:
        with open(path, 'rb') as file:
            for part in iter(lambda: file.read(1 << 20), b''):
                digest.update(part)
        digest.update(b'\0')
    return digest.hexdigest()


def _code() -> List[str]:
    """The files on which results depend: all of the package's core, and of the evaluation what is not the page."""
    here = os.path.dirname(os.path.abspath(__file__))
    folders = (os.path.join(os.path.dirname(here), 'core'), os.path.join(here, 'evaluation'))
    found = [os.path.join(folder, name) for top in folders for folder, _, names in os.walk(top) for name in names]
    looks = ('page.py', 'parts.py', 'cards.py', 'plots.py', 'recordings_page.py', 'figures.py')
    return sorted(path for path in found if path.endswith('.py') and os.path.basename(path) not in looks)


# With labels


def _with_labels(options: Namespace, runs: Sequence[tasks.Run], store: sqlite3.Connection) -> int:
    index = labels.open_index()
    count = labels.add_labels(index, options.labels)
    lanes = _lanes(options)
    if lanes:
        labels.add_lanes(index, lanes)
    for number, path in enumerate(options.detections or []):
        labels.add_detections(index, path, number)
    labels.close_tables(index)
    by = _grouping(options, index)
    job = tasks.Job(tuple(runs), options.min_confidence, by, options.worst)
    total = work.Total(job)
    labels.add_sources(index, _sources(options, labels.folders_of(index), total.broken))
    labels.match_sources(index)
    missing = _Missing()
    files = bool(options.detections)
    if not files:
        missing.count, missing.names = labels.names_without_source(index, MOST_NAMES)
        if missing.count == count:
            raise ToolError(_nothing(total.broken, 'none of %d labelled pictures is in the PATHs' % count))
    pictures = labels.pictures(index, len(runs) if files else 0, [*by, tally.SPEED_FIELD, tally.BLUR_FIELD])
    watched = missing.watch(pictures) if files else pictures
    todo = tasks.label_tasks(watched, files, lambda path: _recording(options, path))
    _do(options, total, work.evaluate_pictures, todo, store, count if files else count - missing.count)
    if not total.pictures:
        raise ToolError(_nothing(total.broken, 'no picture could be evaluated'))
    content = _content(options, total, missing, labels.bad(index, MOST_NAMES))
    _write_numbers(options, content)
    _page().write_page(content, os.path.join(options.output, PAGE), lambda picture: _picture_of(options, picture))
    _say(options, total, content)
    return 0


def _grouping(options: Namespace, index: labels.Index) -> Tuple[str, ...]:
    """The fields by which pictures are grouped. Raises ToolError when one that was asked for cannot be used."""
    names = options.by or tally.GROUPED
    unknown = labels.unknown_fields(index, names)
    large = [name for name in labels.too_many_values(index, names) if name not in tally.PICTURE_BANDS]
    if options.by and unknown:
        raise ToolError('--by %s: no picture of %s has such a field' % (unknown[0], options.labels))
    if options.by and large:
        words = (large[0], labels.MOST_VALUES)
        raise ToolError('--by %s: more than %d values, expected a field that makes groups' % words)
    for name in large:
        print('not grouped by %s: more than %d values' % (name, labels.MOST_VALUES), file=sys.stderr)
    return tuple(name for name in names if name not in unknown and name not in large)


class _Missing:
    """Labelled pictures of which a detections file says nothing: how many, and the first names."""

    def __init__(self) -> None:
        self.count = 0
        self.names: List[str] = []

    def watch(self, pictures: Iterator[labels.LabelledPicture]) -> Iterator[labels.LabelledPicture]:
        """The same pictures, counted."""
        for picture in pictures:
            if None in picture.detected:
                self.count += 1
                self.names += [picture.name] if len(self.names) < MOST_NAMES else []
            yield picture


def _sources(
    options: Namespace, folders_in_names: Sequence[str], broken: tasks.Broken
) -> Iterator[Tuple[str, labels.Source]]:
    """All pictures of the PATHs. A bag that cannot be read is kept as broken."""
    folders = [path for path in options.paths if os.path.isdir(path)]
    inner = [os.path.join(path, name) for path in folders for name in folders_in_names]
    for path in [*options.paths, *(folder for folder in inner if os.path.isdir(folder))]:
        full = os.path.abspath(path)
        files, bags = _contained(full)
        sequence = options.sequence and os.path.isdir(full)
        for number, file in enumerate(files):
            if readable(file) != file:
                broken.add(readable(file), NOT_UTF8)
                continue
            yield file, labels.Source(file, full, number) if sequence else labels.Source(file)
        for bag in bags:
            with _kept_if_broken(bag, broken):
                yield from _bag_sources(bag, _recording(options, bag))


@contextlib.contextmanager
def _kept_if_broken(path: str, broken: tasks.Broken) -> Iterator[None]:
    """A recording that cannot be read is not fatal."""
    try:
        yield
    except ToolError as error:
        broken.add(readable(path), str(error))


def _contained(path: str) -> Tuple[List[str], List[str]]:
    """Pictures and bags of a PATH."""
    if not os.path.isdir(path):
        return ([], [path]) if path.endswith(BAG_ENDING) else ([path], [])
    names = tool.in_order(os.listdir(path))
    files = [os.path.join(path, name) for name in names if name.lower().endswith(tool.PICTURE_ENDINGS)]
    return files, [os.path.join(path, name) for name in names if name.endswith(BAG_ENDING)]


def _bag_sources(path: str, recording: Recording) -> Iterator[Tuple[str, labels.Source]]:
    """A bag's pictures by the names that bag_to_images gives them. Raises ToolError."""
    for number, name, item in named_pictures(recording):
        stamp = border.nanoseconds(item.msg.header.stamp)
        inside = os.path.join(path[: -len(BAG_ENDING)], name + '.jpg')
        yield inside, labels.Source(path, path, number, stamp, item.time)


def _recording(options: Namespace, path: str) -> Recording:
    """A folder, one picture, or a bag. Raises ToolError."""
    if readable(path) != path:
        raise ToolError(NOT_UTF8)
    if os.path.isdir(path) or not path.endswith(BAG_ENDING):
        return open_folder(path, SEQUENCE_RATE)
    return open_bag(path, options.robot)


def _nothing(broken: tasks.Broken, words: str) -> str:
    """The sentence for an evaluation of nothing."""
    if not broken.count:
        return words
    return '%s, %d could not be read, as of %s: %s' % (words, broken.count, *broken.entries[0].values())


# Without labels


def _without_labels(options: Namespace, runs: Sequence[tasks.Run], store: sqlite3.Connection) -> int:
    sheets = os.path.abspath(os.path.join(options.output, SHEETS))
    os.makedirs(sheets, exist_ok=True)
    job = tasks.Job(tuple(runs), sheets=sheets)
    total = work.Total(job)
    found = []
    for path in options.paths:
        files, bags = _contained(os.path.abspath(path))
        for one in [*([os.path.abspath(path)] if files else []), *bags]:
            with _kept_if_broken(one, total.broken):
                found.append(_recording(options, one))
    if not found and not total.broken.count:
        raise ToolError('no pictures and no bags in %s' % ', '.join(options.paths))
    pictures = sum(recording.pictures for recording in found) * len(runs)
    _do(options, total, work.check_recording, tasks.recording_tasks(found, runs), store, pictures)
    if not total.pictures:
        raise ToolError(_nothing(_all_broken(total), 'no picture could be evaluated'))
    content = {
        **_head(options, total),
        'empty': options.empty,
        'runs': [
            {**_run_head(run), 'figures': recordings.figures(_in_order(checked, found), options.empty)}
            for run, checked in zip(runs, total.checked)
        ],
    }
    _write_numbers(options, content)
    _recordings_page().write_recordings_page(content, os.path.join(options.output, PAGE), sheets)
    for run in content['runs']:
        said = run['figures']['total']
        print('%s: %d pictures, %d detections' % (run['name'], said['pictures'], said['detections']))
    _say_broken(_all_broken(total))
    print(os.path.join(options.output, PAGE))
    return 0


def _in_order(checked: Sequence[Mapping[str, Any]], found: Sequence[Recording]) -> List[recordings.RecordingChecked]:
    order = {recording.path: number for number, recording in enumerate(found)}
    return [recordings.from_json(item) for item in sorted(checked, key=lambda item: order[item['path']])]


def _all_broken(total: work.Total) -> tasks.Broken:
    """Recordings and single pictures; of one run, the others had the same pictures."""
    broken = tasks.Broken(total.broken.count, list(total.broken.entries))
    for item in total.checked[0]:
        broken.count += item['broken'] - len(item['why_broken'])
        for sentence in item['why_broken']:
            broken.add(item['path'], sentence)
    return broken


# Both


def _do(
    options: Namespace,
    total: work.Total,
    function: Any,
    todo: Iterator[tasks.Task],
    store: sqlite3.Connection,
    pictures: int,
) -> None:
    """Do what is not finished, and add everything up."""
    before = finished.finished_count(store)
    if before:
        print('%s: going on, %d tasks are finished already' % (options.output, before))
    steps = _steps(options, total, function, todo, store)
    for _ in tool.progress(steps, 'evaluating', pictures):
        pass


def _steps(
    options: Namespace, total: work.Total, function: Any, todo: Iterator[tasks.Task], store: sqlite3.Connection
) -> Iterator[None]:
    """One step a picture."""
    before = 0

    def unfinished() -> Iterator[tasks.Task]:
        nonlocal before
        for task in todo:
            result = finished.finished_result(store, task)
            if result is None:
                yield task
            else:
                total.add(result)
                before += result['pictures']

    waiting = unfinished()
    first = next(waiting, None)
    if first is not None:
        for task, result, why in _done(options, function, total.job, itertools.chain([first], waiting)):
            if result is None:
                for path in task.paths:
                    total.broken.add(path, 'its task failed: %s' % why)
                continue
            finished.store_result(store, task, result)
            total.add(result)
            yield from (None for _ in range(result['pictures'] + before))
            before = 0
    yield from (None for _ in range(before))


def _done(options: Namespace, function: Any, job: tasks.Job, todo: Iterator[tasks.Task]) -> Iterator[workers.Done]:
    """By workers; comparing results of files is faster than starting these."""
    jobs = options.jobs or (1 if options.detections else os.cpu_count() or 1)
    if jobs == 1 and not options.scheduler:
        yield from workers.work_here(function, job, todo)
        return
    with workers.workers_of(jobs, options.scheduler) as client:
        yield from workers.work_through(client, function, job, todo)


def _page() -> Any:
    """The module that writes pages: its libraries take a second to load, and workers never need them."""
    from obst_avoid.offline.evaluation import page

    return page


def _recordings_page() -> Any:
    """Likewise."""
    from obst_avoid.offline.evaluation import recordings_page

    return recordings_page


def _head(options: Namespace, total: work.Total) -> Dict[str, Any]:
    broken = sorted(total.broken.entries, key=lambda entry: (entry['path'], entry['why']))
    return {
        'tool': 'evaluate',
        'version': str(rospkg.RosPack().get_manifest('obst_avoid').version),
        'options': vars(options),
        'labels': options.labels,
        'pictures': total.pictures,
        'broken': broken,
        'broken_count': total.broken.count,
    }


def _run_head(run: tasks.Run) -> Dict[str, Any]:
    return {'name': run.name, 'what': run.what, 'arguments': list(run.arguments)}


def _content(options: Namespace, total: work.Total, missing: _Missing, bad: Tuple[int, List[str]]) -> Dict[str, Any]:
    """What evaluation.json says."""
    return {
        **_head(options, total),
        'missing': missing.names,
        'missing_count': missing.count,
        'bad_entries': bad[1],
        'bad_count': bad[0],
        'constants': {
            'min_height': matching.MIN_HEIGHT,
            'min_bottom': matching.MIN_BOTTOM,
            'near_bottom': matching.NEAR_BOTTOM,
            'iou': matching.MIN_IOU,
            'grow': matching.GROWTH,
            'foot_top': matching.FOOT_TOP,
            'area_factor': matching.AREA_FACTOR,
            'min_confidence': options.min_confidence,
        },
        'runs': [_run_content(total, number) for number in range(len(total.job.runs))],
        'comparison': total.comparison,
    }


def _run_content(total: work.Total, number: int) -> Dict[str, Any]:
    groups, bands = total.groups[number], total.bands[number]
    everything = groups['all']['all']
    others = [kept['all']['all'] for kept in total.groups if kept is not groups]
    words = {
        name: {value: figures.figures(values[value]) for value in _ordered(name, values)}
        for name, values in sorted(groups.items())
        if name != 'all'
    }
    return {
        **_run_head(total.job.runs[number]),
        'groups': {'all': figures.figures(everything), **words},
        'bands': {
            band.name: {
                value: figures.object_figures(bands[band.name][value])
                for value in _ordered(band.name, bands[band.name])
            }
            for band in tally.OBJECT_BANDS
            if band.name in bands
        },
        **figures.curves(everything),
        'position_histogram': figures.written_histogram(everything, 'position', others),
        'milliseconds_histogram': figures.written_histogram(everything, 'milliseconds', others),
        'worst': worst.choose_worst(total.worst[number], total.job.worst),
    }


def _ordered(name: str, values: Mapping[str, Any]) -> List[str]:
    """A group's values in the order of its bands, or of the alphabet."""
    bands = {band.name: band for band in (*tally.PICTURE_BANDS.values(), *tally.OBJECT_BANDS)}
    return [value for value in (bands[name].order() if name in bands else sorted(values)) if value in values]


def _write_numbers(options: Namespace, content: Mapping[str, Any]) -> None:
    tool.write_json(os.path.join(options.output, NUMBERS), content)


def _picture_of(options: Namespace, picture: Mapping[str, Any]) -> Optional[Array]:
    """(H, W, 3) uint8 BGR of a picture on the page; None when it cannot be had."""
    try:
        if picture['in_bag']:
            return _picture_in_bag(options, picture['in_bag'])
        return read_picture(picture['path']) if picture['path'] else None
    except (PictureError, ToolError, OSError, rosbag.ROSBagException):
        return None


def _picture_in_bag(options: Namespace, place: Mapping[str, Any]) -> Optional[Array]:
    recording = open_bag(place['path'], options.robot)
    topic, time = recording.topics[recording.picture_role], border.ros_time(place['time'])
    with rosbag.Bag(place['path']) as bag:
        for _, msg, _ in bag.read_messages(topics=[topic], start_time=time, end_time=time):
            if border.nanoseconds(msg.header.stamp) == place['stamp']:
                return picture_of(Recorded(recording.picture_role, place['time'], msg))
    return None


def _say(options: Namespace, total: work.Total, content: Mapping[str, Any]) -> None:
    """The main numbers for the terminal, and what was not evaluated."""
    for run in content['runs']:
        said = run['groups']['all']
        parts = ['%d pictures' % said['frames']]
        for name, key in (('recall', 'recall'), ('of the right kind', 'recall_kind'), ('precision', 'precision')):
            if said[key]:
                parts.append('%s %.3f (%.3f to %.3f)' % (name, said[key]['value'], *said[key]['ci95']))
        if said['false_alarms']:
            parts.append('%.3f false alarms a picture' % said['false_alarms']['per_frame'])
        print('%s: %s' % (run['name'], ', '.join(parts)))
    _say_broken(total.broken)
    if content['missing_count']:
        what = 'no detections, counted as nothing found' if options.detections else 'not in the PATHs, left out'
        print(
            '%d labelled pictures, as of %s: %s' % (content['missing_count'], content['missing'][0], what),
            file=sys.stderr,
        )
    if content['bad_count']:
        print('%d bad entries, as of %s' % (content['bad_count'], content['bad_entries'][0]), file=sys.stderr)
    print(os.path.join(options.output, PAGE))


def _say_broken(broken: tasks.Broken) -> None:
    for entry in sorted(broken.entries, key=lambda entry: entry['path'])[:MOST_NAMES]:
        print('evaluate: %s: %s' % (entry['path'], entry['why']), file=sys.stderr)
    if broken.count > MOST_NAMES:
        print('evaluate: and %d more' % (broken.count - MOST_NAMES), file=sys.stderr)
