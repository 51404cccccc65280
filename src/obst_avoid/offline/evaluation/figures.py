"""Numbers from tallies, ready for JSON. Names and rounding of what the scorer also says are the scorer's."""

import functools
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from obst_avoid.offline.evaluation.matching import DUPLICATE, FAR, IGNORED, KINDS, LOOSE
from obst_avoid.offline.evaluation.tally import (
    CONFIDENCE_STEPS,
    HISTOGRAMS,
    MICROMETRES,
    ROWS,
    histogram,
    quantile,
)
from obst_avoid.offline.tool import ToolError

Figures = Dict[str, Any]
HISTOGRAM_POINTS = 60
"""Bins of the histograms that are written down."""
PARTS = ('complete', 'rest')


def share(part: int, whole: int) -> Optional[Figures]:
    """A share of independent trials with its 95 % interval (Wilson); None of nothing.

    Neighbouring pictures show the same things, so that the true interval is wider. Raises ToolError without scipy 1.7.
    """
    if not whole:
        return None
    return {'value': round(part / whole, 4), 'k': int(part), 'n': int(whole), 'ci95': list(_interval(part, whole))}


@functools.lru_cache(maxsize=None)
def _interval(part: int, whole: int) -> Tuple[float, float]:
    interval = binomial_test()(int(part), int(whole)).proportion_ci(method='wilson')
    return round(float(interval.low), 4), round(float(interval.high), 4)


def binomial_test() -> Any:
    """scipy.stats.binomtest, which scipy has from 1.7 on. Raises ToolError."""
    try:
        from scipy.stats import binomtest  # takes a second, and workers never need it
    except ImportError as error:
        raise ToolError('scipy 1.7 or newer is needed for the intervals: %s' % error) from error
    return binomtest


def figures(tally: Mapping[str, int]) -> Figures:
    """All figures of a group of pictures."""
    t = _Reader(tally)
    relevant, hits = t.sum('labels/%s'), t.sum('hit/%s')
    complete = t['pictures'] > 0 and t['pictures'] == t['pictures/complete']
    precision = share(hits, hits + t['false']) if relevant else None
    return {
        'frames': t['pictures'],
        'relevant_gt': relevant,
        'recall': share(hits, relevant),
        'recall_near': share(t.sum('hit/%s/near'), t.sum('labels/%s/near')),
        'recall_far_indicative': share(t['far/hit'], t['far']),
        **{key: value for key, value in object_figures(tally).items() if key not in ('relevant_gt', 'recall')},
        'bands': {
            name: share(t.sum('hit/%%s/row/%d' % row), t.sum('labels/%%s/row/%d' % row)) for name, row in _row_names()
        },
        'false_alarms': _false_alarms(t),
        'false_alarms_indicative': {
            'count': t['false'],
            'per_frame': round(t['false'] / max(t['pictures'], 1), 4),
            'on_labelled_object': t['false/on_object'],
            **{'as_' + kind: t['false/as/' + kind] for kind in KINDS},
            'frames_with_any': share(t['pictures/any'], t['pictures']),
        },
        'false_alarms_by_kind': {kind: t['false/counts/as/' + kind] for kind in KINDS}
        if t['pictures/judged']
        else None,
        'precision': precision if complete else None,
        'precision_indicative': precision,
        'other_detections': {state: t['state/' + state] for state in (IGNORED, DUPLICATE, LOOSE, FAR)},
        'milliseconds': milliseconds(tally),
        'report_table': report_table(tally),
    }


def object_figures(tally: Mapping[str, int]) -> Figures:
    """What can be said of labelled things alone: recall, kinds, sides, errors of place and radius."""
    t = _Reader(tally)
    relevant = t.sum('labels/%s')
    return {
        'relevant_gt': relevant,
        'recall': share(t.sum('hit/%s'), relevant),
        'recall_kind': share(t.sum('right/%s'), relevant),
        **{
            kind: {
                'recall': share(t['hit/' + kind], t['labels/' + kind]),
                'recall_near': share(t['hit/%s/near' % kind], t['labels/%s/near' % kind]),
                'recall_kind': share(t['right/' + kind], t['labels/' + kind]),
            }
            for kind in KINDS
        },
        'confusion': {'%s_as_%s' % (a, b): t['as/%s/%s' % (a, b)] for a in KINDS for b in KINDS},
        'in_lane_flag': {
            key[len('where/') :]: number for key, number in sorted(tally.items()) if key.startswith('where/')
        },
        'position': _position(t),
        'radius': _radius(tally),
        'side': _side(t),
    }


def report_table(tally: Mapping[str, int]) -> Figures:
    """The table of the 2018 report, in its order.

    Shares are of the labelled things of that kind; of false positives, of all correct and false detections; of false
    positions, of the things found whose side is known. false_positives_indicative: false alarms in all pictures;
    false_positives: in those alone whose labels are complete enough to tell.
    """
    t = _Reader(tally)
    hits, wrong, known = t.sum('hit/%s'), _wrong_side(t, KINDS), _side_known(t, KINDS)
    hits_judged = sum(_hits(tally, 'complete', kind) for kind in KINDS)
    false_judged = sum(_all(tally, 'confidence/complete/false/' + kind) for kind in KINDS)
    return {
        'correct_duckies': share(t['hit/duckie'], t['labels/duckie']),
        'correct_cones': share(t['hit/cone'], t['labels/cone']),
        'missed_duckies': share(t['labels/duckie'] - t['hit/duckie'], t['labels/duckie']),
        'missed_cones': share(t['labels/cone'] - t['hit/cone'], t['labels/cone']),
        'false_positives': share(false_judged, hits_judged + false_judged),
        'false_positives_indicative': share(t['false'], hits + t['false']),
        'false_position': share(wrong, known),
    }


def milliseconds(tally: Mapping[str, int]) -> Optional[Figures]:
    """A picture's time, to within 1 %."""
    counts, bins = histogram(tally, 'milliseconds'), HISTOGRAMS['milliseconds']
    median, p95 = quantile(counts, bins, 0.5), quantile(counts, bins, 0.95)
    return None if median is None or p95 is None else {'median': round(median, 2), 'p95': round(p95, 2)}


def written_histogram(
    tally: Mapping[str, int], name: str, beside: Sequence[Mapping[str, int]] = ()
) -> Optional[Figures]:
    """A histogram with few bins, from the first to the last that has something; None of nothing.

    beside: other tallies that it is compared with; all get the same bins.
    """
    counts, edges = histogram(tally, name), HISTOGRAMS[name].edges()
    if not counts.any():
        return None
    filled = np.flatnonzero(sum((histogram(other, name) for other in beside), counts))
    first, last = int(filled[0]), int(filled[-1]) + 1
    step = -(-(last - first) // HISTOGRAM_POINTS)
    starts = list(range(first, last, step))
    ends = [min(start + step, last) for start in starts]
    return {
        'edges': [round(float(edges[index]), 5) for index in [*starts, ends[-1]]],
        'counts': [int(counts[start:end].sum()) for start, end in zip(starts, ends)],
    }


def curves(tally: Mapping[str, int]) -> Figures:
    """Precision and recall when only what is at least so confident counts.

    'curve': of pictures whose labels are complete; None when there are none. 'curve_indicative': of all pictures.
    """
    complete = _Reader(tally)['pictures/complete'] > 0
    return {
        'curve': _curves(tally, PARTS[:1]) if complete else None,
        'curve_indicative': _curves(tally, PARTS),
    }


def _curves(tally: Mapping[str, int], parts: Iterable[str]) -> Figures:
    """A kind's curve counts what is called by that name: under the wrong name a detection is no hit."""
    t, parts = _Reader(tally), tuple(parts)

    def of(name: str) -> Any:
        return sum(histogram(tally, 'confidence/%s/%s' % (part, name)) for part in parts)

    hits = {(a, b): of('hit/%s/%s' % (a, b)) for a in KINDS for b in KINDS}
    false = {kind: of('false/' + kind) for kind in KINDS}
    labels = {kind: sum(t['labels/%s/%s' % (part, kind)] for part in parts) for kind in KINDS}
    result = {'all': _curve(sum(hits.values()), sum(false.values()), sum(labels.values()))}
    for kind in KINDS:
        others = sum(hits[a, kind] for a in KINDS if a != kind)
        result[kind] = _curve(hits[kind, kind], false[kind] + others, labels[kind])
    return result


def _curve(hits: Any, false: Any, labels: int) -> List[Figures]:
    """hits, false: (CONFIDENCE_STEPS + 1,) counts. Where nothing is so confident any more there is no point."""
    points = []
    for index, (good, bad) in enumerate(zip(np.cumsum(hits[::-1])[::-1], np.cumsum(false[::-1])[::-1])):
        if labels and good + bad:
            precision, recall = round(float(good / (good + bad)), 4), round(float(good / labels), 4)
            points.append({'confidence': index / CONFIDENCE_STEPS, 'recall': recall, 'precision': precision})
    return points


class _Reader:
    """A tally in which what was never counted is 0, plain dicts included."""

    def __init__(self, tally: Mapping[str, int]) -> None:
        self._tally = tally

    def __getitem__(self, name: str) -> int:
        return self._tally.get(name, 0)

    def sum(self, name: str) -> int:
        """Over both kinds. name: with %s for the kind."""
        return sum(self[name % kind] for kind in KINDS)


def _row_names() -> List[Any]:
    names = ['%d-%d' % pair for pair in zip(ROWS, ROWS[1:])]
    return list(zip([*names, '%d+' % ROWS[-1]], ROWS))


def _false_alarms(t: _Reader) -> Optional[Figures]:
    pictures = t['pictures/judged']
    if not pictures:
        return None
    return {
        'valid_frames': pictures,
        'count': t['false/counts'],
        'per_frame': round(t['false/counts'] / pictures, 4),
        'frames_with_any': share(t['pictures/judged/any'], pictures),
        'on_obstacle_polygon': t['false/on_obstacle'],
    }


def _position(t: _Reader) -> Optional[Figures]:
    """[m] between the nearest points; biases are means, along: away from the robot, across: to the left."""
    number = t['position/count']
    if not number:
        return None
    counts, bins = histogram(t._tally, 'position'), HISTOGRAMS['position']
    return {
        'median': _rounded(quantile(counts, bins, 0.5)),
        'p95': _rounded(quantile(counts, bins, 0.95)),
        'n': number,
        'along_bias': _rounded(t['position/along'] / number / MICROMETRES),
        'across_bias': _rounded(t['position/across'] / number / MICROMETRES),
    }


def _radius(tally: Mapping[str, int]) -> Optional[Figures]:
    """[m] found minus true."""
    signed, size = histogram(tally, 'radius'), histogram(tally, 'radius_size')
    if not signed.sum():
        return None
    return {
        'median_error': _rounded(quantile(signed, HISTOGRAMS['radius'], 0.5)),
        'p95_abs': _rounded(quantile(size, HISTOGRAMS['radius_size'], 0.95)),
        'n': int(signed.sum()),
    }


def _side(t: _Reader) -> Optional[Figures]:
    """Inside or outside our lane, of things found whose side is known."""
    known = _side_known(t, KINDS)
    if not known:
        return None
    return {
        'wrong': share(_wrong_side(t, KINDS), known),
        **{'wrong_' + kind: share(_wrong_side(t, [kind]), _side_known(t, [kind])) for kind in KINDS},
        'unknown': share(t.sum('side/%s/True/None') + t.sum('side/%s/False/None'), known),
        'inside_called_outside': t.sum('side/%s/True/False'),
        'outside_called_inside': t.sum('side/%s/False/True'),
    }


def _wrong_side(t: _Reader, kinds: Sequence[str]) -> int:
    return sum(t['side/%s/True/False' % kind] + t['side/%s/False/True' % kind] for kind in kinds)


def _side_known(t: _Reader, kinds: Sequence[str]) -> int:
    sides = [(true, found) for true in (True, False) for found in (True, False, None)]
    return sum(t['side/%s/%s/%s' % (kind, true, found)] for kind in kinds for true, found in sides)


def _hits(tally: Mapping[str, int], part: str, kind: str) -> int:
    return sum(_all(tally, 'confidence/%s/hit/%s/%s' % (part, kind, found)) for found in KINDS)


def _all(tally: Mapping[str, int], name: str) -> int:
    return int(histogram(tally, name).sum())


def _rounded(value: Optional[float]) -> Optional[float]:
    return None if value is None else round(value, 5)
