"""Settings of obstacle_avoidance_node, whole."""

from dataclasses import dataclass

from obst_avoid.core.settings import choice, number

STAGES = ('stop_only', 'avoid_single')


@dataclass(frozen=True)
class AvoidanceSettings:
    """config/obstacle_avoidance_node.yaml has values, units and reasons."""

    stage: str = choice(*STAGES)
    box_length: float = number('m', above=0)
    box_width: float = number('m', above=0)
    lane_width: float = number('m', above=0)
    robot_width: float = number('m', above=0)
    margin: float = number('m', at_least=0)
    cruise_speed: float = number('m/s', above=0)
    avoid_speed: float = number('m/s', above=0)
    stop_hold: float = number('s', at_least=0)
    avoid_hold: float = number('s', at_least=0)
    same_obstacle: float = number('m', above=0)
    obstacles_age_limit: float = number('s', above=0)
    lane_pose_age_limit: float = number('s', above=0)
    clock_age_limit: float = number('s', above=0)
    future_limit: float = number('s', at_least=0)
