"""Sums of small decision trees: how the measurements of a region are weighed.

Each tree adds a number; their sum is the logarithm of the odds that the region is a thing that stands on the road
(gradient boosting, Friedman 2001), or for the other forests a kind, a foot, a size. trees.npz is written by
train_detector; nothing in it is tuned by hand.
"""

import functools
import os
import zipfile
import zlib
from dataclasses import dataclass
from typing import Dict, List, Tuple

import numpy as np

from obst_avoid.core.detection.robust import native
from obst_avoid.core.detection.robust.features import NAMES, QUICK
from obst_avoid.core.detection.robust.native import NODE
from obst_avoid.core.settings import SettingsError
from obst_avoid.core.types import Array

FILE = os.path.join(os.path.dirname(__file__), 'trees.npz')
FORESTS = ('first', 'thing', 'cone', 'foot', 'radius')


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class Forest:
    """T trees of at most K nodes.

    nodes: (T, K) NODE; node 0 is a tree's root, children come after their parents. base: of the sum. stages: (S,)
    int32, trees after which rows are dropped whose sum, base included, is below hopeless, (S,) float32: most need no
    more trees (a soft cascade, Bourdev and Brandt 2005).
    """

    nodes: Array
    base: float
    stages: Array
    hopeless: Array


def summed(forest: Forest, values: Array) -> Array:
    """(N, F) float32 to (N,) float32: each row's sum, -inf where it is hopeless."""
    total = native.summed(forest.nodes, forest.stages, forest.hopeless, values, forest.base)
    if total is not None:
        return total
    total = np.full(len(values), forest.base, dtype=np.float32)
    going, before = np.arange(len(values)), 0
    for stage, least in zip(forest.stages.tolist(), forest.hopeless.tolist()):
        total[going] = _added(total[going], forest, values[going], slice(before, stage))
        lost = total[going] < least
        total[going[lost]] = -np.inf
        going, before = going[~lost], stage
    total[going] = _added(total[going], forest, values[going], slice(before, None))
    return total


def reasons(forest: Forest, values: Array, count: int = 4) -> List[Tuple[str, float]]:
    """What moved the sum of one row, (F,), most: (measurement, by how much), strongest first.

    Each step down a tree changes the mean of the leaves below; that change goes to the measurement that was asked
    (Saabas 2014).
    """
    nodes, means = forest.nodes, _means(forest.nodes)
    trees = np.arange(len(nodes))
    node = np.zeros(len(trees), dtype=np.int64)
    moved = np.zeros(len(NAMES))
    for _ in range(nodes['depth'].max()):
        here = nodes[trees, node]
        down = np.where(values[here['feature']] < here['value'], here['left'], here['right'])
        np.add.at(moved, here['feature'], means[trees, down] - means[trees, node])
        node = down
    order = np.argsort(-np.abs(moved))[:count]
    return [(NAMES[index], float(moved[index])) for index in order if moved[index]]


@functools.lru_cache(maxsize=1)
def shipped() -> Dict[str, Forest]:
    """The package's FORESTS by name. Raises SettingsError when the file is not usable."""
    try:
        with np.load(FILE) as file:
            if [str(name) for name in file['names']] != NAMES:
                raise SettingsError('%s was trained on other measurements, expected those of features.py' % FILE)
            return {name: _loaded(file, name) for name in FORESTS}
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        if isinstance(error, SettingsError):
            raise
        raise SettingsError('%s is no file of train_detector: %s' % (FILE, error)) from error


def _loaded(file: Dict[str, Array], name: str) -> Forest:
    nodes, stages, hopeless = (file['%s_%s' % (name, part)] for part in ('nodes', 'stages', 'hopeless'))
    base = float(file[name + '_base'])
    asked = len(QUICK if name == 'first' else NAMES)
    passed = np.diff(np.concatenate([[0], stages, [len(nodes) + 1]]))
    staged = stages.shape == hopeless.shape == (len(stages),) and (passed > 0).all() and np.isfinite(hopeless).all()
    if not (staged and np.isfinite(base) and _sound(nodes, asked)):
        raise ValueError('the forest %s is broken' % name)
    return Forest(nodes, base, stages.astype(np.int32), hopeless.astype(np.float32))


def depths(nodes: Array) -> Array:
    """(T,) steps until every way down a tree has ended in a leaf. nodes: as in Forest, but for the depths."""
    depth = np.zeros(nodes.shape, dtype=np.int64)
    trees = np.arange(len(nodes))
    for node in range(nodes.shape[1]):  # children come after their parents
        inner = nodes['left'][:, node] != node
        for side in ('left', 'right'):
            depth[trees[inner], nodes[side][inner, node]] = depth[inner, node] + 1
    deepest: Array = depth.max(axis=1)
    return deepest


def _sound(nodes: Array, asked: int = len(NAMES)) -> bool:
    """Whether every way down each tree ends in a leaf, and every question asks one of so many measurements."""
    if nodes.dtype != NODE or nodes.ndim != 2 or not nodes.size:
        return False
    own = np.arange(nodes.shape[1])
    leaf = (nodes['left'] == own) & (nodes['right'] == own)
    later = np.minimum(nodes['left'], nodes['right']) > own
    inside = np.maximum(nodes['left'], nodes['right']) < len(own)
    known = (nodes['feature'] >= 0) & (nodes['feature'] < asked)
    whole = ((later | leaf) & inside & known & np.isfinite(nodes['value'])).all()
    return bool(whole and (nodes['depth'][:, 0] >= depths(nodes)).all())


def _added(total: Array, forest: Forest, values: Array, chosen: slice) -> Array:
    """(N,) sums and the leaves that rows reach in each of the chosen trees, tree by tree as the compiled path adds."""
    nodes = forest.nodes[chosen]
    if not len(nodes):
        return total
    trees = np.arange(len(nodes))
    node = np.zeros((len(values), len(trees)), dtype=np.int64)
    rows = np.arange(len(values))[:, None]
    for _ in range(nodes['depth'].max()):
        here = nodes[trees, node]
        node = np.where(values[rows, here['feature']] < here['value'], here['left'], here['right'])
    for column in nodes['value'][trees, node].T:
        total = total + column
    return total


def _means(nodes: Array) -> Array:
    """(T, K) mean of the leaves below each node, each leaf alike."""
    leaf = nodes['left'] == np.arange(nodes.shape[1])
    total, leaves = np.where(leaf, nodes['value'], 0).astype(np.float64), np.ones(nodes.shape)
    every = np.arange(len(total))
    for node in range(total.shape[1] - 1, -1, -1):  # children come after their parents
        left, right, inner = nodes['left'][:, node], nodes['right'][:, node], ~leaf[:, node]
        total[inner, node] = (total[every, left] + total[every, right])[inner]
        leaves[inner, node] = (leaves[every, left] + leaves[every, right])[inner]
    means: Array = total / leaves
    return means
