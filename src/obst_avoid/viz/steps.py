"""Every intermediate picture of a profile, from what its trace recorded."""

from typing import Any, List, Mapping, Optional, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.bird_view import BirdView, bird_from_ground, crop, warp
from obst_avoid.core.detection.paper.detector import search_line
from obst_avoid.core.detection.paper.shape import Blob
from obst_avoid.core.detection.robust.channels import WIDE, YELLOW
from obst_avoid.core.detection.robust.judgement import Candidate
from obst_avoid.core.detection.robust.lane import Lane
from obst_avoid.core.detection.robust.light import LINEAR
from obst_avoid.core.detection.robust.lines import Line
from obst_avoid.core.detection.robust.view import View
from obst_avoid.core.types import Array, Kind
from obst_avoid.viz.overlay import draw_on_bird_view, draw_on_picture, label

ACCEPTED, REFUSED = (60, 190, 60), (60, 60, 200)
TINT = {Kind.DUCKIE: (0, 215, 255), Kind.CONE: (0, 110, 255)}


def paper_steps(picture: Array, stages: Mapping[str, Any], view: BirdView) -> List[Tuple[str, Array]]:
    """(name, picture) of each step in order. picture: as the camera gave it. stages: by name, as traced."""
    obstacles, colors = stages['obstacles'], stages['colors']
    boxed = draw_on_bird_view(stages['bird_view'], obstacles)
    for obstacle in obstacles:
        for u, v in search_line(obstacle.bird_box, view):
            boxed[v, u] = (255, 0, 255) if colors['white'][v, u] else (0, 255, 255)
    return [
        ('1 picture', picture),
        ('2 corrected colours', stages['corrected']),
        ('3 rectified and cropped', stages['cropped']),
        ('4 bird view', stages['bird_view']),
        ('5 hue, saturation, value', stages['hsv']),
        ('6 yellow', colors['yellow']),
        ('7 orange', colors['orange']),
        ('8 white', colors['white']),
        ('9 blobs, and why refused', _draw_blobs(stages['bird_view'], stages['blobs'])),
        ('10 after the tracker', _draw_blobs(stages['bird_view'], stages['tracked'])),
        ('11 obstacles, search lines', boxed),
        ('12 result', draw_on_picture(picture, obstacles, view)),
    ]


def robust_steps(picture: Array, stages: Mapping[str, Any], view: BirdView, camera: View) -> List[Tuple[str, Array]]:
    """(name, picture) of each step in order. picture: as the camera gave it. stages: by name, as traced."""
    (small, channels), regions = stages['channels'], stages['regions']
    seen = LINEAR[small] / stages['light'].as_array()
    toned = np.clip(255 * (seen / 4) ** (1 / 2.2), 0, 255).astype(np.uint8)
    bird = warp(crop(picture, view), view)
    return [
        ('1 picture', picture),
        ('2 light relative to the asphalt', toned),
        ('3 levels of yellow', _levels(channels.heights[YELLOW], camera)),
        ('4 levels of yellow, paint cut off', _levels(channels.heights[WIDE], camera)),
        ('5 regions at all levels', _draw_regions(toned, regions.box)),
        ('6 promising regions', _draw_regions(toned, regions.box[stages['promising']])),
        ('7 lines of tape', _draw_lines(bird, view, stages['lines'], None)),
        ('8 candidates', _draw_candidates(picture, stages['candidates'])),
        ('9 our lane', _draw_lines(bird, view, stages['lines'], stages['lane'])),
        ('10 obstacles', draw_on_bird_view(bird, stages['obstacles'])),
        ('11 result', draw_on_picture(picture, stages['obstacles'], view)),
    ]


def _levels(levels: Array, camera: View) -> Array:
    drawn = np.zeros((camera.height, camera.width), dtype=np.uint8)
    drawn[camera.top :] = np.minimum(levels.astype(np.int64) * 12, 255)
    colored: Array = cv2.applyColorMap(drawn, cv2.COLORMAP_INFERNO)
    return colored


def _draw_regions(toned: Array, boxes: Array) -> Array:
    drawn: Array = (toned // 2).astype(np.uint8)
    for left, top, width, height in boxes.astype(int):
        cv2.rectangle(drawn, (left, top), (left + width - 1, top + height - 1), (200, 200, 0), 1)
    return drawn


def _draw_candidates(picture: Array, candidates: Sequence[Candidate]) -> Array:
    drawn: Array = picture.copy()
    for item in sorted(candidates, key=lambda item: item.confidence):
        color = ACCEPTED if item.confidence >= 0.5 else REFUSED
        corners = [int(round(value)) for value in (item.box.left, item.box.top, item.box.right, item.box.bottom)]
        cv2.rectangle(drawn, tuple(corners[:2]), tuple(corners[2:]), color, 1)
        label(drawn, '%.2f' % item.confidence, (item.box.left, item.box.top), color, 0.4)
    return drawn


def _draw_lines(bird: Array, view: BirdView, lines: Sequence[Line], lane: Optional[Lane]) -> Array:
    """Each line's crossings and curve; with a lane, its two boundaries only."""
    drawn: Array = bird.copy()
    sides = () if lane is None else ((lane.left, (0, 220, 255)), (lane.right, (255, 255, 255)))
    pieces = [(line, color) for side, color in sides if side is not None for line in side.pieces]
    for line, color in pieces or ([(line, (80, 220, 80)) for line in lines] if lane is None else []):
        dots = bird_from_ground(view, np.column_stack([line.x, line.y]))
        for u, v in np.rint(dots).astype(int):
            cv2.circle(drawn, (int(u), int(v)), 2, color, -1)
        if len(dots) > 1:
            cv2.polylines(drawn, [np.rint(dots[np.argsort(line.x)]).astype(np.int32)], False, color, 1)
    if lane is not None:
        words = 'd %.3f m, phi %.0f deg, curvature %.1f /m' % (
            lane.pose.d,
            np.degrees(lane.pose.phi),
            lane.pose.curvature,
        )
        label(drawn, words, (8, 24), (60, 60, 60), 0.5)
    return drawn


def _draw_blobs(bird: Array, blobs: Sequence[Blob]) -> Array:
    drawn: Array = (bird // 3).astype(np.uint8)
    for blob in blobs:
        drawn[blob.pixels[:, 1], blob.pixels[:, 0]] = TINT[blob.kind]
    for blob in blobs:
        box = blob.box
        color = REFUSED if blob.refused else ACCEPTED
        cv2.rectangle(drawn, (int(box.left) - 1, int(box.top) - 1), (int(box.right), int(box.bottom)), color, 1)
        if blob.major:
            words = '%.0f' % blob.major if blob.kind is Kind.DUCKIE else '%.0f/%.1f' % (blob.major, blob.minor)
            label(drawn, words, (box.left, box.top), color, 0.35)
    return drawn
