"""core.detection.robust.trees: forests summed, what moved a sum, and files that hold none."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection import start
from obst_avoid.core.detection.robust import trees
from obst_avoid.core.detection.robust.features import NAMES
from obst_avoid.core.detection.robust.trees import STAGES, Forest, reasons, shipped, summed
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.settings import SettingsError

NEVER = (-np.inf,) * len(STAGES)
"""No row is hopeless."""
SMALL: List[Any] = [
    (3, 0.5, (1, -1.0, -2.0, 0.25), 4.0),
    (0, 0.0, -1.0, (3, 0.75, 0.5, (2, 2.0, 8.0, -8.0))),
    0.125,
]
"""Trees: a number, or feature, threshold, the tree for smaller values, and the one for the others."""


def forest_of(given: List[Any], base: float = 0.0, hopeless: Tuple[float, ...] = ()) -> Forest:
    """Written-down trees as arrays; children come after their parents."""
    tables: List[List[List[float]]] = []
    depths = []
    for tree in given:
        rows: List[List[float]] = []
        depths.append(_flat(tree, rows))
        tables.append(rows)
    most = max(map(len, tables))
    nodes = np.array([rows + [[0, 0, i, i, 0] for i in range(len(rows), most)] for rows in tables])
    feature, left, right = (nodes[..., i].astype(np.int64) for i in (0, 2, 3))
    threshold, value = (nodes[..., i].astype(np.float32) for i in (1, 4))
    return Forest(feature, threshold, left, right, value, base, max(depths), hopeless)


def _flat(tree: Any, rows: List[List[float]]) -> int:
    at = len(rows)
    if isinstance(tree, float):
        rows.append([0, 0, at, at, tree])
        return 0
    feature, threshold, smaller, rest = tree
    row: List[float] = [feature, threshold, 0, 0, 0]
    rows.append(row)
    row[2] = len(rows)
    left = _flat(smaller, rows)
    row[3] = len(rows)
    return 1 + max(left, _flat(rest, rows))


def plain(tree: Any, row: Any) -> float:
    """The value of the leaf that one row reaches."""
    while not isinstance(tree, float):
        feature, threshold, smaller, rest = tree
        tree = smaller if row[feature] < np.float32(threshold) else rest
    return tree


def mean(tree: Any) -> Tuple[float, int]:
    """Sum and number of the leaves."""
    if isinstance(tree, float):
        return tree, 1
    (one, some), (other, more) = mean(tree[2]), mean(tree[3])
    return one + other, some + more


def grown(random: Any, depth: int) -> Any:
    """A random tree."""
    if depth == 0 or random.rand() < 0.15:
        return float(np.float32(random.randn()))
    return (
        int(random.randint(6)),
        float(np.float32(random.randn())),
        grown(random, depth - 1),
        grown(random, depth - 1),
    )


def padded(rows: Any) -> np.ndarray:
    """(N, F) float32 of as many columns as there are names."""
    rows = np.asarray(rows, dtype=np.float32)
    return np.concatenate([rows, np.zeros((len(rows), len(NAMES) - rows.shape[1]), np.float32)], axis=1)


@pytest.mark.parametrize(
    'row, total',
    [
        pytest.param((0, -2, 0, 0), -2 + 0.5, id='left, left; right, left'),
        pytest.param((-1, 0, 0, 0), 0.25 - 1, id='left, right; left'),
        pytest.param((0, 0, 0, 0.5), 4 + 0.5, id='at a threshold goes right'),
        pytest.param((0, 0, 1, 0.75), 4 + 8, id='three steps, left'),
        pytest.param((0, 0, 2, 9), 4 - 8, id='three steps, right'),
    ],
)
def test_a_small_forest_by_hand(row: Tuple[float, ...], total: float) -> None:
    assert summed(forest_of(SMALL, base=1.0), padded([row])).tolist() == [1.0 + total + 0.125]


@pytest.mark.parametrize('count', [1, 7, STAGES[0], STAGES[0] + 1, STAGES[-1] + 50])
def test_random_forests_are_what_plain_python_says(count: int) -> None:
    random = np.random.RandomState(count)
    given = [grown(random, 5) for _ in range(count)]
    values = padded(random.randn(50, 6))
    expected = [0.3 + sum(plain(tree, row) for tree in given) for row in values]
    for hopeless in ((), NEVER):
        np.testing.assert_allclose(summed(forest_of(given, 0.3, hopeless), values), expected, atol=1e-4)


def test_no_rows_no_sums() -> None:
    assert summed(forest_of(SMALL), padded(np.zeros((0, 4)))).shape == (0,)
    assert summed(forest_of([1.0] * (STAGES[-1] + 5), 0.0, NEVER), padded(np.zeros((0, 4)))).shape == (0,)


def test_stages_come_one_after_the_other() -> None:
    assert list(STAGES) == sorted(set(STAGES))
    assert STAGES[0] >= 1


@pytest.mark.parametrize('stage', range(len(STAGES)))
def test_hopeless_rows_are_out_for_good(stage: int) -> None:
    """Column 0 of a row says what a tree before the stage's end adds, column 1 what the trees after it add."""
    before, behind = [(0, 0.0, -0.1, 0.1)] * STAGES[stage], [(1, 0.0, -1.0, 100.0)] * 3
    hopeless = [-np.inf] * len(STAGES)
    hopeless[stage] = -2.0
    rows = padded([(-1, 1), (-1, -1), (1, 1), (1, -1)])
    low, high = -1 - 0.1 * STAGES[stage], -1 + 0.1 * STAGES[stage]
    assert low < -2 < high
    forest = forest_of(before + behind, -1.0, tuple(hopeless))
    np.testing.assert_allclose(summed(forest, rows), [-np.inf, -np.inf, high + 300, high - 3], rtol=1e-4)
    np.testing.assert_allclose(summed(forest, rows[:2]), [-np.inf, -np.inf], rtol=1e-4)
    forest = forest_of(before + behind, -1.0, NEVER)
    np.testing.assert_allclose(summed(forest, rows), [low + 300, low - 3, high + 300, high - 3], rtol=1e-4)


def test_a_row_exactly_at_hopeless_goes_on() -> None:
    forest = forest_of([0.0] * STAGES[-1] + [5.0], -2.0, (-2.0,) * len(STAGES))
    assert summed(forest, padded([(0,)])).tolist() == [3.0]


def test_each_row_is_summed_by_itself() -> None:
    random = np.random.RandomState(3)
    forest = forest_of([grown(random, 4) for _ in range(STAGES[-1] + 30)], 0.0, (-1.0,) * len(STAGES))
    values = padded(random.randn(40, 6))
    together = summed(forest, values)
    np.testing.assert_allclose(together, [summed(forest, row[None])[0] for row in values], rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(summed(forest, values[::-1]), together[::-1])


def test_reasons_add_up_to_the_sum_less_the_mean_of_the_leaves() -> None:
    random = np.random.RandomState(5)
    given = [grown(random, 5) for _ in range(30)]
    forest = forest_of(given, base=0.7)
    means = sum(total / count for total, count in map(mean, given))
    for row in padded(random.randn(20, 6)):
        moved = reasons(forest, row, count=len(NAMES))
        assert sum(value for _, value in moved) == pytest.approx(
            float(summed(forest, row[None])[0]) - 0.7 - means, abs=1e-4
        )


def test_reasons_are_the_strongest_measurements_first() -> None:
    forest = forest_of([(0, 0.0, -1.0, 1.0), (2, 0.0, 3.0, -3.0), (4, 0.0, -0.5, 0.5), (5, 0.0, 0.0, 0.0)])
    row = padded([(1, 0, 1, 0, -1, 0)])[0]
    expected = [(NAMES[2], -3.0), (NAMES[0], 1.0), (NAMES[4], -0.5)]
    assert reasons(forest, row) == expected
    assert reasons(forest, row, count=2) == expected[:2]


def test_a_forest_of_leaves_has_no_reasons() -> None:
    assert reasons(forest_of([1.0, 2.0]), padded([(0,)])[0]) == []


# The shipped ones


def test_the_shipped_forests_load_and_are_whole() -> None:
    forests = shipped()
    assert set(forests) == {'thing', 'cone', 'foot', 'radius'}
    for name, forest in forests.items():
        count, most = forest.feature.shape
        every = np.arange(most)[None]
        assert count >= 1, name
        assert ((forest.feature >= 0) & (forest.feature < len(NAMES))).all()
        for side in (forest.left, forest.right):
            assert ((side >= every) & (side < most)).all(), 'children come after their parents'
        assert ((forest.left == every) == (forest.right == every)).all()
        assert np.isfinite(forest.value).all()
        assert np.isfinite(forest.threshold).all()
        assert np.isfinite(forest.base)
        node = np.zeros(count, dtype=int)
        for side in (forest.left, forest.right):
            node[:] = 0
            for _ in range(forest.depth):
                node = side[np.arange(count), node]
            assert (side[np.arange(count), node] == node).all(), 'depth reaches every leaf'
    assert shipped() is forests, 'read once'


def test_the_shipped_forests_give_finite_sums_for_anything() -> None:
    values = (np.random.RandomState(0).randn(200, len(NAMES)) * 5).astype(np.float32)
    for forest in shipped().values():
        assert np.isfinite(summed(replace(forest, hopeless=()), values)).all()
        assert not np.isnan(summed(forest, values)).any()


def test_the_shipped_forests_reasons_add_up() -> None:
    forest = shipped()['thing']
    for row in np.random.RandomState(0).randn(5, len(NAMES)).astype(np.float32):
        names, values = zip(*reasons(forest, row, count=len(NAMES)))
        assert len(set(names)) == len(names)
        whole = replace(forest, hopeless=())
        means = _root_means(whole)
        assert sum(values) == pytest.approx(float(summed(whole, row[None])[0]) - forest.base - means, abs=1e-2)


def _root_means(forest: Forest) -> float:
    """Sum of the trees' means over all their leaves, tree by tree."""
    total = 0.0
    for tree in range(len(forest.feature)):
        leaves, todo = [], [0]
        while todo:
            node = todo.pop()
            if forest.left[tree, node] == node:
                leaves.append(float(forest.value[tree, node]))
            else:
                todo += [int(forest.left[tree, node]), int(forest.right[tree, node])]
        total += sum(leaves) / len(leaves)
    return total


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Writes a changed copy of the shipped file in its place."""

    def change(**changes: Any) -> str:
        path = tmp_path / 'trees.npz'
        with np.load(shipped_file) as file:
            arrays: Dict[str, Any] = {name: file[name] for name in file.files}
        arrays.update(changes)
        np.savez(str(path), **{name: value for name, value in arrays.items() if value is not None})
        monkeypatch.setattr(trees, 'FILE', str(path))
        return str(path)

    shipped_file = trees.FILE
    shipped.cache_clear()
    yield change
    shipped.cache_clear()


@pytest.mark.parametrize(
    'names',
    [
        pytest.param(NAMES[:-1], id='one less'),
        pytest.param(NAMES[::-1], id='another order'),
        pytest.param([*NAMES[:-1], 'smell'], id='another name'),
        pytest.param([], id='none'),
    ],
)
def test_forests_of_other_measurements_are_refused(
    copied: Any, calibration: Calibration, detection_settings: DetectionSettings, names: List[str]
) -> None:
    path = copied(names=np.array(names, dtype=str))
    for call in (shipped, lambda: start(calibration, replace(detection_settings, profile='robust'))):
        with pytest.raises(SettingsError) as refused:
            call()
        assert str(refused.value) == '%s was trained on other measurements, expected those of features.py' % path


def a_part(whole: bytes) -> bytes:
    """As after a copy that broke off."""
    return whole[: len(whole) // 2]


@pytest.mark.parametrize(
    'change',
    [
        pytest.param(lambda whole: None, id='missing'),
        pytest.param(a_part, id='the first half'),
        pytest.param(lambda whole: whole[:-1], id='all but a byte'),
        pytest.param(lambda whole: whole[:3], id='three bytes'),
        pytest.param(lambda whole: b'', id='empty'),
        pytest.param(lambda whole: b'<html>404</html>', id='text'),
    ],
)
def test_a_detector_does_not_start_without_its_forests(
    copied: Any, calibration: Calibration, detection_settings: DetectionSettings, change: Callable[[bytes], Any]
) -> None:
    """Else it would be told at the first thing on the road."""
    path = Path(copied())
    content = change(path.read_bytes())
    path.unlink()
    if content is not None:
        path.write_bytes(content)
    for _ in range(2):
        with pytest.raises(SettingsError) as refused:
            start(calibration, replace(detection_settings, profile='robust'))
        said = str(refused.value)
        assert said.startswith('%s is no file of train_detector: ' % path)
        assert '\n' not in said
    assert start(calibration, replace(detection_settings, profile='paper')), 'that profile needs none'


@pytest.mark.parametrize('missing', ['names', 'thing_feature', 'radius_value', 'foot_base', 'cone_hopeless'])
def test_forests_that_are_not_whole_are_refused(
    copied: Any, calibration: Calibration, detection_settings: DetectionSettings, missing: str
) -> None:
    path = copied(**{missing: None})
    with pytest.raises(SettingsError, match='is no file of train_detector: .*%s' % missing) as refused:
        start(calibration, replace(detection_settings, profile='robust'))
    assert str(refused.value).startswith(path)


def test_a_copy_of_the_file_gives_the_same(copied: Any) -> None:
    values = np.random.RandomState(0).randn(20, len(NAMES)).astype(np.float32)
    before = {name: summed(forest, values) for name, forest in shipped().items()}
    shipped.cache_clear()
    copied()
    for name, forest in shipped().items():
        np.testing.assert_array_equal(summed(forest, values), before[name])


def test_the_file_lies_beside_the_code_and_is_small() -> None:
    path = Path(trees.FILE)
    assert path.name == 'trees.npz'
    assert path.parent == Path(trees.__file__).parent
    assert path.stat().st_size < 3_000_000
