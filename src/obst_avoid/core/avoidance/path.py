"""The way that the lane controller will take to a new offset."""

import math
from typing import Tuple

import numpy as np

from obst_avoid.core.types import Array, LanePose


def path(alongs: Array, pose: LanePose, d_ref: float, length: float) -> Tuple[Array, Array]:
    """(N,) offsets from the lane's centre [m] and (N,) slopes on the way to d_ref, so many m along the lane.

    A critically damped approach over `length` [m], as lane_control drives it whatever the speed; other controllers
    differ, which is what margins are for.
    """
    miss, slope = pose.d - d_ref, math.tan(max(-1.2, min(1.2, pose.phi)))
    fades = np.exp(-alongs / length)
    rest = miss + (miss / length + slope) * alongs
    return d_ref + rest * fades, ((miss / length + slope) - rest / length) * fades
