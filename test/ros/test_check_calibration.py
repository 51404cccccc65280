"""check_calibration: what it says and writes, and its exit codes."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, List

import cv2
import numpy as np
import pytest
import rosbag
import rospy
import yaml
from unit import drawn
from unit.cameras import ROBOT, Camera, calibration_of, extrinsic_file, intrinsic_file, write_files

from obst_avoid.core.calibration import load_calibration
from obst_avoid.core.picture import encode_jpeg
from obst_avoid.msg import Twist2DStamped
from obst_avoid.offline import check_calibration
from obst_avoid.ros import border

FILE, TRUE = Camera(), Camera(roll=2.0, pitch=23.0, height=0.1)
POSES = ((0.0, 0.02, -0.12), (0.1, -0.03, 0.1), (0.2, 0.0, 0.03))


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Calibration files of FILE in both formats, and pictures by TRUE, by FILE, and of nothing."""
    folder = tmp_path_factory.mktemp('check')
    write_files(folder / 'files', intrinsic_file(FILE), extrinsic_file(FILE))
    write_files(folder / 'new', intrinsic_file(FILE), extrinsic_file(FILE, 'resolution-independent'))
    for name, camera in (('off', TRUE), ('good', FILE)):
        (folder / name).mkdir()
        calibration = calibration_of(camera)  # once: drawing for another one begins anew, slowly
        for number, pose in enumerate(POSES):
            picture = drawn.draw(drawn.Scene(), calibration, drawn.RobotPose(*pose), number)
            (folder / name / ('%d.jpg' % number)).write_bytes(encode_jpeg(picture, 95))
    (folder / 'blank').mkdir()
    (folder / 'blank' / 'a.jpg').write_bytes(encode_jpeg(np.full((480, 640, 3), 90, np.uint8), 95))
    return folder


def checked(folder: Path, output: Path, *paths: Any, files: str = 'files', code: int = 0) -> Dict[str, Any]:
    """What check.json says."""
    arguments = ['--calibration', str(folder / files), '--vehicle', ROBOT, '--output', str(output), *map(str, paths)]
    assert check_calibration.main(arguments) == code
    content: Dict[str, Any] = json.loads((output / 'check.json').read_text())
    return content


def value(content: Dict[str, Any], name: str) -> Dict[str, Any]:
    return next(item for item in content['quantities'] if item['name'] == name)


@pytest.mark.parametrize('files', ['files', 'new'])
def test_a_wrong_file_is_told_and_a_corrected_one_written(
    folder: Path, tmp_path: Path, files: str, capsys: pytest.CaptureFixture
) -> None:
    before = {path: path.read_bytes() for path in (folder / files).rglob('*.yaml')}
    content = checked(folder, tmp_path / 'out', folder / 'off', files=files)
    said = capsys.readouterr().out
    assert content['verdict'] == 'does not fit' and 'the calibration does not fit' in said
    assert value(content, 'roll')['seen'] == pytest.approx(2.0, abs=0.3)
    assert value(content, 'pitch')['difference'] == pytest.approx(2.0, abs=0.3)
    assert value(content, 'camera height')['seen'] == pytest.approx(0.1, rel=0.03)
    assert [round(item['distance'], 1) for item in content['obstacles']] == [0.3, 0.6]
    assert 'an obstacle 0.6 m straight ahead is reported' in said
    picture = cv2.imread(str(tmp_path / 'out' / 'check.png'))
    assert picture.shape[0] > 800 and picture.std() > 30
    assert {path: path.read_bytes() for path in (folder / files).rglob('*.yaml')} == before
    new = yaml.safe_load((tmp_path / 'out' / 'camera_extrinsic' / (ROBOT + '.yaml')).read_text())
    assert new.get('format') == ('resolution-independent' if files == 'new' else None)
    corrected, true = load_calibration(str(tmp_path / 'out'), ROBOT), calibration_of(TRUE)
    pixel = (320, 300, 1)
    seen, right = corrected.homography @ pixel, true.homography @ pixel
    np.testing.assert_allclose(seen[:2] / seen[2], right[:2] / right[2], atol=0.01)
    arguments = ['--calibration', str(tmp_path / 'out'), '--vehicle', ROBOT, str(folder / 'off')]
    assert check_calibration.main(arguments) == 0
    assert 'the calibration fits' in capsys.readouterr().out


def test_a_right_file_fits_and_nothing_is_corrected(folder: Path, tmp_path: Path) -> None:
    content = checked(folder, tmp_path / 'out', folder / 'good')
    assert content['verdict'] == 'fits' and content['reasons'] == []
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == ['check.json', 'check.png']
    assert value(content, 'lane width at 0.6 m')['file'] == pytest.approx(drawn.LANE_WIDTH, abs=0.01)


def test_a_picture_without_lines_is_not_enough(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    content = checked(folder, tmp_path / 'out', folder / 'blank', code=1)
    assert content['verdict'] == 'not enough evidence' and content['quantities'] == []
    assert 'not enough evidence' in capsys.readouterr().out
    assert (tmp_path / 'out' / 'check.png').exists()


def test_broken_pictures_are_named_and_the_others_used(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    whole = (folder / 'good' / '0.jpg').read_bytes()
    (tmp_path / 'gone.jpg').symlink_to(tmp_path / 'nowhere.jpg')
    (tmp_path / 'cut.jpg').write_bytes(whole[: len(whole) // 2])
    (tmp_path / 'text.jpg').write_text('no picture')
    small = cv2.resize(cv2.imread(str(folder / 'good' / '1.jpg')), (320, 240))
    cv2.imwrite(str(tmp_path / 'small.jpg'), small)
    content = checked(folder, tmp_path / 'out', tmp_path, folder / 'good')
    lines = capsys.readouterr().err.splitlines()
    for name in ('cut.jpg', 'text.jpg', 'small.jpg', 'gone.jpg'):
        assert sum(name in line and line.startswith('check_calibration: ') for line in lines) == 1, lines
    assert content['verdict'] == 'fits' and len(content['broken']) == 4 and len(content['pictures']) == 3


def test_pictures_of_another_size_are_scaled_to(folder: Path, tmp_path: Path) -> None:
    for number in range(3):
        picture = cv2.imread(str(folder / 'good' / ('%d.jpg' % number)))
        cv2.imwrite(str(tmp_path / ('%d.jpg' % number)), cv2.resize(picture, (320, 240), interpolation=cv2.INTER_AREA))
    content = checked(folder, tmp_path / 'out', tmp_path)
    assert content['picture_size'] == {'file': [640, 480], 'seen': [320, 240]}
    assert content['verdict'] == 'fits'


def bag_of(path: Path, camera: Camera, commands: bool) -> None:
    """A drive that swings from side to side of the lane, 0.2 m/s, 20 pictures in 8 s."""
    calibration = calibration_of(camera)
    with rosbag.Bag(str(path), 'w') as bag:
        left, step, swing = 0.0, 0.02, 0.15
        for tick in range(400):
            now = 10 + 0.02 * tick
            heading = swing * np.sin(now * 2)
            left += 0.2 * 0.02 * np.sin(heading)
            stamp = rospy.Time.from_sec(now)
            if commands:
                msg = Twist2DStamped(v=0.2)
                msg.header.stamp = stamp
                bag.write('/duck1/lane_controller_node/car_cmd', msg, stamp)
            if tick % 20 == 0:
                pose = drawn.RobotPose(0.2 * step * tick, left, heading)
                jpeg = encode_jpeg(drawn.draw(drawn.Scene(), calibration, pose, tick), 90)
                message = border.compressed_image_from_jpeg(jpeg, border.nanoseconds(stamp), 'camera')
                bag.write('/duck1/camera_node/image/compressed', message, stamp)


def test_a_bag_with_commands_tells_the_yaw_too(folder: Path, tmp_path: Path) -> None:
    bag_of(tmp_path / 'drive.bag', replace(FILE, yaw=4.0), True)
    content = checked(folder, tmp_path / 'out', tmp_path / 'drive.bag')
    assert value(content, 'yaw')['seen'] == pytest.approx(4.0, abs=1.0)
    assert value(content, 'yaw')['verdict'] == 'off' and content['verdict'] == 'does not fit'
    assert 5 <= len(content['pictures']) <= 20


def test_a_bag_without_commands_tells_all_but_the_yaw(folder: Path, tmp_path: Path) -> None:
    bag_of(tmp_path / 'drive.bag', TRUE, False)
    content = checked(folder, tmp_path / 'out', tmp_path / 'drive.bag')
    assert content['verdict'] == 'does not fit'
    assert 'yaw' not in [item['name'] for item in content['quantities']]


def test_aligned_pictures_tell_the_yaw(folder: Path, tmp_path: Path) -> None:
    camera = calibration_of(replace(FILE, yaw=-3.0))
    for number in range(3):
        picture = drawn.draw(drawn.Scene(), camera, drawn.RobotPose(0.2 * number, 0.01 * number, 0.0), number)
        (tmp_path / ('%d.jpg' % number)).write_bytes(encode_jpeg(picture, 95))
    content = checked(folder, tmp_path / 'out', '--aligned', tmp_path)
    assert value(content, 'yaw')['seen'] == pytest.approx(-3.0, abs=0.3)
    assert value(content, 'yaw')['ci95'] >= 1.0, 'nobody puts a robot straighter'


def test_existing_files_are_never_written_over(folder: Path, sentence: Callable[[str], str]) -> None:
    arguments = ['--calibration', str(folder / 'files'), '--vehicle', ROBOT, '--output', str(folder / 'files')]
    before = {path: path.read_bytes() for path in (folder / 'files').rglob('*') if path.is_file()}
    assert check_calibration.main([*arguments, str(folder / 'off')]) == 1
    assert 'exists, expected a new folder' in sentence('check_calibration')
    assert {path: path.read_bytes() for path in (folder / 'files').rglob('*') if path.is_file()} == before


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--vehicle', 'nobody'], 'no calibration of nobody'),
        (['--vehicle', ROBOT, 'missing.jpg'], 'missing.jpg does not exist'),
    ],
)
def test_one_sentence_for_what_is_wrong(
    folder: Path, arguments: List[str], words: str, sentence: Callable[[str], str]
) -> None:
    paths = [] if len(arguments) > 2 else [str(folder / 'good')]
    assert check_calibration.main(['--calibration', str(folder / 'files'), *arguments, *paths]) == 1
    assert words in sentence('check_calibration')


def test_a_folder_that_cannot_be_written_is_said_before_the_work(
    folder: Path, tmp_path: Path, sentence: Callable[[str], str]
) -> None:
    (tmp_path / 'file').write_text('')
    arguments = ['--calibration', str(folder / 'files'), '--vehicle', ROBOT, '--output', str(tmp_path / 'file')]
    assert check_calibration.main([*arguments, str(folder / 'missing')]) == 1
    assert str(tmp_path / 'file') in sentence('check_calibration')


def test_a_picture_of_another_aspect_is_refused(folder: Path, tmp_path: Path, sentence: Callable[[str], str]) -> None:
    cv2.imwrite(str(tmp_path / 'wide.jpg'), np.zeros((360, 640, 3), np.uint8))
    arguments = ['--calibration', str(folder / 'files'), '--vehicle', ROBOT, str(tmp_path / 'wide.jpg')]
    assert check_calibration.main(arguments) == 1
    assert 'the picture is 640x360, expected the aspect of 640x480' in sentence('check_calibration')


def test_live_without_a_robot_says_so(
    folder: Path, monkeypatch: pytest.MonkeyPatch, sentence: Callable[[str], str]
) -> None:
    monkeypatch.setenv('ROS_MASTER_URI', 'http://127.0.0.1:1')
    assert check_calibration.main(['--calibration', str(folder / 'files'), '--vehicle', ROBOT, '--live']) == 1
    assert 'no ROS master' in sentence('check_calibration')


@pytest.mark.parametrize(
    'arguments',
    [[], ['--vehicle', 'x'], ['--vehicle', 'x', '--live', 'a.jpg'], ['--vehicle', 'x', '--pictures', '0', 'a.jpg']],
)
def test_wrong_use(arguments: List[str]) -> None:
    with pytest.raises(SystemExit) as error:
        check_calibration.main(arguments)
    assert error.value.code == 2


def test_help(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as error:
        check_calibration.main(['--help'])
    assert error.value.code == 0
    assert '--aligned' in capsys.readouterr().out
