"""Tilt and height of a camera from lane lines: drawn and made-up lines with known errors, and what is said of them."""

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any, List, Sequence, Tuple

import cv2
import numpy as np
import pytest
from unit import drawn
from unit.cameras import ROBOT, Camera, calibration_of, load_camera, write_files

from obst_avoid.core.calibration import (
    camera_position,
    camera_roll,
    extrinsic_content,
    load_calibration,
)
from obst_avoid.core.geometry import pixel_from_ground
from obst_avoid.offline.calibration.fit import (
    Correction,
    corrected_homography,
    fit,
    lane_coordinate,
    yaw_from_motion,
)
from obst_avoid.offline.calibration.judge import BAD, GOOD, OFF, UNCLEAR, camera_pitch, camera_yaw, examine, judge
from obst_avoid.offline.calibration.paint import Line, Tape, find_lines, rows_of

FILE = Camera()
"""What the file says; the true camera differs."""
POSES = ((0.0, 0.02, -0.12), (0.1, -0.03, 0.1), (0.2, 0.0, 0.03), (0.3, 0.03, 0.17), (0.4, -0.02, -0.05))
"""Along the lane [m], left of its centre [m], heading [rad]."""
ERRORS = [
    ('none', FILE),
    ('roll', replace(FILE, roll=3.0)),
    ('roll the other way', replace(FILE, roll=-2.5)),
    ('looks further down', replace(FILE, pitch=24.0)),
    ('looks less far down', replace(FILE, pitch=17.0)),
    ('higher', replace(FILE, height=0.125)),
    ('lower', replace(FILE, height=0.092)),
    ('all of it', replace(FILE, roll=-2.0, pitch=23.0, height=0.098)),
]


def made_lines(camera: Camera, poses: Sequence[Tuple[float, float, float]], noise: float) -> List[List[Line]]:
    """The lines of a straight lane as a camera sees them, edge by edge, with noise [px] on each point."""
    calibration, random = calibration_of(camera), np.random.RandomState(5)
    half = drawn.LANE_WIDTH / 2
    pictures = []
    for along, left, heading in poses:
        pose = drawn.RobotPose(along, left, heading)
        lines = []
        for tape, high, low in (
            (Tape.YELLOW, half + drawn.YELLOW_WIDTH, half),
            (Tape.WHITE, -half, -half - drawn.WHITE_WIDTH),
        ):
            edges = []
            for y in (high, low):
                x = along + np.linspace(0.2, 0.9, 60)
                ground = np.column_stack(drawn.robot_from_world(x, np.full(60, y), pose))
                pixels = pixel_from_ground(calibration.homography, ground)
                edges.append(pixels + np.column_stack([random.normal(0, noise, 60), np.zeros(60)]))
            lines.append(Line(tape, *edges))
        pictures.append(lines)
    return pictures


def drawn_pictures(camera: Camera, poses: Sequence[Tuple[float, float, float]] = POSES[:3]) -> List[Any]:
    """Pictures of a straight lane by that camera."""
    calibration = calibration_of(camera)
    return [drawn.draw(drawn.Scene(), calibration, drawn.RobotPose(*pose), seed) for seed, pose in enumerate(poses)]


def off_by(camera: Camera, correction: Correction) -> Tuple[float, float, float]:
    """[deg], [deg], ratio: by how much a correction of FILE misses the true camera."""
    seen = replace(calibration_of(FILE), homography=corrected_homography(calibration_of(FILE), correction))
    return (
        math.degrees(camera_roll(seen)) - camera.roll,
        math.degrees(camera_pitch(seen)) - camera.pitch,
        camera_position(seen)[2] / camera.height - 1,
    )


class TestCorrection:
    @pytest.mark.parametrize('camera', [FILE, replace(FILE, roll=-3.0, pitch=12.0, yaw=5.0, ahead=0.1, left=0.02)])
    def test_it_turns_and_raises_the_camera_where_it_stands(self, camera: Camera) -> None:
        calibration = calibration_of(camera)
        for correction in (
            Correction(roll=0.03),
            Correction(pitch=0.04),
            Correction(yaw=-0.05),
            Correction(height=1.2),
            Correction(0.02, -0.03, 0.0, 0.9),
        ):
            seen = replace(calibration, homography=corrected_homography(calibration, correction))
            assert camera_pitch(seen) - camera_pitch(calibration) == pytest.approx(correction.pitch, abs=0.001)
            assert camera_roll(seen) - camera_roll(calibration) == pytest.approx(correction.roll, abs=0.002)
            turned = camera_yaw(seen) - camera_yaw(calibration)
            assert turned == pytest.approx(correction.yaw, abs=0.001)
            height = camera.height * correction.height
            np.testing.assert_allclose(camera_position(seen), (camera.ahead, camera.left, height), atol=1e-6)

    def test_none_changes_nothing(self) -> None:
        calibration = calibration_of(FILE)
        np.testing.assert_allclose(corrected_homography(calibration, Correction()), calibration.homography, atol=1e-12)


class TestFit:
    @pytest.mark.parametrize(('what', 'camera'), ERRORS, ids=[what for what, _ in ERRORS])
    def test_a_pixel_of_noise_leaves_a_third_of_a_degree_and_three_per_cent(self, what: str, camera: Camera) -> None:
        fitted = fit(calibration_of(FILE), made_lines(camera, POSES, 1.0), Correction())
        assert fitted is not None and not fitted.at_limit
        roll, pitch, height = off_by(camera, fitted.correction)
        assert abs(roll) < 0.3 and abs(pitch) < 0.3 and abs(height) < 0.03
        assert fitted.noise == pytest.approx(1.0, abs=0.2)
        np.testing.assert_allclose(np.degrees(fitted.headings), np.degrees([pose[2] for pose in POSES]), atol=0.5)

    @pytest.mark.parametrize('yaw', [-4.0, 0.0, 3.0])
    def test_the_heading_is_the_yaw_of_a_robot_that_stands_parallel(self, yaw: float) -> None:
        camera = replace(FILE, yaw=yaw, roll=1.0)
        fitted = fit(calibration_of(FILE), made_lines(camera, [(0, 0.01, 0), (0.2, -0.02, 0)], 1.0), Correction())
        assert fitted is not None
        assert math.degrees(fitted.headings.mean()) == pytest.approx(yaw, abs=0.3)
        correction = replace(fitted.correction, yaw=float(fitted.headings.mean()))
        seen = replace(calibration_of(FILE), homography=corrected_homography(calibration_of(FILE), correction))
        assert math.degrees(camera_yaw(seen)) == pytest.approx(yaw, abs=0.3)
        assert math.degrees(camera_roll(seen)) == pytest.approx(1.0, abs=0.3)

    @pytest.mark.parametrize('yaw', [-3.0, 0.0, 2.0])
    def test_a_drive_tells_the_yaw_by_the_way_it_moves_in_the_lane(self, yaw: float) -> None:
        headings = 0.15 * np.sin(np.arange(16) / 2)
        steps = 0.1 * np.sin((headings[1:] + headings[:-1]) / 2)
        left = np.concatenate([[0.0], np.cumsum(steps)])
        poses = [(0.1 * number, left[number], headings[number]) for number in range(16)]
        fitted = fit(calibration_of(FILE), made_lines(replace(FILE, yaw=yaw), poses, 1.0), Correction())
        assert fitted is not None
        driven = [0.1 * number for number in range(16)]
        found = yaw_from_motion(fitted, [0.5 * number for number in range(16)], driven)
        assert found is not None
        assert math.degrees(found[0]) == pytest.approx(yaw, abs=0.7)
        assert math.degrees(found[1]) < 1.0
        assert yaw_from_motion(fitted, driven, [0.0] * 16) is None, 'a robot that stands tells nothing'

    def test_more_pictures_make_it_surer(self) -> None:
        few = fit(calibration_of(FILE), made_lines(FILE, POSES[:1], 1.0), Correction())
        many = fit(calibration_of(FILE), made_lines(FILE, POSES, 1.0), Correction())
        assert few is not None and many is not None
        assert (many.spread < 0.7 * few.spread).all()

    def test_the_same_view_again_makes_it_no_surer(self) -> None:
        once, often = (
            fit(calibration_of(FILE), count * made_lines(FILE, POSES[:1], 1.0), Correction()) for count in (1, 20)
        )
        assert once is not None and often is not None
        assert (once.views, often.views) == (1, 1)
        np.testing.assert_allclose(often.spread, once.spread, rtol=0.1)

    def test_points_that_are_no_line_are_left_out(self) -> None:
        pictures = made_lines(FILE, POSES, 0.5)
        for lines in pictures:
            lines[0].left[::7] += (25.0, 0.0)
        fitted = fit(calibration_of(FILE), pictures, Correction())
        assert fitted is not None
        assert np.abs(off_by(FILE, fitted.correction)).max() < 0.2
        assert len(fitted.edges.pixels) <= 5 * 4 * 60 - 5 * 9

    def test_nothing_is_made_of_no_lines(self) -> None:
        assert fit(calibration_of(FILE), [], Correction()) is None
        assert fit(calibration_of(FILE), [[], []], Correction()) is None

    @pytest.mark.parametrize('curvature', [-3.0, 0.0, 1e-7, 2.0])
    def test_the_lane_coordinate_is_the_distance_from_the_curve(self, curvature: float) -> None:
        heading, offset = 0.2, 0.1
        along = np.linspace(-0.5, 1.0, 20001)
        if abs(curvature) < 1e-6:
            x, y = along, np.zeros_like(along)
        else:
            x, y = np.sin(curvature * along) / curvature, (1 - np.cos(curvature * along)) / curvature
        cos, sin = math.cos(-heading), math.sin(-heading)  # from the lane's to the robot's frame
        curve = np.column_stack([cos * x - sin * (y + offset), sin * x + cos * (y + offset)])
        points = np.array([[0.2, 0.15], [0.4, -0.1], [0.3, 0.05]])
        expected = [np.hypot(*(curve - point).T).min() for point in points]
        np.testing.assert_allclose(np.abs(lane_coordinate(points, heading, offset, curvature)), expected, atol=1e-4)


class TestPaint:
    @pytest.mark.parametrize('pose', POSES)
    def test_edges_lie_where_the_paint_ends(self, pose: Tuple[float, float, float]) -> None:
        calibration = calibration_of(FILE)
        picture = drawn.draw(drawn.Scene(), calibration, drawn.RobotPose(*pose), 1)
        lines = find_lines(picture, rows_of(calibration), calibration.homography)
        assert [line.tape for line in lines][:2] == [Tape.YELLOW, Tape.WHITE]
        half = drawn.LANE_WIDTH / 2
        edges = {Tape.YELLOW: (half + drawn.YELLOW_WIDTH, half), Tape.WHITE: (-half, -half - drawn.WHITE_WIDTH)}
        for line in lines[:2]:
            if line.tape is Tape.WHITE and line.left[:, 0].mean() < 320:
                continue  # the other lane's
            for pixels, y in zip((line.left, line.right), edges[line.tape]):
                x = pose[0] + np.linspace(-0.3, 3.0, 3000)
                ground = np.column_stack(drawn.robot_from_world(x, np.full(3000, y), drawn.RobotPose(*pose)))
                ground = ground[ground[:, 0] > 0.1]
                truth = pixel_from_ground(calibration.homography, ground)
                order = np.argsort(truth[:, 1])
                expected = np.interp(pixels[:, 1], truth[order, 1], truth[order, 0])
                assert np.median(np.abs(pixels[:, 0] - expected)) < 0.4

    def test_a_picture_without_lines_has_none(self) -> None:
        calibration = calibration_of(FILE)
        rows = rows_of(calibration)
        noise = np.random.RandomState(0).normal(80, 6, (480, 640, 3)).clip(0, 255).astype(np.uint8)
        for picture in (np.zeros_like(noise), np.full_like(noise, 255), noise):
            assert find_lines(picture, rows, calibration.homography) == []

    def test_a_duckie_on_the_road_is_no_line(self) -> None:
        calibration = calibration_of(FILE)
        scene = drawn.Scene((drawn.Thing(drawn.Kind.DUCKIE, 0.45, 0.0, 0.06),))
        empty, full = (
            find_lines(drawn.draw(one, calibration, drawn.RobotPose()), rows_of(calibration), calibration.homography)
            for one in (drawn.Scene(), scene)
        )
        assert [line.tape for line in full] == [line.tape for line in empty]

    @pytest.mark.parametrize('yellow', [(125, 205, 215), (20, 150, 200)], ids=['whitish', 'orange'])
    def test_yellow_tape_is_yellow_when_it_is_pale_or_orange(
        self, yellow: Tuple[int, int, int], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(drawn, 'YELLOW', yellow)
        calibration = calibration_of(FILE)
        picture = drawn.draw(drawn.Scene(), calibration, drawn.RobotPose())
        lines = find_lines(picture, rows_of(calibration), calibration.homography)
        assert [line.tape for line in lines] == [Tape.YELLOW, Tape.WHITE, Tape.WHITE]

    def test_a_red_line_is_neither(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(drawn, 'YELLOW', drawn.RED)
        monkeypatch.setattr(drawn, 'WHITE', drawn.ASPHALT)
        calibration = calibration_of(FILE)
        picture = drawn.draw(drawn.Scene(), calibration, drawn.RobotPose())
        assert find_lines(picture, rows_of(calibration), calibration.homography) == []

    @pytest.mark.parametrize('gains', [(1.0, 0.6, 0.5), (0.5, 1.0, 0.6), (0.5, 0.7, 1.0), (0.3, 0.3, 0.3)])
    def test_white_and_yellow_are_told_apart_in_coloured_light(self, gains: Tuple[float, float, float]) -> None:
        calibration = calibration_of(FILE)
        picture = drawn.draw(drawn.Scene(), calibration, drawn.RobotPose())
        lit = (255 * (picture / 255.0) * np.array(gains)).astype(np.uint8)
        lines = find_lines(lit, rows_of(calibration), calibration.homography)
        assert [line.tape for line in lines] == [Tape.YELLOW, Tape.WHITE, Tape.WHITE]


class TestJudge:
    @pytest.mark.parametrize(('what', 'camera'), ERRORS[1:], ids=[what for what, _ in ERRORS[1:]])
    def test_a_wrong_file_is_found_and_corrected(self, what: str, camera: Camera) -> None:
        pictures = drawn_pictures(camera)
        check = judge(calibration_of(FILE), *examine(calibration_of(FILE), pictures))
        assert check.verdict == BAD and check.corrected is not None and check.fit is not None
        roll, pitch, height = off_by(camera, check.fit.correction)
        assert abs(roll) < 0.3 and abs(pitch) < 0.3 and abs(height) < 0.03
        again = judge(check.corrected, *examine(check.corrected, pictures))
        assert again.verdict == GOOD
        ground = np.array([[0.3, 0.0], [0.6, 0.0]])
        told = np.array([[dx, dy] for _, dx, dy, *_ in check.obstacles])
        pixels = pixel_from_ground(calibration_of(camera).homography, ground)
        ones = np.column_stack([pixels, np.ones(2)]) @ calibration_of(FILE).homography.T
        np.testing.assert_allclose(told, ones[:, :2] / ones[:, 2:] - ground, atol=0.025)

    def test_blur_does_not_seem_like_a_lower_camera(self) -> None:
        pictures = [cv2.GaussianBlur(picture, (0, 0), 1.2) for picture in drawn_pictures(FILE)]
        fitted, _ = examine(calibration_of(FILE), pictures)
        assert fitted is not None
        assert abs(off_by(FILE, fitted.correction)[2]) < 0.02

    def test_a_right_file_fits(self) -> None:
        check = judge(calibration_of(FILE), *examine(calibration_of(FILE), drawn_pictures(FILE)))
        assert check.verdict == GOOD and check.reasons == () and check.corrected is None
        assert all(item.verdict != OFF for item in check.quantities)

    def test_a_twisted_and_stretched_rectification_is_no_error(self) -> None:
        camera = replace(FILE, twist=2.0, projection=(260.0, 220.0))
        check = judge(calibration_of(camera), *examine(calibration_of(camera), drawn_pictures(camera)))
        assert check.verdict == GOOD

    def test_another_picture_size(self) -> None:
        camera = FILE.resized(320, 240)
        check = judge(calibration_of(camera), *examine(calibration_of(camera), drawn_pictures(camera)))
        assert check.verdict == GOOD

    def test_pictures_without_lines_are_not_enough(self) -> None:
        blank = np.full((480, 640, 3), 90, np.uint8)
        fitted, lines = examine(calibration_of(FILE), [blank, blank])
        check = judge(calibration_of(FILE), fitted, lines or ((), ()))
        assert (check.verdict, check.corrected, check.obstacles) == (UNCLEAR, None, ())
        assert check.reasons == ('no lane line was found in 2 pictures',)

    def test_one_short_line_is_not_enough(self) -> None:
        pictures = [
            [Line(Tape.YELLOW, lines[0].left[:14], lines[0].right[:14])] for lines in made_lines(FILE, POSES[:1], 1)
        ]
        fitted = fit(calibration_of(FILE), pictures, Correction())
        check = judge(calibration_of(FILE), fitted, tuple(pictures))
        assert check.verdict == UNCLEAR and check.corrected is None
        assert 'cannot be told from these pictures' in check.reasons[0]

    def test_lines_that_no_camera_can_see_are_not_enough(self) -> None:
        pictures = made_lines(FILE, POSES, 0.5)
        for number, lines in enumerate(pictures):
            for line in lines:
                line.left[:, 0] += 12 * np.sin(line.left[:, 1] / 9 + number)
        check = judge(calibration_of(FILE), fit(calibration_of(FILE), pictures, Correction()), tuple(pictures))
        assert check.verdict == UNCLEAR and check.corrected is None
        assert 'no lane that a camera like this one can see' in check.reasons[0]
        assert check.quantities == () and check.obstacles == ()

    @pytest.mark.parametrize(
        ('roll', 'pictures', 'verdict'),
        [(0.6, 3, 'fits'), (1.25, 1, 'unknown'), (1.25, 5, 'off'), (0.6, 1, 'fits'), (4.0, 1, 'off')],
    )
    def test_a_verdict_is_given_when_it_is_sure(self, roll: float, pictures: int, verdict: str) -> None:
        lines = made_lines(replace(FILE, roll=roll), POSES[:pictures], 0.5)
        check = judge(calibration_of(FILE), fit(calibration_of(FILE), lines, Correction()), tuple(lines))
        assert [item.verdict for item in check.quantities if item.name == 'roll'] == [verdict]
        assert check.verdict == {'fits': GOOD, 'unknown': UNCLEAR, 'off': BAD}[verdict]

    def test_the_yaw_is_corrected_when_it_is_known(self) -> None:
        camera = replace(FILE, yaw=4.0)
        pictures = drawn_pictures(camera, [(0.0, 0.01, 0.0), (0.2, -0.02, 0.0), (0.4, 0.0, 0.0)])
        fitted, lines = examine(calibration_of(FILE), pictures)
        assert fitted is not None
        without = judge(calibration_of(FILE), fitted, lines)
        assert without.verdict == GOOD, 'lines alone do not tell it'
        check = judge(calibration_of(FILE), fitted, lines, (float(fitted.headings.mean()), 0.005))
        assert check.verdict == BAD and check.corrected is not None
        assert math.degrees(camera_yaw(check.corrected)) == pytest.approx(4.0, abs=0.3)
        assert check.obstacles[0][2] == pytest.approx(-0.3 * math.radians(4.0), abs=0.01)


@pytest.mark.parametrize('form', ['flat', 'resolution-independent'])
@pytest.mark.parametrize('size', [(640, 480), (1296, 972)])
def test_a_corrected_file_is_read_as_it_was_meant(tmp_path: Path, form: str, size: Tuple[int, int]) -> None:
    calibration = load_camera(tmp_path, replace(FILE, roll=2.0).resized(*size), form)
    written = extrinsic_content(calibration, form == 'resolution-independent')
    intrinsic = (tmp_path / 'camera_intrinsic' / (ROBOT + '.yaml')).read_text()
    write_files(tmp_path / 'new', intrinsic, written)
    again = load_calibration(str(tmp_path / 'new'), ROBOT)
    np.testing.assert_allclose(
        again.homography / again.homography[2, 2], calibration.homography / calibration.homography[2, 2], rtol=1e-6
    )


REAL = ('bella', 'megaman', 'nominal', 'ola', 'schumi', 'wayne')


@pytest.mark.parametrize('name', REAL)
def test_errors_of_real_calibrations_are_found(name: str, shared: Path, tmp_path: Path) -> None:
    for kind in ('camera_intrinsic', 'camera_extrinsic'):
        (tmp_path / kind).mkdir()
        shutil.copyfile(
            str(shared / 'real' / 'calibrations' / name / (kind + '.yaml')), str(tmp_path / kind / (name + '.yaml'))
        )
    true = load_calibration(str(tmp_path), name)
    wrong = Correction(math.radians(2.0), math.radians(-2.0), 0.0, 1.1)
    file = replace(true, homography=corrected_homography(true, wrong))
    pictures = [drawn.draw(drawn.Scene(), true, drawn.RobotPose(*pose), 1) for pose in POSES[:3]]
    check = judge(file, *examine(file, pictures))
    assert check.fit is not None and check.verdict == BAD
    seen = replace(file, homography=corrected_homography(file, check.fit.correction))
    assert math.degrees(camera_roll(seen) - camera_roll(true)) == pytest.approx(0, abs=0.3)
    assert math.degrees(camera_pitch(seen) - camera_pitch(true)) == pytest.approx(0, abs=0.3)
    assert camera_position(seen)[2] / camera_position(true)[2] == pytest.approx(1, abs=0.03)
