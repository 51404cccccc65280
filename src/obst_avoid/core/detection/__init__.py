"""From a picture to what it shows, by the profile that the settings name.

A profile is one package beside this file with a `detect` like paper's and an empty state; `start` and `detect`
below are the only places that know the profiles' names.
"""

from dataclasses import dataclass, replace
from typing import Any, Optional, Sequence, Tuple

from obst_avoid.core.bird_view import BirdView, make_bird_view
from obst_avoid.core.calibration import Calibration, scaled
from obst_avoid.core.detection.paper import detector as paper
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.types import Array, Command, Scene, Stamped, Trace, no_trace


@dataclass(frozen=True)
class Detector:
    """Everything that one detection needs beside the picture.

    view: for the size of the latest picture. state: of the profile, from the pictures before. newest: [ns] stamp of
    the latest of these.
    """

    calibration: Calibration
    settings: DetectionSettings
    view: BirdView
    state: Any
    newest: Optional[int] = None


def start(calibration: Calibration, settings: DetectionSettings) -> Detector:
    """A detector that has seen nothing yet. Raises CalibrationError."""
    return Detector(calibration, settings, make_bird_view(calibration, settings.bird_view), paper.PaperState())


def detect(
    detector: Detector,
    picture: Array,
    stamp: Optional[int],
    commands: Sequence[Stamped[Command]] = (),
    *,
    trace: Trace = no_trace,
) -> Tuple[Scene, Detector]:
    """Find what one picture shows.

    picture: (H, W, 3) uint8, BGR, as the camera gave it. stamp: [ns] of the picture; None: it stands alone. One older
    than the picture before begins a new sequence: a bag that loops, a clock that was set.
    commands: how the robot was told to move, oldest first, from before the picture before until this one, as far as it
    is known (core.motion). The profile paper takes no notice of them.
    trace: is called after each stage of the profile, for pictures and timings.
    Returns what was found and the detector for the next picture. Raises CalibrationError when the picture has
    another aspect than the calibration.
    """
    height, width = picture.shape[:2]
    view = detector.view
    if (view.calibration.width, view.calibration.height) != (width, height):
        view = make_bird_view(scaled(detector.calibration, width, height), detector.settings.bird_view)
    alone = stamp is None or (detector.newest is not None and stamp < detector.newest)
    state = paper.PaperState() if alone else detector.state
    obstacles, state = paper.detect(picture, view, detector.settings.paper, state, stamp, trace)
    return Scene(obstacles), replace(detector, view=view, state=state, newest=stamp)
