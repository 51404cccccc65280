"""One picture through the detector: every intermediate picture, and for each blob why it counts or not."""

from dataclasses import dataclass, field
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple

from obst_avoid.core import detection
from obst_avoid.core.bird_view import BirdView, image_box_from_bird
from obst_avoid.core.detection.paper.settings import PaperSettings
from obst_avoid.core.detection.robust import trees
from obst_avoid.core.types import Array, Box, Kind, Obstacle, Scene
from obst_avoid.viz.steps import paper_steps, robust_steps


@dataclass(frozen=True)
class Blob:
    """What the detector looked at. box: [px] in the camera picture, corner: in the picture that its step shows.

    why: in words, the number and the limit that decided. numbers: what was measured of it. reasons: measurements that
    moved the confidence most, with by how much its odds' logarithm; profile robust only. obstacle: what is reported.
    """

    kind: Kind
    box: Box
    corner: Tuple[float, float]
    why: str
    numbers: Mapping[str, float]
    reasons: Mapping[str, float] = field(default_factory=dict)
    obstacle: Optional[Obstacle] = None

    @property
    def accepted(self) -> bool:
        """It is reported as an obstacle."""
        return self.obstacle is not None


@dataclass(frozen=True)
class Steps:
    """panels: name and picture of each step in order. blobs: those that are reported first, then the surest."""

    scene: Scene
    panels: List[Tuple[str, Array]]
    blobs: List[Blob]
    view: BirdView


def steps_of(detector: detection.Detector, picture: Array) -> Steps:
    """A picture by itself. Raises CalibrationError when it is not of the calibration's camera."""
    stages: Dict[str, Any] = {}
    scene, seen = detection.detect(detector, picture, None, trace=stages.__setitem__)
    if seen.camera is not None:
        panels = robust_steps(picture, stages, seen.view, seen.camera)
        blobs = list(_robust_blobs(stages, detector.settings.robust.confidence))
    else:
        panels = paper_steps(picture, stages, seen.view)
        found = _paper_blobs(stages, seen.view, detector.settings.paper)
        blobs = sorted(found, key=lambda blob: (not blob.accepted, -blob.numbers['area']))
    return Steps(scene, panels, blobs, seen.view)


def _robust_blobs(stages: Mapping[str, Any], least: float) -> Iterator[Blob]:
    """Candidates come best first, and those that are sure enough become the obstacles in the same order."""
    obstacles = iter(stages['obstacles'])
    for item in stages['candidates']:
        accepted = item.confidence >= least
        why = 'confidence %.2f, %s %.2f' % (item.confidence, 'at least' if accepted else 'less than', least)
        numbers = {'confidence': item.confidence, 'x': item.x, 'y': item.y, 'radius': item.radius}
        reasons = dict(trees.reasons(trees.shipped()['thing'], stages['values'][item.row]))
        corner = (item.box.left, item.box.bottom)
        yield Blob(item.kind, item.box, corner, why, numbers, reasons, next(obstacles) if accepted else None)


def _paper_blobs(stages: Mapping[str, Any], view: BirdView, settings: PaperSettings) -> Iterator[Blob]:
    obstacles = iter(stages['obstacles'])
    for blob in stages['blobs']:
        numbers = {'area': blob.area}
        if blob.major:
            numbers.update({'first eigenvalue': blob.major, 'second': blob.minor})
        box = image_box_from_bird(view, blob.pixels)
        corner = (blob.box.left, blob.box.bottom)
        obstacle = None if blob.refused else next(obstacles)
        if blob.kind is Kind.DUCKIE:
            passed = 'first eigenvalue %.0f px^2, more than %.0f' % (blob.major, settings.duckie_eigenvalue)
        else:
            passed = 'ratio of eigenvalues %.0f, more than %.0f' % (blob.ratio, settings.cone_ratio)
        yield Blob(blob.kind, box, corner, blob.refused or passed, numbers, {}, obstacle)
