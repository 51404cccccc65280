"""core.detection.robust.trees: forests summed, what moved a sum, and files that hold none."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Sequence, Tuple

import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection import start
from obst_avoid.core.detection.robust import native, trees
from obst_avoid.core.detection.robust.features import NAMES, QUICK
from obst_avoid.core.detection.robust.trees import FORESTS, NODE, Forest, reasons, shipped, summed
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.settings import SettingsError

STAGES = (3, 7, 20)
"""Of forests made up here."""
NEVER = (-np.inf,) * len(STAGES)
"""No row is hopeless."""
SMALL: List[Any] = [
    (3, 0.5, (1, -1.0, -2.0, 0.25), 4.0),
    (0, 0.0, -1.0, (3, 0.75, 0.5, (2, 2.0, 8.0, -8.0))),
    0.125,
]
"""Trees: a number, or feature, threshold, the tree for smaller values, and the one for the others."""


@pytest.fixture(params=['compiled', 'numpy'])
def _path(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both ways to sum."""
    if request.param == 'numpy':
        monkeypatch.setattr(native, 'LIBRARY', None)
    elif native.LIBRARY is None:
        pytest.skip('the compiled path is not built')


both_paths = pytest.mark.usefixtures('_path')


def forest_of(
    given: List[Any], base: float = 0.0, hopeless: Sequence[float] = (), stages: Sequence[int] = STAGES
) -> Forest:
    """Written-down trees as an array; children come after their parents. hopeless: of each stage, or of none."""
    tables: List[List[Tuple[float, ...]]] = []
    for tree in given:
        rows: List[Tuple[float, ...]] = []
        depth = _flat(tree, rows)
        tables.append([(*rows[0][:3], depth, rows[0][4]), *rows[1:]])
    most = max(map(len, tables))
    nodes = np.array([rows + [(0, i, i, 0, 0.0) for i in range(len(rows), most)] for rows in tables], dtype=NODE)
    limits = np.array(hopeless, dtype=np.float32)
    return Forest(nodes, base, np.array(stages[: len(limits)], dtype=np.int32), limits)


def _flat(tree: Any, rows: List[Tuple[float, ...]]) -> int:
    """Appends a tree's nodes, each feature, left, right, 0, value. Returns its depth."""
    at = len(rows)
    if isinstance(tree, float):
        rows.append((0, at, at, 0, tree))
        return 0
    feature, threshold, smaller, rest = tree
    rows.append(())
    left = _flat(smaller, rows)
    second = len(rows)
    right = _flat(rest, rows)
    rows[at] = (feature, at + 1, second, 0, threshold)
    return 1 + max(left, right)


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


@both_paths
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


@both_paths
@pytest.mark.parametrize('rows', [1, 2, 5, 12, 13, 50])
@pytest.mark.parametrize('count', [1, 7, STAGES[0], STAGES[0] + 1, STAGES[-1], STAGES[-1] + 50])
def test_random_forests_are_what_plain_python_says(count: int, rows: int) -> None:
    """With fewer trees than stages name, and as many, and more; rows go down by the dozen."""
    random = np.random.RandomState(count)
    given = [grown(random, 5) for _ in range(count)]
    values = padded(random.randn(rows, 6))
    expected = [0.3 + sum(plain(tree, row) for tree in given) for row in values]
    for hopeless in ((), NEVER):
        found = summed(forest_of(given, 0.3, hopeless), values)
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, atol=1e-4)


@both_paths
def test_no_rows_no_sums() -> None:
    assert summed(forest_of(SMALL), padded(np.zeros((0, 4)))).shape == (0,)
    assert summed(forest_of([1.0] * (STAGES[-1] + 5), 0.0, NEVER), padded(np.zeros((0, 4)))).shape == (0,)


@both_paths
def test_rows_need_only_the_columns_that_are_asked() -> None:
    """The first forest looks at what is measured on all regions, which is less."""
    values = np.random.RandomState(2).randn(30, 4).astype(np.float32)
    np.testing.assert_array_equal(summed(forest_of(SMALL), values), summed(forest_of(SMALL), padded(values)))


@both_paths
@pytest.mark.parametrize('stage', range(len(STAGES)))
def test_hopeless_rows_are_out_for_good(stage: int) -> None:
    """Column 0 of a row says what a tree before the stage's end adds, column 1 what the trees after it add."""
    before, behind = [(0, 0.0, -0.7, 0.7)] * STAGES[stage], [(1, 0.0, -1.0, 100.0)] * 3
    hopeless = [-np.inf] * len(STAGES)
    hopeless[stage] = -2.0
    rows = padded([(-1, 1), (-1, -1), (1, 1), (1, -1)])
    low, high = -1 - 0.7 * STAGES[stage], -1 + 0.7 * STAGES[stage]
    assert low < -2 < high
    forest = forest_of(before + behind, -1.0, hopeless)
    np.testing.assert_allclose(summed(forest, rows), [-np.inf, -np.inf, high + 300, high - 3], rtol=1e-4)
    np.testing.assert_allclose(summed(forest, rows[:2]), [-np.inf, -np.inf], rtol=1e-4)
    forest = forest_of(before + behind, -1.0, NEVER)
    np.testing.assert_allclose(summed(forest, rows), [low + 300, low - 3, high + 300, high - 3], rtol=1e-4)


@both_paths
def test_the_last_stage_may_be_after_the_last_tree() -> None:
    """So a first look drops what all its trees together find hopeless."""
    forest = forest_of([(0, 0.0, -1.0, 1.0)] * STAGES[-1], 0.0, (-np.inf, -np.inf, 0.0))
    assert summed(forest, padded([(-1,), (1,)])).tolist() == [-np.inf, STAGES[-1]]
    forest = forest_of([(0, 0.0, -1.0, 1.0)] * STAGES[1], 0.0, (0.0,), stages=(STAGES[1] + 5,))
    assert summed(forest, padded([(-1,), (1,)])).tolist() == [-np.inf, STAGES[1]]


@both_paths
def test_a_row_exactly_at_hopeless_goes_on() -> None:
    forest = forest_of([0.0] * STAGES[-1] + [5.0], -2.0, (-2.0,) * len(STAGES))
    assert summed(forest, padded([(0,)])).tolist() == [3.0]


@both_paths
def test_each_row_is_summed_by_itself() -> None:
    random = np.random.RandomState(3)
    forest = forest_of([grown(random, 4) for _ in range(STAGES[-1] + 30)], 0.0, (-1.0,) * len(STAGES))
    values = padded(random.randn(41, 6))
    together = summed(forest, values)
    assert 0 < np.isfinite(together).sum() < len(values)
    np.testing.assert_array_equal(together, [summed(forest, row[None])[0] for row in values])
    np.testing.assert_array_equal(summed(forest, np.ascontiguousarray(values[::-1])), together[::-1])


def test_both_paths_give_the_same_sums(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit: what one drops the other drops."""
    if native.LIBRARY is None:
        pytest.skip('the compiled path is not built')
    random = np.random.RandomState(4)
    forest = forest_of([grown(random, 6) for _ in range(STAGES[-1] + 30)], 0.3, (-0.5,) * len(STAGES))
    values = padded(random.randn(300, 6))
    compiled = summed(forest, values)
    monkeypatch.setattr(native, 'LIBRARY', None)
    np.testing.assert_array_equal(summed(forest, values), compiled)


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
    at_the_thresholds = padded([(0, 0, 0, 0, 0, 0)])[0]
    assert reasons(forest, at_the_thresholds) == [(NAMES[2], -3.0), (NAMES[0], 1.0), (NAMES[4], 0.5)]


def test_a_forest_of_leaves_has_no_reasons() -> None:
    assert reasons(forest_of([1.0, 2.0]), padded([(0,)])[0]) == []


# The shipped ones


def test_the_shipped_forests_load_and_are_whole() -> None:
    forests = shipped()
    assert tuple(forests) == FORESTS == ('first', 'thing', 'cone', 'foot', 'radius')
    for name, forest in forests.items():
        nodes = forest.nodes
        count, most = nodes.shape
        every = np.arange(most)[None]
        assert nodes.dtype == NODE
        assert nodes.flags.c_contiguous
        assert count >= 1, name
        known = len(QUICK) if name == 'first' else len(NAMES)
        assert ((nodes['feature'] >= 0) & (nodes['feature'] < known)).all()
        leaf = nodes['left'] == every
        for side in ('left', 'right'):
            assert ((nodes[side] > every) | leaf).all(), 'children come after their parents'
            assert (nodes[side] < most).all()
        assert (leaf == (nodes['right'] == every)).all()
        assert np.isfinite(nodes['value']).all()
        assert np.isfinite(forest.base)
        assert [int(depth) for depth in nodes['depth'][:, 0]] == [_deepest(tree) for tree in nodes]
        stages = forest.stages.tolist()
        assert len(stages) == len(forest.hopeless)
        assert stages == sorted(set(stages))
        assert all(1 <= stage <= count for stage in stages)
        assert np.isfinite(forest.hopeless).all()
    assert [name for name in FORESTS if len(forests[name].stages)] == ['first', 'thing']
    assert shipped() is forests, 'read once'


def _deepest(tree: Any, node: int = 0) -> int:
    """Steps of the longest way down from a node of a (K,) tree."""
    if tree['left'][node] == node:
        return 0
    return 1 + max(_deepest(tree, int(tree[side][node])) for side in ('left', 'right'))


def unstaged(forest: Forest) -> Forest:
    """It drops no row."""
    return replace(forest, stages=forest.stages[:0], hopeless=forest.hopeless[:0])


@both_paths
def test_the_shipped_forests_give_finite_sums_for_anything() -> None:
    values = (np.random.RandomState(0).randn(200, len(NAMES)) * 5).astype(np.float32)
    for forest in shipped().values():
        assert np.isfinite(summed(unstaged(forest), values)).all()
        assert not np.isnan(summed(forest, values)).any()


@both_paths
def test_the_first_forest_asks_only_what_is_measured_on_all_regions() -> None:
    values = (np.random.RandomState(0).randn(200, len(NAMES)) * 5).astype(np.float32)
    quick = np.ascontiguousarray(values[:, : len(QUICK)])
    np.testing.assert_array_equal(summed(shipped()['first'], quick), summed(shipped()['first'], values))


@pytest.mark.parametrize('name', FORESTS)
def test_the_shipped_forests_reasons_add_up(name: str) -> None:
    forest = unstaged(shipped()[name])
    means = _root_means(forest)
    for row in np.random.RandomState(0).randn(5, len(NAMES)).astype(np.float32):
        names, values = zip(*reasons(forest, row, count=len(NAMES)))
        assert len(set(names)) == len(names)
        assert sum(values) == pytest.approx(float(summed(forest, row[None])[0]) - forest.base - means, abs=1e-2)


def _root_means(forest: Forest) -> float:
    """Sum of the trees' means over all their leaves, tree by tree."""
    total = 0.0
    for tree in forest.nodes:
        leaves, todo = [], [0]
        while todo:
            node = todo.pop()
            if tree['left'][node] == node:
                leaves.append(float(tree['value'][node]))
            else:
                todo += [int(tree['left'][node]), int(tree['right'][node])]
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


@pytest.mark.parametrize(
    'missing', ['names', 'first_nodes', 'thing_stages', 'radius_nodes', 'foot_base', 'cone_hopeless']
)
def test_forests_that_are_not_whole_are_refused(
    copied: Any, calibration: Calibration, detection_settings: DetectionSettings, missing: str
) -> None:
    path = copied(**{missing: None})
    with pytest.raises(SettingsError, match='is no file of train_detector: .*%s' % missing) as refused:
        start(calibration, replace(detection_settings, profile='robust'))
    assert str(refused.value).startswith(path)


def with_(name: str, tree: int, node: int, **changes: float) -> Callable[[Any], Dict[str, Any]]:
    """One node of the shipped forest of that name changed."""

    def change(file: Any) -> Dict[str, Any]:
        nodes = file[name + '_nodes'].copy()
        for field, value in changes.items():
            nodes[field][tree, node] = value
        return {name + '_nodes': nodes}

    return change


def but(name: str, made: Callable[[Any], Any]) -> Callable[[Any], Dict[str, Any]]:
    """One array of the file made from the shipped one."""
    return lambda file: {name: made(file[name])}


BROKEN = [
    pytest.param('thing', with_('thing', 3, 0, left=0), id='a way that ends nowhere'),
    pytest.param('thing', with_('thing', 3, 1, right=0), id='a way back'),
    pytest.param('cone', with_('cone', 0, 0, right=500), id='a child that is not there'),
    pytest.param('cone', with_('cone', 0, 0, left=-1), id='a child before the first node'),
    pytest.param('radius', with_('radius', 59, 0, feature=len(NAMES)), id='a measurement too many'),
    pytest.param('foot', with_('foot', 0, 0, feature=-1), id='a measurement before the first'),
    pytest.param('first', with_('first', 0, 0, feature=len(QUICK)), id='the first look asks what is measured later'),
    pytest.param('foot', with_('foot', 2, 0, value=np.nan), id='no threshold'),
    pytest.param('foot', with_('foot', 2, 0, value=np.inf), id='a threshold without end'),
    pytest.param('thing', with_('thing', 5, 0, depth=1), id='too few steps to reach the leaves'),
    pytest.param('thing', but('thing_nodes', lambda nodes: nodes['value']), id='numbers instead of nodes'),
    pytest.param(
        'thing',
        but('thing_nodes', lambda nodes: nodes.astype([(field, np.float64) for field in NODE.names])),
        id='nodes of other numbers',
    ),
    pytest.param('first', but('first_nodes', lambda nodes: nodes[0]), id='a tree instead of trees'),
    pytest.param('first', but('first_nodes', lambda nodes: nodes[:0]), id='no tree'),
    pytest.param('first', but('first_nodes', lambda nodes: nodes[:, :0]), id='no nodes'),
    pytest.param('thing', but('thing_stages', lambda stages: stages[1:]), id='a limit without a stage'),
    pytest.param('first', but('first_hopeless', lambda limits: limits[1:]), id='a stage without a limit'),
    pytest.param('first', but('first_stages', lambda stages: stages[::-1]), id='stages that go back'),
    pytest.param('first', but('first_stages', lambda stages: stages + 1), id='a stage after the last tree'),
    pytest.param('first', but('first_hopeless', lambda limits: limits * np.nan), id='limits that are none'),
    pytest.param('cone', but('cone_base', lambda base: np.array(np.nan)), id='no base'),
]


@pytest.mark.parametrize('name, change', BROKEN)
def test_broken_forests_are_refused(
    copied: Any,
    calibration: Calibration,
    detection_settings: DetectionSettings,
    name: str,
    change: Callable[[Any], Dict[str, Any]],
) -> None:
    """Else the compiled path would look where nothing is, or judge by what was never learnt."""
    with np.load(trees.FILE) as file:
        changes = change(file)
    path = copied(**changes)
    with pytest.raises(SettingsError) as refused:
        start(calibration, replace(detection_settings, profile='robust'))
    assert str(refused.value) == '%s is no file of train_detector: the forest %s is broken' % (path, name)


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
