"""What to do about the obstacles: drive on, pass inside the lane, slow down or stop, and why.

`decide` is the whole way from what was heard to what the controller shall do: estimate the lane, remember the
obstacles, carry both to the moment at which the wheels will obey, place them in the corridor, plan, choose.
Source: report, section "Obstacle Avoidance"; what differs from it stands in docs/avoider.md.
"""

from dataclasses import dataclass, replace
from typing import Dict, List, Optional, Sequence, Tuple

from obst_avoid.core.age import NANOSECONDS, age, fresh, why_stale, why_stopped
from obst_avoid.core.avoidance.corridor import HALF_WIDTH, TURNS, Placed, Reach, half_width, place
from obst_avoid.core.avoidance.known import Known, before_bumper, in_sight, moved, remaining, reported
from obst_avoid.core.avoidance.plan import (
    Pass,
    braking_distance,
    braking_speed,
    clearance_on_path,
    groups_of,
    passing,
    passing_beyond,
    reached,
)
from obst_avoid.core.avoidance.settings import AVOID_SINGLE, OPPOSITE, STOP_ONLY, AvoidanceSettings
from obst_avoid.core.lane_estimate import LaneEstimate, carried_pose, carried_to, followed, motion_of, pulled
from obst_avoid.core.motion import Motion
from obst_avoid.core.types import Command, Decision, LanePose, Obstacle, Stamped, State

SLACK = 0.01
"""[m] by which the corridor is wider while something is passed, or the robot stands: hysteresis in place."""
OVERLAP = 0.01
"""[m] by which something beside the robot may seem to reach into it, and is beside it nevertheless."""
MISSING = 0.3
"""[s] without a sighting of what should be seen; the detector's own memory lies before it."""
TURNING = 0.5
"""[s] for which the robot turns as it was told last."""
LINES_LOST, LINES_FORGOTTEN = 0.3, 10.0
"""[s] without a lane pose of our own, after there were some: from then on the robot may be on an intersection, and
until then, unless it stands.
"""
BEND_KNOWN, BEND_SAID = 1.0, 0.5
"""[1/m] standard deviation of the curvature from which on nobody knows how the lane goes on, and below which somebody
says how it goes on through an intersection.
"""


@dataclass(frozen=True)
class Inputs:
    """The latest of everything that a decision rests on; None: nothing came yet.

    lane_pose: of the stack's lane filter. own_lane_pose: of our detector, from the lines in the picture. commands:
    what the wheels were told, oldest first (core.motion). turn: a key of corridor.TURNS, the way that the robot will
    take at an intersection, stamped when it was heard; None: nobody says. clock_stood: [s] of wall time since ROS time
    last moved.
    """

    obstacles: Optional[Stamped[Sequence[Obstacle]]] = None
    lane_pose: Optional[Stamped[LanePose]] = None
    own_lane_pose: Optional[Stamped[LanePose]] = None
    commands: Tuple[Stamped[Command], ...] = ()
    turn: Optional[Stamped[str]] = None
    clock_stood: float = 0.0


@dataclass(frozen=True)
class Memory:
    """What outlives a decision.

    lane: the estimate. known: obstacles at known_stamp [ns], that of the last report. stopped: when a reason to stop
    was there last, and the decision. passing: [m] the offset chosen for what is being passed. passed: its numbers.
    """

    lane: Optional[LaneEstimate] = None
    known: Tuple[Known, ...] = ()
    known_stamp: Optional[int] = None
    stopped: Optional[Stamped[Decision]] = None
    passing: Optional[float] = None
    passed: Tuple[int, ...] = ()


@dataclass(frozen=True)
class Plan:
    """way: past the first obstacles, if there is one. d_ref: [m] to keep. blocking: what to stop before, nearest first.
    why: it cannot be passed. passed: the numbers of what d_ref is for.
    """

    way: Optional[Pass]
    d_ref: float
    blocking: Sequence[Placed]
    why: str
    passed: Tuple[int, ...] = ()


NOTHING_TO_PASS = Plan(None, 0.0, (), '')


@dataclass(frozen=True)
class Reaction:
    """plan: what is kept of it from now on. seen: [ns] when what decides was reported last."""

    decision: Decision
    plan: Plan
    seen: Optional[int]


def decide(inputs: Inputs, memory: Memory, now: int, settings: AvoidanceSettings) -> Tuple[Decision, Memory]:
    """Decide once. now: ROS time in ns, not earlier than the memory's stamps.

    Whatever is missing, stale or unclear ends in v_ref = 0 with the reason.
    """
    memory = _heard(inputs, memory, now, settings)
    fault = _why_blind(inputs, now, settings)
    if fault is not None or memory.lane is None or memory.known_stamp is None:
        decision = Decision(State.FAULT, 0.0, 0.0, 'stopping: %s' % fault)
        return decision, replace(memory, stopped=Stamped(now, decision))  # a detector that starts anew sees late
    then = now + round(settings.lane_estimate.command_delay * NANOSECONDS)
    lane = carried_to(memory.lane, then, inputs.commands, settings.lane_estimate)
    known = moved(memory.known, _motion(inputs, lane, memory.known_stamp, then, settings))
    last = inputs.commands[-1] if inputs.commands else None
    omega = 0.0 if last is None or age(last.stamp, now) > TURNING else last.value.omega
    slack = SLACK if memory.passing is not None or _stands(memory) else 0.0
    turn = fresh(inputs.turn, now, settings.turn_age_limit, settings.future_limit)
    bends = _bends(lane, None if turn is None else turn.value, memory, now, settings)
    placed = sorted(
        (place(item, lane, bends, omega, slack, settings) for item in known), key=lambda one: (one.begin, one.left)
    )
    reaction = _react(placed, lane, len(bends) > 1, memory, settings)
    decision, memory = _held(reaction, memory, now, settings)
    return replace(decision, numbers={**_numbers(lane, omega, settings), **decision.numbers}), memory


def restamped(memory: Memory, now: int) -> Memory:
    """The memory after the clock jumped back: what was held is held from now on. now: ROS time in ns."""
    return Memory(
        None,  # poses of a time that has not come yet would count as news for ever
        tuple(replace(item, seen=now, begun=now, placed=now, lefts=()) for item in memory.known),
        None if memory.known_stamp is None else now,
        None if memory.stopped is None else Stamped(now, memory.stopped.value),
        memory.passing,
        memory.passed,
    )


def _heard(inputs: Inputs, memory: Memory, now: int, settings: AvoidanceSettings) -> Memory:
    """The memory after what is new among the inputs."""
    limit, ahead = settings.lane_pose_age_limit, settings.future_limit
    filtered, own = (fresh(pose, now, limit, ahead) for pose in (inputs.lane_pose, inputs.own_lane_pose))
    lane = followed(memory.lane, filtered, own, inputs.commands, settings.lane_estimate)
    begun = memory.lane is not None and lane is not None and lane.begun != memory.lane.begun
    memory = replace(memory, lane=lane, known=() if begun else memory.known)  # it was lifted and set down elsewhere
    report = fresh(inputs.obstacles, now, settings.obstacles_age_limit, ahead)
    if report is None or lane is None:
        return memory
    if memory.known_stamp is not None and report.stamp <= memory.known_stamp:
        return memory
    motion, unknown_way = None, 0.0
    if memory.known_stamp is not None:
        motion = _motion(inputs, lane, memory.known_stamp, report.stamp, settings)
        seconds = age(memory.known_stamp, report.stamp)
        unknown_way = settings.lane_estimate.unknown_speed * seconds if motion is None else 0.0
    shape = _lane_ahead(inputs, lane, report.stamp, settings)
    known = reported(moved(memory.known, motion), report, shape, settings.known, unknown_way)
    known = remaining(known, report.stamp, motion is not None, settings)
    return replace(memory, known=known, known_stamp=report.stamp)


def _motion(
    inputs: Inputs, lane: LaneEstimate, since: int, until: int, settings: AvoidanceSettings
) -> Optional[Motion]:
    """How the robot moved between two times [ns]: as it was told, and with its pull; None: not known."""
    told = motion_of(inputs.commands, since, until, settings.lane_estimate)
    return None if told is None else pulled(told, lane.pull)


def _lane_ahead(inputs: Inputs, lane: LaneEstimate, stamp: int, settings: AvoidanceSettings) -> Optional[LanePose]:
    """The lane's shape before the robot at a time [ns], as our own lines have shown it; None: they have not, or were
    not believed.
    """
    own = inputs.own_lane_pose
    if own is None or own.stamp != lane.lines_stamp or abs(age(own.stamp, stamp)) > settings.obstacles_age_limit:
        return None
    return carried_pose(own, stamp, inputs.commands, settings.lane_estimate)


def _bends(
    lane: LaneEstimate, turn: Optional[str], memory: Memory, now: int, settings: AvoidanceSettings
) -> Sequence[float]:
    """[1/m] how the lane may go on. Where the lines have just ended, all ways that the robot may take count: straight
    on, since nobody knows where the intersection begins, and the turn, or every turn when nobody says which.
    """
    curvature, error = float(lane.belief.mean[2]), lane.errors[2]
    unseen = LINES_FORGOTTEN if lane.lines_stamp is None else age(lane.lines_stamp, now)
    lost = LINES_LOST < unseen < LINES_FORGOTTEN or (unseen > LINES_FORGOTTEN and _stands(memory))
    if not lost or _beyond(memory, settings) or error < BEND_SAID:
        return [curvature]
    ways = TURNS if turn is None else ('straight', turn)
    return sorted({curvature, *(TURNS[way] for way in ways)})


def _react(
    placed: Sequence[Placed], lane: LaneEstimate, forked: bool, memory: Memory, settings: AvoidanceSettings
) -> Reaction:
    """What to do now, without regard to a stop that is held."""
    counting = [item for item in placed if _counts(item, memory, settings)]
    near = [item for item in counting if item.begin < settings.look_ahead]
    inside = [item for item in near if item.reach is Reach.INSIDE]
    if inside:  # before it begins to pass them it looks whether there is room behind them
        farthest = max(item.end for item in inside) + settings.dead_end
        near = [item for item in counting if item.begin < max(farthest, settings.look_ahead)]
        inside = [item for item in near if item.reach is Reach.INSIDE]
    plan = _plan(inside, near, placed, lane, forked, memory, settings) if inside else NOTHING_TO_PASS
    doubtful = [item for item in near if _is_doubtful(item, memory, settings)]
    if doubtful:  # where there is room, it is passed as well; it never stops the robot
        both = sorted((*inside, *doubtful), key=lambda one: (one.begin, one.left))
        wider = _plan(both, near, placed, lane, forked, memory, settings)
        if wider.way is not None and not any(item in wider.blocking for item in doubtful):
            plan, inside = wider, both
    decision, item = _drive(inside, plan, settings)
    unsure = sorted(
        (item for item in near if item.reach is Reach.UNSURE and _is_seen(item, memory, settings)),
        key=lambda one: (one.away, one.left),
    )
    if decision.state is State.CLEAR and unsure and _gap(unsure[0], settings) < settings.stop_distance:
        decision, item = _slow(unsure[0], settings), unsure[0]
    if plan.blocking:
        allowed = _allowed_speed(plan.blocking[0], memory, settings)
        if allowed < decision.v_ref:
            decision, item = _brake(plan, allowed, memory.known_stamp or 0, settings), plan.blocking[0]
    hit = None if decision.v_ref == 0 else _in_the_path(placed, lane.pose, decision.d_ref, decision.v_ref, settings)
    if hit is not None:
        word = 'stopping' if hit.known.seen == memory.known_stamp else 'waiting'
        reason = '%s: 1 obstacle in the path, nearest %.2f m' % (word, _distance(hit))
        decision, item = Decision(State.STOPPED, 0.0, 0.0, reason), hit
    if item is not None:
        numbers = _numbers_of(item, decision.v_ref, plan.way, settings)
        decision = replace(decision, obstacle=item.known.obstacle, numbers=numbers)
    return Reaction(decision, plan, None if item is None else item.known.seen)


def _counts(item: Placed, memory: Memory, settings: AvoidanceSettings) -> bool:
    """Whether to do something about it. What is far has to be there for a while first: nothing is lost by waiting.

    What should be seen, and has been missing for MISSING, holds a robot that stands or passes it, but stops no other.
    """
    if _stands(memory) or item.known.number in memory.passed:
        return True
    if in_sight(item.known, settings) and age(item.known.seen, memory.known_stamp or 0) > MISSING:
        return False
    return (
        _gap(item, settings) < settings.near_distance or age(item.known.begun, item.known.seen) >= settings.confirmation
    )


def _plan(
    inside: Sequence[Placed],
    near: Sequence[Placed],
    everything: Sequence[Placed],
    lane: LaneEstimate,
    forked: bool,
    memory: Memory,
    settings: AvoidanceSettings,
) -> Plan:
    """How to pass what reaches into the corridor, as far as it can be passed. near: all that counts, inside or not.

    An obstacle that cannot be passed is one to stop before; so are those before it, where there is no room to stand
    in between. What the robot is beside already is not: it has to go on, or stand there for ever.
    """
    ahead = sorted((item for item in inside if _ahead(item, settings)), key=lambda one: (one.away, one.left))
    beside = len(ahead) < len(inside)
    held = memory.passing if beside or not _stands(memory) else None
    keeping = Plan(None, held or 0.0 if beside else 0.0, ahead, '', memory.passed)
    begun = {item.known.number for item in inside} & set(memory.passed)
    why = _why_not(inside, lane, forked, bool(begun), settings)
    if why is not None:
        return replace(keeping, why=why)
    stations = [
        item for item in near if not (item.known.in_lane is False and item.reach is Reach.OUTSIDE) and not item.speed
    ]
    groups = groups_of(stations, settings)
    while not any(item in inside for item in groups[0]):  # d = 0 passes them
        groups.pop(0)
    numbers = tuple(item.known.number for item in groups[0])
    same = held if set(numbers) & set(memory.passed) else None
    ways = [passing(groups[0], same, lane.pose, settings)]
    later = [group for group in groups[1:] if any(item in inside for item in group)]
    groups = [groups[0], *later]
    ways += [passing(group, None, LanePose(0.0, 0.0), settings) for group in later]
    why = 'no room to pass in a lane of %.2f m' % settings.lane_width
    first = next((index for index, way in enumerate(ways) if way is None), len(ways))
    if (
        first == 1 < len(groups)
        and not beside
        and groups[1][0].begin - max(item.end for item in groups[0]) < settings.dead_end
    ):
        first = 0
    unpassable = [item for group in groups[first:] for item in group]
    blocking = [item for item in ahead if item in unpassable]
    way = ways[0] if first > 0 else None
    if way is not None:
        before = [item for item in stations if item.end < groups[0][0].begin]
        if reached(before, lane.pose, way.d_ref, settings):
            return Plan(way, way.d_ref, blocking, why, numbers)
        return Plan(None, 0.0, ahead, 'another one has to be passed first')
    if settings.stage == OPPOSITE and (_beyond(memory, settings) or _stands(memory)):
        way = passing_beyond(everything, lane.pose, settings)
        if way is not None:
            return Plan(way, way.d_ref, [], '', numbers)
    return replace(keeping, blocking=blocking, why=why)


def _ahead(item: Placed, settings: AvoidanceSettings) -> bool:
    """Whether the robot is not beside it yet."""
    return item.begin >= settings.robot_ahead or before_bumper(item.known, OVERLAP, settings)


def _why_not(
    inside: Sequence[Placed], lane: LaneEstimate, forked: bool, begun: bool, settings: AvoidanceSettings
) -> Optional[str]:
    """Why nothing is passed here, whatever room there is; None: it may be. begun: the robot does so already, and a bend
    that comes into view ahead is none yet.
    """
    if settings.stage == STOP_ONLY:
        return 'stage stop_only'
    if settings.stage == AVOID_SINGLE and len(inside) > 1:
        return 'stage avoid_single'
    if any(item.speed for item in inside):
        return 'it moves'
    if forked:
        return 'on an intersection'
    lines = lane.lines_stamp is not None and age(lane.lines_stamp, lane.stamp) < LINES_FORGOTTEN
    unknown = lines and lane.errors[2] > BEND_KNOWN  # a filter without lines is taken at its word
    seen = [] if begun else [place.pose.curvature for place in lane.ahead[-1:]]
    bends = [float(lane.belief.mean[2]), *seen]  # here, and where the lines were seen last
    if unknown or max(abs(bend) for bend in bends) > settings.straight:
        return 'in a bend'
    return None


def _drive(inside: Sequence[Placed], plan: Plan, settings: AvoidanceSettings) -> Tuple[Decision, Optional[Placed]]:
    """As if there were nothing to stop before."""
    if plan.way is not None and (plan.d_ref or inside):
        reason = 'avoiding: %s in the lane at %.2f m, passing at %+.3f m with %.3f m to spare' % (
            _count(inside), _distance(inside[0]), plan.d_ref, plan.way.clearance,
        )  # fmt: skip
        return Decision(State.AVOIDING, plan.d_ref, _near_speed(inside[0], settings), reason), inside[0]
    if plan.d_ref:
        reason = "passing: keeping %+.3f m beside what stands at the robot's side" % plan.d_ref
        return Decision(State.AVOIDING, plan.d_ref, settings.avoid_speed, reason), inside[0]
    return Decision(State.CLEAR, 0.0, settings.cruise_speed, 'clear: no obstacle in the lane'), None


def _near_speed(item: Placed, settings: AvoidanceSettings) -> float:
    """[m/s] at most towards, and beside, something in the corridor."""
    return settings.avoid_speed if _gap(item, settings) < settings.near_distance else settings.cruise_speed


def _is_seen(item: Placed, memory: Memory, settings: AvoidanceSettings) -> bool:
    """Whether the last report had it, after others that did, and it is not beside the robot already."""
    lately = item.known.seen == memory.known_stamp and age(item.known.begun, item.known.seen) >= settings.confirmation
    return lately and _ahead(item, settings)


def _is_doubtful(item: Placed, memory: Memory, settings: AvoidanceSettings) -> bool:
    """Whether it may reach into the corridor, and is so near that something has to be done, or is being passed."""
    near = _gap(item, settings) < settings.near_distance and _is_seen(item, memory, settings)
    return item.reach is Reach.UNSURE and (near or item.known.number in memory.passed)


def _slow(item: Placed, settings: AvoidanceSettings) -> Decision:
    reason = 'slowing: unsure whether what stands at %.2f m is in the way, %.3f m beside the middle, error %.3f m' % (
        _distance(item), abs(item.left), item.error,
    )  # fmt: skip
    return Decision(State.SLOWING, 0.0, settings.slow_speed, reason)


def _brake(plan: Plan, allowed: float, reported: int, settings: AvoidanceSettings) -> Decision:
    """reported: [ns] stamp of the last report."""
    first = plan.blocking[0]
    stop, unseen = allowed < settings.least_speed, age(first.known.seen, reported)
    why = 'not seen for %.1f s of %.1f s' % (unseen, settings.stop_hold) if unseen > 0 else plan.why
    reason = '%s: %s in the lane, nearest %.2f m%s' % (
        'waiting' if stop and unseen > 0 else 'stopping' if stop else 'slowing', _count(plan.blocking),
        _distance(first), why and ', ' + why,
    )  # fmt: skip
    return Decision(State.STOPPED if stop else State.SLOWING, plan.d_ref, 0.0 if stop else allowed, reason)


def _beyond(memory: Memory, settings: AvoidanceSettings) -> bool:
    """Whether the robot passes over the yellow line, where nobody looks for lines."""
    return memory.passing is not None and memory.passing > settings.lane_width / 2


def _stands(memory: Memory) -> bool:
    return memory.stopped is not None and memory.stopped.value.state is State.STOPPED


def _allowed_speed(first: Placed, memory: Memory, settings: AvoidanceSettings) -> float:
    """[m/s] towards something to stop before. A robot that stands needs more room to start than to go on."""
    gap = _gap(first, settings)
    if _stands(memory) and gap < settings.start_distance:
        return 0.0
    limit = braking_speed(gap - settings.stop_distance, settings)
    if settings.time_to_collision:
        limit = min(limit, max(gap, 0.0) / settings.time_to_collision)
    return min(limit, _near_speed(first, settings))


def _in_the_path(
    placed: Sequence[Placed], pose: LanePose, d_ref: float, speed: float, settings: AvoidanceSettings
) -> Optional[Placed]:
    """The first obstacle, whatever its side of the line, that the robot would touch before it could stand."""
    farthest = braking_distance(speed, settings) + settings.margin
    for item in placed:
        least = 0.0 if item.known.in_lane is False else settings.least_margin / 2
        clearance = clearance_on_path(item, pose, d_ref, farthest, settings)
        nearer = clearance < clearance_on_path(item, pose, d_ref, 0.0, settings) - 1e-3
        if clearance < least and (nearer or before_bumper(item.known, OVERLAP, settings)):
            return item
    return None


def _held(reaction: Reaction, memory: Memory, now: int, settings: AvoidanceSettings) -> Tuple[Decision, Memory]:
    """The decision with what outlives it: a stop lasts for a while after its reason was seen last."""
    decision, stopped = reaction.decision, memory.stopped
    kept = replace(memory, passing=reaction.plan.d_ref or None, passed=reaction.plan.passed)
    if decision.state is State.STOPPED:
        since = max(reaction.seen or 0, 0 if stopped is None else stopped.stamp)
        return decision, replace(kept, stopped=Stamped(since, decision))
    if stopped is not None and age(stopped.stamp, now) <= settings.stop_hold:
        since_then = age(stopped.stamp, now)
        reason = 'waiting: no reason to stop for %.1f s of %.1f s' % (since_then, settings.stop_hold)
        waiting = replace(stopped.value, v_ref=0.0, reason=reason)
        return waiting, replace(memory, stopped=Stamped(stopped.stamp, waiting))
    return decision, replace(kept, stopped=None)


def _why_blind(inputs: Inputs, now: int, settings: AvoidanceSettings) -> Optional[str]:
    limit, ahead = settings.lane_pose_age_limit, settings.future_limit
    filtered = why_stale('lane pose', inputs.lane_pose, now, limit, ahead)
    own = why_stale('lane pose', inputs.own_lane_pose, now, limit, ahead)
    doubts: List[Optional[str]] = [
        why_stopped(inputs.clock_stood, settings.clock_age_limit),
        why_stale('obstacle list', inputs.obstacles, now, settings.obstacles_age_limit, ahead),
        filtered if own is not None else None,  # either alone is enough
    ]
    return next((reason for reason in doubts if reason is not None), None)


def _numbers_of(item: Placed, speed: float, way: Optional[Pass], settings: AvoidanceSettings) -> Dict[str, float]:
    numbers = {
        'gap [m]': _gap(item, settings), 'obstacle left of the middle [m]': item.left, 'its error [m]': item.error,
        'its speed to the left [m/s]': item.speed,
    }  # fmt: skip
    if speed > 0:
        numbers['time to collision [s]'] = max(numbers['gap [m]'], 0.0) / speed
    if way is not None:
        numbers['to spare [m]'] = way.clearance
    return numbers


def _numbers(lane: LaneEstimate, omega: float, settings: AvoidanceSettings) -> Dict[str, float]:
    d, phi, curvature, pull = lane.belief.mean.tolist()
    d_error, phi_error, bend_error = lane.errors
    return {
        'd [m]': d, 'd error [m]': d_error, 'phi [rad]': phi, 'phi error [rad]': phi_error,
        'curvature [1/m]': curvature, 'curvature error [1/m]': bend_error, 'pull [rad/m]': pull,
        HALF_WIDTH: half_width(omega, settings),
    }  # fmt: skip


def _gap(item: Placed, settings: AvoidanceSettings) -> float:
    """[m] between bumper and footprint: straight, which is never more than along the lane, whatever the lane does."""
    return (item.begin if item.begin < settings.robot_ahead else item.away) - settings.robot_ahead


def _distance(item: Placed) -> float:
    """[m] ahead of the axle."""
    return item.known.obstacle.x


def _count(items: Sequence[Placed]) -> str:
    return '1 obstacle' if len(items) == 1 else '%d obstacles' % len(items)
