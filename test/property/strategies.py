"""What the properties are asked for: cameras, points, obstacles, poses."""

from typing import Any

from hypothesis import strategies as st
from unit.cameras import Camera

from obst_avoid.core.types import LanePose, Obstacle


def numbers(low: float, high: float) -> Any:
    """Finite numbers of a range, both ends included."""
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


cameras = st.builds(
    Camera,
    focal=numbers(330, 450),
    projection=st.tuples(numbers(210, 400), numbers(220, 400)),
    ahead=numbers(-0.02, 0.1),
    left=numbers(-0.03, 0.03),
    height=numbers(0.06, 0.16),
    pitch=numbers(8, 35),
    roll=numbers(-5.5, 5.5),
    yaw=numbers(-10, 10),
    twist=numbers(-2, 2),
)
"""Cameras that a Duckiebot may have."""

obstacles = st.builds(
    Obstacle,
    kind=st.none(),
    x=numbers(-0.1, 0.8),
    y=numbers(-0.3, 0.3),
    radius=numbers(0.001, 0.12),
    in_lane=st.sampled_from([True, False, None]),
)
obstacle_lists = st.lists(obstacles, max_size=3)
lane_poses = st.builds(LanePose, d=numbers(-0.12, 0.12), phi=numbers(-0.8, 0.8), curvature=numbers(-3, 3))
