"""demo: the whole graph on the drawn drive, or on the user's pictures; a summary and a contact sheet at the end."""

import argparse
import json
import os
import socket
import subprocess
import sys
from typing import Any

from obst_avoid.offline import drawn_bag, tool
from obst_avoid.offline.summary import table


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='demo',
        description='Play a drawn drive, or your pictures, through detector, avoider, visualizer and controller.',
    )
    parser.add_argument('--output', metavar='DIR', required=True, help='folder for summary.json and contact_sheet.png')
    parser.add_argument('--images', metavar='DIR', help='play the pictures of a folder instead of the drawn drive')
    parser.add_argument(
        '--calibration', metavar='DIR', default='', help='folder with camera_intrinsic/ and camera_extrinsic/'
    )
    parser.add_argument('--vehicle', metavar='NAME', default='demo', help='robot whose calibration is used')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    output = os.path.abspath(options.output)
    os.makedirs(output, exist_ok=True)
    for name in ('summary.json', 'contact_sheet.png'):  # of an earlier demo: must not pass for this one's
        if os.path.exists(os.path.join(output, name)):
            os.remove(os.path.join(output, name))
    call = ['roslaunch', '--port', str(_free_port()), 'obst_avoid', 'demo.launch', 'output:=' + output]
    call += [
        'veh:=' + options.vehicle,
        'calibration_dir:=' + (options.calibration and os.path.abspath(options.calibration)),
    ]
    if options.images:
        tool.picture_files([options.images])
        call.append('images:=' + os.path.abspath(options.images))
    else:
        bag = os.path.join(output, 'drawn.bag')
        print('drawing the drive: %s' % bag, flush=True)
        drawn_bag.write(bag)
        call.append('bag:=' + bag)
    with open(os.path.join(output, 'log.txt'), 'w', encoding='utf-8') as log:
        process = subprocess.Popen(
            call,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors='replace',
            env={**os.environ, 'PYTHONUNBUFFERED': '1'},  # or the nodes' words come when all is over
        )
        assert process.stdout is not None
        over = False
        for line in process.stdout:
            log.write(line)
            over = over or 'the recording is over' in line  # what follows is the nodes' ending
            if _worth_showing(line) and not over:
                print(line.rstrip(), flush=True)
        process.wait()
    try:
        with open(os.path.join(output, 'summary.json'), encoding='utf-8') as file:
            summary = json.load(file)
    except OSError as error:
        raise tool.ToolError('the drive ended without a summary, see %s' % log.name) from error
    print('\n' + table(summary) + '\n\nPictures and log: %s' % output)
    if not options.images and not (summary['stops'] and summary['releases']):
        print(
            'demo: %d stops and %d releases, expected at least one of each' % (summary['stops'], summary['releases']),
            file=sys.stderr,
        )
        return 1
    return 0


def _worth_showing(line: str) -> bool:
    """What a person wants to see of the graph's output: the nodes' own words, warnings and errors."""
    return any(mark in line for mark in ('[INFO]', '[WARN]', '[ERROR]', '[FATAL]', 'Traceback', 'Error'))


def _free_port() -> int:
    """For a master of our own, beside one that may be running."""
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])
