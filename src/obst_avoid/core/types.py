"""The values that travel from stage to stage. SI units; frames as docs/architecture.md names them."""

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Callable, Generic, Mapping, Optional, Sequence, Tuple, TypeVar

import numpy as np

if TYPE_CHECKING:  # numpy.typing is younger than the robot's numpy 1.17
    from numpy.typing import NDArray

    Array = NDArray[Any]
else:
    Array = np.ndarray

T = TypeVar('T')

Trace = Callable[[str, Any], None]
"""Called by the detector after each stage with the stage's name and its result."""


def no_trace(stage: str, result: Any) -> None:
    """Watch nothing."""


class Kind(enum.Enum):
    """What stands on the road."""

    DUCKIE = 'duckie'
    CONE = 'cone'


@dataclass(frozen=True)
class Box:
    """Axis-aligned box in pixels, half-open: left <= u < right, top <= v < bottom."""

    left: float
    top: float
    right: float
    bottom: float


@dataclass(frozen=True)
class Obstacle:
    """Something that stands on the road at one instant.

    kind: None where nobody said, as in a PoseArray.
    x, y: [m] the point of its footprint nearest the robot, robot frame.
    radius: [m] > 0, half its width across the line of sight.
    in_lane: False when the whole footprint lies beyond a line that bounds our lane; None: not known.
    confidence: 0 to 1, for ranking only.
    bird_box: in pixels of the report's bird view. image_box: in pixels of the camera picture as it came.
    to_left, to_right: [m] from its footprint's edge to the inner edge of our lane's left and right line, positive
    inside; None: not known.
    """

    kind: Optional[Kind]
    x: float
    y: float
    radius: float
    in_lane: Optional[bool]
    confidence: float = 1.0
    bird_box: Optional[Box] = None
    image_box: Optional[Box] = None
    to_left: Optional[float] = None
    to_right: Optional[float] = None


@dataclass(frozen=True)
class LanePose:
    """Where the robot is in its lane.

    d: [m] left of the lane's centre. phi: [rad] turned left of the lane's direction.
    curvature: [1/m] positive when the lane bends left; 0 may mean unknown.
    covariance: of d and phi, row by row: m^2, m rad, m rad, rad^2; None: not known.
    """

    d: float
    phi: float
    curvature: float = 0.0
    covariance: Optional[Tuple[float, float, float, float]] = None


@dataclass(frozen=True)
class Scene:
    """What one picture shows. lane_pose: None where the picture does not tell."""

    obstacles: Sequence[Obstacle]
    lane_pose: Optional[LanePose] = None


class State(enum.Enum):
    """What the avoider is doing; the values equal the constants of LaneControl.msg."""

    CLEAR = 0
    SLOWING = 1
    AVOIDING = 2
    STOPPED = 3
    FAULT = 4


@dataclass(frozen=True)
class Decision:
    """What the lane controller shall do, and why.

    d_ref: [m] desired offset from the lane's centre, left positive. v_ref: [m/s] >= 0; 0 in STOPPED and FAULT.
    reason: one clause for a person. obstacle: the one that decided, if one did. numbers: what it rests on, by name.
    """

    state: State
    d_ref: float
    v_ref: float
    reason: str
    obstacle: Optional[Obstacle] = None
    numbers: Mapping[str, float] = field(default_factory=dict)

    @property
    def active(self) -> bool:
        """False exactly when the controller shall follow the lane as if we were not there."""
        return self.state is not State.CLEAR


def in_words(state: State, reason: str) -> str:
    """A decision in one line for a person; a reason that begins with the state's own word does not say it twice."""
    word, colon, rest = reason.partition(': ')
    return '%s: %s' % (state.name, rest if colon and word.upper() == state.name else reason)


@dataclass(frozen=True)
class Command:
    """What the wheels shall do. v: [m/s] forward. omega: [rad/s] turning left."""

    v: float
    omega: float


@dataclass(frozen=True)
class Stamped(Generic[T]):
    """A value and the time it speaks of. stamp: ROS time in ns."""

    stamp: int
    value: T
