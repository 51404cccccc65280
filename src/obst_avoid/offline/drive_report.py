"""drive_report: a film, a plot and a summary of a recorded drive, simulated or real."""

import argparse
import json
import math
import os
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

import matplotlib
import numpy as np
import rosbag

from obst_avoid.core import detection
from obst_avoid.core.age import age
from obst_avoid.core.avoidance.corridor import View
from obst_avoid.core.bird_view import BirdView
from obst_avoid.core.picture import PictureError, decode_jpeg
from obst_avoid.core.types import Array, Decision, Obstacle, State
from obst_avoid.offline import tool
from obst_avoid.offline.recording import open_bag, robot_of
from obst_avoid.offline.simulation import calibration_of, map_of, towns_folder, write_film
from obst_avoid.offline.summary import summarise, table
from obst_avoid.ros import border
from obst_avoid.ros.markers import view_from_markers
from obst_avoid.sim.scenario import load_scenario
from obst_avoid.viz.film import Map, Shot, compose
from obst_avoid.viz.overlay import STATE_COLORS

matplotlib.use('Agg')  # no screen; has to be said before pyplot is imported
from matplotlib import pyplot

FILM_RATE = 10.0
PLAN_AGE_LIMIT = 0.3
"""[s] between a decision and a plan that is shown with it."""
NOTHING_DECIDED = (0, Decision(State.FAULT, 0.0, 0.0, 'nothing decided yet'))
"""Stamp [ns] and decision."""


@dataclass
class Drive:
    """What a bag holds, in order of time. Times in s since the first message. plans: by stamp [ns]."""

    pictures: List[Tuple[float, int, bytes]] = field(default_factory=list)
    obstacles: Dict[int, List[Obstacle]] = field(default_factory=dict)
    decisions: List[Tuple[float, int, Decision]] = field(default_factory=list)
    plans: Dict[int, View] = field(default_factory=dict)
    commands: List[Tuple[float, float, float]] = field(default_factory=list)
    lane_poses: List[Tuple[float, float, float]] = field(default_factory=list)
    poses: List[Tuple[float, float, float, float]] = field(default_factory=list)
    true_lane: List[Tuple[float, float, float]] = field(default_factory=list)
    true_obstacles: List[Tuple[float, List[Obstacle]]] = field(default_factory=list)
    gaps: List[Tuple[float, float]] = field(default_factory=list)
    contacts: List[Tuple[float, bool]] = field(default_factory=list)
    latencies: List[float] = field(default_factory=list)
    scenario: Optional[Dict[str, Any]] = None


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='drive_report', description='Make a film, a plot over time and a summary of a recorded drive.'
    )
    tool.add_calibration_arguments(parser)
    parser.add_argument('bag', metavar='BAG', help='with pictures, posearray, lane_control and car_cmd')
    parser.add_argument('--output', metavar='DIR', required=True, help='folder for drive.mp4, drive.png, drive.json')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    os.makedirs(options.output, exist_ok=True)
    summary = report(options)
    print(table(summary))
    return 0


def report(options: argparse.Namespace) -> Dict[str, Any]:
    """Write film, plot and summary; returns the summary. options: bag, output, and those of the calibration."""
    drive = read_drive(options.bag)
    detector = detection.start(calibration_of(options), tool.detection_settings(options))
    summary = summary_of(drive)
    tool.write_json(os.path.join(options.output, 'drive.json'), summary)
    plot(drive, os.path.join(options.output, 'drive.png'))
    pictures = film_of_drive(drive, detector.view, _map(drive, options.config), _title(drive, options.bag))
    write_film(os.path.join(options.output, 'drive.mp4'), pictures, FILM_RATE)
    return summary


def read_drive(path: str) -> Drive:
    """Read a bag. Raises ToolError when it has no pictures; what else is missing stays empty."""
    veh = robot_of(open_bag(path))
    drive = Drive()
    frame = border.footprint_frame(veh)
    begin: Optional[float] = None
    with rosbag.Bag(path) as bag:
        for topic, msg, time in bag.read_messages():
            if not topic.startswith('/%s/' % veh):
                continue
            begin = time.to_sec() if begin is None else begin
            try:
                _take(drive, topic[len(veh) + 2 :], msg, time.to_sec() - begin, frame)
            except border.BorderError:
                continue  # the nodes did not use it either
    return drive


def _take(drive: Drive, name: str, msg: Any, now: float, frame: str) -> None:
    """Sort one message in."""
    if name == 'camera_node/image/compressed':
        drive.pictures.append((now, border.nanoseconds(msg.header.stamp), bytes(msg.data)))
    elif name == 'obstacle_detection_node/posearray':
        drive.obstacles[border.nanoseconds(msg.header.stamp)] = border.obstacles_from_pose_array(msg, frame)
    elif name == 'obstacle_avoidance_node/lane_control':
        drive.decisions.append((now, border.nanoseconds(msg.header.stamp), border.decision_from_lane_control(msg)))
    elif name == 'obstacle_avoidance_node/markers':
        plan = view_from_markers(msg)
        drive.plans[border.nanoseconds(msg.markers[0].header.stamp)] = plan
    elif name == 'lane_controller_node/car_cmd':
        drive.commands.append((now, msg.v, msg.omega))
    elif name == 'lane_filter_node/lane_pose':
        drive.lane_poses.append((now, msg.d, msg.phi))
    else:
        _take_simulated(drive, name, msg, now, frame)


def _take_simulated(drive: Drive, name: str, msg: Any, now: float, frame: str) -> None:
    """Sort in what only the simulator says."""
    if name == 'simulator_node/truth/pose':
        turn = msg.pose.orientation
        heading = 2 * float(np.arctan2(turn.z, turn.w))
        drive.poses.append((now, msg.pose.position.x, msg.pose.position.y, heading))
    elif name == 'simulator_node/truth/lane_pose':
        drive.true_lane.append((now, msg.d, msg.phi))
    elif name == 'simulator_node/truth/obstacles':
        drive.true_obstacles.append((now, border.obstacles_from_pose_array(msg, frame)))
    elif name == 'simulator_node/truth/gap':
        drive.gaps.append((now, msg.data))
    elif name == 'simulator_node/truth/contact':
        drive.contacts.append((now, msg.data))
    elif name == 'simulator_node/latency':
        drive.latencies.append(msg.data)
    elif name == 'simulator_node/scenario':
        drive.scenario = json.loads(msg.data)


def summary_of(drive: Drive) -> Dict[str, Any]:
    """What happened, in numbers; the truth only where the recording has it."""
    stamps = {stamp: time for time, stamp, _ in drive.pictures}
    first: Dict[int, float] = {}
    for time, stamp, _ in drive.decisions:
        if stamp in stamps:
            first.setdefault(stamp, time - stamps[stamp])
    latencies = drive.latencies or list(first.values())
    answered = [drive.obstacles[stamp] for _, stamp, _ in drive.pictures if stamp in drive.obstacles]
    skipped = len(drive.pictures) - len(answered)
    summary = summarise(
        len(drive.pictures), answered, [decision for _, _, decision in drive.decisions], latencies, skipped
    )
    seconds = drive.pictures[-1][0] - drive.pictures[0][0] if len(drive.pictures) > 1 else 0.0
    summary['seconds'] = round(seconds, 1)
    summary['pictures_per_second'] = round((len(drive.pictures) - 1) / seconds, 1) if seconds else None
    if drive.poses:
        places = np.array([pose[1:3] for pose in drive.poses])
        summary['metres'] = round(float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()), 2)
    if drive.contacts:
        touched = [time for time, contact in drive.contacts if contact]
        summary['contacts'] = int(bool(touched))
        gap = min((gap for _, gap in drive.gaps), default=math.inf)
        summary['smallest_gap_m'] = round(gap, 3) if math.isfinite(gap) else None  # JSON knows no inf
        summary['stops_before_an_obstacle'] = _true_stops(drive)
    return summary


def _true_stops(drive: Drive) -> int:
    """Stops with an obstacle in the lane less than 1 m ahead, by the truth."""
    times = [time for time, _ in drive.true_obstacles]
    stops, before = 0, State.FAULT
    for time, _, decision in drive.decisions:
        index = bisect_right(times, time) - 1
        if decision.state is State.STOPPED and before is not State.STOPPED and index >= 0:
            stops += any(item.in_lane and 0 < item.x < 1.0 for item in drive.true_obstacles[index][1])
        before = decision.state
    return stops


def film_of_drive(drive: Drive, view: BirdView, town: Optional[Map], title: str) -> Iterator[Array]:
    """The film's pictures, at FILM_RATE."""
    decision_times = [time for time, _, _ in drive.decisions]
    command_times, pose_times = [item[0] for item in drive.commands], [item[0] for item in drive.poses]
    seen_times = [time for time, _ in drive.true_obstacles]
    plan_stamps = sorted(drive.plans)
    answers = {stamp: (stamp, decision) for _, stamp, decision in reversed(drive.decisions)}  # the first to each
    begin = drive.pictures[0][0]
    due, shown = begin, False
    for time, stamp, jpeg in tool.progress(drive.pictures, 'film'):
        if time + 1e-6 < due:
            continue
        due = max(due + 1 / FILM_RATE, time)
        try:
            picture = decode_jpeg(jpeg)
        except PictureError:
            continue
        at = bisect_right(decision_times, time) - 1
        in_force = drive.decisions[at][1:] if at >= 0 else NOTHING_DECIDED
        decided, decision = answers.get(stamp, in_force)
        command = bisect_right(command_times, time) - 1
        place = bisect_right(pose_times, time)
        pose = drive.poses[place - 1][1:] if place else None
        seen = bisect_right(seen_times, time) - 1
        standing = _standing(drive.true_obstacles[seen][1], pose) if seen >= 0 and pose else ()
        path = [(x, y) for _, x, y, _ in drive.poses[:place]]
        speed = drive.commands[command][1] if command >= 0 else 0.0
        plan = plan_of(drive, plan_stamps, decided)
        shot = Shot(time - begin, picture, drive.obstacles.get(stamp, []), decision, speed, pose, standing, plan)
        shown = True
        yield compose(shot, view, town, path, title)
    if not shown:
        raise tool.ToolError('no picture of the recording decodes, expected at least one')


def plan_of(drive: Drive, stamps: Sequence[int], decided: int) -> Optional[View]:
    """The newest plan not newer than a decision, None when it is too old. stamps: of drive.plans in order, [ns]."""
    index = bisect_right(stamps, decided) - 1
    if index < 0 or age(stamps[index], decided) > PLAN_AGE_LIMIT:
        return None
    return drive.plans[stamps[index]]


def _standing(
    obstacles: Sequence[Obstacle], pose: Tuple[float, float, float]
) -> List[Tuple[float, float, Optional[bool]]]:
    """Where obstacles in the robot frame stand in the world, and whether in the lane."""
    x, y, heading = pose
    cos, sin = math.cos(heading), math.sin(heading)
    return [(x + cos * item.x - sin * item.y, y + sin * item.x + cos * item.y, item.in_lane) for item in obstacles]


def plot(drive: Drive, path: str) -> None:
    """Speed, place in the lane and nearest obstacle over time; the background shows the avoider's state."""
    begin = drive.pictures[0][0]
    figure, axes = pyplot.subplots(3, 1, sharex=True, figsize=(11, 8), constrained_layout=True)
    spans = [(time - begin, decision.state) for time, _, decision in drive.decisions]
    changes = [span for index, span in enumerate(spans) if not index or span[1] is not spans[index - 1][1]]
    ends = [time for time, _ in changes[1:]] + [spans[-1][0]] if spans else []
    told = set()
    for (time, state), end in zip(changes, ends):
        blue, green, red = (value / 255 for value in STATE_COLORS[state])
        for index, axis in enumerate(axes):
            label = state.name if index == 0 and state not in told else None
            axis.axvspan(time, end, color=(red, green, blue), alpha=0.18, linewidth=0, label=label)
        told.add(state)
    axes[0].plot([item[0] - begin for item in drive.commands], [item[1] for item in drive.commands], label='commanded')
    axes[0].set_ylabel('speed [m/s]')
    poses = drive.lane_poses
    axes[1].plot(
        [item[0] - begin for item in poses], [item[1] for item in poses], '.', markersize=3, label='lane filter'
    )
    if drive.true_lane:
        axes[1].plot(
            [item[0] - begin for item in drive.true_lane], [item[1] for item in drive.true_lane], label='truth'
        )
    wanted = [(time - begin, decision.d_ref) for time, _, decision in drive.decisions]
    axes[1].plot([item[0] for item in wanted], [item[1] for item in wanted], '--', label='d_ref')
    axes[1].set_ylabel("left of the lane's centre [m]")
    seen = [
        (time - begin, [item for item in drive.obstacles.get(stamp, []) if item.in_lane])
        for time, stamp, _ in drive.pictures
    ]
    near = [(time, min(float(np.hypot(item.x, item.y)) for item in items)) for time, items in seen if items]
    axes[2].plot([item[0] for item in near], [item[1] for item in near], '.', markersize=3, label='seen, in the lane')
    true = [
        (time - begin, [item for item in items if item.in_lane and item.x > 0]) for time, items in drive.true_obstacles
    ]
    ahead = [(time, min(float(np.hypot(item.x, item.y)) for item in items)) for time, items in true if items]
    if ahead:
        axes[2].plot([item[0] for item in ahead], [item[1] for item in ahead], '.', markersize=2, label='truth')
    axes[2].set_ylim(0, 2)
    axes[2].set_ylabel('nearest obstacle [m]')
    axes[2].set_xlabel('time [s]')
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.legend(loc='upper right', fontsize=8, ncol=3)
    figure.savefig(path, dpi=90)
    pyplot.close(figure)


def _title(drive: Drive, bag: str) -> str:
    if drive.scenario is None:
        return os.path.basename(bag)
    return '%s, seed %d' % (os.path.basename(drive.scenario['file']), drive.scenario['seed'])


def _map(drive: Drive, config: str) -> Optional[Map]:
    """The town of a simulated drive."""
    if drive.scenario is None or not os.path.isfile(drive.scenario['file']):
        return None
    return map_of(load_scenario(drive.scenario['file'], drive.scenario['seed'], towns_folder(config)).town)
