"""show_steps: every intermediate picture of the detector, as files and as one contact sheet."""

import argparse
import os
import sys
from typing import Any, Dict, Iterator

from obst_avoid.core import detection
from obst_avoid.core.calibration import CalibrationError
from obst_avoid.core.detection.robust import trees
from obst_avoid.core.picture import PictureError
from obst_avoid.offline import tool
from obst_avoid.offline.pictures import read_picture
from obst_avoid.viz.overlay import contact_sheet
from obst_avoid.viz.steps import paper_steps, robust_steps


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='show_steps', description='Write each intermediate picture of the detector, and all of them on one sheet.'
    )
    tool.add_calibration_arguments(parser)
    parser.add_argument('--output', metavar='DIR', required=True, help='folder to write to, one folder a picture')
    parser.add_argument('paths', metavar='PATH', nargs='+', help='pictures, or folders of pictures')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    files = tool.picture_files(options.paths)
    names = tool.short_names(files)
    stems = {path: os.path.splitext(name)[0] for path, name in names.items()}
    stems = stems if len(set(stems.values())) == len(stems) else names
    detector = detection.start(tool.calibration_of(options), tool.detection_settings(options))
    broken = 0
    for path in tool.progress(files, 'drawing'):
        stages: Dict[str, Any] = {}
        try:
            picture = read_picture(path)
            _, seen = detection.detect(detector, picture, None, trace=stages.__setitem__)
        except (PictureError, CalibrationError, OSError) as error:
            print('show_steps: %s' % (tool.why_os(error) if isinstance(error, OSError) else error), file=sys.stderr)
            broken += 1
            continue
        robust = seen.camera is not None
        panels = (
            robust_steps(picture, stages, seen.view, seen.camera) if robust else paper_steps(picture, stages, seen.view)
        )
        folder = os.path.join(options.output, stems[path])
        os.makedirs(folder, exist_ok=True)
        for name, panel in panels:
            tool.write_picture(os.path.join(folder, name.replace(', ', '_').replace(' ', '_') + '.png'), panel)
        tool.write_picture(os.path.join(folder, 'contact_sheet.png'), contact_sheet(panels, columns=3, width=480))
        for sentence in _why_robust(stages) if robust else _why_paper(stages):
            print('%s %s' % (path, sentence))
    print('%d pictures: %s' % (len(files) - broken, options.output))
    return 1 if broken else 0


def _why_paper(stages: Dict[str, Any]) -> Iterator[str]:
    """A sentence for each blob: where it is, and why it is no obstacle."""
    for blob in stages['blobs']:
        yield '(%d, %d) %s: %s' % (blob.box.left, blob.box.bottom, blob.kind.value, blob.refused or 'accepted')


def _why_robust(stages: Dict[str, Any]) -> Iterator[str]:
    """A sentence for each candidate: where it is, how sure, and the measurements that moved that most."""
    for item in stages['candidates']:
        moved = trees.reasons(trees.shipped()['thing'], stages['values'][item.row])
        reasons = ', '.join('%s %+.1f' % reason for reason in moved)
        yield '(%d, %d) %s %.2f: %s' % (item.box.left, item.box.bottom, item.kind.value, item.confidence, reasons)
