"""train_detector: from rendered pictures to a file that the detector loads, and one sentence when that cannot be."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import json
import os
import re
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

import cv2
import numpy as np
import pytest
from helpers import REPOSITORY, default_calibration, picture_of, run_program
from unit.drawn import Scene
from unit.drawn import Thing as Placed

from obst_avoid.core import detection
from obst_avoid.core.calibration import CalibrationError
from obst_avoid.core.detection.robust import native, trees
from obst_avoid.core.detection.robust.channels import channels_of
from obst_avoid.core.detection.robust.features import NAMES, QUICK
from obst_avoid.core.detection.robust.judgement import judge
from obst_avoid.core.detection.robust.light import LINEAR, estimate_light
from obst_avoid.core.detection.robust.regions import find_regions
from obst_avoid.core.detection.robust.trees import FORESTS, NODE, Forest, summed
from obst_avoid.core.detection.robust.view import make_view, working_picture
from obst_avoid.core.types import Kind
from obst_avoid.offline import render_dataset, train_detector
from obst_avoid.offline.pictures import read_picture
from obst_avoid.offline.tool import ToolError
from obst_avoid.offline.training import samples as sampling
from obst_avoid.offline.training.samples import Dataset, Samples, Thing, read_datasets, read_labels, samples_of

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
    sentence = r'(\d+) pictures, (\d+) regions, (\d+) of them promising, \d+ of these things: %s$'
    words = re.match(sentence % re.escape(str(output)), last)
    assert words, last
    shown, regions, things = map(int, words.groups())
    assert 0 < shown <= 2 * PICTURES  # those of which the first look leaves anything
    assert 0 < things < regions
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
    from obst_avoid.offline.training import fit

    assert tuple(loaded) == FORESTS
    stages = {name: tuple(forest.stages.tolist()) for name, forest in loaded.items()}
    assert stages == {'first': fit.FIRST_STAGES, 'thing': fit.STAGES, 'cone': (), 'foot': (), 'radius': ()}
    trees_of = {name: len(forest.nodes) for name, forest in loaded.items()}
    few = fit.FEW_TREES
    assert trees_of == {'first': fit.FIRST_TREES, 'thing': fit.TREES, 'cone': few, 'foot': few, 'radius': few}
    assert loaded['first'].nodes['feature'].max() < len(QUICK), 'more is not measured on all regions'
    values = np.random.RandomState(0).randn(50, len(NAMES)).astype(np.float32)
    for name, forest in loaded.items():
        sums = summed(forest, values)
        assert not np.isnan(sums).any() and (sums < np.inf).all()  # -inf: hopeless, and only a judgement may say so
        assert name in ('first', 'thing') or np.isfinite(sums).all()


def counted(found: Samples) -> Any:
    """(2,) regions of things, and of none."""
    return np.array([((found.overlap >= 0.6) & ~found.ignored).sum(), (~found.touches & ~found.ignored).sum()])


@growing
def test_what_was_learnt_is_found_again(loaded: Any, rendered: Path, detection_settings: Any) -> None:
    """On the very pictures that it learnt from, labelled things get higher odds than anything else.

    A first look leaves them, and little else.
    """
    dataset = Dataset(**entry(rendered, copies=1))
    things, others = [], []
    looked_at, left = np.zeros(2, dtype=int), np.zeros(2, dtype=int)
    for picture, boxes in read_labels(dataset):
        every, found = samples_of(dataset, picture, boxes, 0), samples_of(dataset, picture, boxes, 0, loaded['first'])
        assert every is not None
        looked_at += counted(every)
        if found is None:
            continue
        left += counted(found)
        odds = summed(loaded['thing'], found.values)
        things += odds[(found.overlap >= 0.6) & ~found.ignored].tolist()
        others += odds[~found.touches & ~found.ignored].tolist()
    assert len(things) > 10
    assert left[0] > 0.95 * looked_at[0]
    assert left[1] < 0.2 * looked_at[1]
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
        booster = xgboost.train({**settings, 'nthread': 1}, xgboost.DMatrix(values, target), 25)
        expected = booster.predict(xgboost.DMatrix(values), output_margin=True)
        forest = forest_of(booster)
        assert forest.nodes.dtype == NODE
        assert len(forest.nodes) == 25
        np.testing.assert_allclose(summed(forest, values), expected, atol=1e-3)
        assert trees._sound(forest.nodes)
        assert [int(depth) for depth in forest.nodes['depth'][:, 0]] == [deepest(tree) for tree in forest.nodes]


@growing
def test_a_tree_of_one_leaf_is_one_too() -> None:
    """Where nothing is to be learnt XGBoost's trees are leaves."""
    import xgboost

    from obst_avoid.offline.training.fit import forest_of

    values = np.zeros((20, len(NAMES)), np.float32)
    booster = xgboost.train({'base_score': 0.25, 'nthread': 1}, xgboost.DMatrix(values, np.full(20, 0.25)), 3)
    forest = forest_of(booster)
    assert forest.nodes['depth'].max() == 0
    np.testing.assert_allclose(summed(forest, values[:2]), 0.25, atol=1e-6)


def deepest(tree: Any, node: int = 0) -> int:
    """Steps of the longest way down from a node of a (K,) tree."""
    if tree['left'][node] == node:
        return 0
    return 1 + max(deepest(tree, int(tree[side][node])) for side in ('left', 'right'))


def made_up(random: np.random.RandomState, count: int, columns: int = len(NAMES)) -> Samples:
    """Regions of one picture whose first values tell thing, cone, foot and radius; ignored ones say the reverse."""
    values = random.randn(count, columns).astype(np.float32)
    ignored = random.rand(count) < 0.2
    thing = (values[:, 0] > 0.8) != ignored
    return Samples(
        'a', 'a.jpg', 0, values, np.where(thing, np.arange(count) % 3, -1), np.where(thing, 0.8, 0.0), thing, ignored,
        cone=thing & ((values[:, 1] > 0) != ignored),
        foot=np.where(thing, np.where(ignored, -1, 1) * 0.2 * np.tanh(values[:, 2]), np.nan),
        radius=np.where(thing, np.where(ignored, -1, 1) * 0.5 * np.tanh(values[:, 3]), np.nan),
        box=np.zeros((count, 4)),
    )  # fmt: skip


@growing
def test_a_thing_of_many_regions_counts_less_a_region() -> None:
    from obst_avoid.offline.training import fit

    number, thing = np.array([0, 0, -1, 0, 1, 0, 1]), np.array([1, 1, 0, 1, 1, 1, 0], bool)
    weights = fit._weights(number, thing)
    np.testing.assert_allclose(weights, np.array([0.5, 0.5, 0.6, 0.5, 1, 0.5, 0.6]) / 0.6)
    np.testing.assert_allclose(fit._weights(np.array([-1, -1]), np.zeros(2, bool)), [1, 1])


@growing
def test_things_are_numbered_over_all_pictures() -> None:
    from obst_avoid.offline.training import fit

    pictures = [made_up(np.random.RandomState(0), count) for count in (30, 40)]
    used = [np.arange(30) % 2 == 0, np.ones(40, bool)]
    number = fit._numbered(pictures, used)
    assert_equal = np.testing.assert_array_equal
    assert_equal(number[:15], pictures[0].thing[::2])
    assert_equal(number[15:], np.where(pictures[1].thing < 0, -1, pictures[1].thing + 3))


@growing
def test_each_forest_learns_its_own_from_all_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows are picked picture by picture, for each forest others: what is learnt belongs to its row."""
    from obst_avoid.offline.training import fit

    monkeypatch.setattr(fit, 'TREES', 150)
    random = np.random.RandomState(0)
    pictures = [made_up(random, count) for count in (700, 150, 1, 900, 400, 60, 800)]
    forests = fit.grown(pictures, 1)
    assert list(forests) == ['thing', 'cone', 'foot', 'radius']
    values = np.random.RandomState(1).randn(1500, len(NAMES)).astype(np.float32)
    odds, cone, foot, radius = (summed(forests[name], values) for name in ('thing', 'cone', 'foot', 'radius'))
    thing = values[:, 0] > 0.8
    assert ((odds > 0) == thing).mean() > 0.95
    assert ((cone > 0) == (values[:, 1] > 0))[thing].mean() > 0.9
    assert np.corrcoef(foot, np.tanh(values[:, 2]))[0, 1] > 0.9
    assert np.corrcoef(radius, np.tanh(values[:, 3]))[0, 1] > 0.9
    assert np.isfinite(odds[thing]).mean() > 0.9, 'hopeless is what is none'


@growing
def test_the_first_look_drops_what_is_surely_none() -> None:
    """By what is measured on all regions; nearly each thing that it learnt from passes every stage."""
    from obst_avoid.offline.training import fit

    random = np.random.RandomState(0)
    pictures = [made_up(random, count, len(QUICK)) for count in (700, 1, 900, 400, 60, 800)]
    forest = fit.first_of(pictures, 1)
    assert forest.stages.tolist() == list(fit.FIRST_STAGES)
    assert len(forest.nodes) == fit.FIRST_TREES == fit.FIRST_STAGES[-1], 'the last stage is the verdict'
    taught = np.concatenate([item.values[fit.things(item)] for item in pictures])
    lost = 1 - np.isfinite(summed(forest, taught)).mean()
    assert 0 < lost <= 0.001 + fit.SAFE * len(fit.FIRST_STAGES)
    values = np.random.RandomState(1).randn(1500, len(QUICK)).astype(np.float32)
    kept, thing = np.isfinite(summed(forest, values)), values[:, 0] > 0.8
    assert kept[thing].mean() > 0.95
    assert kept[values[:, 0] < 0.6].mean() < 0.1


@growing
@pytest.mark.parametrize('share', [0.05, 0.3])
def test_a_stage_drops_a_given_share_of_the_things_that_were_learnt(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or fewer: those with the same sum stay together."""
    from obst_avoid.offline.training import fit

    monkeypatch.setattr(fit, 'SAFE', share)
    monkeypatch.setattr(fit, 'FIRST_STAGES', (20,))
    item = made_up(np.random.RandomState(0), 4000, len(QUICK))
    forest = fit.first_of([item], 1)
    assert forest.stages.tolist() == [20]
    lost = 1 - np.isfinite(summed(forest, item.values[fit.things(item)])).mean()
    assert share / 2 < lost < share + 0.002


@growing
def test_what_is_written_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from obst_avoid.offline.training import fit

    shipped = trees.shipped()
    fit.write(shipped, str(tmp_path / 'trees.npz'))
    trees.shipped.cache_clear()
    monkeypatch.setattr(trees, 'FILE', str(tmp_path / 'trees.npz'))
    again = trees.shipped()
    trees.shipped.cache_clear()
    for name in FORESTS:
        for field in ('nodes', 'base', 'stages', 'hopeless'):
            np.testing.assert_array_equal(getattr(again[name], field), getattr(shipped[name], field))


def test_its_workers_have_the_compiled_path_too() -> None:
    """They import the package anew, in catkin's development space from another folder than this process."""
    asked = '__import__("obst_avoid.core.detection.robust.native", fromlist=["LIBRARY"]).LIBRARY is None'
    with ProcessPoolExecutor(1, get_context('spawn')) as workers:
        assert workers.submit(eval, asked).result() is (native.LIBRARY is None)


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
        assert found.values.shape == (count, len(QUICK))
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


def leaving(name: str, more_than: float) -> Forest:
    """A first forest that leaves the regions of which that measurement is at least so much."""
    nodes = np.zeros((1, 3), dtype=NODE)
    nodes['left'] = nodes['right'] = np.arange(3)
    nodes[0, 0] = (NAMES.index(name), 1, 2, 1, more_than)
    nodes['value'][0, 1:] = -1, 1
    return Forest(nodes, 0.0, np.int32([1]), np.float32([0]))


def test_everything_is_measured_on_what_the_first_forest_leaves(rendered: Path) -> None:
    dataset = Dataset(**entry(rendered, copies=1))
    for picture, boxes in read_labels(dataset)[:4]:
        for copy in (0, 1):
            every = samples_of(dataset, picture, boxes, copy)
            some = samples_of(dataset, picture, boxes, copy, leaving('pixels_up', 12.0))
            assert every is not None and some is not None
            left = every.values[:, QUICK.index('pixels_up')] >= 12
            assert 0 < left.sum() < len(left)
            assert some.values.shape == (left.sum(), len(NAMES))
            np.testing.assert_array_equal(some.values[:, : len(QUICK)], every.values[left])
            for name in ('overlap', 'touches', 'ignored', 'cone', 'foot', 'radius', 'box'):
                np.testing.assert_array_equal(getattr(some, name), getattr(every, name)[left])
            assert samples_of(dataset, picture, boxes, copy, leaving('pixels_up', 1000.0)) is None


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


@pytest.mark.parametrize('seed', range(8))
def test_boxes_move_with_the_picture_into_another_camera(seed: int) -> None:
    """Zoomed, shifted, rolled and perhaps mirrored: a box's middle stays on its thing, and metres are lost."""
    boxes = [(150.0, 190.0, 40.0, 30.0), (450.0, 200.0, 30.0, 40.0), (300.0, 330.0, 20.0, 24.0)]
    picture = np.zeros((480, 640, 3), np.uint8)
    for channel, (left, top, width, height) in enumerate(boxes):
        picture[int(top) : int(top + height), int(left) : int(left + width), channel] = 255
    things = [Thing('duckie', boxes[0], (220.0, 0.5, 0.02)), Thing('cone', boxes[1], None)]
    moved, kept, ignored = sampling._through_another_camera(picture, things, boxes[2:], np.random.RandomState(seed))
    assert [(one.kind, one.place) for one in kept] == [('duckie', None), ('cone', None)]
    for channel, (left, top, width, height) in enumerate([one.box for one in kept] + ignored):
        sums = cv2.moments(moved[..., channel])
        middle = sums['m10'] / sums['m00'] + 0.5, sums['m01'] / sums['m00'] + 0.5
        assert (left + width / 2, top + height / 2) == pytest.approx(middle, abs=1.0)
        assert width * height == pytest.approx(sums['m00'] / 255, rel=0.05)


WHOLE = (300.0, 250.0, 40.0, 40.0)
"""[px] left, top, width, height of something that every copy shows."""


@pytest.mark.parametrize(
    'box',
    [
        pytest.param((2.0, 200.0, 40.0, 40.0), id='at the left edge'),
        pytest.param((596.0, 260.0, 42.0, 40.0), id='at the right edge'),
        pytest.param((200.0, 436.0, 40.0, 42.0), id='at the lower edge'),
        pytest.param((400.0, 200.0, 30.0, 13.0), id='low'),
    ],
)
def test_what_a_copy_hardly_shows_is_neither_a_thing_nor_none(box: Tuple[float, ...]) -> None:
    """Less than half of it, or too low after the zoom: it is ignored, and what is left of it is where it is seen."""
    picture = np.zeros((480, 640, 3), np.uint8)
    for channel, (left, top, width, height) in enumerate((WHOLE, box)):
        picture[int(top) : int(top + height), int(left) : int(left + width), channel] = 255
    things = [Thing('cone', WHOLE, None), Thing('duckie', box, None)]
    fates = []
    for seed in range(60):
        copy, kept, ignored = sampling._through_another_camera(picture, things, [], np.random.RandomState(seed))
        assert kept[0].kind == 'cone'
        whole, shown = (float(copy[..., channel].sum()) / 255 for channel in (0, 1))
        zoom = np.sqrt(whole / (WHOLE[2] * WHOLE[3]))
        part, height = shown / (zoom**2 * box[2] * box[3]), zoom * box[3] * (copy[..., 1].max() > 0)
        if abs(part - sampling.LEAST_PART) < 0.06 or abs(height - sampling.LEAST_HEIGHT) < 0.5:
            continue  # a rolled box is a little larger than what is in it
        good = part > sampling.LEAST_PART and height > sampling.LEAST_HEIGHT
        fates.append((good, part > 0.02))
        assert [one.kind for one in kept[1:]] == (['duckie'] if good else []), seed
        if not good and part > 0.02:
            ((left, top, across, down),) = ignored
            assert across > 0 and down > 0
            rows, columns = np.nonzero(copy[..., 1] > 128)
            middle = columns.mean() + 0.5, rows.mean() + 0.5
            assert (left + across / 2, top + down / 2) == pytest.approx(middle, abs=2.0), seed
        elif good:
            assert ignored == []
    assert (True, True) in fates
    assert (False, True) in fates


def label_of(thing: Placed) -> Dict[str, Any]:
    """The annotation of a drawn thing before the robot: its box by what it changes in the picture."""
    change = np.abs(picture_of(Scene((thing,))).astype(int) - picture_of(Scene())).max(axis=2) > 40
    rows, columns = np.flatnonzero(change.any(axis=1)), np.flatnonzero(change.any(axis=0))
    box = [columns[0], rows[0], columns[-1] + 1 - columns[0], rows[-1] + 1 - rows[0]]
    near = 1 - thing.radius / np.hypot(thing.x, thing.y)
    place = {'x': near * thing.x, 'y': near * thing.y, 'radius': thing.radius}
    return {'category': 'duckie', 'bbox': [float(value) for value in box], **place}


def test_regions_on_what_a_copy_hardly_shows_are_ignored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are neither what the judgement shall find nor what it shall not."""
    thing = Placed(Kind.DUCKIE, 0.35, 0.3)
    label = label_of(thing)
    assert label['bbox'][0] < 80, 'near the left edge'
    cv2.imwrite(str(tmp_path / 'a.png'), picture_of(Scene((thing,))))
    dataset = Dataset('', str(tmp_path), CALIBRATIONS, 'default', 1)
    moved: List[Any] = []
    through = sampling._through_another_camera
    monkeypatch.setattr(sampling, 'ZOOM', 0.4)
    monkeypatch.setattr(sampling, '_through_another_camera', lambda *given: moved.append(through(*given)) or moved[-1])
    complete = {'duckie': 'all', 'cone': 'all'}
    picture = {'file_name': 'a.png', 'width': 640, 'height': 480, 'complete': complete}
    lost = 0
    for copy in range(1, 41):
        found = samples_of(dataset, picture, [label], copy)
        _, kept, ignored = moved[-1]
        if kept or not ignored or found is None:
            assert found is None or not found.ignored.any()
            continue
        ((left, top, width, height),) = ignored
        middle, foot = found.box[:, 0] + found.box[:, 2] / 2, found.box[:, 1] + found.box[:, 3]
        on_it = (middle > left) & (middle < left + width) & (foot > top + height / 2) & (foot < top + height + 2)
        similar = on_it & (found.box[:, 2] < 1.5 * width) & (found.box[:, 3] < 1.5 * height)
        lost += int(similar.any())
        assert found.ignored[similar].all()
        assert not found.touches.any()
        assert found.overlap.max() == 0
    assert lost >= 3


def test_pictures_of_one_width_and_other_heights_have_their_own_calibrations(tmp_path: Path) -> None:
    """One of another aspect was cut somewhere, whatever came before it."""
    dataset = Dataset('', str(tmp_path), CALIBRATIONS, 'default', 1)
    made = {height: sampling._calibration(dataset, 640, height) for height in (480, 482, 479)}
    for height, calibration in made.items():
        assert (calibration.width, calibration.height) == (640, height)
        view = sampling._view(dataset, calibration)
        assert view.height == round(height * view.width / 640)
        assert sampling._calibration(dataset, 640, height) is calibration, 'made once'
    with pytest.raises(CalibrationError, match='the picture is 640x360, expected the aspect of 640x480'):
        sampling._calibration(dataset, 640, 360)


@pytest.mark.parametrize('ahead, cut', [(0.1, True), (0.12, True), (0.3, False), (0.6, False)])
@pytest.mark.parametrize('aside', [0.0, 0.05])
def test_what_the_radius_is_learnt_from_gives_the_radius(
    ahead: float, aside: float, cut: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, detection_settings: Any
) -> None:
    """A forest that says just what it was taught leads the judgement to the true one."""
    thing = Placed(Kind.DUCKIE, ahead, aside)
    label = label_of(thing)
    cv2.imwrite(str(tmp_path / 'a.png'), picture_of(Scene((thing,))))
    shown = read_picture(str(tmp_path / 'a.png'))
    dataset = Dataset('', str(tmp_path), CALIBRATIONS, 'default', 1)
    found = samples_of(dataset, {'file_name': 'a.png', 'width': 640, 'height': 480}, [label], 0)
    assert found is not None
    calibration = default_calibration()
    view = make_view(calibration)
    regions = find_regions(channels_of(working_picture(shown, view), estimate_light(shown), view), view)
    np.testing.assert_array_equal(regions.box * view.scale, found.box)
    chosen = np.flatnonzero(found.overlap > 0.6)
    assert len(chosen) > 3
    assert (found.values[chosen, NAMES.index('cut_low')] == cut).all()
    values = np.zeros((len(regions), len(NAMES)), np.float32)  # only these are asked for the radius
    values[:, : len(QUICK)] = found.values
    for row in chosen:
        taught = {
            'thing': np.where(np.arange(len(regions)) == row, 3.0, -9.0),
            'cone': np.array([-1.0]),
            'foot': found.foot[[row]],
            'radius': found.radius[[row]],
        }
        monkeypatch.setattr(trees, 'shipped', lambda taught=taught: taught)
        monkeypatch.setattr(trees, 'summed', lambda forest, values: forest)
        (one,) = judge(regions.box, values, view, calibration, detection_settings.robust)
        assert (one.row, one.cut) == (row, cut)
        assert one.radius == pytest.approx(thing.radius, rel=1e-3 if cut else 0.05)
        assert cut or one.x == pytest.approx(label['x'], rel=0.02)


def test_copies_are_rolled_either_way() -> None:
    """By a few degrees, and a right angle stays one."""
    turned = []
    for seed in range(20):
        corners = [(150.0, 150.0), (450.0, 150.0), (150.0, 350.0)]
        things = [Thing('duckie', (*corner, 30.0, 30.0), None) for corner in corners]
        blank = np.zeros((480, 640, 3), np.uint8)
        _, kept, _ = sampling._through_another_camera(blank, things, [], np.random.RandomState(seed))
        corner, across, down = np.array([one.box[:2] for one in kept])
        (right, rise), below = across - corner, down - corner
        assert right * below[0] + rise * below[1] == pytest.approx(0, abs=1.0)
        turned.append(np.degrees(np.arctan(rise / right)))
    assert min(turned) < -1.5
    assert max(turned) > 1.5
    assert np.abs(turned).max() <= sampling.ROLL + 1e-6


def test_some_copies_are_lit_by_lamps_of_different_colours() -> None:
    """Shading is the same left and right, noise is everywhere: what is not is the lamps'."""
    grey = np.full((240, 320, 3), 100, np.uint8)
    uneven = []
    for seed in range(30):
        picture = sampling._in_another_light(grey, np.random.RandomState(seed))
        light = cv2.resize(LINEAR[picture], (8, 6), interpolation=cv2.INTER_AREA)
        blueness = np.log2(light[..., 0] / light[..., 2])
        uneven.append(np.abs(blueness - blueness[:, ::-1]).max() > 0.5)
    assert 5 <= sum(uneven) <= 18


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
        *(
            pytest.param(
                {
                    'categories': [{'id': 1, 'name': 'duckie'}],
                    'images': [{'id': 1, 'file_name': 'a.jpg', 'width': 640, 'height': 480}],
                    'annotations': [{'id': 1, 'image_id': 1, 'category_id': 1, 'bbox': [1, 2, 3, 4], **changes}],
                },
                id=name,
            )
            for name, changes in (
                ('a box of three', {'bbox': [1, 2, 3]}),
                ('a radius without a place', {'radius': 0.03}),
                ('no radius to speak of', {'x': 1, 'y': 0, 'radius': 0}),
                ('a radius in words', {'x': 1, 'y': 0, 'radius': 'x'}),
            )
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
