"""The simulation's tools, run_scenarios, render_dataset, drive_report: what they write, and one-sentence errors."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import json
import math
import os
import sys
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import cv2
import numpy as np
import pytest
import rosbag
import rospy
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from helpers import Ended, compressed_image, jpeg_of, pose_array, run_program
from std_msgs.msg import Float32, Header, String
from unit.cameras import ROBOT, Camera, extrinsic_file, intrinsic_file, write_files
from unit.drives import mapping, thing
from visualization_msgs.msg import MarkerArray

from obst_avoid import msg as messages
from obst_avoid.core.avoidance.corridor import View
from obst_avoid.core.types import Decision, State
from obst_avoid.offline import drive_report, render_dataset, run_scenarios
from obst_avoid.ros.markers import markers_from_decision

PICTURE_RATE = 10


def ran(tool: str, arguments: Sequence[Any], seconds: float = 200.0) -> Ended:
    """A tool run as a program of its own, without the start of rosrun."""
    code = 'import sys; from obst_avoid.offline import {0}; sys.exit({0}.main(sys.argv[1:]))'.format(tool)
    return run_program([sys.executable, '-c', code, *map(str, arguments)], seconds)


@pytest.fixture(scope='module')
def camera(tmp_path_factory: pytest.TempPathFactory) -> List[str]:
    """Options that name a small camera."""
    folder, small = tmp_path_factory.mktemp('calibration'), Camera().resized(320, 240)
    write_files(folder, intrinsic_file(small), extrinsic_file(small))
    return ['--calibration', str(folder), '--vehicle', ROBOT]


def frames_of(path: Path) -> List[Any]:
    """All pictures of a film."""
    film, found = cv2.VideoCapture(str(path)), []
    while True:
        there, picture = film.read()
        if not there:
            return found
        found.append(picture)


class TestRunScenarios:
    @pytest.fixture(scope='class')
    def done(self, camera: List[str], tmp_path_factory: pytest.TempPathFactory) -> Tuple[Path, Ended, Dict[str, Any]]:
        """Two short episodes that fail, by two processes: folder, terminal, scenarios.json."""
        folder = tmp_path_factory.mktemp('scenarios')
        content = mapping(duration=0.9, success={'must': 'arrive', 'goal': 2.0})
        content['start'] = {**content['start'], 'along': {'from': 0.3, 'to': 0.6}}
        (folder / 'tiny.yaml').write_text(json.dumps(content))
        output = folder / 'new' / 'out'
        options = ['--count', 2, '--seed', 7, '--jobs', 2, '--picture-rate', PICTURE_RATE, '--output', output]
        ended = ran('run_scenarios', [*camera, *options, folder / 'tiny.yaml'])
        assert ended.code == 0, ended.output
        return output, ended, json.loads((output / 'scenarios.json').read_text())

    def test_episodes(self, done: Any) -> None:
        output, _, content = done
        assert set(content) == {'families', 'episodes', 'options'}
        one, other = content['episodes']
        assert [one['seed'], other['seed']] == [7, 8]
        for episode in (one, other):
            assert (episode['scenario'], episode['success'], episode['contact']) == ('tiny', False, None)
            assert episode['why'].startswith('ran out of time after 0.1')
            assert episode['seconds'] == pytest.approx(0.9, abs=0.01)
            assert episode['driven'] == pytest.approx(0.14, abs=0.03)
            assert (episode['smallest_gap'], episode['stops'], episode['in_the_way']) == (None, 0, False)
            assert episode['film'] == str(output / ('tiny_%d.mp4' % episode['seed']))
        assert one['driven'] != other['driven']

    def test_families(self, done: Any) -> None:
        family = done[2]['families']['tiny']
        assert (family['episodes'], family['success'], family['contacts']) == (2, [0, 0, 0.8419], [0, 0, 0.8419])
        assert (family['stops'], family['false_stops'], family['smallest_gap_m']) == (0, 0, None)
        assert family['metres'] == pytest.approx(sum(item['driven'] for item in done[2]['episodes']), abs=0.06)

    def test_the_terminal(self, done: Any) -> None:
        output, ended, content = done
        lines = ended.output.splitlines()
        assert any(line.startswith('family ') for line in lines)
        rows = [line.split() for line in lines if line.startswith('tiny ')]
        assert rows == ['tiny 2 0 (0 to 84) 0 (0 to 84) 0:0 0 0 0 - - 0.0 - 0 0'.split()]
        assert str(output / 'scenarios.json') in lines
        assert 'tiny, seed 8: ' + content['episodes'][1]['why'] in lines

    def test_films_of_failures(self, done: Any) -> None:
        for seed in (7, 8):
            film = frames_of(done[0] / ('tiny_%d.mp4' % seed))
            assert len(film) == 9, 'pictures of 0 to 0.8 s, the last one answered'
            assert film[0].shape == (640, 1120, 3) and film[0].std() > 10

    def test_one_process_comes_to_the_same(self, done: Any, camera: List[str], tmp_path: Path) -> None:
        scenario = done[0].parents[1] / 'tiny.yaml'
        options = ['--seed', '8', '--picture-rate', str(PICTURE_RATE), '--output', str(tmp_path), '--films', 'none']
        assert run_scenarios.main([*camera, *options, str(scenario)]) == 0
        (episode,) = json.loads((tmp_path / 'scenarios.json').read_text())['episodes']
        assert {**episode, 'film': 0} == {**done[2]['episodes'][1], 'film': 0}
        assert not [name for name in os.listdir(tmp_path) if name.endswith('.mp4')]

    @pytest.mark.parametrize(
        'options, words',
        [
            (['nowhere'], 'nowhere is no scenario, expected a YAML file or one of: blocking_straight, crossing, '),
            (['--pose-errors', 'perfect', 'sudden'], "pose_errors = 'perfect', expected one of: clean, real"),
            (['--light', 'mauve', 'sudden'], "light/color = 'mauve', expected one of: "),
            (['--calibration', '/nowhere', '--vehicle', 'duck1', 'sudden'], '/nowhere'),
            (['--config', '/nowhere', 'sudden'], '/nowhere'),
        ],
        ids=['scenario', 'pose errors', 'light', 'calibration', 'config'],
    )
    def test_one_sentence(self, options: List[str], words: str, sentence: Callable[[str], str]) -> None:
        assert run_scenarios.main(options) == 1
        assert words in sentence('run_scenarios')

    def test_a_folder_of_a_scenarios_name(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sentence: Callable[[str], str]
    ) -> None:
        (tmp_path / 'sudden').mkdir()
        monkeypatch.chdir(tmp_path)
        assert run_scenarios.main(['--pose-errors', 'perfect', 'sudden']) == 1
        assert 'pose_errors' in sentence('run_scenarios'), 'the folder is not taken for the scenario'

    def test_two_of_one_name(self, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        own = tmp_path / 'sudden.yaml'
        own.write_text(json.dumps(mapping()))
        assert run_scenarios.main(['sudden', str(own)]) == 1
        said = sentence('run_scenarios')
        assert '%s have one name, expected different ones' % own in said

    @pytest.mark.parametrize(
        'options', [['--count', '0'], ['--jobs', '0'], ['--films', 'some'], ['--picture-rate', '0'], ['--seed', '-1']]
    )
    def test_wrong_use(self, options: List[str], capsys: pytest.CaptureFixture) -> None:
        with pytest.raises(SystemExit, match='2'):
            run_scenarios.main([*options, 'sudden'])
        assert options[0] in capsys.readouterr().err


@pytest.mark.parametrize(
    'part, whole, low, high',
    [
        (0, 50, 0.0, 0.0711), (50, 50, 0.9289, 1.0), (25, 50, 0.3553, 0.6447), (1, 20, 0.0013, 0.2487),
        (0, 1, 0.0, 0.975), (10, 10, 0.6915, 1.0),
    ],
)  # fmt: skip
def test_shares_and_their_intervals(part: int, whole: int, low: float, high: float) -> None:
    # published tables of Clopper and Pearson
    assert run_scenarios.share(part, whole) == pytest.approx([part / whole, low, high], abs=1e-4)


def test_a_share_of_nothing() -> None:
    share, low, high = run_scenarios.share(0, 0)
    assert math.isnan(share) and (low, high) == (0.0, 1.0)


def drive(**changes: Any) -> Dict[str, Any]:
    """One outcome as run_scenarios keeps it."""
    return {
        'success': True, 'contact': None, 'in_the_way': True, 'smallest_gap': 0.3, 'seconds': 10.0, 'driven': 1.0,
        'stops': 1, 'activations': 1, 'false_stops': 0, 'off_lane': 0.0, 'restart': None,
        'sightings': {'of': {}, 'invented': 0}, **changes,
    }  # fmt: skip


def test_summarise() -> None:
    touched = {'success': False, 'contact': {'time': 1.0}}
    found = run_scenarios.summarise([
        drive(), drive(smallest_gap=0.1, off_lane=2.0, stops=3, false_stops=2, activations=4),
        drive(in_the_way=False, smallest_gap=None, driven=-0.5, stops=0, activations=0),
        drive(**touched, smallest_gap=0.0), drive(**touched, in_the_way=False, smallest_gap=0.0),
    ])  # fmt: skip
    assert (found['episodes'], found['success'][0], found['contacts'][0]) == (5, 0.6, 0.4)
    assert found['success'][1:] == pytest.approx([0.1466, 0.9473], abs=1e-4)
    assert found['avoided_to_hit'] == [2, 2], 'met three, avoided two; one was hit from outside the lane'
    assert (found['stops'], found['activations'], found['false_stops'], found['metres']) == (6, 7, 2, 4.0)
    assert (found['smallest_gap_m'], found['median_gap_m'], found['off_lane_share']) == (0.0, 0.2, 0.04)
    assert found['restart'] is None, 'nothing went away'
    waited = run_scenarios.summarise([drive(restart=wait) for wait in (1.0, 2.0, 2.01, None)])
    assert waited['restart'][0] == pytest.approx(2 / 3, abs=1e-3)


def test_a_table_of_families() -> None:
    rows = run_scenarios.table({
        'far': run_scenarios.summarise([drive()]), 'none': run_scenarios.summarise([drive(smallest_gap=None)]),
    }).splitlines()  # fmt: skip
    assert len(rows) == 3
    assert rows[1].split() == 'far 1 100 (2 to 100) 0 (0 to 98) 1:0 1 1 0 0.300 0.300 0.0 - 0 0'.split()
    assert rows[2].split()[-6:] == ['-', '-', '0.0', '-', '0', '0']


def test_how_well_the_detector_kept_track() -> None:
    def thing(since: float, after: Optional[float], lost: int = 0) -> Dict[str, Any]:
        return {'since': since, 'after': after, 'lost': lost, 'seen': True}

    found = run_scenarios.summarise([
        drive(sightings={'of': {0: thing(1.0, 0.2, 3), 2: thing(2.0, 0.3)}, 'invented': 2}),
        drive(sightings={'of': {0: thing(1.0, 0.0), 1: thing(1.0, None, 1), 2: thing(9.9, None)}, 'invented': 1}),
    ])  # fmt: skip
    assert found['prompt'][0] == 0.5, 'two of four; one came into view when all was over'
    assert (found['lost'], found['invented']) == (4, 3)
    assert run_scenarios.table({'one': found}).splitlines()[1].split()[-3:] == ['50', '4', '3']


def decoded(segmentation: Dict[str, Any]) -> Any:
    """(H, W) bool, run by run down the columns."""
    height, width = segmentation['size']
    pixels, value = [], False
    for count in segmentation['counts']:
        pixels += [value] * count
        value = not value
    assert len(pixels) == height * width
    return np.array([[pixels[column * height + row] for column in range(width)] for row in range(height)])


@pytest.mark.parametrize(
    'rows, counts',
    [
        (['..', '..', '..'], [6]),
        (['##', '##', '##'], [0, 6]),
        (['#.', '..', '..'], [0, 1, 5]),
        (['..', '#.', '..'], [1, 1, 4]),
        (['..', '..', '.#'], [5, 1]),
        (['.#', '##', '#.'], [1, 4, 1]),
    ],
)
def test_run_lengths(rows: List[str], counts: List[int]) -> None:
    mask = np.array([[pixel == '#' for pixel in row] for row in rows])
    found = render_dataset.run_lengths(mask)
    assert found == {'size': [3, 2], 'counts': counts}
    assert (decoded(found) == mask).all()


def test_run_lengths_of_anything() -> None:
    random = np.random.RandomState(1)
    for share in (0.1, 0.5, 0.9):
        mask = random.uniform(size=(7, 11)) < share
        assert (decoded(render_dataset.run_lengths(mask)) == mask).all()


class TestRenderDataset:
    CALL = ('--layouts', 'straight', '--lights', 'warm', 'red', '--distances', '0.6', '0.3')

    @pytest.fixture(scope='class')
    def done(self, camera: List[str], tmp_path_factory: pytest.TempPathFactory) -> Tuple[Path, Ended, Dict[str, Any]]:
        """Four pictures by two processes: folder, terminal, labels.json."""
        output = tmp_path_factory.mktemp('dataset') / 'new'
        call = [*camera, *self.CALL, '--count', 4, '--seed', 3, '--jobs', 2, '--output', output]
        ended = ran('render_dataset', call)
        assert ended.code == 0, ended.output
        return output, ended, json.loads((output / 'labels.json').read_text())

    def test_pictures_and_their_labels(self, done: Any) -> None:
        output, ended, labels = done
        images, annotations = labels['images'], labels['annotations']
        assert [image['file_name'] for image in images] == ['%06d.jpg' % index for index in range(4)]
        assert sorted(os.listdir(output / 'images')) == [image['file_name'] for image in images]
        assert '4 pictures, %d obstacles: %s' % (len(annotations), output / 'labels.json') in ended.output
        for image in images:
            picture = cv2.imread(str(output / 'images' / image['file_name']))
            assert picture.shape == (image['height'], image['width'], 3) == (240, 320, 3)

    def test_ids_are_unique_and_meet(self, done: Any) -> None:
        labels = done[2]
        for name in ('images', 'annotations', 'categories'):
            ids = [item['id'] for item in labels[name]]
            assert len(set(ids)) == len(ids) > 0
        assert {item['image_id'] for item in labels['annotations']} <= {item['id'] for item in labels['images']}
        names = {item['id']: item['name'] for item in labels['categories']}
        for item in labels['annotations']:
            assert names[item['category_id']] == ('duckie' if item['sort'] == 'duckie' else 'cone')

    def test_boxes_and_masks(self, done: Any) -> None:
        assert len(done[2]['annotations']) >= 2
        for item in done[2]['annotations']:
            mask = decoded(item['segmentation'])
            rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
            left, top, width, height = item['bbox']
            assert (left, top) == (columns[0], rows[0])
            assert (left + width, top + height) == (columns[-1] + 1, rows[-1] + 1)
            assert left >= 0 and top >= 0 and left + width <= 320 and top + height <= 240
            assert item['area'] == mask.sum() > 0
            assert mask.shape == (240, 320) and item['iscrowd'] == 0

    def test_only_what_was_asked_for(self, done: Any) -> None:
        images = done[2]['images']
        assert [image['lighting'] for image in images] == ['warm', 'red'] * 2
        assert {image['layout'] for image in images} == {'straight'}
        for item in done[2]['annotations']:
            pose = images[item['image_id'] - 1]['lane_pose']
            # the nearest point is up to a radius nearer than the middle, which is 0.3 to 0.6 m ahead along the lane
            ray = math.hypot(item['x'], item['y'])
            x, y = (value * (ray + item['radius']) / ray for value in (item['x'], item['y']))
            ahead = math.cos(pose['phi']) * x - math.sin(pose['phi']) * y
            assert 0.27 < ahead < 0.63

    def test_the_same_again_by_one_process(self, done: Any, camera: List[str], tmp_path: Path) -> None:
        output = tmp_path / 'again'
        assert render_dataset.main([*camera, *self.CALL, '--count', '2', '--seed', '3', '--output', str(output)]) == 0
        for name in ('000000.jpg', '000001.jpg'):
            assert (output / 'images' / name).read_bytes() == (done[0] / 'images' / name).read_bytes()
        labels = json.loads((output / 'labels.json').read_text())
        assert labels['images'] == done[2]['images'][:2]
        assert labels['annotations'] == [item for item in done[2]['annotations'] if item['image_id'] <= 2]

    @pytest.mark.parametrize(
        'options, words',
        [
            (['--layouts', 'moon'], 'moon is no layout, expected: straight, curve_left, '),
            (['--lights', 'mauve'], "colors = ['mauve'], expected a list of: "),
            (['--settings', '/nowhere.yaml'], '/nowhere.yaml cannot be read'),
            (['--vehicle', 'nobody'], 'nobody'),
            (['--distances', '0.3', 'inf'], "distance = {'from': 0.3, 'to': inf}, expected {from: number, to: number}"),
        ],
        ids=['layout', 'light', 'settings', 'vehicle', 'distances'],
    )
    def test_one_sentence(self, options: List[str], words: str, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        assert render_dataset.main([*options, '--count', '1', '--output', str(tmp_path / 'out')]) == 1
        assert words in sentence('render_dataset')
        assert not (tmp_path / 'out').exists()

    def test_nothing_is_overwritten(self, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        (tmp_path / 'labels.json').write_text('precious')
        assert render_dataset.main(['--count', '1', '--output', str(tmp_path)]) == 1
        assert '%s is not empty, expected a new folder' % tmp_path in sentence('render_dataset')
        assert (tmp_path / 'labels.json').read_text() == 'precious'


FRAME = 'duck1/footprint'
BEGIN = 1000.0
"""[s] when the bag begins."""
DECISIONS = [State.CLEAR, State.CLEAR, State.STOPPED, State.STOPPED, State.CLEAR, State.STOPPED, State.STOPPED]
"""One each tenth of a second, 0.05 s after a picture."""


def plan_of(state: State, stamp: rospy.Time) -> MarkerArray:
    """A corridor straight ahead, as the avoider shows it."""
    corners = np.array([(0.0, 0.1), (1.0, 0.1), (1.0, -0.1), (0.0, -0.1), (0.0, 0.1)])
    view = View(corners, np.array([(0.0, 0.0), (1.0, 0.0)]), None)
    return markers_from_decision(Decision(state, 0.0, 0.0, 'because'), view, stamp.to_nsec(), FRAME)


def write_bag(
    path: Path, pictures: bool = True, truth: bool = True, scenario: str = '', plans: Sequence[int] = ()
) -> str:
    """A drive of 0.6 s, 0.2 m to the east and 0.1 m to the north; two stops, the second one for nothing.

    plans: which decisions are recorded as markers too.
    """
    topic = '/duck1/simulator_node/'
    with rosbag.Bag(str(path), 'w') as bag:
        for index, state in enumerate(DECISIONS):
            stamp = rospy.Time.from_sec(BEGIN + index / 10)
            header = Header(stamp=stamp, frame_id='')

            def write(name: str, msg: Any, late: float = 0.0, stamp: rospy.Time = stamp) -> None:
                bag.write(name, msg, stamp + rospy.Duration.from_sec(late))

            if pictures:
                write('/duck1/camera_node/image/compressed', compressed_image(jpeg_of(), stamp))
            seen = [(0.45, 0.0, 0.03)] if index < 4 else [(0.4, -0.3, -0.03)]
            write('/duck1/obstacle_detection_node/posearray', pose_array(seen, stamp, FRAME), 0.04)
            decision = messages.LaneControl(header, 0.0, 0.2, state is not State.CLEAR, state.value, 'because')
            decision.v_ref = 0.0 if state is State.STOPPED else 0.2
            write('/duck1/obstacle_avoidance_node/lane_control', decision, 0.05)
            if index in plans:
                write('/duck1/obstacle_avoidance_node/markers', plan_of(state, stamp), 0.051)
            write('/duck1/lane_controller_node/car_cmd', messages.Twist2DStamped(header, 0.2, 0.0), 0.055)
            write('/duck1/lane_filter_node/lane_pose', messages.LanePose(header=header, d=0.01 * index), 0.01)
            if truth:
                x, y = (1.0 + 0.05 * index, 2.0) if index < 5 else (1.2, 2.05 if index == 5 else 2.1)
                at = Pose(Point(x, y, 0.0), Quaternion(0.0, 0.0, math.sin(0.4), math.cos(0.4)))
                write(topic + 'truth/pose', PoseStamped(header, at))
                write(topic + 'truth/lane_pose', messages.LanePose(header=header, d=0.02))
                there = [(0.47, 0.0, 0.03)] if index < 4 else [(1.2, 0.0, 0.03), (0.4, -0.3, -0.03)]
                write(topic + 'truth/obstacles', pose_array(there, stamp, FRAME))
                write(topic + 'truth/gap', Float32(0.25 - 0.03 * index))
                write(topic + 'truth/contact', messages.BoolStamped(header, index >= 6))
                write(topic + 'latency', Float32(0.03))
        if scenario:
            bag.write(topic + 'scenario', String(json.dumps({'file': scenario, 'seed': 4})), stamp)
    return str(path)


class TestDriveReport:
    @pytest.fixture(scope='class')
    def done(self, tmp_path_factory: pytest.TempPathFactory) -> Tuple[Path, Dict[str, Any]]:
        """Of a simulated drive: folder, drive.json."""
        folder = tmp_path_factory.mktemp('report')
        scenario = folder / 'tiny.yaml'
        scenario.write_text(json.dumps(mapping(thing(1.0))))
        bag = write_bag(folder / 'drive.bag', scenario=str(scenario))
        assert drive_report.main([bag, '--output', str(folder / 'new' / 'out')]) == 0
        return folder / 'new' / 'out', json.loads((folder / 'new' / 'out' / 'drive.json').read_text())

    def test_what_happened(self, done: Any) -> None:
        summary = done[1]
        assert (summary['pictures'], summary['pictures_answered'], summary['pictures_skipped']) == (7, 7, 0)
        assert (summary['obstacles_inside'], summary['obstacles_outside']) == (4, 3)
        assert (summary['stops'], summary['releases'], summary['activations'], summary['faults']) == (2, 1, 2, 0)
        assert (summary['seconds'], summary['pictures_per_second']) == (0.6, 10.0)

    def test_what_was_true(self, done: Any) -> None:
        summary = done[1]
        # from (1, 2) by (1.2, 2) to (1.2, 2.1)
        assert summary['metres'] == 0.3
        assert (summary['contacts'], summary['smallest_gap_m']) == (1, 0.07)
        assert summary['stops_before_an_obstacle'] == 1, 'the second one has it 1.2 m ahead'
        assert summary['median_latency_ms'] == 30.0, "the simulator's own figure"

    def test_film_and_plot(self, done: Any) -> None:
        film = frames_of(done[0] / 'drive.mp4')
        assert len(film) == 7 and film[0].shape == (640, 1120, 3)
        plot = cv2.imread(str(done[0] / 'drive.png'))
        assert plot is not None and plot.std() > 10
        assert sorted(os.listdir(done[0])) == ['drive.json', 'drive.mp4', 'drive.png']

    def test_the_plan_is_in_the_film(self, tmp_path: Path) -> None:
        films = []
        for name, plans in (('without', []), ('with', [0, 1, 2, 4])):
            bag = write_bag(tmp_path / (name + '.bag'), plans=plans)
            assert drive_report.main([bag, '--output', str(tmp_path / name)]) == 0
            films.append(frames_of(tmp_path / name / 'drive.mp4'))
        changes = [
            np.abs(one[300:470, 300:340].astype(int) - other[300:470, 300:340]).mean() for one, other in zip(*films)
        ]
        assert min(changes) > 10, 'also where the newest plan is a little older than the decision'

    def test_a_plan_of_long_ago_is_not_in_the_film(self, tmp_path: Path) -> None:
        drive = drive_report.read_drive(write_bag(tmp_path / 'drive.bag', plans=[1]))
        (stamp,) = drive.plans
        assert stamp == round((BEGIN + 0.1) * 1e9)
        ages = {late: drive_report.plan_of(drive, [stamp], stamp + late) for late in (-1, 0, 3 * 10**8, 3 * 10**8 + 1)}
        assert [late for late, plan in ages.items() if plan is not None] == [0, 3 * 10**8]

    def test_a_real_drive_has_no_truth(self, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
        bag = write_bag(tmp_path / 'drive.bag', truth=False)
        assert drive_report.main([bag, '--output', str(tmp_path)]) == 0
        summary = json.loads((tmp_path / 'drive.json').read_text())
        assert not {'metres', 'contacts', 'smallest_gap_m', 'stops_before_an_obstacle'} & set(summary)
        assert (summary['stops'], summary['median_latency_ms']) == (2, 50.0)
        assert len(frames_of(tmp_path / 'drive.mp4')) == 7
        assert 'Traceback' not in capsys.readouterr().err

    def test_an_empty_road_has_no_gap(self, tmp_path: Path) -> None:
        path = tmp_path / 'empty.bag'
        stamp = rospy.Time.from_sec(BEGIN)
        with rosbag.Bag(str(path), 'w') as bag:
            bag.write('/duck1/camera_node/image/compressed', compressed_image(jpeg_of(), stamp), stamp)
            bag.write('/duck1/simulator_node/truth/gap', Float32(math.inf), stamp)
            bag.write('/duck1/simulator_node/truth/contact', messages.BoolStamped(), stamp)
        assert drive_report.main([str(path), '--output', str(tmp_path)]) == 0
        text = (tmp_path / 'drive.json').read_text()
        assert 'Infinity' not in text, 'that is no JSON'
        summary = json.loads(text)
        assert (summary['contacts'], summary['smallest_gap_m'], summary['pictures_skipped']) == (0, None, 1)

    def test_one_sentence(self, tmp_path: Path, sentence: Callable[[str], str]) -> None:
        blind = write_bag(tmp_path / 'blind.bag', pictures=False)
        (tmp_path / 'text.bag').write_text('not a bag')
        for path, words in (
            (blind, 'has no pictures, expected a topic that ends in camera_node/image/compressed'),
            (str(tmp_path / 'missing.bag'), 'does not exist, expected a bag'),
            (str(tmp_path / 'text.bag'), 'cannot be read as a bag'),
        ):
            assert drive_report.main([path, '--output', str(tmp_path / 'out')]) == 1
            said = sentence('drive_report')
            assert path in said and words in said
