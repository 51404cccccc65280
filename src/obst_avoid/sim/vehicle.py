"""A differential-drive robot: it does what it is told a little late, a little wrongly, and it has a body."""

import math
from dataclasses import dataclass, replace
from typing import Tuple

import numpy as np
from shapely.geometry import Polygon

from obst_avoid.core.motion import chord
from obst_avoid.core.settings import number
from obst_avoid.core.types import Command
from obst_avoid.sim.town import WorldPose, world_from_robot

CRUISING = 0.2
"""[m/s] at which turn_noise is meant; it grows with the speed."""
STILL = 0.005
"""[m/s] below which the robot counts as standing."""


@dataclass(frozen=True)
class VehicleSettings:
    """config/simulation.yaml has values, units and reasons."""

    ahead: float = number('m', above=0)
    behind: float = number('m', above=0)
    width: float = number('m', above=0)
    command_delay: float = number('s', at_least=0)
    speed_lag: float = number('s', above=0)
    turn_lag: float = number('s', above=0)
    trim: float = number('1/m', at_least=0)
    speed_noise: float = number('ratio', at_least=0)
    turn_noise: float = number('rad/s', at_least=0)
    noise_time: float = number('s', above=0)


@dataclass(frozen=True)
class Vehicle:
    """The robot's state. v, omega: as it moves. commands: (time [s] of its effect, command), oldest first.

    trim: [1/m] of this robot. speed_error: ratio, turn_error: [rad/s] at CRUISING speed; both wander.
    """

    pose: WorldPose
    v: float = 0.0
    omega: float = 0.0
    commands: Tuple[Tuple[float, Command], ...] = ((0.0, Command(0.0, 0.0)),)
    trim: float = 0.0
    speed_error: float = 0.0
    turn_error: float = 0.0


def told(vehicle: Vehicle, command: Command, now: float, settings: VehicleSettings) -> Vehicle:
    """The robot after it has heard a command at `now` s."""
    return replace(vehicle, commands=vehicle.commands + ((now + settings.command_delay, command),))


def moved(
    vehicle: Vehicle, now: float, dt: float, settings: VehicleSettings, random: 'np.random.RandomState'
) -> Vehicle:
    """The robot dt s after `now` s. The path within dt is an arc."""
    due = [index for index, (time, _) in enumerate(vehicle.commands) if time <= now + 1e-9]
    commands = vehicle.commands[due[-1] :] if due else vehicle.commands
    wanted = commands[0][1] if due else Command(0.0, 0.0)
    keep = math.exp(-dt / settings.noise_time)
    share = math.sqrt(1 - keep * keep)
    one, other = random.standard_normal(2)
    speed_error = keep * vehicle.speed_error + share * settings.speed_noise * one
    turn_error = keep * vehicle.turn_error + share * settings.turn_noise * other
    v_goal = wanted.v * (1 + speed_error)
    omega_goal = wanted.omega + vehicle.v * (vehicle.trim + turn_error / CRUISING)
    v = vehicle.v + (v_goal - vehicle.v) * (1 - math.exp(-dt / settings.speed_lag))
    omega = vehicle.omega + (omega_goal - vehicle.omega) * (1 - math.exp(-dt / settings.turn_lag))
    pose = driven(vehicle.pose, v, omega, dt)
    return replace(
        vehicle, pose=pose, v=v, omega=omega, commands=commands, speed_error=speed_error, turn_error=turn_error
    )


def driven(pose: WorldPose, v: float, omega: float, dt: float) -> WorldPose:
    """Where an arc of constant speed and turn rate leads in dt s, which may be negative."""
    heading = pose.heading + omega * dt
    middle = (pose.heading + heading) / 2
    length = chord(v, omega, dt)
    return WorldPose(pose.x + length * math.cos(middle), pose.y + length * math.sin(middle), heading)


def body(pose: WorldPose, settings: VehicleSettings) -> Polygon:
    """The robot's footprint in the world."""
    half = settings.width / 2
    corners = np.array(
        [[settings.ahead, half], [-settings.behind, half], [-settings.behind, -half], [settings.ahead, -half]]
    )
    return Polygon(world_from_robot(corners, pose))
