"""The check as a picture: what the camera saw, the road by the file and by the lines, and the figures in words."""

import textwrap
from dataclasses import replace
from typing import Any, List, Sequence, Tuple

import cv2
import matplotlib
import numpy as np

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.geometry import image_from_rectified, pixel_from_ground
from obst_avoid.core.types import Array
from obst_avoid.offline.calibration.fit import corrected_homography
from obst_avoid.offline.calibration.judge import GOOD, OFF, UNCLEAR, Check, number
from obst_avoid.offline.calibration.paint import Line, Tape

matplotlib.use('Agg')  # no screen; has to be said before pyplot is imported
from matplotlib import pyplot

AHEAD, ASIDE = (0.12, 1.0), 0.4
"""[m] of the road that is shown from above."""
PIXELS_PER_METRE = 400
FILE, SEEN = '#d62728', '#2ca02c'
"""Red: by the file. Green: by the lines."""
TAPES = {Tape.WHITE: '#17becf', Tape.YELLOW: '#ff7f0e'}
STATES = {GOOD: SEEN, UNCLEAR: '#7f7f7f'}


def draw(check: Check, calibration: Calibration, pictures: Sequence[Array], names: Sequence[str], path: str) -> None:
    """Write a PNG. pictures: (H, W, 3) uint8 BGR, those that were examined, with their names."""
    best = _clearest(check.lines) if check.lines else 0
    lines = check.lines[best] if check.lines else ()
    figure = pyplot.figure(figsize=(13, 10), constrained_layout=True)
    grid = figure.add_gridspec(2, 6, height_ratios=(1.0, 1.1))
    seen = calibration
    if check.fit is not None and check.verdict != UNCLEAR:
        seen = replace(calibration, homography=corrected_homography(calibration, check.fit.correction))
    _camera(figure.add_subplot(grid[0, :3]), calibration, seen, pictures[best], lines, names[best])
    _table(figure.add_subplot(grid[0, 3:]), check)
    _above(figure.add_subplot(grid[1, :2]), calibration, pictures[best], 'the road by the file', FILE)
    if seen is calibration:
        words = 'the file fits' if check.verdict == GOOD else 'no better answer than the file'
        _nothing(figure.add_subplot(grid[1, 2:4]), words)
    else:
        _above(figure.add_subplot(grid[1, 2:4]), seen, pictures[best], 'the road by the lines seen', SEEN)
    _obstacles(figure.add_subplot(grid[1, 4:]), check)
    title = '%s: the calibration %s' % (calibration.vehicle, check.verdict)
    if check.verdict == UNCLEAR:
        title = '%s: %s' % (calibration.vehicle, UNCLEAR)
    figure.suptitle(title, fontsize=16, color=STATES.get(check.verdict, FILE))
    figure.savefig(path, dpi=100)
    pyplot.close(figure)


def _clearest(lines: Sequence[Sequence[Line]]) -> int:
    """Number of the picture with the most tape."""
    return int(np.argmax([sum(len(line.left) for line in found) for found in lines]))


def _camera(
    axes: Any, calibration: Calibration, seen: Calibration, picture: Array, lines: Sequence[Line], name: str
) -> None:
    axes.imshow(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
    for trial, color, words in ((calibration, FILE, 'horizon by the file'), (seen, SEEN, 'horizon by the lines')):
        if trial is calibration or seen is not calibration:
            horizon = _horizon(trial)
            axes.plot(horizon[:, 0], horizon[:, 1], '--', color=color, label=words)
    told = set()
    for line in lines:
        for edge in (line.left, line.right):
            points = image_from_rectified(calibration, edge)
            label = None if line.tape in told else 'edges of %s tape' % line.tape.value
            told.add(line.tape)
            axes.plot(points[:, 0], points[:, 1], '.', markersize=3, color=TAPES[line.tape], label=label)
    axes.set_xlim(0, picture.shape[1])
    axes.set_ylim(picture.shape[0], 0)
    axes.set_title(name, fontsize=10)
    axes.axis('off')
    axes.legend(loc='upper right', fontsize=8)


def _horizon(calibration: Calibration) -> Array:
    """(N, 2) camera pixels of the horizon, bent by the lens."""
    u = np.linspace(0, calibration.width - 1, 60)
    homography = calibration.homography
    v = -(homography[2, 0] * u + homography[2, 2]) / homography[2, 1]
    return image_from_rectified(calibration, np.column_stack([u, v]))


def _above(axes: Any, calibration: Calibration, picture: Array, words: str, color: str) -> None:
    """The road from above, on a grid of metres."""
    x = np.arange(AHEAD[1], AHEAD[0], -1 / PIXELS_PER_METRE)
    y = np.arange(ASIDE, -ASIDE, -1 / PIXELS_PER_METRE)
    ground = np.stack(np.meshgrid(x, y, indexing='ij'), axis=-1).reshape(-1, 2)
    rectified = pixel_from_ground(calibration.homography, ground)
    pixels = image_from_rectified(calibration, rectified)
    pixels[(rectified[:, 0] < 0) | (rectified[:, 0] > calibration.width)] = -10  # there the lens model folds back
    maps = pixels.reshape(len(x), len(y), 2).astype(np.float32)
    road = cv2.remap(picture, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderValue=(110, 110, 110))
    axes.imshow(cv2.cvtColor(road, cv2.COLOR_BGR2RGB), extent=(ASIDE, -ASIDE, *AHEAD), aspect='equal')
    axes.grid(color='white', alpha=0.35, linewidth=0.8)
    axes.set_xticks(np.arange(-0.4, 0.41, 0.2))
    axes.set_yticks(np.arange(0.2, 1.01, 0.2))
    axes.set_xlabel('m to the left')
    axes.set_ylabel('m ahead of the wheels')
    axes.set_title(words, color=color, fontsize=11)


def _nothing(axes: Any, words: str) -> None:
    axes.axis('off')
    axes.text(0.5, 0.5, words, ha='center', va='center', fontsize=12, color='#7f7f7f')


def _table(axes: Any, check: Check) -> None:
    """The quantities, each with its verdict, and the reasons below."""
    axes.axis('off')
    if check.quantities:
        rows = table_rows(check)
        drawn = axes.table(
            cellText=[row[:-1] for row in rows],
            colLabels=('', 'by the file', 'by the lines', '± (95 %)', 'verdict'),
            colWidths=(0.34, 0.17, 0.17, 0.16, 0.13),
            loc='upper center',
            cellLoc='right',
        )
        drawn.auto_set_font_size(False)
        drawn.set_fontsize(9)
        drawn.scale(1, 1.25)
        for index, (*_, off) in enumerate(rows):
            drawn[index + 1, 0].set_text_props(ha='left')
            if off:
                drawn[index + 1, 4].set_text_props(color=FILE, weight='bold')
    words = '\n'.join(textwrap.fill(reason, 90) for reason in check.reasons if ': the file has' not in reason)
    axes.text(0.0, 0.0, words, fontsize=9, va='bottom', transform=axes.transAxes)


def table_rows(check: Check) -> List[Tuple[str, str, str, str, str, bool]]:
    """Name, value by the file, value by the lines, 95 % interval, verdict, and whether it is off."""
    return [
        (
            item.name,
            number(item, item.file),
            number(item, item.seen),
            number(item, 1.96 * item.spread),
            item.verdict,
            item.verdict == OFF,
        )
        for item in check.quantities
    ]


def _obstacles(axes: Any, check: Check) -> None:
    """Where obstacles straight ahead stand, and where the file puts them."""
    axes.set_title('what it does to an obstacle', fontsize=11)
    if not check.obstacles:
        axes.axis('off')
        return
    for distance, dx, dy, spread_x, spread_y in check.obstacles:
        axes.plot(0, distance, 'o', markersize=16, color=SEEN, alpha=0.6)
        axes.errorbar(
            dy, distance + dx, yerr=1.96 * spread_x, xerr=1.96 * spread_y, fmt='X', markersize=9, color=FILE, capsize=3
        )
        axes.annotate('', (dy, distance + dx), (0, distance), arrowprops={'arrowstyle': '->', 'color': FILE})
        words = '%.0f cm %s\n%.0f cm %s' % (
            abs(100 * dx), 'too far' if dx > 0 else 'too near', abs(100 * dy), 'left' if dy > 0 else 'right'
        )  # fmt: skip
        axes.text(-0.035, distance, words, fontsize=9, va='center')
    axes.plot([], [], 'o', color=SEEN, label='where it stands')
    axes.plot([], [], 'X', color=FILE, label='where the file puts it')
    axes.set_xlim(0.2, -0.2)
    axes.set_xticks((0.2, 0.1, 0.0, -0.1, -0.2))
    far = max(distance + max(dx, 0) for distance, dx, *_ in check.obstacles)
    axes.set_ylim(0, max(1.0, min(far + 0.1, 2.5)))
    axes.set_xlabel('m to the left')
    axes.grid(alpha=0.3)
    axes.legend(loc='upper right', fontsize=8)
