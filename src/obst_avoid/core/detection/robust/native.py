"""Calls native.c, the compiled path. Each function returns None where it is not built; then numpy does the work."""

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


def channels(rows: Array, logarithms: Array, less: Array, steps: Array, light: Array) -> Optional[Tuple[Array, Array]]:
    """Heights and sums of channels.Channels, but for the channels that OpenCV makes. rows: (R, W, 3) uint8."""
    if LIBRARY is None:
        return None
    count, width = rows.shape[:2]
    heights = np.empty((7, count, width), dtype=np.uint8)
    sums = np.empty((count + 1, width + 1, 8), dtype=np.int32)
    both = light[0] + light[1].astype(np.uint16) * 256
    _call(LIBRARY.channels, rows, count, width, logarithms, less, steps, both, heights, sums)
    return heights, sums


def morphed(height: Array, bands: Array, closing: bool, result: Array) -> bool:
    """channels.opened or, closing, channels.joined."""
    if LIBRARY is None:
        return False
    _call(LIBRARY.morphed, height, *height.shape, bands, len(bands), int(closing), result)
    return True


def regions(
    heights: Array, sums: Array, count: int, limits: Sequence[int], columns: int
) -> Optional[Tuple[Array, Array]]:
    """Table and place of regions.Regions."""
    if LIBRARY is None:
        return None
    _, rows, width = heights.shape
    place = np.empty((count, rows, width), dtype=np.int32)
    table = np.empty((MOST, columns), dtype=np.int32)
    found = _call(LIBRARY.regions, heights, sums, rows, width, count, np.array(limits, np.int32), place, table, MOST)
    return table[:found], place


def quick(table: Array, sums: Array, top: int, nearness: Array, bearing: Array, columns: int) -> Optional[Array]:
    """features.measure_all."""
    if LIBRARY is None:
        return None
    values = np.empty((len(table), columns), dtype=np.float32)
    _call(LIBRARY.quick, table, len(table), sums, _view(sums, top, nearness, bearing), values)
    return values


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
    _call(LIBRARY.full, table, len(table), values, place, heights, sums, view, lines, len(lines), numbers, result)
    return result


def summed(nodes: Array, stages: Array, hopeless: Array, values: Array, base: float) -> Optional[Array]:
    """trees.summed. nodes: (T, K) trees.NODE."""
    if LIBRARY is None:
        return None
    total = np.full(len(values), base, dtype=np.float32)
    trees, size = nodes.shape
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
    found = _call(
        LIBRARY.tapes,
        np.ascontiguousarray(picture),
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
    return edges[0, :found], edges[1, :found], colors[:found]


def curves(
    x: Array, y: Array, row: Array, tolerance: Array, trials: Array, limits: Sequence[float], most: int
) -> Optional[Array]:
    """lines._chosen. trials: (3, T) numbers of crossings."""
    if LIBRARY is None:
        return None
    chosen = np.empty((most, len(x)), dtype=bool)
    of = np.ascontiguousarray(x), np.ascontiguousarray(y), row.astype(np.int64), tolerance
    numbers = trials.astype(np.int32)
    size, bounds = numbers.shape[1], np.array(limits, dtype=np.float64)
    return chosen[: _call(LIBRARY.curves, *of, len(x), numbers, size, bounds, chosen, most)]


def fitted(
    x: Array, y: Array, across: Array, color: Array, tolerance: Array, chosen: Array, limits: Sequence[float]
) -> Optional[Tuple[Array, List[Array]]]:
    """lines._fitted: (L, 16) numbers of lines.Line, and the crossings of each. chosen is used up."""
    if LIBRARY is None:
        return None
    curve_count, count = chosen.shape
    lines = np.empty((curve_count, 16))
    numbers, sizes = np.empty((curve_count, count), dtype=np.int32), np.empty(curve_count, dtype=np.int32)
    of = (np.ascontiguousarray(values) for values in (x, y, across, color, tolerance))
    bounds = np.array(limits, dtype=np.float64)
    found = _call(LIBRARY.fitted, *of, count, chosen, curve_count, bounds, lines, numbers, sizes)
    return lines[:found], [row[:size] for row, size in zip(numbers, sizes[:found].tolist())]


def _view(sums: Array, top: int, nearness: Array, bearing: Array) -> Any:
    rows, width = sums.shape[0] - 1, sums.shape[1] - 1
    view = _View(rows, width, top, len(nearness), nearness.ctypes.data, bearing.ctypes.data)
    return ctypes.byref(view)


def _pointer(values: Array) -> Any:
    assert values.flags.c_contiguous
    return ctypes.c_void_p(values.ctypes.data)


def _call(function: Any, *arguments: Any) -> int:
    """Arrays go as pointers to their first number, so they have to be in C order."""
    given = [_pointer(value) if isinstance(value, np.ndarray) else value for value in arguments]
    result = int(function(*given))
    if result < 0:
        raise MemoryError('not enough memory for the regions of one picture')
    return result
