"""One drive in lockstep: simulation, detector, avoider and controller take turns through the nodes' own functions."""

import functools
from dataclasses import dataclass, replace
from typing import Callable, List, Optional, Sequence, Tuple

from obst_avoid.core import detection
from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.detection.robust.view import in_view
from obst_avoid.core.lane_control import LaneControlSettings, Reference, control, learning, reference_from_decision
from obst_avoid.core.lane_estimate import LaneEstimate, believed, followed
from obst_avoid.core.motion import remembered
from obst_avoid.core.picture import decode_jpeg
from obst_avoid.core.types import Command, Decision, LanePose, Obstacle, Scene, Stamped, State
from obst_avoid.sim import world as worlds
from obst_avoid.sim.perceived import perceive
from obst_avoid.sim.renderer import Renderer
from obst_avoid.sim.scenario import Scenario
from obst_avoid.sim.settings import SimulationSettings
from obst_avoid.sim.sightings import Sightings, looked
from obst_avoid.sim.world import Contact, Place, World

DECISION_PERIOD, COMMAND_PERIOD = 0.1, 0.05
"""[s] after which avoider and controller speak again when nothing new came, as their nodes do."""
RELEVANT = 1.0
"""[m] ahead of the axle: a stop without an obstacle in the lane nearer than this is a false one."""


@dataclass(frozen=True)
class Robot:
    """The programs on the robot, as they are set."""

    detector: detection.Detector
    avoidance: AvoidanceSettings
    lane_control: LaneControlSettings


@dataclass(frozen=True)
class Frame:
    """What was the case when a picture was answered. jpeg: the picture. gap: [m] to the nearest obstacle, or inf."""

    time: float
    jpeg: bytes
    obstacles: Tuple[Obstacle, ...]
    decision: Decision
    command: Command
    world: World
    gap: float


@dataclass(frozen=True)
class Outcome:
    """How an episode went.

    why: it is a success or not, for a person. stops: times the robot's avoider went to STOPPED. false_stops: of these,
    without an obstacle in the lane within RELEVANT. activations: times it became active. smallest_gap: [m] between
    body and obstacles when pictures were answered, 0 after a contact, inf without obstacles. stop_gap: [m] after the
    last stop. restart: [s] from when an obstacle went away until the robot, which stood, drove on, or the episode
    ended. off_lane: [s] with the axle's middle beyond a line. in_the_way: an obstacle stood in the lane ahead at some
    time. driven: [m].
    sightings: how well the detector kept track.
    """

    scenario: str
    seed: int
    success: bool
    why: str
    contact: Optional[Contact]
    stops: int
    false_stops: int
    activations: int
    smallest_gap: float
    stop_gap: Optional[float]
    restart: Optional[float]
    off_lane: float
    in_the_way: bool
    seconds: float
    driven: float
    sightings: Sightings


def run(
    scenario: Scenario,
    robot: Robot,
    settings: SimulationSettings,
    renderer: Optional[Renderer],
    watch: Callable[[Frame], None] = lambda frame: None,
) -> Outcome:
    """Run one episode to its end. watch: is called with each answered picture.

    renderer: None for a drive without pictures, ten times as fast: the detector is left out, and what it would see is
    made up of the truth (perceived.py).
    """
    place, world = worlds.begin(scenario, settings)
    graph = _Graph(robot, place)
    tally, sightings = _Tally(), Sightings({})
    visible = functools.partial(in_view, robot.detector.view.calibration)
    period, pose_period = 1 / settings.picture_rate, 1 / place.pose_errors.rate
    next_picture = next_pose = 0.0
    waiting: List[Tuple[float, bytes, Scene, int]] = []
    while True:
        now = world.time + 1e-9
        if now >= next_pose:
            next_pose += pose_period
            pose, world = worlds.lane_pose(world, place)
            graph.poses.append((world.time + place.pose_errors.delay, Stamped(worlds.stamp(world.time), pose)))
        if now >= next_picture:
            next_picture += period
            stamp = worlds.stamp(world.time)
            if renderer is None:
                data, found = b'', perceive(world, place, visible)
            else:
                shown, world = worlds.picture(world, place, renderer)
                data = worlds.jpeg(shown, place)
                found = graph.detect(data, stamp)
            sightings = looked(sightings, world.time, worlds.everything(world, place), found.obstacles, visible)
            waiting.append((world.time + settings.picture_delay, data, found, stamp))
        graph.hear_turn(worlds.turn(world, place), now)
        graph.hear_poses(now)
        while waiting and waiting[0][0] <= now:
            _, data, found, stamp = waiting.pop(0)
            graph.hear_scene(found, stamp, now)
            gap = worlds.gap(world, place)
            tally.look(graph.decision, worlds.truth(world, place), gap, world)
            watch(Frame(world.time, data, tuple(found.obstacles), graph.decision, graph.command, world, gap))
        graph.look(now)
        if graph.spoke:
            world = worlds.command(world, place, graph.command)
            graph.spoke = False
        world = worlds.step(world, place)
        tally.wait(world)
        tally.off_lane += worlds.STEP * (abs(world.lane_pose.d) > scenario.route.lane_width / 2)
        verdict = _verdict(world, place, tally, graph.decision)
        if verdict is not None:
            return Outcome(
                scenario.name, scenario.seed, verdict[0], verdict[1], world.contact, tally.stops, tally.false_stops,
                tally.activations, 0.0 if world.contact else tally.smallest_gap, tally.stop_gap, tally.waited(world),
                round(tally.off_lane, 3), tally.in_the_way, round(world.time, 3), world.along - scenario.start,
                sightings,
            )  # fmt: skip


class _Graph:
    """The nodes' part: what each has heard last, and when it speaks."""

    def __init__(self, robot: Robot, place: Place) -> None:
        self._robot, self._detector = robot, robot.detector
        self._inputs, self._memory = Inputs(), Memory()
        self._lane: Optional[LaneEstimate] = None
        self._reference: Optional[Stamped[Reference]] = None
        self._commands: Tuple[Stamped[Command], ...] = ()
        self._decided = self._commanded = self._learned = 0.0
        self.poses: List[Tuple[float, Stamped[LanePose]]] = []
        self.decision = Decision(State.FAULT, 0.0, 0.0, 'stopping: no obstacle list yet')
        self.command = Command(0.0, 0.0)
        self.spoke = False

    def detect(self, jpeg: bytes, stamp: int) -> Scene:
        scene, self._detector = detection.detect(self._detector, decode_jpeg(jpeg), stamp, self._commands)
        return scene

    def hear_poses(self, now: float) -> None:
        while self.poses and self.poses[0][0] <= now:
            pose = self.poses.pop(0)[1]
            self._inputs = replace(self._inputs, lane_pose=pose)
            self._lane = followed(self._lane, pose, None, self._commands, self._robot.lane_control.lane_estimate)
            self._control(now)

    def hear_turn(self, turn: Optional[str], now: float) -> None:
        heard = None if turn is None else Stamped(worlds.stamp(now), turn)
        self._inputs = replace(self._inputs, turn=heard)

    def hear_scene(self, scene: Scene, stamp: int, now: float) -> None:
        if scene.lane_pose is not None:
            own = Stamped(stamp, scene.lane_pose)
            self._inputs = replace(self._inputs, own_lane_pose=own)
            self._lane = followed(self._lane, None, own, self._commands, self._robot.lane_control.lane_estimate)
        self._inputs = replace(self._inputs, obstacles=Stamped(stamp, scene.obstacles))
        self._decide(now)

    def look(self, now: float) -> None:
        if now - self._decided >= DECISION_PERIOD:
            self._decide(now)
        if now - self._commanded >= COMMAND_PERIOD:
            self._control(now)

    def _decide(self, now: float) -> None:
        inputs = replace(self._inputs, commands=self._commands)
        self.decision, self._memory = decide(inputs, self._memory, worlds.stamp(now), self._robot.avoidance)
        self._decided = now
        self._reference = Stamped(worlds.stamp(now), reference_from_decision(self.decision))
        self._control(now)

    def _control(self, now: float) -> None:
        settings = self._robot.lane_control
        pose = believed(self._lane, self._commands, worlds.stamp(now), settings.lane_estimate)
        metres = self.command.v * (now - self._commanded)
        self._learned = learning(self._learned, pose, self._reference, metres, settings)
        self.command, _ = control(pose, self._reference, 0.0, worlds.stamp(now), settings, self._learned)
        self._commands = remembered(self._commands, Stamped(worlds.stamp(now), self.command))
        self._commanded, self.spoke = now, True


class _Tally:
    """Counts while an episode runs."""

    def __init__(self) -> None:
        self.stops = self.false_stops = self.activations = 0
        self.smallest_gap = float('inf')
        self.stop_gap: Optional[float] = None
        self.restart: Optional[float] = None
        self._gone, self._left = 0, 0.0
        self.off_lane = 0.0
        self.in_the_way = False
        self._before = Decision(State.FAULT, 0.0, 0.0, '')

    def look(self, decision: Decision, truth: Sequence[Obstacle], gap: float, world: World) -> None:
        relevant = any(item.in_lane is not False and -0.1 < item.x < RELEVANT for item in truth)
        self.in_the_way = self.in_the_way or relevant
        self.smallest_gap = min(self.smallest_gap, gap)
        if decision.state is State.STOPPED:
            if self._before.state is not State.STOPPED:
                self.stops += 1
                self.false_stops += not relevant
            self.stop_gap = gap
        self.activations += decision.active and not self._before.active and decision.state is not State.FAULT
        self._before = decision

    def wait(self, world: World) -> None:
        """Measure how long a robot that stands takes to drive on when an obstacle has gone."""
        gone = sum(actor.gone for actor in world.actors)
        if gone > self._gone and world.stood > 0:
            self._left = world.time
        if self._left and world.stood == 0:
            self.restart, self._left = round(world.time - self._left, 3), 0.0
        self._gone = gone

    def waited(self, world: World) -> Optional[float]:
        """[s] the same, or so far; None: no obstacle went away before a robot that stood."""
        return round(world.time - self._left, 3) if self._left else self.restart


def _verdict(world: World, place: Place, tally: _Tally, decision: Decision) -> Optional[Tuple[bool, str]]:
    """(success, why) when the episode is over, else None."""
    scenario, settings = place.scenario, place.settings
    success = scenario.settings.success
    driven = world.along - scenario.start
    if world.contact is not None:
        contact = world.contact
        return False, 'touched a %s at %.2f s, x %.2f m, y %.2f m' % (
            contact.thing.sort, contact.time, contact.x, contact.y,
        )  # fmt: skip
    if abs(world.lane_pose.d) > 0.6:
        return False, 'lost the road'
    if driven >= success.goal:
        if success.must == 'stop':
            return False, 'drove past the obstacle'
        if success.must == 'drive' and tally.stops:
            return False, 'stopped %d times for nothing' % tally.stops
        if success.must in ('drive', 'pass') and tally.off_lane > 0:
            return False, 'left the lane for %.1f s' % tally.off_lane
        return True, 'arrived'
    if success.must == 'stop' and world.stood >= settings.calm and decision.state is State.STOPPED:
        gap = worlds.gap(world, place)
        ahead = any(item.in_lane is not False and 0 < item.x < RELEVANT for item in worlds.truth(world, place))
        if ahead:
            good = success.smallest_gap <= gap <= success.largest_gap
            return good, 'stands %.2f m before the obstacle' % gap
    if world.stood >= settings.patience:
        why = 'stands for %.0f s: %s' % (settings.patience, decision.reason)
        return success.must == 'touch_nothing', why
    if world.time >= scenario.settings.duration:
        return success.must == 'touch_nothing', 'ran out of time after %.2f m: %s' % (driven, decision.reason)
    return None
