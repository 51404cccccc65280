"""core.detection.robust: what holds for any drawn scene."""

import math
from dataclasses import replace
from typing import List, Tuple
from unittest import mock

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from unit.cameras import Camera, calibration_of
from unit.drawn import RobotPose, Scene, Thing, draw, robot_from_world
from unit.rendered import brighter
from unit.shipped import detection_settings

from obst_avoid.core.detection import detect, start
from obst_avoid.core.detection.robust import native
from obst_avoid.core.types import Array, Kind, Obstacle
from property.strategies import numbers

EXAMPLES = 15
"""A picture takes a fifth of a second to draw and to look at."""
CALIBRATION = calibration_of(Camera())
"""Without roll, yaw or offset: a mirrored picture of it is a picture of the mirrored road."""
DETECTOR = start(CALIBRATION, detection_settings())
SURE, HALF_SURE = 0.9, 0.3
"""What has the one confidence in a picture has at least the other in the same picture changed."""
FOUND = 0.6
"""Of all things, hidden ones included, so many are sure; else it means little that those which are found are right."""
TOLD = 0.7
"""[m] Farther away a small cone has 10 rows of the working picture, and may pass for a duckie."""

things = st.builds(
    Thing,
    kind=st.sampled_from(list(Kind)),
    x=numbers(0.35, 0.9),
    y=numbers(-0.25, 0.25),
    height=numbers(0.045, 0.07),
)


def apart(two: Tuple[Thing, Thing]) -> bool:
    """Neither stands in the other: what such a thing is nobody can say."""
    one, other = two
    return math.hypot(one.x - other.x, one.y - other.y) > one.radius + other.radius


scenes = st.builds(Scene, st.tuples(things, things).filter(apart) | st.tuples(things))
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
        and (other.kind is one.kind or one.x > TOLD)
        for other in others
    )


def agree(one: Array, other: Array, side: int = 1) -> float:
    """What is sure in one picture is there in the other. Returns how many are sure, on the average."""
    count = 0
    for here, there in ((one, other), (other, one)):
        found = seen(there, HALF_SURE)
        for obstacle in seen(here, SURE):
            assert is_there(obstacle, found, side), (obstacle, found)
            count += 1
    return count / 2


def most_are_found(counts: List[Tuple[float, int]]) -> None:
    """counts: of each scene, how many were sure and how many stand there."""
    assert len(counts) >= EXAMPLES
    found, there = np.sum(counts, axis=0)
    assert found >= FOUND * there, (found, there)


def test_a_mirrored_picture_shows_mirrored_things() -> None:
    counts: List[Tuple[float, int]] = []

    @settings(max_examples=EXAMPLES)
    @given(scenes, poses)
    def holds(scene: Scene, pose: RobotPose) -> None:
        picture = draw(scene, CALIBRATION, pose)
        counts.append((agree(picture, np.ascontiguousarray(picture[:, ::-1]), -1), len(scene.things)))

    holds()
    most_are_found(counts)


def test_the_lights_strength_changes_nothing() -> None:
    counts: List[Tuple[float, int]] = []

    @settings(max_examples=EXAMPLES)
    @given(scenes, poses, numbers(0.2, 1.1))
    def holds(scene: Scene, pose: RobotPose, factor: float) -> None:
        picture = draw(scene, CALIBRATION, pose)
        counts.append((agree(picture, brighter(picture, factor)), len(scene.things)))

    holds()
    most_are_found(counts)


def test_things_that_are_found_are_where_things_stand() -> None:
    """Nothing sure is elsewhere, and nothing is found twice."""
    counts: List[Tuple[float, int]] = []

    @settings(max_examples=EXAMPLES)
    @given(scenes, poses)
    def holds(scene: Scene, pose: RobotPose) -> None:
        found = seen(draw(scene, CALIBRATION, pose), SURE)
        assert len(found) <= len(scene.things)
        for one in found:
            distances = []
            for thing in scene.things:
                x, y = robot_from_world(thing.x, thing.y, pose)
                distances.append(math.hypot(x - one.x, y - one.y) - thing.radius)
            assert min(distances) < 0.05 + 0.08 * math.hypot(one.x, one.y)
        counts.append((len(found), len(scene.things)))

    holds()
    most_are_found(counts)


@settings(max_examples=EXAMPLES)
@given(poses, st.integers(0, 1000))
def test_an_empty_road_is_empty(pose: RobotPose, seed: int) -> None:
    assert seen(draw(Scene(), CALIBRATION, pose, seed), 0.5) == []


def blotches(seed: int, size: int, share: float) -> Array:
    """Of any size and darkness."""
    coarse = np.random.RandomState(seed).uniform(0, 255 * share, (3 * size, 4 * size, 3)).astype(np.uint8)
    return cv2.resize(coarse, (CALIBRATION.width, CALIBRATION.height), interpolation=cv2.INTER_CUBIC)


pictures = st.builds(draw, scenes, st.just(CALIBRATION), poses) | st.builds(
    blotches, st.integers(0, 10**6), st.sampled_from([4, 12, 40]), numbers(0.01, 1.0)
)


@pytest.mark.skipif(native.LIBRARY is None, reason='the compiled path is not built')
@settings(max_examples=EXAMPLES)
@given(pictures)
def test_without_the_compiled_path_the_same_is_seen(picture: Array) -> None:
    compiled = seen(picture, 0.06)
    with mock.patch.object(native, 'LIBRARY', None):
        slowly = seen(picture, 0.06)
    assert [(one.kind, one.image_box) for one in slowly] == [(one.kind, one.image_box) for one in compiled]
    for one, other in zip(slowly, compiled):
        numbers_of = [(each.x, each.y, each.radius, each.confidence) for each in (one, other)]
        assert numbers_of[0] == pytest.approx(numbers_of[1], abs=1e-3)


@settings(max_examples=EXAMPLES)
@given(st.integers(0, 10**6), st.sampled_from([4, 12, 40]), numbers(0.01, 1.0))
def test_any_picture_gives_finite_numbers(seed: int, size: int, share: float) -> None:
    picture = blotches(seed, size, share)
    scene, detector = detect(DETECTOR, picture, 0)
    assert scene.obstacles == []
    for one in [*seen(picture, 0.06), *(item.last for item in detector.state.tracks)]:
        assert np.isfinite([one.x, one.y, one.radius, one.confidence]).all()
        assert one.radius > 0
        assert 0 < one.x <= DETECTOR.settings.robust.farthest
