"""The report's tracker: a yellow blob counts when consecutive pictures agree (report, step 5)."""

import math
from dataclasses import dataclass
from typing import List, Sequence, Tuple

from obst_avoid.core.detection.paper.settings import PaperSettings
from obst_avoid.core.detection.paper.shape import Blob
from obst_avoid.core.types import Kind


@dataclass(frozen=True)
class Track:
    """A duckie-like blob of the last picture. seen: consecutive pictures, that one included. changed: by more than
    size_change since the picture before.
    """

    blob: Blob
    seen: int
    changed: bool


def track(
    tracks: Sequence[Track], blobs: Sequence[Blob], pixels_per_metre: float, settings: PaperSettings
) -> List[Track]:
    """Match the duckie-like blobs of one picture with the tracks of the picture before.

    Each track takes at most one blob, nearest pairs first; a track that finds none ends, since the report's rule
    is about consecutive pictures. Cones are not tracked. Returns the tracks of this picture, in the blobs' order.
    """
    scale = pixels_per_metre / settings.reference_scale
    ducks = [blob for blob in blobs if blob.kind is Kind.DUCKIE and not blob.refused]
    pairs = []
    for i, old in enumerate(tracks):
        for j, blob in enumerate(ducks):
            across, down = _move(old.blob, blob)
            distance = math.hypot(across, down)
            if distance <= settings.same_place * scale and down >= -settings.moved_up * scale:
                pairs.append((distance, i, j))
    taken, before = set(), {}
    for _, i, j in sorted(pairs):
        if i not in taken and j not in before:
            taken.add(i)
            before[j] = tracks[i]
    return [
        _continued(blob, before[j], settings) if j in before else Track(blob, 1, False) for j, blob in enumerate(ducks)
    ]


def confirmed(tracks: Sequence[Track], settings: PaperSettings) -> List[Blob]:
    """The blobs that were seen often enough: a large steady one sure_frames times, any other unsure_frames times."""
    return [item.blob for item in tracks if item.seen >= frames_needed(item, settings)]


def frames_needed(item: Track, settings: PaperSettings) -> int:
    """How many consecutive pictures a track needs before it counts."""
    sure = item.blob.major > settings.sure_eigenvalue and not item.changed
    return settings.sure_frames if sure else settings.unsure_frames


def _continued(blob: Blob, old: Track, settings: PaperSettings) -> Track:
    changed = abs(blob.area - old.blob.area) > settings.size_change * old.blob.area
    return Track(blob, old.seen + 1, changed)


def _move(old: Blob, new: Blob) -> Tuple[float, float]:
    """[px] by which the middle of the lower edge moved to the right and down, towards the robot."""
    across = (new.box.left + new.box.right - old.box.left - old.box.right) / 2
    return across, new.box.bottom - old.box.bottom
