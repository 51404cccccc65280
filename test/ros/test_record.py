"""record, record.launch and play: what a drive leaves behind, how large it gets, and what is done with it."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List

import pytest
import rosbag
import rosgraph
import yaml
from helpers import REPOSITORY, START, free_port, load_launch, run_program, wait_for

from obst_avoid.offline import play, record, simulated_time
from obst_avoid.offline.graph import launched

END_WAIT = 30.0
"""[s] for a recorder to write its index."""
ROBOT = ['--vehicle', 'duck1']
SETTINGS = (
    'bird_view.yaml',
    'car_cmd_guard_node.yaml',
    'daffy_adapter_node.yaml',
    'lane_controller_node.yaml',
    'lane_estimate.yaml',
    'obstacle_avoidance_node.yaml',
    'obstacle_detection_node.yaml',
    'simulation.yaml',
)
"""What launch files read."""


@pytest.fixture
def master() -> Iterator[Dict[str, str]]:
    """A master of our own; the environment for those that take part."""
    environment = {**os.environ, 'ROS_MASTER_URI': 'http://localhost:%d' % free_port(), 'ROS_HOSTNAME': 'localhost'}
    core = subprocess.Popen(
        ['roscore', '-p', environment['ROS_MASTER_URI'].split(':')[-1]],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_for(lambda: rosgraph.is_master_online(environment['ROS_MASTER_URI']), START, 'a master')
        yield environment
    finally:
        core.send_signal(signal.SIGINT)
        core.wait()


@contextlib.contextmanager
def running(call: List[str], environment: Dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """A program that is asked to end as by Ctrl-C when the block is left, and has to."""
    process = subprocess.Popen(call, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(END_WAIT)
        finally:
            process.kill()


def files_in(folder: Path) -> List[Path]:
    return sorted(path for path in folder.rglob('*') if path.is_file())


def bytes_in(folder: Path) -> int:
    """Of all files; one that is renamed or removed meanwhile counts for nothing."""
    total = 0
    for path in files_in(folder):
        with contextlib.suppress(FileNotFoundError):
            total += path.stat().st_size
    return total


@pytest.mark.parametrize('pictures', ['compressed', 'raw'])
@pytest.mark.parametrize('megabytes', [20, 50, 333, 2000, 100_000])
def test_the_parts_of_a_recording_stay_below_the_limit_and_use_it(megabytes: int, pictures: str) -> None:
    size, count = record.parts(megabytes, pictures)
    largest = (size * record.INDEX + record.SPARE[pictures]) * record.MIB
    assert size >= 1 and count >= 3
    assert 0.6e6 * megabytes < largest * count < 1e6 * megabytes


def test_a_recording_never_gets_larger_than_it_may(master: Dict[str, str], tmp_path: Path) -> None:
    limit = 20
    camera = subprocess.Popen([sys.executable, __file__], env=master)
    try:
        call = ['rosrun', 'obst_avoid', 'record', *ROBOT, '--output', str(tmp_path), '--megabytes', str(limit)]
        largest = 0
        with running(call, master) as process:

            def first_part_is_gone() -> bool:
                nonlocal largest
                largest = max(largest, bytes_in(tmp_path))
                assert process.poll() is None, process.stdout and process.stdout.read()
                bags = {path.name.split('.')[0] for path in files_in(tmp_path) if '.bag' in path.name}
                return bool(bags) and 'drive_0' not in bags and 'drive_1' not in bags

            wait_for(first_part_is_gone, 120.0, 'the oldest parts go')
    finally:
        camera.kill()
        camera.wait()
    largest = max(largest, bytes_in(tmp_path))
    assert 0.5e6 * limit < largest < 1e6 * limit
    bags = [path for path in files_in(tmp_path) if path.suffix == '.bag']
    assert len(bags) >= 3 and not [path for path in files_in(tmp_path) if path.name.endswith('.active')]
    for path in bags:
        with rosbag.Bag(str(path)) as bag:  # each is whole, and has what was said only once
            assert bag.get_message_count('/duck1/camera_node/image/compressed')
            assert bag.get_message_count('/duck1/simulator_node/scenario') == 1


def test_what_is_recorded_can_be_looked_at_and_evaluated(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'log'))
    drive = ['simulation.launch', 'veh:=duck1', 'picture_rate:=10', 'stage:=stop_only', 'scenario:=demo.yaml']
    drive[-1] = 'scenario:=' + os.path.join(record.tool.package_folder(), 'config/demo.yaml')
    with open(str(tmp_path / 'log.txt'), 'wb') as log, launched(drive, log.fileno()) as graph:
        call = ['roslaunch', '--wait', 'obst_avoid', 'record.launch', 'veh:=duck1', 'output:=drives', 'megabytes:=200']
        with running([*call, 'allow_default_calibration:=true'], {**graph.environment, 'PWD': str(tmp_path)}):
            wait_for(lambda: bytes_in(tmp_path / 'drives') > 1_500_000, 120.0, 'a recording')
    (folder,) = (tmp_path / 'drives').iterdir()
    assert folder.name.startswith('duck1_20')
    names = {str(path.relative_to(folder)) for path in files_in(folder)}
    assert names == {
        'drive_0.bag',
        'settings.yaml',
        *('settings/' + name for name in SETTINGS),
        'calibrations/camera_intrinsic/duck1.yaml',
        'calibrations/camera_extrinsic/duck1.yaml',
    }
    settings = yaml.safe_load((folder / 'settings.yaml').read_text())['duck1']
    assert settings['obstacle_avoidance_node']['stage'] == 'stop_only' and 'rviz' not in settings
    config = load_launch('obst_avoid.launch', veh='duck1', config=str(folder / 'settings'))
    assert config.params['/duck1/obstacle_avoidance_node/stage'].value == 'stop_only'
    bag = str(folder / 'drive_0.bag')
    with rosbag.Bag(bag) as read:
        found = {topic: info.message_count for topic, info in read.get_type_and_topic_info().topics.items()}
    missing = {name for name in record.topics('duck1', 'compressed') if name not in found}
    assert {name for name in missing if not name.endswith('parameter_updates')} <= {
        '/duck1/turn'  # only before an intersection
    }
    look_at(folder, tmp_path)
    robot = ['--calibration', str(folder / 'calibrations'), '--vehicle', 'duck1']
    for tool_call, made in (
        (['drive_report', bag, '--output', str(tmp_path / 'report')], 'report/drive.mp4'),
        (['evaluate', '--profile', 'paper', '--output', str(tmp_path / 'results'), bag], 'results'),
        (['run_bag', '--config', str(folder / 'settings'), bag, '--output', str(tmp_path / 'again.bag')], 'again.bag'),
    ):
        ended = run_program(['rosrun', 'obst_avoid', *tool_call, *robot], 240)
        assert ended.code == 0 and (tmp_path / made).exists(), ended.output


def look_at(folder: Path, tmp_path: Path) -> None:
    """visualizer.launch draws it, and goes on when the bag begins anew; on the time of the recording."""
    call = ['visualizer.launch', 'veh:=duck1', 'rviz:=false', 'bag:=' + str(folder), 'rate:=4', 'loop:=true']
    with rosbag.Bag(str(folder / 'drive_0.bag')) as bag:
        begin, end = bag.get_start_time(), bag.get_end_time()
    call.append('calibration_dir:=' + str(folder / 'calibrations'))
    with open(str(tmp_path / 'log.txt'), 'wb') as log, launched(call, log.fileno()) as graph:
        wait_for(lambda: rosgraph.is_master_online(graph.environment['ROS_MASTER_URI']), START, 'a master')
        seen: List[float] = []
        while seen == sorted(seen):  # until time has run backwards
            ended = run_program([sys.executable, __file__, 'stamp'], START, graph.environment)
            assert ended.code == 0 and len(seen) < 20, ended.output
            stamp, now = (float(word) for word in ended.output.split()[-2:])
            assert all(begin - 1 <= time <= end + 1 for time in (stamp, now))
            seen.append(stamp)


def test_nothing_is_overwritten(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(record.time, 'strftime', lambda form: '_now')
    folders = [record.new_folder(str(tmp_path), 'duck1') for _ in range(3)]
    assert [os.path.basename(folder) for folder in folders] == ['duck1_now', 'duck1_now_2', 'duck1_now_3']


@pytest.mark.parametrize(
    'arguments, words',
    [
        (['--bag', 'there.bag'], 'there.bag exists, expected a new file'),
        (['--bag', 'nowhere/a.bag'], 'nowhere/a.bag cannot be written, expected a file in an existing folder'),
        (['--output', 'there.bag'], 'there.bag'),
    ],
)
def test_errors_are_one_sentence(
    arguments: List[str], words: str, tmp_path: Path, monkeypatch: Any, sentence: Callable[[str], str]
) -> None:
    (tmp_path / 'there.bag').write_text('mine')
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('PWD', str(tmp_path))
    monkeypatch.setattr(record.rosgraph, 'is_master_online', lambda: True)
    assert record.main([*ROBOT, *arguments, '__name:=recorder']) == 1
    assert words in sentence('record')
    assert (tmp_path / 'there.bag').read_text() == 'mine'


@pytest.mark.parametrize('tool', ['record', 'play'])
def test_without_a_master(tool: str, tmp_path: Path, monkeypatch: Any, sentence: Callable[[str], str]) -> None:
    bag = make_bag(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('PWD', str(tmp_path))
    monkeypatch.setenv('ROS_MASTER_URI', 'http://localhost:%d' % free_port())
    assert (record.main(ROBOT) if tool == 'record' else play.main([bag, *ROBOT])) == 1
    assert 'no ROS master at http://localhost' in sentence(tool)
    assert len(files_in(tmp_path)) == 1


@pytest.mark.parametrize('megabytes', ['19', '-1', 'many'])
def test_too_small_to_be_divided(megabytes: str, capsys: Any) -> None:
    with pytest.raises(SystemExit) as error:
        record.main([*ROBOT, '--megabytes', megabytes])
    assert error.value.code == 2 and '--megabytes' in capsys.readouterr().err


def test_without_calibration_it_is_said_and_recorded_all_the_same(
    tmp_path: Path, monkeypatch: Any, sentence: Callable[[str], str]
) -> None:
    options = record.argparse.Namespace(vehicle='duck1', calibration=str(tmp_path), default_calibration=False)
    record._keep_calibration(options, str(tmp_path / 'calibrations'))
    assert 'without calibration: no calibration of duck1' in sentence('record')
    assert not (tmp_path / 'calibrations').exists()


@pytest.mark.parametrize('packages', ['debian-12', 'ubuntu-20.04'])
def test_a_robot_needs_no_package_of_the_tools(packages: str) -> None:
    listed = (REPOSITORY / 'deps' / (packages + '.txt')).read_text()
    tools = re.findall(r'^python3-(\w+)$', listed.split('# tools')[1].split('# test')[0], re.MULTILINE)
    assert {'scipy', 'moderngl'} <= set(tools)
    code = 'import sys; sys.modules.update(dict.fromkeys(%r)); import obst_avoid.offline.record' % tools
    ended = run_program([sys.executable, '-c', code], 60)
    assert ended.code == 0, ended.output


def make_bag(folder: Path) -> str:
    """A bag with one picture of duck1."""
    from sensor_msgs.msg import CompressedImage

    path = str(folder / 'a.bag')
    with rosbag.Bag(path, 'w') as bag:
        bag.write('/duck1/camera_node/image/compressed', CompressedImage(format='jpeg', data=b'\0'))
    return path


@pytest.mark.parametrize(
    'arguments, words',
    [
        (['nowhere.bag', '--vehicle', 'duck1'], 'nowhere.bag does not exist, expected a bag'),
        (['empty', '--vehicle', 'duck1'], 'empty has no bag, expected a folder that record made'),
        (['a.bag', '--vehicle', 'duck2'], 'a.bag has no pictures of duck2'),
        (
            ['a.bag', '--vehicle', 'duck1', '--input', 'raw'],
            'a.bag has compressed pictures, expected input:=compressed',
        ),
    ],
)
def test_what_cannot_be_played(
    arguments: List[str], words: str, tmp_path: Path, monkeypatch: Any, sentence: Callable[[str], str]
) -> None:
    make_bag(tmp_path)
    (tmp_path / 'empty').mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('PWD', str(tmp_path))
    assert play.main(arguments) == 1
    assert words in sentence('play')


@pytest.mark.parametrize(
    'call',
    [
        ['visualizer.launch', 'veh:=duck1', 'bag:={bag}', 'rviz:=false', 'allow_default_calibration:=true'],
        ['replay.launch', 'veh:=duck1', 'bag:={bag}', 'allow_default_calibration:=true'],
        ['replay.launch', 'veh:=duck2', 'bag:={bag}', 'allow_default_calibration:=true'],
        ['simulation.launch', 'veh:=duck2'],
    ],
)
def test_nothing_is_played_or_simulated_beside_a_robot(master: Dict[str, str], tmp_path: Path, call: List[str]) -> None:
    topic = '/duck1/camera_node/image/compressed'
    state = rosgraph.Master('/test', master['ROS_MASTER_URI'])
    camera = subprocess.Popen([sys.executable, __file__], env=master)
    try:
        wait_for(lambda: topic in dict(state.getSystemState()[0]), START, 'the robot')
        state.setParam('/duck1/obstacle_avoidance_node/stage', 'stop_only')
        bag = make_bag(tmp_path)
        ended = run_program(['roslaunch', 'obst_avoid', *(word.format(bag=bag) for word in call)], 60, master)
    finally:
        camera.kill()
        camera.wait()
    sentence = '/camera publishes %s at %s, expected nobody else there' % (topic, master['ROS_MASTER_URI'])
    assert ended.code == 1 and sentence in ended.output, ended.output
    assert not state.hasParam('/use_sim_time'), 'the robot has its own time'
    assert state.getParam('/duck1/obstacle_avoidance_node/stage') == 'stop_only', 'and its settings'
    assert topic in dict(state.getSystemState()[0]), 'the master remembers who was killed'
    simulated_time.require('duck1', uri=master['ROS_MASTER_URI'])


def show_pictures() -> None:
    """A camera with large pictures, and something that is said only once. A program of its own."""
    import rospy
    from sensor_msgs.msg import CompressedImage
    from std_msgs.msg import String

    rospy.init_node('camera')
    once = rospy.Publisher('/duck1/simulator_node/scenario', String, queue_size=1, latch=True)
    once.publish(String('{}'))
    camera = rospy.Publisher('/duck1/camera_node/image/compressed', CompressedImage, queue_size=1)
    while not rospy.is_shutdown():
        camera.publish(CompressedImage(format='jpeg', data=os.urandom(200_000)))
        time.sleep(0.02)


def show_stamp() -> None:
    """Print the stamp of an annotated picture, and the time. A program of its own."""
    import rospy
    from sensor_msgs.msg import CompressedImage

    rospy.init_node('looker', anonymous=True)
    topic = '/duck1/obstacle_detection_visual_node/image/compressed'
    msg = rospy.wait_for_message(topic, CompressedImage, timeout=None)
    print(msg.header.stamp.to_sec(), rospy.Time.now().to_sec())


if __name__ == '__main__':
    show_stamp() if 'stamp' in sys.argv else show_pictures()
