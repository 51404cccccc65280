"""Plots of the evaluation's page, each a data URI of an SVG with the words for those who do not see it."""

import base64
import io
import math
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

COLORS = ('#1f5fa8', '#c8640a')
"""Of the first and the second run, told apart by people who see no red or green, and on a grey print."""
MARKS = ('o', 's')
SIZE = (5.2, 3.5)
"""[inch]; 100 px each on the page, so that letters are as large as the text's."""
MOST_BARS = 14
"""Values in one plot: more do not fit beside each other; they are in the tables."""
CHARACTERS = 62
"""That fit below an axis side by side; more are turned."""
LONGEST_NAME = 26
"""[characters] below an axis."""
STYLE = {
    'font.size': 9,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.grid': True,
    'grid.alpha': 0.3,
    'legend.frameon': False,
    'svg.hashsalt': 'evaluate',  # the same content makes the same page
}
LOG_STEPS, LEAST_TICKS = ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9)), 3
"""Of ticks in a decade, until there are so many."""
BINS, SHOWN = 36, 0.99
"""Of a histogram: a few slow pictures would press all others to the edge."""
FEW_POINTS = 12
"""Of a curve: so few are marked each."""
MARKED = (0.25, 0.5, 0.75, 0.9)
"""Confidences whose points are named in the plot of precision against recall."""


@dataclass(frozen=True)
class Plot:
    """uri: data: URI. title: above it. words: what it shows, for those who do not see it."""

    uri: str
    title: str
    words: str


def precision_recall(runs: Sequence[Mapping[str, Any]], name: str = 'all') -> Optional[Plot]:
    """Precision against recall over confidence of each run; None when no run has a curve of that name.

    Where labels are not complete anywhere, the indicative curve is drawn instead, dashed.
    """
    curves = [(run['name'], *_curve(run, name)) for run in runs]
    if not any(points for _, points, _ in curves):
        return None

    def draw(axes: Any) -> None:
        for index, (run, points, indicative) in enumerate(curves):
            if not points:
                continue
            label = run + (', indicative' if indicative else '')
            recall, precision = [p['recall'] for p in points], [p['precision'] for p in points]
            mark = MARKS[index] if len(points) < FEW_POINTS else None
            axes.plot(recall, precision, '--' if indicative else '-', color=COLORS[index], marker=mark, label=label)
            for marked in MARKED:
                near = min(points, key=lambda p: abs(p['confidence'] - marked))
                if abs(near['confidence'] - marked) <= 0.03:
                    at = (near['recall'], near['precision'])
                    axes.plot(*at, MARKS[index], color=COLORS[index], markersize=5)
                    shift = (5, 5 if index == 0 else -11)
                    axes.annotate(
                        '%g' % marked, at, xytext=shift, textcoords='offset points', color=COLORS[index], fontsize=8
                    )
        axes.set_xlim(0, 1.02)
        axes.set_ylim(0, 1.02)
        axes.set_xlabel('recall: share of the labelled objects that were found')
        axes.set_ylabel('precision: right share of the detections')
        axes.legend(loc='upper right')

    what = '' if name == 'all' else ', %ss' % name
    words = '; '.join(_curve_words(run, points) for run, points, _ in curves if points)
    return _plot(draw, 'Precision against recall' + what, '%s (numbers: confidence)' % words)


def _curve(run: Mapping[str, Any], name: str) -> Tuple[List[Dict[str, float]], bool]:
    """The points that have both values, and whether they are indicative only."""
    for key in ('curve', 'curve_indicative'):
        points = ((run.get(key) or {}).get(name)) or []
        points = [p for p in points if p.get('recall') is not None and p.get('precision') is not None]
        if points:
            return points, key == 'curve_indicative'
    return [], False


def _curve_words(run: str, points: Sequence[Mapping[str, float]]) -> str:
    low = min(points, key=lambda p: p['confidence'])
    return '%s at its lowest confidence: recall %.2f, precision %.2f' % (run, low['recall'], low['precision'])


def recall_bars(title: str, values: Sequence[str], runs: Sequence[Tuple[str, Sequence[Any]]]) -> Optional[Plot]:
    """Recall with 95 % intervals by band or group. values: their names. runs: name, and a share for each value or
    None. None when there is nothing to compare: fewer than two values with numbers, or more than MOST_BARS.
    """
    kept = [i for i in range(len(values)) if any(shares[i] for _, shares in runs)]
    if not 2 <= len(kept) <= MOST_BARS:
        return None

    def draw(axes: Any) -> None:
        for index, (run, shares) in enumerate(runs):
            there = [(at, shares[i]) for at, i in enumerate(kept) if shares[i]]
            shift = 0.0 if len(runs) == 1 else (-0.12, 0.12)[index]
            value = np.array([share['value'] for _, share in there])
            low = np.array([share['ci95'][0] for _, share in there])
            high = np.array([share['ci95'][1] for _, share in there])
            axes.errorbar(
                [at + shift for at, _ in there],
                value,
                yerr=np.abs([value - low, high - value]),
                fmt=MARKS[index],
                color=COLORS[index],
                capsize=3,
                markersize=5,
                label=run,
            )
        axes.set_xticks(range(len(kept)))
        labels = ['%s\n(%d)' % (_short(values[i]), max(share[i]['n'] for _, share in runs if share[i])) for i in kept]
        long = max(len(_short(values[i])) for i in kept) * len(kept) > CHARACTERS
        axes.set_xticklabels(labels, rotation=50 if long else 0, ha='right' if long else 'center', fontsize=8)
        axes.set_xlim(-0.5, len(kept) - 0.5)
        axes.set_ylim(0, 1.02)
        axes.set_ylabel('recall, with 95 % interval')
        axes.grid(axis='x', visible=False)
        if len(runs) > 1:
            axes.legend(loc='upper left', bbox_to_anchor=(0, 1.16), ncol=2, borderaxespad=0)

    words = '; '.join(
        '%s: %s' % (run, ', '.join('%s %.2f' % (values[i], shares[i]['value']) for i in kept if shares[i]))
        for run, shares in runs
    )
    return _plot(draw, 'Recall by %s' % title, '%s (in brackets: objects)' % words)


def histogram(
    title: str, unit: str, runs: Sequence[Tuple[str, Optional[Mapping[str, Sequence[float]]]]]
) -> Optional[Plot]:
    """Shares of pictures or objects by a measured value. runs: name, and edges and counts; None when all are empty."""
    there = [(i, run, counts) for i, (run, counts) in enumerate(runs) if counts and sum(counts['counts'])]
    if not there:
        return None

    high = max(_quantile(content, SHOWN) for _, _, content in there)
    fewest = min(sum(content['counts']) for _, _, content in there)
    shown = [(index, run, *_merged(content, high, fewest), sum(content['counts'])) for index, run, content in there]
    geometric = all(_grows(content['edges']) for _, _, content in there)
    left_out = any(sum(counts) < total for _, _, _, counts, total in shown)

    def draw(axes: Any) -> None:
        for index, run, edges, counts, total in shown:
            heights = 100 * np.append(counts, counts[-1]) / total
            axes.fill_between(edges, heights, step='post', color=COLORS[index], alpha=0.15)
            label = '%s (%d)' % (run, total)
            axes.step(edges, heights, where='post', color=COLORS[index], linewidth=1.4, label=label)
        if geometric:
            axes.set_xscale('log')
            ticks = log_ticks(min(edges[0] for _, _, edges, _, _ in shown), max(e[-1] for _, _, e, _, _ in shown))
            axes.set_xticks(ticks)
            axes.set_xticklabels(['%g' % tick for tick in ticks])
            axes.xaxis.set_minor_locator(NullLocator())
        axes.set_ylim(bottom=0)
        without = ', without the highest %g %%' % (100 - 100 * SHOWN) if left_out else ''
        axes.set_xlabel('%s [%s]%s' % (title.lower(), unit, without))
        axes.set_ylabel('% of all')
        axes.legend(loc='upper right')

    words = '; '.join(
        '%s: half of %d below %.3g %s' % (run, sum(c['counts']), _quantile(c, 0.5), unit) for _, run, c in there
    )
    return _plot(draw, title, words)


def _quantile(content: Mapping[str, Sequence[float]], part: float) -> float:
    """Where so large a part of the counts is reached, in bins' ends."""
    up_to = np.cumsum(content['counts'])
    return float(content['edges'][int(np.searchsorted(up_to, part * up_to[-1])) + 1])


def _merged(content: Mapping[str, Sequence[float]], high: float, number: int) -> Tuple[List[float], List[int]]:
    """Edges and counts of wider bins, from the first up to high: at most the root of a number of values, and BINS.

    Only whole bins are put together, so that each height is one that was counted.
    """
    edges, counts = content['edges'], content['counts']
    used = int(np.searchsorted(edges[1:], high * (1 - 1e-9))) + 1
    step = -(-min(used, len(counts)) // min(BINS, math.ceil(math.sqrt(number))))
    starts = list(range(0, min(used, len(counts)), step))
    ends = [min(start + step, len(counts)) for start in starts]
    merged = [int(sum(counts[start:end])) for start, end in zip(starts, ends)]
    return [float(edges[index]) for index in [*starts, ends[-1]]], merged


def log_ticks(low: float, high: float) -> List[float]:
    """Round numbers on a logarithmic axis, at least two if possible; of a narrow axis its ends."""
    for steps in LOG_STEPS:
        ticks = [step * 10.0**power for power in range(-3, 6) for step in steps]
        ticks = [round(tick, 9) for tick in ticks if low <= tick <= high]
        if len(ticks) >= LEAST_TICKS:
            return ticks
    return [float('%.3g' % low), float('%.3g' % high)]


def _grows(edges: Sequence[float]) -> bool:
    """Whether the bins get wider by a factor, as those of times do."""
    widths = np.diff(edges)
    return bool(edges[0] > 0 and widths[-1] > 1.5 * widths[0])


def _short(value: str) -> str:
    """A value's name below an axis: bands as signs, long names cut."""
    first, _, last = value.partition(' to ')
    if last and not last.startswith('-'):
        value = '%s\u2013%s' % (first, last)
    elif value.endswith(' and more'):
        value = '\u2265 ' + value[: -len(' and more')]
    elif value.startswith('below '):
        value = '< ' + value[len('below ') :]
    return value if len(value) <= LONGEST_NAME else value[: LONGEST_NAME - 1] + '…'


def _plot(draw: Callable[[Any], None], title: str, words: str) -> Plot:
    with rc_context(STYLE):
        figure = Figure(figsize=SIZE, constrained_layout=True)
        draw(figure.subplots())
        buffer = io.BytesIO()
        figure.savefig(buffer, format='svg', metadata={'Date': None})
    return Plot('data:image/svg+xml;base64,' + base64.b64encode(buffer.getvalue()).decode(), title, words)
