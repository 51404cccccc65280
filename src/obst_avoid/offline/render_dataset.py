"""render_dataset: random pictures of the simulated town with exact labels, for measuring and tuning detectors."""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from typing import Any, Dict, List, Tuple

import cv2
import numpy as np

from obst_avoid.core.picture import encode_jpeg
from obst_avoid.core.settings import load, read_yaml
from obst_avoid.core.types import Array, Kind
from obst_avoid.offline import tool
from obst_avoid.offline.simulation import calibration_of, simulation_settings, towns_folder
from obst_avoid.sim.exam import ROAD, ExamSettings, Question, ask, sheet_question
from obst_avoid.sim.renderer import Renderer, RenderError
from obst_avoid.sim.settings import SimulationSettings
from obst_avoid.sim.town import Town, follow, town_from_mapping
from obst_avoid.viz.overlay import contact_sheet

CATEGORIES = {Kind.DUCKIE: 1, Kind.CONE: 2}
SAMPLES = 4
SHEET_BLURS = (0.0, 10.0, 20.0)
_state: Dict[str, Any] = {}
"""A worker's own: what is too costly to make for each picture."""


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='render_dataset', description='Render pictures of the simulated town, with COCO labels (labels.json).'
    )
    parser.add_argument(
        '--calibration', metavar='DIR', default='', help='folder with camera_intrinsic/ and camera_extrinsic/'
    )
    parser.add_argument('--vehicle', metavar='NAME', default='', help='robot whose camera is simulated')
    parser.add_argument('--config', metavar='DIR', default='', help="folder of settings (default: the package's own)")
    parser.add_argument('--settings', metavar='FILE', help='what is rendered (default: exam.yaml of the settings)')
    parser.add_argument('--count', type=tool.count, default=100, help='pictures (default: 100)')
    parser.add_argument('--seed', type=tool.seed, default=1, help='another one gives other pictures (default: 1)')
    parser.add_argument('--layouts', metavar='NAME', nargs='+', help='only these of the settings')
    parser.add_argument('--lights', metavar='COLOR', nargs='+', help='instead of those of the settings')
    parser.add_argument('--distances', metavar='M', type=float, nargs=2, help='nearest and farthest obstacle')
    parser.add_argument('--jobs', type=tool.count, default=1, help='pictures at the same time (default: 1)')
    parser.add_argument('--sheets', action='store_true', help='instead: one sheet a layout, lights by blur, to look at')
    parser.add_argument('--output', metavar='DIR', required=True, help='folder to write, empty or new')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    if os.path.isdir(options.output) and os.listdir(options.output):
        raise tool.ToolError('%s is not empty, expected a new folder' % options.output)
    _start(options)
    os.makedirs(os.path.join(options.output, '' if options.sheets else 'images'), exist_ok=True)
    if options.sheets:
        _write_sheets(options.output)
        return 0
    indices = range(options.count)
    if options.jobs == 1:
        answers = list(tool.progress(map(_render, indices), 'rendering', options.count))
    else:
        with ProcessPoolExecutor(options.jobs, get_context('spawn'), _start, (options,)) as workers:
            answers = list(tool.progress(workers.map(_render, indices, chunksize=4), 'rendering', options.count))
    content = {
        'info': {'options': vars(options)},
        'categories': [{'id': number, 'name': kind.value} for kind, number in CATEGORIES.items()],
        'images': [image for image, _ in answers],
        'annotations': [
            {'id': number + 1, **annotation}
            for number, annotation in enumerate(item for _, found in answers for item in found)
        ],
    }
    path = os.path.join(options.output, 'labels.json')
    tool.write_json(path, content, indent=None)
    print('%d pictures, %d obstacles: %s' % (len(answers), len(content['annotations']), path))
    return 0


def _start(options: argparse.Namespace) -> None:
    if options.jobs > 1:
        cv2.setNumThreads(1)
    path = _settings_path(options)
    content = read_yaml(path)
    if options.lights and isinstance(content, dict):
        content['colors'] = options.lights
    if options.distances and isinstance(content, dict):
        content['distance'] = {'from': min(options.distances), 'to': max(options.distances)}
    settings = load(ExamSettings, content, path)
    if options.layouts:
        unknown = [name for name in options.layouts if name not in settings.layouts]
        if unknown:
            raise tool.ToolError('%s is no layout, expected: %s' % (unknown[0], ', '.join(settings.layouts)))
        settings = replace(settings, layouts={name: settings.layouts[name] for name in options.layouts})
    towns = _towns(settings, options.config)
    for layout in settings.layouts.values():  # what is wrong is said before the first picture
        follow(towns[layout.map], layout.column, layout.row, layout.heading, layout.turns, ROAD)
    try:
        renderer = Renderer(calibration_of(options), SAMPLES)
    except RenderError as error:
        raise tool.ToolError(str(error)) from error
    simulation: SimulationSettings = simulation_settings(options.config)
    _state.update(
        options=options,
        settings=settings,
        simulation=simulation,
        renderer=renderer,
        towns=towns,
    )


def _render(index: int) -> Tuple[Dict[str, Any], List[Dict[str, Any]]]:
    """Render one picture into the folder; its entries for labels.json."""
    options, simulation = _state['options'], _state['simulation']
    question = ask(index, options.seed, _state['settings'], simulation.sensor, _state['towns'], _state['renderer'])
    name = '%06d.jpg' % index
    with open(os.path.join(options.output, 'images', name), 'wb') as file:
        file.write(encode_jpeg(question.picture, simulation.jpeg_quality))
    return _image(question, index, name), _annotations(question, index)


def _image(question: Question, index: int, name: str) -> Dict[str, Any]:
    pose = question.truth.lane_pose
    height, width = question.picture.shape[:2]
    return {
        'id': index + 1, 'file_name': name, 'width': width, 'height': height, 'subset': 'rendered',
        'sequence_id': 'rendered/%s' % question.layout, 'split_block': question.layout, 'frame_index': index,
        'robot': 'simulated', 'lighting': question.color, 'rectified': False,
        'complete': {'duckie': 'all', 'cone': 'all'}, 'layout': question.layout,
        'light_strength': round(question.strength, 4), 'blur_px': round(question.blur, 2),
        'glare': round(question.glare, 3), 'exposure_s': round(question.sensor.exposure, 5),
        'gain': round(question.sensor.gain, 2), 'exposure_error_stops': round(question.exposure_error, 3),
        'lane_pose': {'d': pose.d, 'phi': pose.phi, 'curvature': pose.curvature},
    }  # fmt: skip


def _annotations(question: Question, index: int) -> List[Dict[str, Any]]:
    found = []
    for thing, obstacle in zip(question.things, question.truth.obstacles):
        if obstacle.box is None:
            continue
        box = obstacle.box
        found.append({
            'image_id': index + 1, 'category_id': CATEGORIES[obstacle.kind],
            'bbox': [box.left, box.top, box.right - box.left, box.bottom - box.top],
            'area': int(obstacle.mask.sum()), 'iscrowd': 0, 'segmentation': run_lengths(obstacle.mask),
            'x': round(obstacle.x, 4), 'y': round(obstacle.y, 4), 'radius': round(obstacle.radius, 4),
            'in_lane': obstacle.in_lane, 'sort': thing.sort, 'height_m': round(thing.height, 4), 'lying': thing.lying,
        })  # fmt: skip
    return found


def run_lengths(mask: Array) -> Dict[str, Any]:
    """COCO's uncompressed run-length encoding of a (H, W) bool mask: column by column, beginning with False."""
    values = np.concatenate([[False], mask.ravel(order='F'), [not mask[-1, -1]]])
    edges = np.flatnonzero(values[1:] != values[:-1])
    counts = np.diff(np.concatenate([[0], edges]))
    return {'size': list(mask.shape), 'counts': [int(count) for count in counts]}


def _write_sheets(output: str) -> None:
    settings, towns = _state['settings'], _state['towns']
    for name in tool.progress(list(settings.layouts), 'rendering'):
        panels = []
        for color in settings.colors:
            for blur in SHEET_BLURS:
                question = sheet_question(
                    name, color, blur, settings, _state['simulation'].sensor, towns, _state['renderer']
                )
                panels.append(('%s, %s, blur %.0f px' % (name, color, blur), question.picture))
        path = os.path.join(output, 'sheet_%s.png' % name)
        tool.write_picture(path, contact_sheet(panels, columns=len(SHEET_BLURS), width=400))
        print(path)


def _settings_path(options: argparse.Namespace) -> str:
    return str(
        options.settings or os.path.join(options.config or os.path.join(tool.package_folder(), 'config'), 'exam.yaml')
    )


def _towns(settings: ExamSettings, config: str) -> Dict[str, Town]:
    towns = {}
    for layout in settings.layouts.values():
        path = os.path.join(towns_folder(config), layout.map + '.yaml')
        towns[layout.map] = town_from_mapping(read_yaml(path), path)
    return towns
