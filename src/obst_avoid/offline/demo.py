"""demo: a drive through the simulated town in the real ROS graph, or the user's pictures; what happened, at the end."""

import argparse
import json
import os
import sys
from typing import Any, Dict, List

from obst_avoid.offline import tool
from obst_avoid.offline.drive_report import report
from obst_avoid.offline.graph import launched
from obst_avoid.offline.simulation import calibration_of
from obst_avoid.offline.summary import table

SHOWN = ('[INFO]', '[WARN]', '[ERROR]', '[FATAL]', 'Traceback', 'Error')
LAST_WORDS = ('the drive is over', 'the recording is over')


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='demo',
        description='Drive through the simulated town, or play your pictures, with all nodes; exit code 0 only if the '
        'robot touched nothing and stopped where it had to.',
    )
    tool.add_calibration_arguments(parser)
    parser.add_argument('--output', metavar='DIR', required=True, help='folder for film, plot, summary and log')
    parser.add_argument('--images', metavar='DIR', help='play the pictures of a folder instead of driving')
    parser.add_argument('--rviz', action='store_true', help='open rviz')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    output = options.output = os.path.abspath(options.output)
    calibration_of(options)  # what is wrong with it is said before the drive
    os.makedirs(output, exist_ok=True)
    made = (
        'summary.json',
        'contact_sheet.png',
        'drive.bag',
        'drive.bag.active',
        'drive.json',
        'drive.mp4',
        'drive.png',
    )
    for name in made:  # of an earlier demo: must not pass for this one's
        if os.path.exists(os.path.join(output, name)):
            os.remove(os.path.join(output, name))
    arguments = [
        'veh:=' + (options.vehicle or 'demo'),
        'calibration_dir:=' + (options.calibration and os.path.abspath(options.calibration)),
        'rviz:=%s' % str(options.rviz).lower(),
    ]
    if options.profile:
        arguments.append('profile:=' + options.profile)
    log = os.path.join(output, 'log.txt')
    if options.images:
        tool.picture_files([options.images])
        arguments += ['images:=' + os.path.abspath(options.images), 'output:=' + output]
        _launch(['replay.launch', 'allow_default_calibration:=true'] + arguments, log)
        summary = _read(os.path.join(output, 'summary.json'), log)
        faults: List[str] = []
    else:
        options.bag = os.path.join(output, 'drive.bag')
        _launch(['demo.launch', 'bag:=' + options.bag] + arguments, log)
        if not os.path.exists(options.bag):
            raise tool.ToolError('the drive ended without a recording, see %s' % log)
        print('\nmaking film and plot of the drive', flush=True)
        summary = report(options)
        faults = _faults(summary, log)
    print('\n' + table(summary) + '\n\nResults and log: %s' % output)
    for fault in faults:
        print('demo: %s' % fault, file=sys.stderr)
    return 1 if faults else 0


def _faults(summary: Dict[str, Any], log: str) -> List[str]:
    """What the drive should have been and was not."""
    faults = []
    if summary.get('contacts', 1):
        faults.append('the robot touched an obstacle, expected that it does not')
    if not summary.get('stops_before_an_obstacle'):  # that it drove on later shows at the goal, behind the duckie
        faults.append('the robot did not stop for the duckie in its lane, expected that it does')
    with open(log, encoding='utf-8') as file:
        if 'the goal is reached' not in file.read():
            faults.append('the robot did not reach the end of its way in time, expected that it does')
    return faults


def _launch(call: List[str], log_path: str) -> None:
    """Run a launch file to its end on a master of its own; show the nodes' own words, and keep all in the log."""
    with open(log_path, 'w', encoding='utf-8') as log, launched(call) as graph:
        assert graph.process.stdout is not None
        over = False
        for line in graph.process.stdout:
            log.write(line)
            if not over and any(mark in line for mark in SHOWN):
                print(line.rstrip(), flush=True)
            over = over or any(words in line for words in LAST_WORDS)  # what follows is the nodes' ending


def _read(path: str, log: str) -> Dict[str, Any]:
    try:
        with open(path, encoding='utf-8') as file:
            summary: Dict[str, Any] = json.load(file)
            return summary
    except OSError as error:
        raise tool.ToolError('the drive ended without a summary, see %s' % log) from error
