"""Settings of obstacle_detection_node, whole."""

from dataclasses import dataclass

from obst_avoid.core.bird_view import BirdViewSettings
from obst_avoid.core.detection.paper.settings import PaperSettings
from obst_avoid.core.detection.robust.settings import RobustSettings
from obst_avoid.core.settings import choice, group, number

PROFILES = ('robust', 'paper')


@dataclass(frozen=True)
class DetectionSettings:
    """config/obstacle_detection_node.yaml and config/bird_view.yaml have values, units and reasons."""

    profile: str = choice(*PROFILES)
    picture_age_limit: float = number('s', above=0)
    bird_view: BirdViewSettings = group(BirdViewSettings)
    robust: RobustSettings = group(RobustSettings)
    paper: PaperSettings = group(PaperSettings)
