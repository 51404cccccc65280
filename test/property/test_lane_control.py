"""core.lane_control: mirrored, limited, and still when in doubt."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obst_avoid.core.lane_control import LaneControlSettings, Reference, control
from obst_avoid.core.types import Command, LanePose, Stamped
from property.strategies import lane_poses, numbers

NOW = 1_700_000_000_000_000_000
references = st.builds(Reference, active=st.booleans(), d_ref=numbers(-0.1, 0.1), v_ref=numbers(0.0, 1.0))


def fresh(pose: LanePose, reference: Reference, settings: LaneControlSettings) -> Command:
    """The command for inputs of this very moment."""
    return control(Stamped(NOW, pose), Stamped(NOW, reference), 0.0, NOW, settings)[0]


@given(pose=lane_poses, reference=references)
def test_every_command_is_within_its_limits(
    lane_control_settings: LaneControlSettings, pose: LanePose, reference: Reference
) -> None:
    answer = fresh(pose, reference, lane_control_settings)
    assert math.isfinite(answer.v) and abs(answer.omega) <= lane_control_settings.largest_omega
    wanted = reference.v_ref if reference.active else lane_control_settings.cruise_speed
    assert answer.v == min(wanted, lane_control_settings.largest_speed)
    assert answer.v > 0 or answer.omega == 0, 'a robot that stands does not turn'


@given(pose=lane_poses, reference=references)
def test_a_mirrored_robot_turns_the_other_way(
    lane_control_settings: LaneControlSettings, pose: LanePose, reference: Reference
) -> None:
    here = fresh(pose, reference, lane_control_settings)
    mirrored = LanePose(-pose.d, -pose.phi, -pose.curvature)
    there = fresh(mirrored, Reference(reference.active, -reference.d_ref, reference.v_ref), lane_control_settings)
    assert (there.v, there.omega) == pytest.approx((here.v, -here.omega), abs=1e-12)


@given(pose=lane_poses, reference=references, shift=numbers(-0.05, 0.05))
def test_only_the_distance_to_the_wanted_offset_counts(
    lane_control_settings: LaneControlSettings, pose: LanePose, reference: Reference, shift: float
) -> None:
    active = Reference(True, reference.d_ref, reference.v_ref)
    here = fresh(pose, active, lane_control_settings)
    moved = LanePose(pose.d + shift, pose.phi, pose.curvature)
    there = fresh(moved, Reference(True, active.d_ref + shift, active.v_ref), lane_control_settings)
    assert there.omega == pytest.approx(here.omega, abs=1e-9)


@given(
    pose=lane_poses,
    reference=references,
    pose_age=numbers(-1.0, 1.0),
    reference_age=numbers(-1.0, 1.0),
    stood=numbers(0, 2),
)
def test_doubt_stops(
    lane_control_settings: LaneControlSettings,
    pose: LanePose,
    reference: Reference,
    pose_age: float,
    reference_age: float,
    stood: float,
) -> None:
    rules = lane_control_settings
    ns = [round(seconds * 1e9) for seconds in (pose_age, reference_age)]
    answer, why = control(Stamped(NOW - ns[0], pose), Stamped(NOW - ns[1], reference), stood, NOW, rules)
    doubtful = (
        not -rules.future_limit <= ns[0] / 1e9 <= rules.lane_pose_age_limit
        or not -rules.future_limit <= ns[1] / 1e9 <= rules.reference_age_limit
        or stood > rules.clock_age_limit
    )
    assert answer.v == 0 or not doubtful
    assert why.startswith('stopping: ') is (answer == Command(0.0, 0.0))
