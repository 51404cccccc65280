"""run_bag: a bag through detector and avoider without a running ROS graph, on the nodes' own code path."""

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from typing import Any, Dict, List, Tuple

import rosbag
from obst_avoid.core import detection
from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.calibration import CalibrationError
from obst_avoid.core.picture import PictureError
from obst_avoid.core.settings import load
from obst_avoid.core.types import Decision, LanePose, Obstacle, Stamped
from obst_avoid.offline import tool
from obst_avoid.offline.recording import JPEG, LANE_POSE, RAW, messages, open_bag
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
    parser.add_argument('--stage', default='', help='of commissioning, instead of the one that the settings name')
    parser.add_argument('--robot', metavar='NAME', default='', help='whose topics are read, if the bag has several robots')
    parser.add_argument('--output', metavar='BAG', help='bag to write: posearray, lane_control and the active flag')
    parser.add_argument('--json', metavar='FILE', help='write the summary there')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    recording = open_bag(options.bag, options.robot)
    detector = detection.start(tool.calibration_of(options), tool.detection_settings(options))
    content = tool.node_yaml(options.config, 'obstacle_avoidance_node.yaml')
    if options.stage:
        content['stage'] = options.stage
    settings = load(AvoidanceSettings, content, 'obstacle_avoidance_node')
    if options.output and os.path.exists(options.output):
        raise tool.ToolError('%s exists, expected a new file' % options.output)
    if LANE_POSE not in recording.topics:
        print('the recording has no lane pose: taking d = phi = 0', file=sys.stderr)
    veh = recording.topics[recording.picture_role].strip('/').split('/')[0]
    inputs, memory = Inputs(), Memory()
    lists: List[List[Obstacle]] = []
    decisions: List[Decision] = []
    seconds: List[float] = []
    broken: List[str] = []
    results: List[Tuple[int, int, List[Obstacle], Decision]] = []
    for item in tool.progress(messages(recording), 'running'):
        if item.role == LANE_POSE:
            try:
                pose = border.lane_pose_from_msg(item.msg)
                inputs = replace(inputs, lane_pose=Stamped(border.nanoseconds(item.msg.header.stamp), pose))
            except border.BorderError as error:
                broken.append(str(error))
        if item.role not in (JPEG, RAW):
            continue
        stamp = border.nanoseconds(item.msg.header.stamp)
        if LANE_POSE not in recording.topics:
            inputs = replace(inputs, lane_pose=Stamped(stamp, LanePose(0.0, 0.0)))
        begin = time.perf_counter()
        try:
            jpeg = item.role == JPEG
            picture = border.picture_from_compressed_image(item.msg) if jpeg else border.picture_from_image(item.msg)
            obstacles, detector = detection.detect(detector, picture, stamp)
        except (PictureError, CalibrationError) as error:
            broken.append('picture %.3f: %s' % (stamp / 1e9, error))
            continue
        inputs = replace(inputs, obstacles=Stamped(stamp, obstacles))
        decision, memory = decide(inputs, memory, item.time, settings)
        seconds.append(time.perf_counter() - begin)
        lists.append(obstacles)
        decisions.append(decision)
        if options.output:
            results.append((item.time, stamp, obstacles, decision))
    for sentence in broken:
        print('run_bag: %s: %s' % (options.bag, sentence), file=sys.stderr)
    summary = summarise(recording.pictures, lists, decisions, seconds, recording.pictures - len(lists))
    print(table(summary))
    if options.output:
        _write(options.output, veh, results)
    if options.json:
        with open(options.json, 'w', encoding='utf-8') as file:
            json.dump(summary, file, indent=1)
    return 1 if broken else 0


def _write(path: str, veh: str, results: List[Tuple[int, int, List[Obstacle], Decision]]) -> None:
    flag_class = find_messages('').BoolStamped
    with rosbag.Bag(path, 'w') as bag:
        for now, stamp, obstacles, decision in results:
            out: Dict[str, Any] = {
                'obstacle_detection_node/posearray': border.pose_array_from_obstacles(
                    obstacles, stamp, border.footprint_frame(veh)
                ),
                'obstacle_avoidance_node/lane_control': border.lane_control_from_decision(decision, stamp),
                'obstacle_avoidance_node/obstacle_avoidance_active_flag': border.flag_from_decision(
                    decision, stamp, flag_class
                ),
            }
            for topic, msg in out.items():
                bag.write('/%s/%s' % (veh, topic), msg, border.ros_time(now))
