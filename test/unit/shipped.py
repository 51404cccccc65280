"""What the package ships: settings and the default calibration, read as the programs read them."""

from pathlib import Path
from typing import Any, Dict, Tuple, Type

from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.calibration import Calibration, load_calibration
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.lane_control import LaneControlSettings
from obst_avoid.core.settings import load, read_yaml

REPOSITORY = Path(__file__).resolve().parents[2]
CONFIG = REPOSITORY / 'config'


def mappings() -> Dict[str, Tuple[Type[Any], Dict[str, Any]]]:
    """Every node's settings class and the mapping that its YAML files make together."""
    detection = dict(read_yaml(str(CONFIG / 'obstacle_detection_node.yaml')))
    detection.update(read_yaml(str(CONFIG / 'bird_view.yaml')))
    lane = read_yaml(str(CONFIG / 'lane_estimate.yaml'))
    return {
        'detection': (DetectionSettings, detection),
        'avoidance': (AvoidanceSettings, {**read_yaml(str(CONFIG / 'obstacle_avoidance_node.yaml')), **lane}),
        'lane_control': (LaneControlSettings, {**read_yaml(str(CONFIG / 'lane_controller_node.yaml')), **lane}),
    }


def detection_settings() -> DetectionSettings:
    """Of obstacle_detection_node."""
    settings, mapping = mappings()['detection']
    loaded: DetectionSettings = load(settings, mapping, 'detection')
    return loaded


def avoidance_settings() -> AvoidanceSettings:
    """Of obstacle_avoidance_node."""
    settings, mapping = mappings()['avoidance']
    loaded: AvoidanceSettings = load(settings, mapping, 'avoidance')
    return loaded


def lane_control_settings() -> LaneControlSettings:
    """Of lane_controller_node."""
    settings, mapping = mappings()['lane_control']
    loaded: LaneControlSettings = load(settings, mapping, 'lane_control')
    return loaded


def default_calibration() -> Calibration:
    """The made-up camera of the simulation, 640x480."""
    return load_calibration(str(CONFIG / 'calibrations'), 'default')
