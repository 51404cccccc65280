"""Fixtures of all tests: where things lie, the shipped settings and the shipped calibration. Nothing here needs ROS."""

from pathlib import Path

import pytest
from unit import shipped

from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.bird_view import BirdView, make_bird_view
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.lane_control import LaneControlSettings


@pytest.fixture(scope='session')
def repository() -> Path:
    """The root of the package."""
    return shipped.REPOSITORY


@pytest.fixture(scope='session')
def shared() -> Path:
    """The folder of real calibrations and pictures beside the repository; it has no licence and is never inside."""
    folder = shipped.REPOSITORY.parent / 'shared'
    if not folder.is_dir():
        pytest.skip('%s is absent: real calibrations are not part of the repository' % folder)
    return folder


@pytest.fixture(scope='session')
def detection_settings() -> DetectionSettings:
    """As shipped."""
    return shipped.detection_settings()


@pytest.fixture(scope='session')
def avoidance_settings() -> AvoidanceSettings:
    """As shipped."""
    return shipped.avoidance_settings()


@pytest.fixture(scope='session')
def lane_control_settings() -> LaneControlSettings:
    """As shipped."""
    return shipped.lane_control_settings()


@pytest.fixture(scope='session')
def calibration() -> Calibration:
    """The package's default camera, 640x480."""
    return shipped.default_calibration()


@pytest.fixture(scope='session')
def view(calibration: Calibration, detection_settings: DetectionSettings) -> BirdView:
    """The bird view of the default camera."""
    return make_bird_view(calibration, detection_settings.bird_view)
