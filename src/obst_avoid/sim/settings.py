"""Settings of the simulation, whole."""

from dataclasses import dataclass
from typing import Any, Dict

from obst_avoid.core.settings import SettingsError, checked, group, integer, load, number
from obst_avoid.sim.pose_errors import PoseErrors
from obst_avoid.sim.sensor import SensorSettings
from obst_avoid.sim.vehicle import VehicleSettings


@dataclass(frozen=True)
class SimulationSettings:
    """config/simulation.yaml has values, units and reasons."""

    picture_rate: float = number('1/s', above=0, at_most=200)
    picture_delay: float = number('s', at_least=0)
    jpeg_quality: int = integer(at_least=1)
    calm: float = number('s', above=0)
    patience: float = number('s', above=0)
    sensor: SensorSettings = group(SensorSettings)
    vehicle: VehicleSettings = group(VehicleSettings)
    pose_errors: Dict[str, PoseErrors] = checked(lambda value, where: _pose_errors(value, where))


def _pose_errors(value: Any, where: str) -> Dict[str, PoseErrors]:
    if not isinstance(value, dict) or not value:
        raise SettingsError('%s = %r, expected a mapping of names to errors' % (where, value))
    return {str(name): load(PoseErrors, errors, '%s/%s' % (where, name)) for name, errors in value.items()}
