"""Calls native.c, the compiled path. Each function returns None where it is not built; then numpy does the work.

So it does where native.c has no room for what is asked, or would have to look beyond what it is given. An array of
another type or shape than expected is a ValueError: C would not see the difference.
"""

import ctypes
import glob
import os
import sys
import warnings
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

import obst_avoid
from obst_avoid.core.types import Array

MOST = 1 << 15
"""Regions of one picture that are looked at: a picture of nothing but noise has half as many."""
INTERFACE = 1
"""Of native.c; another number when what is passed changes."""
REFUSED = -2
"""What it returns for what it cannot do."""
REGION, QUICK, FULL, SUMS, RANGE = 28, 37, 427, 8, 1024
"""Numbers in its Region, in rows of what quick and full measure, of a pixel in sums; steps of logarithms."""
BYTE, SHORT, WORD, INT, LONG = (np.dtype(name) for name in ('uint8', 'int16', 'uint16', 'int32', 'int64'))
BOOL, FLOAT, DOUBLE = (np.dtype(name) for name in ('bool', 'float32', 'float64'))
NODE = np.dtype([(name, SHORT) for name in ('feature', 'left', 'right', 'depth')] + [('value', FLOAT)])
"""Of a tree. feature: column of features.NAMES. left, right: nodes; of a leaf itself. depth: of a root, steps that
reach every leaf. value: smaller ones go left; of a leaf what it adds."""


def _load() -> Optional[Any]:
    beside = [os.path.join(folder, 'obst_avoid') for folder in sys.path]  # a worker may find the sources first
    for folder in dict.fromkeys([*obst_avoid.__path__, *beside]):
        for path in sorted(glob.glob(os.path.join(folder, '_native*.so'))):
            try:
                library = ctypes.CDLL(path)
                if library.interface() == INTERFACE:
                    return library
                problem = 'it was built from another version'
            except (OSError, AttributeError) as error:  # for another machine, or no library of ours
                problem = str(error)
            warnings.warn('%s is not used, and detection is slow without it: %s' % (path, problem), stacklevel=1)
    return None


LIBRARY = _load()


class _View(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int32) for name in ('rows', 'width', 'top', 'height')] + [
        (name, ctypes.c_void_p) for name in ('nearness', 'bearing')
    ]
    kept: Tuple[Array, Array]  # what these point to


def channels(rows: Array, logarithms: Array, less: Array, steps: Array, light: Array) -> Optional[Tuple[Array, Array]]:
    """Heights and sums of channels.Channels, but for the channels that OpenCV makes. rows: (R, W, 3) uint8."""
    if LIBRARY is None:
        return None
    count, width = rows.shape[:2]
    heights = np.empty((7, count, width), dtype=np.uint8)
    sums = np.empty((count + 1, width + 1, SUMS), dtype=np.int32)
    both = light[0] + light[1].astype(np.uint16) * 256
    _expect(rows, BYTE, count, width, 3)
    _expect(logarithms, SHORT, 3, 256)
    _expect(less, SHORT, 2 * RANGE)
    _expect(steps, BYTE, 3, 2 * RANGE)
    _expect(both, WORD, 256)
    found = _call(LIBRARY.channels, rows, count, width, logarithms, less, steps, both, heights, sums)
    return None if found == REFUSED else (heights, sums)


def morphed(height: Array, bands: Array, closing: bool, result: Array) -> bool:
    """channels.opened or, closing, channels.joined."""
    if LIBRARY is None:
        return False
    rows, width = height.shape
    _expect(height, BYTE, rows, width)
    _expect(bands, INT, len(bands), 3)
    _expect(result, BYTE, rows, width)
    return _call(LIBRARY.morphed, height, rows, width, bands, len(bands), int(closing), result) != REFUSED


def regions(
    heights: Array, sums: Array, count: int, limits: Sequence[int], columns: int
) -> Optional[Tuple[Array, Array]]:
    """Table and place of regions.Regions."""
    if LIBRARY is None:
        return None
    _, rows, width = heights.shape
    place = np.empty((count, rows, width), dtype=np.int32)
    table = np.empty((MOST, columns), dtype=np.int32)
    _expect(heights, BYTE, count, rows, width)
    _expect(sums, INT, rows + 1, width + 1, SUMS)
    _expect(table, INT, MOST, REGION)
    found = _call(LIBRARY.regions, heights, sums, rows, width, count, np.array(limits, np.int32), place, table, MOST)
    return None if found == REFUSED else (table[:found], place)


def quick(table: Array, sums: Array, top: int, nearness: Array, bearing: Array, columns: int) -> Optional[Array]:
    """features.measure_all."""
    if LIBRARY is None:
        return None
    values = np.empty((len(table), columns), dtype=np.float32)
    _expect(table, INT, len(table), REGION)
    _expect(values, FLOAT, len(table), QUICK)
    found = _call(LIBRARY.quick, table, len(table), sums, _view(sums, top, nearness, bearing), values)
    return None if found == REFUSED else values


def full(
    table: Array,
    values: Array,
    place: Array,
    heights: Array,
    sums: Array,
    top: int,
    nearness: Array,
    bearing: Array,
    lines: Array,
    limits: Sequence[float],
    columns: int,
) -> Optional[Array]:
    """features.measure."""
    if LIBRARY is None:
        return None
    result = np.empty((len(table), columns), dtype=np.float32)
    view = _view(sums, top, nearness, bearing)
    numbers = np.array(limits, dtype=np.float64)
    rows, width = sums.shape[0] - 1, sums.shape[1] - 1
    _expect(table, INT, len(table), REGION)
    _expect(values, FLOAT, len(table), QUICK)
    _expect(place, INT, len(place), rows, width)
    _expect(heights, BYTE, len(place), rows, width)
    _expect(lines, DOUBLE, len(lines), 7)
    _expect(result, FLOAT, len(table), FULL)
    pictures = place, heights, sums, view
    found = _call(LIBRARY.full, table, len(table), values, *pictures, lines, len(lines), numbers, result)
    return None if found == REFUSED else result


def summed(nodes: Array, stages: Array, hopeless: Array, values: Array, base: float) -> Optional[Array]:
    """trees.summed. nodes: (T, K) NODE."""
    if LIBRARY is None:
        return None
    total = np.full(len(values), base, dtype=np.float32)
    trees, size = nodes.shape
    _expect(nodes, NODE, trees, size)
    _expect(stages, INT, len(stages))
    _expect(hopeless, FLOAT, len(stages))
    _expect(values, FLOAT, *values.shape)
    _call(LIBRARY.summed, nodes, trees, size, stages, hopeless, len(stages), values, *values.shape, total)
    return total


def tapes(
    picture: Array, sampling: Any, share: Sequence[int], limits: Sequence[float], linear: Array
) -> Optional[Tuple[Array, Array, Array]]:
    """lines._tapes. sampling: lines.LineSampling."""
    if LIBRARY is None:
        return None
    count, (height, width) = len(sampling.scan), picture.shape[:2]
    edges, colors = np.empty((2, count)), np.empty((count, 3))
    picture = np.ascontiguousarray(picture)
    _expect(picture, BYTE, height, width, 3)
    _expect(sampling.map_pixel, SHORT, 1, count, 2)
    _expect(sampling.map_part, WORD, 1, count)
    _expect(sampling.whole, FLOAT, 1, count)
    _expect(sampling.scan, INT, count)
    _expect(linear, FLOAT, 256)
    found = _call(
        LIBRARY.tapes,
        picture,
        width,
        height,
        sampling.map_pixel,
        sampling.map_part,
        sampling.whole,
        sampling.scan,
        count,
        np.array(share, dtype=np.int32),
        np.array(limits, dtype=np.float64),
        linear,
        edges[0],
        edges[1],
        colors,
        count,
    )
    return None if found == REFUSED else (edges[0, :found], edges[1, :found], colors[:found])


def curves(
    x: Array, y: Array, row: Array, tolerance: Array, trials: Array, limits: Sequence[float], most: int
) -> Optional[Array]:
    """lines._chosen. trials: (3, T) numbers of crossings."""
    if LIBRARY is None:
        return None
    count = len(x)
    chosen = np.empty((most, count), dtype=bool)
    of = np.ascontiguousarray(x), np.ascontiguousarray(y), row.astype(np.int64), tolerance
    for values, kind in zip(of, (DOUBLE, DOUBLE, LONG, DOUBLE)):
        _expect(values, kind, count)
    numbers = trials.astype(np.int32)
    size, bounds = numbers.shape[1], np.array(limits, dtype=np.float64)
    _expect(numbers, INT, 3, size)
    found = _call(LIBRARY.curves, *of, count, numbers, size, bounds, chosen, most)
    return None if found == REFUSED else chosen[:found]


def fitted(
    x: Array, y: Array, across: Array, color: Array, tolerance: Array, chosen: Array, limits: Sequence[float]
) -> Optional[Tuple[Array, List[Array]]]:
    """lines._fitted: (L, 16) numbers of lines.Line, and the crossings of each. chosen is used up."""
    if LIBRARY is None:
        return None
    curve_count, count = chosen.shape
    lines = np.empty((curve_count, 16))
    numbers, sizes = np.empty((curve_count, count), dtype=np.int32), np.empty(curve_count, dtype=np.int32)
    of = [np.ascontiguousarray(values) for values in (x, y, across, color, tolerance)]
    for values, shape in zip(of, ((count,), (count,), (count, 2), (count, 3), (count,))):
        _expect(values, DOUBLE, *shape)
    _expect(chosen, BOOL, curve_count, count)
    bounds = np.array(limits, dtype=np.float64)
    found = _call(LIBRARY.fitted, *of, count, chosen, curve_count, bounds, lines, numbers, sizes)
    if found == REFUSED:
        return None
    return lines[:found], [row[:size] for row, size in zip(numbers, sizes[:found].tolist())]


def _view(sums: Array, top: int, nearness: Array, bearing: Array) -> Any:
    rows, width = sums.shape[0] - 1, sums.shape[1] - 1
    height = len(nearness)
    nearness, bearing = (np.ascontiguousarray(values[:, :width]) for values in (nearness, bearing))
    _expect(sums, INT, rows + 1, width + 1, SUMS)
    _expect(nearness, FLOAT, height, width)
    _expect(bearing, FLOAT, height, width)
    if not 0 <= top <= height - rows:
        raise ValueError('the view has %d rows, expected %d from row %d on' % (height, rows, top))
    view = _View(rows, width, top, height, nearness.ctypes.data, bearing.ctypes.data)
    view.kept = nearness, bearing
    return ctypes.byref(view)


def _expect(values: Array, kind: Any, *shape: int) -> None:
    """Arrays go as pointers to their first number: nothing but this tells what follows it."""
    if values.dtype != kind or values.shape != shape or not values.flags.c_contiguous:
        given = '%s of %s%s' % (values.dtype, values.shape, '' if values.flags.c_contiguous else ', not in C order')
        raise ValueError('an array is %s, expected %s of %s in C order' % (given, kind, shape))


def _call(function: Any, *arguments: Any) -> int:
    """What it returns. Raises MemoryError."""
    given = [ctypes.c_void_p(value.ctypes.data) if isinstance(value, np.ndarray) else value for value in arguments]
    result = int(function(*given))
    if result == -1:
        raise MemoryError('not enough memory for the regions of one picture')
    return result
