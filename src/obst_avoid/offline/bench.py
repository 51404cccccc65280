"""bench: where the time goes, stage by stage, beside the cost of decoding the picture."""

import argparse
import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from typing import Any, Dict, List, Tuple

import cv2
import numpy as np

from obst_avoid.core import detection
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust import native
from obst_avoid.core.picture import PictureError, decode_jpeg, encode_jpeg
from obst_avoid.offline import tool
from obst_avoid.offline.bench_graph import bench_graph
from obst_avoid.offline.bench_run_bag import bench_run_bag
from obst_avoid.offline.bench_simulation import bench_simulation
from obst_avoid.offline.measure import percentiles
from obst_avoid.offline.pictures import read_jpeg
from obst_avoid.offline.simulated_bag import Camera, stands, straight_road
from obst_avoid.offline.simulation import add_robot_arguments
from obst_avoid.sim.renderer import Scene
from obst_avoid.sim.town import pose_at

WARM_UP = 20
RENDERED = 20
"""Different rendered pictures; they are repeated to make up the number wanted."""
DECODE, TOTAL, DEPLOYED = 'decode', 'detector, without decoding', 'paper as deployed in 2018'
WORDS = {
    'corrected': 'colour correction, every pixel',
    'cropped': 'rectify and crop',
    'bird_view': 'warp to the bird view',
    'hsv': 'convert to HSV',
    'colors': 'yellow, orange, white',
    'blobs': 'label, regionprops, criteria',
    'tracked': 'tracker',
    'light': 'asphalt, the reference for light',
    'channels': 'reduce, colours, levels, sums',
    'regions': 'component trees',
    'promising': 'first look at all regions',
    'lines': 'lines of tape',
    'values': 'closer look at promising ones',
    'candidates': 'judgement, foot, size, kind',
    'lane': 'our lane',
}
LAST = {'paper': 'position, radius, search line, boxes', 'robust': 'sides, tracker, boxes'}
PROFILES = ('robust', 'paper')
BLOBS = (0, 3, 30, 100, 300)
WIDTHS = (320, 640, 960, 1280)
GAIN, OFFSET = (1.2, 1.1, 1.0), (-8.0, -4.0, 0.0)
"""Some colour correction; how it is applied takes the time, not which."""
COLD = """
import pickle, sys, time
times = [time.perf_counter()]
from obst_avoid.core import detection
from obst_avoid.core.picture import decode_jpeg
with open(sys.argv[1], 'rb') as file:
    calibration, settings, jpeg, count = pickle.load(file)
times.append(time.perf_counter())
detector = detection.start(calibration, settings)
times.append(time.perf_counter())
for index in range(count):
    _, detector = detection.detect(detector, decode_jpeg(jpeg), index * 33333333)
    if not index:
        times.append(time.perf_counter())
with open('/proc/self/status') as file:
    peak = next(int(line.split()[1]) for line in file if line.startswith('VmHWM:'))
print(*(b - a for a, b in zip(times, times[1:])), peak * 1024 / 1e6)
"""
"""What a new process runs: nothing but the detector. Its ru_maxrss would be at least that of the process before it."""


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='bench',
        description='Time each stage of the detectors beside JPEG decoding, the simulation, run_bag and the ROS graph.',
    )
    add_robot_arguments(parser)
    parser.add_argument('--soak', type=float, default=0.0, metavar='MIN', help='watch memory for so many minutes, too')
    parser.add_argument(
        '--graph-seconds', type=_seconds, default=60.0, metavar='S',
        help="time in the ROS graph, with the package's own settings; 0: none (default: 60)",
    )  # fmt: skip
    parser.add_argument('--count', type=tool.count, default=200, help='pictures that are timed (default: 200)')
    parser.add_argument('--output', metavar='FILE', help='write the figures there, as JSON')
    parser.add_argument('--compare', metavar='FILE', help='figures that an earlier version wrote with --output')
    parser.add_argument('paths', metavar='PATH', nargs='*', help='pictures or folders; without any, they are rendered')
    return tool.run(_main, parser, arguments)


def _seconds(value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = -1.0
    if not 0 <= number <= 86400:
        raise argparse.ArgumentTypeError('%s, expected 0 to 86400 (s)' % value)
    return number


def _main(options: argparse.Namespace) -> int:
    before = _earlier(options.compare) if options.compare else None
    if options.output:
        os.makedirs(os.path.dirname(os.path.abspath(options.output)), exist_ok=True)
        tool.writable(options.output)
    if options.paths:
        calibration = tool.calibration_of(options)
        pictures = [_sound(path) for path in tool.picture_files(options.paths)[: options.count]]
    else:
        calibration = tool.default_calibration()
        pictures = _rendered(calibration)
    result: Dict[str, Any] = {}
    try:
        _measure(options, calibration, pictures, result)
    finally:  # what was measured is kept, whatever fails after it
        if options.output and result:
            tool.write_json(options.output, result)
    if before is not None:
        _print_comparison(before, result)
    return 0


def _measure(
    options: argparse.Namespace, calibration: Calibration, pictures: List[bytes], result: Dict[str, Any]
) -> None:
    """Part by part into result, what is quick first."""
    settings = tool.detection_settings(options)
    detectors = {name: detection.start(calibration, replace(settings, profile=name)) for name in PROFILES}
    repeated = [pictures[i % len(pictures)] for i in range(WARM_UP + options.count)]
    result.update(pictures=options.count, opencv=cv2.__version__, compiled=native.LIBRARY is not None, threads={})
    if not result['compiled']:
        print('the compiled path of robust is not built: numpy does the work')
    for threads in sorted({1, cv2.getNumThreads()}):
        cv2.setNumThreads(threads)
        figures = result['threads'].setdefault(str(threads), {})
        for name, detector in detectors.items():
            figures[name] = _all_figures(_times(detector, repeated))
            _print('%s, %d thread%s' % (name, threads, 's'[: threads > 1]), figures[name], name, options.count)
        figures[DEPLOYED] = percentiles(_deployed(detectors['paper'], repeated)[WARM_UP:])
        _print_ratios(figures)
    cv2.setNumThreads(1)
    result['blobs'] = _by_blobs(detectors, pictures[0], options.count)
    result['sizes'] = _by_sizes(detectors['robust'], pictures[0], options.count)
    result['start'] = _cold(detectors['robust'], pictures[0], options.count)
    if not options.paths:
        result['simulation'] = bench_simulation(options)
    result['run_bag'] = bench_run_bag(options, pictures)
    if options.graph_seconds:
        result['graph'] = bench_graph(options, pictures)


def _sound(path: str) -> bytes:
    """A JPEG file that can be decoded. Raises ToolError."""
    jpeg = read_jpeg(path)
    try:
        decode_jpeg(jpeg)
    except PictureError as error:
        raise tool.ToolError('%s: %s' % (path, error)) from error
    return jpeg


def _earlier(path: str) -> Dict[str, Any]:
    try:
        with open(path, encoding='utf-8') as file:
            content = json.load(file)
        content['threads']['1']['robust'][DECODE]['median_ms']
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise tool.ToolError('--compare %s is no file that bench wrote with --output: %r' % (path, error)) from error
    return dict(content)


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


def _all_figures(times: Dict[str, List[float]]) -> Dict[str, Dict[str, float]]:
    return {name: percentiles(values[WARM_UP:]) for name, values in times.items()}


def _deployed(detector: detection.Detector, jpegs: List[bytes]) -> List[float]:
    """[ms] of the profile paper as deployed in 2018.

    Decoding; maps rebuilt for each picture; every pixel corrected by gains and offsets; the detector. The first two
    faults stand in the report's source, its own text names the third (ORIGINAL: it was switched off for its cost).
    """
    times = []
    settings = replace(detector.settings, paper=replace(detector.settings.paper, color_correction='none'))
    for index, jpeg in enumerate(tool.progress(jpegs, DEPLOYED)):
        begin = time.perf_counter()
        picture = decode_jpeg(jpeg)
        fresh = detection.start(detector.calibration, settings)
        corrected = np.clip(picture * np.array(GAIN) + np.array(OFFSET), 0, 255).astype(np.uint8)
        stamp = tool.stamp_of_frame(index, 30.0)
        _, detector = detection.detect(replace(fresh, state=detector.state, newest=detector.newest), corrected, stamp)
        times.append(1e3 * (time.perf_counter() - begin))
    return times


def _by_blobs(detectors: Dict[str, detection.Detector], jpeg: bytes, count: int) -> Dict[str, Dict[str, float]]:
    """[ms] median after decoding, by the number of yellow blobs on the road, of each profile."""
    road = decode_jpeg(jpeg)
    height, width = road.shape[:2]
    result: Dict[str, Dict[str, float]] = {}
    for blobs in BLOBS:
        picture, random = road.copy(), np.random.RandomState(blobs)
        for _ in range(blobs):
            u, v = random.randint(0, width), random.randint(height // 2, height)
            cv2.circle(picture, (u, v), max(3 * width // 640, 1), (30, 200, 230), -1)
        jpegs = [encode_jpeg(picture)] * (WARM_UP + count)
        for name, detector in detectors.items():
            total = _all_figures(_times(detector, jpegs))[TOTAL]['median_ms']
            result.setdefault(name, {})[str(blobs)] = total
    print('\nafter decoding, median ms, by blobs on the road: %s' % ', '.join('%d' % blobs for blobs in BLOBS))
    for name, values in result.items():
        few = values[str(BLOBS[1])]
        print('%-38s %s   %.2f x' % (name, ' '.join('%7.3f' % value for value in values.values()), values['300'] / few))
    return result


def _by_sizes(detector: detection.Detector, jpeg: bytes, count: int) -> Dict[str, Dict[str, float]]:
    """[ms] medians of decoding and of the rest, by the picture's size."""
    picture, result = decode_jpeg(jpeg), {}
    print('\nrobust, median ms, by size             decoding    after      x')
    for size in ((width, round(width * picture.shape[0] / picture.shape[1])) for width in WIDTHS):
        jpegs = [encode_jpeg(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))] * (WARM_UP + count)
        figures = _all_figures(_times(detector, jpegs))
        decode, total = figures[DECODE]['median_ms'], figures[TOTAL]['median_ms']
        result['%dx%d' % size] = {'decode_ms': decode, 'after_ms': total}
        print('%-38s %8.3f %8.3f %6.2f' % ('%d x %d' % size, decode, total, total / decode))
    return result


def _cold(detector: detection.Detector, jpeg: bytes, count: int) -> Dict[str, float]:
    """What a new process takes until its first answer, and its memory after all."""
    with tempfile.NamedTemporaryFile() as file:
        pickle.dump((detector.calibration, detector.settings, jpeg, count), file)
        file.flush()
        command = [sys.executable, '-c', COLD, file.name]
        ended = subprocess.run(command, stdout=subprocess.PIPE, check=True)
    names = 'imports_s', 'start_s', 'first_picture_s', 'memory_mb'
    figures = dict(zip(names, (round(float(word), 3) for word in ended.stdout.split())))
    print(
        '\na new process: %.2f s of imports, %.2f s until the detector stands, %.3f s for the first picture; %.0f MB'
        % tuple(figures.values())
    )
    return figures


def _print(title: str, figures: Dict[str, Dict[str, float]], profile: str, count: int) -> None:
    floor = figures[DECODE]['median_ms']
    print('\n%s, %d pictures, milliseconds' % (title, count))
    print('%-38s %8s %8s %8s %12s' % ('stage', 'median', 'p95', 'p99', 'x decoding'))
    for name, values in figures.items():
        words = LAST[profile] if name == 'obstacles' else WORDS.get(name, name)
        numbers = values['median_ms'], values['p95_ms'], values['p99_ms'], values['median_ms'] / floor
        print('%-38s %8.3f %8.3f %8.3f %12.2f' % (words, *numbers))


def _print_ratios(figures: Dict[str, Any]) -> None:
    robust, deployed = figures['robust'], figures[DEPLOYED]
    decode, total = robust[DECODE], robust[TOTAL]
    print('\nrobust after decoding / decoding: median %.2f, p99 %.2f' % (
        total['median_ms'] / decode['median_ms'], total['p99_ms'] / decode['p99_ms']))  # fmt: skip
    whole = decode['median_ms'] + total['median_ms']
    print('%s, %.1f ms / robust with decoding: %.2f' % (DEPLOYED, deployed['median_ms'], deployed['median_ms'] / whole))


def _print_comparison(before: Dict[str, Any], result: Dict[str, Any]) -> None:
    """Each stage in units of its own run's decoding, so that another machine's speed drops out."""
    print('\none thread, in units of decoding                before      now  ratio')
    for profile in PROFILES:
        old, new = (item['threads']['1'].get(profile, {}) for item in (before, result))
        for name in (name for name in new if name in old and name != DECODE):
            was, now = (item[name]['median_ms'] / item[DECODE]['median_ms'] for item in (old, new))
            print(
                '%-46s %7.3f  %7.3f  %5.2f' % (profile + ', ' + WORDS.get(name, name), was, now, now / max(was, 1e-9))
            )


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
