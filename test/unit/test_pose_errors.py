"""sim.pose_errors: the lane filter is as wrong as the settings say, and for as long."""

import math
from dataclasses import replace
from typing import Any, List, Tuple

import numpy as np
import pytest

from obst_avoid.core.types import LanePose
from obst_avoid.sim.pose_errors import PoseErrors, measured
from unit.drives import simulation

COUNT = 20_000


def answers(errors: PoseErrors, seed: int = 1) -> Tuple[Any, Any, List[float]]:
    """(COUNT, 2) true d and phi, which go through all cells, what the filter says, and its inner state."""
    random, place = np.random.RandomState(seed), np.random.RandomState(seed + 1)
    truths, found, states, wander = [], [], [], 0.0
    for d, phi in place.uniform((-0.1, -0.5), (0.1, 0.5), (COUNT, 2)):
        pose, wander = measured(LanePose(d, phi, 1.5), wander, errors, random)
        truths.append((d, phi))
        found.append((pose.d, pose.phi))
        states.append(wander)
    return np.array(truths), np.array(found), states


@pytest.fixture(scope='module')
def real() -> Any:
    """Answers with the errors `real`."""
    return answers(simulation().pose_errors['real'])


def test_clean_answers_are_true() -> None:
    truths, found, _ = answers(simulation().pose_errors['clean'])
    np.testing.assert_array_equal(found, truths)


def test_the_heading_is_wrong_by_up_to_10_degrees(real: Any) -> None:
    error = np.degrees(np.abs(real[1] - real[0])[:, 1])
    assert error.max() <= 10.0
    assert error.max() > 8.0
    assert 3.0 < math.sqrt((error**2).mean()) < 7.0


def test_the_error_is_evenly_distributed() -> None:
    errors = replace(simulation().pose_errors['real'], heading_cell=0.0, heading_noise=0.1, noise_time=1e-3)
    truths, found, _ = answers(errors)
    parts, _ = np.histogram((found - truths)[:, 1], bins=10, range=(-0.1, 0.1))
    assert parts.sum() == COUNT
    assert parts / COUNT == pytest.approx(0.1, abs=0.012)


def test_an_error_lasts(real: Any) -> None:
    # 10 answers a second, 0.3 s
    wander = np.array(real[2])
    assert (wander.mean(), wander.std()) == pytest.approx((0, 1), abs=0.06)
    assert np.corrcoef(wander[:-1], wander[1:])[0, 1] == pytest.approx(math.exp(-1 / 3), abs=0.02)
    assert np.corrcoef(wander[:-3], wander[3:])[0, 1] == pytest.approx(math.exp(-1), abs=0.03)
    error = (real[1] - real[0])[:, 1]
    assert np.corrcoef(error[:-1], error[1:])[0, 1] > 0.5


def test_d_is_noisy_and_in_cells(real: Any) -> None:
    error = (real[1] - real[0])[:, 0]
    assert error.std() == pytest.approx(math.sqrt(0.015**2 + 0.02**2 / 12), rel=0.03)
    assert error.mean() == pytest.approx(0, abs=0.001)
    assert abs(np.corrcoef(error[:-1], error[1:])[0, 1]) < 0.03, 'each answer has its own'


def test_answers_lie_on_the_grid(real: Any) -> None:
    cells = real[1] / (0.02, 0.1)
    np.testing.assert_allclose(cells, np.rint(cells), atol=1e-9)
    assert len(np.unique(np.rint(cells[:, 0]))) >= 9 and len(np.unique(np.rint(cells[:, 1]))) >= 9


@pytest.mark.parametrize('name', ['clean', 'real'])
def test_the_curvature_is_passed_on(name: str) -> None:
    pose, _ = measured(LanePose(0.01, 0.2, -2.4), 0.0, simulation().pose_errors[name], np.random.RandomState(1))
    assert pose.curvature == -2.4


def test_the_same_chance_gives_the_same_answers() -> None:
    errors = simulation().pose_errors['real']
    poses = [measured(LanePose(0.0, 0.0), 0.5, errors, np.random.RandomState(seed)) for seed in (3, 3, 4)]
    assert poses[0] == poses[1] and poses[0] != poses[2]
