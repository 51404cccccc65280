"""bench: where the time goes, stage by stage, beside the cost of decoding the picture."""

import argparse
import json
import os
import time
from typing import Any, Dict, List, Tuple

import cv2
import numpy as np

from obst_avoid.core import detection
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.picture import decode_jpeg, encode_jpeg
from obst_avoid.offline import tool
from obst_avoid.offline.bench_simulation import bench_simulation
from obst_avoid.offline.pictures import read_jpeg
from obst_avoid.offline.simulated_bag import Camera, stands, straight_road
from obst_avoid.offline.simulation import add_robot_arguments
from obst_avoid.sim.renderer import Scene
from obst_avoid.sim.town import pose_at

WARM_UP = 20
RENDERED = 20
"""Different rendered pictures; they are repeated to make up the number wanted."""
DECODE, TOTAL = 'decode', 'detector, without decoding'
WORDS = {
    'corrected': 'colour correction, every pixel',
    'cropped': 'rectify and crop',
    'bird_view': 'warp to the bird view',
    'hsv': 'convert to HSV',
    'colors': 'yellow, orange, white',
    'blobs': 'label, regionprops, criteria',
    'tracked': 'tracker',
    'obstacles': 'position, radius, search line, boxes',
}


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='bench', description='Time each stage of the detector beside JPEG decoding, and the simulation.'
    )
    add_robot_arguments(parser)
    parser.add_argument('--soak', type=float, default=0.0, metavar='MIN', help='watch memory for so many minutes, too')
    parser.add_argument('--count', type=tool.count, default=200, help='pictures that are timed (default: 200)')
    parser.add_argument('--output', metavar='FILE', help='write the figures there, as JSON')
    parser.add_argument('paths', metavar='PATH', nargs='*', help='pictures or folders; without any, they are rendered')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    if options.paths:
        calibration = tool.calibration_of(options)
        pictures = [read_jpeg(path) for path in tool.picture_files(options.paths)[: options.count]]
    else:
        calibration = tool.default_calibration()
        pictures = _rendered(calibration)
    detector = detection.start(calibration, tool.detection_settings(options))
    result: Dict[str, Any] = {'pictures': options.count, 'opencv': cv2.__version__, 'threads': {}}
    for threads in (1, cv2.getNumThreads()):
        cv2.setNumThreads(threads)
        times = _times(detector, [pictures[i % len(pictures)] for i in range(WARM_UP + options.count)])
        figures = {name: _figures(values[WARM_UP:]) for name, values in times.items()}
        result['threads'][str(threads)] = figures
        _print(figures, threads, options.count)
    if not options.paths:
        result['simulation'] = bench_simulation(options)
    if options.output:
        os.makedirs(os.path.dirname(os.path.abspath(options.output)), exist_ok=True)
        with open(options.output, 'w', encoding='utf-8') as file:
            json.dump(result, file, indent=1)
    return 0


def _times(detector: detection.Detector, jpegs: List[bytes]) -> Dict[str, List[float]]:
    """[ms] of each stage, a list over the pictures."""
    times: Dict[str, List[float]] = {}
    for index, jpeg in enumerate(tool.progress(jpegs, 'timing')):
        watch = _Watch()
        picture = decode_jpeg(jpeg)
        watch.lap(DECODE, None)
        _, detector = detection.detect(detector, picture, tool.stamp_of_frame(index, 30.0), trace=watch.lap)
        laps = dict(watch.laps)
        laps[TOTAL] = sum(value for name, value in watch.laps if name != DECODE)
        for name, value in laps.items():
            times.setdefault(name, []).append(value)
    return times


class _Watch:
    """Takes the time between two stages."""

    def __init__(self) -> None:
        self.laps: List[Tuple[str, float]] = []
        self._last = time.perf_counter()

    def lap(self, name: str, _: Any) -> None:
        now = time.perf_counter()
        self.laps.append((name, 1e3 * (now - self._last)))
        self._last = time.perf_counter()


def _figures(values: List[float]) -> Dict[str, float]:
    median, p95, p99 = np.percentile(values, [50, 95, 99])
    return {'median_ms': round(float(median), 4), 'p95_ms': round(float(p95), 4), 'p99_ms': round(float(p99), 4)}


def _print(figures: Dict[str, Dict[str, float]], threads: int, count: int) -> None:
    floor = figures[DECODE]['median_ms']
    print('\n%d thread%s, %d pictures, milliseconds' % (threads, '' if threads == 1 else 's', count))
    print('%-38s %8s %8s %8s %12s' % ('stage', 'median', 'p95', 'p99', 'x decoding'))
    for name, values in figures.items():
        row = (
            WORDS.get(name, name),
            values['median_ms'],
            values['p95_ms'],
            values['p99_ms'],
            values['median_ms'] / floor,
        )
        print('%-38s %8.3f %8.3f %8.3f %12.2f' % row)


def _rendered(calibration: Calibration) -> List[bytes]:
    """A robot drives towards a duckie, a cone in its lane and a duckie beyond the white line."""
    camera, (town, route) = Camera(calibration), straight_road()
    pictures = []
    for index in tool.progress(range(RENDERED), 'rendering'):
        things = (
            stands(route, 'duckie', 1.5 + 0.02 * index, 0.02, 0.05),
            stands(route, 'cone', 1.8, -0.08, 0.07),
            stands(route, 'duckie', 1.6, -0.25, 0.05),
        )
        scene, pose = Scene(town, things), pose_at(route, 1.0 + 0.01 * index, 0.01, 0.03)
        if not index:
            camera.settle(scene, pose)
        pictures.append(encode_jpeg(camera.take(scene, pose, index)))
    return pictures
