"""train_detector: from rendered pictures to a file that the detector loads, and one sentence when that cannot be."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import json
import os
import sys
from pathlib import Path
from typing import Any, Callable, Dict, List

import cv2
import numpy as np
import pytest
from helpers import REPOSITORY, default_calibration, picture_of, run_program
from unit.drawn import Scene

from obst_avoid.core import detection
from obst_avoid.core.detection.robust import trees
from obst_avoid.core.detection.robust.features import NAMES
from obst_avoid.core.detection.robust.trees import STAGES, summed
from obst_avoid.offline import render_dataset, train_detector
from obst_avoid.offline.tool import ToolError
from obst_avoid.offline.training.samples import Dataset, read_datasets, read_labels, samples_of

CALIBRATIONS = str(REPOSITORY / 'config' / 'calibrations')
PICTURES = 12
try:
    import xgboost  # noqa: F401

    HAS_XGBOOST = True
except ImportError:  # Ubuntu 20.04 has no such package
    HAS_XGBOOST = False
growing = pytest.mark.skipif(not HAS_XGBOOST, reason='xgboost is not installed')


@pytest.fixture(scope='module')
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small labelled data set of the simulation."""
    folder = tmp_path_factory.mktemp('rendered') / 'set'
    call = ['--count', str(PICTURES), '--seed', '5', '--lights', 'white', 'warm', '--distances', '0.3', '0.8']
    assert render_dataset.main([*call, '--output', str(folder)]) == 0
    return folder


def entry(folder: Path, **changes: Any) -> Dict[str, Any]:
    """One data set of the YAML file."""
    labels = next(folder.rglob('labels.json'))
    pictures = next(folder.rglob('*.jpg')).parent
    return {
        'labels': str(labels), 'pictures': str(pictures),
        'calibration': CALIBRATIONS, 'vehicle': 'default', 'copies': 2, **changes,
    }  # fmt: skip


def written(path: Path, content: Any) -> str:
    """The path of a new YAML file: JSON is YAML."""
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(path)


@pytest.fixture(scope='module')
def grown(rendered: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What train_detector writes of the small data set, as a program."""
    folder = tmp_path_factory.mktemp('grown')
    datasets, output = written(folder / 'datasets.yaml', [entry(rendered)]), folder / 'trees.npz'
    call = ['rosrun', 'obst_avoid', 'train_detector', '--jobs', '2', '--output', str(output), datasets]
    ended = run_program(call, 300)
    assert ended.code == 0, ended.output
    assert 'Traceback' not in ended.output
    last = ended.output.strip().splitlines()[-1]
    assert last.startswith('%d pictures, ' % (2 * PICTURES))
    assert last.endswith(': %s' % output)
    return output


@pytest.fixture
def loaded(grown: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The detector's forests, read from the new file."""
    trees.shipped.cache_clear()
    monkeypatch.setattr(trees, 'FILE', str(grown))
    yield trees.shipped()
    trees.shipped.cache_clear()


@growing
def test_the_file_is_what_the_detector_loads(loaded: Any) -> None:
    assert set(loaded) == {'thing', 'cone', 'foot', 'radius'}
    assert len(loaded['thing'].hopeless) == len(STAGES)
    values = np.random.RandomState(0).randn(50, len(NAMES)).astype(np.float32)
    for name, forest in loaded.items():
        sums = summed(forest, values)
        assert not np.isnan(sums).any() and (sums < np.inf).all()  # -inf: hopeless, and only a judgement may say so
        assert name == 'thing' or np.isfinite(sums).all()


@growing
def test_what_was_learnt_is_found_again(loaded: Any, rendered: Path, detection_settings: Any) -> None:
    """On the very pictures that it learnt from, labelled things get higher odds than anything else."""
    dataset = Dataset(**entry(rendered, copies=1))
    things, others = [], []
    for picture, boxes in read_labels(dataset):
        found = samples_of(dataset, picture, boxes, 0)
        assert found is not None
        odds = summed(loaded['thing'], found.values)
        things += odds[(found.overlap >= 0.6) & ~found.ignored].tolist()
        others += odds[~found.touches & ~found.ignored].tolist()
    assert len(things) > 10
    assert np.median(things) > np.sort(others)[int(0.98 * len(others))]
    detector = detection.start(default_calibration(), detection_settings)
    scene, _ = detection.detect(detector, picture_of(), None)
    assert all(np.isfinite([one.x, one.y, one.radius]).all() for one in scene.obstacles)


@growing
def test_the_forests_say_what_xgboost_says() -> None:
    import xgboost

    from obst_avoid.offline.training.fit import forest_of

    random = np.random.RandomState(0)
    values = random.randn(400, len(NAMES)).astype(np.float32)
    for objective, target in (
        ('binary:logistic', (values[:, 0] + values[:, 3] ** 2 > 1).astype(np.float32)),
        ('reg:squarederror', 3 * values[:, 1] + values[:, 2]),
    ):
        settings = {
            'objective': objective,
            'max_leaves': 12,
            'grow_policy': 'lossguide',
            'tree_method': 'hist',
            'eta': 0.3,
        }
        booster = xgboost.train({**settings, 'nthread': 1}, xgboost.DMatrix(values, target), STAGES[0] + 10)
        expected = booster.predict(xgboost.DMatrix(values), output_margin=True)
        np.testing.assert_allclose(summed(forest_of(booster), values), expected, atol=1e-3)


def test_what_is_held_out_is_not_looked_at(rendered: Path, tmp_path: Path, sentence: Callable[[str], str]) -> None:
    labels = json.loads(next(rendered.rglob('labels.json')).read_text())
    for image in labels['images']:
        image['split_block'] = 'drive_1'
    changed = written(tmp_path / 'labels.json', labels)
    datasets = written(tmp_path / 'd.yaml', [entry(rendered, labels=changed)])
    call = ['--hold-out', 'drive_1', '--output', str(tmp_path / 't.npz'), datasets]
    assert train_detector.main(call) == 1
    assert 'no region of any picture is a labelled thing' in sentence('train_detector')


# Samples


def test_each_region_on_a_thing_is_its_sample(rendered: Path) -> None:
    dataset = Dataset(**entry(rendered, copies=1))
    pictures = read_labels(dataset)
    assert len(pictures) == PICTURES
    hits = 0
    for picture, boxes in pictures:
        found = samples_of(dataset, picture, boxes, 0)
        assert found is not None
        count = len(found.box)
        assert found.values.shape == (count, len(NAMES))
        for name in ('overlap', 'touches', 'ignored', 'cone', 'foot', 'radius'):
            assert getattr(found, name).shape == (count,), name
        good = found.overlap > 0.7
        hits += int(good.sum())
        assert found.touches[good].all()
        assert np.isfinite(found.foot[good]).all() or (found.box[good, 1] + found.box[good, 3] > 470).any()
        assert np.nanmax(np.abs(found.foot[good]), initial=0) < 1.0
        kinds = {item['category'] for item in boxes}
        if 'cone' not in kinds:
            assert not found.cone.any()
    assert hits > 20


def test_copies_differ_and_are_the_same_each_time(rendered: Path) -> None:
    dataset = Dataset(**entry(rendered))
    picture, boxes = next((one, some) for one, some in read_labels(dataset) if some)
    first, again, other = (samples_of(dataset, picture, boxes, copy) for copy in (1, 1, 2))
    assert first is not None
    assert again is not None
    assert other is not None
    np.testing.assert_array_equal(first.values, again.values)
    assert first.values.shape != other.values.shape or not np.array_equal(first.values, other.values)
    assert np.isnan(first.radius).all(), 'through another camera metres are lost'


def test_a_picture_without_a_region_is_no_sample(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / 'grey.png'), np.full((480, 640, 3), 90, np.uint8))
    dataset = Dataset('', str(tmp_path), CALIBRATIONS, 'default', 1)
    assert samples_of(dataset, {'file_name': 'grey.png', 'width': 640, 'height': 480}, [], 0) is None


# What cannot be


FIELDS = 'labels, pictures, calibration, vehicle, copies'


@pytest.mark.parametrize(
    'content, words',
    [
        pytest.param(None, 'is not a list, expected one mapping of %s a dataset' % FIELDS, id='empty'),
        pytest.param([], 'is not a list', id='an empty list'),
        pytest.param({'labels': 'a'}, 'is not a list', id='a mapping'),
        pytest.param(['a'], 'entry 0 does not have exactly the fields %s' % FIELDS, id='a word'),
        pytest.param([{'labels': 'a'}], 'entry 0 does not have exactly the fields', id='fields missing'),
        pytest.param(
            [{'labels': 'a', 'pictures': 'b', 'calibration': 'c', 'vehicle': 'd', 'copies': 1, 'weight': 2}],
            'entry 0 does not have exactly the fields',
            id='a field too many',
        ),
        pytest.param(
            [{'labels': 'a', 'pictures': 'b', 'calibration': 'c', 'vehicle': 'd', 'copies': 'many'}],
            "entry 0: copies = 'many', expected int",
            id='not a number',
        ),
        pytest.param(
            [{'labels': 1, 'pictures': 'b', 'calibration': 'c', 'vehicle': 'd', 'copies': 1}],
            'entry 0: labels = 1, expected str',
            id='not a name',
        ),
    ],
)
def test_other_yaml_is_refused(content: Any, words: str) -> None:
    with pytest.raises(ToolError) as refused:
        read_datasets('sets.yaml', content)
    assert str(refused.value).startswith('sets.yaml')
    assert words in str(refused.value)


@pytest.mark.parametrize(
    'content',
    [
        pytest.param('not JSON', id='text'),
        pytest.param('[]', id='a list'),
        pytest.param('{}', id='nothing in it'),
        pytest.param({'categories': [], 'images': [{'id': 1, 'file_name': 'a.jpg'}], 'annotations': []}, id='no size'),
        pytest.param(
            {
                'categories': [{'id': 1, 'name': 'duckie'}],
                'images': [{'id': 1, 'file_name': 'a.jpg', 'width': 640, 'height': 480}],
                'annotations': [{'image_id': 2, 'category_id': 1, 'bbox': [1, 2, 3, 4]}],
            },
            id='a box in no picture',
        ),
        pytest.param(
            {
                'categories': [{'id': 1, 'name': 'duckie'}],
                'images': [{'id': 1, 'file_name': 'a.jpg', 'width': 640, 'height': 480}],
                'annotations': [{'image_id': 1, 'category_id': 1}],
            },
            id='no box',
        ),
    ],
)
def test_labels_that_are_none_are_refused(content: Any, tmp_path: Path) -> None:
    path = written(tmp_path / 'labels.json', content)
    with pytest.raises(ToolError) as refused:
        read_labels(Dataset(path, str(tmp_path), CALIBRATIONS, 'default', 1))
    assert str(refused.value).startswith('%s is no COCO file: ' % path)


@growing
@pytest.mark.parametrize(
    'changes, words',
    [
        pytest.param({'labels': '/no/such/labels.json'}, '/no/such/labels.json is no COCO file', id='no labels'),
        pytest.param({'pictures': '/no/such/folder'}, '/no/such/folder', id='no pictures'),
        pytest.param({'calibration': '/no/such/calibrations'}, '/no/such/calibrations', id='no calibration'),
        pytest.param({'vehicle': 'nobody'}, 'no calibration of nobody', id='another vehicle'),
    ],
)
def test_failures_are_one_sentence(
    rendered: Path, changes: Dict[str, Any], words: str, tmp_path: Path, sentence: Callable[[str], str]
) -> None:
    datasets = written(tmp_path / 'd.yaml', [entry(rendered, **changes)])
    assert train_detector.main(['--output', str(tmp_path / 't.npz'), datasets]) == 1
    assert words in sentence('train_detector')
    assert not (tmp_path / 't.npz').exists()


@growing
@pytest.mark.parametrize(
    'content, words',
    [
        pytest.param(b'junk', 'a.jpg: the picture starts with 6a75, expected a JPEG', id='junk'),
        pytest.param(None, 'no region of any picture is a labelled thing', id='an empty road'),
    ],
)
def test_pictures_that_teach_nothing(content: Any, words: str, tmp_path: Path, sentence: Callable[[str], str]) -> None:
    if content is None:
        cv2.imwrite(str(tmp_path / 'a.jpg'), picture_of(Scene()))
    else:
        (tmp_path / 'a.jpg').write_bytes(content)
    labels = {
        'categories': [{'id': 1, 'name': 'duckie'}],
        'images': [{'id': 1, 'file_name': 'a.jpg', 'width': 640, 'height': 480}],
        'annotations': [],
    }
    item = {'labels': written(tmp_path / 'l.json', labels), 'pictures': str(tmp_path), 'calibration': CALIBRATIONS}
    datasets = written(tmp_path / 'd.yaml', [{**item, 'vehicle': 'default', 'copies': 1}])
    assert train_detector.main(['--output', str(tmp_path / 't.npz'), datasets]) == 1
    assert words in sentence('train_detector')


def test_files_that_cannot_be(tmp_path: Path, sentence: Callable[[str], str]) -> None:
    datasets = written(tmp_path / 'd.yaml', [])
    for output, words in (
        (str(tmp_path / 'trees.txt'), 'expected a name that ends in .npz'),
        ('/no/such/folder/trees.npz', '/no/such/folder/trees.npz cannot be written'),
    ):
        assert train_detector.main(['--output', output, datasets]) == 1
        assert words in sentence('train_detector')
    (tmp_path / 'there.npz').write_text('precious')
    assert train_detector.main(['--output', str(tmp_path / 'there.npz'), datasets]) == 1
    assert 'there.npz exists, expected a new file' in sentence('train_detector')
    assert (tmp_path / 'there.npz').read_text() == 'precious'


@growing
def test_a_yaml_file_that_is_none(tmp_path: Path, sentence: Callable[[str], str]) -> None:
    call = ['--output', str(tmp_path / 't.npz')]
    assert train_detector.main([*call, '/no/such/sets.yaml']) == 1
    assert '/no/such/sets.yaml cannot be read: No such file or directory' in sentence('train_detector')
    assert train_detector.main([*call, written(tmp_path / 'bad.yaml', 'a: [1, 2')]) == 1
    assert 'does not parse as YAML' in sentence('train_detector')
    assert train_detector.main([*call, written(tmp_path / 'map.yaml', 'a: 1')]) == 1
    assert 'is not a list' in sentence('train_detector')


@pytest.mark.parametrize(
    'arguments', [[], ['a.yaml'], ['--output', 'o.npz'], ['--output', 'o.npz', '--jobs', '0', 'a']]
)
def test_wrong_use(arguments: List[str], capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as ended:
        train_detector.main(arguments)
    assert ended.value.code == 2
    assert 'usage: train_detector' in capsys.readouterr().err


def test_help(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as ended:
        train_detector.main(['--help'])
    assert ended.value.code == 0
    assert 'usage: train_detector' in capsys.readouterr().out
    script = REPOSITORY / 'scripts' / 'train_detector'
    assert os.access(str(script), os.X_OK)


def test_without_xgboost_it_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, sentence: Callable[[str], str]
) -> None:
    monkeypatch.setitem(sys.modules, 'xgboost', None)
    monkeypatch.delitem(sys.modules, 'obst_avoid.offline.training.fit', raising=False)
    monkeypatch.delattr('obst_avoid.offline.training.fit', raising=False)
    datasets = written(tmp_path / 'd.yaml', [])
    assert train_detector.main(['--output', str(tmp_path / 't.npz'), datasets]) == 1
    said = sentence('train_detector')
    assert 'xgboost is missing' in said
    assert 'pip install xgboost' in said


def test_nothing_else_imports_xgboost() -> None:
    using = [
        path.relative_to(REPOSITORY).as_posix()
        for folder in ('src', 'scripts')
        for path in (REPOSITORY / folder).rglob('*')
        if path.is_file() and path.suffix in ('', '.py') and 'import xgboost' in path.read_text()
    ]
    assert using == ['src/obst_avoid/offline/training/fit.py']
    code = 'import sys, obst_avoid.offline.train_detector; sys.exit("xgboost" in sys.modules)'
    assert run_program([sys.executable, '-c', code], 60).code == 0
