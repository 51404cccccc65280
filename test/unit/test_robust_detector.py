"""core.detection.robust: the simulation's pictures in, obstacles and our lane out, compared with the truth."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import math
from dataclasses import fields, replace
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration, scaled
from obst_avoid.core.detection import Detector, detect, start
from obst_avoid.core.detection.robust import native
from obst_avoid.core.detection.robust.detector import RobustState
from obst_avoid.core.detection.robust.features import NAMES, NO_LINE
from obst_avoid.core.detection.robust.lane import lane_of
from obst_avoid.core.detection.robust.light import FASTEST, estimate_light
from obst_avoid.core.detection.robust.lines import find_lines
from obst_avoid.core.detection.robust.view import WIDTH, working_picture
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.types import Box, Command, Obstacle, Scene, Stamped
from obst_avoid.sim.light import COLORS, Lamp, Light
from obst_avoid.sim.things import Thing
from obst_avoid.sim.town import follow
from obst_avoid.sim.truth import SeenObstacle, Truth
from unit import drawn
from unit.rendered import Camera, brighter, standing
from unit.scenes import picture_of
from unit.shipped import default_calibration, detection_settings
from unit.towns import shipped_town, town

MS = 1_000_000
PLACES = [(0.35, 0.0), (0.45, 0.05), (0.6, -0.06), (0.9, 0.02), (0.5, -0.3), (0.6, 0.4)]
"""[m] ahead of the robot and left of the lane's middle; the lane reaches 0.11 m to each side."""
AHEAD, ASIDE, RADIUS = 0.08, 0.02, 0.012
"""[of the distance], [m], [m] that place and radius may be off."""
LEAST_OVERLAP = 0.35
"""Intersection over union of the boxes: the foot of a cone is dark and a fifth wider than what is orange."""


def told(speed: float) -> List[Stamped[Command]]:
    """The robot's commands during all of a sequence."""
    return [Stamped(10**9 + 50 * number * MS, Command(speed, 0.0)) for number in range(-10, 100)]


STANDING = told(0.0)


@pytest.fixture(scope='module')
def detector() -> Detector:
    """The profile robust with the default camera; it has seen nothing."""
    return start(default_calibration(), replace(detection_settings(), profile='robust'))


@pytest.fixture(scope='module')
def camera() -> Iterator[Camera]:
    """The simulated default camera."""
    made = Camera(default_calibration())
    yield made
    made.close()


def overlap(one: Box, other: Box) -> float:
    """Intersection over union."""
    width = min(one.right, other.right) - max(one.left, other.left)
    height = min(one.bottom, other.bottom) - max(one.top, other.top)
    both = max(width, 0) * max(height, 0)
    areas = sum((box.right - box.left) * (box.bottom - box.top) for box in (one, other))
    return both / (areas - both)


def matches(found: Obstacle, true: SeenObstacle) -> None:
    """What was found is the thing that stands there."""
    distance = math.hypot(true.x, true.y)
    assert found.kind is true.kind
    assert found.x == pytest.approx(true.x, abs=AHEAD * distance)
    assert found.y == pytest.approx(true.y, abs=ASIDE)
    assert found.radius == pytest.approx(true.radius, abs=RADIUS)
    assert found.in_lane is true.in_lane
    assert found.confidence >= 0.5
    assert found.image_box is not None
    assert true.box is not None
    assert overlap(found.image_box, true.box) > LEAST_OVERLAP
    assert found.bird_box is not None


def same_things(scene: Scene, truth: Truth) -> None:
    """What was found is all that stands there, and nothing else."""
    seen = sorted(scene.obstacles, key=lambda one: one.y)
    true = sorted(truth.obstacles, key=lambda one: one.y)
    assert [one.kind for one in seen] == [one.kind for one in true]
    for here, there in zip(seen, true):
        matches(here, there)


def check(scene: Scene) -> None:
    """What holds for any picture at all."""
    for obstacle in scene.obstacles:
        for field in fields(obstacle):
            value = getattr(obstacle, field.name)
            assert not isinstance(value, float) or math.isfinite(value), field.name
        assert obstacle.x > 0
        assert obstacle.radius > 0
        assert 0 <= obstacle.confidence <= 1
        box = obstacle.image_box
        if box is not None:
            assert box.left < box.right
            assert box.top < box.bottom
    if scene.lane_pose is not None:
        pose = scene.lane_pose
        assert all(math.isfinite(value) for value in (pose.d, pose.phi, pose.curvature, *(pose.covariance or ())))


# One picture


@pytest.mark.parametrize('x, y', PLACES)
@pytest.mark.parametrize('sort', ['duckie', 'cone'])
def test_a_thing_is_found_where_it_stands(detector: Detector, camera: Camera, sort: str, x: float, y: float) -> None:
    picture, truth = camera.take((standing(sort, x, y),))
    scene, _ = detect(detector, picture, None)
    assert truth.obstacles[0].in_lane is (abs(y) < 0.2)
    same_things(scene, truth)
    check(scene)


@pytest.mark.parametrize('height', [0.04, 0.05, 0.08])
def test_small_and_large_ones_have_their_radius(detector: Detector, camera: Camera, height: float) -> None:
    things = (standing('duckie', 0.5, 0.06, height), standing('cone', 0.55, -0.05, height))
    picture, truth = camera.take(things)
    same_things(detect(detector, picture, None)[0], truth)


def test_several_things_are_all_found(detector: Detector, camera: Camera) -> None:
    things = (
        standing('duckie', 0.4, 0.05),
        standing('cone', 0.5, -0.08),
        standing('duckie', 0.6, -0.3, yaw=0.5),
        standing('cone', 0.8, 0.38),
    )
    picture, truth = camera.take(things, d=0.02, phi=0.05)
    same_things(detect(detector, picture, None)[0], truth)


@pytest.mark.parametrize(
    'along, d, phi, seed', [(0.5, -0.03, -0.3, 0), (0.9, 0.0, 0.0, 1), (1.3, 0.04, 0.2, 2), (1.7, 0.0, 0.3, 3)]
)
def test_on_an_empty_road_there_is_nothing(
    detector: Detector, camera: Camera, along: float, d: float, phi: float, seed: int
) -> None:
    """Neither dashes nor white lines, nor what stands around the town, are obstacles."""
    picture, _ = camera.take((), along, d, phi, seed=seed)
    scene, _ = detect(detector, picture, None)
    assert scene.obstacles == []
    assert scene.lane_pose is not None


def test_hardly_anything_on_an_empty_road_is_a_candidate(detector: Detector, camera: Camera) -> None:
    """Weak ones are for the tracker; each of them is a track for a while."""
    for seed in range(3):
        stages = traced(detector, camera.take((), 0.7 + 0.4 * seed, seed=seed)[0])
        assert len(stages['regions']) > 100
        assert len(stages['candidates']) <= 6


@pytest.mark.parametrize('along', [0.9, 1.2, 1.4, 1.6])
def test_stop_lines_are_no_obstacles(detector: Detector, camera: Camera, along: float) -> None:
    crossing = town('───┼──')
    route = follow(crossing, 0, 0, 'east', ['straight'])
    picture, _ = camera.take((), along, road=(crossing, route))
    assert (picture[..., 2].astype(int) > picture[..., 1] * 1.5 + 10)[100:].sum() > 500, 'a stop line is in the picture'
    assert detect(detector, picture, None)[0].obstacles == []


def test_a_drawn_stop_line_and_a_solid_line_are_no_obstacles(detector: Detector, camera: Camera) -> None:
    calibration = default_calibration()
    for ahead in (0.3, 0.5, 0.9):
        picture = drawn.draw(drawn.Scene((), stop_line=ahead), calibration, drawn.RobotPose())
        assert detect(detector, picture, None)[0].obstacles == []
    solid = shipped_town('solid')
    picture, _ = camera.take((), 1.0, road=(solid, follow(solid, 0, 0, 'east')))
    assert detect(detector, picture, None)[0].obstacles == []


@pytest.mark.parametrize('strength', [1.0, 0.1])
@pytest.mark.parametrize('color', sorted(COLORS))
def test_coloured_light_changes_nothing(detector: Detector, camera: Camera, color: str, strength: float) -> None:
    things = (standing('duckie', 0.5, 0.03), standing('cone', 0.6, -0.25))
    picture, truth = camera.take(things, light=Light(color=COLORS[color], strength=strength))
    same_things(detect(detector, picture, None)[0], truth)


def test_one_hard_lamp_with_its_shadows_changes_nothing(detector: Detector, camera: Camera) -> None:
    light = Light(lamps=(Lamp(2.0, 0.7, 0.85, size=0.03),), glare=0.3)
    picture, truth = camera.take((standing('duckie', 0.5, 0.03), standing('cone', 0.6, -0.25)), light=light)
    same_things(detect(detector, picture, None)[0], truth)


@pytest.mark.parametrize('d, phi', [(0.0, 0.0), (0.05, -0.1), (-0.05, 0.2)])
def test_the_lane_pose_is_our_own_estimate(detector: Detector, camera: Camera, d: float, phi: float) -> None:
    picture, truth = camera.take((standing('duckie', 0.5, 0.03),), d=d, phi=phi)
    pose = detect(detector, picture, None)[0].lane_pose
    assert pose is not None
    assert (pose.d, pose.phi) == (pytest.approx(d, abs=0.015), pytest.approx(phi, abs=0.05))
    assert (truth.lane_pose.d, truth.lane_pose.phi) == pytest.approx((d, phi), abs=1e-3)
    assert pose.covariance is not None


def test_without_a_line_the_side_is_unknown(detector: Detector, camera: Camera) -> None:
    """Asphalt everywhere but for the duckie."""
    picture, truth = camera.take((standing('duckie', 0.5, 0.0),))
    box = truth.obstacles[0].box
    assert box is not None
    alone = np.full_like(picture, 60)
    inside = slice(int(box.top), int(box.bottom)), slice(int(box.left), int(box.right))
    alone[inside] = picture[inside]
    scene, _ = detect(detector, alone, None)
    assert scene.lane_pose is None
    assert [one.in_lane for one in scene.obstacles] == [None]


# Any picture


@pytest.mark.parametrize('value', [0, 1, 128, 254, 255])
def test_a_flat_picture_shows_nothing(detector: Detector, value: int) -> None:
    picture = np.full((480, 640, 3), value, np.uint8)
    for stamp in (None, 0):
        assert detect(detector, picture, stamp)[0] == Scene([], None)


@pytest.mark.parametrize('color', [(0, 255, 255), (0, 128, 255), (255, 0, 0), (0, 0, 255)])
def test_a_picture_of_one_colour_shows_nothing(detector: Detector, color: Tuple[int, int, int]) -> None:
    assert detect(detector, np.full((480, 640, 3), color, np.uint8), None)[0].obstacles == []


@pytest.mark.parametrize('size', [(4, 3), (8, 6), (32, 24), (320, 240), (1280, 960)], ids='%dx%d'.__mod__)
def test_noise_of_any_size_gives_finite_numbers(detector: Detector, size: Tuple[int, int]) -> None:
    random = np.random.RandomState(size[0])
    noise = random.randint(0, 256, (size[1], size[0], 3)).astype(np.uint8)
    blotches = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), max(size[0] / 60, 1.0)), None, 0, 255, cv2.NORM_MINMAX)
    sheer = replace(detector.settings, robust=replace(detector.settings.robust, confidence=1e-6, weak_confidence=1e-6))
    trusting = replace(detector, settings=sheer)
    count = 0
    for picture in (noise, blotches, (blotches // 30).astype(np.uint8), np.maximum(blotches, 200)):
        scene, _ = detect(trusting, picture, None)
        check(scene)
        count += len(scene.obstacles)
        check(detect(trusting, picture, 5 * MS)[0])
    assert count > 0 or size[0] < 100


@pytest.mark.parametrize('size', [(320, 240), (800, 600), (1280, 960)], ids='%dx%d'.__mod__)
def test_a_picture_of_another_size_shows_the_same(detector: Detector, camera: Camera, size: Tuple[int, int]) -> None:
    picture, truth = camera.take((standing('duckie', 0.45, 0.05), standing('cone', 0.6, -0.05)))
    resized = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if size[0] < 640 else cv2.INTER_LINEAR)
    scene, after = detect(detector, resized, None)
    assert after.camera is not None
    assert after.camera.scale == size[0] / WIDTH
    factor = 640 / size[0]
    boxes = [one.image_box for one in scene.obstacles]
    scaled = [
        replace(one, image_box=Box(*(factor * value for value in (box.left, box.top, box.right, box.bottom))))
        for one, box in zip(scene.obstacles, boxes)
        if box is not None
    ]
    same_things(replace(scene, obstacles=scaled), truth)


STAGES = [
    'light', 'channels', 'regions', 'promising', 'lines', 'values', 'candidates', 'lane', 'obstacles',
]  # fmt: skip


def traced(detector: Detector, picture: Any, stamp: Optional[int] = None) -> Dict[str, Any]:
    """What each stage gives, by its name."""
    stages: Dict[str, Any] = {}
    detect(detector, picture, stamp, trace=stages.__setitem__)
    return stages


def test_the_stages_are_traced_in_order(detector: Detector, camera: Camera) -> None:
    picture, _ = camera.take((standing('duckie', 0.45, 0.05),))
    names: List[str] = []
    for stamp in (None, 0):
        scene, _ = detect(detector, picture, stamp, trace=lambda name, _: names.append(name))
        assert traced(detector, picture, stamp)['obstacles'] == scene.obstacles
    assert names == 2 * STAGES


def test_each_stage_is_of_the_same_picture(detector: Detector, camera: Camera) -> None:
    picture, _ = camera.take((standing('duckie', 0.45, 0.05), standing('cone', 0.6, -0.25)))
    stages, view = traced(detector, picture), detector.camera
    assert view is not None
    assert stages['light'] == estimate_light(picture)
    small, channels = stages['channels']
    np.testing.assert_array_equal(small, working_picture(picture, view))
    assert channels.heights.shape[1:] == (view.height - view.top, view.width)
    lines = find_lines(picture, view.sampling, stages['light'].as_array())
    numbers = [[(line.a, line.b, line.c, line.brightness) for line in some] for some in (stages['lines'], lines)]
    assert numbers[0] == numbers[1]
    assert len(lines) >= 2
    assert stages['lane'].pose == lane_of(lines).pose == detect(detector, picture, None)[0].lane_pose


def test_only_promising_regions_are_measured_whole(detector: Detector, camera: Camera) -> None:
    """Most of them are not, and candidates are some of them."""
    picture, _ = camera.take((standing('duckie', 0.45, 0.05), standing('cone', 0.6, -0.25)))
    weak = replace(detector.settings.robust, confidence=1e-6, weak_confidence=1e-6)
    trusting = replace(detector, settings=replace(detector.settings, robust=weak))
    stages = traced(trusting, picture)
    regions, promising, values = stages['regions'], stages['promising'], stages['values']
    assert 0 < len(promising) < len(regions) / 2
    assert (np.diff(promising) > 0).all()
    assert 0 <= promising[0] and promising[-1] < len(regions)
    assert values.shape == (len(promising), len(NAMES))
    box = regions.box[promising]
    np.testing.assert_array_equal(values[:, NAMES.index('pixels_across')], box[:, 2])
    np.testing.assert_array_equal(values[:, NAMES.index('pixels_up')], box[:, 3])
    assert stages['candidates']
    for one in stages['candidates']:
        left, top, width, height = trusting.camera.scale * box[one.row]
        assert one.box == Box(*map(pytest.approx, (left, top, left + width, top + height)))


def test_regions_are_measured_against_the_lines_of_the_same_picture(detector: Detector, camera: Camera) -> None:
    stages = traced(detector, camera.take((standing('duckie', 0.45, 0.05),))[0])
    width, blue = (stages['values'][:, NAMES.index(name)] for name in ('line_width', 'line_blue'))
    shown = np.float32([(line.width, line.blueness) for line in stages['lines']])
    assert set(zip(width, blue)) <= {tuple(one) for one in shown} | {(NO_LINE, NO_LINE)}
    assert len(set(width) - {NO_LINE}) >= 2


def test_without_the_compiled_path_the_same_is_found(
    detector: Detector, camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    if native.LIBRARY is None:
        pytest.skip('the compiled path is not built')
    pictures = [camera.take((standing('duckie', 0.45, 0.05), standing('cone', 0.6, -0.25)), d=0.02, phi=0.05)[0]]
    pictures += [brighter(pictures[0], 0.2), camera.take((), 1.3, 0.04, 0.2)[0]]
    weak = replace(detector.settings.robust, confidence=1e-3, weak_confidence=1e-3)
    trusting = replace(detector, settings=replace(detector.settings, robust=weak))
    compiled = [traced(trusting, picture) for picture in pictures]
    monkeypatch.setattr(native, 'LIBRARY', None)
    count = 0
    for picture, wanted in zip(pictures, compiled):
        found = traced(trusting, picture)
        assert len(found['regions']) == len(wanted['regions'])
        boxes = [sorted(map(tuple, stages['regions'].box[stages['promising']])) for stages in (found, wanted)]
        assert boxes[0] == boxes[1]
        assert len(found['obstacles']) == len(wanted['obstacles'])
        for one, other in zip(found['obstacles'], wanted['obstacles']):
            assert (one.kind, one.in_lane, one.image_box) == (other.kind, other.in_lane, other.image_box)
            numbers = [(each.x, each.y, each.radius, each.confidence) for each in (one, other)]
            assert numbers[0] == pytest.approx(numbers[1], abs=1e-3)
        poses = [(stages['lane'].pose.d, stages['lane'].pose.phi) for stages in (found, wanted)]
        assert poses[0] == pytest.approx(poses[1], abs=1e-4)
        count += len(wanted['obstacles'])
    assert count > 2


def test_the_surest_comes_first(detector: Detector, camera: Camera) -> None:
    things = (standing('duckie', 0.4, 0.05), standing('cone', 0.5, -0.08), standing('cone', 0.8, 0.38))
    scene, _ = detect(detector, camera.take(things)[0], None)
    sure = [one.confidence for one in scene.obstacles]
    assert sure == sorted(sure, reverse=True)


def test_a_higher_limit_reports_less(detector: Detector, camera: Camera) -> None:
    picture, _ = camera.take((standing('duckie', 0.4, 0.05), standing('cone', 0.5, -0.08)))
    everything = detect(detector, picture, None)[0].obstacles
    between = np.mean(sorted(one.confidence for one in everything))
    strict = replace(detector.settings, robust=replace(detector.settings.robust, confidence=float(between)))
    some = detect(replace(detector, settings=strict), picture, None)[0].obstacles
    assert some == [one for one in everything if one.confidence >= between]
    assert 0 < len(some) < len(everything)


# Pictures one after the other


def run(
    detector: Detector,
    pictures: Sequence[Any],
    step: float,
    commands: Sequence[Stamped[Command]] = (),
    begin: int = 10**9,
) -> Tuple[List[Scene], Detector]:
    """What a sequence shows, a picture each step, [s]."""
    scenes = []
    for number, picture in enumerate(pictures):
        scene, detector = detect(detector, picture, begin + round(number * step * 1000) * MS, commands)
        scenes.append(scene)
    return scenes, detector


@pytest.fixture(scope='module')
def seen(camera: Camera) -> Tuple[List[Any], Truth]:
    """Seven pictures of the same things by a robot that stands, each with its own noise."""
    things = (standing('duckie', 0.5, 0.03), standing('cone', 0.6, -0.25))
    taken = [camera.take(things, seed=number) for number in range(7)]
    return [picture for picture, _ in taken], taken[0][1]


@pytest.mark.parametrize('rate', [10, 15, 30])
def test_a_sequence_confirms_within_a_fifth_of_a_second_but_not_at_once(
    detector: Detector, seen: Tuple[List[Any], Truth], rate: int
) -> None:
    pictures, truth = seen
    scenes, _ = run(detector, pictures, 1 / rate, STANDING)
    counts = [len(scene.obstacles) for scene in scenes]
    assert counts[0] == 0
    assert set(counts[max(1, round(0.2 * rate)) :]) == {2}, counts
    same_things(scenes[-1], truth)


def test_pictures_that_stand_alone_do_not_know_each_other(
    detector: Detector, camera: Camera, seen: Tuple[List[Any], Truth]
) -> None:
    pictures, _ = seen
    others = [camera.take((standing('cone', 0.5, 0.05),))[0], brighter(pictures[0], 0.3), camera.take()[0]]
    every = [pictures[0], *others]
    each = [detect(detector, picture, None)[0] for picture in every]
    assert [len(scene.obstacles) for scene in each] == [2, 1, 2, 0]
    _, warm = run(detector, pictures, 0.1)
    for order in ([0, 1, 2, 3], [3, 2, 1, 0], [2, 2, 0, 0, 1]):
        now = warm
        for index in order:
            scene, now = detect(now, every[index], None)
            assert scene == each[index]
        assert now.state == RobustState()


def test_a_sequence_begins_anew_with_an_older_picture(detector: Detector, seen: Tuple[List[Any], Truth]) -> None:
    pictures, _ = seen
    first, now = run(detector, pictures[:4], 0.1)
    again, _ = run(now, pictures[:4], 0.1, begin=5 * 10**8)
    assert [len(scene.obstacles) for scene in again] == [len(scene.obstacles) for scene in first]
    assert again == first


def test_a_sequence_begins_anew_after_a_gap(detector: Detector, seen: Tuple[List[Any], Truth]) -> None:
    pictures, _ = seen
    gap = detector.settings.robust.tracking.longest_gap
    scenes, now = run(detector, pictures[:4], 0.1)
    assert len(scenes[-1].obstacles) == 2
    scene, _ = detect(now, pictures[4], 10**9 + round((0.3 + gap + 0.1) * 1000) * MS)
    assert scene.obstacles == []


def test_a_drive_on_an_empty_road_shows_nothing(detector: Detector, camera: Camera) -> None:
    pictures = [camera.take((), 0.6 + 0.02 * number, phi=0.1 - 0.01 * number, seed=number)[0] for number in range(20)]
    for commands in (told(0.2), []):
        scenes, _ = run(detector, pictures, 0.1, commands)
        assert [scene.obstacles for scene in scenes] == [[]] * 20


def test_what_is_taken_away_is_not_reported_any_more(
    detector: Detector, camera: Camera, seen: Tuple[List[Any], Truth]
) -> None:
    empty = camera.take()[0]
    pictures = [*seen[0][:4], *[empty] * 12]
    scenes, _ = run(detector, pictures, 0.1, STANDING)
    counts = [len(scene.obstacles) for scene in scenes]
    assert counts[3] == 2
    assert counts[-1] == 0
    assert counts == sorted(counts[:4]) + sorted(counts[4:], reverse=True)


def test_what_drops_out_below_the_picture_is_remembered_by_the_robots_motion(
    detector: Detector, camera: Camera
) -> None:
    speed, step = 0.2, 0.1
    thing = standing('duckie', 0.45, 0.0, along=1.0)
    pictures = [camera.take((thing,), along=1.0 + speed * step * number, seed=number)[0] for number in range(20)]
    last, truth = camera.take((thing,), along=1.0 + speed * step * 19)
    assert truth.obstacles[0].box is None, 'it is out of sight'
    scenes, _ = run(detector, pictures, step, told(speed))
    (found,) = scenes[-1].obstacles
    assert found.image_box is None
    assert found.bird_box is not None
    assert found.x == pytest.approx(truth.obstacles[0].x, abs=0.04)
    assert found.y == pytest.approx(truth.obstacles[0].y, abs=0.02)


def test_a_jump_of_the_light_is_followed_slowly(detector: Detector, seen: Tuple[List[Any], Truth]) -> None:
    picture = seen[0][0]
    _, now = detect(detector, picture, 0)
    before = now.state.light.value.as_array()
    _, now = detect(now, brighter(picture, 0.1), 100 * MS)
    after = now.state.light.value.as_array()
    np.testing.assert_allclose(after / before, FASTEST**-0.1, rtol=1e-6)
    assert now.state.light.stamp == 100 * MS
    _, alone = detect(detector, brighter(picture, 0.1), 100 * MS)
    np.testing.assert_allclose(alone.state.light.value.as_array() / before, 0.1, rtol=0.15)


def test_the_detector_given_is_left_alone(detector: Detector, seen: Tuple[List[Any], Truth]) -> None:
    pictures, _ = seen
    _, now = run(detector, pictures[:2], 0.1)
    tracks, before = list(now.state.tracks), replace(now)
    for _ in range(2):
        detect(now, pictures[2], 10**9 + 200 * MS)
    assert now == before
    assert list(now.state.tracks) == tracks


def test_the_same_pictures_give_the_same_answers(detector: Detector, seen: Tuple[List[Any], Truth]) -> None:
    pictures, _ = seen
    assert run(detector, pictures, 0.1)[0] == run(detector, pictures, 0.1)[0]


def test_a_picture_is_not_written_to(detector: Detector) -> None:
    picture = picture_of(default_calibration())
    assert not picture.flags.writeable
    copy = picture.copy()
    detect(detector, picture, 0)
    assert (picture == copy).all()


def test_other_cameras_see_the_same_things(calibration: Calibration, detection_settings: DetectionSettings) -> None:
    """320x240 from the lens on, not a picture made smaller."""
    small = scaled(calibration, 320, 240)
    camera = Camera(small)
    try:
        things: Tuple[Thing, ...] = (standing('duckie', 0.45, 0.05), standing('cone', 0.5, -0.08))
        picture, truth = camera.take(things)
    finally:
        camera.close()
    assert picture.shape == (240, 320, 3)
    same_things(detect(start(small, detection_settings), picture, None)[0], truth)
