"""replay_node: plays a bag or a folder of pictures through the graph, on simulated time, and says what happened.

The next picture waits for the answer to the one before, so that nothing is dropped on a slow machine; otherwise
time passes at its usual rate.
"""

import os
import threading
import time
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Tuple

import rospy
from geometry_msgs.msg import PoseArray
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import String

from obst_avoid.core.picture import decode_jpeg
from obst_avoid.core.settings import choice, number, text
from obst_avoid.core.types import Decision, LanePose, Obstacle
from obst_avoid.msg import LaneControl
from obst_avoid.offline.recording import (
    CAMERA_INFO,
    CAR_CMD,
    JPEG,
    LANE_POSE,
    RAW,
    TURN,
    Recorded,
    Recording,
    messages,
    open_bag,
    open_folder,
)
from obst_avoid.offline.summary import summarise, table
from obst_avoid.offline.tool import ToolError, write_json, write_picture
from obst_avoid.ros import border, node
from obst_avoid.ros.messages import find_messages
from obst_avoid.viz.overlay import banner, contact_sheet

TICK = 10_000_000
"""[ns] of simulated time between two messages on /clock, as rosbag play has it."""
ANSWER_WAIT, LOOK, CRAWL = 1.0, 0.1, 1_000_000
"""[s] of wall time for the answer to a picture (one that cannot be used gets none), looked for every LOOK [s], while
ROS time crawls on by CRAWL [ns] a look: a clock that stands still would stop the robot."""
START_WAIT = 30.0
"""[s] of wall time for the nodes to subscribe."""
SHEET_PICTURES = 24
KEPT_PICTURES = 256
"""Annotated pictures that are remembered for the contact sheet; when there are more, every other one goes."""


@dataclass(frozen=True)
class ReplaySettings:
    """What launch files set. bag, images: one of them. output: folder for summary and contact sheet, '' for none."""

    veh: str = text()
    bag: str = text()
    images: str = text()
    output: str = text()
    msgs_package: str = text()
    input: str = choice('compressed', 'raw')
    picture_rate: float = number('1/s', above=0)


class Answers:
    """Collects what the graph says. Filled by callbacks, read when the recording is over."""

    def __init__(self, frame: str) -> None:
        self._frame = frame
        self._changed = threading.Condition()
        self._shown: Dict[int, float] = {}
        self._annotated: List[Tuple[int, bytes]] = []
        self.obstacles: Dict[int, List[Obstacle]] = {}
        self.decisions: List[Decision] = []
        self.decision_of: Dict[int, Decision] = {}
        self.latencies: List[float] = []

    def shows(self, stamp: int) -> None:
        """A picture is about to be published."""
        with self._changed:
            self._shown[stamp] = time.monotonic()

    def on_obstacles(self, msg: PoseArray) -> None:
        """The detector's answer."""
        with self._changed:
            self.obstacles[border.nanoseconds(msg.header.stamp)] = border.obstacles_from_pose_array(msg, self._frame)

    def on_lane_control(self, msg: LaneControl) -> None:
        """The avoider's answer."""
        stamp = border.nanoseconds(msg.header.stamp)
        with self._changed:
            self.decisions.append(border.decision_from_lane_control(msg))
            if stamp in self._shown and stamp not in self.decision_of:
                self.latencies.append(time.monotonic() - self._shown[stamp])
                self.decision_of[stamp] = self.decisions[-1]
                self._changed.notify_all()

    def on_annotated(self, msg: CompressedImage) -> None:
        """The visualizer's picture."""
        with self._changed:
            self._annotated.append((border.nanoseconds(msg.header.stamp), bytes(msg.data)))
            if len(self._annotated) > KEPT_PICTURES:
                del self._annotated[::2]

    def wait(self, stamp: int) -> bool:
        """Wait a moment for the answer to a picture. False: none came yet."""
        with self._changed:
            return self._changed.wait_for(lambda: stamp in self.decision_of, LOOK)

    def sheet(self) -> Optional[Any]:
        """Contact sheet of pictures with obstacles, spread over the drive, with the decisions; all if few."""
        with self._changed:
            annotated = [(stamp, jpeg) for stamp, jpeg in self._annotated if stamp in self.decision_of]
        with_obstacles = [item for item in annotated if self.obstacles.get(item[0])]
        chosen = with_obstacles if len(with_obstacles) >= SHEET_PICTURES else annotated
        step = max(1.0, len(chosen) / SHEET_PICTURES)
        chosen = [chosen[int(i * step)] for i in range(min(SHEET_PICTURES, len(chosen)))]
        panels = []
        for stamp, jpeg in chosen:
            decision = self.decision_of[stamp]
            words = '%s v %.2f d %+.3f' % (decision.state.name, decision.v_ref, decision.d_ref)
            panels.append(('%.2f s' % (stamp / 1e9), banner(decode_jpeg(jpeg), words)))
        return contact_sheet(panels, columns=4, width=400) if panels else None


class ReplayNode:
    """Publishes a recording and /clock, then the summary, then ends."""

    def __init__(self) -> None:
        settings = node.private_settings(ReplaySettings)
        self._output = node.path_of_user(settings.output)
        self._recording = _open(settings)
        self._messages = find_messages(settings.msgs_package)
        self._answers = Answers(border.footprint_frame(settings.veh))
        self._clock = rospy.Publisher('/clock', Clock, queue_size=10)
        self._publishers = {
            self._recording.picture_role: rospy.Publisher(
                '~image/compressed' if settings.input == 'compressed' else '~image',
                CompressedImage if settings.input == 'compressed' else Image,
                queue_size=4,
            ),
            CAMERA_INFO: rospy.Publisher('~camera_info', CameraInfo, queue_size=4),
            LANE_POSE: rospy.Publisher('~lane_pose', self._messages.LanePose, queue_size=4),
            CAR_CMD: rospy.Publisher('~car_cmd', self._messages.Twist2DStamped, queue_size=10),
            TURN: rospy.Publisher('~turn', String, queue_size=4),
        }
        rospy.Subscriber('~posearray', PoseArray, self._answers.on_obstacles, queue_size=100)
        rospy.Subscriber('~lane_control', LaneControl, self._answers.on_lane_control, queue_size=100)
        if settings.output:
            rospy.Subscriber('~annotated/compressed', CompressedImage, self._answers.on_annotated, queue_size=100)
        node.once(self._run)

    def _run(self) -> None:
        self._wait_for_subscribers()
        self._play()
        self._report()

    def _wait_for_subscribers(self) -> None:
        wanted = [self._recording.picture_role, LANE_POSE]
        end = time.monotonic() + START_WAIT
        while not all(self._publishers[role].get_num_connections() for role in wanted):
            if time.monotonic() > end or node.ending():
                raise node.NodeError(
                    'nobody listens to the pictures after %.0f s, expected detector and avoider' % START_WAIT
                )
            time.sleep(0.05)
        time.sleep(0.5)  # for the subscriptions in the other direction

    def _play(self) -> None:
        recording = self._recording
        if LANE_POSE not in recording.topics:
            rospy.logwarn('%s: the recording has no lane pose: publishing d = phi = 0', rospy.get_name())
        now: Optional[int] = None
        wall = time.monotonic()
        for index, item in enumerate(messages(recording, motion=True)):
            if now is None or item.time < now - 20 * CRAWL:  # the first message, or the recording jumps back
                now = item.time
            while now + TICK < item.time and not node.ending():
                now, wall = self._tick(now + TICK, TICK, wall)
            if item.time >= now:
                now, wall = self._tick(item.time, item.time - now, wall)
            if node.ending():
                return
            self._publish(item)
            if item.role in (JPEG, RAW):
                now = self._wait_for_answer(border.nanoseconds(item.msg.header.stamp), now)
            if index % 100 == 0:
                rospy.loginfo('%s: %.1f s', rospy.get_name(), item.time / 1e9)

    def _wait_for_answer(self, stamp: int, now: int) -> int:
        """Let ROS time crawl until the graph has answered a picture. Returns ROS time."""
        end = time.monotonic() + ANSWER_WAIT
        while not self._answers.wait(stamp) and time.monotonic() < end and not node.ending():
            now += CRAWL
            self._clock.publish(Clock(border.ros_time(now)))
        return now

    def _tick(self, now: int, step: int, wall: float) -> Tuple[int, float]:
        """Advance ROS time, not faster than wall time. Waiting for answers does not have to be caught up."""
        wall = max(wall + step / 1e9, time.monotonic() - 0.05)
        time.sleep(max(0.0, wall - time.monotonic()))
        self._clock.publish(Clock(border.ros_time(now)))
        return now, wall

    def _publish(self, item: Recorded) -> None:
        if item.role in (JPEG, RAW):
            stamp = border.nanoseconds(item.msg.header.stamp)
            if LANE_POSE not in self._recording.topics:
                pose = border.msg_from_lane_pose(LanePose(0.0, 0.0), stamp, self._messages.LanePose)
                self._publishers[LANE_POSE].publish(pose)
            self._answers.shows(stamp)
            self._publishers[item.role].publish(item.msg)
        elif item.role in self._publishers:
            try:
                self._publishers[item.role].publish(self._translated(item))
            except border.BorderError as error:
                node.dropped(item.role.replace('_', ' '), error)

    def _translated(self, item: Recorded) -> Any:
        """A message by the class that the nodes use; the recording may have another package's. Raises BorderError."""
        msg = item.msg
        if item.role == LANE_POSE and msg._type != self._messages.LanePose._type:
            stamp = border.nanoseconds(msg.header.stamp)
            return border.msg_from_lane_pose(border.lane_pose_from_msg(msg), stamp, self._messages.LanePose)
        if item.role == CAR_CMD and msg._type != self._messages.Twist2DStamped._type:
            stamp = border.nanoseconds(msg.header.stamp)
            return border.msg_from_command(border.command_from_msg(msg), stamp, self._messages.Twist2DStamped)
        return msg

    def _report(self) -> None:
        answers = self._answers
        pictures = self._recording.pictures
        skipped = pictures - len(answers.obstacles)
        summary = summarise(pictures, list(answers.obstacles.values()), answers.decisions, answers.latencies, skipped)
        rospy.loginfo('%s: the recording is over\n%s', rospy.get_name(), table(summary))
        if not self._output:
            return
        os.makedirs(self._output, exist_ok=True)
        write_json(os.path.join(self._output, 'summary.json'), summary)
        sheet = answers.sheet()
        if sheet is not None:
            write_picture(os.path.join(self._output, 'contact_sheet.png'), sheet)


def _open(settings: ReplaySettings) -> Recording:
    if bool(settings.bag) == bool(settings.images):
        raise node.NodeError('bag = %r and images = %r, expected one of them' % (settings.bag, settings.images))
    try:
        if settings.bag:
            recording = open_bag(node.path_of_user(settings.bag))
        else:
            recording = open_folder(node.path_of_user(settings.images), settings.picture_rate)
    except ToolError as error:
        raise node.NodeError(str(error)) from error
    wanted = 'compressed' if recording.picture_role == JPEG else 'raw'
    if settings.input != wanted:
        raise node.NodeError('%s has %s pictures, expected input:=%s' % (recording.path, wanted, wanted))
    return recording


def main() -> None:
    """Entry point."""
    node.run('replay_node', ReplayNode)
