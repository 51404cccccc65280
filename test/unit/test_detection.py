"""core.detection: the one entrance, whatever the profile."""

from dataclasses import replace
from typing import Any, List, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.core.calibration import Calibration, CalibrationError
from obst_avoid.core.detection import Detector, detect, start, tuned
from obst_avoid.core.detection.settings import PROFILES, DetectionSettings
from obst_avoid.core.types import Command, Obstacle, Scene, Stamped
from unit.cameras import Camera, calibration_of
from unit.scenes import cone, duckie, picture_of

MS = 1_000_000


@pytest.fixture(params=PROFILES)
def settings(request: Any, detection_settings: DetectionSettings) -> DetectionSettings:
    """As shipped, of each profile."""
    return replace(detection_settings, profile=request.param)


@pytest.fixture
def detector(calibration: Calibration, settings: DetectionSettings) -> Detector:
    """It has seen nothing yet."""
    return start(calibration, settings)


def test_the_default_is_robust(detection_settings: DetectionSettings) -> None:
    assert detection_settings.profile == 'robust'


def by_distance(scene: Scene) -> List[Obstacle]:
    """What was found, the nearest first: the profiles have orders of their own."""
    return sorted(scene.obstacles, key=lambda one: one.x)


def kinds_of(scene: Scene) -> List[str]:
    """What was found, in the order of the alphabet."""
    return sorted(one.kind.value for one in scene.obstacles if one.kind is not None)


def test_a_camera_that_sees_no_road_cannot_start(settings: DetectionSettings) -> None:
    with pytest.raises(CalibrationError, match='homography has the horizon at row'):
        start(calibration_of(Camera(pitch=-29.0)), settings)


def test_nothing_is_an_empty_list(detector: Detector, calibration: Calibration) -> None:
    assert detect(detector, picture_of(calibration), None)[0].obstacles == []
    assert detect(detector, picture_of(calibration), 0)[0].obstacles == []


@pytest.mark.parametrize('size', [(320, 240), (800, 600), (1280, 960)], ids='%dx%d'.__mod__)
def test_a_picture_of_another_size_gives_the_same_answer(
    detector: Detector, calibration: Calibration, size: Tuple[int, int]
) -> None:
    picture = picture_of(calibration, (duckie(0.4, 0.02), cone(0.6, -0.05)))
    resized = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if size[0] < 640 else cv2.INTER_LINEAR)
    (plain, _), (found, after) = detect(detector, picture, None), detect(detector, resized, None)
    assert kinds_of(found) == kinds_of(plain) == ['cone', 'duckie']
    assert (after.view.calibration.width, after.view.calibration.height) == size
    factor = size[0] / 640
    for here, there in zip(by_distance(plain), by_distance(found)):
        assert (there.x, there.y, there.radius) == pytest.approx((here.x, here.y, here.radius), abs=0.015)
        assert here.image_box is not None and there.image_box is not None
        for name in ('left', 'right', 'bottom'):
            expected = factor * getattr(here.image_box, name)
            assert getattr(there.image_box, name) == pytest.approx(expected, abs=0.006 * size[0]), name


def test_the_view_is_kept_while_the_size_stays(detector: Detector, calibration: Calibration) -> None:
    _, after = detect(detector, picture_of(calibration), None)
    assert after.view is detector.view
    small = np.zeros((240, 320, 3), np.uint8)
    _, after = detect(after, small, None)
    assert after.view is not detector.view
    assert detect(after, small, None)[1].view is after.view


@pytest.mark.parametrize('size', [(640, 360), (480, 640), (640, 640)], ids='%dx%d'.__mod__)
def test_a_picture_of_another_aspect_is_refused(detector: Detector, size: Tuple[int, int]) -> None:
    with pytest.raises(CalibrationError) as refused:
        detect(detector, np.zeros((size[1], size[0], 3), np.uint8), None)
    assert str(refused.value).startswith('the picture is %dx%d, expected the aspect of 640x480 as in ' % size)


def test_pictures_that_stand_alone_do_not_know_each_other(detector: Detector, calibration: Calibration) -> None:
    things = [(duckie(0.5, 0.0),), (), (cone(0.5, 0.05), duckie(0.6, -0.04)), (duckie(0.5, 0.01),)]
    pictures = [picture_of(calibration, some) for some in things]
    pictures.append(np.rint(pictures[0] * 0.5).astype(np.uint8))  # another light: a kept correction would show
    each = [detect(detector, picture, None)[0] for picture in pictures]
    assert [len(found.obstacles) for found in each] == [1, 0, 2, 1, 1]
    for order in ([0, 1, 2, 3, 4], [4, 3, 2, 1, 0], [0, 0, 3, 3, 4, 2]):
        now, answers = detector, []  # type: Tuple[Detector, List[Scene]]
        for i in order:
            found, now = detect(now, pictures[i], None)
            answers.append(found)
        assert answers == [each[i] for i in order]


def test_a_sequence_confirms_and_an_older_picture_forgets(detector: Detector, calibration: Calibration) -> None:
    picture = picture_of(calibration, (duckie(0.6, 0.0),))
    counts, now = [], detector
    for stamp in (500, 600, 100, 200):
        found, now = detect(now, picture, stamp * MS)
        counts.append(len(found.obstacles))
    assert counts == [0, 1, 0, 1]


def test_the_detector_given_is_left_alone(detector: Detector, calibration: Calibration) -> None:
    picture = picture_of(calibration, (duckie(0.6, 0.0),))
    before = replace(detector)
    for _ in range(3):
        assert detect(detector, picture, 0)[0].obstacles == []
    assert detector == before


def test_the_profile_paper_takes_no_notice_of_the_robots_motion(
    calibration: Calibration, detection_settings: DetectionSettings
) -> None:
    detector = start(calibration, replace(detection_settings, profile='paper'))
    commands = (Stamped(-100 * MS, Command(0.4, 3.0)),)
    for told in ((), commands):
        now = detector
        for stamp in (0, 100, 200):
            scene, now = detect(now, picture_of(calibration, (duckie(0.6, 0.0),)), stamp * MS, told)
        assert len(scene.obstacles) == 1
        assert scene.lane_pose is None


def test_other_settings_take_effect_and_nothing_seen_is_lost(
    calibration: Calibration, detection_settings: DetectionSettings
) -> None:
    picture = picture_of(calibration, (duckie(0.5, 0.0),))
    detector = start(calibration, detection_settings)
    for number in range(8):
        scene, detector = detect(detector, picture, number * 33 * MS)
    assert kinds_of(scene) == ['duckie']
    view = detector.view
    detector = tuned(detector, replace(detection_settings, robust=replace(detection_settings.robust, confidence=0.5)))
    assert detector.view is view, 'not made anew for nothing: that takes longer than a picture'
    bird_view = replace(detection_settings.bird_view, crop_distance=1.2)
    detector = tuned(detector, replace(detection_settings, bird_view=bird_view))
    assert detector.view.x_top == pytest.approx(1.2, abs=0.05)
    scene, detector = detect(detector, picture, 8 * 33 * MS)
    assert kinds_of(scene) == ['duckie'], 'a track goes on'
    paper = replace(detection_settings, profile='paper')
    detector = tuned(detector, paper)
    scene, detector = detect(detector, picture, 9 * 33 * MS)
    assert kinds_of(scene) == [], 'another profile has seen one picture only'
    assert detector.settings is paper


def test_settings_that_fit_no_camera_are_refused(settings: DetectionSettings) -> None:
    detector = start(calibration_of(Camera(pitch=5.0)), settings)
    with pytest.raises(CalibrationError, match='homography has the horizon at row'):
        tuned(detector, replace(settings, bird_view=replace(settings.bird_view, horizon_margin=0.49)))
