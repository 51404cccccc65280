"""A simulated drive along the straight road, as a bag: what the rostests play.

The robot drives towards a duckie in its lane, stands before it, the duckie goes away, the robot drives on and meets
a small duckie at the side with room to pass. A cone stands beyond the white line all the time.
"""

import argparse
import functools
import math
import os
from dataclasses import dataclass
from typing import Any, Dict, Iterator, Tuple

import rosbag

from obst_avoid.core.age import NANOSECONDS
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.picture import encode_jpeg
from obst_avoid.core.settings import load
from obst_avoid.core.types import Array, LanePose
from obst_avoid.msg import LanePose as LanePoseMsg
from obst_avoid.offline import tool
from obst_avoid.ros import border
from obst_avoid.sim.backdrop import Surfaces
from obst_avoid.sim.light import Lamp, Light
from obst_avoid.sim.renderer import Renderer, RenderError, Scene
from obst_avoid.sim.sensor import SensorSettings, SensorState, adapted, developed, mean_signal, settled, signal_factors
from obst_avoid.sim.things import Thing
from obst_avoid.sim.town import Route, Town, WorldPose, follow, pose_at, town_from_mapping

RATE = 30.0
DURATION = 9.3
PICTURES = int(DURATION * RATE)
SPEED = 0.2
VEHICLE = 'simulated'
BEGIN = 0.6
"""[m] along the lane from the road's western end."""
STANDS, DUCKIE_GONE, DRIVES_ON = 2.35, 3.35, 6.1
"""[s] into the drive. No motion is recorded, so the duckie is remembered for 2 s and the stop for 1 s more: it ends
soon after DRIVES_ON, a second before the next duckie counts.
"""
LIGHT = Light(lamps=(Lamp(azimuth=math.pi, elevation=0.5, share=0.3, size=0.5),))
"""White and bright, a large window behind the robot: a shaded foot is too dark for the report's yellow."""
SURFACES = Surfaces(yellow=(0.52, 0.325, 0.023))
"""Dull old tape in the middle: the report's algorithm takes bright dashes, where they flow together far away, for
duckies.
"""


@dataclass(frozen=True)
class Drive:
    """The road and what stands on it.

    blocking: in the lane, goes away. beside: in the lane, with room to pass. outside: beyond the white line.
    """

    town: Town
    route: Route
    blocking: Thing
    beside: Thing
    outside: Thing

    def at(self, seconds: float) -> Tuple[Scene, WorldPose]:
        """What there is to see, and from where, so many seconds into the drive."""
        driven = min(seconds, STANDS) + max(0.0, seconds - DRIVES_ON)
        gone = () if seconds >= DUCKIE_GONE else (self.blocking,)
        scene = Scene(self.town, (*gone, self.beside, self.outside), LIGHT, SURFACES)
        return scene, pose_at(self.route, BEGIN + SPEED * driven)


class Camera:
    """Renderer and sensor together. Its exposure follows what it sees."""

    def __init__(self, calibration: Calibration) -> None:
        """Raises ToolError where there is no OpenGL."""
        try:
            self._renderer = Renderer(calibration)
        except RenderError as error:
            raise tool.ToolError(str(error)) from error
        content = tool.node_yaml('', 'simulation.yaml')
        self._settings = load(SensorSettings, content.get('sensor'), 'simulation.yaml/sensor')
        self._state = SensorState(self._settings.shortest_exposure, 1.0)

    def settle(self, scene: Scene, pose: WorldPose) -> None:
        """Look at a scene until the exposure changes no more."""
        self._state = settled(functools.partial(self._renderer.render, scene, [pose]), self._settings)

    def take(self, scene: Scene, pose: WorldPose, seed: int) -> Array:
        """The next picture, (H, W, 3) uint8 BGR. seed: of its noise."""
        state = self._state
        encoded = self._renderer.render(scene, [pose], signal_factors(state, self._settings))
        self._state = adapted(state, mean_signal(encoded), 1 / RATE, self._settings)
        return developed(encoded, state, seed)


def straight_road() -> Tuple[Town, Route]:
    """The straight road, and its lane that heads east."""
    town = town_from_mapping(tool.node_yaml('', 'towns/straight.yaml'), 'towns/straight.yaml')
    return town, follow(town, 0, 0, 'east')


def stands(route: Route, sort: str, along: float, d: float, height: float) -> Thing:
    """A thing that looks across the road to the left. along, d: [m] as in pose_at. height: [m]."""
    place = pose_at(route, along, d, math.pi / 2)
    return Thing(sort, place.x, place.y, place.heading, height)


def scripted() -> Drive:
    """The drive's road and things."""
    town, route = straight_road()
    return Drive(
        town,
        route,
        blocking=stands(route, 'duckie', BEGIN + 0.9, 0.0, 0.05),
        beside=stands(route, 'duckie', BEGIN + 1.4, -0.088, 0.03),
        outside=stands(route, 'cone', BEGIN + 1.1, -0.24, 0.05),
    )


def frames(calibration: Calibration) -> Iterator[Tuple[int, bytes]]:
    """The whole drive: stamp [ns] and JPEG of each picture."""
    camera, drive = Camera(calibration), scripted()
    camera.settle(*drive.at(0.0))
    for index in tool.progress(range(PICTURES), 'rendering'):
        scene, pose = drive.at(index / RATE)
        yield tool.stamp_of_frame(index, RATE), encode_jpeg(camera.take(scene, pose, index))


def write(path: str) -> None:
    """Render the drive into a bag."""
    calibration = tool.default_calibration()
    os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
    with tool.whole(path) as part, rosbag.Bag(part, 'w') as bag:
        for stamp, jpeg in frames(calibration):
            for topic, msg in _messages(stamp, jpeg, calibration).items():
                bag.write('/%s/%s' % (VEHICLE, topic), msg, border.ros_time(stamp + NANOSECONDS // 1000))


def _messages(stamp: int, jpeg: bytes, calibration: Calibration) -> Dict[str, Any]:
    image = border.compressed_image_from_jpeg(jpeg, stamp, border.camera_frame(VEHICLE))
    info = border.camera_info_from_calibration(calibration, stamp, border.camera_frame(VEHICLE))
    return {
        'lane_filter_node/lane_pose': border.msg_from_lane_pose(LanePose(0.0, 0.0), stamp, LanePoseMsg),
        'camera_node/camera_info': info,
        'camera_node/image/compressed': image,
    }


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog='simulated_bag', description='Render the bag that the tests play.')
    parser.add_argument('output', metavar='BAG', help='bag to write')
    return tool.run(lambda options: write(options.output) or 0, parser, arguments)
