"""core.calibration on the fleet's real files, which lie beside the repository and are never copied into it."""

import json
import math
import shutil
from pathlib import Path
from typing import Any, Dict, List, Union

import numpy as np
import pytest

from obst_avoid.core.bird_view import make_bird_view
from obst_avoid.core.calibration import Calibration, CalibrationError, camera_roll, horizon_row, load_calibration
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.geometry import ground_from_pixel

Fleet = List[Dict[str, Any]]
Loaded = Dict[str, Union[Calibration, str]]


@pytest.fixture(scope='module')
def fleet(shared: Path) -> Fleet:
    """What is known about each pair of files, from measurements made without this package."""
    entries: Fleet = json.loads((shared / 'real' / 'calibrations' / 'index.json').read_text())
    assert len(entries) > 60
    return entries


@pytest.fixture(scope='module')
def loaded(shared: Path, fleet: Fleet, tmp_path_factory: pytest.TempPathFactory) -> Loaded:
    """Each pair by its folder's name: the calibration, or the sentence that refuses it."""
    folder = tmp_path_factory.mktemp('fleet')
    results: Loaded = {}
    for entry in fleet:
        name = entry['folder']
        for kind in ('camera_intrinsic', 'camera_extrinsic'):
            (folder / kind).mkdir(exist_ok=True)
            shutil.copyfile(
                str(shared / 'real' / 'calibrations' / name / (kind + '.yaml')), str(folder / kind / (name + '.yaml'))
            )
        try:
            results[name] = load_calibration(str(folder), name)
        except CalibrationError as error:
            results[name] = str(error)
    return results


def test_files_load_or_are_refused_as_the_index_says(fleet: Fleet, loaded: Loaded) -> None:
    wrong = {
        entry['folder']: (entry['why'], loaded[entry['folder']])
        for entry in fleet
        if entry['ok'] is isinstance(loaded[entry['folder']], str)
    }
    assert wrong == {}


@pytest.mark.parametrize(
    'name, reason',
    [
        ('student05', 'does not parse as YAML'),
        ('student16', 'does not parse as YAML'),
        ('harpy', 'upside down'),
        ('mickey', 'upside down'),
        ('duckduckgo', 'upside down'),
        ('cookie', 'upside down'),
        ('blackmanba', 'homography'),
        ('duckiefat', 'camera_matrix has focal lengths 11454 and 1445 px'),
    ],
)
def test_a_broken_pair_is_refused_for_its_own_fault(loaded: Loaded, name: str, reason: str) -> None:
    refusal = loaded[name]
    assert isinstance(refusal, str) and reason in refusal and name + '.yaml' in refusal


def test_horizon_and_ground_agree_with_the_index(fleet: Fleet, loaded: Loaded) -> None:
    compared = 0
    for entry in fleet:
        calibration = loaded[entry['folder']]
        if isinstance(calibration, str) or 'ground_320_470' not in entry:
            continue
        compared += 1
        name = entry['folder']
        ground = ground_from_pixel(calibration.homography, np.array([[320.0, 470.0], [320.0, 300.0]]))
        np.testing.assert_allclose(ground[0], entry['ground_320_470'], atol=1.1e-3, err_msg=name)
        np.testing.assert_allclose(ground[1], entry['ground_320_300'], atol=1.1e-3, err_msg=name)
        assert horizon_row(calibration.homography, 320) == pytest.approx(entry['horizon_v_at_320'], abs=0.06), name
    assert compared > 50


def test_roll_agrees_with_the_index(fleet: Fleet, loaded: Loaded) -> None:
    compared = 0
    for entry in fleet:
        calibration = loaded[entry['folder']]
        if isinstance(calibration, str) or entry.get('roll_deg') is None:
            continue
        compared += 1
        roll = math.degrees(camera_roll(calibration))
        assert abs(roll) == pytest.approx(abs(entry['roll_deg']), abs=1.0), entry['folder']
        if abs(entry['roll_deg']) > 0.2:
            assert roll * entry['roll_deg'] > 0, entry['folder']
    assert compared > 50


def test_every_good_pair_has_a_usable_bird_view(loaded: Loaded, detection_settings: DetectionSettings) -> None:
    scales = {}
    for name, calibration in loaded.items():
        if not isinstance(calibration, str):
            view = make_bird_view(calibration, detection_settings.bird_view)
            scales[name] = view.pixels_per_metre
    assert {name: scale for name, scale in scales.items() if not 100 < scale < 250} == {}
