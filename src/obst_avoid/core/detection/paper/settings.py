"""What can be tuned in the profile `paper`; config/obstacle_detection_node.yaml has values, units and reasons."""

from dataclasses import dataclass
from typing import Tuple

from obst_avoid.core.settings import choice, group, integer, integers, number


@dataclass(frozen=True)
class ColorRange:
    """Limits for cv2.inRange, both included: hue 0 to 179, saturation and value 0 to 255."""

    low: Tuple[int, int, int] = integers(3, 0, 255)
    high: Tuple[int, int, int] = integers(3, 0, 255)


@dataclass(frozen=True)
class PaperSettings:
    """Pixels are those of a bird view with reference_scale; other views are compared after scaling."""

    color_correction: str = choice('none', 'once', 'per_picture')
    largest_gain: float = number('ratio', at_least=1)
    yellow: ColorRange = group(ColorRange)
    orange: ColorRange = group(ColorRange)
    white: ColorRange = group(ColorRange)
    reference_scale: float = number('px/m', above=0)
    smallest_area: float = number('px^2', above=0)
    duckie_eigenvalue: float = number('px^2', above=0)
    cone_ratio: float = number('ratio', above=1)
    sure_eigenvalue: float = number('px^2', above=0)
    sure_frames: int = integer(1)
    unsure_frames: int = integer(1)
    size_change: float = number('ratio', above=0)
    same_place: float = number('px', above=0)
    moved_up: float = number('px', at_least=0)
    longest_gap: float = number('s', above=0)
    white_samples: float = number('px', at_least=0)
