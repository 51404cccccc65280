"""Every intermediate picture of the profile `paper`, from what its trace recorded."""

from typing import Any, List, Mapping, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.bird_view import BirdView
from obst_avoid.core.detection.paper.detector import search_line
from obst_avoid.core.detection.paper.shape import Blob
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
