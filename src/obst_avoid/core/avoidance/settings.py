"""Settings of obstacle_avoidance_node, whole."""

from dataclasses import dataclass

from obst_avoid.core.lane_estimate import LaneEstimateSettings
from obst_avoid.core.settings import choice, group, number

STOP_ONLY, AVOID_SINGLE, AVOID_ALL, OPPOSITE = 'stop_only', 'avoid_single', 'avoid_all', 'avoid_all_opposite_lane'
STAGES = (STOP_ONLY, AVOID_SINGLE, AVOID_ALL, OPPOSITE)


@dataclass(frozen=True)
class KnownSettings:
    """How obstacles are remembered."""

    gate: float = number('m', above=0)
    gate_growth: float = number('ratio', at_least=0)
    gain: float = number('ratio', above=0, at_most=1)
    near: float = number('m', at_least=0)
    view: float = number('rad', above=0)
    out_of_sight: float = number('s', at_least=0)
    out_of_sight_moving: float = number('s', at_least=0)
    position_error: float = number('m', above=0)
    position_growth: float = number('ratio', at_least=0)
    shape_error: float = number('m', above=0)
    shape_direction: float = number('rad', at_least=0)
    shape_bend: float = number('1/m', at_least=0)
    error_time: float = number('s', at_least=0)
    walking: float = number('m/sqrt(s)', at_least=0)
    watch: float = number('s', above=0)
    watch_bend: float = number('1/m', at_least=0)
    moving: float = number('m/s', above=0)
    fastest: float = number('m/s', above=0)
    moving_certainty: float = number('standard deviations', above=0)
    foresight: float = number('s', at_least=0)


@dataclass(frozen=True)
class AvoidanceSettings:
    """config/obstacle_avoidance_node.yaml and config/lane_estimate.yaml have values, units and reasons."""

    stage: str = choice(*STAGES)
    lane_width: float = number('m', above=0)
    robot_width: float = number('m', above=0)
    robot_ahead: float = number('m', above=0)
    robot_behind: float = number('m', above=0)
    look_ahead: float = number('m', above=0)
    confirmation: float = number('s', at_least=0)
    margin: float = number('m', at_least=0)
    wanted_margin: float = number('m', at_least=0)
    least_margin: float = number('m', at_least=0)
    yaw_margin: float = number('m s', at_least=0)
    straight: float = number('1/m', at_least=0)
    unsure: float = number('standard deviations', at_least=0)
    stop_distance: float = number('m', at_least=0)
    near_distance: float = number('m', at_least=0)
    start_distance: float = number('m', at_least=0)
    dead_end: float = number('m', at_least=0)
    switch_distance: float = number('m', above=0)
    convergence_length: float = number('m', above=0)
    cruise_speed: float = number('m/s', above=0)
    avoid_speed: float = number('m/s', above=0)
    slow_speed: float = number('m/s', above=0)
    least_speed: float = number('m/s', at_least=0)
    deceleration: float = number('m/s^2', above=0)
    time_to_collision: float = number('s', at_least=0)
    delay: float = number('s', at_least=0)
    stop_hold: float = number('s', at_least=0)
    known: KnownSettings = group(KnownSettings)
    obstacles_age_limit: float = number('s', above=0)
    lane_pose_age_limit: float = number('s', above=0)
    turn_age_limit: float = number('s', above=0)
    clock_age_limit: float = number('s', above=0)
    future_limit: float = number('s', at_least=0)
    lane_estimate: LaneEstimateSettings = group(LaneEstimateSettings)
