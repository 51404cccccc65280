"""core.detection.robust: what holds for any drawn scene."""

import math
from dataclasses import replace
from typing import List

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from unit.cameras import Camera, calibration_of
from unit.drawn import RobotPose, Scene, Thing, draw, robot_from_world
from unit.rendered import brighter
from unit.shipped import detection_settings

from obst_avoid.core.detection import detect, start
from obst_avoid.core.types import Array, Kind, Obstacle
from property.strategies import numbers

EXAMPLES = 15
"""A picture takes a fifth of a second to draw and to look at."""
CALIBRATION = calibration_of(Camera())
"""Without roll, yaw or offset: a mirrored picture of it is a picture of the mirrored road."""
DETECTOR = start(CALIBRATION, detection_settings())
SURE, HALF_SURE = 0.9, 0.3
"""What has the one confidence in a picture has at least the other in the same picture changed."""

things = st.builds(
    Thing,
    kind=st.sampled_from(list(Kind)),
    x=numbers(0.35, 0.9),
    y=numbers(-0.25, 0.25),
    height=numbers(0.045, 0.07),
)
scenes = st.builds(Scene, st.tuples(things, things) | st.tuples(things))
poses = st.builds(RobotPose, y=numbers(-0.04, 0.04), heading=numbers(-0.2, 0.2))


def seen(picture: Array, least: float) -> List[Obstacle]:
    """What is in a picture that stands alone, with at least such a confidence."""
    robust = replace(DETECTOR.settings.robust, confidence=least)
    detector = replace(DETECTOR, settings=replace(DETECTOR.settings, robust=robust))
    return list(detect(detector, picture, None)[0].obstacles)


def is_there(one: Obstacle, others: List[Obstacle], side: int = 1) -> bool:
    """Whether something stands in the same place, with side -1 in the mirrored one."""
    reach = 0.08 * math.hypot(one.x, one.y)
    return any(
        abs(other.x - one.x) < reach
        and abs(side * other.y - one.y) < 0.03
        and abs(other.radius - one.radius) < 0.012
        and other.kind is one.kind
        for other in others
    )


def agree(one: Array, other: Array, side: int = 1) -> None:
    """What is sure in one picture is there in the other."""
    for here, there in ((one, other), (other, one)):
        found = seen(there, HALF_SURE)
        for obstacle in seen(here, SURE):
            assert is_there(obstacle, found, side), (obstacle, found)


@settings(max_examples=EXAMPLES)
@given(scenes, poses)
def test_a_mirrored_picture_shows_mirrored_things(scene: Scene, pose: RobotPose) -> None:
    picture = draw(scene, CALIBRATION, pose)
    agree(picture, np.ascontiguousarray(picture[:, ::-1]), -1)


@settings(max_examples=EXAMPLES)
@given(scenes, poses, numbers(0.2, 1.1))
def test_the_lights_strength_changes_nothing(scene: Scene, pose: RobotPose, factor: float) -> None:
    picture = draw(scene, CALIBRATION, pose)
    agree(picture, brighter(picture, factor))


@settings(max_examples=EXAMPLES)
@given(scenes, poses)
def test_things_that_are_found_are_where_things_stand(scene: Scene, pose: RobotPose) -> None:
    """Nothing sure is elsewhere, and nothing is found twice."""
    found = seen(draw(scene, CALIBRATION, pose), SURE)
    assert len(found) <= len(scene.things)
    for one in found:
        distances = []
        for thing in scene.things:
            x, y = robot_from_world(thing.x, thing.y, pose)
            distances.append(math.hypot(x - one.x, y - one.y) - thing.radius)
        assert min(distances) < 0.05 + 0.08 * math.hypot(one.x, one.y)


@settings(max_examples=EXAMPLES)
@given(poses, st.integers(0, 1000))
def test_an_empty_road_is_empty(pose: RobotPose, seed: int) -> None:
    assert seen(draw(Scene(), CALIBRATION, pose, seed), 0.5) == []


@settings(max_examples=EXAMPLES)
@given(st.integers(0, 10**6), st.sampled_from([4, 12, 40]), numbers(0.01, 1.0))
def test_any_picture_gives_finite_numbers(seed: int, size: int, share: float) -> None:
    """Blotches of any size and darkness."""
    coarse = np.random.RandomState(seed).uniform(0, 255 * share, (3 * size, 4 * size, 3)).astype(np.uint8)
    picture = cv2.resize(coarse, (CALIBRATION.width, CALIBRATION.height), interpolation=cv2.INTER_CUBIC)
    scene, detector = detect(DETECTOR, picture, 0)
    assert scene.obstacles == []
    for one in [*seen(picture, 0.06), *(item.last for item in detector.state.tracks)]:
        assert np.isfinite([one.x, one.y, one.radius, one.confidence]).all()
        assert one.radius > 0
        assert 0 < one.x <= DETECTOR.settings.robust.farthest
