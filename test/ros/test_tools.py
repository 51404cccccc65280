"""The command-line tools: what they write, their exit codes, and one sentence instead of a traceback."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import argparse
import contextlib
import json
import os
import re
import shutil
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

import cv2
import numpy as np
import pytest
import rosbag
from helpers import DUCKIE, REPOSITORY, SCENE, default_calibration, jpeg_of, nanoseconds, picture_of, run_program
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from unit.drawn import Scene, Thing

from obst_avoid import msg as messages
from obst_avoid.core import detection
from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.detection.robust import native, trees
from obst_avoid.core.detection.robust.features import NAMES
from obst_avoid.core.picture import decode_jpeg
from obst_avoid.core.types import Box, Command, Kind, LanePose, Obstacle, Stamped
from obst_avoid.core.types import Scene as Shown
from obst_avoid.offline import (
    bag_to_images,
    bench,
    bench_graph,
    bench_run_bag,
    demo,
    detect_images,
    images_to_bag,
    recording,
    run_bag,
    show_steps,
    simulated_bag,
)
from obst_avoid.offline.tool import ToolError, picture_files
from obst_avoid.ros import border
from obst_avoid.sim.renderer import RenderError

DEFAULT = ['--calibration', str(REPOSITORY / 'config' / 'calibrations'), '--vehicle', 'default']
TOOLS = {
    'bag_to_images': bag_to_images,
    'bench': bench,
    'demo': demo,
    'detect_images': detect_images,
    'images_to_bag': images_to_bag,
    'run_bag': run_bag,
    'show_steps': show_steps,
    'simulated_bag': simulated_bag,
}
CONE = SCENE.things[1]
PICTURES = simulated_bag.PICTURES
CHECKED = 100
"""Pictures of the simulated bag, up to where the stop is only remembered."""


@pytest.fixture(scope='module')
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a duckie and a cone, an empty road, and the duckie alone."""
    folder = tmp_path_factory.mktemp('pictures')
    (folder / 'a.jpg').write_bytes(jpeg_of())
    (folder / 'b.jpg').write_bytes(jpeg_of(Scene()))
    (folder / 'c.jpg').write_bytes(jpeg_of(Scene((DUCKIE,)), seed=1))
    (folder / 'notes.txt').write_text('not a picture')
    return folder


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The simulated drive: the one that the build has made, or a new one."""
    for prefix in os.environ.get('CMAKE_PREFIX_PATH', '').split(':'):
        made = Path(prefix).parent / 'test_data' / 'simulated.bag'
        if prefix and made.exists():
            return str(made)
    path = str(tmp_path_factory.mktemp('bag') / 'simulated.bag')
    simulated_bag.write(path)
    return path


def detected(paths: List[Any], folder: Path, *options: str) -> Dict[str, Any]:
    """What detect_images writes, by file name."""
    output = folder / 'det.json'
    assert detect_images.main([*DEFAULT, '--output', str(output), *options, *map(str, paths)]) == 0
    content = json.loads(output.read_text())
    assert set(content) == {'images'}
    return {image['file_name']: image for image in content['images']}


def box_of(thing: Thing) -> Tuple[int, int, int, int]:
    """left, top, right, bottom of where a thing of SCENE changes the picture."""
    others = tuple(other for other in SCENE.things if other is not thing)
    change = np.abs(picture_of().astype(int) - picture_of(Scene(others))).max(axis=2) > 40
    rows, columns = np.flatnonzero(change.any(axis=1)), np.flatnonzero(change.any(axis=0))
    return columns[0], rows[0], columns[-1] + 1, rows[-1] + 1


def overlap(first: Any, second: Any) -> float:
    """Intersection over union of two boxes."""
    (left, top), (right, bottom) = np.maximum(first[:2], second[:2]), np.minimum(first[2:], second[2:])
    both = max(0, right - left) * max(0, bottom - top)
    areas = sum((box[2] - box[0]) * (box[3] - box[1]) for box in (first, second))
    return float(both / (areas - both))


class TestDetectImages:
    def test_the_file_is_as_the_contract_says(self, pictures: Path, tmp_path: Path) -> None:
        images = detected([pictures], tmp_path)
        assert list(images) == ['a.jpg', 'b.jpg', 'c.jpg']
        for image in images.values():
            assert list(image) == ['file_name', 'width', 'height', 'milliseconds', 'obstacles']
            assert (image['width'], image['height']) == (640, 480)
            assert 0 < image['milliseconds'] < 60_000
        assert images['b.jpg']['obstacles'] == []
        seen = [obstacle for image in images.values() for obstacle in image['obstacles']]
        assert len(seen) >= 3
        for obstacle in seen:
            assert set(obstacle) == {'kind', 'bbox', 'x', 'y', 'radius', 'in_lane', 'confidence'}
            assert obstacle['kind'] in ('duckie', 'cone')
            assert obstacle['in_lane'] in (True, False, None)
            assert all(isinstance(obstacle[key], float) for key in ('x', 'y', 'radius', 'confidence'))
            assert 0 <= obstacle['confidence'] <= 1
            assert obstacle['radius'] > 0
            left, top, width, height = obstacle['bbox']
            assert width > 0
            assert height > 0
            assert 0 <= left
            assert left + width <= 640
            assert 0 <= top
            assert top + height <= 480

    def test_boxes_lie_around_what_was_drawn(self, pictures: Path, tmp_path: Path) -> None:
        seen = detected([pictures / 'a.jpg'], tmp_path)['a.jpg']['obstacles']
        assert sorted(obstacle['kind'] for obstacle in seen) == ['cone', 'duckie']
        for obstacle in seen:
            left, top, width, height = obstacle['bbox']
            wanted = box_of(DUCKIE if obstacle['kind'] == 'duckie' else CONE)
            assert overlap((left, top, left + width, top + height), wanted) > 0.5

    def test_places_and_sides(self, pictures: Path, tmp_path: Path) -> None:
        seen = {item['kind']: item for item in detected([pictures / 'a.jpg'], tmp_path)['a.jpg']['obstacles']}
        duckie, cone = seen['duckie'], seen['cone']
        assert duckie['x'] == pytest.approx(DUCKIE.x - DUCKIE.radius, abs=0.05)
        assert duckie['y'] == pytest.approx(0, abs=0.03)
        assert duckie['in_lane'] is True
        assert cone['y'] < -0.15
        assert cone['in_lane'] is False

    def test_pictures_are_independent_of_each_other(self, pictures: Path, tmp_path: Path) -> None:
        names = ['a.jpg', 'b.jpg', 'c.jpg']
        orders = [names, names[::-1], ['c.jpg']]
        found: Dict[str, List[Any]] = {}
        for order in orders:
            for name, image in detected([pictures / name for name in order], tmp_path).items():
                found.setdefault(name, []).append(image['obstacles'])
        for name in names:
            assert len(found[name]) >= 2
            assert all(obstacles == found[name][0] for obstacles in found[name])

    def test_a_sequence_uses_the_tracker(self, tmp_path: Path) -> None:
        jpeg = jpeg_of()
        paths = [tmp_path / ('%d.jpg' % index) for index in range(4)]
        for path in paths:
            path.write_bytes(jpeg)

        def duckies(*options: str) -> List[int]:
            images = detected(paths, tmp_path, *options)
            return [sum(o['kind'] == 'duckie' for o in images[path.name]['obstacles']) for path in paths]

        assert duckies() == [1, 1, 1, 1]
        assert duckies('--sequence')[0] == 0
        assert duckies('--sequence')[-1] == 1
        assert duckies('--sequence', '--rate', '0.5') == [0, 0, 0, 0], 'pictures 2 s apart are not consecutive'

    def test_a_broken_picture_is_named_and_the_others_are_not_lost(
        self, pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture
    ) -> None:
        broken, output = tmp_path / 'broken.jpg', tmp_path / 'det.json'
        broken.write_bytes(jpeg_of()[:5000])
        paths = [str(pictures / 'a.jpg'), str(broken), str(pictures / 'b.jpg')]
        assert detect_images.main([*DEFAULT, '--output', str(output), *paths]) == 1
        names = [image['file_name'] for image in json.loads(output.read_text())['images']]
        assert names == ['a.jpg', 'b.jpg']
        lines = capsys.readouterr().err.splitlines()
        assert [line for line in lines if str(broken) in line and 'end marker' in line]
        assert not [line for line in lines if 'Traceback' in line]

    def test_other_pictures(self, tmp_path: Path) -> None:
        cv2.imwrite(str(tmp_path / 'p.png'), picture_of())
        small = cv2.resize(picture_of(), (320, 240), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(tmp_path / 's.JPG'), small)
        images = detected([tmp_path], tmp_path)
        assert [o['kind'] for o in images['p.png']['obstacles']].count('duckie') == 1
        assert (images['s.JPG']['width'], images['s.JPG']['height']) == (320, 240)
        for obstacle in images['s.JPG']['obstacles']:
            assert obstacle['bbox'][0] + obstacle['bbox'][2] <= 320

    def test_one_name_in_two_folders(self, tmp_path: Path) -> None:
        for folder in ('day', 'night'):
            (tmp_path / folder).mkdir()
            (tmp_path / folder / '1.jpg').write_bytes(jpeg_of())
        images = detected([tmp_path / 'day', tmp_path / 'night'], tmp_path, '--annotated', str(tmp_path / 'out'))
        assert list(images) == ['day/1.jpg', 'night/1.jpg']
        assert (tmp_path / 'out' / 'day' / '1.jpg').exists()
        assert (tmp_path / 'out' / 'night' / '1.jpg').exists()

    def test_annotated_pictures(self, pictures: Path, tmp_path: Path) -> None:
        detected([pictures], tmp_path, '--annotated', str(tmp_path / 'boxes'))
        assert sorted(os.listdir(tmp_path / 'boxes')) == ['a.jpg', 'b.jpg', 'c.jpg']
        changes = {}
        for name in ('a.jpg', 'b.jpg'):
            drawn, plain = (cv2.imread(str(folder / name)).astype(int) for folder in (tmp_path / 'boxes', pictures))
            assert drawn.shape == plain.shape
            changes[name] = int((np.abs(drawn - plain).max(axis=2) > 100).sum())
        assert changes['a.jpg'] > 100
        assert changes['b.jpg'] == 0

    def test_the_pictures_themselves_are_not_overwritten(self, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        (tmp_path / '1.jpg').write_bytes(jpeg_of())
        call = [*DEFAULT, '--output', str(tmp_path / 'o.json'), '--annotated', str(tmp_path), str(tmp_path)]
        assert detect_images.main(call) == 1
        assert 'would overwrite' in sentence('detect_images')
        assert (tmp_path / '1.jpg').read_bytes() == jpeg_of()

    def test_annotated_pictures_that_differ_in_their_ending_only(self, tmp_path: Path) -> None:
        folder = tmp_path / 'pictures'
        folder.mkdir()
        (folder / '1.jpg').write_bytes(jpeg_of())
        cv2.imwrite(str(folder / '1.png'), picture_of(Scene()))
        detected([folder], tmp_path, '--annotated', str(tmp_path / 'boxes'))
        assert len(os.listdir(tmp_path / 'boxes')) == 2

    @pytest.mark.parametrize(
        'arguments',
        [[], ['a.jpg'], ['--output', 'o.json'], ['--output', 'o.json', '--profile', 'magic', 'a.jpg'], ['--what']],
    )
    def test_wrong_use(self, arguments: List[str], capsys: pytest.CaptureFixture) -> None:
        with pytest.raises(SystemExit) as ended:
            detect_images.main(arguments)
        assert ended.value.code == 2
        assert 'usage: detect_images' in capsys.readouterr().err

    @pytest.mark.parametrize(
        ('options', 'words'),
        [
            ([DEFAULT[0], DEFAULT[1], '--vehicle', 'nobody'], 'no calibration of nobody'),
            ([DEFAULT[0], DEFAULT[1]], '--vehicle is missing'),
            (['--calibration', '/no/such', '--vehicle', 'x'], '/no/such'),
            ([*DEFAULT, '--config', '/no/such'], '/no/such'),
            ([*DEFAULT, '--output', '/no/such/det.json'], '/no/such/det.json'),
        ],
    )
    def test_failures(
        self, options: List[str], words: str, pictures: Path, tmp_path: Path, sentence: Callable[[str], str]
    ) -> None:
        assert detect_images.main(['--output', str(tmp_path / 'o.json'), *options, str(pictures / 'b.jpg')]) == 1
        assert words in sentence('detect_images')

    def test_paths_without_pictures(self, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        common = [*DEFAULT, '--output', str(tmp_path / 'o.json')]
        assert detect_images.main([*common, str(tmp_path)]) == 1
        assert 'no picture in %s' % tmp_path in sentence('detect_images')
        assert detect_images.main([*common, str(tmp_path / 'nothing.jpg')]) == 1
        assert 'nothing.jpg does not exist' in sentence('detect_images')


@pytest.mark.parametrize('name', sorted(TOOLS))
def test_help(name: str, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as ended:
        TOOLS[name].main(['--help'])
    assert ended.value.code == 0
    assert 'usage: ' + name in capsys.readouterr().out


@pytest.fixture
def broken_trees(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The detector's forests are not where they should be, or only a part of them, or something is wrong with them."""
    path, shipped = tmp_path / 'trees.npz', trees.FILE
    monkeypatch.setattr(trees, 'FILE', str(path))

    def broken(how: str) -> str:
        if how == 'cut off':
            whole = Path(shipped).read_bytes()
            path.write_bytes(whole[: int(0.7 * len(whole))])
        elif how != 'missing':
            with np.load(shipped) as file:
                arrays = {name: file[name] for name in file.files}
            if how == 'without an end':
                arrays['first_nodes']['left'][0, 1] = 0
            else:
                arrays['names'] = arrays['names'][:-1]
            np.savez(str(path), **arrays)
        trees.shipped.cache_clear()
        return str(path)

    yield broken
    trees.shipped.cache_clear()


@pytest.mark.parametrize(
    ('how', 'words'),
    [
        ('missing', 'is no file of train_detector: '),
        ('cut off', 'is no file of train_detector: '),
        ('without an end', 'is no file of train_detector: the forest first is broken'),
        ('of other measurements', 'was trained on other measurements, expected those of features.py'),
    ],
)
@pytest.mark.parametrize('name', ['detect_images', 'show_steps', 'bench', 'run_bag'])
def test_without_its_forests_a_tool_ends_with_a_sentence(
    name: str,
    how: str,
    words: str,
    broken_trees: Callable[[str], str],
    pictures: Path,
    bag: str,
    tmp_path: Path,
    sentence: Callable[[str], str],
) -> None:
    path = broken_trees(how)
    output = {'detect_images': 'o.json', 'show_steps': 'steps', 'bench': 'bench.json', 'run_bag': 'out.bag'}[name]
    shown = bag if name == 'run_bag' else str(pictures / 'b.jpg')
    assert TOOLS[name].main([*DEFAULT, '--output', str(tmp_path / output), shown]) == 1
    assert '%s %s' % (path, words) in sentence(name)


def test_tools_are_installed(pictures: Path, tmp_path: Path) -> None:
    output = tmp_path / 'det.json'
    call = ['rosrun', 'obst_avoid', 'detect_images', *DEFAULT, '--output', str(output), str(pictures)]
    ended = run_program(call, 60)
    assert ended.code == 0, ended.output
    assert len(json.loads(output.read_text())['images']) == 3
    ended = run_program([*call[:3], '--calibration', DEFAULT[1], '--vehicle', 'nobody', *call[7:]], 60)
    assert ended.code == 1
    assert 'Traceback' not in ended.output
    assert len(ended.output.strip().splitlines()) == 1


def test_each_tool_has_a_script() -> None:
    for name in TOOLS:
        script = REPOSITORY / 'scripts' / name
        assert os.access(str(script), os.X_OK)
        assert 'obst_avoid.offline.%s import main' % name in script.read_text()


def test_what_a_tracker_remembers_is_no_detection_in_a_picture() -> None:
    shown = Obstacle(Kind.DUCKIE, 0.5, 0.0, 0.03, True, image_box=Box(1, 2, 3, 4))
    remembered = Obstacle(Kind.DUCKIE, 0.1, 0.0, 0.03, True, bird_box=Box(1, 2, 3, 4))
    assert detect_images.in_sight([remembered, shown]) == [shown]
    assert detect_images.in_sight([]) == []


class TestShowSteps:
    @pytest.mark.parametrize(
        ('options', 'steps'), [([], 11), (['--profile', 'robust'], 11), (['--profile', 'paper'], 12)]
    )
    def test_each_step_and_a_sheet(self, options: List[str], steps: int, pictures: Path, tmp_path: Path) -> None:
        assert show_steps.main([*DEFAULT, *options, '--output', str(tmp_path), str(pictures / 'a.jpg')]) == 0
        assert os.listdir(tmp_path) == ['a']
        names = sorted(os.listdir(tmp_path / 'a'))
        assert len(names) == steps + 1
        assert 'contact_sheet.png' in names
        numbers = {name.split('_')[0] for name in names if name != 'contact_sheet.png'}
        assert numbers == {str(number) for number in range(1, steps + 1)}
        for name in names:
            picture = cv2.imread(str(tmp_path / 'a' / name))
            assert picture is not None
            assert picture.max() > picture.min()

    def test_robust_says_what_moved_each_candidate(
        self, pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture
    ) -> None:
        path = str(pictures / 'a.jpg')
        assert show_steps.main([*DEFAULT, '--profile', 'robust', '--output', str(tmp_path), path]) == 0
        *lines, last = capsys.readouterr().out.splitlines()
        assert last == '1 pictures: %s' % tmp_path
        seen = {}
        for line in lines:
            words = re.match(r'%s \((\d+), (\d+)\) (duckie|cone) ([01]\.\d\d): (.*)$' % re.escape(path), line)
            assert words, line
            reasons = words.group(5).split(', ')
            assert 1 <= len(reasons) <= 4
            for reason in reasons:
                name, value = reason.split()
                assert name in NAMES
                assert re.match(r'[-+]\d+\.\d$', value)
            seen[words.group(3)] = int(words.group(1)), int(words.group(2)), float(words.group(4))
        assert set(seen) == {'duckie', 'cone'}
        for name, thing in (('duckie', DUCKIE), ('cone', CONE)):
            left, _, _, bottom = box_of(thing)
            assert seen[name][:2] == pytest.approx((left, bottom), abs=12)
            assert seen[name][2] >= 0.5

    def test_the_steps_of_robust_show_what_was_found(self, pictures: Path, tmp_path: Path) -> None:
        for name in ('a', 'b'):
            assert show_steps.main([*DEFAULT, '--output', str(tmp_path), str(pictures / (name + '.jpg'))]) == 0
        steps = sorted(path.name for path in (tmp_path / 'a').iterdir())
        assert steps == sorted(path.name for path in (tmp_path / 'b').iterdir())
        read = {name: {step: cv2.imread(str(tmp_path / name / step)).astype(int) for step in steps} for name in 'ab'}
        left, top, right, bottom = box_of(DUCKIE)
        for step in (
            '2_light_relative_to_the_asphalt.png',
            '3_levels_of_yellow.png',
            '4_levels_of_yellow_paint_cut_off.png',
            '5_regions_at_all_levels.png',
            '6_promising_regions.png',
            '8_candidates.png',
            '11_result.png',
        ):
            scale = 640 / read['a'][step].shape[1]  # the working picture is smaller
            row, column = int((top + bottom) / 2 / scale), int((left + right) / 2 / scale)
            reach = int(25 / scale)
            box = slice(row - reach, row + reach), slice(column - reach, column + reach)
            assert np.abs(read['a'][step][box] - read['b'][step][box]).max() > 60, step

    def test_fewer_regions_are_promising_than_there_are(self, pictures: Path, tmp_path: Path) -> None:
        assert show_steps.main([*DEFAULT, '--output', str(tmp_path), str(pictures / 'a.jpg')]) == 0
        steps = ('2_light_relative_to_the_asphalt', '5_regions_at_all_levels', '6_promising_regions')
        plain, every, some = (cv2.imread(str(tmp_path / 'a' / (step + '.png'))).astype(int) for step in steps)
        drawn = [int((np.abs(shown - plain // 2).max(axis=2) > 60).sum()) for shown in (every, some)]
        assert 0 < drawn[1] < drawn[0]

    def test_one_name_in_two_folders(self, tmp_path: Path) -> None:
        paths = []
        for folder, scene in (('day', SCENE), ('night', Scene())):
            (tmp_path / folder).mkdir()
            paths.append(tmp_path / folder / '1.jpg')
            paths[-1].write_bytes(jpeg_of(scene))
        assert show_steps.main([*DEFAULT, '--output', str(tmp_path / 'out'), *map(str, paths)]) == 0
        assert len(list((tmp_path / 'out').rglob('contact_sheet.png'))) == 2

    def test_a_broken_picture(self, pictures: Path, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        broken = tmp_path / 'broken.jpg'
        broken.write_bytes(b'junk')
        out = tmp_path / 'out'
        assert show_steps.main([*DEFAULT, '--output', str(out), str(broken), str(pictures / 'b.jpg')]) == 1
        assert str(broken) in sentence('show_steps')
        assert (out / 'b' / 'contact_sheet.png').exists()


class TestBagsAndImages:
    def test_pictures_to_a_bag_and_back(self, pictures: Path, tmp_path: Path) -> None:
        bag = tmp_path / 'made.bag'
        call = ['--output', str(bag), '--vehicle', 'duck1', '--rate', '3', str(pictures)]
        assert images_to_bag.main(call) == 0
        with rosbag.Bag(str(bag)) as content:
            found = [(topic, nanoseconds(msg), time.to_nsec(), msg) for topic, msg, time in content.read_messages()]
        assert {topic for topic, _, _, _ in found} == {'/duck1/camera_node/image/compressed'}
        assert [stamp for _, stamp, _, _ in found] == [1_000_000_000, 1_333_333_333, 1_666_666_667]
        assert all(stamp == time for _, stamp, time, _ in found)
        assert {msg.format for _, _, _, msg in found} == {'jpeg'}
        assert bag_to_images.main([str(bag), '--output', str(tmp_path / 'back')]) == 0
        names = sorted(os.listdir(tmp_path / 'back'))
        assert names == ['1_000000000.jpg', '1_333333333.jpg', '1_666666667.jpg']
        for name, original in zip(names, ('a.jpg', 'b.jpg', 'c.jpg')):
            assert (tmp_path / 'back' / name).read_bytes() == (pictures / original).read_bytes()

    def test_every_nth_picture_of_a_bag(self, bag: str, tmp_path: Path) -> None:
        assert bag_to_images.main([bag, '--output', str(tmp_path), '--every', '100']) == 0
        assert sorted(os.listdir(tmp_path)) == ['1_000000000.jpg', '4_333333333.jpg', '7_666666667.jpg']

    def test_raw_pictures_of_a_bag(self, tmp_path: Path) -> None:
        path, picture = str(tmp_path / 'raw.bag'), picture_of()
        with rosbag.Bag(path, 'w') as content:
            msg = Image(encoding='bgr8', width=640, height=480, step=1920, data=picture.tobytes())
            msg.header.stamp.secs = 5
            content.write('/duck1/camera_node/image', msg)
        assert bag_to_images.main([path, '--output', str(tmp_path / 'out')]) == 0
        back = cv2.imread(str(tmp_path / 'out' / '5_000000000.jpg'))
        assert np.abs(back.astype(int) - picture).mean() < 4

    @pytest.mark.parametrize('rate', ['0', '-1', 'nan'])
    def test_rates_that_are_none(
        self, rate: str, pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture
    ) -> None:
        with pytest.raises(SystemExit, match='2'):
            images_to_bag.main(['--output', str(tmp_path / 'x.bag'), '--rate', rate, str(pictures)])
        assert '--rate: %s, expected 0.001 to 1000' % rate in capsys.readouterr().err
        assert not (tmp_path / 'x.bag').exists()

    def test_nothing_is_overwritten(self, pictures: Path, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        path = tmp_path / 'there.bag'
        path.write_text('precious')
        assert images_to_bag.main(['--output', str(path), str(pictures)]) == 1
        assert '%s exists' % path in sentence('images_to_bag')
        assert path.read_text() == 'precious'

    def test_a_picture_that_is_none(self, pictures: Path, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        broken, bag = tmp_path / 'broken.jpg', str(tmp_path / 'made.bag')
        broken.write_bytes(b'junk')
        assert images_to_bag.main(['--output', bag, str(broken), str(pictures / 'a.jpg')]) == 1
        assert str(broken) in sentence('images_to_bag')
        assert recording.open_bag(bag).pictures == 1

    def test_every_none(self, bag: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
        with pytest.raises(SystemExit, match='2'):
            bag_to_images.main([bag, '--output', str(tmp_path), '--every', '0'])
        assert '--every: 0, expected a whole number >= 1' in capsys.readouterr().err

    def test_pictures_of_one_stamp_are_all_kept(self, bag: str, tmp_path: Path) -> None:
        source, folder = str(tmp_path / 'same.bag'), tmp_path / 'out'
        with rosbag.Bag(bag) as old, rosbag.Bag(source, 'w') as new:
            topic = '/simulated/camera_node/image/compressed'
            for index, (_, msg, time) in enumerate(old.read_messages(topics=[topic])):
                msg.header.stamp.secs = msg.header.stamp.nsecs = 0
                new.write(topic, msg, time)
                if index == 2:
                    break
        assert bag_to_images.main([source, '--output', str(folder)]) == 0
        assert len(os.listdir(folder)) == 3

    def test_a_topic_that_is_no_picture(self, bag: str, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        topic = '/simulated/lane_filter_node/lane_pose'
        assert bag_to_images.main([bag, '--output', str(tmp_path), '--topic', topic]) == 1
        assert 'has no pictures' in sentence('bag_to_images')


class TestRunBag:
    @pytest.fixture(scope='class')
    def ran(self, bag: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
        """Folder with what run_bag wrote of the simulated drive."""
        folder = tmp_path_factory.mktemp('ran')
        call = [*DEFAULT, bag, '--output', str(folder / 'out.bag'), '--json', str(folder / 'summary.json')]
        assert run_bag.main(call) == 0
        return folder

    def test_it_stops_and_is_released(self, ran: Path) -> None:
        summary = json.loads((ran / 'summary.json').read_text())
        assert (summary['pictures'], summary['pictures_answered'], summary['pictures_skipped']) == (
            PICTURES,
            PICTURES,
            0,
        )
        assert summary['stops'] == 1
        assert summary['releases'] == 1
        assert summary['activations'] == 2, 'the duckie in the lane, and the one at the side'
        assert summary['faults'] == 0

    def test_it_writes_what_the_nodes_would_publish(self, ran: Path) -> None:
        with rosbag.Bag(str(ran / 'out.bag')) as content:
            topics = {
                name: (info.msg_type, info.message_count) for name, info in content.get_type_and_topic_info()[1].items()
            }
            stamps = {name: [nanoseconds(msg) for _, msg, _ in content.read_messages(topics=[name])] for name in topics}
        kind, poses = topics.pop('/simulated/obstacle_detection_node/lane_pose')
        assert kind in ('obst_avoid/LanePose', 'duckietown_msgs/LanePose')
        assert 0.9 * PICTURES <= poses <= PICTURES  # only while lines are seen
        prefix = '/simulated/obstacle_avoidance_node/'
        flag_type = topics[prefix + 'obstacle_avoidance_active_flag'][0]
        assert flag_type in ('obst_avoid/BoolStamped', 'duckietown_msgs/BoolStamped')
        assert topics == {
            '/simulated/obstacle_detection_node/posearray': ('geometry_msgs/PoseArray', PICTURES),
            prefix + 'lane_control': ('obst_avoid/LaneControl', PICTURES),
            prefix + 'obstacle_avoidance_active_flag': (flag_type, PICTURES),
        }
        wanted = [10**9 + round(index * 10**9 / 30) for index in range(PICTURES)]
        posed = stamps.pop('/simulated/obstacle_detection_node/lane_pose')
        assert posed == [stamp for stamp in wanted if stamp in set(posed)]
        assert all(found == wanted for found in stamps.values())

    def test_it_decides_as_core_does(
        self, ran: Path, bag: str, detection_settings: Any, avoidance_settings: Any
    ) -> None:
        detector = detection.start(default_calibration(), detection_settings)
        inputs, memory, wanted = Inputs(), Memory(), []
        with rosbag.Bag(bag) as content:
            for topic, msg, time in content.read_messages():
                if 'lane_pose' in topic:
                    pose = Stamped(nanoseconds(msg), LanePose(msg.d, msg.phi, msg.curvature))
                if 'compressed' in topic:
                    stamp = nanoseconds(msg)
                    seen, detector = detection.detect(detector, decode_jpeg(bytes(msg.data)), stamp)
                    own = None if seen.lane_pose is None else Stamped(stamp, seen.lane_pose)
                    inputs = Inputs(Stamped(stamp, seen.obstacles), pose, own or inputs.own_lane_pose)
                    decision, memory = decide(inputs, memory, time.to_nsec(), avoidance_settings)
                    wanted.append((decision.state.value, decision.d_ref, decision.v_ref, decision.reason))
                    if len(wanted) == CHECKED:
                        break
        with rosbag.Bag(str(ran / 'out.bag')) as content:
            topics = ['/simulated/obstacle_avoidance_node/lane_control']
            found = [msg for _, msg, _ in content.read_messages(topics=topics)]
        assert {state for state, _, _, _ in wanted} == {0, 1, 3}
        for msg, (state, d_ref, v_ref, reason) in zip(found, wanted):
            assert (msg.state, msg.reason) == (state, reason)
            assert (msg.d_ref, msg.v_ref) == (pytest.approx(d_ref, abs=1e-6), pytest.approx(v_ref, abs=1e-6))

    def test_motion_goes_in_and_our_own_lane_pose_comes_out(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        jpeg, told = jpeg_of(), []
        with rosbag.Bag(str(tmp_path / 'in.bag'), 'w') as content:
            for number in range(4):
                now = border.ros_time(10**9 + number * 10**8)
                content.write(
                    '/duck1/lane_controller_node/car_cmd', messages.Twist2DStamped(Header(stamp=now), 0.25, 0.5), now
                )
                picture = border.compressed_image_from_jpeg(jpeg, 10**9 + number * 10**8, 'camera')
                content.write('/duck1/camera_node/image/compressed', picture, now)

        def detect(detector: Any, picture: Any, stamp: int, commands: Any) -> Any:
            told.append([(command.stamp, command.value) for command in commands])
            seen = stamp > 1_150_000_000
            return Shown([], LanePose(0.25, 0.5, 1.0, (1.0, 0.5, 0.5, 2.0)) if seen else None), detector

        monkeypatch.setattr(detection, 'detect', detect)
        assert run_bag.main([*DEFAULT, str(tmp_path / 'in.bag'), '--output', str(tmp_path / 'out.bag')]) == 0
        assert told[2] == [(10**9 + number * 10**8, Command(0.25, 0.5)) for number in range(3)]
        with rosbag.Bag(str(tmp_path / 'out.bag')) as content:
            poses = [msg for _, msg, _ in content.read_messages(topics=['/duck1/obstacle_detection_node/lane_pose'])]
        assert [nanoseconds(msg) for msg in poses] == [1_200_000_000, 1_300_000_000]
        assert tuple(poses[0].d_phi_covariance) == (1.0, 0.5, 0.5, 2.0)
        assert (poses[0].d, poses[0].phi, poses[0].curvature) == (0.25, 0.5, 1.0)

    def test_the_stage_can_be_chosen(self, tmp_path: Path) -> None:
        jpeg = jpeg_of(Scene((Thing(Kind.DUCKIE, 0.38, -0.09, 0.03),)))
        for index in range(8):
            (tmp_path / ('%d.jpg' % index)).write_bytes(jpeg)
        bag = str(tmp_path / 'beside.bag')
        assert images_to_bag.main(['--output', bag, str(tmp_path)]) == 0
        stops = {}
        for stage in ('avoid_single', 'stop_only'):
            out = tmp_path / (stage + '.json')
            assert run_bag.main([*DEFAULT, bag, '--stage', stage, '--json', str(out)]) == 0
            stops[stage] = json.loads(out.read_text())['stops']
        assert stops == {'avoid_single': 0, 'stop_only': 1}

    def test_a_bag_without_lane_pose_is_taken_and_said(
        self, pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture
    ) -> None:
        bag = str(tmp_path / 'plain.bag')
        assert images_to_bag.main(['--output', bag, str(pictures)]) == 0
        assert run_bag.main([*DEFAULT, bag, '--json', str(tmp_path / 's.json')]) == 0
        assert 'no lane pose: taking d = phi = 0' in capsys.readouterr().err
        summary = json.loads((tmp_path / 's.json').read_text())
        assert (summary['pictures_answered'], summary['faults']) == (3, 0)

    def test_a_broken_picture_is_named_and_skipped(self, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
        bag = str(tmp_path / 'made.bag')
        folder = tmp_path / 'pictures'
        folder.mkdir()
        for index in range(3):
            (folder / ('%d.jpg' % index)).write_bytes(jpeg_of())
        assert images_to_bag.main(['--output', bag, str(folder)]) == 0
        spoilt = str(tmp_path / 'spoilt.bag')
        with rosbag.Bag(bag) as old, rosbag.Bag(spoilt, 'w') as new:
            for index, (topic, msg, time) in enumerate(old.read_messages()):
                msg.data = msg.data[:2000] if index == 1 else msg.data
                new.write(topic, msg, time)
        assert run_bag.main([*DEFAULT, spoilt, '--json', str(tmp_path / 's.json')]) == 1
        assert '1.033 s: the picture of 2000 bytes has no end marker' in capsys.readouterr().err
        summary = json.loads((tmp_path / 's.json').read_text())
        assert (summary['pictures'], summary['pictures_answered'], summary['pictures_skipped']) == (3, 2, 1)

    def test_a_bag_of_two_robots(self, pictures: Path, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        two = str(tmp_path / 'two.bag')
        for name in ('duck1', 'duck2'):
            made = str(tmp_path / (name + '.bag'))
            assert images_to_bag.main(['--output', made, '--vehicle', name, str(pictures)]) == 0
            with rosbag.Bag(made) as old, rosbag.Bag(two, 'w' if name == 'duck1' else 'a') as new:
                for topic, msg, time in old.read_messages():
                    new.write(topic, msg, time)
        assert run_bag.main([*DEFAULT, two]) == 1
        assert '/duck1/camera_node/image/compressed, /duck2/camera_node/image/compressed' in sentence('run_bag')
        assert run_bag.main([*DEFAULT, two, '--robot', 'duck2', '--output', str(tmp_path / 'out.bag')]) == 0
        with rosbag.Bag(str(tmp_path / 'out.bag')) as content:
            assert all(name.startswith('/duck2/') for name in content.get_type_and_topic_info()[1])

    def test_bags_that_are_none(self, bag: str, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        (tmp_path / 'text.bag').write_text('not a bag')
        (tmp_path / 'empty.bag').write_bytes(b'')
        (tmp_path / 'half.bag').write_bytes(Path(bag).read_bytes()[:1_000_000])
        with rosbag.Bag(str(tmp_path / 'blind.bag'), 'w') as content:
            content.write('/duck1/lane_filter_node/lane_pose', messages.LanePose())
        for name, words in (
            ('missing.bag', 'does not exist, expected a bag'),
            ('text.bag', 'cannot be read as a bag'),
            ('empty.bag', 'cannot be read as a bag'),
            ('half.bag', 'cannot be read as a bag'),
            ('blind.bag', 'has no pictures, expected a topic that ends in camera_node/image/compressed'),
        ):
            for module, tool in ((run_bag, 'run_bag'), (bag_to_images, 'bag_to_images')):
                options = DEFAULT if tool == 'run_bag' else ['--output', str(tmp_path / 'out')]
                assert module.main([*options, str(tmp_path / name)]) == 1
                said = sentence(tool)
                assert words in said
                assert str(tmp_path / name) in said

    def test_a_folder_is_not_called_missing(self, pictures: Path, sentence: Callable[[str], str]) -> None:
        assert run_bag.main([*DEFAULT, str(pictures)]) == 1
        assert 'does not exist' not in sentence('run_bag')

    def test_nothing_is_overwritten(self, bag: str, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        path = tmp_path / 'there.bag'
        path.write_text('precious')
        assert run_bag.main([*DEFAULT, bag, '--output', str(path)]) == 1
        assert '%s exists' % path in sentence('run_bag')
        assert path.read_text() == 'precious'


def test_pictures_come_in_the_order_in_which_people_count(tmp_path: Path) -> None:
    names = ['9_99.jpg', '10_00.jpg', '10.5.jpg', '10.25.jpg', 'a2.png', 'a02.png', 'a10.png', 'A1.JPG', 'b.jpeg']
    for name in names:
        (tmp_path / name).touch()
    wanted = ['9_99.jpg', '10_00.jpg', '10.25.jpg', '10.5.jpg', 'A1.JPG', 'a02.png', 'a2.png', 'a10.png', 'b.jpeg']
    assert picture_files([str(tmp_path)]) == [str(tmp_path / name) for name in wanted]


def test_a_folder_as_a_recording(pictures: Path, tmp_path: Path) -> None:
    folder = tmp_path / 'pictures'
    shutil.copytree(str(pictures), str(folder))
    (folder / 'aa.png').write_bytes(b'\x89PNG\r\n\x1a\njunk')
    opened = recording.open_folder(str(folder), 10.0)
    assert (opened.pictures, opened.picture_role) == (4, recording.JPEG)
    items = list(recording.messages(opened))
    assert [item.time for item in items] == [1_000_000_000, 1_100_000_000, 1_200_000_000, 1_300_000_000]
    assert [nanoseconds(item.msg) for item in items] == [item.time for item in items]
    assert [os.path.basename(path) for path in opened.files] == ['a.jpg', 'aa.png', 'b.jpg', 'c.jpg']
    assert bytes(items[0].msg.data) == (pictures / 'a.jpg').read_bytes()
    assert bytes(items[1].msg.data) == b'', 'what is no picture is passed on as nothing'


def test_the_demo_on_a_folder_of_pictures(tmp_path: Path) -> None:
    # The whole graph, on a master of its own: replay.launch with images:=.
    folder = tmp_path / 'pictures'
    folder.mkdir()
    jpeg = jpeg_of(Scene((Thing(Kind.DUCKIE, 0.42, 0.0),)))
    for index in range(12):
        (folder / ('%02d.jpg' % index)).write_bytes(jpeg)
    ended = run_program(
        ['rosrun', 'obst_avoid', 'demo', '--output', str(tmp_path / 'out'), '--images', str(folder)], 120
    )
    assert ended.code == 0, ended.output
    assert 'Traceback' not in ended.output
    assert 'no lane pose' in ended.output
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert summary['pictures'] == 12
    assert summary['pictures_answered'] >= 10
    assert summary['stops'] == 1
    assert cv2.imread(str(tmp_path / 'out' / 'contact_sheet.png')) is not None
    assert 'stops' in ended.output


def test_the_compiled_path_is_built() -> None:
    """Without it everything passes, by numpy, and no robot is fast enough."""
    assert native.LIBRARY is not None


def test_bench(tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    threads = cv2.getNumThreads()
    monkeypatch.setattr(bench_run_bag, 'PICTURES', 30)
    output = tmp_path / 'new' / 'bench.json'
    try:
        assert bench.main(['--count', '3', '--graph-seconds', '3', '--output', str(output)]) == 0
    finally:
        cv2.setNumThreads(threads)
    result = json.loads(output.read_text())
    assert result['pictures'] == 3
    assert '1' in result['threads']
    for figures in result['threads'].values():
        assert set(figures['robust']) >= {'decode', 'light', 'regions', 'values', 'candidates', 'lane', 'obstacles'}
        assert set(figures['paper']) >= {'decode', 'corrected', 'bird_view', 'blobs', 'obstacles'}
        for stages in (figures['robust'], figures['paper'], {'': figures['paper as deployed in 2018']}):
            for values in stages.values():
                assert 0 < values['median_ms'] <= values['p95_ms'] <= values['p99_ms']
    assert set(result['blobs']) == {'robust', 'paper'}
    assert all(list(values) == ['0', '3', '30', '100', '300'] for values in result['blobs'].values())
    assert set(result['sizes']) == {'320x240', '640x480', '960x720', '1280x960'}
    assert 20 < result['start']['memory_mb'] < 1000
    assert set(result['run_bag']) == {'1', '2', 'with_start'}
    for processes, with_start in result['run_bag']['with_start'].items():
        assert 0 < with_start < result['run_bag'][processes]
    graph = result['graph']
    assert graph['published'] == 90
    assert graph['answered'] > 0
    assert graph['published'] == graph['answered'] + graph['dropped']
    assert graph['twice'] == 0
    latency = graph['latency']
    assert 0 < latency['median_ms'] <= latency['p95_ms'] <= latency['p99_ms'] <= graph['oldest_ms']
    assert set(graph['cpu_share']) == {'obstacle_detection_node', 'obstacle_avoidance_node'}
    assert all(share > 0 for share in graph['cpu_share'].values())
    assert all(20 < memory < 1000 for memory in graph['memory_mb'].values())
    printed = capsys.readouterr().out
    assert 'x decoding' in printed
    assert 'processed twice' in printed
    assert 'ratio' not in printed
    picture = tmp_path / 'picture.jpg'
    cv2.imwrite(str(picture), picture_of(SCENE))
    try:
        assert bench.main(['--count', '3', '--graph-seconds', '0', '--compare', str(output), str(picture)]) == 0
    finally:
        cv2.setNumThreads(threads)
    assert 'robust, component trees' in capsys.readouterr().out


def test_bench_counts_what_became_of_the_pictures() -> None:
    ms = 1_000_000
    stamps = [1000 * ms, 1033 * ms, 1066 * ms, 1099 * ms]
    seen = [(967, 980), (1000, 1010), (1000, 1020), (1066, 1080), (1099, 1110)]
    decided = [(967, 982), (967, 1002), (1000, 1012), (1000, 1062), (1066, 1082), (1099, 1112), (1099, 1400)]
    arrivals = [[(stamp * ms, time * ms) for stamp, time in messages] for messages in (seen, decided)]
    figures = bench_graph.counts(stamps, *arrivals)
    assert {name: figures[name] for name in ('published', 'answered', 'dropped', 'twice', 'repeated', 'oldest_ms')} == {
        'published': 4,
        'answered': 3,
        'dropped': 1,
        'twice': 1,
        'repeated': 1,  # the one of 1099 again comes when no picture does any more
        'oldest_ms': 62,
    }
    assert figures['latency']['median_ms'] == 13


def test_bench_of_a_graph_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    mark = 'BENCH_TEST=%d' % os.getpid()
    monkeypatch.setenv(*mark.split('='))
    options = argparse.Namespace(vehicle='', calibration='', profile='', stage='nonsense', graph_seconds=1.0)
    with pytest.raises(ToolError, match='the graph does not answer: a node died, after: .*nonsense'):
        bench_graph.bench_graph(options, [jpeg_of()])
    left = []
    for environ in Path('/proc').glob('[0-9]*/environ'):
        with contextlib.suppress(OSError):  # another user's, or gone meanwhile
            if mark.encode() in environ.read_bytes().split(b'\0'):
                left.append(environ)
    assert left == []


def test_bench_against_what_it_did_not_write(tmp_path: Path, sentence: Callable[[str], str]) -> None:
    (tmp_path / 'other.json').write_text('{"threads": {}}')
    assert bench.main(['--compare', str(tmp_path / 'other.json')]) == 1
    assert 'is no file that bench wrote' in sentence('bench')


@pytest.mark.parametrize(('module', 'arguments'), [(simulated_bag, ['x.bag']), (bench, [])])
def test_without_opengl(
    module: Any, arguments: List[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, sentence: Callable[[str], str]
) -> None:
    def refuse(*_: Any) -> None:
        raise RenderError('OpenGL is not to be had')

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(simulated_bag, 'Renderer', refuse)
    assert module.main(arguments) == 1
    assert 'OpenGL is not to be had' in sentence(module.__name__.split('.')[-1])
    assert not (tmp_path / 'x.bag').exists()


def test_bench_of_a_picture_that_is_cut_off(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / 'cut.jpg').write_bytes(jpeg_of()[:-5000])
    assert bench.main(['--output', str(tmp_path / 'bench.json'), str(tmp_path / 'cut.jpg')]) == 1
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith('bench: %s: the picture of ' % (tmp_path / 'cut.jpg'))
    assert not (tmp_path / 'bench.json').exists()


def test_bench_keeps_what_it_has_measured(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def measure(options: Any, calibration: Any, pictures: Any, result: Dict[str, Any]) -> None:
        result['pictures'] = options.count
        raise ToolError('the graph does not answer')

    monkeypatch.setattr(bench, '_measure', measure)
    (tmp_path / 'a.jpg').write_bytes(jpeg_of())
    assert bench.main(['--count', '3', '--output', str(tmp_path / 'bench.json'), str(tmp_path / 'a.jpg')]) == 1
    assert json.loads((tmp_path / 'bench.json').read_text()) == {'pictures': 3}


def test_bench_of_nothing(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit, match='2'):
        bench.main(['--count', '0'])
    assert '--count: 0, expected a whole number >= 1' in capsys.readouterr().err
