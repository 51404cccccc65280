"""Samples to forests, by gradient boosting with XGBoost, and the file that the detector loads."""

import json
from dataclasses import replace
from typing import Any, Dict, List, Optional, Sequence

import numpy as np
import xgboost

from obst_avoid.core.detection.robust.features import NAMES
from obst_avoid.core.detection.robust.trees import FORESTS, NODE, Forest, depths, summed
from obst_avoid.core.types import Array
from obst_avoid.offline.training.samples import Samples

SAME, OTHER = 0.55, 0.3
"""[intersection over union] from which a region is the thing, and below which it is a wrong box of it."""
TREES, FIRST_TREES, FEW_TREES = 450, 100, 60
"""Of the judgement, of the first look at all regions, and of the other forests."""
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
FIRST = {'max_leaves': 24, 'eta': 0.2, 'colsample_bytree': 0.5}
GROWING = {'max_leaves': 24, 'eta': 0.075}
"""What differs for the first look and for the judgement."""
FIRST_STAGES, STAGES = (4, 8, 15, 30, 60, 100), (5, 10, 20, 40, 70, 100, 150, 200, 300)
"""Trees after which hopeless regions are dropped."""
SAFE = 0.005
"""Share of the regions of true things that each stage may drop: a thing has several."""


def first_of(samples: Sequence[Samples], threads: int) -> Forest:
    """The forest that looks at all regions first. samples: of all regions, what is measured on all."""
    true = [things(item) for item in samples]
    used = [same | other for same, other in zip(true, _others(samples, true))]
    values, thing = _of(samples, 'values', used), _rows(true, used)
    return _staged(
        _boosted('binary:logistic', values, thing, FIRST_TREES, threads, **FIRST), values[thing], FIRST_STAGES
    )


def grown(samples: Sequence[Samples], threads: int) -> Dict[str, Forest]:
    """The forests thing, cone, foot and radius. samples: of what the first forest leaves, everything."""
    true = [things(item) for item in samples]
    used = [same | other for same, other in zip(true, _others(samples, true))]
    values, thing = _of(samples, 'values', used), _rows(true, used)
    weights = _weights(_numbered(samples, used), thing)
    judgement = _boosted('binary:logistic', values, thing, TREES, threads, weights, **GROWING)
    values = values[thing]
    cone, foot, radius = (_of(samples, name, true) for name in ('cone', 'foot', 'radius'))

    def regressed(target: Array, most: float) -> Forest:
        known = np.abs(target) < most  # not NaN either
        return _staged(_boosted('reg:squarederror', values[known], target[known], FEW_TREES, threads))

    return {
        'thing': _staged(judgement, values, STAGES),
        'cone': _staged(_boosted('binary:logistic', values, cone, FEW_TREES, threads)),
        'foot': regressed(foot, 0.5),
        'radius': regressed(radius, 2.0),
    }


def things(item: Samples) -> Array:
    """(N,) bool: which regions of a picture teach what a thing looks like."""
    chosen: Array = (item.overlap >= SAME) & ~item.ignored
    return chosen


def _numbered(samples: Sequence[Samples], chosen: Sequence[Array]) -> Array:
    """(N,) int of the chosen rows of all samples: which thing of all pictures each is most alike, -1 none."""
    numbers, before = [np.zeros(0, dtype=np.int64)], 0
    for item, rows in zip(samples, chosen):
        numbers.append(np.where(item.thing[rows] < 0, -1, item.thing[rows] + before))
        before += int(item.thing.max()) + 1
    return np.concatenate(numbers)


def _weights(number: Array, thing: Array) -> Array:
    """(N,) A near thing has dozens of regions, a far one three: counted alike, what is hard to see hardly counts.

    number: of _numbered. thing: (N,) bool. Together things weigh as much as they are regions.
    """
    weights = np.ones(len(thing))
    regions = np.bincount(number[thing], minlength=1)
    weights[thing] = 1 / np.sqrt(regions[number[thing]])
    weights[thing] *= thing.sum() / max(weights[thing].sum(), 1e-9)
    return weights


def _others(samples: Sequence[Samples], true: Sequence[Array]) -> List[Array]:
    """Which regions teach what is no thing."""
    return [~same & ~item.ignored & (~item.touches | (item.overlap < OTHER)) for item, same in zip(samples, true)]


def _of(samples: Sequence[Samples], name: str, chosen: Sequence[Array]) -> Array:
    """The chosen rows of all samples' arrays of that name."""
    return np.concatenate([getattr(item, name)[rows] for item, rows in zip(samples, chosen)])


def _rows(flags: Sequence[Array], chosen: Sequence[Array]) -> Array:
    return np.concatenate([item[rows] for item, rows in zip(flags, chosen)])


def _staged(booster: 'xgboost.Booster', things: Optional[Array] = None, stages: Sequence[int] = ()) -> Forest:
    """A forest that drops, after each of these stages, what nearly all rows of true things have passed."""
    forest = forest_of(booster)
    limits = []
    for stage in stages if things is not None else ():
        part = replace(forest, nodes=np.ascontiguousarray(forest.nodes[:stage]))
        limits.append(float(np.quantile(summed(part, things), SAFE)))
    return replace(forest, stages=np.array(stages, dtype=np.int32), hopeless=np.array(limits, dtype=np.float32))


def forest_of(booster: 'xgboost.Booster') -> Forest:
    """XGBoost's trees as an array. Its leaves hold values, its inner nodes send smaller values to the left."""
    dumped = [_nodes(json.loads(tree)) for tree in booster.get_dump(dump_format='json')]
    nodes = np.zeros((len(dumped), 1 + max(node['nodeid'] for tree in dumped for node in tree)), dtype=NODE)
    nodes['left'] = nodes['right'] = np.arange(nodes.shape[1])
    for tree, branches in enumerate(dumped):
        for node in branches:
            at = tree, node['nodeid']
            if 'leaf' in node:
                nodes['value'][at] = node['leaf']
                continue
            nodes['feature'][at], nodes['value'][at] = int(node['split'][1:]), node['split_condition']
            nodes['left'][at], nodes['right'][at] = node['yes'], node['no']
    nothing = np.zeros((1, booster.num_features()), np.float32)
    base = float(booster.predict(xgboost.DMatrix(nothing), output_margin=True)[0])
    none = np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.float32)
    nodes['depth'][:, 0] = depths(nodes)
    forest = Forest(nodes, 0.0, *none)
    return replace(forest, base=base - float(summed(forest, nothing)[0]))


def _nodes(tree: Dict[str, Any]) -> List[Dict[str, Any]]:
    """A tree and all its branches."""
    return [tree] + [node for branch in tree.get('children', ()) for node in _nodes(branch)]


def write(forests: Dict[str, Forest], path: str) -> None:
    """As trees.shipped reads it."""
    arrays: Dict[str, Any] = {'names': np.array(NAMES)}
    for name in FORESTS:
        forest = forests[name]
        arrays[name + '_nodes'] = forest.nodes
        arrays[name + '_base'] = np.array(forest.base)
        arrays[name + '_stages'], arrays[name + '_hopeless'] = forest.stages, forest.hopeless
    np.savez_compressed(path, **arrays)


def _boosted(
    objective: str,
    values: Array,
    target: Array,
    trees: int,
    threads: int,
    weights: Optional[Array] = None,
    **changes: Any,
) -> 'xgboost.Booster':
    data = xgboost.DMatrix(values, target.astype(np.float32), weight=weights)
    return xgboost.train({**FEW, 'objective': objective, 'nthread': threads, **changes}, data, trees)
