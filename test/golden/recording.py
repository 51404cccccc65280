"""The drawn recording and how it runs through detector and avoider; shared by the test and by refresh.py."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Dict, List, Tuple

from unit import shipped
from unit.drawn import RobotPose, Scene, draw
from unit.scenes import cone, duckie

from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.detection import detect, start
from obst_avoid.core.types import Decision, Obstacle, Stamped

PATH = Path(__file__).with_name('drawn_approach.json')
START = 1_000_000_000_000
STEP = 250_000_000
"""[ns] between pictures."""

ROADSIDE = (cone(0.95, -0.3), duckie(1.15, 0.5, 0.04))
"""A cone beyond the right line and a duckie beyond the left one."""
PASSABLE, BLOCKING = duckie(0.75, 0.075, 0.04), cone(1.25, 0.0)
"""A duckie at the centre line, which can be passed, and a cone in the middle of the lane."""
FREED = ROADSIDE + (PASSABLE,)

FRAMES: List[Tuple[Tuple[Any, ...], RobotPose]] = [
    (FREED + (BLOCKING,), RobotPose(0.00, 0.010, 0.02)),
    (FREED + (BLOCKING,), RobotPose(0.10, 0.012, 0.00)),
    (FREED + (BLOCKING,), RobotPose(0.20, 0.012, -0.02)),
    (FREED + (BLOCKING,), RobotPose(0.30, 0.008, -0.05)),
    (FREED + (BLOCKING,), RobotPose(0.40, -0.002, -0.06)),
    (FREED + (BLOCKING,), RobotPose(0.50, -0.010, -0.04)),
    (FREED + (BLOCKING,), RobotPose(0.60, -0.015, -0.02)),
    (FREED + (BLOCKING,), RobotPose(0.70, -0.018, 0.00)),
    (FREED + (BLOCKING,), RobotPose(0.80, -0.018, 0.00)),
    (FREED + (BLOCKING,), RobotPose(0.85, -0.018, 0.00)),
    (FREED, RobotPose(0.85, -0.018, 0.00)),
    (FREED, RobotPose(0.85, -0.018, 0.00)),
]
"""What stands there and where the robot is; somebody takes the blocking cone away before the last two pictures."""


def replayed() -> List[Dict[str, Any]]:
    """What detector and avoider answer to each picture, ready for JSON."""
    calibration = shipped.default_calibration()
    paper = replace(shipped.detection_settings(), profile='paper')
    detector, memory, rules = start(calibration, paper), Memory(), shipped.avoidance_settings()
    answers = []
    for number, (things, pose) in enumerate(FRAMES):
        stamp = START + number * STEP
        picture = draw(Scene(things), calibration, pose, seed=number)
        scene, detector = detect(detector, picture, stamp)
        inputs = Inputs(Stamped(stamp, scene.obstacles), Stamped(stamp, pose.lane_pose))
        decision, memory = decide(inputs, memory, stamp, rules)
        answers.append(
            {
                'stamp': stamp,
                'obstacles': [_fields_of_obstacle(one) for one in sorted(scene.obstacles, key=lambda one: one.x)],
                'decision': _fields_of_decision(decision),
            }
        )
    return answers


def _fields_of_obstacle(obstacle: Obstacle) -> Dict[str, Any]:
    fields: Dict[str, Any] = _plain(asdict(obstacle))
    fields['kind'] = obstacle.kind and obstacle.kind.value
    return fields


def _fields_of_decision(decision: Decision) -> Dict[str, Any]:
    return {
        'state': decision.state.name,
        'd_ref': _plain(decision.d_ref),
        'v_ref': decision.v_ref,
        'reason': decision.reason,
        'active': decision.active,
        'obstacle': decision.obstacle and decision.obstacle.kind and decision.obstacle.kind.value,
    }


def _plain(value: Any) -> Any:
    """Rounded far below the tolerances, so that a refreshed file differs only where something changed."""
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    return round(value, 4) if isinstance(value, float) else value
