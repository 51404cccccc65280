"""Label-free checks: flicker, metres, false alarms and contact sheets of sequences with known answers."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import cv2
import numpy as np
import pytest
import rosbag
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from helpers import DUCKIE, jpeg_of
from std_msgs.msg import Header
from unit.drawn import Scene

from obst_avoid import msg as messages
from obst_avoid.core import detection
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.types import Box, Command, Kind, Obstacle
from obst_avoid.core.types import Scene as Shown
from obst_avoid.offline import recording as recordings_files
from obst_avoid.offline.evaluation import recordings
from obst_avoid.offline.evaluation.recordings import Flicker, Odometry, Seen, Sighting
from obst_avoid.offline.tool import ToolError
from obst_avoid.ros import border
from obst_avoid.viz.overlay import INSIDE, contact_sheet

PERIOD = 100_000_000
"""[ns] between the pictures of the sequences made by hand."""
STILL = recordings.Pose()
NOTHING = Flicker()

Places = Sequence[Sequence[Tuple[float, float]]]


def sequence(places: Places, step: Optional[recordings.Pose] = STILL, period: int = PERIOD) -> List[Seen]:
    """Pictures, each with duckies at the given places in m."""
    return [
        Seen(10**9 + period * i, tuple(Sighting('duckie', x, y) for x, y in items), step if i else None)
        for i, items in enumerate(places)
    ]


def flicker_of(places: Places, **more: Any) -> Flicker:
    return recordings.flicker(sequence(places, **more))


HERE, THERE = (0.5, 0.0), (0.5, 0.3)


class TestFlicker:
    @pytest.mark.parametrize(
        ('what', 'places', 'wanted'),
        [
            ('no picture', [], NOTHING),
            ('pictures without anything', [[], [], []], NOTHING),
            ('one picture: nobody can say', [[HERE]], Flicker(tracks=1)),
            ('always there', [[HERE]] * 5, Flicker(tracks=1, judged=1, between=3)),
            ('two things, always there', [[HERE, THERE]] * 5, Flicker(tracks=2, judged=2, between=6)),
            ('a flash', [[], [HERE], [], []], Flicker(tracks=1, judged=1, flashes=1)),
            ('begins in the last picture', [[], [], [HERE]], Flicker(tracks=1)),
            (
                'lost twice and found again',
                [[HERE], [], [], [HERE], [], [HERE]],
                Flicker(tracks=1, judged=1, gaps=2, missed=3, between=4),
            ),
            ('ends: that is no gap', [[HERE], [HERE], [], []], Flicker(tracks=1, judged=1)),
            (
                'gone at one place, there at another',
                [[HERE], [HERE], [THERE], [THERE]],
                Flicker(tracks=2, judged=2),
            ),
            (
                'lost for longer than the memory',
                [[HERE], [HERE], *[[]] * 10, [HERE], [HERE]],
                Flicker(tracks=2, judged=2),
            ),
            (
                'lost for as long as the memory',
                [[HERE], [HERE], *[[]] * 9, [HERE], [HERE]],
                Flicker(tracks=1, judged=1, gaps=1, missed=9, between=11),
            ),
            (
                'a thing that jitters by less than the gate stays itself',
                [[(0.5, 0.0)], [(0.57, 0.02)], [(0.49, -0.03)]],
                Flicker(tracks=1, judged=1, between=1),
            ),
            (
                'the nearest pairs belong together, whatever the order',
                [[(0.5, 0.0), (0.5, 0.08)], [(0.5, 0.09), (0.5, 0.01)], [(0.5, 0.0), (0.5, 0.08)]],
                Flicker(tracks=2, judged=2, between=2),
            ),
            ('one sighting continues one track only', [[(0.5, 0.0), (0.5, 0.05)], [(0.5, 0.02)], [(0.5, 0.02)]],
             Flicker(tracks=2, judged=2, flashes=1, between=1)),
        ],
    )  # fmt: skip
    def test_of_things_seen_by_a_robot_that_stands(self, what: str, places: Places, wanted: Flicker) -> None:
        assert flicker_of(places) == wanted, what

    def test_nearest_first_keeps_kinds_apart(self) -> None:
        first = Seen(0, (Sighting('duckie', 0.5, 0.0), Sighting('cone', 0.5, 0.08)))
        then = Seen(PERIOD, (Sighting('cone', 0.5, 0.09), Sighting('duckie', 0.5, 0.01)), STILL)
        assert recordings.flicker([first, then]).changes == 0

    def test_a_change_of_kind_is_counted_and_is_no_new_thing(self) -> None:
        kinds = ('duckie', 'cone', 'cone', 'duckie')
        pictures = [Seen(PERIOD * i, (Sighting(kind, 0.5, 0.0),), STILL) for i, kind in enumerate(kinds)]
        assert recordings.flicker(pictures) == Flicker(tracks=1, judged=1, between=2, changes=2)

    def test_the_robots_turn_is_taken_out(self) -> None:
        # It turns left by 0.2 rad a picture: a thing that stands still goes to the right by 0.16 m at 0.8 m.
        turn = recordings.Pose(heading=0.2)
        angles = [0.6 - 0.2 * i for i in range(7)]
        places = [[] if i in (2, 3) else [(0.8 * math.cos(a), 0.8 * math.sin(a))] for i, a in enumerate(angles)]
        assert flicker_of(places, step=turn) == Flicker(tracks=1, judged=1, gaps=1, missed=2, between=5)
        assert flicker_of(places, step=STILL).tracks > 1, 'else this test would not show anything'

    def test_the_robots_drive_is_taken_out(self) -> None:
        places = [[(1.2 - 0.2 * i, 0.1)] for i in range(5)]
        assert flicker_of(places, step=recordings.Pose(x=0.2)) == Flicker(tracks=1, judged=1, between=3)
        assert flicker_of(places, step=recordings.Pose(x=-0.2)).tracks == 5

    def test_without_motion_the_gate_grows_faster(self) -> None:
        lost = [[(0.8, 0.0)], [], [], [(0.68, 0.18)], [(0.68, 0.18)]]
        assert flicker_of(lost, step=None).tracks == 1
        assert flicker_of(lost, step=STILL).tracks == 2

    def test_stamps_that_run_backwards_begin_anew(self) -> None:
        pictures = sequence([[HERE], [HERE], [HERE]])
        assert recordings.flicker([*pictures, *pictures]) == Flicker(tracks=2, judged=2, between=2)

    def test_two_drives_add_up_whatever_their_order(self) -> None:
        first, second = sequence([[HERE], [], [HERE]]), sequence([[THERE], [THERE]])
        assert recordings.flicker(first + second) == recordings.flicker(second + first)


class TestMotion:
    @pytest.mark.parametrize(
        ('what', 'command', 'seconds', 'wanted'),
        [
            ('stands', Command(0.0, 0.0), 0.4, (0, 0, 0)),
            ('straight', Command(0.2, 0.0), 0.4, (0.08, 0, 0)),
            ('turns left on the spot', Command(0.0, 1.0), 0.4, (0, 0, 0.4)),
            ('a quarter of a circle', Command(0.5 * math.pi, math.pi), 0.5, (0.5, 0.5, math.pi / 2)),
            ('a command counts for half a second', Command(0.2, 0.0), 3.0, (0.1, 0, 0)),
        ],
    )
    def test_of_one_command(
        self, what: str, command: Command, seconds: float, wanted: Tuple[float, float, float]
    ) -> None:
        start = recordings.told(None, command, 7 * 10**9)
        odometry = start
        for part in range(1, 31):  # in small steps, as pictures come
            odometry = recordings.driven(odometry, 7 * 10**9 + int(part * seconds / 30 * 1e9))
        pose = odometry.pose
        assert (pose.x, pose.y, pose.heading) == pytest.approx(wanted, abs=1e-3), what
        whole = recordings.driven(start, 7 * 10**9 + int(seconds * 1e9))
        assert (whole.pose.heading, whole.time) == (pytest.approx(wanted[2], abs=1e-6), odometry.time)

    def test_the_next_command_takes_over(self) -> None:
        odometry: Optional[Odometry] = None
        for index, speed in enumerate((0.2, 0.0, 0.4)):
            odometry = recordings.told(odometry, Command(speed, 0.0), index * PERIOD)
        assert odometry is not None
        assert recordings.driven(odometry, 3 * PERIOD).pose.x == pytest.approx(0.02 + 0.04)

    def test_a_pose_seen_from_another(self) -> None:
        before, after = recordings.Pose(1.0, 2.0, math.pi / 2), recordings.Pose(0.5, 3.0, math.pi)
        seen = recordings.relative(before, after)
        assert (seen.x, seen.y, seen.heading) == pytest.approx((1.0, 0.5, math.pi / 2))


def obstacle(
    x: float = 0.5, y: float = 0.0, kind: Optional[Kind] = Kind.DUCKIE, side: Optional[bool] = True
) -> Obstacle:
    return Obstacle(kind, x, y, 0.03, side, 0.8, image_box=Box(300, 220, 340, 270))


Says = Callable[[Any], detection.Detector]
asked: List[Tuple[int, Any]] = []
"""Stamp and commands of each call of the detector that `says` has made."""


@pytest.fixture
def says(monkeypatch: pytest.MonkeyPatch, calibration: Calibration, detection_settings: DetectionSettings) -> Says:
    """A detector that says what the test wants, picture by picture."""

    def prepare(answers: Sequence[Sequence[Obstacle]]) -> detection.Detector:
        left = list(answers)
        asked.clear()

        def detect(detector: Any, picture: Any, stamp: int, commands: Any) -> Tuple[Shown, Any]:
            assert stamp is not None, 'a recording is a sequence'
            asked.append((stamp, commands))
            return Shown(left.pop(0)), detector

        monkeypatch.setattr(detection, 'detect', detect)
        return detection.start(calibration, detection_settings)

    return prepare


@pytest.fixture
def folder(tmp_path: Path) -> Callable[[int], recordings_files.Recording]:
    """A folder of so many pictures, 10 a second."""

    def make(count: int) -> recordings_files.Recording:
        inside = tmp_path / 'drive one'
        inside.mkdir()
        for index in range(count):
            (inside / ('%04d.jpg' % index)).write_bytes(jpeg_of(Scene()))
        return recordings_files.open_folder(str(inside), 10.0)

    return make


def never(sentence: str) -> None:
    raise AssertionError(sentence)


Folder = Callable[[int], recordings_files.Recording]


class TestFolder:
    def test_nothing_found(self, says: Says, folder: Folder) -> None:
        checked = recordings.check(folder(3), says([[]] * 3), never)
        assert (checked.pictures, checked.broken, checked.found, checked.with_any) == (3, 0, {}, 0)
        assert (checked.seconds, checked.metres, checked.metres_from) == (0.2, None, None)
        assert (checked.flicker, checked.longest_run, checked.sheets) == (NOTHING, 0, [])
        assert sum(checked.milliseconds.values()) == 3

    def test_what_is_counted(self, says: Says, folder: Folder) -> None:
        cone = obstacle(0.7, 0.3, Kind.CONE, False)
        answers = [
            [obstacle()],
            [],
            [obstacle(), cone],
            [obstacle(), cone],
            [cone],
            [],
            [obstacle(side=None, kind=None)],
        ]
        checked = recordings.check(folder(7), says(answers), never)
        assert checked.found == {
            'cone': {'outside': 3},
            'duckie': {'inside': 3},
            'unknown': {'unknown': 1},
        }
        assert checked.with_any == 5
        assert (checked.longest_run, checked.longest_from, checked.longest_to) == (3, '0002.jpg', '0004.jpg')
        assert checked.flicker == Flicker(tracks=2, judged=2, gaps=2, missed=3, between=6, changes=1)

    def test_broken_pictures_are_named_and_skipped(self, says: Says, folder: Folder) -> None:
        recording = folder(4)
        Path(recording.files[1]).write_bytes(b'\xff\xd8junk')
        sentences: List[str] = []
        checked = recordings.check(recording, says([[obstacle()]] * 3), sentences.append)
        assert (checked.pictures, checked.broken) == (3, 1)
        assert len(sentences) == 1
        assert sentences[0].startswith('0001.jpg: the picture of 6 bytes has no end marker')
        assert checked.why_broken == sentences
        assert checked.flicker.gaps == 0, 'a picture that nobody could see is no miss'

    def test_the_counts_survive_json(self, says: Says, folder: Folder, tmp_path: Path) -> None:
        checked = recordings.check(folder(3), says([[obstacle()]] * 3), never, str(tmp_path), 'a')
        assert checked.sheets == ['a_001.jpg']
        assert recordings.from_json(json.loads(json.dumps(asdict(checked)))) == checked

    def test_with_the_real_detector(
        self, folder: Folder, calibration: Calibration, detection_settings: DetectionSettings, tmp_path: Path
    ) -> None:
        recording = folder(5)
        for path in recording.files:
            Path(path).write_bytes(jpeg_of(Scene((DUCKIE,))))
        detector = detection.start(calibration, detection_settings)
        checked = recordings.check(recording, detector, never, str(tmp_path), 'real')
        assert set(checked.found) == {'duckie'}
        assert 2 <= checked.with_any <= 4, 'the tracker needs more than one picture'
        assert checked.flicker.tracks == 1
        assert cv2.imread(str(tmp_path / 'real_001.jpg')) is not None


class TestSheets:
    def test_are_written_as_they_fill(self, tmp_path: Path, picture: Any) -> None:
        sheets = recordings.Sheets(str(tmp_path), '0001_drive')
        for index in range(100):
            sheets.take('%d.jpg' % index, picture, obstacle())
            assert len(list(tmp_path.iterdir())) == (index + 1) // 48
        sheets.close()
        assert sheets.names == ['0001_drive_001.jpg', '0001_drive_002.jpg', '0001_drive_003.jpg']
        sizes = [cv2.imread(str(tmp_path / name)).shape for name in sheets.names]
        assert sizes[0] == sizes[1]
        assert sizes[0][1] == 8 * (recordings.TILE[0] + 4)
        assert sizes[0][0] == 6 * sizes[2][0], 'the last one has four tiles, one row'

    def test_none_are_written_without_a_folder_or_anything(self, tmp_path: Path, picture: Any) -> None:
        nowhere, empty = recordings.Sheets('', 'a'), recordings.Sheets(str(tmp_path), 'a')
        nowhere.take('a', picture, obstacle())
        for sheets in (nowhere, empty):
            sheets.close()
            assert (sheets.names, sheets.unshown) == ([], 0)
        assert not list(tmp_path.iterdir())

    def test_there_is_an_end(self, tmp_path: Path, picture: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(recordings, 'MOST_SHEETS', 1)
        sheets = recordings.Sheets(str(tmp_path), 'a')
        for _ in range(50):
            sheets.take('a', picture, obstacle())
        sheets.close()
        assert (sheets.names, sheets.unshown) == (['a_001.jpg'], 2)

    def test_a_name_that_the_font_does_not_have(self, picture: Any) -> None:
        shown = [contact_sheet([(name, picture)]) for name in ('caf\udce9', 'caf\u00e9', 'caf?')]
        assert (shown[0] == shown[2]).all() and (shown[1] == shown[2]).all()

    def test_a_folder_that_is_not_there(self, picture: Any, tmp_path: Path) -> None:
        sheets = recordings.Sheets(str(tmp_path / 'none'), 'a')
        sheets.take('a', picture, obstacle())
        with pytest.raises(OSError, match='No such file'):
            sheets.close()

    @pytest.mark.parametrize(
        'box',
        [Box(0, 0, 3, 3), Box(300, 200, 340, 250), Box(630, 470, 640, 480), Box(0, 0, 640, 480), Box(5, 100, 9, 470)],
    )
    def test_a_window_holds_its_box_and_lies_in_the_picture(self, box: Box) -> None:
        left, top, right, bottom = recordings.window(box, 640, 480)
        assert 0 <= left <= box.left
        assert 0 <= top <= box.top
        assert box.right - 1 <= right <= 640
        assert box.bottom - 1 <= bottom <= 480
        assert (right - left) / (bottom - top) == pytest.approx(4 / 3, abs=0.05)
        assert recordings.tile(np.zeros((480, 640, 3), np.uint8), obstacle()).shape == (
            132 + recordings.CAPTION,
            176,
            3,
        )

    def test_a_tile_shows_the_thing(self, picture: Any) -> None:
        painted = picture.copy()
        painted[220:270, 300:340] = (255, 0, 0)
        shown = recordings.tile(painted, obstacle())
        assert tuple(shown[66, 88]) == (255, 0, 0)
        assert tuple(shown[4, 4]) == (0, 0, 0)
        edge = np.argwhere((shown == INSIDE).all(axis=2))
        assert edge.mean(axis=0) == pytest.approx((66, 88), abs=2), 'a box of its side around it'
        assert np.ptp(edge, axis=0) == pytest.approx((50 * 132 / 125, 40 * 176 / 166), abs=3)


@pytest.fixture
def picture() -> Any:
    return np.zeros((480, 640, 3), np.uint8)


def write_bag(path: Path, pictures: int, commands: bool = True, truth: bool = False, speed: float = 0.2) -> str:
    """A robot that is told to drive straight on, and by the truth drives half as fast."""
    with rosbag.Bag(str(path), 'w') as bag:
        for index in range(pictures):
            stamp = 10**9 + index * PERIOD
            now = border.ros_time(stamp)
            if commands:
                bag.write(
                    '/duck/lane_controller_node/car_cmd', messages.Twist2DStamped(Header(stamp=now), speed, 0.0), now
                )
                bag.write(
                    '/other/lane_controller_node/car_cmd', messages.Twist2DStamped(Header(stamp=now), 9.0, 0.0), now
                )
            if truth:
                place = Point(speed / 2 * index * PERIOD / 1e9, 0, 0)
                posed = PoseStamped(Header(stamp=now), Pose(place, Quaternion(0, 0, 0, 1)))
                bag.write('/duck/simulator_node/truth/pose', posed, now)
            image = border.compressed_image_from_jpeg(jpeg_of(Scene()), stamp, 'camera')
            bag.write('/duck/camera_node/image/compressed', image, border.ros_time(stamp + 1000))
    return str(path)


class TestBag:
    def test_metres_by_commands(self, says: Says, tmp_path: Path) -> None:
        recording = recordings_files.open_bag(write_bag(tmp_path / 'a.bag', 11))
        checked = recordings.check(recording, says([[]] * 11), never)
        assert (checked.seconds, checked.metres_from) == (1.0, 'commands')
        assert checked.metres == pytest.approx(0.2, abs=0.002)

    def test_the_truth_is_better_than_commands(self, says: Says, tmp_path: Path) -> None:
        recording = recordings_files.open_bag(write_bag(tmp_path / 'a.bag', 11, truth=True))
        checked = recordings.check(recording, says([[]] * 11), never)
        assert checked.metres_from == 'truth'
        assert checked.metres == pytest.approx(0.1, abs=0.002)

    def test_the_detector_is_told_how_the_robot_moves(self, says: Says, tmp_path: Path) -> None:
        recordings.check(recordings_files.open_bag(write_bag(tmp_path / 'a.bag', 3, speed=0.25)), says([[]] * 3), never)
        for number, (stamp, commands) in enumerate(asked, 1):
            assert [(command.stamp, command.value) for command in commands] == [
                (stamp - PERIOD * back, Command(0.25, 0.0)) for back in reversed(range(number))
            ]

    def test_a_bag_without_motion(self, says: Says, tmp_path: Path) -> None:
        recording = recordings_files.open_bag(write_bag(tmp_path / 'a.bag', 3, commands=False))
        assert recording.motion == {}
        checked = recordings.check(recording, says([[]] * 3), never)
        assert (checked.metres, checked.metres_from) == (None, None)

    def test_motion_is_taken_out(self, says: Says, tmp_path: Path) -> None:
        recording = recordings_files.open_bag(write_bag(tmp_path / 'a.bag', 6, speed=2.0))
        near = [[obstacle(1.6 - 0.2 * i)] for i in range(6)]
        checked = recordings.check(recording, says(near), never)
        assert checked.flicker == Flicker(tracks=1, judged=1, between=4)

    def test_pictures_have_the_names_that_bag_to_images_gives(self, says: Says, tmp_path: Path) -> None:
        recording = recordings_files.open_bag(write_bag(tmp_path / 'a.bag', 3))
        checked = recordings.check(recording, says([[obstacle()], [obstacle()], []]), never)
        assert (checked.longest_from, checked.longest_to) == ('1_000000000.jpg', '1_100000000.jpg')

    def test_a_command_that_is_not_finite(self, says: Says, tmp_path: Path) -> None:
        recording = recordings_files.open_bag(write_bag(tmp_path / 'a.bag', 2, speed=math.nan))
        sentences: List[str] = []
        checked = recordings.check(recording, says([[]] * 2), sentences.append)
        assert checked.pictures == 2
        assert sentences == ['%.3f s: the car command has v = nan, expected a finite number' % s for s in (1.0, 1.1)]

    def test_a_damaged_bag(self, says: Says, tmp_path: Path) -> None:
        path = Path(write_bag(tmp_path / 'a.bag', 4))
        recording = recordings_files.open_bag(str(path))
        data = bytearray(path.read_bytes())
        data[6000:9000] = bytes(3000)
        path.write_bytes(bytes(data))
        with pytest.raises(ToolError, match=r'a\.bag is damaged'):
            recordings.check(recording, says([[]] * 4), never)

    def test_only_those_who_ask_get_the_motion(self, tmp_path: Path) -> None:
        recording = recordings_files.open_bag(write_bag(tmp_path / 'a.bag', 2, truth=True))
        assert list(recording.topics) == [recordings_files.JPEG]
        assert recording.motion == {
            'car_cmd': '/duck/lane_controller_node/car_cmd',
            'true_pose': '/duck/simulator_node/truth/pose',
        }
        assert {item.role for item in recordings_files.messages(recording)} == {'jpeg'}
        everything = [item.role for item in recordings_files.messages(recording, motion=True)]
        assert sorted(everything) == ['car_cmd', 'car_cmd', 'jpeg', 'jpeg', 'true_pose', 'true_pose']
        times = [item.time for item in recordings_files.messages(recording, motion=True)]
        assert times == sorted(times)


def checked_of(path: str = 'drives/one.bag', **changes: Any) -> recordings.RecordingChecked:
    """100 pictures over 10 s and 2 m, 6 detections in 5 of them."""
    values: Dict[str, Any] = {
        'path': path,
        'pictures': 100,
        'broken': 1,
        'why_broken': ['x.jpg: the picture is empty'],
        'seconds': 10.0,
        'metres': 2.0,
        'metres_from': 'commands',
        'found': {'duckie': {'inside': 4, 'outside': 1}, 'cone': {'unknown': 1}},
        'with_any': 5,
        'longest_run': 3,
        'longest_from': 'a.jpg',
        'longest_to': 'c.jpg',
        'flicker': Flicker(tracks=4, judged=4, flashes=1, gaps=2, missed=3, between=30, changes=1),
        'milliseconds': {'milliseconds|600': 100},
        'sheets': ['one_001.jpg'],
        'unshown': 0,
    }
    return recordings.RecordingChecked(**{**values, **changes})


class TestFigures:
    def test_of_nothing(self) -> None:
        found = recordings.figures([], True)
        assert found['recordings'] == []
        total = found['total']
        assert (total['pictures'], total['detections'], total['per_picture'], total['metres']) == (0, 0, None, None)
        assert total['false_alarms']['longest_run'] == 0
        assert total['milliseconds'] is None
        json.dumps(found)

    def test_of_one(self) -> None:
        found = recordings.figures([checked_of()], False)
        one = found['recordings'][0]
        assert one == {**found['total'], 'name': one['name']}
        assert one['name'] == 'one.bag'
        assert (one['detections'], one['per_picture'], one['per_metre']) == (6, 0.06, 3.0)
        assert one['false_alarms'] is None
        assert one['flicker']['flashes']['value'] == 0.25
        assert one['flicker']['missing']['value'] == 0.1
        assert one['flicker']['gaps_per_track'] == 0.5
        json.dumps(found)

    def test_of_an_empty_road(self) -> None:
        other = checked_of('drives/two', pictures=300, found={'duckie': {'inside': 10}}, with_any=9, longest_run=7)
        alarms = recordings.figures([checked_of(), other], True)['total']['false_alarms']
        assert (alarms['count'], alarms['kinds']) == (16, {'duckie': 15, 'cone': 1})
        assert (alarms['pictures_with_any']['k'], alarms['pictures_with_any']['n']) == (14, 400)
        low, high = alarms['pictures_with_any']['ci95']
        assert (low, high) == pytest.approx((0.021, 0.058), abs=0.001)  # Wilson, by hand
        assert (alarms['per_picture'], alarms['per_metre']) == (0.04, 4.0)
        assert (alarms['longest_run'], alarms['longest_in']) == (7, 'two')

    def test_only_those_that_drove_count_a_metre(self) -> None:
        stood = checked_of(metres=0.01)
        folder = checked_of(metres=None, metres_from=None)
        assert recordings.figures([stood], False)['total']['per_metre'] is None
        assert recordings.figures([folder], False)['total']['metres'] is None
        both = recordings.figures([checked_of(), folder], False)['total']
        assert (both['metres'], both['per_metre'], both['detections']) == (2.0, 3.0, 12)
