"""What is counted: sparse counters that add up in any order, so that parts of the work may be done anywhere.

A tally maps a name to a number. Names of counts look like 'hit/duckie', those of histograms like 'milliseconds|345',
where the number is the bin. Its size is bounded by names and bins, not by pictures. Sums are whole numbers, so that
the order of adding changes nothing.
"""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Optional, Tuple

import numpy as np

from obst_avoid.core.types import Array
from obst_avoid.offline.evaluation.matching import (
    FALSE,
    HIT,
    MIN_BOTTOM,
    MIN_HEIGHT,
    NEAR_BOTTOM,
    Found,
    Judged,
    JudgedLabel,
    Label,
)

Tally = Counter
Groups = Dict[str, Dict[str, Dict[str, int]]]
"""Tallies by the group's name and value, as 'lighting', 'dark'."""

MICROMETRES = 1e6
ROWS = (MIN_BOTTOM, NEAR_BOTTOM, 240, 300)
"""Where the bands of bottom rows begin, in pixels."""
ROWS_BAND = 'bottom row [px]'


@dataclass(frozen=True)
class Bins:
    """Fixed bins: all as wide, or each by the same factor wider. The outermost also take what is beyond."""

    low: float
    high: float
    count: int
    factor: bool = False

    def index(self, value: float) -> int:
        """Of the bin that takes a value."""
        if self.factor:
            place = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
        else:
            place = (value - self.low) / (self.high - self.low)
        return min(max(int(place * self.count + 1e-9), 0), self.count - 1)  # 0.29 / 0.01 is a little less than 29

    def edges(self) -> Array:
        """(count + 1,) float64."""
        space = np.geomspace if self.factor else np.linspace
        return np.asarray(space(self.low, self.high, self.count + 1))


CONFIDENCE_STEPS = 100
HISTOGRAMS = {
    'milliseconds': Bins(0.01, 60_000.0, 1600, factor=True),
    'position': Bins(0.0, 2.0, 2000),
    'radius': Bins(-0.2, 0.2, 800),
    'radius_size': Bins(0.0, 0.2, 400),
    'confidence': Bins(0.0, 1.0 + 1.0 / CONFIDENCE_STEPS, CONFIDENCE_STEPS + 1),
}
"""By the first part of a histogram's name. Times in ms: each bin 1 % wider than the one before. Lengths in m: 1 mm,
radii 0.5 mm.
"""


@dataclass(frozen=True)
class Band:
    """Values in bands. edges: from each one to the next; closed: none beyond the last. unit: in the band's name."""

    name: str
    edges: Tuple[float, ...]

    def of(self, value: float) -> str:
        """The band's words."""
        at = sum(value >= edge - 1e-9 for edge in self.edges)
        if at == 0:
            return 'below %g' % self.edges[0]
        if at == len(self.edges):
            return '%g and more' % self.edges[-1]
        return '%g to %g' % (self.edges[at - 1], self.edges[at])

    def order(self) -> List[str]:
        """All bands, in their order."""
        beyond = ['below %g' % self.edges[0]]
        beyond += ['%g to %g' % pair for pair in zip(self.edges, self.edges[1:])]
        return [*beyond, '%g and more' % self.edges[-1]]


def _steps(first: float, last: float, step: float) -> Tuple[float, ...]:
    return tuple(round(first + step * index, 6) for index in range(round((last - first) / step) + 1))


PICTURE_BANDS = {
    'light_strength': Band('light strength', _steps(0.0, 2.0, 0.25)),
    'glare': Band('glare', _steps(0.0, 1.0, 0.25)),
    'exposure_error_stops': Band('exposure error [stops]', _steps(-3.0, 3.0, 0.5)),
}
"""By the picture's field: groups of whole pictures."""
GROUPED = ('subset', 'lighting', 'robot', 'layout', 'split_block', *PICTURE_BANDS)
"""Fields of pictures by whose values they are grouped, unless others are asked for."""
SPEED_FIELD, BLUR_FIELD = 'speed', 'blur_px'
DISTANCE = Band('distance [m]', _steps(0.0, 2.0, 0.2))
HEIGHT = Band('box height [px]', (MIN_HEIGHT, 24.0, 32.0, 48.0, 64.0, 96.0))
RADIUS = Band('radius [m]', _steps(0.0, 0.1, 0.01))
SPEED = Band('speed [m/s]', _steps(0.0, 0.6, 0.1))
BLUR = Band('blur [px]', (0.0, 1.0, 2.0, 5.0, 10.0, 20.0))
BOTTOM = Band(ROWS_BAND, ROWS)
OBJECT_BANDS = (DISTANCE, BOTTOM, HEIGHT, RADIUS, SPEED, BLUR)


def count_picture(tally: Tally, judged: Judged, milliseconds: Optional[float]) -> None:
    """Add one picture, without what tally_of_label says. milliseconds: it took to detect; None: not told."""
    states = Counter(item.state for item in judged.found)
    false = [item for item in judged.found if item.state == FALSE]
    counted = sum(item.counts for item in false)
    tally.update(
        {
            'pictures': 1,
            'pictures/complete': int(judged.complete),
            'ignored_labels': sum(bool(label.ignored) for label in judged.labels),
            'detections': len(judged.found),
            'false': len(false),
            'false/on_object': sum(item.on_object for item in false),
            'false/on_obstacle': sum(item.on_obstacle for item in false),
            'false/counts': counted,
            'pictures/judged': int(judged.judges_false_alarms),
            'pictures/judged/any': int(judged.judges_false_alarms and counted > 0),
            'pictures/any': int(bool(false)),
        }
    )
    tally.update({'state/' + state: number for state, number in states.items()})
    part = 'complete' if judged.complete else 'rest'
    for item in false:
        tally['false/as/' + item.found.kind] += 1
        tally['false/counts/as/' + item.found.kind] += item.counts
        count_value(tally, 'confidence/%s/false/%s' % (part, item.found.kind), item.found.confidence)
    if milliseconds is not None:
        count_value(tally, 'milliseconds', milliseconds)
    for label in judged.labels:
        if label.far_found is not None and label.label.box[3] >= MIN_HEIGHT:
            tally['far'] += 1
            tally['far/hit'] += label.far_found
        if label.ignored:
            continue
        kind = label.label.category
        tally['labels/%s/%s' % (part, kind)] += 1
        if label.partner is not None:
            found = judged.found[label.partner].found
            count_value(tally, 'confidence/%s/%s/%s/%s' % (part, HIT, kind, found.kind), found.confidence)


def tally_of_label(label: JudgedLabel, judged: Judged) -> Tally:
    """One relevant label: whether it was found, as what, and how far from where it is."""
    tally: Tally = Counter()
    kind, bottom = label.label.category, label.label.box[1] + label.label.box[3]
    found = None if label.partner is None else judged.found[label.partner]
    scopes = [kind, kind + '/near'] if bottom >= NEAR_BOTTOM else [kind]
    scopes.append('%s/row/%d' % (kind, max(row for row in ROWS if row <= bottom)))
    for scope in scopes:
        tally['labels/' + scope] = 1
        if found is not None:
            tally['hit/' + scope] = 1
            tally['right/' + scope] = int(found.found.kind == kind)
    if found is None:
        return tally
    tally['as/%s/%s' % (kind, found.found.kind)] += 1
    if label.where is not None:
        tally['where/%s_%s' % (label.where, found.found.in_lane)] += 1
    if label.inside is not None:
        tally['side/%s/%s/%s' % (kind, label.inside, found.found.in_lane)] += 1
    _count_errors(tally, label.label, found.found)
    return tally


def _count_errors(tally: Tally, label: Label, found: Found) -> None:
    """Position and radius of a hit, where the label tells them. Along: away from the robot. Across: to the left."""
    if label.x is not None and label.y is not None and found.x is not None and found.y is not None:
        dx, dy = found.x - label.x, found.y - label.y
        distance = max(math.hypot(label.x, label.y), 1e-6)
        along = (dx * label.x + dy * label.y) / distance
        across = (dy * label.x - dx * label.y) / distance
        count_value(tally, 'position', math.hypot(dx, dy))
        tally['position/count'] += 1
        tally['position/along'] += round(along * MICROMETRES)
        tally['position/across'] += round(across * MICROMETRES)
    if label.radius is not None and found.radius is not None:
        error = found.radius - label.radius
        count_value(tally, 'radius', error)
        count_value(tally, 'radius_size', abs(error))


def count_value(tally: Tally, name: str, value: float) -> None:
    """Add a value to a histogram, by its full name."""
    tally['%s|%d' % (name, HISTOGRAMS[name.split('/')[0]].index(value))] += 1


def histogram(tally: Mapping[str, int], name: str) -> Array:
    """The counts of all bins, (count,) int64."""
    counts = np.zeros(HISTOGRAMS[name.split('/')[0]].count, dtype=np.int64)
    for key, number in tally.items():
        if key.startswith(name + '|'):
            counts[int(key[len(name) + 1 :])] += number
    return counts


def quantile(counts: Array, bins: Bins, share: float) -> Optional[float]:
    """As numpy.quantile of the values, to within a bin's width. counts: (bins.count,). None when there are none."""
    up_to = np.cumsum(counts)
    total = int(up_to[-1])
    if not total:
        return None
    rank = share * (total - 1)
    below, above = (_ranked(counts, up_to, bins, index) for index in (math.floor(rank), math.ceil(rank)))
    return below + (above - below) * (rank - math.floor(rank))


def _ranked(counts: Array, up_to: Array, bins: Bins, index: int) -> float:
    """About the index-th of the sorted values: a bin's values are taken to be spread evenly."""
    at = int(np.searchsorted(up_to, index, side='right'))
    edges = bins.edges()[at : at + 2]
    inside = (index - (up_to[at] - counts[at]) + 0.5) / counts[at]
    return float(edges[0] + inside * (edges[1] - edges[0]))


def bands_of_label(label: Label, speed: Optional[float], blur: Optional[float]) -> List[Tuple[str, str]]:
    """Name and band of each that a labelled thing belongs to. speed: [m/s] of the robot. blur: [px]."""
    height, bottom = label.box[3], label.box[1] + label.box[3]
    known = label.x is not None and label.y is not None
    values = [(DISTANCE, math.hypot(label.x or 0.0, label.y or 0.0)) if known else (BOTTOM, bottom), (HEIGHT, height)]
    if label.radius is not None:
        values.append((RADIUS, label.radius))
    if speed is not None:
        values.append((SPEED, speed))
    elif blur is not None:
        values.append((BLUR, blur))
    return [(band.name, band.of(value)) for band, value in values]


def groups_of_picture(fields: Mapping[str, Any], by: Tuple[str, ...], on_lanes: bool) -> List[Tuple[str, str]]:
    """Name and value of each group of a picture. fields: of its entry in the labels. by: names of such fields."""
    groups = [('all', 'all')]
    for name in by:
        value = fields.get(name)
        if name in PICTURE_BANDS and isinstance(value, (int, float)):
            groups.append((PICTURE_BANDS[name].name, PICTURE_BANDS[name].of(value)))
        elif value is not None:
            groups.append((name, str(value)))
    return groups + ([('lane polygons', 'with')] if on_lanes else [])


def add(groups: Groups, others: Mapping[str, Mapping[str, Mapping[str, int]]]) -> None:
    """Add tallies to those of the same group and value."""
    for name, values in others.items():
        into = groups.setdefault(name, {})
        for value, tally in values.items():
            add_to(into.setdefault(value, {}), tally)


def add_to(tally: Dict[str, int], other: Mapping[str, int]) -> None:
    """Add one tally to another, in place: Counter.update takes twice as long for as few names as a picture has."""
    for name, number in other.items():
        if number:
            tally[name] = tally.get(name, 0) + number
