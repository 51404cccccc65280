"""viz.film: one picture of a film."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from obst_avoid.core.avoidance.corridor import view_of
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.bird_view import BirdView
from obst_avoid.core.types import Box, Decision, LanePose, Obstacle, State
from obst_avoid.viz.film import Map, Shot, compose

CAMERA, BIRD, WORDS, MAP = np.s_[:480, :640], np.s_[:161, 640:], np.s_[480:, :640], np.s_[170:, 640:]
"""Parts of the film's picture."""


@pytest.fixture
def shot() -> Shot:
    """A grey road."""
    decision = Decision(State.AVOIDING, 0.03, 0.1, 'avoiding: 1 obstacle in the lane at 0.50 m, passing at +0.030 m')
    return Shot(1.2, np.full((480, 640, 3), 90, dtype=np.uint8), [], decision, 0.1, (0.5, 0.5, 0.0))


def composed(shot: Shot, view: BirdView) -> Any:
    """With a town of one grey tile."""
    town = Map(np.full((90, 90, 3), 60, dtype=np.uint8), 90.0)
    return compose(shot, view, town, [(0.4, 0.5), (0.5, 0.5)], 'a title')


def test_the_plan_is_drawn_on_the_picture_and_on_the_bird_view(
    shot: Shot, view: BirdView, avoidance_settings: AvoidanceSettings
) -> None:
    decision = replace(shot.decision, obstacle=Obstacle(None, 0.5, -0.08, 0.02, True))
    plan = view_of(decision, LanePose(0.0, 0.0), avoidance_settings)
    without, shown = composed(shot, view), composed(replace(shot, plan=plan), view)
    assert without.shape == shown.shape == (640, 1120, 3)
    for part, least in ((CAMERA, 50000), (BIRD, 500)):
        assert (shown[part] != without[part]).any(axis=2).sum() > least
    for part in (WORDS, MAP):
        assert (shown[part] == without[part]).all()


def test_boxes_lie_over_the_plan(shot: Shot, view: BirdView, avoidance_settings: AvoidanceSettings) -> None:
    seen = Obstacle(None, 0.4, 0.0, 0.03, True, bird_box=Box(300, 150, 340, 180), image_box=Box(300, 200, 340, 240))
    plan = view_of(shot.decision, LanePose(0.0, 0.0), avoidance_settings)
    drawn = composed(replace(shot, obstacles=[seen], plan=plan), view)
    plain = composed(replace(shot, obstacles=[seen]), view)
    box = np.s_[200:240, 300:302]
    assert (drawn[box] == plain[box]).all()
    assert (plain[box] != 90).any()


def test_the_plan_has_the_colour_of_the_state(
    shot: Shot, view: BirdView, avoidance_settings: AvoidanceSettings
) -> None:
    plan = view_of(shot.decision, LanePose(0.0, 0.0), avoidance_settings)
    drawn = [composed(replace(shot, plan=plan, decision=replace(shot.decision, state=state)), view) for state in State]
    assert len({tuple(picture[300, 400].tolist()) for picture in drawn}) == len(State)
