"""What a lane filter makes of the robot's true place in its lane."""

import math
from dataclasses import dataclass, replace
from typing import Tuple

import numpy as np

from obst_avoid.core.settings import number
from obst_avoid.core.types import LanePose


@dataclass(frozen=True)
class PoseErrors:
    """config/simulation.yaml has values, units and reasons."""

    rate: float = number('1/s', above=0)
    delay: float = number('s', at_least=0)
    heading_cell: float = number('rad', at_least=0)
    heading_noise: float = number('rad', at_least=0)
    d_cell: float = number('m', at_least=0)
    d_noise: float = number('m', at_least=0)
    noise_time: float = number('s', above=0)


def measured(
    truth: LanePose, wander: float, errors: PoseErrors, random: 'np.random.RandomState'
) -> Tuple[LanePose, float]:
    """One answer of the filter, and the new state of its heading error.

    wander: that state, of unit variance, 0 to begin with; its error function makes the error evenly distributed, so
    that heading_noise is a bound. The curvature is passed on as it is, as a stack that knows its map does.
    """
    keep = math.exp(-1 / (errors.rate * errors.noise_time))
    one, other = random.standard_normal(2)
    wander = keep * wander + math.sqrt(1 - keep * keep) * one
    phi = truth.phi + errors.heading_noise * math.erf(wander / math.sqrt(2))
    d = truth.d + errors.d_noise * other
    return replace(truth, d=_in_cells(d, errors.d_cell), phi=_in_cells(phi, errors.heading_cell)), wander


def _in_cells(value: float, cell: float) -> float:
    """The middle of the cell that a value falls in."""
    return cell * round(value / cell) if cell else value
