"""What the tools of the simulation share: their settings, the robot in them, and films of drives."""

import argparse
import os
from typing import Iterator, List, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core import detection
from obst_avoid.core.avoidance.settings import STAGES
from obst_avoid.core.avoidance.shown import view_in_picture
from obst_avoid.core.bird_view import BirdView
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.motion import remembered
from obst_avoid.core.picture import decode_jpeg
from obst_avoid.core.settings import load
from obst_avoid.core.types import Array, Command, Stamped
from obst_avoid.offline import tool
from obst_avoid.sim import world as worlds
from obst_avoid.sim.episode import Frame, Robot
from obst_avoid.sim.paint import ASPHALT, PIXELS, RED, WHITE, YELLOW, ground_picture
from obst_avoid.sim.scenario import Scenario, place
from obst_avoid.sim.settings import SimulationSettings
from obst_avoid.sim.town import Town
from obst_avoid.sim.truth import obstacles_of
from obst_avoid.viz.film import SIZE, Map, Shot, compose, shrunk_map

MAP_COLORS = {WHITE: (235, 235, 235), YELLOW: (40, 200, 240), RED: (40, 40, 200)}
"""BGR."""


def add_robot_arguments(parser: argparse.ArgumentParser) -> None:
    """Calibration, profile and stage, the same in every tool that drives."""
    tool.add_calibration_arguments(parser)
    parser.add_argument('--stage', choices=STAGES, help='of commissioning, instead of the one that the settings name')


def calibration_of(options: argparse.Namespace) -> Calibration:
    """The camera that the options name; without any, the package's own made-up one, which is right here."""
    if options.calibration or options.vehicle:
        return tool.calibration_of(options)
    return tool.default_calibration()


def robot_of(options: argparse.Namespace) -> Tuple[Calibration, Robot]:
    """The robot's programs as the options and the settings say."""
    calibration = calibration_of(options)
    robot = Robot(
        detection.start(calibration, tool.detection_settings(options)),
        tool.avoidance_settings(options.config, options.stage),
        tool.lane_control_settings(options.config),
    )
    return calibration, robot


def simulation_settings(config: str) -> SimulationSettings:
    """config/simulation.yaml, of the given folder or the package's own."""
    return load(SimulationSettings, tool.node_yaml(config, 'simulation.yaml'), 'simulation.yaml')


def towns_folder(config: str) -> str:
    """Where the maps lie."""
    return os.path.join(config or os.path.join(tool.package_folder(), 'config'), 'towns')


def map_of(town: Town) -> Map:
    """The town from above, for films."""
    ground = cv2.resize(ground_picture(town, 0), None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    picture = ground[..., ASPHALT : ASPHALT + 1].astype(np.float32) * 0.35 * np.ones(3, dtype=np.float32)
    for channel, color in MAP_COLORS.items():
        share = ground[..., channel : channel + 1] / np.float32(255)
        picture += share * (np.array(color, dtype=np.float32) - picture)
    return shrunk_map(picture.astype(np.uint8), PIXELS / 4 / town.tile_size)


def film_of(
    frames: Sequence[Frame], scenario: Scenario, robot: Robot, view: BirdView, delay: float, title: str, every: int
) -> Iterator[Array]:
    """The pictures of a film of an episode, one of so many frames. delay: [s] of a picture's answer."""
    town = map_of(scenario.town)
    path: List[Tuple[float, float]] = []
    commands: Tuple[Stamped[Command], ...] = ()
    for index, frame in enumerate(frames):
        pose, decided = frame.world.vehicle.pose, worlds.stamp(frame.time)
        path.append((pose.x, pose.y))
        commands = remembered(commands, Stamped(decided, frame.command))
        if index % every and index != len(frames) - 1:
            continue
        pairs = zip(scenario.obstacles, frame.world.actors)
        placed = [place(item, scenario, actor.left) for item, actor in pairs if actor.here]
        things = [thing for thing in placed if thing.kind is not None]  # as obstacles_of
        found = obstacles_of(things, scenario.town, scenario.route, frame.world.along, pose)
        standing = [(thing.x, thing.y, obstacle.in_lane) for thing, obstacle in zip(things, found)]
        plan = view_in_picture(frame.decision, commands, decided, worlds.stamp(frame.time - delay), robot.avoidance)
        shot = Shot(
            frame.time, decode_jpeg(frame.jpeg), frame.obstacles, frame.decision, frame.command.v,
            (pose.x, pose.y, pose.heading), standing, plan,
        )  # fmt: skip
        yield compose(shot, view, town, path, title)


def write_film(path: str, pictures: Iterator[Array], rate: float) -> None:
    """Write an MP4, H.264 where OpenCV has it, else MPEG-4. Raises ToolError when it cannot be written."""
    level = os.environ.get('OPENCV_FFMPEG_LOGLEVEL')
    os.environ['OPENCV_FFMPEG_LOGLEVEL'] = '-8'
    try:
        writer = next(
            (writer for writer in (cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*code), rate, SIZE)
                                   for code in ('avc1', 'mp4v')) if writer.isOpened()), None,
        )  # fmt: skip
    finally:
        if level is None:
            del os.environ['OPENCV_FFMPEG_LOGLEVEL']
    if writer is None:
        raise tool.ToolError('%s cannot be written, expected OpenCV with FFmpeg' % path)
    for picture in pictures:
        writer.write(picture)
    writer.release()
