"""Where the robot is in its lane, by all who say so: the stack's lane filter, our own lines, and the wheels' commands.

An extended Kalman filter of offset, heading, curvature and of the robot's pull to one side. Each lane pose speaks of an
earlier moment; it is carried to the estimate's by the commanded motion before it counts, so what comes late or out of
order is used as it is.

The camera sees lines from some way ahead on only. What our own lane pose says of the robot itself is the seen curve
drawn on backwards, which is wrong by as much as 40 degrees where a bend begins between the robot and what is seen. So
it counts little at once, and much when the robot has come to where the lines were seen.

Across an intersection the lines belong to other roads. What the stack's filter alone makes of the robot's place is kept
beside the estimate, and what our lines say against that is not believed.

A robot may be lifted and set down elsewhere, mostly one that stands, which learns nothing new. So where the stack's
filter, or our lines where there is none, contradict all that was known for lost_time, the estimate begins anew.
"""

import math
from dataclasses import dataclass, replace
from typing import Optional, Sequence, Tuple

import numpy as np

from obst_avoid.core.age import NANOSECONDS, age
from obst_avoid.core.geometry import lane_from_robot
from obst_avoid.core.matrices import inverted, solved
from obst_avoid.core.motion import Motion, inverse, motion_between, then
from obst_avoid.core.settings import number
from obst_avoid.core.types import Array, Command, LanePose, Stamped


@dataclass(frozen=True)
class LaneEstimateSettings:
    """config/lane_estimate.yaml has values, units and reasons."""

    command_delay: float = number('s', at_least=0)
    filter_d_error: float = number('m', above=0)
    filter_phi_error: float = number('rad', above=0)
    filter_bend_error: float = number('1/m', above=0)
    filter_time: float = number('s', at_least=0)
    own_d_error: float = number('m', above=0)
    own_phi_error: float = number('rad', above=0)
    own_bend_error: float = number('1/m', above=0)
    own_length: float = number('m', above=0)
    own_claimed: float = number('ratio', at_least=0)
    own_ahead: float = number('m', at_least=0)
    own_step: float = number('m', above=0)
    arrived_d_error: float = number('m', above=0)
    arrived_phi_error: float = number('rad', above=0)
    gate: float = number('standard deviations', above=0)
    pull_spread: float = number('rad/m', above=0)
    pull_length: float = number('m', above=0)
    turn_error: float = number('rad/sqrt(m)', at_least=0)
    bend_spread: float = number('1/m', above=0)
    bend_length: float = number('m', above=0)
    unknown_speed: float = number('m/s', at_least=0)
    unknown_turn: float = number('rad/sqrt(s)', at_least=0)
    lost_time: float = number('s', above=0)


UNSAID = 100.0
"""Times what a number may be at all: the error of one that a pose does not say."""


@dataclass(frozen=True, eq=False)
class Belief:
    """mean: (4,) offset d [m], heading phi [rad], curvature of the lane [1/m], pull of the robot [rad/m]: so much it
    turns left beyond what it is told. covariance: (4, 4).
    """

    mean: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Ahead:
    """The lane as it was seen at a place ahead. place: of it, from the robot. pose: of a robot that stood there."""

    place: Motion
    pose: LanePose


@dataclass(frozen=True, eq=False)
class LaneEstimate:
    """What is known of the robot's place in its lane at one time.

    stamp: [ns] ROS time. begun: [ns] of the pose that it began with. belief: by all sources. filtered: by the stack's
    filter alone, None before its first pose. filter_stamp, own_stamp: [ns] of the latest lane pose of each source,
    None before the first. lines_stamp: of the latest one of our own that was believed. agreed_stamp: of the latest
    pose that did not contradict all that was known. ahead: the lane as it was seen at places that the robot has not
    come to, nearest first.
    """

    stamp: int
    belief: Belief
    filtered: Optional[Belief] = None
    filter_stamp: Optional[int] = None
    own_stamp: Optional[int] = None
    lines_stamp: Optional[int] = None
    agreed_stamp: Optional[int] = None
    ahead: Tuple[Ahead, ...] = ()
    begun: int = 0

    @property
    def pose(self) -> LanePose:
        """As one lane pose."""
        (dd, dp), (pd, pp) = self.belief.covariance[:2, :2].tolist()
        d, phi, curvature, _ = self.belief.mean.tolist()
        return LanePose(d, phi, curvature, (dd, dp, pd, pp))

    @property
    def errors(self) -> Tuple[float, float, float]:
        """Standard deviations of d [m], phi [rad] and curvature [1/m]."""
        dd, pp, cc, _ = np.sqrt(np.diag(self.belief.covariance)).tolist()
        return dd, pp, cc

    @property
    def pull(self) -> float:
        """[rad/m] see Belief."""
        return float(self.belief.mean[3])


def followed(
    before: Optional[LaneEstimate],
    filtered: Optional[Stamped[LanePose]],
    own: Optional[Stamped[LanePose]],
    commands: Sequence[Stamped[Command]],
    settings: LaneEstimateSettings,
) -> Optional[LaneEstimate]:
    """The estimate after the latest lane pose of the stack's filter and of our own detector; each counts once.

    commands: the robot's motion, oldest first. Returns None as long as there was no lane pose.
    """
    estimate = before
    if filtered is not None and (estimate is None or _is_new(filtered, estimate.filter_stamp)):
        estimate = _with_filter(estimate, filtered, commands, settings)
    if own is not None and (estimate is None or _is_new(own, estimate.own_stamp)):
        estimate = _with_own(estimate, own, commands, settings)
    return estimate


def carried_to(
    estimate: LaneEstimate, until: int, commands: Sequence[Stamped[Command]], settings: LaneEstimateSettings
) -> LaneEstimate:
    """The estimate at a later time, by the commanded motion. until: [ns]; one before the estimate changes nothing."""
    if until <= estimate.stamp:
        return estimate
    told, seconds = motion_of(commands, estimate.stamp, until, settings), age(estimate.stamp, until)
    filtered = None if estimate.filtered is None else _moved(estimate.filtered, told, seconds, settings)
    belief = _moved(estimate.belief, told, seconds, settings)
    moved = replace(estimate, stamp=until, belief=belief, filtered=filtered, ahead=())
    if told is None:  # nobody knows when the robot comes there
        return moved
    back = inverse(pulled(told, estimate.pull))
    ahead = [replace(item, place=then(back, item.place)) for item in estimate.ahead]
    for item in ahead:
        if item.place.x <= 0:
            moved = _arrived(moved, item, settings)
    return replace(moved, ahead=tuple(item for item in ahead if item.place.x > 0))


def believed(
    estimate: Optional[LaneEstimate], commands: Sequence[Stamped[Command]], now: int, settings: LaneEstimateSettings
) -> Optional[Stamped[LanePose]]:
    """The robot's pose when the wheels obey a command of now [ns], with the stamp of the latest pose it rests on.

    Its curvature is what the wheels have to be told to follow the lane: without the robot's own pull.
    """
    if estimate is None:
        return None
    stamp = max(stamp for stamp in (estimate.filter_stamp, estimate.own_stamp) if stamp is not None)
    obeyed = now + round(settings.command_delay * NANOSECONDS)
    pose = carried_to(estimate, obeyed, commands, settings).pose
    return Stamped(stamp, replace(pose, curvature=pose.curvature - estimate.pull))


def carried_pose(
    pose: Stamped[LanePose], until: int, commands: Sequence[Stamped[Command]], settings: LaneEstimateSettings
) -> Optional[LanePose]:
    """The same lane, seen from where the robot is at another time [ns], earlier or later; None: not known how it moved.

    Unlike the estimate's, its curvature is not forgotten: it is the lane's shape where the lines are seen.
    """
    first, last = min(pose.stamp, until), max(pose.stamp, until)
    motion = motion_of(commands, first, last, settings) if last > first else Motion()
    if motion is None:
        return None
    _, left, phi = _lane_moved(pose.value, motion if until >= pose.stamp else inverse(motion))
    return replace(pose.value, d=left, phi=phi)


def motion_of(
    commands: Sequence[Stamped[Command]], since: int, until: int, settings: LaneEstimateSettings
) -> Optional[Motion]:
    """How the robot moved between two times [ns], by commands that the wheels follow command_delay later; None:
    not known.
    """
    lag = round(settings.command_delay * NANOSECONDS)
    return motion_between(commands, since - lag, until - lag)


def pulled(motion: Motion, pull: float) -> Motion:
    """A motion as it was told, and how it became with the robot's pull [rad/m] to one side."""
    turn = pull * math.copysign(math.hypot(motion.x, motion.y), motion.x)
    return Motion(motion.x - motion.y * turn / 2, motion.y + motion.x * turn / 2, motion.turn + turn)


def _is_new(pose: Stamped[LanePose], used: Optional[int]) -> bool:
    return used is None or pose.stamp > used


def _with_filter(
    before: Optional[LaneEstimate],
    measured: Stamped[LanePose],
    commands: Sequence[Stamped[Command]],
    settings: LaneEstimateSettings,
) -> LaneEstimate:
    """The estimate after a pose of the stack's filter."""
    said = _by_filter(measured.value, settings)
    if before is None:
        said = _beginning(said, settings)
        return LaneEstimate(measured.stamp, said, said, filter_stamp=measured.stamp, begun=measured.stamp)
    estimate, said = _met(before, said, measured.stamp, commands, settings)
    agreed = _agreed_last(estimate, estimate.filtered, said, measured.stamp, settings.gate)
    if age(agreed, measured.stamp) > settings.lost_time:
        return _with_filter(None, measured, commands, settings)
    if before.filter_stamp is not None:
        said = _counted(said, 2 * settings.filter_time / max(age(before.filter_stamp, measured.stamp), 1e-3))
    filtered = (
        _beginning(said, settings) if estimate.filtered is None else _weighed(estimate.filtered, said, settings.gate)
    )
    belief = _weighed(estimate.belief, said, settings.gate)
    return replace(estimate, belief=belief, filtered=filtered, filter_stamp=measured.stamp, agreed_stamp=agreed)


def _with_own(
    before: Optional[LaneEstimate],
    measured: Stamped[LanePose],
    commands: Sequence[Stamped[Command]],
    settings: LaneEstimateSettings,
) -> LaneEstimate:
    """The estimate after a pose of our own."""
    if before is None:
        belief = _beginning(_by_lines(measured.value, 0.0, settings), settings)
        estimate = LaneEstimate(measured.stamp, belief, begun=measured.stamp)
    else:
        bend = float((before.filtered or before.belief).mean[2])
        said = _by_lines(measured.value, bend, settings)
        estimate, said = _met(before, said, measured.stamp, commands, settings)
        if estimate.filter_stamp is None or age(estimate.filter_stamp, measured.stamp) > settings.lost_time:
            estimate = replace(estimate, filtered=None)  # silent: nothing speaks against our lines
        if estimate.filtered is None:
            agreed = _agreed_last(estimate, estimate.belief, said, measured.stamp, settings.gate)
            if age(agreed, measured.stamp) > settings.lost_time:
                return _with_own(None, measured, commands, settings)
            estimate = replace(estimate, agreed_stamp=agreed)
        elif _disagreement(estimate.filtered, said) > settings.gate:
            return replace(estimate, own_stamp=measured.stamp, ahead=())
        said = _counted(said, _worth(before, measured.stamp, commands, settings))
        estimate = replace(estimate, belief=_weighed(estimate.belief, said, settings.gate))
    estimate = replace(estimate, own_stamp=measured.stamp, lines_stamp=measured.stamp)
    return _looking_ahead(estimate, measured, commands, settings)


def _agreed_last(estimate: LaneEstimate, known: Optional[Belief], said: Belief, stamp: int, gate: float) -> int:
    """When [ns] poses last agreed with what is known; the time of this one if it does, or if there was none before."""
    if known is None or _disagreement(known, said) <= gate:
        return stamp
    return stamp if estimate.agreed_stamp is None else estimate.agreed_stamp


def _met(
    estimate: LaneEstimate,
    said: Belief,
    stamp: int,
    commands: Sequence[Stamped[Command]],
    settings: LaneEstimateSettings,
) -> Tuple[LaneEstimate, Belief]:
    """The estimate and what is said of a time [ns], both at the later time of the two."""
    if stamp > estimate.stamp:
        return carried_to(estimate, stamp, commands, settings), said
    motion = motion_of(commands, stamp, estimate.stamp, settings)
    return estimate, _moved(said, motion, age(stamp, estimate.stamp), settings)


def _looking_ahead(
    estimate: LaneEstimate,
    own: Stamped[LanePose],
    commands: Sequence[Stamped[Command]],
    settings: LaneEstimateSettings,
) -> LaneEstimate:
    """The estimate with one more place ahead where the lane was seen."""
    told = motion_of(commands, own.stamp, estimate.stamp, settings)
    if told is None:
        return estimate
    _, left, phi = _lane_moved(own.value, Motion(settings.own_ahead))
    place = then(inverse(pulled(told, estimate.pull)), Motion(settings.own_ahead))
    last = estimate.ahead[-1].place.x if estimate.ahead else 0.0
    if place.x <= last + settings.own_step:
        return estimate
    return replace(estimate, ahead=(*estimate.ahead, Ahead(place, LanePose(left, phi, own.value.curvature))))


def _arrived(estimate: LaneEstimate, item: Ahead, settings: LaneEstimateSettings) -> LaneEstimate:
    """The robot has come to where the lane was seen; its own motion since then is all that may be wrong."""
    _, left, heading = _lane_moved(item.pose, inverse(item.place))
    errors = settings.arrived_d_error, settings.arrived_phi_error, settings.own_bend_error
    said = _said(LanePose(left, heading, item.pose.curvature), errors, settings)
    if estimate.filtered is not None and _disagreement(estimate.filtered, said) > settings.gate:
        return estimate
    said = _counted(said, 2 * settings.own_length / settings.own_step)
    return replace(estimate, belief=_weighed(estimate.belief, said, settings.gate))


def _worth(
    before: LaneEstimate, stamp: int, commands: Sequence[Stamped[Command]], settings: LaneEstimateSettings
) -> float:
    """Factor of the variance of our own pose: its errors last until the robot has come own_length farther. One that
    stands sees the same picture again and again, and learns nothing.
    """
    if before.lines_stamp is None or before.lines_stamp >= stamp:
        return 1.0
    motion = motion_of(commands, before.lines_stamp, stamp, settings)
    unknown = settings.unknown_speed * age(before.lines_stamp, stamp)
    way = unknown if motion is None else math.hypot(motion.x, motion.y)
    return 2 * settings.own_length / max(way, 1e-9)


def _beginning(said: Belief, settings: LaneEstimateSettings) -> Belief:
    """The first belief: what is said, and that lanes are straight and robots do not pull, as far as that goes."""
    known = np.diag([0.0, 0.0, settings.bend_spread**-2, settings.pull_spread**-2])
    covariance = inverted(inverted(said.covariance) + known)
    return Belief(covariance @ solved(said.covariance, said.mean), (covariance + covariance.T) / 2)


def _counted(said: Belief, factor: float) -> Belief:
    """What is said, with a greater variance: measurements whose errors are alike are worth no more than one."""
    return Belief(said.mean, said.covariance * max(1.0, factor))


def _disagreement(one: Belief, other: Belief) -> float:
    """Standard deviations between two beliefs, of offset and heading."""
    miss = (other.mean - one.mean)[:2]
    return math.sqrt(float(miss @ solved((one.covariance + other.covariance)[:2, :2], miss)))


def _weighed(before: Belief, said: Belief, gate: float) -> Belief:
    """A Kalman update. What is farther off than the gate counts the less, but not nothing for ever."""
    said = _counted(said, (_disagreement(before, said) / gate) ** 2)
    gain = solved(before.covariance + said.covariance, before.covariance).T
    keep = np.eye(4) - gain
    covariance = keep @ before.covariance @ keep.T + gain @ said.covariance @ gain.T
    return Belief(before.mean + gain @ (said.mean - before.mean), covariance)


def _said(pose: LanePose, errors: Tuple[float, float, float], settings: LaneEstimateSettings) -> Belief:
    """A pose with independent errors of its d, phi and curvature; it says nothing of the pull."""
    noise = np.diag(np.square([*errors, UNSAID * settings.pull_spread]))
    return Belief(np.array([pose.d, pose.phi, pose.curvature, 0.0]), noise)


def _by_filter(pose: LanePose, settings: LaneEstimateSettings) -> Belief:
    """What the stack's filter says. A curvature of 0 may mean that it does not know."""
    bend_error = settings.filter_bend_error if pose.curvature else UNSAID * settings.bend_spread
    return _claiming(_said(pose, (settings.filter_d_error, settings.filter_phi_error, bend_error), settings), pose, 1.0)


def _by_lines(pose: LanePose, bend: float, settings: LaneEstimateSettings) -> Belief:
    """What our own lines say of the robot, by drawing the curve that is seen on backwards.

    bend: [1/m] of the lane beside the robot, as far as it is known, 0 before that. Where the curve ahead is another
    one, the lane changes somewhere in between, and drawing on is wrong by up to that much.
    """
    between = abs(pose.curvature - bend)
    turned, aside = between * settings.own_ahead, between * settings.own_ahead**2 / 2
    said = _said(pose, (settings.own_d_error, settings.own_phi_error, settings.own_bend_error), settings)
    said.covariance[:3, :3] += np.diag([aside**2, turned**2, between**2])
    said.covariance[0, 1] = said.covariance[1, 0] = -aside * turned
    return _claiming(said, pose, settings.own_claimed)


def _claiming(said: Belief, pose: LanePose, share: float) -> Belief:
    """What is said, with so great a share of the errors that the pose itself claims."""
    if pose.covariance is None:
        return said
    claimed = np.zeros((4, 4))
    claimed[:2, :2] = np.reshape(pose.covariance, (2, 2))
    return Belief(said.mean, said.covariance + share**2 * (claimed + claimed.T) / 2)


def _moved(belief: Belief, told: Optional[Motion], seconds: float, settings: LaneEstimateSettings) -> Belief:
    """The belief after a motion. The lane's curvature is forgotten along the way: bends begin and end."""
    d, phi, curvature, pull = belief.mean.tolist()
    if told is None:
        turn, aside = settings.unknown_turn * math.sqrt(seconds), settings.unknown_speed * math.sqrt(seconds)
        keep = math.exp(-settings.unknown_speed * seconds / settings.bend_length)
        spread = settings.bend_spread**2 * (1 - keep**2)
        grown = belief.covariance * np.outer([1, 1, keep, 1], [1, 1, keep, 1])
        sideways = aside * (abs(math.sin(phi)) + turn / 2)
        return Belief(np.array([d, phi, curvature * keep, pull]), grown + np.diag([sideways**2, turn**2, spread, 0.0]))
    along, left, heading = _lane_moved(LanePose(d, phi, curvature), pulled(told, pull))
    keep, hold = math.exp(-abs(along) / settings.bend_length), math.exp(-abs(along) / settings.pull_length)
    half = along**2 / 2
    step = np.array([[1, along, -half, half], [0, 1, -along, along], [0, 0, keep, 0], [0, 0, 0, hold]])
    turn = settings.turn_error**2 * abs(along)
    drift = np.zeros((4, 4))
    drift[:2, :2] = [[turn * along**2 / 3, turn * along / 2], [turn * along / 2, turn]]
    drift[2, 2] = settings.bend_spread**2 * (1 - keep**2)
    drift[3, 3] = settings.pull_spread**2 * (1 - hold**2)
    return Belief(np.array([left, heading, curvature * keep, pull * hold]), step @ belief.covariance @ step.T + drift)


def _lane_moved(pose: LanePose, motion: Motion) -> Tuple[float, float, float]:
    """Where a robot is in the lane after a motion: along it [m], left of it [m], heading [rad]."""
    along, left = lane_from_robot(motion.x, motion.y, pose)
    return along, left, pose.phi + motion.turn - pose.curvature * along
