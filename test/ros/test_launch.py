"""The launch files, read as roslaunch reads them: names, remaps and parameters, without starting anything."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import re
import shlex
from pathlib import Path
from typing import Any, Dict, List, Optional

import pytest
import rosgraph.names
from helpers import REPOSITORY, load_launch
from roslaunch.loader import LoadException

from obst_avoid.core.settings import load
from obst_avoid.offline.record import topics
from obst_avoid.ros.car_cmd_guard_node import GuardNodeSettings
from obst_avoid.ros.daffy_adapter_node import AdapterNodeSettings
from obst_avoid.ros.lane_controller_node import ControllerNodeSettings
from obst_avoid.ros.node import path_of_user
from obst_avoid.ros.obstacle_avoidance_node import AvoidanceNodeSettings
from obst_avoid.ros.obstacle_detection_node import DetectionNodeSettings
from obst_avoid.ros.obstacle_detection_visual_node import VisualNodeSettings
from obst_avoid.ros.replay_node import ReplaySettings
from obst_avoid.ros.simulator_node import SimulatorNodeSettings

LAUNCH = sorted(path.name for path in (REPOSITORY / 'launch').glob('*.launch'))
REASONABLE = {
    'obst_avoid.launch': [{}, {'lane_controller': 'true'}, {'input': 'raw', 'stage': 'stop_only', 'profile': 'paper'}],
    'daffy.launch': [{}, {'hard_stop': 'true', 'stage': 'stop_only', 'profile': 'paper'}],
    'visualizer.launch': [{}, {'rviz': 'false', 'calibration_dir': '/calibrations'}, {'bag': 'a.bag', 'loop': 'true'}],
    'record.launch': [{}, {'output': 'out', 'megabytes': '100', 'input': 'raw', 'allow_default_calibration': 'true'}],
    'replay.launch': [{'bag': '/a.bag'}, {'images': '/pictures', 'rviz': 'true'}, {'bag': 'a.bag', 'output': 'out'}],
    'simulation.launch': [{}, {'scenario': 'a.yaml', 'ends': 'true', 'input': 'raw'}, {'rviz': 'true', 'seed': '7'}],
    'demo.launch': [{}, {'bag': '/a.bag'}, {'scenario': '/a.yaml', 'rviz': 'true', 'stage': 'stop_only'}],
}
"""Arguments beside veh."""

SETTINGS = {
    'obstacle_detection_node': DetectionNodeSettings,
    'obstacle_avoidance_node': AvoidanceNodeSettings,
    'obstacle_detection_visual_node': VisualNodeSettings,
    'lane_controller_node': ControllerNodeSettings,
    'car_cmd_guard_node': GuardNodeSettings,
    'daffy_adapter_node': AdapterNodeSettings,
    'replay_node': ReplaySettings,
    'simulator_node': SimulatorNodeSettings,
}

FILES = {
    'obstacle_detection_node': ['obstacle_detection_node', 'bird_view'],
    'obstacle_avoidance_node': ['obstacle_avoidance_node', 'lane_estimate'],
    'lane_controller_node': ['lane_controller_node', 'lane_estimate'],
    'obstacle_detection_visual_node': ['bird_view'],
    'simulator_node': ['simulation'],
}
"""In config; of the others one with the node's name."""

TOOLS = ('play', 'record')
"""Programs that take arguments instead of parameters."""

CONTRACT = {
    'obstacle_detection_node': {
        '~image/compressed': 'camera_node/image/compressed',
        '~image': 'camera_node/image',
        '~camera_info': 'camera_node/camera_info',
        '~car_cmd': 'lane_controller_node/car_cmd',
        '~thresholds': 'anti_instagram_node/thresholds',
        '~posearray': 'obstacle_detection_node/posearray',
        '~lane_pose': 'obstacle_detection_node/lane_pose',
    },
    'obstacle_avoidance_node': {
        '~posearray': 'obstacle_detection_node/posearray',
        '~lane_pose': 'lane_filter_node/lane_pose',
        '~own_lane_pose': 'obstacle_detection_node/lane_pose',
        '~car_cmd': 'lane_controller_node/car_cmd',
        '~turn': 'turn',
        '~lane_control': 'obstacle_avoidance_node/lane_control',
        '~obstacle_avoidance_active_flag': 'obstacle_avoidance_node/obstacle_avoidance_active_flag',
        '~markers': 'obstacle_avoidance_node/markers',
    },
    'lane_controller_node': {
        '~lane_pose': 'lane_filter_node/lane_pose',
        '~own_lane_pose': 'obstacle_detection_node/lane_pose',
        '~lane_control': 'obstacle_avoidance_node/lane_control',
        '~car_cmd': 'lane_controller_node/car_cmd',
    },
    'car_cmd_guard_node': {
        '~car_cmd': 'lane_controller_node/car_cmd',
        '~obstacle_distance_reading': 'road_anomaly_watcher/obstacle_distance',
    },
    'daffy_adapter_node': {
        '~lane_filter_pose': 'lane_filter_node/lane_pose',
        '~lane_pose': 'daffy_adapter_node/lane_pose',
        '~lane_control': 'obstacle_avoidance_node/lane_control',
        '~mode': 'fsm_node/mode',
        '~switch': 'daffy_adapter_node/switch',
        '~obstacle_distance_reading': 'road_anomaly_watcher/obstacle_distance',
        '~emergency_stop': 'wheels_driver_node/emergency_stop',
    },
    'obstacle_detection_visual_node': {
        '~posearray': 'obstacle_detection_node/posearray',
        '~image_in/compressed': 'camera_node/image/compressed',
        '~image_in': 'camera_node/image',
        '~plan': 'obstacle_avoidance_node/markers',
        '~detector_settings': 'obstacle_detection_node/parameter_updates',
        '~markers': 'obstacle_detection_visual_node/markers',
        '~image': 'obstacle_detection_visual_node/image',
        '~bird_view': 'obstacle_detection_visual_node/bird_view',
    },
    'replay_node': {
        '~image/compressed': 'camera_node/image/compressed',
        '~image': 'camera_node/image',
        '~camera_info': 'camera_node/camera_info',
        '~lane_pose': 'lane_filter_node/lane_pose',
        '~car_cmd': 'replay_node/car_cmd',
        '~turn': 'turn',
        '~posearray': 'obstacle_detection_node/posearray',
        '~lane_control': 'obstacle_avoidance_node/lane_control',
        '~annotated/compressed': 'obstacle_detection_visual_node/image/compressed',
    },
    'simulator_node': {
        '~image/compressed': 'camera_node/image/compressed',
        '~image': 'camera_node/image',
        '~camera_info': 'camera_node/camera_info',
        '~lane_pose': 'lane_filter_node/lane_pose',
        '~car_cmd': 'lane_controller_node/car_cmd',
        '~lane_control': 'obstacle_avoidance_node/lane_control',
        '~turn': 'turn',
        '~scenario': 'simulator_node/scenario',
        '~latency': 'simulator_node/latency',
        '~truth/pose': 'simulator_node/truth/pose',
        '~truth/lane_pose': 'simulator_node/truth/lane_pose',
        '~truth/obstacles': 'simulator_node/truth/obstacles',
        '~truth/gap': 'simulator_node/truth/gap',
        '~truth/contact': 'simulator_node/truth/contact',
    },
}
"""Private names in code, and where they lead under /<veh> (docs/architecture.md, Topics)."""


def nodes_of(config: Any) -> Dict[str, Any]:
    """By full name."""
    return {rosgraph.names.ns_join(node.namespace, node.name): node for node in config.nodes}


def resolved(node: Any, name: str) -> str:
    """Where a name in a node's code leads, by the node's remaps."""
    full = rosgraph.names.ns_join(node.namespace, node.name)
    remaps = {
        rosgraph.names.resolve_name(old, full): rosgraph.names.resolve_name(new, full) for old, new in node.remap_args
    }
    plain = rosgraph.names.resolve_name(name, full)
    return str(remaps.get(plain, plain))


def private(config: Any, node: str) -> Dict[str, Any]:
    """A node's parameters as rospy.get_param('~') returns them."""
    tree: Dict[str, Any] = {}
    for name, param in config.params.items():
        if name.startswith(node + '/'):
            *groups, leaf = name[len(node) + 1 :].split('/')
            branch = tree
            for group in groups:
                branch = branch.setdefault(group, {})
            branch[leaf] = param.value
    return tree


def param(config: Any, name: str) -> Optional[Any]:
    return config.params[name].value if name in config.params else None


CALLS = [(name, arguments) for name in LAUNCH for arguments in REASONABLE.get(name, [])]


def test_each_launch_file_is_tested_here() -> None:
    assert set(LAUNCH) == set(REASONABLE)


@pytest.mark.parametrize(('name', 'arguments'), CALLS)
def test_it_parses(name: str, arguments: Dict[str, str]) -> None:
    config = load_launch(name, veh='duck1', **arguments)
    assert config.nodes
    assert not config.config_errors
    for full, node in nodes_of(config).items():
        assert full.startswith('/duck1/')
        if node.package == 'obst_avoid':
            assert (REPOSITORY / 'scripts' / node.type).exists()


@pytest.mark.parametrize(('name', 'arguments'), CALLS)
def test_each_node_is_given_all_its_settings_and_no_others(name: str, arguments: Dict[str, str]) -> None:
    config = load_launch(name, veh='duck1', **arguments)
    for full, node in nodes_of(config).items():
        if node.package == 'obst_avoid' and node.type not in TOOLS:
            settings = load(SETTINGS[node.type], private(config, full), full)
            assert settings.veh == 'duck1'
    known = tuple(full + '/' for full in nodes_of(config))
    strays = [name for name in config.params if not name.startswith((*known, '/use_sim_time', '/ros'))]
    assert strays == []


@pytest.mark.parametrize(('name', 'arguments'), CALLS)
def test_names_lead_to_the_topics_of_the_contract(name: str, arguments: Dict[str, str]) -> None:
    config = load_launch(name, veh='duck1', **arguments)
    for node in config.nodes:
        if node.package == 'obst_avoid' and node.type not in TOOLS:
            wanted = {own: '/duck1/' + topic for own, topic in CONTRACT[node.type].items()}
            if name == 'replay.launch' and node.type in ('obstacle_detection_node', 'obstacle_avoidance_node'):
                wanted['~car_cmd'] = '/duck1/replay_node/car_cmd'  # how the robot moved when it was recorded
            assert {own: resolved(node, own) for own in wanted} == wanted
            assert {own for own, _ in node.remap_args} <= set(wanted), 'a remap of a name that the node does not use'


@pytest.mark.parametrize('node', sorted(CONTRACT))
def test_the_names_of_the_contract_are_those_in_code(node: str) -> None:
    code = (REPOSITORY / 'src' / 'obst_avoid' / 'ros' / (node + '.py')).read_text()
    assert set(re.findall(r"'(~[a-z_/]+)'", code)) == set(CONTRACT[node])


def test_a_robots_nodes() -> None:
    assert set(nodes_of(load_launch('obst_avoid.launch', veh='duck1'))) == {
        '/duck1/obstacle_detection_node',
        '/duck1/obstacle_avoidance_node',
        '/duck1/car_cmd_guard_node',
    }


def test_nodes_are_started_again_unless_told_otherwise() -> None:
    for name in ('obst_avoid.launch', 'daffy.launch'):
        assert all(node.respawn for node in nodes_of(load_launch(name, veh='duck1')).values()), name
    config = load_launch('obst_avoid.launch', veh='duck1', respawn='false')
    assert not any(node.respawn for node in nodes_of(config).values())


def test_the_lane_controller_only_when_asked_for() -> None:
    config = load_launch('obst_avoid.launch', veh='duck1', lane_controller='true')
    assert '/duck1/lane_controller_node' in nodes_of(config)


def test_rviz_unless_told_otherwise() -> None:
    rviz = nodes_of(load_launch('visualizer.launch', veh='duck1'))['/duck1/rviz']
    assert '-f duck1/footprint' in rviz.args
    path = re.search(r'-d (\S+)', rviz.args)
    assert path is not None
    assert path.group(1).endswith('rviz/obst_avoid.rviz')
    assert '/duck1/rviz' not in nodes_of(load_launch('visualizer.launch', veh='duck1', rviz='false'))
    assert '/duck1/rviz' not in nodes_of(load_launch('replay.launch', veh='duck1', bag='/a.bag'))


def test_a_replay_starts_the_whole_graph_on_simulated_time_and_ends_with_it() -> None:
    config = load_launch('replay.launch', veh='duck1', bag='/a.bag')
    nodes = nodes_of(config)
    assert {node.type for node in nodes.values()} == set(SETTINGS) - {'simulator_node', 'daffy_adapter_node'}
    assert param(config, '/use_sim_time') is True
    assert [full for full, node in nodes.items() if node.required] == ['/duck1/replay_node']


@pytest.mark.parametrize('name', ['simulation.launch', 'demo.launch'])
def test_a_simulation_starts_the_whole_graph_on_simulated_time_and_ends_with_it(name: str) -> None:
    config = load_launch(name, veh='duck1')
    nodes = nodes_of(config)
    assert {node.type for node in nodes.values()} == set(SETTINGS) - {'replay_node', 'daffy_adapter_node'}
    assert param(config, '/use_sim_time') is True
    assert [full for full, node in nodes.items() if node.required] == ['/duck1/simulator_node']
    assert param(config, '/duck1/simulator_node/ends') is (name == 'demo.launch')


def arguments_of(node: Any) -> List[str]:
    """As roslaunch passes them."""
    return shlex.split(node.args)


def test_the_demo_records_into_one_bag() -> None:
    recorder = nodes_of(load_launch('demo.launch', veh='duck1', bag='/a b.bag'))['/duck1/recorder']
    assert (recorder.package, recorder.type) == ('obst_avoid', 'record')
    assert arguments_of(recorder) == ['--vehicle', 'duck1', '--bag', '/a b.bag']
    assert '/duck1/recorder' not in nodes_of(load_launch('demo.launch', veh='duck1'))


def test_what_is_recorded_is_what_the_report_reads() -> None:
    found = topics('duck1', 'compressed')
    simulated = {'/duck1/' + topic for topic in CONTRACT['simulator_node'].values()} - {'/duck1/camera_node/image'}
    assert simulated <= set(found) and len(set(found)) == len(found)
    for node, name in (('obstacle_detection_node', '~posearray'), ('obstacle_avoidance_node', '~markers')):
        assert '/duck1/' + CONTRACT[node][name] in found
    assert {'/diagnostics', '/rosout', '/tf_static'} <= set(found) and '/clock' not in found
    raw = topics('duck1', 'raw')
    assert set(found) ^ set(raw) == {'/duck1/camera_node/image', '/duck1/camera_node/image/compressed'}


def test_record_passes_its_arguments_on_and_ends_with_the_recorder() -> None:
    given = {'output': 'a b', 'megabytes': '100', 'calibration_dir': 'c', 'input': 'raw'}
    node = nodes_of(load_launch('record.launch', veh='duck1', allow_default_calibration='true', **given))[
        '/duck1/recorder'
    ]
    expected = '--vehicle duck1 --output "a b" --megabytes 100 --calibration c --input raw --default-calibration'
    assert arguments_of(node) == shlex.split(expected) and node.required
    plain = arguments_of(nodes_of(load_launch('record.launch', veh='007'))['/007/recorder'])
    expected = '--vehicle 007 --output . --megabytes 2000 --calibration "" --input compressed'
    assert plain == shlex.split(expected)


def test_a_bag_is_played_to_the_visualizer_alone() -> None:
    config = load_launch('visualizer.launch', veh='007', bag='a b.bag', rate='0.5', loop='true')
    assert set(nodes_of(config)) == {'/007/obstacle_detection_visual_node', '/007/rviz', '/007/player'}
    assert param(config, '/use_sim_time') is True
    expected = '"a b.bag" --vehicle 007 --input compressed --rate 0.5 --loop'
    assert arguments_of(nodes_of(config)['/007/player']) == shlex.split(expected)
    assert '/use_sim_time' not in load_launch('visualizer.launch', veh='duck1').params
    assert '--loop' not in nodes_of(load_launch('visualizer.launch', veh='duck1', bag='1'))['/duck1/player'].args


def test_robots_do_not_run_on_simulated_time() -> None:
    assert '/use_sim_time' not in load_launch('obst_avoid.launch', veh='duck1').params


@pytest.mark.parametrize('name', ['obst_avoid.launch', 'replay.launch', 'simulation.launch', 'demo.launch'])
def test_profile_and_stage_override_the_yaml_only_when_given(name: str) -> None:
    config = load_launch(name, veh='duck1')
    assert param(config, '/duck1/obstacle_detection_node/profile') == 'robust'
    assert param(config, '/duck1/obstacle_avoidance_node/stage') == 'avoid_all'
    config = load_launch(name, veh='duck1', profile='paper', stage='stop_only')
    assert param(config, '/duck1/obstacle_detection_node/profile') == 'paper'
    assert param(config, '/duck1/obstacle_avoidance_node/stage') == 'stop_only'


@pytest.mark.parametrize('name', [name for name in LAUNCH if name != 'record.launch'])
def test_config_names_the_folder_of_all_settings(name: str, tmp_path: Path) -> None:
    arguments = {**REASONABLE[name][-1], 'veh': 'duck1', 'config': str(tmp_path)}
    with pytest.raises(LoadException, match=re.escape('file does not exist [%s/' % tmp_path)):
        load_launch(name, **arguments)
    for path in (REPOSITORY / 'config').glob('*.yaml'):
        (tmp_path / path.name).write_text('%s\nsaid_%s: here\n' % (path.read_text(), path.stem))
    config = load_launch(name, **arguments)
    for full, node in nodes_of(config).items():
        if node.type in SETTINGS and node.type != 'replay_node':
            found = {name.split('/')[-1] for name in config.params if name.startswith(full + '/said_')}
            assert found == {'said_' + stem for stem in FILES.get(node.type, [node.type])}


def test_a_replay_passes_its_arguments_on() -> None:
    arguments = {
        'calibration_dir': '/calibrations',
        'allow_default_calibration': 'true',
        'msgs_package': 'duckietown_msgs',
        'input': 'raw',
    }
    config = load_launch('replay.launch', veh='duck1', bag='/a.bag', picture_rate='10', **arguments)
    for node in ('obstacle_detection_node', 'obstacle_detection_visual_node'):
        assert param(config, '/duck1/%s/calibration_dir' % node) == '/calibrations'
        assert param(config, '/duck1/%s/allow_default_calibration' % node) is True
        assert param(config, '/duck1/%s/input' % node) == 'raw'
    for node in ('obstacle_detection_node', 'obstacle_avoidance_node', 'lane_controller_node', 'replay_node'):
        assert param(config, '/duck1/%s/msgs_package' % node) == 'duckietown_msgs'
    assert param(config, '/duck1/replay_node/picture_rate') == 10.0
    assert param(config, '/duck1/replay_node/input') == 'raw'


@pytest.mark.parametrize(
    'name', [name for name in LAUNCH if name not in ('demo.launch', 'record.launch', 'simulation.launch')]
)
def test_a_robot_never_gets_a_made_up_calibration_unasked(name: str) -> None:
    config = load_launch(name, veh='duck1')
    asked = [value.value for full, value in config.params.items() if full.endswith('/allow_default_calibration')]
    assert asked
    assert not any(asked)


@pytest.mark.parametrize('name', [name for name in LAUNCH if name != 'record.launch'])
@pytest.mark.parametrize(
    ('given', 'wanted'),
    [
        ('', ''),
        ('/data/cal', '/data/cal'),
        ('cal', '/here/cal'),
        ('../cal', '/here/../cal'),
        ('2024', '/here/2024'),
        ('true', '/here/true'),
        ("it's", "/here/it's"),
    ],
)
def test_a_relative_calibration_dir_is_seen_from_where_roslaunch_was_called(
    name: str, given: str, wanted: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The nodes run elsewhere, in ~/.ros.
    monkeypatch.setenv('PWD', '/here')
    config = load_launch(name, veh='duck1', calibration_dir=given)
    found = {path_of_user(value.value) for full, value in config.params.items() if full.endswith('/calibration_dir')}
    assert found == {wanted}


@pytest.mark.parametrize('argument', ['bag', 'images', 'output'])
def test_relative_paths_of_a_replay(argument: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('PWD', '/here')
    for given, wanted in (('a/b', '/here/a/b'), ('/a/b', '/a/b'), ('', ''), ('2018', '/here/2018')):
        config = load_launch('replay.launch', veh='duck1', **{argument: given})
        assert path_of_user(param(config, '/duck1/replay_node/' + argument)) == wanted


@pytest.mark.parametrize('veh', ['007', 'true', '1e3'])
def test_a_robot_whose_name_reads_like_a_number(veh: str) -> None:
    config = load_launch('replay.launch', veh=veh, bag='/a.bag', msgs_package='obst_avoid')
    for full, node in nodes_of(config).items():
        assert load(SETTINGS[node.type], private(config, full), full).veh == veh
