"""The report's detector, step by step: this file is its table of contents."""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.age import age
from obst_avoid.core.bird_view import BirdView, bird_from_ground, crop, ground_from_bird, image_box_from_bird, warp
from obst_avoid.core.detection.paper.color import ColorCorrection, correct, estimate_correction, in_color
from obst_avoid.core.detection.paper.settings import PaperSettings
from obst_avoid.core.detection.paper.shape import Blob, confidence, find_blobs
from obst_avoid.core.detection.paper.tracking import Track, confirmed, track
from obst_avoid.core.types import Array, Box, Kind, Obstacle, Stamped, Trace, no_trace


@dataclass(frozen=True)
class PaperState:
    """What the detector remembers from picture to picture. The empty state is the start of a sequence."""

    correction: Optional[ColorCorrection] = None
    tracks: Optional[Stamped[Sequence[Track]]] = None


def detect(
    picture: Array,
    view: BirdView,
    settings: PaperSettings,
    state: PaperState,
    stamp: Optional[int],
    trace: Trace = no_trace,
) -> Tuple[List[Obstacle], PaperState]:
    """Find duckies and cones in one picture.

    picture: (H, W, 3) uint8, BGR, of the size that view was made for. stamp: [ns] of the picture, later than the
    state's; None for a picture that stands alone: the tracker is off and every blob that passes the criteria for a
    single picture is reported. trace: is called after each stage.
    Returns the obstacles and the state for the next picture.
    Source: report, section "Actual Implementation" of the detection.
    """
    correction = state.correction if settings.color_correction == 'once' else None
    if correction is None and settings.color_correction != 'none':
        correction = estimate_correction(picture, settings.largest_gain)
    corrected = correct(picture, correction)
    trace('corrected', corrected)
    cropped = crop(corrected, view)
    trace('cropped', cropped)
    bird = warp(cropped, view)
    trace('bird_view', bird)
    hsv = cv2.cvtColor(bird, cv2.COLOR_BGR2HSV)
    trace('hsv', hsv)
    yellow, orange, white = (in_color(hsv, color) for color in (settings.yellow, settings.orange, settings.white))
    trace('colors', {'yellow': yellow, 'orange': orange, 'white': white})
    scale = view.pixels_per_metre
    blobs = find_blobs(yellow, Kind.DUCKIE, scale, settings) + find_blobs(orange, Kind.CONE, scale, settings)
    trace('blobs', blobs)
    found = [blob for blob in blobs if not blob.refused]
    tracks: Optional[Stamped[Sequence[Track]]] = None
    if stamp is not None:
        tracks = Stamped(stamp, track(_fresh(state.tracks, stamp, settings), found, scale, settings))
        found = confirmed(tracks.value, settings) + [blob for blob in found if blob.kind is Kind.CONE]
    trace('tracked', found)
    obstacles = [_obstacle(blob, white, view, settings) for blob in found]
    trace('obstacles', obstacles)
    return obstacles, PaperState(correction if settings.color_correction == 'once' else None, tracks)


def search_line(box: Box, view: BirdView) -> Array:
    """Pixels between the robot and an obstacle's box, nearest first, as far as the bird view shows them.

    box: [px] in the bird view. Returns (N, 2) int, columns u, v, one a pixel of length, ending above the box's
    lower edge.
    """
    start = bird_from_ground(view, np.zeros((1, 2)))[0]
    end = np.array([(box.left + box.right - 1) / 2, box.bottom - 1])
    steps = int(np.ceil(np.hypot(*(end - start)))) + 1
    line = np.rint(start + np.linspace(0, 1, steps)[:, None] * (end - start)).astype(int)
    inside = (line >= 0).all(axis=1) & (line < (view.width, view.height)).all(axis=1)
    shown: Array = line[inside]
    return shown


def _fresh(tracks: Optional[Stamped[Sequence[Track]]], stamp: int, settings: PaperSettings) -> Sequence[Track]:
    """The tracks of the picture before, none when it is too long ago or when time ran backwards."""
    if tracks is None or not 0 < age(tracks.stamp, stamp) <= settings.longest_gap:
        return ()
    return tracks.value


def _obstacle(blob: Blob, white: Array, view: BirdView, settings: PaperSettings) -> Obstacle:
    """Position, radius and side of the lane line of one blob (report, steps 7 and 8)."""
    low = blob.box.bottom - 0.5  # pixel centres are whole numbers, the box ends between two of them
    edge = np.array([[(blob.box.left + blob.box.right - 1) / 2, low], [blob.box.right - 0.5, low]])
    (x, y), corner = ground_from_bird(view, edge)
    u, v = search_line(blob.box, view).T
    crossed = np.count_nonzero(white[v, u]) * settings.reference_scale / view.pixels_per_metre
    return Obstacle(
        kind=blob.kind,
        x=float(x),
        y=float(y),
        radius=float(np.hypot(x - corner[0], y - corner[1])),
        in_lane=bool(crossed <= settings.white_samples),
        confidence=confidence(blob, settings),
        bird_box=blob.box,
        image_box=image_box_from_bird(view, blob.pixels),
    )
