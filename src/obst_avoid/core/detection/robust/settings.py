"""What can be tuned in the profile `robust`; config/obstacle_detection_node.yaml has values, units and reasons."""

from dataclasses import dataclass

from obst_avoid.core.detection.robust.tracking import TrackingSettings
from obst_avoid.core.settings import group, number


@dataclass(frozen=True)
class RobustSettings:
    """Sizes in metres are the camera's business (view.py), what a thing looks like is the trees' (trees.py)."""

    confidence: float = number('probability', above=0, below=1)
    weak_confidence: float = number('probability', above=0, below=1)
    overlap: float = number('ratio', above=0, at_most=1)
    farthest: float = number('m', above=0)
    tracking: TrackingSettings = group(TrackingSettings)
