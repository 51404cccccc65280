"""Pictures on the page: annotated, small enough, and each with the call that shows it again."""

import base64
import os
import shlex
from typing import Any, Callable, Dict, Optional, Sequence, Tuple

import cv2

from obst_avoid.core.types import Array
from obst_avoid.offline.evaluation.parts import Content
from obst_avoid.viz.overlay import label

PICTURE_WIDTH = 640
"""[px] of the widest picture on the page."""
PICTURE_STEPS = ((640, 80), (640, 65), (480, 65), (320, 60))
"""Width [px] and JPEG quality, from the best on: the first that fits the picture's part of the budget is taken."""
GREEN, RED, GREY, WHITE, MAGENTA, BLUE = (
    (60, 200, 60),
    (40, 40, 230),
    (160, 160, 160),
    (255, 255, 255),
    (230, 40, 230),
    (235, 160, 60),
)
"""BGR."""
LABEL_COLORS = {'hit': GREEN, 'missed': RED, 'ignored': GREY}


class Cards:
    """Makes annotated pictures that together stay within a budget."""

    def __init__(self, picture_of: Callable[[Dict[str, Any]], Optional[Array]], budget: int, robot: str = '') -> None:
        """budget: [characters] for each panel. robot: whose pictures of a bag these are, when it has several."""
        self._picture_of = picture_of
        self._budget = budget
        self._robot = robot

    def of(self, picture: Dict[str, Any], names: Sequence[str], run: Content) -> Dict[str, Any]:
        """What the page shows of one picture. names: of the runs, a panel each. run: whose command is shown."""
        found = self._picture_of(picture)
        words = '%s, annotated: %s' % (picture['name'], picture['why'])
        panels = []
        if found is not None:
            uris = [(name, self._fitting(annotated(found, picture, name))) for name in names]
            titled = len(names) > 1
            panels = [{'uri': uri, 'words': words, 'title': name if titled else ''} for name, uri in uris if uri]
        return {
            'name': picture['name'],
            'why': picture['why'],
            'panels': panels,
            'absent': 'Picture not found.' if found is None else 'Left out, so that the page stays small.',
            'command': command_of(picture, run.get('arguments') or [], self._robot),
        }

    def _fitting(self, drawn: Array) -> str:
        """The best data URI that fits the budget; '' when none does."""
        for width, quality in PICTURE_STEPS:
            uri = jpeg_uri(_narrowed(drawn, width), quality)
            if len(uri) <= self._budget:
                return uri
        return ''


def jpeg_uri(picture: Array, quality: int) -> str:
    """A picture as data: URI."""
    jpeg = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    return 'data:image/jpeg;base64,' + base64.b64encode(jpeg).decode()


def _narrowed(picture: Array, width: int) -> Array:
    if picture.shape[1] <= width:
        return picture
    height = max(1, round(picture.shape[0] * width / picture.shape[1]))
    narrow: Array = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return narrow


def annotated(picture: Array, marks: Content, run: str) -> Array:
    """Draw labels and one run's detections. picture: (H, W, 3) uint8 BGR. marks: a PICTURE of evaluation.json.

    Returns a picture at most PICTURE_WIDTH wide.
    """
    drawn = _narrowed(picture, PICTURE_WIDTH).copy()
    scale = drawn.shape[1] / picture.shape[1]
    words = []
    for item in marks['labels']:
        state = (item.get('states') or {}).get(run, item['state'])
        color = LABEL_COLORS[state]
        at = _rectangle(drawn, item['bbox'], scale, color, 1 if state == 'ignored' else 2)
        if state == 'ignored' and item.get('why'):
            words.append((item['why'], at, color))
    for item in marks['runs'].get(run, ()):
        state = item['state']
        color = MAGENTA if state == 'fa' or item.get('side_wrong') else WHITE if state == 'hit' else BLUE
        at = _rectangle(drawn, item['bbox'], scale, color, 2 if state == 'fa' else 1)
        if state == 'fa':
            words.append(('%s %.2f' % (item['kind'], item['confidence']), at, color))
        elif item.get('side_wrong'):
            words.append(('wrong side', at, MAGENTA))
        elif state != 'hit':
            words.append((state, at, BLUE))
    for text, at, (blue, green, red) in words:  # last, so that no box crosses them
        label(drawn, text, at, (blue * 3 // 4, green * 3 // 4, red * 3 // 4), 0.45)  # darker: the letters are white
    return drawn


def _rectangle(
    drawn: Array, bbox: Sequence[float], scale: float, color: Tuple[int, int, int], width: int
) -> Tuple[float, float]:
    """Draw a box in place; returns its upper left corner."""
    left, top, right, bottom = (round(scale * v) for v in (bbox[0], bbox[1], bbox[0] + bbox[2], bbox[1] + bbox[3]))
    cv2.rectangle(drawn, (left, top), (right - 1, bottom - 1), color, width)
    return left, top


def command_of(picture: Content, arguments: Sequence[str], robot: str = '') -> str:
    """The call that shows every step of the detector on this picture alone, to be pasted into a shell.

    robot: whose pictures are taken of a bag; '' when it has only one.
    """
    show = ['rosrun', 'obst_avoid', 'show_steps', *arguments, '--output', 'steps']
    bag = picture.get('in_bag')
    if bag:
        whose = ['--vehicle', robot] if robot else []
        unpack = ['rosrun', 'obst_avoid', 'bag_to_images', *whose, '--output', 'pictures', bag['path']]
        one = os.path.join('pictures', os.path.basename(picture['name']))
        return '%s &&\n%s' % (_shell(unpack), _shell([*show, one]))
    return _shell([*show, picture.get('path') or picture['name']])


def _shell(words: Sequence[str]) -> str:
    return ' '.join(shlex.quote(str(word)) for word in words)
