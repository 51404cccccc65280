"""bench's second part: pictures a second of the renderer, episodes a minute, memory over a long run."""

import argparse
import os
import time
from dataclasses import replace
from typing import Any, Callable, Dict, List, Tuple

import numpy as np

from obst_avoid.core.picture import decode_jpeg
from obst_avoid.offline import tool
from obst_avoid.offline.measure import resident
from obst_avoid.offline.simulation import robot_of, simulation_settings, towns_folder
from obst_avoid.sim import world as worlds
from obst_avoid.sim.episode import run
from obst_avoid.sim.renderer import Renderer, RenderError
from obst_avoid.sim.scenario import Scenario, load_scenario
from obst_avoid.sim.sensor import developed, signal_factors
from obst_avoid.sim.town import WorldPose

WARM_UP, COUNT, EPISODES = 10, 100, 3


def bench_simulation(options: argparse.Namespace) -> Dict[str, Any]:
    """Time the simulation; prints a table and returns its figures. options: of bench, with soak [min]."""
    calibration, robot = robot_of(options)
    settings = simulation_settings(options.config)
    try:
        renderer = Renderer(calibration)
    except RenderError as error:
        raise tool.ToolError(str(error)) from error
    result = _pictures(renderer, _scenario(options, 'demo.yaml', 1), settings)
    print("\nsimulation, %d pictures of the demo's first view, milliseconds" % COUNT)
    for name, values in result.items():
        print('%-38s %8.3f %8s %8s %12.2f' % (
            name, values['median_ms'], '', '', values['median_ms'] / result['decode']['median_ms']))  # fmt: skip
    rendering = result['render, without blur']['median_ms'] + result['sensor']['median_ms']
    print('%-38s %8.1f' % ('pictures a second, without blur', 1e3 / rendering))
    begin = time.perf_counter()
    seconds = 0.0
    for seed in tool.progress(range(1, EPISODES + 1), 'episodes'):
        scenario = _scenario(options, 'scenarios/blocking_straight.yaml', seed)
        seconds += run(scenario, robot, replace(settings, picture_rate=10.0), renderer).seconds
    wall = time.perf_counter() - begin
    print('%-38s %8.1f   (%d of blocking_straight, 10 pictures a second, one process, %.1f simulated s a second)' % (
        'episodes a minute', 60 * EPISODES / wall, EPISODES, seconds / wall))  # fmt: skip
    figures: Dict[str, Any] = {'stages': result, 'episodes_per_minute': round(60 * EPISODES / wall, 2)}
    if options.soak:
        figures['memory_mb'] = _soak(options, robot, settings, renderer)
    return figures


def _pictures(renderer: Renderer, scenario: Scenario, settings: Any) -> Dict[str, Dict[str, float]]:
    place, world = worlds.begin(scenario, settings)
    shown, world = worlds.picture(world, place, renderer)
    scene, pose = worlds.scene_of(world, place), world.vehicle.pose
    factors = signal_factors(world.sensor, settings.sensor)
    turned = WorldPose(pose.x, pose.y, pose.heading + 10 / renderer.focal_length)
    encoded = renderer.render(scene, [pose], factors)
    jpeg = worlds.jpeg(shown, place)
    return {
        'decode': _timed(lambda index: decode_jpeg(jpeg)),
        'render, without blur': _timed(lambda index: renderer.render(scene, [pose], factors)),
        'render, 10 px of blur': _timed(lambda index: renderer.render(scene, [pose, turned], factors)),
        'sensor': _timed(lambda index: developed(encoded, world.sensor, index)),
        'encode': _timed(lambda index: worlds.jpeg(shown, place)),
    }


def _timed(work: Callable[[int], Any]) -> Dict[str, float]:
    times: List[float] = []
    for index in range(WARM_UP + COUNT):
        begin = time.perf_counter()
        work(index)
        times.append(1e3 * (time.perf_counter() - begin))
    return {'median_ms': round(float(np.median(times[WARM_UP:])), 3)}


def _soak(options: argparse.Namespace, robot: Any, settings: Any, renderer: Renderer) -> List[Tuple[float, float]]:
    """Drive for so many minutes of wall time; (minute, resident memory in MB) about ten times on the way."""
    begin, seed = time.monotonic(), 0
    readings: List[Tuple[float, float]] = []
    while time.monotonic() - begin < 60 * options.soak:
        seed += 1
        scenario = _scenario(options, 'scenarios/%s.yaml' % ('empty_road' if seed % 2 else 'curve_left'), seed)
        run(scenario, robot, replace(settings, picture_rate=10.0), renderer)
        minute = (time.monotonic() - begin) / 60
        if not readings or minute - readings[-1][0] >= options.soak / 10 or minute >= options.soak:
            readings.append((round(minute, 2), round(resident(), 1)))
            print('%-38s %8.1f   (minute %.1f, %d episodes)' % ('resident memory, MB', resident(), minute, seed))
    return readings


def _scenario(options: argparse.Namespace, name: str, seed: int) -> Scenario:
    folder = options.config or os.path.join(tool.package_folder(), 'config')
    return load_scenario(os.path.join(folder, name), seed, towns_folder(options.config))
