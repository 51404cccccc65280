"""From a picture to what it shows, by the profile that the settings name.

A profile is one package beside this file with a `detect` and an empty state; `start`, `detect` and `_camera` below are
the only places that know the profiles' names.
"""

from dataclasses import dataclass, replace
from typing import Any, Optional, Sequence, Tuple

from obst_avoid.core.bird_view import BirdView, make_bird_view
from obst_avoid.core.calibration import Calibration, scaled
from obst_avoid.core.detection.robust import detector as robust_detector
from obst_avoid.core.detection.robust import trees
from obst_avoid.core.detection.robust.view import View, make_view
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.types import Array, Command, Scene, Stamped, Trace, no_trace


@dataclass(frozen=True)
class Detector:
    """Everything that one detection needs beside the picture.

    view, camera: for the size of the latest picture, the report's bird view and what else the profile robust needs.
    state: of the profile, from the pictures before. newest: [ns] stamp of the latest of these.
    """

    calibration: Calibration
    settings: DetectionSettings
    view: BirdView
    camera: Optional[View]
    state: Any
    newest: Optional[int] = None


def start(calibration: Calibration, settings: DetectionSettings) -> Detector:
    """A detector that has seen nothing yet. Raises CalibrationError; SettingsError when the trees are not usable."""
    if settings.profile == 'robust':
        trees.shipped()  # what is wrong with them is said now, not at the first thing on the road
    view = make_bird_view(calibration, settings.bird_view)
    return Detector(calibration, settings, view, _camera(calibration, settings), _nothing_seen(settings))


def tuned(detector: Detector, settings: DetectionSettings) -> Detector:
    """A detector that goes on with other settings, and with what it has seen unless the profile is another one.

    Raises what start does.
    """
    if (settings.profile, settings.bird_view) == (detector.settings.profile, detector.settings.bird_view):
        return replace(detector, settings=settings)
    calibration = detector.view.calibration
    if settings.profile == detector.settings.profile:
        return replace(detector, settings=settings, view=make_bird_view(calibration, settings.bird_view))
    return replace(start(calibration, settings), calibration=detector.calibration)


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
    settings, view, camera = detector.settings, detector.view, detector.camera
    if (view.calibration.width, view.calibration.height) != (width, height):
        calibration = scaled(detector.calibration, width, height)
        view, camera = make_bird_view(calibration, settings.bird_view), _camera(calibration, settings)
    alone = stamp is None or (detector.newest is not None and stamp < detector.newest)
    state = _nothing_seen(settings) if alone else detector.state
    if camera is None:
        obstacles, state = _paper().detect(picture, view, settings.paper, state, stamp, trace)
        scene = Scene(obstacles)
    else:
        scene, state = robust_detector.detect(picture, view, camera, settings.robust, state, stamp, commands, trace)
    return scene, replace(detector, view=view, camera=camera, state=state, newest=stamp)


def _camera(calibration: Calibration, settings: DetectionSettings) -> Optional[View]:
    return make_view(calibration) if settings.profile == 'robust' else None


def _nothing_seen(settings: DetectionSettings) -> Any:
    return robust_detector.RobustState() if settings.profile == 'robust' else _paper().PaperState()


def _paper() -> Any:
    """The profile paper, which alone needs scikit-image: 45 MB and half a second that robust can do without."""
    from obst_avoid.core.detection.paper import detector

    return detector
