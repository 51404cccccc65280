"""run_bag: a bag through detector and avoider without a running ROS graph, by the functions that the nodes call.

It decides once a picture, without delay: what the nodes' timers say in gaps between pictures does not appear.
"""

import argparse
import sys
import time
from dataclasses import dataclass, replace
from typing import Any, Callable, Dict, Iterator, List, Sequence, Tuple

import rosbag

from obst_avoid.core import detection
from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.avoidance.corridor import TURNS
from obst_avoid.core.avoidance.settings import STAGES, AvoidanceSettings
from obst_avoid.core.calibration import CalibrationError
from obst_avoid.core.motion import remembered
from obst_avoid.core.picture import PictureError
from obst_avoid.core.types import Command, Decision, LanePose, Scene, Stamped
from obst_avoid.offline import tool
from obst_avoid.offline.recording import (
    CAR_CMD,
    JPEG,
    LANE_POSE,
    RAW,
    TURN,
    Recording,
    messages,
    open_bag,
    picture_of,
    robot_of,
)
from obst_avoid.offline.summary import summarise, table
from obst_avoid.ros import border
from obst_avoid.ros.messages import find_messages


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='run_bag', description='Run a bag through detector and avoider, as fast as possible, without ROS running.'
    )
    tool.add_calibration_arguments(parser)
    parser.add_argument('bag', metavar='BAG')
    parser.add_argument('--stage', choices=STAGES, help='of commissioning, instead of the one that the settings name')
    parser.add_argument(
        '--robot', metavar='NAME', default='', help='whose topics are read, if the bag has several robots'
    )
    parser.add_argument(
        '--output', metavar='BAG', help='bag to write: posearray, our own lane pose, lane_control and the active flag'
    )
    parser.add_argument('--json', metavar='FILE', help='write the summary there')
    return tool.run(_main, parser, arguments)


@dataclass(frozen=True)
class Answer:
    """What detector and avoider make of one picture. time: [ns] of its recording. stamp: [ns]. seconds: it took."""

    time: int
    stamp: int
    scene: Scene
    decision: Decision
    seconds: float


def run(
    recording: Recording,
    detector: detection.Detector,
    settings: AvoidanceSettings,
    complain: Callable[[str], None],
) -> Iterator[Answer]:
    """Work through a recording, picture by picture. A message that cannot be used is complained about and skipped."""
    inputs, memory = Inputs(), Memory()
    commands: Tuple[Stamped[Command], ...] = ()
    for item in messages(recording, motion=True):
        if item.role == TURN and item.msg.data in ('', *TURNS):
            inputs = replace(inputs, turn=Stamped(item.time, item.msg.data) if item.msg.data else None)
        if item.role not in (LANE_POSE, CAR_CMD, JPEG, RAW):
            continue
        stamp = border.nanoseconds(item.msg.header.stamp)
        begin = time.perf_counter()
        try:
            if item.role == CAR_CMD:
                commands = remembered(commands, Stamped(item.time, border.command_from_msg(item.msg)))
                continue
            if item.role == LANE_POSE:
                inputs = replace(inputs, lane_pose=Stamped(stamp, border.lane_pose_from_msg(item.msg)))
                continue
            scene, detector = detection.detect(detector, picture_of(item), stamp, commands)
        except (PictureError, CalibrationError, border.BorderError) as error:
            complain('%.3f s: %s' % (stamp / 1e9, error))
            continue
        inputs = replace(inputs, obstacles=Stamped(stamp, scene.obstacles), commands=commands)
        if scene.lane_pose is not None:
            inputs = replace(inputs, own_lane_pose=Stamped(stamp, scene.lane_pose))
        if LANE_POSE not in recording.topics:
            inputs = replace(inputs, lane_pose=Stamped(stamp, LanePose(0.0, 0.0)))
        decision, memory = decide(inputs, memory, item.time, settings)
        yield Answer(item.time, stamp, scene, decision, time.perf_counter() - begin)


def _main(options: argparse.Namespace) -> int:
    if options.output:
        tool.new_file(options.output)
    if options.json:
        tool.writable(options.json)
    recording = open_bag(options.bag, options.robot)
    detector = detection.start(tool.calibration_of(options), tool.detection_settings(options))
    settings = tool.avoidance_settings(options.config, options.stage)
    if LANE_POSE not in recording.topics:
        print('the recording has no lane pose: taking d = phi = 0', file=sys.stderr)
    broken: List[str] = []
    answers = list(tool.progress(run(recording, detector, settings, broken.append), 'running', recording.pictures))
    for sentence in broken:
        print('run_bag: %s: %s' % (options.bag, sentence), file=sys.stderr)
    summary = summarise(
        recording.pictures,
        [answer.scene.obstacles for answer in answers],
        [answer.decision for answer in answers],
        [answer.seconds for answer in answers],
        recording.pictures - len(answers),
    )
    print(table(summary))
    if options.output:
        _write(options.output, robot_of(recording), answers)
    if options.json:
        tool.write_json(options.json, summary)
    return 1 if broken else 0


def _write(path: str, veh: str, answers: Sequence[Answer]) -> None:
    classes = find_messages('')
    with tool.whole(path) as part, rosbag.Bag(part, 'w') as bag:
        for answer in answers:
            scene = answer.scene
            posearray = border.pose_array_from_obstacles(scene.obstacles, answer.stamp, border.footprint_frame(veh))
            out: Dict[str, Any] = {
                'obstacle_detection_node/posearray': posearray,
                'obstacle_avoidance_node/lane_control': border.lane_control_from_decision(
                    answer.decision, answer.stamp
                ),
                'obstacle_avoidance_node/obstacle_avoidance_active_flag': border.flag_from_decision(
                    answer.decision, answer.stamp, classes.BoolStamped
                ),
            }
            if scene.lane_pose is not None:
                out['obstacle_detection_node/lane_pose'] = border.msg_from_lane_pose(
                    scene.lane_pose, answer.stamp, classes.LanePose
                )
            for topic, msg in out.items():
                bag.write('/%s/%s' % (veh, topic), msg, border.ros_time(answer.time))
