"""simulator_node: the simulated town in the ROS graph, on simulated time: what a robot would publish, and the truth.

Simulated time passes at the set rate, but never runs far ahead of the graph's answers: a slow machine makes it slower,
not blind.
"""

import json
import math
import os
import threading
import time
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Tuple

import rospkg
import rospy
from geometry_msgs.msg import Point, Pose, PoseArray, PoseStamped, Quaternion
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Float32, Header, String

from obst_avoid.core.age import NANOSECONDS
from obst_avoid.core.settings import choice, flag, integer, number, text
from obst_avoid.core.types import Array, Command, LanePose
from obst_avoid.msg import LaneControl
from obst_avoid.ros import border, node
from obst_avoid.ros.messages import find_messages
from obst_avoid.sim import world as worlds
from obst_avoid.sim.renderer import Renderer, RenderError
from obst_avoid.sim.scenario import ROAD_END, load_scenario
from obst_avoid.sim.settings import SimulationSettings

TRUTH_STEPS = 20
"""Steps of the world between two messages of the truth."""
AHEAD = 0.06
"""[s] of simulated time that may pass at full speed before a picture is answered; then it crawls, for a clock that
stands still stops the robot."""
LOOK, ANSWER_WAIT, START_WAIT = 0.1, 2.0, 40.0
"""[s] of wall time between two steps while time crawls, to wait for an answer at most, and for somebody who listens."""
LARGEST_LAG = 0.1
"""[s] of wall time that is caught up after a slow step; more is let go."""
TURN_PERIOD = 1.0
"""[s] of simulated time between two messages of the turn while there is one; the avoider forgets."""
REPORT = 5.0
"""[s] of simulated time between two lines on the terminal."""


@dataclass(frozen=True)
class SimulatorNodeSettings(SimulationSettings):
    """The simulation's settings and those of its node, which launch files set.

    scenario: a YAML file. real_time_factor: simulated seconds a second, 0 as fast as the graph answers. ends: when the
    scenario's goal is reached or its time is over; else it drives on to the end of the road.
    """

    veh: str = text()
    scenario: str = text()
    seed: int = integer(at_least=0)
    calibration_dir: str = text()
    allow_default_calibration: bool = flag()
    msgs_package: str = text()
    input: str = choice('compressed', 'raw')
    real_time_factor: float = number('ratio', at_least=0)
    ends: bool = flag()


class Answers:
    """What the graph has said: the newest command, and which pictures have been answered. Filled by callbacks."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._shown: Dict[int, float] = {}
        self._command: Optional[Command] = None
        self.answered = 0
        self._latencies: List[float] = []

    def shows(self, stamp: int) -> None:
        """A picture is about to be published."""
        with self._changed:
            self._shown[stamp] = time.monotonic()

    def on_command(self, msg: Any) -> None:
        """From the lane controller."""
        try:
            command = border.command_from_msg(msg)
        except border.BorderError as error:
            node.dropped('car command', error)
            return
        with self._changed:
            self._command = command

    def on_lane_control(self, msg: LaneControl) -> None:
        """From the avoider: it carries the stamp of the picture that it answers."""
        stamp = border.nanoseconds(msg.header.stamp)
        with self._changed:
            if stamp in self._shown:
                self._latencies.append(time.monotonic() - self._shown[stamp])
            self._shown = {shown: begun for shown, begun in self._shown.items() if shown > stamp}
            self.answered = max(self.answered, stamp)
            self._changed.notify_all()

    def take_command(self) -> Optional[Command]:
        """The newest command that was not taken yet."""
        with self._changed:
            command, self._command = self._command, None
            return command

    def take_latencies(self) -> List[float]:
        """[s] of wall time from each picture to its decision, those that were not taken yet."""
        with self._changed:
            latencies, self._latencies = self._latencies, []
            return latencies

    def wait_for(self, stamp: int) -> bool:
        """Wait a moment until a picture, or a later one, is answered. False: it is not yet."""
        with self._changed:
            return self._changed.wait_for(lambda: self.answered >= stamp, LOOK)


class SimulatorNode:
    """Steps the world in one thread; everything else only listens."""

    def __init__(self) -> None:
        settings = node.private_settings(SimulatorNodeSettings)
        self._settings = settings
        messages = find_messages(settings.msgs_package)
        self._lane_pose_class = messages.LanePose
        self._flag_class = messages.BoolStamped
        calibration = node.calibration_of(settings.veh, settings.calibration_dir, settings.allow_default_calibration)
        towns = os.path.join(rospkg.RosPack().get_path('obst_avoid'), 'config/towns')
        scenario = load_scenario(node.path_of_user(settings.scenario), settings.seed, towns)
        self._place, self._world = worlds.begin(scenario, settings)
        self._calibration = calibration
        self._answers = Answers()
        self._next_picture = self._next_pose = 0.0
        self._late_poses: List[Tuple[float, int, LanePose]] = []
        self._unanswered: List[int] = []
        self._waited = 0.0
        self._clock = rospy.Publisher('/clock', Clock, queue_size=10)
        compressed = settings.input == 'compressed'
        self._image = rospy.Publisher(
            '~image/compressed' if compressed else '~image', CompressedImage if compressed else Image, queue_size=4
        )
        self._camera_info = rospy.Publisher('~camera_info', CameraInfo, queue_size=4)
        self._lane_pose = rospy.Publisher('~lane_pose', messages.LanePose, queue_size=4)
        self._truth = {
            'pose': rospy.Publisher('~truth/pose', PoseStamped, queue_size=4),
            'lane_pose': rospy.Publisher('~truth/lane_pose', messages.LanePose, queue_size=4),
            'obstacles': rospy.Publisher('~truth/obstacles', PoseArray, queue_size=4),
            'gap': rospy.Publisher('~truth/gap', Float32, queue_size=4),
            'contact': rospy.Publisher('~truth/contact', messages.BoolStamped, queue_size=4),
        }
        self._turn: Optional[str] = None
        self._next_turn = 0.0
        self._pictures, self._told, self._last_latency = node.Rate(), (time.monotonic(), 0.0), 0.0
        self._turn_publisher = rospy.Publisher('~turn', String, queue_size=1, latch=True)
        self._latency = rospy.Publisher('~latency', Float32, queue_size=4)
        self._scenario = rospy.Publisher('~scenario', String, queue_size=1, latch=True)
        path = os.path.abspath(node.path_of_user(settings.scenario))
        self._scenario.publish(String(json.dumps({'file': path, 'seed': settings.seed})))
        self._health = node.Health(settings.veh, self._diagnose)
        rospy.Subscriber('~car_cmd', messages.Twist2DStamped, self._answers.on_command, queue_size=1)
        rospy.Subscriber('~lane_control', LaneControl, self._answers.on_lane_control, queue_size=10)
        node.once(self._run)

    def _run(self) -> None:
        try:
            renderer = Renderer(self._calibration)  # in this thread: an OpenGL context belongs to one
        except RenderError as error:
            raise node.NodeError(str(error)) from error
        self._wait_for_subscribers()
        rospy.loginfo('%s: %s', rospy.get_name(), self._place.scenario.settings.about)
        try:
            self._drive(renderer)
        finally:
            renderer.close()

    def _wait_for_subscribers(self) -> None:
        end = time.monotonic() + START_WAIT
        while not (self._image.get_num_connections() and self._lane_pose.get_num_connections()):
            self._clock.publish(Clock(border.ros_time(worlds.stamp(0.0))))
            if time.monotonic() > end:
                rospy.logwarn('%s: nobody listens to the camera after %.0f s', rospy.get_name(), START_WAIT)
                break
            if node.ending():
                return
            time.sleep(0.05)
        time.sleep(1.0)  # for the subscriptions in the other direction

    def _drive(self, renderer: Renderer) -> None:
        factor, steps, wall = self._settings.real_time_factor, 0, time.monotonic()
        while not node.ending():
            self._clock.publish(Clock(border.ros_time(worlds.stamp(self._world.time))))
            world = self._sense(self._world, renderer)
            if steps % TRUTH_STEPS == 0:
                self._publish_truth(world)
            command = self._answers.take_command()
            if command is not None:
                world = worlds.command(world, self._place, command)
            before, self._world = world, worlds.step(world, self._place)
            steps += 1
            self._tell(before, self._world)
            self._wait_for_answer()
            if factor:
                wall = max(wall + worlds.STEP / factor, time.monotonic() - LARGEST_LAG)
                time.sleep(max(0.0, wall - time.monotonic()))
            why = self._why_over()
            if why:
                self._publish_truth(self._world)
                rospy.loginfo('%s: the drive is over: %s', rospy.get_name(), why)
                return

    def _sense(self, world: worlds.World, renderer: Renderer) -> worlds.World:
        """Publish the lane pose and the picture that are due."""
        place, now = self._place, world.time + 1e-9
        turn = worlds.turn(world, place)
        if turn != self._turn or (turn is not None and world.time >= self._next_turn):
            self._turn, self._next_turn = turn, world.time + TURN_PERIOD
            self._turn_publisher.publish(String(turn or ''))
        if now >= self._next_pose:
            self._next_pose += 1 / place.pose_errors.rate
            pose, world = worlds.lane_pose(world, place)
            self._late_poses.append((world.time + place.pose_errors.delay, worlds.stamp(world.time), pose))
        while self._late_poses and self._late_poses[0][0] <= now:
            _, stamp, pose = self._late_poses.pop(0)
            self._lane_pose.publish(border.msg_from_lane_pose(pose, stamp, self._lane_pose_class))
        if now >= self._next_picture:
            self._next_picture += 1 / self._settings.picture_rate
            shown, world = worlds.picture(world, place, renderer)
            self._publish_picture(shown, worlds.stamp(world.time))
            self._unanswered.append(worlds.stamp(world.time))
        return world

    def _tell(self, before: worlds.World, world: worlds.World) -> None:
        """Say what a person in front of the terminal wants to know."""
        if world.contact is not None and before.contact is None:
            contact = world.contact
            self._publish_truth(world)
            words = '%s: touched a %s at %.2f s, x %.2f m, y %.2f m'
            rospy.logerr(words, rospy.get_name(), contact.thing.sort, contact.time, contact.x, contact.y)
        if int(world.time / REPORT) > int(before.time / REPORT):
            driven = world.along - self._place.scenario.start
            rospy.loginfo('%s: %.0f s, %.1f m driven', rospy.get_name(), world.time, driven)

    def _wait_for_answer(self) -> None:
        """Let the graph keep up: time crawls while a picture older than AHEAD is not answered.

        When none is answered for ANSWER_WAIT, somebody is gone, and time goes on without: that is what shall be seen.
        """
        while self._unanswered and self._unanswered[0] <= self._answers.answered:
            self._unanswered.pop(0)
            self._waited = 0.0
        overdue = self._unanswered and self._unanswered[0] + AHEAD * NANOSECONDS <= worlds.stamp(self._world.time)
        if not overdue:
            return
        if self._waited < ANSWER_WAIT:
            begin = time.monotonic()
            if not self._answers.wait_for(self._unanswered[0]):
                self._waited += time.monotonic() - begin
        else:
            stamp = self._unanswered.pop(0) / NANOSECONDS
            rospy.logwarn_throttle(
                5.0, '%s: no answer to the picture of %.3f s, driving on without' % (rospy.get_name(), stamp)
            )

    def _why_over(self) -> str:
        world, scenario = self._world, self._place.scenario
        if world.along > scenario.route.length - ROAD_END:
            return 'the road ends'
        if self._settings.ends and world.along - scenario.start >= scenario.settings.success.goal:
            return 'the goal is reached'
        if self._settings.ends and world.time >= scenario.settings.duration:
            return 'its time of %.0f s is up' % scenario.settings.duration
        return ''

    def _publish_picture(self, shown: Array, stamp: int) -> None:
        frame = border.camera_frame(self._settings.veh)
        self._camera_info.publish(border.camera_info_from_calibration(self._calibration, stamp, frame))
        self._answers.shows(stamp)
        self._pictures.tick()
        if self._settings.input == 'compressed':
            msg = border.compressed_image_from_jpeg(worlds.jpeg(shown, self._place), stamp, frame)
        else:
            msg = border.image_from_picture(shown, stamp, frame)
        self._image.publish(msg)

    def _publish_truth(self, world: worlds.World) -> None:
        stamp = worlds.stamp(world.time)
        place, pose = self._place, world.vehicle.pose
        header = Header(stamp=border.ros_time(stamp), frame_id='world')
        half = pose.heading / 2
        turn = Quaternion(0.0, 0.0, math.sin(half), math.cos(half))
        self._truth['pose'].publish(PoseStamped(header, Pose(Point(pose.x, pose.y, 0.0), turn)))
        self._truth['lane_pose'].publish(border.msg_from_lane_pose(world.lane_pose, stamp, self._lane_pose_class))
        frame = border.footprint_frame(self._settings.veh)
        seen = worlds.truth(world, place)
        self._truth['obstacles'].publish(border.pose_array_from_obstacles(seen, stamp, frame))
        self._truth['gap'].publish(Float32(worlds.gap(world, place)))
        self._truth['contact'].publish(
            self._flag_class(header=Header(stamp=border.ros_time(stamp)), data=world.contact is not None)
        )
        for latency in self._answers.take_latencies():
            self._last_latency = latency
            self._latency.publish(Float32(latency))

    def _diagnose(self, status: Any) -> None:
        wall, world = time.monotonic(), self._world
        (told_wall, told), self._told = self._told, (wall, world.time)
        factor, rate = (world.time - told) / max(wall - told_wall, 1e-3), self._pictures.read()
        driven = node.figure(world.along - self._place.scenario.start, '%.2f')
        numbers = driven, world.time, factor, rate
        words = 'drove %s m in %.1f s, at %.2f of real time, %.1f pictures/s' % numbers
        if world.contact is not None:
            status.summary(node.ERROR, 'touched a %s; %s' % (world.contact.thing.sort, words))
        else:
            status.summary(node.OK if factor else node.WARN, words if world.time else 'waiting for the other nodes')
        status.add('pictures [1/s]', '%.1f' % rate)
        status.add('simulated seconds a second', '%.2f' % factor)
        status.add('last answer took [ms]', '%.1f' % (1e3 * self._last_latency))
        status.add('simulated time [s]', '%.2f' % world.time)
        status.add('driven [m]', driven)
        status.add('scenario', self._settings.scenario)
        status.add('seed', self._settings.seed)
        status.add('calibration', self._calibration.source)


def main() -> None:
    """Entry point."""
    node.run('simulator_node', SimulatorNode)
