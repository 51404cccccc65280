"""What one picture gives with some settings: every step, each blob with its reason, and what the avoider would do."""

from dataclasses import dataclass
from typing import Any, Dict, List, Tuple

from obst_avoid.core import detection
from obst_avoid.core.avoidance.avoider import Inputs, Memory, decide
from obst_avoid.core.avoidance.corridor import view_of
from obst_avoid.core.avoidance.settings import AvoidanceSettings
from obst_avoid.core.bird_view import BirdView
from obst_avoid.core.calibration import Calibration
from obst_avoid.core.types import Array, Command, Decision, LanePose, Scene, Stamped, State
from obst_avoid.offline.steps import Blob, Steps, steps_of
from obst_avoid.offline.tuning.settings import AVOIDER, DETECTOR, Values, settings_of
from obst_avoid.viz.overlay import draw_on_picture, draw_plan_on_picture

SETTLED = 30
"""Decisions, ten a second, after which a robot that stands has made up its mind: it waits after its start, and for a
second sighting.
"""
PERIOD = 100_000_000
"""[ns] between two of them."""
STANDING = tuple(Stamped(number * PERIOD, Command(0.0, 0.0)) for number in range(SETTLED + 1))
MOST_ROWS = 40
"""Blobs in the table; the profile paper has hundreds of specks."""


@dataclass(frozen=True)
class Result:
    """panels: name and picture. rows: of the table, as text. found: obstacles, in words. decision: in words."""

    panels: List[Tuple[str, Array]]
    rows: List[Dict[str, str]]
    found: str
    decision: str


def result_of(picture: Array, calibration: Calibration, values: Values) -> Result:
    """A picture by itself, (H, W, 3) uint8, BGR. Raises SettingsError, CalibrationError."""
    detector = detection.start(calibration, settings_of(values, DETECTOR))
    steps = steps_of(detector, picture)
    settings: AvoidanceSettings = settings_of(values, AVOIDER)
    decision, pose = standing(steps.scene, settings)
    panels = steps.panels + [('%d the plan' % (len(steps.panels) + 1), plan(picture, steps, decision, pose, settings))]
    rows = [_row(blob) for blob in steps.blobs[:MOST_ROWS]]
    more = len(steps.blobs) - len(rows)
    if more > 0:
        rows.append({'kind': '', 'counts': '', 'place': '', 'numbers': '', 'why': '%d more, smaller ones' % more})
    return Result(panels, rows, _found(steps.scene), '%s: %s' % (decision.state.name, decision.reason))


def standing(scene: Scene, settings: AvoidanceSettings) -> Tuple[Decision, LanePose]:
    """What the avoider decides of a robot that stands and sees nothing but this, and where it is in the lane then.

    Without lines in the picture the robot is taken to be in the middle of a straight lane.
    """
    pose = scene.lane_pose or LanePose(0.0, 0.0)
    memory, decision = Memory(), Decision(State.FAULT, 0.0, 0.0, 'nothing decided yet')
    for number in range(1, SETTLED + 1):
        now = number * PERIOD
        inputs = Inputs(Stamped(now, scene.obstacles), Stamped(now, pose), Stamped(now, pose), STANDING[: number + 1])
        decision, memory = decide(inputs, memory, now, settings)
    return decision, pose


def plan(picture: Array, steps: Steps, decision: Decision, pose: LanePose, settings: AvoidanceSettings) -> Array:
    """The picture with the corridor in which obstacles count, the path, and the obstacles."""
    view: BirdView = steps.view
    drawn = draw_plan_on_picture(picture, view_of(decision, pose, settings), decision.state, view)
    return draw_on_picture(drawn, steps.scene.obstacles, view)


def _found(scene: Scene) -> str:
    words = ['%s %.2f m ahead, %+.2f m' % (_kind(item), item.x, item.y) for item in scene.obstacles]
    return '%d: %s' % (len(words), '; '.join(words)) if words else 'nothing'


def _row(blob: Blob) -> Dict[str, str]:
    place = '(%d, %d) px' % (round(blob.box.left), round(blob.box.bottom))
    if blob.obstacle is not None:
        place += ', x %.2f m, y %+.2f m, radius %.3f m, %s' % (
            blob.obstacle.x, blob.obstacle.y, blob.obstacle.radius, _side(blob.obstacle.in_lane),
        )  # fmt: skip
    numbers = ', '.join('%s %.4g' % item for item in blob.numbers.items())
    if blob.reasons:
        numbers += '; moved most by ' + ', '.join('%s %+.1f' % item for item in blob.reasons.items())
    counts = 'yes' if blob.accepted else 'no'
    return {'kind': blob.kind.value, 'counts': counts, 'place': place, 'why': blob.why, 'numbers': numbers}


def _side(in_lane: Any) -> str:
    return {True: 'in our lane', False: 'outside', None: 'side unknown'}[in_lane]


def _kind(item: Any) -> str:
    return 'something' if item.kind is None else str(item.kind.value)
