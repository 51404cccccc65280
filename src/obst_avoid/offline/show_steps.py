"""show_steps: every intermediate picture of the detector, as files and as one contact sheet."""

import argparse
import os
import sys
from typing import Any

from obst_avoid.core import detection
from obst_avoid.core.calibration import CalibrationError
from obst_avoid.core.picture import PictureError
from obst_avoid.offline import tool
from obst_avoid.offline.pictures import read_picture
from obst_avoid.offline.steps import Blob, steps_of
from obst_avoid.viz.overlay import contact_sheet


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
        try:
            steps = steps_of(detector, read_picture(path))
        except (PictureError, CalibrationError, OSError) as error:
            print('show_steps: %s' % (tool.why_os(error) if isinstance(error, OSError) else error), file=sys.stderr)
            broken += 1
            continue
        folder = os.path.join(options.output, stems[path])
        os.makedirs(folder, exist_ok=True)
        for name, panel in steps.panels:
            tool.write_picture(os.path.join(folder, name.replace(', ', '_').replace(' ', '_') + '.png'), panel)
        tool.write_picture(os.path.join(folder, 'contact_sheet.png'), contact_sheet(steps.panels, columns=3, width=480))
        for blob in steps.blobs:
            print('%s %s' % (path, _sentence(blob)))
    print('%d pictures: %s' % (len(files) - broken, options.output))
    return 1 if broken else 0


def _sentence(blob: Blob) -> str:
    """Where it is, and why it is no obstacle, or how sure and the measurements that moved that most."""
    where = '(%d, %d) %s' % (*blob.corner, blob.kind.value)
    if not blob.reasons:
        return '%s: %s%s' % (where, 'accepted, ' if blob.accepted else '', blob.why)
    reasons = ', '.join('%s %+.1f' % reason for reason in blob.reasons.items())
    return '%s %.2f: %s' % (where, blob.numbers['confidence'], reasons)
