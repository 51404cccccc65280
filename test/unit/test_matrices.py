"""core.matrices, and that a robot's programs leave its other cores alone."""

import os
import threading
import time
from typing import Any, Callable

import numpy as np
import pytest

from obst_avoid.core import detection
from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.detection.robust import native
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.lane_control import LaneControlSettings, control
from obst_avoid.core.lane_estimate import believed, followed
from obst_avoid.core.matrices import inverted, solved
from obst_avoid.core.types import Array, Command, Kind, LanePose, Obstacle, Stamped
from unit.drawn import RobotPose, Scene, Thing, draw

START = 1_700_000_000_000_000_000
STEP = 33_333_333
"""[ns] from picture to picture."""
TIMES = 40
LIMIT = 0.05
"""Cores. A thread that spins has more, even beside eight others on one core."""
LIMITED = {'OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'} & set(os.environ)


def positive(size: int, seed: int) -> Array:
    random = np.random.default_rng(seed).normal(size=(size, size))
    return random @ random.T + 0.1 * np.eye(size)


@pytest.mark.parametrize('size', [1, 2, 3, 4, 8])
def test_as_numpy_says(size: int) -> None:
    for seed in range(20):
        matrix, right = positive(size, seed), np.random.default_rng(seed).normal(size=(size, 3))
        assert inverted(matrix) == pytest.approx(np.linalg.inv(matrix), rel=1e-9, abs=1e-9)
        assert solved(matrix, right) == pytest.approx(np.linalg.solve(matrix, right), rel=1e-9, abs=1e-9)
        assert solved(matrix, right[:, 0]) == pytest.approx(np.linalg.solve(matrix, right[:, 0]), rel=1e-9, abs=1e-9)
        assert solved(matrix, right[:, 0]).shape == (size,)


@pytest.mark.parametrize('scale', [1e-110, 1e-16, 1e110])
def test_of_any_scale(scale: float) -> None:
    for size in (2, 3, 4):
        assert inverted(scale * np.eye(size)) == pytest.approx(np.eye(size) / scale, rel=1e-9)
        assert solved(scale * np.eye(size), np.ones(size)) == pytest.approx(np.ones(size) / scale, rel=1e-9)


def test_of_what_nobody_knows() -> None:
    unknown = np.diag([1e20, 1e20, 1.0, 1e-6])
    assert inverted(unknown) == pytest.approx(np.diag([1e-20, 1e-20, 1.0, 1e6]), rel=1e-9, abs=0)
    assert solved(unknown, np.ones(4)) == pytest.approx(np.array([1e-20, 1e-20, 1.0, 1e6]), rel=1e-9, abs=0)


@pytest.mark.parametrize('size', [2, 3, 4])
def test_what_has_no_inverse_is_named(size: int) -> None:
    flat = np.ones((size, size))
    with pytest.raises(np.linalg.LinAlgError, match='Singular'):
        inverted(flat)
    with pytest.raises(np.linalg.LinAlgError, match='Singular'):
        solved(flat, np.ones(size))


def elsewhere(work: Callable[[int], Any]) -> float:
    """How much other threads than this one work, in cores, while this one works now and then."""
    if LIMITED:
        pytest.skip('%s is set: no other thread could work' % ', '.join(sorted(LIMITED)))
    work(0)
    time.sleep(0.2)
    whole, mine, began = time.process_time(), time.thread_time(), time.monotonic()
    for index in range(1, TIMES):
        work(index)
        time.sleep(0.01)
    mine, whole = time.thread_time() - mine, time.process_time() - whole
    return (whole - mine) / (time.monotonic() - began)


def test_other_threads_would_be_noticed() -> None:
    ends = threading.Event()

    def spins() -> None:
        while not ends.is_set():
            pass

    thread = threading.Thread(target=spins)
    thread.start()
    try:
        assert elsewhere(lambda _: None) > LIMIT
    finally:
        ends.set()
        thread.join()


def test_the_lane_controller_keeps_one_core_busy(
    avoidance_settings: AvoidanceSettings, lane_control_settings: LaneControlSettings
) -> None:
    rules, lane, commands = avoidance_settings.lane_estimate, None, ()

    def work(index: int) -> None:
        nonlocal lane, commands
        now = START + index * STEP
        pose = Stamped(now, LanePose(0.01, 0.02, 0.0, (1e-4, 0.0, 0.0, 1e-3)))
        commands = (*commands, Stamped(now, Command(0.2, 0.1)))
        lane = followed(lane, pose, pose, commands, rules)
        control(believed(lane, commands, now, rules), None, 0.0, now, lane_control_settings)

    assert elsewhere(work) < LIMIT


def test_the_avoider_keeps_one_core_busy(avoidance_settings: AvoidanceSettings) -> None:
    memory = Memory()

    def work(index: int) -> None:
        nonlocal memory
        now = START + index * STEP
        pose = Stamped(now, LanePose(0.01, 0.02, 0.0, (1e-4, 0.0, 0.0, 1e-3)))
        seen = Stamped(now, (Obstacle(Kind.DUCKIE, 0.8 - 0.005 * index, 0.0, 0.03, True, 0.99),))
        _, memory = decide(Inputs(seen, pose, pose), memory, now, avoidance_settings)

    assert elsewhere(work) < LIMIT


@pytest.mark.skipif(native.LIBRARY is None, reason='not compiled: numpy and OpenCV do it, with threads')
def test_the_detector_keeps_one_core_busy(calibration: Calibration, detection_settings: DetectionSettings) -> None:
    assert detection_settings.profile == 'robust'
    detector = detection.start(calibration, detection_settings)
    picture = draw(Scene((Thing(Kind.DUCKIE, 0.5, 0.0),)), calibration, RobotPose())

    def work(index: int) -> None:
        nonlocal detector
        _, detector = detection.detect(detector, picture, START + index * STEP)

    assert elsewhere(work) < LIMIT
