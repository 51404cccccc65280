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

from obst_avoid.core.detection.robust.features import NAMES
from obst_avoid.core.settings import SettingsError
from obst_avoid.core.types import Array

FILE = os.path.join(os.path.dirname(__file__), 'trees.npz')
STAGES = (15, 40, 100, 200)
"""Trees after which hopeless regions are dropped: most need no more (a soft cascade, Bourdev and Brandt 2005)."""


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class Forest:
    """T trees of at most K nodes, (T, K) each; node 0 is a tree's root.

    feature: column of NAMES. threshold: smaller values go left. left, right: nodes; a leaf leads to itself. value: of
    leaves. base: of the sum. depth: steps that reach every leaf. hopeless: for each of STAGES the sum, base included,
    below which the rest is not worth its time.
    """

    feature: Array
    threshold: Array
    left: Array
    right: Array
    value: Array
    base: float
    depth: int
    hopeless: Tuple[float, ...] = ()


def summed(forest: Forest, values: Array) -> Array:
    """(N, F) float32 to (N,) float32: each row's sum, -inf where it is hopeless: the first trees alone say little."""
    total = np.full(len(values), forest.base, dtype=np.float32)
    going, before = np.arange(len(values)), 0
    for stage, least in zip(STAGES, forest.hopeless):
        total[going] += _leaves(forest, values[going], slice(before, stage)).sum(axis=1)
        lost = total[going] < least
        total[going[lost]] = -np.inf
        going, before = going[~lost], stage
    total[going] += _leaves(forest, values[going], slice(before, None)).sum(axis=1)
    return total


def reasons(forest: Forest, values: Array, count: int = 4) -> List[Tuple[str, float]]:
    """What moved the sum of one row, (F,), most: (measurement, by how much), strongest first.

    Each step down a tree changes the mean of the leaves below; that change goes to the measurement that was asked
    (Saabas 2014).
    """
    means = _means(forest)
    trees = np.arange(len(forest.feature))
    node = np.zeros(len(trees), dtype=np.int64)
    moved = np.zeros(len(NAMES))
    for _ in range(forest.depth):
        feature = forest.feature[trees, node]
        down = np.where(
            values[feature] < forest.threshold[trees, node], forest.left[trees, node], forest.right[trees, node]
        )
        np.add.at(moved, feature, means[trees, down] - means[trees, node])
        node = down
    order = np.argsort(-np.abs(moved))[:count]
    return [(NAMES[index], float(moved[index])) for index in order if moved[index]]


@functools.lru_cache(maxsize=1)
def shipped() -> Dict[str, Forest]:
    """The package's forests by name: thing, cone, foot, radius. Raises SettingsError when the file is not usable."""
    try:
        with np.load(FILE) as file:
            names = [str(name) for name in file['names']]
            if names != NAMES:
                raise SettingsError('%s was trained on other measurements, expected those of features.py' % FILE)
            return {name: _loaded(file, name) for name in ('thing', 'cone', 'foot', 'radius')}
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        if isinstance(error, SettingsError):
            raise
        raise SettingsError('%s is no file of train_detector: %s' % (FILE, error)) from error


def _loaded(file: Dict[str, Array], name: str) -> Forest:
    nodes = [file['%s_%s' % (name, part)] for part in ('feature', 'threshold', 'left', 'right', 'value')]
    base, depth = file[name + '_base']
    feature, threshold, left, right, value = nodes
    return Forest(
        feature.astype(np.int64),
        threshold.astype(np.float32),
        left.astype(np.int64),
        right.astype(np.int64),
        value.astype(np.float32),
        float(base),
        int(depth),
        tuple(float(value) for value in file[name + '_hopeless']),
    )


def _leaves(forest: Forest, values: Array, chosen: slice) -> Array:
    """(N, T) value of the leaf that each row reaches in each of the chosen trees."""
    feature, threshold = forest.feature[chosen], forest.threshold[chosen]
    left, right = forest.left[chosen], forest.right[chosen]
    trees = np.arange(len(feature))
    node = np.zeros((len(values), len(trees)), dtype=np.int64)
    rows = np.arange(len(values))[:, None]
    for _ in range(forest.depth):
        lower = values[rows, feature[trees, node]] < threshold[trees, node]
        node = np.where(lower, left[trees, node], right[trees, node])
    reached: Array = forest.value[chosen][trees, node]
    return reached


def _means(forest: Forest) -> Array:
    """(T, K) mean of the leaves below each node, each leaf alike."""
    total, leaves = forest.value.astype(np.float64).copy(), np.ones(forest.value.shape)
    every = np.arange(len(total))
    for node in range(total.shape[1] - 1, -1, -1):  # children come after their parents
        left, right = forest.left[:, node], forest.right[:, node]
        inner = left != node
        total[inner, node] = (total[every, left] + total[every, right])[inner]
        leaves[inner, node] = (leaves[every, left] + leaves[every, right])[inner]
    means: Array = total / leaves
    return means
