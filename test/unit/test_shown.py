"""core.avoidance.shown: the plan where the picture shows the road, not where the robot will be."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import math
from dataclasses import replace
from typing import Tuple

import numpy as np
import pytest

from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.avoidance.known import footprint_centre
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.avoidance.shown import view_in_picture
from obst_avoid.core.geometry import lane_from_robot
from obst_avoid.core.types import Command, Decision, LanePose, Obstacle, Stamped, State

TAKEN = 1_700_000_000_000_000_000
DECIDED = TAKEN + 80_000_000
SURE = (1e-8, 0.0, 0.0, 1e-8)
OBSTACLE = Obstacle(None, 0.55, 0.03, 0.025, True)


def shown(
    pose: LanePose, command: Command, settings: AvoidanceSettings
) -> Tuple[np.ndarray, np.ndarray, Tuple[float, float, float]]:
    """What a decision on a picture taken at a pose shows: region and way in the lane as bent as it is believed to be,
    along and left of its centre; what decides.
    """
    commands = tuple(Stamped(TAKEN + late * 10_000_000, command) for late in range(-40, 9))
    told = Stamped(TAKEN, pose)
    inputs = Inputs(Stamped(TAKEN, [OBSTACLE]), told, told, commands)
    decision, _ = decide(inputs, Memory(), DECIDED, settings)
    view = view_in_picture(decision, commands, DECIDED, TAKEN, settings)
    assert view is not None and view.deciding is not None
    seen = replace(pose, curvature=decision.numbers['curvature [1/m]'])
    region, way = (np.array([lane_from_robot(x, y, seen) for x, y in points]) for points in (view.region, view.way))
    return region, way, view.deciding


@pytest.mark.parametrize('bend', [0.0, 0.8])
@pytest.mark.parametrize('omega', [0.0, -1.5, 1.5])
def test_the_corridor_follows_the_lane_that_the_picture_shows(
    bend: float, omega: float, avoidance_settings: AvoidanceSettings
) -> None:
    pose = LanePose(0.02, 0.1, bend, SURE)
    region, way, deciding = shown(pose, Command(0.2, omega), avoidance_settings)
    half = avoidance_settings.robot_width / 2 + avoidance_settings.margin + avoidance_settings.yaw_margin * abs(omega)
    assert np.abs(region[:, 1]) == pytest.approx(half, abs=0.004)
    driven = 0.2 * (0.08 + avoidance_settings.lane_estimate.command_delay)
    assert region[:, 0].min() == pytest.approx(driven, abs=0.005), 'from where the robot will be'
    assert way[0] == pytest.approx((driven, pose.d + driven * math.sin(pose.phi)), abs=0.03)
    assert deciding == pytest.approx((*footprint_centre(OBSTACLE), OBSTACLE.radius), abs=0.004)


def test_a_decision_that_knows_no_lane_shows_nothing(avoidance_settings: AvoidanceSettings) -> None:
    decision = Decision(State.FAULT, 0.0, 0.0, 'stopping: no lane pose yet')
    assert view_in_picture(decision, (), DECIDED, TAKEN, avoidance_settings) is None


def test_where_nobody_says_how_the_robot_moves_it_is_not_moved(avoidance_settings: AvoidanceSettings) -> None:
    told = Stamped(TAKEN, LanePose(0.0, 0.0, 0.0, SURE))
    decision, _ = decide(Inputs(Stamped(TAKEN, []), told, told), Memory(), DECIDED, avoidance_settings)
    view = view_in_picture(decision, (), DECIDED, TAKEN, avoidance_settings)
    assert view is not None
    assert view.region[:, 0].min() == pytest.approx(0.0, abs=1e-6)
    assert view.deciding is None
