"""Samples to forests, by gradient boosting with XGBoost, and the file that the detector loads."""

import json
from dataclasses import replace
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np
import xgboost

from obst_avoid.core.detection.robust.features import NAMES
from obst_avoid.core.detection.robust.trees import STAGES, Forest, summed
from obst_avoid.core.types import Array
from obst_avoid.offline.training.samples import Samples

SAME, OTHER = 0.55, 0.3
"""[intersection over union] from which a region is the thing, and below which it is a wrong box of it."""
SHARE, HARD = 0.1, -3.0
"""Share of what is no thing that a first forest sees; what it does not put below HARD, the second one sees."""
TREES, FIRST_TREES, FEW_TREES = 450, 60, 60
"""Of the judgement, of the search for hard regions, and of the other forests."""
FEW: Dict[str, Any] = {
    'tree_method': 'hist',
    'grow_policy': 'lossguide',
    'max_depth': 8,
    'max_leaves': 8,
    'max_bin': 64,
    'eta': 0.1,
    'lambda': 5.0,
    'min_child_weight': 8.0,
    'subsample': 0.6,
    'colsample_bytree': 0.25,
    'seed': 1,
}
GROWING = {'max_leaves': 24, 'eta': 0.075}
"""What differs for the judgement."""
SAFE = 0.005
"""Share of the regions of true things that each stage may drop: a thing has several."""


def grown(samples: Sequence[Samples], threads: int) -> Dict[str, Forest]:
    """The forests thing, cone, foot and radius."""
    random = np.random.RandomState(0)
    true = [things(item) for item in samples]
    wrong = [~same & ~item.ignored & (~item.touches | (item.overlap < OTHER)) for item, same in zip(samples, true)]
    sampled = [other & (random.rand(len(other)) < SHARE) for other in wrong]
    first = [same | some for same, some in zip(true, sampled)]
    quick = _boosted('binary:logistic', _of(samples, 'values', first), _rows(true, first), None, FIRST_TREES, threads)
    hard = [other & (_predicted(quick, item.values) > HARD) for item, other in zip(samples, wrong)]
    used = [same | some | other for same, some, other in zip(true, sampled, hard)]
    values, thing = _of(samples, 'values', used), _rows(true, used)
    weight = np.where(thing | _rows(hard, used), 1.0, 1 / SHARE)
    judgement = forest_of(_boosted('binary:logistic', values, thing, weight, TREES, threads, **GROWING))
    values = values[thing]
    cone, foot, radius = (_of(samples, name, true) for name in ('cone', 'foot', 'radius'))

    def regressed(target: Array, most: float) -> Forest:
        known = np.abs(target) < most  # not NaN either
        return forest_of(_boosted('reg:squarederror', values[known], target[known], None, FEW_TREES, threads))

    return {
        'thing': replace(judgement, hopeless=hopeless(judgement, values)),
        'cone': forest_of(_boosted('binary:logistic', values, cone, None, FEW_TREES, threads)),
        'foot': regressed(foot, 0.5),
        'radius': regressed(radius, 2.0),
    }


def things(item: Samples) -> Array:
    """(N,) bool: which regions of a picture teach what a thing looks like."""
    chosen: Array = (item.overlap >= SAME) & ~item.ignored
    return chosen


def _of(samples: Sequence[Samples], name: str, chosen: Sequence[Array]) -> Array:
    """The chosen rows of all samples' arrays of that name."""
    return np.concatenate([getattr(item, name)[rows] for item, rows in zip(samples, chosen)])


def _rows(flags: Sequence[Array], chosen: Sequence[Array]) -> Array:
    return np.concatenate([item[rows] for item, rows in zip(flags, chosen)])


def hopeless(forest: Forest, values: Array) -> Tuple[float, ...]:
    """What nearly all rows of true things have reached after each of STAGES."""
    limits = []
    for stage in STAGES:
        parts = (forest.feature, forest.threshold, forest.left, forest.right, forest.value)
        first = Forest(*(part[:stage] for part in parts), forest.base, forest.depth)
        sums = [summed(first, some) for some in np.array_split(values, max(1, len(values) // 2000))]
        limits.append(float(np.quantile(np.concatenate(sums), SAFE)))
    return tuple(limits)


def forest_of(booster: 'xgboost.Booster') -> Forest:
    """XGBoost's trees as arrays. Its leaves hold values, its inner nodes send smaller values to the left."""
    dumped = [_nodes(json.loads(tree)) for tree in booster.get_dump(dump_format='json')]
    trees, most = len(dumped), 1 + max(node['nodeid'] for nodes in dumped for node in nodes)
    feature = np.zeros((trees, most), dtype=np.int16)
    threshold = np.zeros((trees, most), dtype=np.float32)
    left = np.tile(np.arange(most, dtype=np.int16), (trees, 1))
    right, value = left.copy(), np.zeros((trees, most), dtype=np.float32)
    for tree, nodes in enumerate(dumped):
        for node in nodes:
            at = tree, node['nodeid']
            if 'leaf' in node:
                value[at] = node['leaf']
                continue
            feature[at], threshold[at] = int(node['split'][1:]), node['split_condition']
            left[at], right[at] = node['yes'], node['no']
    base = float(booster.predict(xgboost.DMatrix(np.zeros((1, len(NAMES)), np.float32)), output_margin=True)[0])
    forest = Forest(feature, threshold, left, right, value, 0.0, _depth(left, right))
    base -= float(summed(forest, np.zeros((1, len(NAMES)), np.float32))[0])
    return Forest(feature, threshold, left, right, value, base, forest.depth)


def _nodes(tree: Dict[str, Any]) -> List[Dict[str, Any]]:
    """A tree and all its branches."""
    return [tree] + [node for branch in tree.get('children', ()) for node in _nodes(branch)]


def write(forests: Dict[str, Forest], path: str) -> None:
    """As trees.shipped reads it."""
    arrays: Dict[str, Any] = {'names': np.array(NAMES)}
    for name, forest in forests.items():
        for part in ('feature', 'threshold', 'left', 'right', 'value'):
            kind = np.int16 if part in ('feature', 'left', 'right') else np.float32
            arrays['%s_%s' % (name, part)] = getattr(forest, part).astype(kind)
        arrays[name + '_base'] = np.array([forest.base, forest.depth])
        arrays[name + '_hopeless'] = np.array(forest.hopeless, dtype=np.float64)
    np.savez_compressed(path, **arrays)


def _boosted(
    objective: str,
    values: Array,
    target: Array,
    weight: Optional[Array],
    trees: int,
    threads: int,
    **changes: Any,
) -> 'xgboost.Booster':
    data = xgboost.DMatrix(values, target.astype(np.float32), weight=weight)
    return xgboost.train({**FEW, 'objective': objective, 'nthread': threads, **changes}, data, trees)


def _predicted(booster: 'xgboost.Booster', values: Array) -> Array:
    return booster.predict(xgboost.DMatrix(values), output_margin=True)


def _depth(left: Array, right: Array) -> int:
    """Steps until every tree's way has ended in a leaf."""
    reached = np.zeros(left.shape, dtype=np.int64)
    depth = np.zeros(left.shape, dtype=np.int64)
    reached[:, 0] = 1
    trees = np.arange(len(left))
    for node in range(left.shape[1]):
        inner = (left[:, node] != node) & (reached[:, node] == 1)
        for side in (left, right):
            child = side[:, node]
            depth[trees[inner], child[inner]] = depth[trees[inner], node] + 1
            reached[trees[inner], child[inner]] = 1
    return int(depth.max())
