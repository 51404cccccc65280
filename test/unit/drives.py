"""What tests of simulated drives share: the shipped settings, a robot without errors, small scenario files."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Dict, Optional

from obst_avoid.core.settings import load, read_yaml
from obst_avoid.sim.scenario import Scenario, load_scenario
from obst_avoid.sim.settings import SimulationSettings
from obst_avoid.sim.vehicle import VehicleSettings
from unit.shipped import CONFIG

TOWNS = str(CONFIG / 'towns')
LIGHT = {'color': 'white', 'strength': 1.0, 'lamps': 1, 'glare': 0.0, 'unevenness': 0.0, 'headlight': 0.0}
START = {'column': 0, 'row': 0, 'heading': 'east', 'along': 0.3, 'd': 0.0, 'phi': 0.0}
LANE = 0.17
"""[m] north of the world's origin to the middle of the lane of straight.yaml, on the way east."""


def simulation() -> SimulationSettings:
    """As shipped."""
    settings: SimulationSettings = load(SimulationSettings, read_yaml(str(CONFIG / 'simulation.yaml')), 'simulation')
    return settings


def exact(**changes: Any) -> VehicleSettings:
    """The shipped robot without trim and noise, with some of its settings changed."""
    return replace(simulation().vehicle, **{'trim': 0.0, 'speed_noise': 0.0, 'turn_noise': 0.0, **changes})


def quiet(**changes: Any) -> SimulationSettings:
    """The shipped simulation with that robot."""
    return replace(simulation(), vehicle=exact(), **changes)


def mapping(*obstacles: Dict[str, Any], success: Optional[Dict[str, Any]] = None, **changes: Any) -> Dict[str, Any]:
    """The content of a scenario file: a straight road with obstacles, nothing random."""
    return {
        'about': 'a test',
        'seed': 1,
        'map': 'straight',
        'start': START,
        'turns': [],
        'obstacles': list(obstacles),
        'clutter': 0,
        'light': LIGHT,
        'pose_errors': 'clean',
        'turn_said': True,
        'duration': 20.0,
        'success': {'must': 'stop', 'goal': 2.5, 'smallest_gap': 0.05, 'largest_gap': 0.45, **(success or {})},
        **changes,
    }


def thing(along: float, left: float = 0.0, sort: str = 'cone', height: float = 0.08, **more: Any) -> Dict[str, Any]:
    """An obstacle; the default is a cone with a base of 60 mm by 60 mm."""
    return {'sort': sort, 'height': height, 'along': along, 'left': left, **more}


def scenario_of(folder: Path, content: Any, seed: int = 1, instead: Optional[Dict[str, Any]] = None) -> Scenario:
    """Write a scenario file and load it by the code under test."""
    path = folder / 'test.yaml'
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding='utf-8')
    return load_scenario(str(path), seed, TOWNS, instead)
