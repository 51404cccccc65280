"""Labelled pictures to samples: the regions of each picture, what was measured on them, and what they truly are."""

import json
import math
import os
import zlib
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Sequence, Tuple

import cv2
import numpy as np

from obst_avoid.core.calibration import Calibration, find_calibration, scaled
from obst_avoid.core.detection.robust.channels import channels_of
from obst_avoid.core.detection.robust.features import NAMES, measure, measure_all
from obst_avoid.core.detection.robust.light import LINEAR, estimate_light
from obst_avoid.core.detection.robust.lines import find_lines
from obst_avoid.core.detection.robust.regions import find_regions
from obst_avoid.core.detection.robust.trees import Forest, summed
from obst_avoid.core.detection.robust.view import View, make_view, working_picture
from obst_avoid.core.geometry import image_from_rectified, pixel_from_ground
from obst_avoid.core.types import Array
from obst_avoid.offline.evaluation.matching import KINDS, ROBOT, Label, Rectangle, ignored_because
from obst_avoid.offline.pictures import read_picture
from obst_avoid.offline.tool import ToolError

LEAST_HEIGHT = 12.0
"""[px] of a label in 640x480: smaller ones teach neither way."""
LEAST_PART = 0.5
"""Of a thing that a copy of a picture has to show still, or it teaches neither way."""
FAR_ROW = 180 / 480
"""Of the picture's height: beyond it, incompletely labelled pictures say nothing about what is no thing."""
GAINS, EXPOSURE, SHADING, NOISE = 1.2, (-2.0, 1.2), 0.5, 5.0
"""Copies of a picture in another light: stops of each channel and of all, share at the corners, grey levels."""
LAMPS, LAMP_GAIN = (3, 4), 1.0
"""Places by which lamps of different colours light a picture, rows and columns, and stops of each."""
ZOOM, SHIFT, ROLL = 0.22, 20.0, 3.0
"""And through another camera: logarithm of the zoom, [px] of 640x480, [deg]."""
TABLE = 4096
ENCODED = ((np.arange(TABLE + 1) / TABLE) ** (1 / 2.2) * 256 - 1).clip(0, 255)
"""The inverse of LINEAR."""


@dataclass(frozen=True)
class Dataset:
    """One COCO file and the camera that took its pictures."""

    labels: str
    pictures: str
    calibration: str
    vehicle: str
    copies: int


@dataclass(frozen=True)
class Thing:
    """One labelled obstacle. box: [px]. place: row where it meets the road [px], x and radius [m], where known."""

    kind: str
    box: Rectangle
    place: Optional[Tuple[float, float, float]]


@dataclass(frozen=True, eq=False)  # arrays: the same object or another
class Samples:
    """N regions of one picture.

    values: (N, F) float32, of measure_all or of measure. thing: (N,) int, number of the one most alike, -1 where there
    is none. overlap: (N,) intersection over union with it. touches: (N,) bool, lies on a labelled thing somehow.
    ignored: (N,) bool. cone: (N,) bool. foot, radius: (N,) targets of the forests of these names, NaN where not known.
    box: (N, 4) [px].
    """

    group: str
    picture: str
    copy: int
    values: Array
    thing: Array
    overlap: Array
    touches: Array
    ignored: Array
    cone: Array
    foot: Array
    radius: Array
    box: Array


def read_datasets(path: str, content: Any) -> List[Dataset]:
    """From the parsed YAML file: a list of mappings with the fields of Dataset. Raises ToolError."""
    fields = {'labels': str, 'pictures': str, 'calibration': str, 'vehicle': str, 'copies': int}
    if not isinstance(content, list) or not content:
        raise ToolError('%s is not a list, expected one mapping of %s a dataset' % (path, ', '.join(fields)))
    datasets = []
    for number, item in enumerate(content):
        if not isinstance(item, dict) or set(item) != set(fields):
            raise ToolError('%s: entry %d does not have exactly the fields %s' % (path, number, ', '.join(fields)))
        for name, kind in fields.items():
            if not isinstance(item[name], kind):
                raise ToolError('%s: entry %d: %s = %r, expected %s' % (path, number, name, item[name], kind.__name__))
        datasets.append(Dataset(**item))
    return datasets


def read_labels(dataset: Dataset) -> List[Tuple[Dict[str, Any], List[Dict[str, Any]]]]:
    """(picture, its annotations with their category's name) of one COCO file. Raises ToolError."""
    try:
        with open(dataset.labels, encoding='utf-8') as file:
            content = json.load(file)
        names = {item['id']: item['name'] for item in content['categories']}
        for item in content['images']:
            os.path.join(dataset.pictures, item['file_name'])
            item.update(width=int(item['width']), height=int(item['height']))
        of_picture: Dict[Any, List[Dict[str, Any]]] = {item['id']: [] for item in content['images']}
        for annotation in content['annotations']:
            box = [float(value) for value in annotation['bbox']]
            category = names[annotation['category_id']]
            place = {name: float(annotation[name]) for name in ('x', 'y', 'radius') if name in annotation}
            if len(box) != 4 or len(place) not in (0, 3) or place.get('radius', 1.0) <= 0:
                raise ValueError(
                    'annotation %s needs 4 numbers in bbox, and x, y, radius > 0 or none' % annotation['id']
                )
            of_picture[annotation['image_id']].append(dict(annotation, bbox=box, category=category))
        return [(item, of_picture[item['id']]) for item in content['images']]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ToolError('%s is no COCO file: %s' % (dataset.labels, error)) from error


def samples_of(
    dataset: Dataset,
    picture: Dict[str, Any],
    annotations: Sequence[Dict[str, Any]],
    copy: int,
    first: Optional[Forest] = None,
) -> Optional[Samples]:
    """The samples of one picture; copy > 0: in another light and through another camera, the same ones each time.

    first: only the regions that this forest leaves, and everything of them; without it all, and what is measured on
    all. None when there are none.
    """
    calibration = _calibration(dataset, int(picture['width']), int(picture['height']))
    pixels = read_picture(os.path.join(dataset.pictures, picture['file_name']))
    things, ignored = _things(annotations, calibration)
    if copy:
        random = np.random.RandomState(zlib.crc32(('%s %d' % (picture['file_name'], copy)).encode()))
        pixels, things, ignored = _through_another_camera(pixels, things, ignored, random)
        pixels = _in_another_light(pixels, random)
    view = _view(dataset, calibration)
    light = estimate_light(pixels)
    channels = channels_of(working_picture(pixels, view), light, view)
    regions = find_regions(channels, view)
    values = measure_all(regions, channels, view)
    box = regions.box * view.scale
    if first is not None:
        chosen = np.flatnonzero(summed(first, values) > -np.inf)
        lines = find_lines(pixels, view.sampling, light.as_array())
        values, box = measure(regions, chosen, values, channels, view, lines), box[chosen]
    if not len(values):
        return None
    overlap, which, touches = _compared(box, np.array([item.box for item in things]).reshape(-1, 4))
    _, _, on_ignored = _compared(box, np.array(ignored).reshape(-1, 4))
    if not _complete(picture):
        on_ignored = on_ignored | ((box[:, 1] + box[:, 3] < FAR_ROW * calibration.height) & ~touches)
    foot, radius = _targets(box, which, things, values)
    return Samples(
        str(picture.get('split_block', picture.get('subset', dataset.labels))),
        str(picture['file_name']),
        copy,
        values,
        which,
        overlap,
        touches,
        on_ignored,
        np.array([which >= 0 and things[which].kind == 'cone' for which in which]),
        foot,
        radius,
        box,
    )


_CAMERAS: Dict[Tuple[str, str, int, int], Tuple[Calibration, View]] = {}


def _calibration(dataset: Dataset, width: int, height: int) -> Calibration:
    key = (dataset.calibration, dataset.vehicle, width, height)
    if key not in _CAMERAS:
        calibration = scaled(find_calibration(dataset.vehicle, dataset.calibration), width, height)
        _CAMERAS[key] = (calibration, make_view(calibration))
    return _CAMERAS[key][0]


def _view(dataset: Dataset, calibration: Calibration) -> View:
    return _CAMERAS[(dataset.calibration, dataset.vehicle, calibration.width, calibration.height)][1]


def _complete(picture: Dict[str, Any]) -> bool:
    """Whether every duckie and every cone is labelled, as far as the file says."""
    complete = picture.get('complete', {})
    return all(str(complete.get(kind, '')) == 'all' for kind in KINDS)


def _things(annotations: Sequence[Dict[str, Any]], calibration: Calibration) -> Tuple[List[Thing], List[Rectangle]]:
    labels = [
        Label(item['category'], tuple(item['bbox']), bool(item.get('iscrowd')), bool(item.get('riding')))
        for item in annotations
    ]
    robots = [label.box for label in labels if label.category == ROBOT]
    things: List[Thing] = []
    ignored: List[Rectangle] = []
    for item, label in zip(annotations, labels):
        if label.category not in KINDS:
            continue
        size = (calibration.width, calibration.height)
        why = ignored_because(label, size, robots)
        if why in ('iscrowd', 'riding') or label.box[3] < LEAST_HEIGHT * calibration.height / 480:
            ignored.append(label.box)
            continue
        place = None
        if 'radius' in item:
            x, y = float(item['x']), float(item['y'])
            pixel = pixel_from_ground(calibration.homography, np.array([[x, y]]))
            place = (float(image_from_rectified(calibration, pixel)[0, 1]) + 0.5, x, float(item['radius']))
        things.append(Thing(label.category, label.box, place))
    return things, ignored


def _compared(box: Array, things: Array) -> Tuple[Array, Array, Array]:
    """Of each box: the best overlap with a thing, which one, and whether it lies on any, by a fifth or by its foot."""
    if not len(things):
        return np.zeros(len(box)), np.full(len(box), -1), np.zeros(len(box), dtype=bool)
    low = np.maximum(box[:, None, :2], things[None, :, :2])
    high = np.minimum(box[:, None, :2] + box[:, None, 2:], things[None, :, :2] + things[None, :, 2:])
    common = np.prod(np.maximum(high - low, 0), axis=2)
    areas, others = box[:, 2] * box[:, 3], things[:, 2] * things[:, 3]
    union = areas[:, None] + others[None] - common
    ratio = common / union
    u, v = (box[:, 0] + box[:, 2] / 2)[:, None], (box[:, 1] + box[:, 3])[:, None]
    x, y, w, h = things.T
    foot = (u >= x - 0.25 * w) & (u <= x + 1.25 * w) & (v >= y + 0.35 * h) & (v <= y + 1.25 * h)
    foot &= (areas[:, None] < 4 * others) & (others < 4 * areas[:, None])
    touches = (common.sum(axis=1) > 0.2 * areas) | foot.any(axis=1)
    return ratio.max(axis=1), ratio.argmax(axis=1), touches


def _targets(box: Array, which: Array, things: Sequence[Thing], values: Array) -> Tuple[Array, Array]:
    """How far below its lowest row a region's foot is, in its heights, and the log of its true to its seen radius."""
    foot, radius = np.full(len(box), np.nan), np.full(len(box), np.nan)
    for index in np.flatnonzero(which >= 0):
        thing = things[which[index]]
        if thing.place is not None:  # boxes drawn by hand end somewhere near the foot
            row, x, size = thing.place
            foot[index] = (row - box[index, 1] - box[index, 3]) / box[index, 3]
            seen = values[index, NAMES.index('width')] / 2
            if not values[index, NAMES.index('cut_low')]:
                seen *= x / values[index, NAMES.index('ahead')]
            radius[index] = math.log2(size / max(seen, 1e-3))
    return foot, radius


def _through_another_camera(
    picture: Array, things: Sequence[Thing], ignored: Sequence[Rectangle], random: 'np.random.RandomState'
) -> Tuple[Array, List[Thing], List[Rectangle]]:
    """Zoomed, shifted, rolled and perhaps mirrored: calibrations are wrong, cameras differ. Truth in metres is lost."""
    height, width = picture.shape[:2]
    zoom = math.exp(random.uniform(-ZOOM, ZOOM))
    shift = random.uniform(-SHIFT, SHIFT, 2) * height / 480
    middle = np.array([width / 2, 0.31 * height])
    roll = math.radians(random.uniform(-ROLL, ROLL))
    turned = zoom * np.array([[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]])
    matrix = np.column_stack([turned, middle - turned @ middle + shift])
    picture = cv2.warpAffine(picture, matrix, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    mirrored = random.rand() < 0.5
    if mirrored:
        picture = np.ascontiguousarray(picture[:, ::-1])

    def moved(box: Rectangle) -> Rectangle:
        half = zoom / 2 * np.array(box[2:])  # things stay upright: the roll of a camera is small
        centre = turned @ (box[0] + box[2] / 2, box[1] + box[3] / 2) + matrix[:, 2]
        (left, top), (right, bottom) = np.clip([centre - half, centre + half], 0, (width, height))
        if mirrored:
            left, right = width - right, width - left
        return (float(left), float(top), float(right - left), float(bottom - top))

    kept, lost = [], [moved(box) for box in ignored]
    for thing in things:
        box = moved(thing.box)
        whole = zoom**2 * thing.box[2] * thing.box[3]
        if box[3] < LEAST_HEIGHT * height / 480 or box[2] * box[3] < LEAST_PART * whole:
            lost.append(box)
        else:
            kept.append(Thing(thing.kind, box, None))
    return picture, kept, [box for box in lost if min(box[2:]) > 0]


def _in_another_light(picture: Array, random: 'np.random.RandomState') -> Array:
    """Another colour and brightness of light, several lamps, shading, stray light, noise, blur and JPEG quality."""
    gains = np.exp2(random.uniform(-GAINS, GAINS, 3) * (random.rand() < 0.7))
    gains = gains / gains.max() ** random.uniform(0, 1) * np.exp2(random.uniform(*EXPOSURE))
    light = LINEAR[picture] * gains.astype(np.float32)
    if random.rand() < 0.4:
        lamps = random.uniform(-LAMP_GAIN, LAMP_GAIN, LAMPS + (3,)).astype(np.float32)
        light = light * np.exp2(cv2.resize(lamps, picture.shape[1::-1], interpolation=cv2.INTER_CUBIC))
    if random.rand() < 0.3:
        v, u = np.mgrid[-1 : 1 : picture.shape[0] * 1j, -1 : 1 : picture.shape[1] * 1j]
        light = light * (1 + ((u**2 + v**2) / 2)[..., None] * random.uniform(-SHADING, SHADING, 3)).astype(np.float32)
    if random.rand() < 0.3:
        light = light + np.float32(random.uniform(0, 0.02))
    pixels = ENCODED[np.minimum((light * TABLE).astype(np.int32), TABLE)]
    if random.rand() < 0.6:
        pixels = pixels + random.randn(*picture.shape) * random.uniform(0, NOISE)
    result: Array = np.clip(pixels, 0, 255).astype(np.uint8)
    if random.rand() < 0.3:
        size = random.randint(2, 9)
        kernel = np.zeros((size, size), dtype=np.float32)
        if random.rand() < 0.5:
            kernel[size // 2] = 1 / size
        else:
            np.fill_diagonal(kernel, 1 / size)
        result = cv2.filter2D(result, -1, kernel)
    if random.rand() < 0.7:
        jpeg = cv2.imencode('.jpg', result, [cv2.IMWRITE_JPEG_QUALITY, int(random.randint(40, 92))])[1]
        result = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
    return result
