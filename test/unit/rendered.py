"""Pictures of the simulated town as a robot's camera takes them, and what they show."""

import functools
from typing import Any, Sequence, Tuple

import numpy as np

from obst_avoid.core.calibration import Calibration
from obst_avoid.core.settings import load, read_yaml
from obst_avoid.core.types import Array
from obst_avoid.sim.light import Light
from obst_avoid.sim.renderer import Renderer, Scene
from obst_avoid.sim.sensor import SensorSettings, developed, settled, signal_factors
from obst_avoid.sim.things import Thing
from obst_avoid.sim.town import Route, Town, follow, pose_at
from obst_avoid.sim.truth import Truth, truth_of
from unit.shipped import CONFIG
from unit.towns import shipped_town

WHITE = Light()
SAMPLES = 4
"""Per pixel of a thing's edge."""


class Camera:
    """Renderer and sensor; the exposure is what it settles to."""

    def __init__(self, calibration: Calibration) -> None:
        """Raises RenderError."""
        self._renderer = Renderer(calibration, SAMPLES)
        self._sensor = load(SensorSettings, read_yaml(str(CONFIG / 'simulation.yaml'))['sensor'], 'sensor')

    def take(
        self,
        things: Sequence[Thing] = (),
        along: float = 1.0,
        d: float = 0.0,
        phi: float = 0.0,
        light: Light = WHITE,
        road: Any = None,
        seed: int = 0,
    ) -> Tuple[Array, Truth]:
        """The picture, (H, W, 3) uint8 BGR, and what it shows.

        along, d, phi: [m], [m], [rad] where the robot is on its lane. road: town and route, else straight ahead.
        seed: of the noise and of the room.
        """
        town, route = road or straight()
        pose = pose_at(route, along, d, phi)
        scene = Scene(town, tuple(things), light, seed=seed)
        state = settled(functools.partial(self._renderer.render, scene, [pose]), self._sensor)
        picture = developed(self._renderer.render(scene, [pose], signal_factors(state, self._sensor)), state, seed)
        return picture, truth_of(self._renderer, scene, route, along, pose)

    def close(self) -> None:
        """Give back what the graphics side holds."""
        self._renderer.close()


@functools.lru_cache(maxsize=1)
def straight() -> Tuple[Town, Route]:
    """The shipped straight road and its lane that heads east."""
    town = shipped_town('straight')
    return town, follow(town, 0, 0, 'east')


def standing(sort: str, ahead: float, left: float, height: float = 0.06, yaw: float = 2.5, along: float = 1.0) -> Thing:
    """A thing on the straight road. ahead: [m] of a robot that is so far along. left: [m] of our lane's middle."""
    place = pose_at(straight()[1], along + ahead, left)
    return Thing(sort, place.x, place.y, place.heading + yaw, height)


def mirrored(things: Sequence[Thing], around: float) -> Tuple[Thing, ...]:
    """The same on the other side of the line y = around, [m] of the world."""
    return tuple(Thing(one.sort, one.x, 2 * around - one.y, -one.yaw, one.height) for one in things)


def brighter(picture: Array, factor: float) -> Array:
    """The picture with so many times the light, as a camera would encode it."""
    light = ((picture.astype(np.float64) + 1) / 256) ** 2.2 * factor
    return np.clip(np.rint(256 * light ** (1 / 2.2) - 1), 0, 255).astype(np.uint8)
