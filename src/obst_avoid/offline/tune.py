"""tune: a local web page with sliders over pictures, a bag or a running robot."""

import argparse
import importlib.util
import os
import socket
import sys
from typing import Any

from obst_avoid.offline import tool
from obst_avoid.offline.tool import ToolError


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='tune',
        description='Move sliders and see what changes, before and after side by side: every step of the detector, '
        'why each blob counts or not, and the plan. The page is for this machine alone (127.0.0.1).',
    )
    tool.add_calibration_arguments(parser)
    parser.add_argument('--robot', metavar='NAME', help='instead of PATHs: a running robot, whose settings are changed')
    parser.add_argument('--port', type=int, default=8080, help='of the page (default: 8080)')
    parser.add_argument('--output', metavar='DIR', default='tuned', help='folder to save settings to (default: tuned)')
    parser.add_argument('paths', metavar='PATH', nargs='*', help='a bag, or pictures and folders of pictures')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    if bool(options.robot) == bool(options.paths):
        raise ToolError('expected pictures, a bag, or --robot NAME: one of these')
    if options.robot and (options.config or options.profile):
        raise ToolError('--config and --profile are not for --robot, expected neither: it has settings of its own')
    if os.environ.get('OBST_AVOID_VENV'):  # for this program alone; first, since it needs newer ones than Debian's
        sys.path.insert(0, os.environ['OBST_AVOID_VENV'])
    if importlib.util.find_spec('nicegui') is None:
        raise ToolError('NiceGUI is missing, expected it in build/venv: run make setup, and source setup.bash again')
    if os.path.exists(options.output) and not os.path.isdir(options.output):
        raise ToolError('%s is no folder, expected one, or a new name' % options.output)
    _require_free(options.port)
    options.vehicle = options.vehicle or (options.robot if options.calibration else '')
    calibration = tool.calibration_of(options)
    # Only now: these need NiceGUI, and take their time.
    from obst_avoid.offline.tuning.page import Desk, serve
    from obst_avoid.offline.tuning.robot import Robot
    from obst_avoid.offline.tuning.source import open_pictures

    robot = Robot(options.robot) if options.robot else None
    source = None if robot is not None else open_pictures(options.paths, options.vehicle)
    desk = Desk(calibration, options.config, options.profile, options.output, source, robot)
    address = 'http://127.0.0.1:%d' % options.port
    serve(desk, options.port, lambda: print('%s (Ctrl-C ends it)' % address, flush=True))
    return 0


def _require_free(port: int) -> None:
    """Say now what the server would say in the midst of its own words."""
    if not 1 <= port <= 65535:
        raise ToolError('--port %d, expected 1 to 65535' % port)
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(('127.0.0.1', port))
        except OSError as error:
            raise ToolError('port %d is not to be had (%s), expected a free one' % (port, error.strerror)) from error
