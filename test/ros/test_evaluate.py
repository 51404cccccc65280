"""The tool `evaluate` as a whole: its files, its errors, what is broken, interrupted, run in parallel, and bags."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import contextlib
import itertools
import json
import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterator, List, Tuple

import pytest
import rosbag
from helpers import DUCKIE, REPOSITORY, SCENE, free_port, jpeg_of, nanoseconds, wait_for
from labelled import DUCKIE as DUCKIE_ID
from labelled import coco, detections, found, jittered, many, written
from unit.drawn import Scene

from obst_avoid import msg as messages
from obst_avoid.offline import bag_to_images, detect_images, evaluate, images_to_bag
from obst_avoid.offline.evaluation import tasks, work, workers
from obst_avoid.offline.evaluation.work import evaluate_pictures
from obst_avoid.offline.tool import ToolError

DEFAULT = ['--calibration', str(REPOSITORY / 'config' / 'calibrations'), '--vehicle', 'default']
PAPER = [*DEFAULT, '--profile', 'paper']
BOX = [300.0, 200.0, 40.0, 50.0]
COPIES = 50
"""Of each of six drawn pictures: 300 pictures, six tasks."""
SCRIPT = str(REPOSITORY / 'scripts' / 'evaluate')
LIMIT = 120.0
"""[s] for a whole evaluation on a busy machine."""


def read(folder: Path) -> Any:
    return json.loads((folder / 'evaluation.json').read_text())


def timeless(content: Any) -> Any:
    """Without what another run of the same work may say otherwise: times and options."""
    if isinstance(content, dict):
        return {
            key: timeless(value) for key, value in content.items() if 'milliseconds' not in key and key != 'options'
        }
    return [timeless(item) for item in content] if isinstance(content, list) else content


@pytest.fixture(scope='module')
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder: pictures/, and labels.json with what `paper` finds in the pictures drawn, and a cone that it misses."""
    folder = tmp_path_factory.mktemp('drawn')
    scenes = [(SCENE, 0), (Scene(), 0), (Scene((DUCKIE,)), 1), (SCENE, 2), (Scene((DUCKIE,)), 3), (Scene(), 4)]
    (folder / 'pictures').mkdir()
    for number, (scene, seed) in enumerate(scenes):
        for copy in range(COPIES):
            (folder / 'pictures' / ('%d_%02d.jpg' % (number, copy))).write_bytes(jpeg_of(scene, seed))
    first = [str(folder / 'pictures' / ('%d_00.jpg' % number)) for number in range(len(scenes))]
    output = folder / 'det.json'
    assert detect_images.main([*PAPER, '--output', str(output), *first]) == 0
    boxes: Dict[str, Any] = {}
    for image in json.loads(output.read_text())['images']:
        seen = [(1 if item['kind'] == 'duckie' else 2, item['bbox']) for item in image['obstacles']]
        for copy in range(COPIES):
            boxes['%s_%02d.jpg' % (image['file_name'][0], copy)] = seen
    boxes['5_49.jpg'] = [*boxes['5_49.jpg'], (2, [20.0, 400.0, 40.0, 50.0])]
    written(folder / 'labels.json', coco(boxes))
    return folder


@pytest.fixture(scope='module')
def whole(drawn: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What one process says of all drawn pictures, uninterrupted."""
    output = tmp_path_factory.mktemp('whole') / 'out'
    call = [*PAPER, '--labels', str(drawn / 'labels.json'), '--jobs', '1', '--output', str(output)]
    assert evaluate.main([*call, str(drawn / 'pictures')]) == 0
    return read(output)


def finished(output: Path) -> Dict[str, bytes]:
    """The stored results by task."""
    if not (output / 'work.sqlite').exists():
        return {}
    store = sqlite3.connect(str(output / 'work.sqlite'), timeout=20)
    try:
        return dict(store.execute('SELECT task, result FROM finished'))
    except sqlite3.OperationalError:  # not made yet
        return {}
    finally:
        store.close()


def interrupted(call: List[str], output: Path) -> Tuple[int, str]:
    """Exit code and what was said of an evaluation that Ctrl-C reaches as soon as a task is finished."""
    before = signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # else ignored where a shell runs it behind itself
    process = subprocess.Popen(
        [sys.executable, SCRIPT, *call, '--jobs', '2'],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    signal.signal(signal.SIGINT, before)
    try:
        wait_for(lambda: finished(output) or process.poll() is not None, LIMIT, 'a finished task')
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C does: the workers get it, too
        errors = process.communicate(timeout=LIMIT)[1].decode()
    finally:
        process.kill()
    return process.returncode, errors


def labelled(**fields: Any) -> Any:
    """One labelled duckie with these fields."""
    content = coco({'a.jpg': [(1, BOX)]})
    content['annotations'][0].update(fields)
    return content


def broken_after(messages_of: Any, count: int) -> Any:
    """In place of recording.messages."""

    def called(recording: Any, motion: bool) -> Any:
        yield from itertools.islice(messages_of(recording, motion), count)
        raise ToolError('%s is damaged' % recording.path)

    return called


def fail_once(function: Any) -> Any:
    """The function, which fails when it is called first."""
    errors = [OverflowError('odd')]

    def called(*arguments: Any) -> Any:
        if errors:
            raise errors.pop()
        return function(*arguments)

    return called


def fail_at_0_00(job: tasks.Job, task: tasks.Task) -> Any:
    """In place of evaluate_pictures."""
    if task.pictures[0].name == '0_00.jpg':
        raise RuntimeError('oh')
    return evaluate_pictures(job, task)


class TestFiles:
    def test_what_is_written(self, tmp_path: Path) -> None:
        labels = written(tmp_path / 'l.json', many(60))
        det = written(tmp_path / 'd.json', jittered(many(60), 1))
        output = tmp_path / 'out'
        assert evaluate.main(['--labels', labels, '--detections', det, '--output', str(output)]) == 0
        assert sorted(os.listdir(output)) == ['evaluation.html', 'evaluation.json', 'work.sqlite']
        content = read(output)
        assert (content['tool'], content['pictures'], content['broken'], content['missing_count']) == (
            'evaluate', 60, [], 0,
        )  # fmt: skip
        (run,) = content['runs']
        assert list(run['groups']) == ['all', 'lighting']
        assert list(run['groups']['lighting']) == ['bright', 'dark', 'red']
        assert set(run['bands']) == {'distance [m]', 'box height [px]', 'radius [m]'}
        for band in run['bands'].values():
            assert sum(item['relevant_gt'] for item in band.values()) == run['groups']['all']['relevant_gt']
        assert sum(run['position_histogram']['counts']) == run['groups']['all']['position']['n']
        assert sum(run['milliseconds_histogram']['counts']) == 60
        assert len(run['worst']) == 24
        assert [item['score'] for item in run['worst']] == sorted((i['score'] for i in run['worst']), reverse=True)
        page = (output / 'evaluation.html').read_text()
        assert run['worst'][0]['name'] in page

    def test_two_files_side_by_side(self, tmp_path: Path) -> None:
        labels = written(tmp_path / 'l.json', coco({'a.jpg': [(1, BOX)], 'b.jpg': [(2, BOX)], 'c.jpg': [(1, BOX)]}))
        old = detections({'a.jpg': [found('duckie', BOX)], 'b.jpg': [], 'c.jpg': []})
        new = detections({'a.jpg': [found('duckie', BOX)], 'b.jpg': [found('cone', BOX)], 'c.jpg': []})
        new['images'][2]['obstacles'] = [found('cone', [50, 300, 30, 30])]
        files = [written(tmp_path / 'old.json', old), written(tmp_path / 'new.json', new)]
        assert evaluate.main(['--labels', labels, '--detections', *files, '--output', str(tmp_path / 'out')]) == 0
        content = read(tmp_path / 'out')
        assert [run['name'] for run in content['runs']] == ['old', 'new']
        assert [run['groups']['all']['recall']['k'] for run in content['runs']] == [1, 2]
        said = content['comparison']
        assert (said['both'], said['only'], said['neither']) == (1, {'old': 0, 'new': 1}, 1)
        assert said['false_alarms'] == {'old': 0, 'new': 1}
        assert [item['name'] for item in said['pictures']] == ['b.jpg', 'c.jpg']

    def test_grouping_by_other_fields(
        self, tmp_path: Path, sentence: Callable[[str], str], capsys: pytest.CaptureFixture
    ) -> None:
        content = coco({'%d.jpg' % number: [(1, BOX)] for number in range(4)}, weather='rain', subset='x')
        files = ['--labels', written(tmp_path / 'l.json', content)]
        files += ['--detections', written(tmp_path / 'd.json', detections({'0.jpg': []}))]
        assert evaluate.main([*files, '--by', 'weather', '--output', str(tmp_path / 'out')]) == 0
        assert list(read(tmp_path / 'out')['runs'][0]['groups']) == ['all', 'weather']
        capsys.readouterr()
        assert evaluate.main([*files, '--by', 'nothing', '--output', str(tmp_path / 'other')]) == 1
        assert '--by nothing: no picture' in sentence('evaluate')

    def test_the_pictures_of_the_worst_are_found(self, drawn: Path, tmp_path: Path) -> None:
        det = written(tmp_path / 'd.json', detections({'pictures/0_00.jpg': [], '1_00.png': [found('duckie', BOX)]}))
        labels = written(tmp_path / 'l.json', coco({'pictures/0_00.jpg': [(1, BOX)], '1_00.jpg': [(1, BOX)]}))
        call = ['--labels', labels, '--detections', det, '--output', str(tmp_path / 'out'), str(drawn)]
        assert evaluate.main([*call, str(drawn / 'pictures' / '1_00.jpg')]) == 0
        content = read(tmp_path / 'out')
        assert [item['path'] for item in content['runs'][0]['worst']] == [str(drawn / 'pictures' / '0_00.jpg')]
        assert (content['missing_count'], content['runs'][0]['groups']['all']['recall']['k']) == (0, 1), 'by stem'
        assert (tmp_path / 'out' / 'evaluation.html').read_text().count('data:image/jpeg') == 1

    def test_entries_that_are_bad_are_counted_and_named(self, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
        labels = written(tmp_path / 'l.json', coco({'a.jpg': [(1, BOX)], 'b.jpg': []}))
        good = found('duckie', BOX)
        bad: List[Any] = [
            {**good, 'kind': 'frog'}, {**good, 'bbox': [1, 2, 3]}, {**good, 'bbox': [1, 2, 0, 3]},
            {**good, 'bbox': [1, 2, 'x', 3]}, {**good, 'confidence': 'high'}, {**good, 'in_lane': 'yes'}, 7,
            {**good, 'confidence': 1.01}, {**good, 'confidence': -0.1}, {**good, 'x': 1e305}, {**good, 'radius': 'big'},
        ]  # fmt: skip
        content = detections({'a.jpg': [*bad, good]})
        content['images'][0]['width'] = 320
        det = written(tmp_path / 'd.json', content)
        assert evaluate.main(['--labels', labels, '--detections', det, '--output', str(tmp_path / 'out')]) == 0
        said = read(tmp_path / 'out')
        assert said['bad_count'] == len(said['bad_entries']) == 12
        assert said['bad_entries'][0].startswith('a.jpg: bad obstacle {"kind": "frog"')
        assert said['bad_entries'][-1] == 'a.jpg: size 320x480, labels 640x480'
        assert (said['missing'], said['missing_count']) == (['b.jpg'], 1)
        assert said['runs'][0]['groups']['all']['recall']['value'] == 1
        errors = capsys.readouterr().err
        assert '12 bad entries' in errors
        assert '1 labelled pictures, as of b.jpg: no detections' in errors

    @pytest.mark.parametrize(
        ('labels', 'words'),
        [
            ('{"images": [', 'is not JSON'),
            ('hello', 'is not JSON'),
            ('{}', 'has no category duckie or cone'),
            ({'categories': [{'id': 1, 'name': 'dog'}]}, 'found: dog'),
            ({**coco({'a.jpg': []}), 'images': []}, 'has no images'),
            ({**coco({'a.jpg': []}), 'images': [{'id': 1}]}, 'image 1 is {"id": 1}, expected id and file_name'),
            ({**coco({'a.jpg': []}), 'images': [{'id': 1, 'file_name': 'a'}]}, 'a has width missing'),
            ({**coco({'a.jpg': []}), 'annotations': [{'image_id': 1, 'category_id': 9, 'bbox': BOX}]}, 'category_id 9'),
            ({**coco({'a.jpg': []}), 'annotations': [{'image_id': 1, 'category_id': 1}]}, 'has bbox missing'),
            ({**coco({'a.jpg': []}), 'annotations': [{'category_id': 1, 'bbox': BOX}]}, 'has no image_id'),
            ({key: value for key, value in coco({'a.jpg': []}).items() if key != 'annotations'}, 'no list of annotat'),
            ({**coco({'a.jpg': []}), 'annotations': {}}, 'no list of annotations, expected one, empty or not'),
            ({**coco({'a.jpg': []}), 'annotations': 'none'}, 'has no list of annotations'),
            (labelled(in_lane='false'), 'annotation 1 has in_lane "false", expected true or false'),
            (labelled(iscrowd='0'), 'annotation 1 has iscrowd "0", expected true or false'),
            (labelled(riding=[]), 'annotation 1 has riding [], expected true or false'),
            (labelled(x=1e305), 'annotation 1 has x 1e+305, expected a number below 1000 (m)'),
            (labelled(radius='big'), 'annotation 1 has radius "big"'),
            (coco({'a.jpg': []}, speed='fast'), 'a.jpg has speed "fast", expected a finite number'),
            (coco({'a.jpg': []}, blur_px=[1]), 'a.jpg has blur_px [1], expected a finite number'),
            (coco({'a.jpg': [(1, [1.0, 2.0, 10**400, 3.0])]}), 'l.json'),
            (coco({'a.jpg': [(1, [1.0, 2.0, float('nan'), 3.0])]}), 'expected UTF-8 JSON without NaN'),
            (json.dumps(coco({'a.jpg': []})).encode('utf-16'), 'expected UTF-8 JSON without NaN'),
            (coco({'a.jpg': [(1, [1.0, 2.0, 0.0, 3.0])]}), 'width and height > 0'),
            (
                {**coco({'a.jpg': []}), 'images': coco({'a.jpg': []})['images'] * 2},
                'two images of one',
            ),
        ],
    )
    def test_labels_that_are_not_as_expected(
        self, labels: Any, words: str, tmp_path: Path, sentence: Callable[[str], str]
    ) -> None:
        path, det = written(tmp_path / 'l.json', labels), written(tmp_path / 'd.json', detections({'a.jpg': []}))
        assert evaluate.main(['--labels', path, '--detections', det, '--output', str(tmp_path / 'out')]) == 1
        said = sentence('evaluate')
        assert words in said
        assert path in said

    def test_what_else_may_stand_in_labels(self, tmp_path: Path) -> None:
        content = labelled(in_lane=0, iscrowd=False, riding=None)
        content['annotations'].append({'id': 2, 'image_id': 1, 'category_id': 3, 'bbox': [1, 2, 0, 3]})
        labels = written(tmp_path / 'l.json', b'\xef\xbb\xbf' + json.dumps(content).encode())
        det = written(tmp_path / 'd.json', detections({'a.jpg': [found('duckie', BOX, in_lane=True)]}))
        assert evaluate.main(['--labels', labels, '--detections', det, '--output', str(tmp_path / 'out')]) == 0
        said = read(tmp_path / 'out')
        assert said['runs'][0]['groups']['all']['side']['outside_called_inside'] == 1
        expected = 'expected [left, top, width, height], finite, width and height > 0'
        assert said['bad_entries'] == ['%s: annotation 2 has bbox [1, 2, 0, 3], %s' % (labels, expected)]

    def test_an_odd_value_costs_its_picture_only(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        labels = written(tmp_path / 'l.json', coco({'a.jpg': [(1, BOX)], 'b.jpg': [(1, BOX)]}))
        det = written(tmp_path / 'd.json', detections({name: [found('duckie', BOX)] for name in ('a.jpg', 'b.jpg')}))
        monkeypatch.setattr(work, 'tally_of_label', fail_once(work.tally_of_label))
        assert evaluate.main(['--labels', labels, '--detections', det, '--output', str(tmp_path / 'out')]) == 0
        said = read(tmp_path / 'out')
        assert said['broken'] == [{'path': 'a.jpg', 'why': 'OverflowError: odd'}]
        assert (said['pictures'], said['runs'][0]['groups']['all']['relevant_gt']) == (1, 1)

    @pytest.mark.parametrize(
        ('case', 'labelled_as', 'found_as', 'missing'),
        [
            ('one name in two folders', ['a/1.jpg', 'b/1.jpg'], ['a/1.jpg'], ['b/1.jpg']),
            ('a row that could be of both', ['a/1.jpg', 'b/1.jpg'], ['1.jpg'], ['a/1.jpg', 'b/1.jpg']),
            ('two endings', ['1.jpg', '1.png'], ['1.jpg'], ['1.png']),
            ('two endings of neither', ['1.jpg', '1.png'], ['1.bmp'], ['1.jpg', '1.png']),
            ('two rows for one', ['1.jpg'], ['a/1.jpg', 'b/1.jpg'], ['1.jpg']),
            ('by base name', ['a/1.jpg'], ['1.jpg'], []),
            ('by stem', ['a/1.jpg'], ['b/1.png'], []),
        ],
    )
    def test_no_row_is_taken_twice(
        self, case: str, labelled_as: List[str], found_as: List[str], missing: List[str], tmp_path: Path
    ) -> None:
        labels = written(tmp_path / 'l.json', coco({name: [(1, BOX)] for name in labelled_as}))
        det = written(tmp_path / 'd.json', detections({name: [found('duckie', BOX)] for name in found_as}))
        assert evaluate.main(['--labels', labels, '--detections', det, '--output', str(tmp_path / 'out')]) == 0
        said = read(tmp_path / 'out')
        assert said['missing'] == missing, case
        assert said['runs'][0]['groups']['all']['recall']['k'] == len(labelled_as) - len(missing)

    @pytest.mark.parametrize(
        ('content', 'words'),
        [
            ('[', 'is not JSON'),
            ('{}', 'has no images'),
            ({'images': [{'obstacles': []}]}, 'expected a file_name'),
            ({'images': [{'file_name': 'a.jpg'}]}, 'a.jpg has no obstacles'),
        ],
    )
    def test_detections_that_are_not_as_expected(
        self, content: Any, words: str, tmp_path: Path, sentence: Callable[[str], str]
    ) -> None:
        labels, det = written(tmp_path / 'l.json', coco({'a.jpg': []})), written(tmp_path / 'd.json', content)
        assert evaluate.main(['--labels', labels, '--detections', det, '--output', str(tmp_path / 'out')]) == 1
        assert words in sentence('evaluate')

    def test_lanes(self, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        content = coco({'a.jpg': [], 'b.jpg': []}, complete='partly')
        files = ['--labels', written(tmp_path / 'l.json', content)]
        det = detections({name: [found('duckie', BOX)] for name in ('a.jpg', 'b.jpg')})
        files += ['--detections', written(tmp_path / 'd.json', det)]
        road = [{'label': 'Ego Lane', 'points': [[0, 0], [640, 0], [640, 480], [0, 480]]}]
        written(tmp_path / 'l_lanes.json', {'a.png': {'polygons': road}})
        assert evaluate.main([*files, '--output', str(tmp_path / 'out')]) == 0
        groups = read(tmp_path / 'out')['runs'][0]['groups']
        assert groups['all']['false_alarms']['count'] == groups['all']['false_alarms']['valid_frames'] == 1
        assert groups['lane polygons']['with']['frames'] == 1
        other = written(tmp_path / 'other.json', {'a.png': {'polygons': [{'label': 'Ego Lane', 'points': [[0]]}]}})
        assert evaluate.main([*files, '--lanes', other, '--output', str(tmp_path / 'out2')]) == 1
        sentence('evaluate')
        assert (
            evaluate.main([*files, '--lanes', written(tmp_path / 'n.json', [1]), '--output', str(tmp_path / 'o')]) == 1
        )
        assert 'has no lane polygons, expected a mapping' in sentence('evaluate')
        assert (
            evaluate.main([*files, '--lanes', written(tmp_path / 'n.json', {}), '--output', str(tmp_path / 'p')]) == 0
        )


class TestUse:
    @pytest.mark.parametrize(
        'arguments',
        [
            [],
            ['--output', 'o'],
            ['--labels', 'l.json', '--output', 'o'],
            ['--labels', 'l.json', '--detections', 'd.json'],
            ['--detections', 'd.json', '--output', 'o', 'a.jpg'],
            ['--labels', 'l.json', '--empty', '--output', 'o', 'a.jpg'],
            ['--labels', 'l.json', '--detections', 'd.json', '--profile', 'paper', '--output', 'o'],
            ['--labels', 'l.json', '--detections', 'd.json', '--sequence', '--output', 'o'],
            ['--labels', 'l.json', '--detections', 'd.json', 'e.json', 'f.json', '--output', 'o'],
            ['--labels', 'l.json', '--profile', 'magic', '--output', 'o', 'a.jpg'],
            ['--lanes', 'x.json', '--output', 'o', 'a.jpg'],
            ['--by', 'x', '--output', 'o', '--', 'a.jpg'],
            ['--jobs', '2', '--scheduler', 'tcp://x:1', '--output', 'o', 'a.jpg'],
            ['--jobs', '0', '--output', 'o', 'a.jpg'],
            ['--min-confidence', '2', '--output', 'o', 'a.jpg'],
        ],
    )
    def test_wrong_use(self, arguments: List[str], capsys: pytest.CaptureFixture, tmp_path: Path) -> None:
        with pytest.raises(SystemExit) as ended:
            evaluate.main(arguments)
        assert ended.value.code == 2
        assert 'usage: evaluate' in capsys.readouterr().err

    @pytest.mark.parametrize(
        'arguments',
        [
            ['--profile', 'paper', 'pictures/'],
            ['--profile', 'paper', '--config', 'a', 'b', 'pictures/'],
            ['--labels', 'l.json', '--detections', 'd.json', 'e.json', 'pictures/'],
            ['--profile', 'paper', '--config', 'a', 'pictures/'],
            ['--labels', 'l.json', '--profile', 'paper', '--config', 'a', 'pictures/'],
            ['--help'],
        ],
    )
    def test_paths_behind_an_option_of_one_or_two_values(
        self, arguments: List[str], capsys: pytest.CaptureFixture
    ) -> None:
        with pytest.raises(SystemExit):
            evaluate.main(['--output', 'o', *arguments])
        said = capsys.readouterr()
        assert 'PATHs stand before all options, or behind "--"' in ' '.join((said.out + said.err).split())

    def test_paths_before_the_options_or_behind_two_dashes(self, drawn: Path, tmp_path: Path) -> None:
        picture, labels = str(drawn / 'pictures' / '0_00.jpg'), ['--labels', str(drawn / 'labels.json'), '--jobs', '1']
        first = [picture, *labels, '--output', str(tmp_path / 'a'), *PAPER]
        last = [*labels, '--output', str(tmp_path / 'b'), *PAPER, '--', picture]
        assert [evaluate.main(first), evaluate.main(last)] == [0, 0]

    def test_an_argument_has_a_name_for_people(self, capsys: pytest.CaptureFixture) -> None:
        with pytest.raises(SystemExit):
            evaluate.main(['--min-confidence', 'x', '--output', 'o'])
        assert "invalid confidence value: 'x'" in capsys.readouterr().err

    def test_help(self, capsys: pytest.CaptureFixture) -> None:
        with pytest.raises(SystemExit) as ended:
            evaluate.main(['--help'])
        assert ended.value.code == 0
        assert 'usage: evaluate' in capsys.readouterr().out

    def test_the_script(self) -> None:
        assert os.access(SCRIPT, os.X_OK)
        assert 'obst_avoid.offline.evaluate import main' in Path(SCRIPT).read_text()

    def test_another_evaluation_in_the_folder(
        self, tmp_path: Path, sentence: Callable[[str], str], capsys: pytest.CaptureFixture
    ) -> None:
        files = ['--labels', written(tmp_path / 'l.json', many(5))]
        files += ['--detections', written(tmp_path / 'd.json', jittered(many(5), 1))]
        output = ['--output', str(tmp_path / 'out')]
        assert evaluate.main([*files, *output]) == 0
        before = read(tmp_path / 'out')
        (tmp_path / 'out' / 'evaluation.json').unlink()
        capsys.readouterr()
        assert evaluate.main([*files, *output]) == 0, 'the same call again'
        assert 'going on' in capsys.readouterr().out
        assert read(tmp_path / 'out') == before
        assert evaluate.main([*files, *output, '--min-confidence', '0.5']) == 1
        assert 'holds an evaluation with other options' in sentence('evaluate')
        written(tmp_path / 'l.json', many(5, seed=1))
        assert evaluate.main([*files, *output]) == 1
        assert 'with other labels' in sentence('evaluate')
        (tmp_path / 'full').mkdir()
        (tmp_path / 'full' / 'precious').write_text('')
        assert evaluate.main([*files, '--output', str(tmp_path / 'full')]) == 1
        assert 'is not empty' in sentence('evaluate')

    def test_failures(self, drawn: Path, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        labels = ['--labels', written(tmp_path / 'l.json', coco({'elsewhere.jpg': []}))]
        call = [*PAPER, *labels, '--output']
        assert evaluate.main([*call, str(tmp_path / 'a'), str(drawn / 'pictures')]) == 1
        assert 'none of 1 labelled pictures is in the PATHs' in sentence('evaluate')
        assert evaluate.main([*call, str(tmp_path / 'b'), str(tmp_path / 'missing')]) == 1
        assert 'missing does not exist' in sentence('evaluate')
        assert evaluate.main(['--labels', str(tmp_path / 'no.json'), *PAPER, '--output', str(tmp_path / 'c'), '.']) == 1
        assert 'no.json' in sentence('evaluate')
        nobody = ['--calibration', DEFAULT[1], '--vehicle', 'nobody']
        assert evaluate.main([*nobody, *labels, '--output', str(tmp_path / 'd'), str(drawn)]) == 1
        assert 'no calibration of nobody' in sentence('evaluate')

    def test_no_scheduler(
        self, drawn: Path, tmp_path: Path, sentence: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr('obst_avoid.offline.evaluation.workers.START_SECONDS', 1)
        call = [*PAPER, '--labels', str(drawn / 'labels.json'), '--output', str(tmp_path / 'out')]
        assert evaluate.main([*call, '--scheduler', 'tcp://127.0.0.1:%d' % free_port(), str(drawn / 'pictures')]) == 1
        assert 'no Dask scheduler with workers at tcp://127.0.0.1' in sentence('evaluate')


class TestRuns:
    def test_what_paper_finds_is_found(self, whole: Any) -> None:
        said = whole['runs'][0]['groups']['all']
        assert (said['frames'], said['recall']['n'] - said['recall']['k']) == (6 * COPIES, 1)
        assert said['recall']['k'] >= 4 * COPIES
        assert said['false_alarms']['count'] == 0
        (worst,) = whole['runs'][0]['worst']
        assert (worst['name'], worst['why']) == ('5_49.jpg', '1 cone missed')
        assert whole['runs'][0]['arguments'] == [*DEFAULT, '--profile', 'paper']

    def test_the_same_as_of_a_file_of_detect_images(self, drawn: Path, whole: Any, tmp_path: Path) -> None:
        det = tmp_path / 'det.json'
        assert detect_images.main([*PAPER, '--output', str(det), str(drawn / 'pictures')]) == 0
        call = ['--labels', str(drawn / 'labels.json'), '--detections', str(det), '--output', str(tmp_path / 'out')]
        assert evaluate.main(call) == 0
        ours, theirs = (timeless(content['runs'][0]['groups']) for content in (read(tmp_path / 'out'), whole))
        assert ours == theirs

    def test_what_is_broken_is_counted_and_named(
        self, drawn: Path, tmp_path: Path, capsys: pytest.CaptureFixture
    ) -> None:
        folder = tmp_path / 'pictures'
        folder.mkdir()
        jpeg = jpeg_of()
        for name, data in (('good.jpg', jpeg), ('half.jpg', jpeg[:5000]), ('no.jpg', b'junk')):
            (folder / name).write_bytes(data)
        (folder / 'bad.bag').write_bytes(b'#ROSBAG V2.0\njunk')
        boxes = json.loads((drawn / 'labels.json').read_text())['annotations'][:1]
        content = coco({name: [(1, boxes[0]['bbox'])] for name in ('good.jpg', 'half.jpg', 'no.jpg', 'gone.jpg')})
        labels = written(tmp_path / 'l.json', content)
        output = tmp_path / 'out'
        assert evaluate.main([*PAPER, '--labels', labels, '--jobs', '1', '--output', str(output), str(folder)]) == 0
        said = read(output)
        assert (said['pictures'], said['broken_count'], said['missing']) == (1, 3, ['gone.jpg'])
        assert [os.path.basename(item['path']) for item in said['broken']] == ['bad.bag', 'half.jpg', 'no.jpg']
        assert 'end marker' in said['broken'][1]['why']
        errors = capsys.readouterr().err
        for name in ('bad.bag', 'half.jpg', 'no.jpg', 'gone.jpg'):
            assert name in errors
        assert 'Traceback' not in errors

    def test_names_that_are_not_utf8(
        self, drawn: Path, tmp_path: Path, sentence: Callable[[str], str], capsys: pytest.CaptureFixture
    ) -> None:
        folder = tmp_path / 'pictures'
        folder.mkdir()
        for name in (b'caf\xe9.jpg', b'0_00.jpg', b'caf\xe9.bag'):
            (folder / os.fsdecode(name)).write_bytes(jpeg_of())
        call = [*PAPER, '--jobs', '1', '--output']
        labels = ['--labels', str(drawn / 'labels.json')]
        assert evaluate.main([*call, str(tmp_path / 'a'), *labels, str(folder)]) == 0
        broken = read(tmp_path / 'a')['broken']
        assert [(os.path.basename(item['path']), item['why']) for item in broken] == [
            ('caf\ufffd.bag', evaluate.NOT_UTF8), ('caf\ufffd.jpg', evaluate.NOT_UTF8),
        ]  # fmt: skip
        assert evaluate.main([*call, str(tmp_path / 'b'), str(folder)]) == 0
        assert (read(tmp_path / 'b')['pictures'], read(tmp_path / 'b')['broken_count']) == (2, 1)
        assert len(os.listdir(tmp_path / 'b' / 'sheets')) == 1
        (folder / os.fsdecode(b'caf\xe9.jpg')).write_bytes(b'junk')
        assert evaluate.main([*call, str(tmp_path / 'c'), '--sequence', *labels, str(folder)]) == 0
        capsys.readouterr()
        assert evaluate.main([*call, str(tmp_path / 'd'), str(folder / os.fsdecode(b'caf\xe9.jpg'))]) == 1
        assert evaluate.NOT_UTF8 in sentence('evaluate')

    def test_a_file_of_a_sequence_that_cannot_be_read(self, drawn: Path, tmp_path: Path) -> None:
        folder = tmp_path / 'pictures'
        folder.mkdir()
        names = ['%d_00.jpg' % number for number in (0, 1, 2)]
        for name in (names[0], names[2]):
            (folder / name).write_bytes(jpeg_of())
        (folder / names[1]).symlink_to('nowhere')
        (folder / '1_01.jpg').mkdir()
        labels = ['--labels', written(tmp_path / 'l.json', coco({name: [] for name in names}))]
        call = [*PAPER, '--jobs', '1', '--output']
        assert evaluate.main([*call, str(tmp_path / 'a'), *labels, '--sequence', str(folder)]) == 0
        said = read(tmp_path / 'a')
        assert (said['pictures'], [os.path.basename(item['path']) for item in said['broken']]) == (
            2, ['1_00.jpg', '1_01.jpg'],
        )  # fmt: skip
        assert evaluate.main([*call, str(tmp_path / 'b'), str(folder)]) == 0
        assert read(tmp_path / 'b')['runs'][0]['figures']['total']['broken'] == 2

    def test_all_is_broken(self, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        (tmp_path / 'a.jpg').write_bytes(jpeg_of()[:5000])
        labels = written(tmp_path / 'l.json', coco({'a.jpg': []}))
        call = [*PAPER, '--labels', labels, '--jobs', '1', '--output', str(tmp_path / 'out'), str(tmp_path / 'a.jpg')]
        assert evaluate.main(call) == 1
        assert '1 could not be read, as of %s' % (tmp_path / 'a.jpg') in sentence('evaluate')

    @pytest.mark.parametrize('jobs', ['1', '2'])
    def test_a_task_that_fails_is_named_and_tried_again_by_the_next_call(
        self, jobs: str, drawn: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
    ) -> None:
        pictures = [str(drawn / 'pictures' / name) for name in ('0_00.jpg', '1_00.jpg')]
        call = [*PAPER, '--labels', str(drawn / 'labels.json'), '--output', str(tmp_path / 'out'), *pictures]
        with monkeypatch.context() as patched:
            patched.setattr(tasks, 'PICTURES', 1)
            patched.setattr(work, 'evaluate_pictures', fail_at_0_00)
            assert evaluate.main([*call, '--jobs', jobs]) == 0
            said = read(tmp_path / 'out')
            assert (said['pictures'], [item['path'] for item in said['broken']]) == (1, pictures[:1])
            assert 'its task failed: RuntimeError: oh' in said['broken'][0]['why']
            assert pictures[0] in capsys.readouterr().err
            patched.setattr(work, 'evaluate_pictures', evaluate_pictures)
            assert evaluate.main([*call, '--jobs', '1']) == 0
        assert (read(tmp_path / 'out')['pictures'], read(tmp_path / 'out')['broken']) == (2, [])

    def test_one_name_for_two_pictures(self, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        for name in ('day', 'night'):
            (tmp_path / name).mkdir()
            (tmp_path / name / '1.jpg').write_bytes(jpeg_of())
        folders = [str(tmp_path / 'day'), str(tmp_path / 'night')]
        labels = written(tmp_path / 'l.json', coco({'1.jpg': []}))
        call = [*PAPER, '--labels', labels, '--jobs', '1', '--output']
        assert evaluate.main([*call, str(tmp_path / 'a'), *folders]) == 1
        assert '1.jpg could be' in sentence('evaluate')
        written(tmp_path / 'l.json', coco({'day/1.jpg': [], 'night/1.jpg': []}))
        assert evaluate.main([*call, str(tmp_path / 'b'), *folders]) == 0
        assert read(tmp_path / 'b')['pictures'] == 2
        written(tmp_path / 'l.json', coco({'day/1.jpg': [], 'other/1.jpg': []}))
        assert evaluate.main([*call, str(tmp_path / 'c'), folders[0]]) == 1
        assert 'day/1.jpg and other/1.jpg would both be' in sentence('evaluate')

    def test_a_picture_of_another_size_than_labelled(self, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        (tmp_path / 'a.jpg').write_bytes(jpeg_of())
        content = coco({'a.jpg': []})
        content['images'][0].update(width=320, height=240)
        labels = written(tmp_path / 'l.json', content)
        call = [*PAPER, '--labels', labels, '--jobs', '1', '--output', str(tmp_path / 'out'), str(tmp_path / 'a.jpg')]
        assert evaluate.main(call) == 1
        assert '640x480, expected 320x240 as in the labels' in sentence('evaluate')

    def test_a_sequence_uses_the_tracker(self, tmp_path: Path) -> None:
        folder = tmp_path / 'pictures'
        folder.mkdir()
        for number in range(4):
            (folder / ('%d.jpg' % number)).write_bytes(jpeg_of())
        det = tmp_path / 'd.json'
        assert detect_images.main([*PAPER, '--sequence', '--output', str(det), str(folder)]) == 0
        counts = [len(image['obstacles']) for image in json.loads(det.read_text())['images']]
        assert counts[0] < counts[-1]
        labels = written(tmp_path / 'l.json', coco({'%d.jpg' % number: [] for number in range(4)}))
        call = [*PAPER, '--labels', labels, '--jobs', '1', '--sequence', '--output', str(tmp_path / 'out')]
        assert evaluate.main([*call, str(folder)]) == 0
        said = read(tmp_path / 'out')['runs'][0]['groups']['all']
        assert said['false_alarms_indicative']['count'] + said['other_detections']['far'] == sum(counts)

    def test_both_profiles_side_by_side(self, drawn: Path, tmp_path: Path) -> None:
        call = [*DEFAULT, '--profile', 'paper', 'robust', '--labels', str(drawn / 'labels.json'), '--jobs', '2']
        assert evaluate.main([*call, '--output', str(tmp_path), str(drawn / 'pictures')]) == 0
        content = read(tmp_path)
        paper, robust = content['runs']
        assert [run['arguments'][-1] for run in (paper, robust)] == ['paper', 'robust']
        for run in (paper, robust):
            said = run['groups']['all']
            assert said['frames'] == 6 * COPIES
            assert said['recall']['k'] >= 4 * COPIES
        assert robust['groups']['all']['recall']['n'] == paper['groups']['all']['recall']['n']
        assert set(content['comparison']['only']) == {'paper', 'robust'}
        assert content['comparison']['both'] >= 4 * COPIES

    def test_two_settings_side_by_side(self, drawn: Path, tmp_path: Path) -> None:
        other = tmp_path / 'strict'
        other.mkdir()
        for name in os.listdir(REPOSITORY / 'config'):
            if name.endswith('.yaml'):
                (other / name).write_text((REPOSITORY / 'config' / name).read_text())
        call = [*PAPER, '--labels', str(drawn / 'labels.json'), '--config', str(REPOSITORY / 'config'), str(other)]
        pictures = [str(drawn / 'pictures' / ('0_%02d.jpg' % number)) for number in range(3)]
        assert evaluate.main([*call, '--jobs', '1', '--output', str(tmp_path / 'out'), *pictures]) == 0
        content = read(tmp_path / 'out')
        assert [run['name'] for run in content['runs']] == ['config', 'strict']
        first, second = (timeless(run['groups']) for run in content['runs'])
        assert first == second
        assert content['comparison']['only'] == {'config': 0, 'strict': 0}
        assert content['comparison']['both'] > 0


class TestInParallel:
    def test_interrupted_and_continued(
        self, drawn: Path, whole: Any, tmp_path: Path, capsys: pytest.CaptureFixture
    ) -> None:
        output = tmp_path / 'out'
        call = [*PAPER, '--labels', str(drawn / 'labels.json'), '--output', str(output), str(drawn / 'pictures')]
        code, errors = interrupted(call, output)
        before = finished(output)
        assert code == 1, errors
        assert 'evaluate: interrupted' in errors
        assert 'Traceback' not in errors
        assert 0 < len(before) < 6
        assert evaluate.main([*call, '--jobs', '1']) == 0
        assert 'going on, %d tasks are finished' % len(before) in capsys.readouterr().out
        after = finished(output)
        assert len(after) == 6
        assert {name: after[name] for name in before} == before, 'finished tasks are not done again'
        assert timeless(read(output)) == timeless(whole)

    def test_a_real_scheduler_and_a_worker_that_dies(
        self, drawn: Path, whole: Any, tmp_path: Path, cluster: Cluster
    ) -> None:
        output = tmp_path / 'out'
        call = [*PAPER, '--labels', str(drawn / 'labels.json'), '--output', str(output), str(drawn / 'pictures')]
        process = subprocess.Popen(
            [sys.executable, SCRIPT, *call, '--scheduler', cluster.address],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        try:
            wait_for(lambda: finished(output) or process.poll() is not None, LIMIT, 'a finished task')
            cluster.workers[0].kill()
            said = process.communicate(timeout=LIMIT)[0].decode()
        finally:
            process.kill()
        assert process.returncode == 0, said
        assert len(finished(output)) == 6
        assert timeless(read(output)) == timeless(whole)

    def test_the_scheduler_dies(self, drawn: Path, tmp_path: Path, cluster: Cluster) -> None:
        output = tmp_path / 'out'
        call = [*PAPER, '--labels', str(drawn / 'labels.json'), '--output', str(output), str(drawn / 'pictures')]
        process = subprocess.Popen(
            [sys.executable, SCRIPT, *call, '--scheduler', cluster.address],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        try:
            wait_for(lambda: finished(output) or process.poll() is not None, LIMIT, 'a finished task')
            cluster.scheduler.kill()
            errors = process.communicate(timeout=LIMIT)[1].decode().splitlines()
        finally:
            process.kill()
        words = (cluster.address, 'the same call goes on where it stopped')
        assert errors == ['evaluate: the scheduler at %s is gone; %s' % words], '\n'.join(errors)
        assert process.returncode == 1
        assert 0 < len(finished(output)) < 6

    @pytest.mark.parametrize('when', ['cancelled', 'result'])
    def test_the_scheduler_goes_with_a_result(self, monkeypatch: pytest.MonkeyPatch, when: str) -> None:
        monkeypatch.setattr('distributed.as_completed', Completed)
        monkeypatch.setattr(Future, when, lost if when == 'result' else lambda _: True)
        with pytest.raises(ToolError, match='the scheduler at tcp://gone:1 is gone; the same call goes on'):
            list(workers.work_through(Client(), None, tasks.Job(()), [tasks.Task('0')]))

    def test_workers_that_cannot_start(self, drawn: Path, tmp_path: Path) -> None:
        call = [*PAPER, '--labels', str(drawn / 'labels.json'), '--output', str(tmp_path / 'out'), '--jobs', '2']
        done = subprocess.run(
            [sys.executable, SCRIPT, *call, str(drawn / 'pictures')],
            env={**os.environ, 'DASK_DISTRIBUTED__WORKER__PRELOAD': '["nonexistent_module_x"]'},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            timeout=LIMIT,
            check=False,
        )
        words = "ModuleNotFoundError: No module named 'nonexistent_module_x'"
        assert done.stderr.decode().splitlines() == ['evaluate: workers cannot be started: %s' % words]
        assert done.returncode == 1

    def test_an_interrupt_while_workers_start_is_not_lost(self) -> None:
        child = 'import os, signal; os.kill(os.getpid(), signal.SIGINT); print("alive")'
        before, said = signal.getsignal(signal.SIGINT), []

        def start() -> None:
            with workers._interrupts_later():
                os.kill(os.getpid(), signal.SIGINT)
                said.append(subprocess.check_output([sys.executable, '-c', child]))

        with pytest.raises(KeyboardInterrupt):
            start()
        assert said == [b'alive\n'], 'what is started meanwhile does not get it'
        assert signal.getsignal(signal.SIGINT) is before
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])

    def test_workers_that_come_later_get_work(self) -> None:
        client = Client()
        todo = [tasks.Task(str(number)) for number in range(40)]
        steps = workers.work_through(client, None, tasks.Job(()), todo)
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr('distributed.as_completed', Completed)
            next(steps)
            assert client.running == 2 * workers.IN_FLIGHT
            client.workers = 1
            next(steps)
            assert client.running == 2 * workers.IN_FLIGHT - 1
            client.workers = 5
            assert len(list(steps)) == 38
        assert client.most == 5 * workers.IN_FLIGHT

    def test_memory_does_not_grow_with_the_pictures(self, tmp_path: Path) -> None:
        program = (
            'import resource, sys; from obst_avoid.offline import evaluate; code = evaluate.main(sys.argv[1:]); '
            'print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss); sys.exit(code)'
        )
        peaks = []
        for count in (400, 4000):
            labels = many(count)
            files = ['--labels', written(tmp_path / 'l.json', labels)]
            files += ['--detections', written(tmp_path / 'd.json', jittered(labels, 1))]
            call = [sys.executable, '-c', program, *files, '--output', str(tmp_path / str(count))]
            peaks.append(int(subprocess.check_output(call, timeout=LIMIT).split()[-1]) / 1024)
        assert peaks[1] - peaks[0] < 20, 'MB'


class Future:
    """A finished one of Dask's, as far as work_through knows them."""

    def __init__(self, client: Client, key: str) -> None:
        self.key, self._client = key, client

    def cancelled(self) -> bool:
        return False

    def exception(self) -> None:
        return None

    def result(self) -> Any:
        return {}

    def release(self) -> None:
        self._client.running -= 1


def lost(_: Future) -> Any:
    """Dask raises the class of concurrent.futures, which since Python 3.8 is not asyncio's."""
    from distributed.client import CancelledError

    raise CancelledError('evaluate-0')


class Client:
    """Dask's, as far as work_through knows it."""

    loop = None
    scheduler = SimpleNamespace(address='tcp://gone:1')

    def __init__(self) -> None:
        self.workers, self.running, self.most = 2, 0, 0

    def scheduler_info(self) -> Any:
        return {'workers': dict.fromkeys(range(self.workers))}

    def submit(self, *_: Any, key: str, pure: bool) -> Future:
        self.running += 1
        self.most = max(self.most, self.running)
        return Future(self, key)


class Completed(list):  # type: ignore[type-arg]
    """Dask's as_completed: more may be added on the way."""

    def __init__(self, loop: Any) -> None:
        super().__init__()

    add = list.append


class Cluster:
    """A Dask scheduler and two workers, each a process of its own."""

    def __init__(self) -> None:
        self.address = 'tcp://127.0.0.1:%d' % free_port()
        port = self.address.split(':')[-1]
        self.scheduler = self._start('dask_scheduler', '--host', '127.0.0.1', '--port', port, '--no-dashboard')
        options = ['--host', '127.0.0.1', '--nthreads', '1', '--no-nanny', '--no-dashboard']
        self.workers = [self._start('dask_worker', self.address, *options) for _ in range(2)]

    @staticmethod
    def _start(name: str, *options: str) -> Any:
        call = [sys.executable, '-m', 'distributed.cli.' + name, *options]
        return subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def close(self) -> None:
        """End all processes."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    monkeypatch.chdir(tmp_path)  # a worker leaves its files where it stands
    made = Cluster()
    try:
        yield made
    finally:
        made.close()


class TestBags:
    @pytest.fixture(scope='class')
    def bag(self, tmp_path_factory: pytest.TempPathFactory) -> Path:
        """Twelve pictures of a scene; the robot is told to drive at 0.25 m/s, and from the seventh picture on 0.05."""
        folder = tmp_path_factory.mktemp('bag')
        (folder / 'pictures').mkdir()
        for number in range(12):
            (folder / 'pictures' / ('%02d.jpg' % number)).write_bytes(jpeg_of())
        plain = str(folder / 'plain.bag')
        assert images_to_bag.main(['--output', plain, '--vehicle', 'duck', str(folder / 'pictures')]) == 0
        with rosbag.Bag(plain) as old, rosbag.Bag(str(folder / 'drive.bag'), 'w') as new:
            for number, (topic, msg, time) in enumerate(old.read_messages()):
                command = messages.Twist2DStamped(header=msg.header, v=0.25 if number < 6 else 0.05)
                new.write('/duck/lane_controller_node/car_cmd', command, time)
                new.write(topic, msg, time)
        return folder

    def test_labels_of_a_bag_by_the_names_of_bag_to_images(self, bag: Path, tmp_path: Path) -> None:
        path = bag / 'drive.bag'
        assert bag_to_images.main([str(path), '--output', str(tmp_path / 'pictures')]) == 0
        names = sorted(os.listdir(tmp_path / 'pictures'))
        det = tmp_path / 'd.json'
        call = [*PAPER, '--sequence', '--output', str(det), str(tmp_path / 'pictures')]
        assert detect_images.main(call) == 0
        last = json.loads(det.read_text())['images'][-1]['obstacles']
        boxes = [(DUCKIE_ID if item['kind'] == 'duckie' else 2, item['bbox']) for item in last]
        labels = written(tmp_path / 'l.json', coco(dict.fromkeys(names, boxes)))
        output = tmp_path / 'out'
        assert evaluate.main([*PAPER, '--labels', labels, '--jobs', '1', '--output', str(output), str(path)]) == 0
        content = read(output)
        assert (content['pictures'], content['missing_count']) == (12, 0)
        run = content['runs'][0]
        once = [image['obstacles'] for image in json.loads(det.read_text())['images']]
        assert run['groups']['all']['recall']['k'] == sum(map(len, once)), 'as a sequence: the tracker is on'
        speeds = {name: item['relevant_gt'] for name, item in run['bands']['speed [m/s]'].items()}
        assert speeds == {'0.2 to 0.3': 6 * len(boxes), '0 to 0.1': 6 * len(boxes)}
        first = run['worst'][0]
        assert first['in_bag']['path'] == str(path)
        assert first['path'] is None
        assert (output / 'evaluation.html').read_text().count('data:image/jpeg') == len(run['worst'])

    def test_without_commands_there_are_no_speeds(self, bag: Path, tmp_path: Path) -> None:
        with rosbag.Bag(str(bag / 'plain.bag')) as content:
            stamp = nanoseconds(next(iter(content.read_messages()))[1])
        name = '%d_%09d.jpg' % (stamp // 10**9, stamp % 10**9)
        labels = written(tmp_path / 'l.json', coco({'plain/' + name: [(1, BOX)]}))
        call = [*PAPER, '--labels', labels, '--jobs', '1', '--output', str(tmp_path / 'out')]
        assert evaluate.main([*call, str(bag)]) == 0, 'the folder is enough: the name says which bag'
        assert 'speed [m/s]' not in read(tmp_path / 'out')['runs'][0]['bands']
        assert read(tmp_path / 'out')['pictures'] == 1

    def test_a_bag_that_breaks_names_all_pictures_that_were_not_seen(
        self, bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = bag / 'plain.bag'
        with rosbag.Bag(str(path)) as content:
            stamps = [nanoseconds(message) for _, message, _ in content.read_messages()]
        names = ['%d_%09d.jpg' % (stamp // 10**9, stamp % 10**9) for stamp in stamps]
        labels = ['--labels', written(tmp_path / 'l.json', coco({name: [] for name in names}))]
        monkeypatch.setattr(work, 'messages', broken_after(work.messages, 5))
        call = [*PAPER, *labels, '--jobs', '1', '--output', str(tmp_path / 'out'), str(path)]
        assert evaluate.main(call) == 0
        said = read(tmp_path / 'out')
        assert said['pictures'] == 5
        places = ['%s, %.3f s' % (path, stamp / 1e9) for stamp in stamps[5:]]
        assert [item['path'] for item in said['broken']] == [str(path), *places]
        whys = [item['why'] for item in said['broken']]
        assert whys == ['is damaged', *['not reached: its recording cannot be read to the end'] * 7]

    def test_a_bag_that_is_none_is_named_once(self, bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
        path = tmp_path / 'not.bag'
        path.write_bytes(b'junk')
        call = [*PAPER, '--jobs', '1', '--output', str(tmp_path / 'out'), str(path), str(bag / 'pictures')]
        assert evaluate.main(call) == 0
        assert 'evaluate: %s: cannot be read as a bag' % path in capsys.readouterr().err

    def test_without_labels(self, bag: Path, tmp_path: Path) -> None:
        broken = tmp_path / 'broken.bag'
        broken.write_bytes((bag / 'drive.bag').read_bytes()[:-1000])
        output = tmp_path / 'out'
        call = [*PAPER, '--empty', '--jobs', '1', '--output', str(output), str(bag / 'drive.bag'), str(broken)]
        assert evaluate.main([*call, str(bag / 'pictures')]) == 0
        content = read(output)
        assert (content['pictures'], content['labels'], content['empty']) == (24, None, True)
        assert [item['path'] for item in content['broken']] == [str(broken)]
        total = content['runs'][0]['figures']['total']
        assert total['pictures'] == 24
        assert total['false_alarms']['count'] > 0
        assert os.listdir(output / 'sheets')
        assert (output / 'evaluation.html').exists()
