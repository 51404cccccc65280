"""run_scenarios: many drives in the simulated town, in lockstep without ROS, and what came of them."""

import argparse
import math
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, replace
from multiprocessing import get_context
from typing import Any, Dict, List, Optional, Sequence, Tuple

import cv2
import numpy as np
from scipy.stats import beta

from obst_avoid.core.bird_view import make_bird_view
from obst_avoid.offline import tool
from obst_avoid.offline.simulation import (
    add_robot_arguments,
    film_of,
    robot_of,
    simulation_settings,
    towns_folder,
    write_film,
)  # fmt: skip
from obst_avoid.sim import world as worlds
from obst_avoid.sim.episode import Frame, Outcome, run
from obst_avoid.sim.renderer import Renderer, RenderError
from obst_avoid.sim.scenario import load_scenario

FILM_RATE = 10.0
PROMPT = 0.2
"""[s] within which the detector has to know what has come near and into view."""
RESTART = 2.0
"""[s] within which a robot that waited drives on when the obstacle has gone."""


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='run_scenarios',
        description='Drive scenarios in the simulated town. Exit code 0 says that they ran, not that all went well.',
    )
    add_robot_arguments(parser)
    parser.add_argument('--count', type=tool.count, default=1, help='episodes of each scenario (default: 1)')
    parser.add_argument(
        '--seed', type=tool.seed, help='of the first episode; the next one has the next (default: as in the file)'
    )
    parser.add_argument('--jobs', type=tool.count, default=1, help='episodes at the same time (default: 1)')
    parser.add_argument('--pose-errors', metavar='NAME', help='of simulation.yaml, instead of what the scenarios name')
    parser.add_argument('--light', metavar='COLOR', help='of the lamps, instead of what the scenarios name')
    parser.add_argument('--picture-rate', metavar='HZ', type=tool.rate, help='instead of that of simulation.yaml')
    parser.add_argument(
        '--without-pictures',
        action='store_true',
        help='leave the camera and the detector out and take the truth with their errors: fast, for tuning the avoider',
    )
    parser.add_argument(
        '--output', metavar='DIR', help='folder for scenarios.json, table.txt, and films of what failed'
    )
    parser.add_argument('--films', choices=('failures', 'all', 'none'), default='failures', help='(default: failures)')
    parser.add_argument(
        'scenarios', metavar='SCENARIO', nargs='*', help='YAML files, or names of config/scenarios; without any: all'
    )
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    files = _files(options)
    if options.output:
        os.makedirs(options.output, exist_ok=True)
    _start(options)  # what is wrong is said here, once, not by every worker
    tasks = [(path, first + index) for path, first in _first_seeds(files, options) for index in range(options.count)]
    if options.jobs == 1:
        outcomes = [_drive(*task) for task in tool.progress(tasks, 'driving')]
    else:
        workers = ProcessPoolExecutor(options.jobs, get_context('spawn'), _start, (options,))
        with workers:
            futures = [workers.submit(_drive, *task) for task in tasks]
            outcomes = [future.result() for future in tool.progress(as_completed(futures), 'driving', len(futures))]
    order = {task: index for index, task in enumerate(tasks)}
    outcomes.sort(key=lambda outcome: order[outcome['file'], outcome['seed']])
    families = {_family(path): [o for o in outcomes if o['file'] == path] for path in files}
    summary = {name: summarise(found) for name, found in families.items()}
    print(table(summary))
    if options.output:
        path = os.path.join(options.output, 'scenarios.json')
        tool.write_json(path, {'options': vars(options), 'families': summary, 'episodes': outcomes})
        with open(os.path.join(options.output, 'table.txt'), 'w', encoding='utf-8') as file:
            file.write(table(summary) + '\n')
        print('\n%s' % path)
    for outcome in outcomes:
        if not outcome['success']:
            print('%s, seed %d: %s' % (outcome['scenario'], outcome['seed'], outcome['why']))
    return 0


def summarise(outcomes: Sequence[Dict[str, Any]]) -> Dict[str, Any]:
    """The figures of one family. Shares come with 95 % intervals (Clopper and Pearson).

    median_gap_m: of the episodes without contact. prompt: of what came near and into view, known within PROMPT. lost:
    how often a known one was missing from a report. invented: how often the detector began to report what is not there.
    restart: of robots that had to wait, those that drove on within RESTART.
    """
    count = len(outcomes)
    hits = sum(outcome['contact'] is not None for outcome in outcomes)
    met = sum(outcome['in_the_way'] for outcome in outcomes)
    gaps = [o['smallest_gap'] for o in outcomes if o['smallest_gap'] is not None]
    kept = [o['smallest_gap'] for o in outcomes if o['smallest_gap'] is not None and o['contact'] is None]
    near = [(o['seconds'] - thing['since'], thing) for o in outcomes for thing in o['sightings']['of'].values()]
    prompt = [thing['after'] is not None and thing['after'] <= PROMPT + 1e-6 for since, thing in near if since > PROMPT]
    waits = [outcome['restart'] for outcome in outcomes if outcome['restart'] is not None]
    seconds, metres = sum(o['seconds'] for o in outcomes), sum(max(o['driven'], 0.0) for o in outcomes)
    return {
        'episodes': count,
        'success': share(sum(outcome['success'] for outcome in outcomes), count),
        'contacts': share(hits, count),
        'avoided_to_hit': [met - sum(o['in_the_way'] and o['contact'] is not None for o in outcomes), hits],
        'stops': sum(outcome['stops'] for outcome in outcomes),
        'activations': sum(outcome['activations'] for outcome in outcomes),
        'false_stops': sum(outcome['false_stops'] for outcome in outcomes),
        'metres': round(metres, 1),
        'smallest_gap_m': round(min(gaps), 3) if gaps else None,
        'median_gap_m': round(float(np.median(kept)), 3) if kept else None,
        'off_lane_share': round(sum(o['off_lane'] for o in outcomes) / seconds, 4) if seconds else None,
        'prompt': share(sum(prompt), len(prompt)) if prompt else None,
        'restart': share(sum(wait <= RESTART for wait in waits), len(waits)) if waits else None,
        'lost': sum(thing['lost'] for _, thing in near),
        'invented': sum(o['sightings']['invented'] for o in outcomes),
    }


def share(part: int, whole: int) -> List[float]:
    """[share, lower, upper] with the exact 95 % interval of a binomial share."""
    if not whole:
        return [math.nan, 0.0, 1.0]
    low = float(beta.ppf(0.025, part, whole - part + 1)) if part else 0.0
    high = float(beta.ppf(0.975, part + 1, whole - part)) if part < whole else 1.0
    return [round(part / whole, 4), round(low, 4), round(high, 4)]


def table(summary: Dict[str, Dict[str, Any]]) -> str:
    """The families for a terminal."""
    head = '%-18s %4s %20s %20s %9s %6s %6s %6s %7s %7s %6s %7s %5s %8s' % (
        'family', 'n', 'success % (95 %)', 'contacts % (95 %)', 'avoid:hit', 'stops', 'activ.', 'false', 'gap min',
        'median', 'off %', 'prompt', 'lost', 'invented',
    )  # fmt: skip
    lines = [head]
    for name, row in summary.items():
        cells = ['%.0f (%.0f to %.0f)' % tuple(100 * value for value in row[key]) for key in ('success', 'contacts')]
        gaps = ['-' if row[key] is None else '%.3f' % row[key] for key in ('smallest_gap_m', 'median_gap_m')]
        lines.append(
            '%-18s %4d %20s %20s %9s %6d %6d %6d %7s %7s %6.1f %7s %5d %8d'
            % (
                name,
                row['episodes'],
                *cells,
                '%d:%d' % tuple(row['avoided_to_hit']),
                row['stops'],
                row['activations'],
                row['false_stops'],
                *gaps,
                100 * (row['off_lane_share'] or 0.0),
                '-' if row['prompt'] is None else '%.0f' % (100 * row['prompt'][0]),
                row['lost'],
                row['invented'],
            )  # fmt: skip
        )
    return '\n'.join(lines)


_state: Dict[str, Any] = {}
"""A worker's own: what is too costly to make for each episode."""


def _start(options: argparse.Namespace) -> None:
    if options.jobs > 1:
        cv2.setNumThreads(1)
    calibration, robot = robot_of(options)
    renderer: Optional[Renderer] = None
    if not options.without_pictures:
        try:
            renderer = Renderer(calibration)
        except RenderError as error:
            raise tool.ToolError(str(error)) from error
    settings = simulation_settings(options.config)
    if options.picture_rate:
        settings = replace(settings, picture_rate=options.picture_rate)
    view = make_bird_view(calibration, robot.detector.settings.bird_view)
    _state.update(options=options, robot=robot, renderer=renderer, settings=settings, view=view)


def _drive(path: str, seed: int) -> Dict[str, Any]:
    """One episode in a worker; what comes back is plain, for JSON."""
    options = _state['options']
    scenario = load_scenario(path, seed, towns_folder(options.config), _instead(options))
    frames: List[Frame] = []
    keep = options.output and options.films != 'none' and not options.without_pictures
    outcome = run(scenario, _state['robot'], _state['settings'], _state['renderer'], frames.append if keep else _forget)
    film: Optional[str] = None
    if keep and frames and (options.films == 'all' or not outcome.success):
        film = os.path.join(options.output, '%s_%d.mp4' % (scenario.name, seed))
        settings, robot, view = _state['settings'], _state['robot'], _state['view']
        every = max(1, round(settings.picture_rate / FILM_RATE))
        title = '%s, seed %d: %s' % (scenario.name, seed, outcome.why)
        pictures = film_of(frames, scenario, robot, view, settings.picture_delay, title, every)
        write_film(film, pictures, settings.picture_rate / every)
    return {'file': path, 'film': film, **plain(outcome)}


def plain(outcome: Outcome) -> Dict[str, Any]:
    """An outcome for JSON, which knows no inf."""
    values = asdict(outcome)
    if outcome.contact is not None:
        contact = outcome.contact
        values['contact'] = {'time': contact.time, 'x': contact.x, 'y': contact.y, 'sort': contact.thing.sort}
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value for name, value in values.items()
    }


def _first_seeds(files: Sequence[str], options: argparse.Namespace) -> List[Tuple[str, int]]:
    """Load each scenario once, so that what is wrong in one of many is said before the first is driven."""
    first = []
    for path in files:
        scenario = load_scenario(path, options.seed or 0, towns_folder(options.config), _instead(options))
        worlds.begin(scenario, _state['settings'])
        first.append((path, scenario.settings.seed if options.seed is None else options.seed))
    return first


def _forget(frame: Frame) -> None:
    """Nobody wants a film."""


def _instead(options: argparse.Namespace) -> Dict[str, Any]:
    instead: Dict[str, Any] = {}
    if options.pose_errors:
        instead['pose_errors'] = options.pose_errors
    if options.light:
        instead['light/color'] = options.light
    return instead


def _files(options: argparse.Namespace) -> List[str]:
    folder = os.path.join(options.config or os.path.join(tool.package_folder(), 'config'), 'scenarios')
    names = options.scenarios or sorted(name for name in os.listdir(folder) if name.endswith('.yaml'))
    files: Dict[str, str] = {}
    for name in names:
        inside = os.path.join(folder, name if name.endswith('.yaml') else name + '.yaml')
        path = name if os.path.isfile(name) else inside
        if not os.path.isfile(path):
            known = ', '.join(sorted(entry[:-5] for entry in os.listdir(folder) if entry.endswith('.yaml')))
            raise tool.ToolError('%s is no scenario, expected a YAML file or one of: %s' % (name, known))
        if _family(path) in files:
            raise tool.ToolError('%s and %s have one name, expected different ones' % (files[_family(path)], path))
        files[_family(path)] = path
    return list(files.values())


def _family(path: str) -> str:
    """What a scenario is called."""
    return os.path.splitext(os.path.basename(path))[0]
