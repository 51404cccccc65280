"""Labels and detections for the tests of `evaluate`: written small, or made from given labels by a seeded jitter."""

import json
import random
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

DUCKIE, CONE, ROBOT = 1, 2, 3
CATEGORIES = [{'id': DUCKIE, 'name': 'duckie'}, {'id': CONE, 'name': 'cone'}, {'id': ROBOT, 'name': 'duckiebot'}]
NAMES = {item['id']: item['name'] for item in CATEGORIES}
Json = Dict[str, Any]


def coco(pictures: Dict[str, Sequence[Tuple[int, List[float]]]], **fields: Any) -> Json:
    """Labels of 640x480 pictures: by file name (category, bbox). fields: of all pictures."""
    images = [
        {'id': number, 'file_name': name, 'width': 640, 'height': 480, **fields}
        for number, name in enumerate(pictures, 1)
    ]
    annotations = [
        {'id': 0, 'image_id': number, 'category_id': category, 'bbox': list(box), 'iscrowd': 0}
        for number, boxes in enumerate(pictures.values(), 1)
        for category, box in boxes
    ]
    for number, annotation in enumerate(annotations, 1):
        annotation['id'] = number
    return {'categories': CATEGORIES, 'images': images, 'annotations': annotations}


def found(kind: str, box: Sequence[float], confidence: float = 0.9, in_lane: Optional[bool] = True) -> Json:
    """An obstacle of a detections file."""
    return {
        'kind': kind, 'bbox': list(box), 'x': 0.5, 'y': 0.0, 'radius': 0.03, 'in_lane': in_lane,
        'confidence': confidence,
    }  # fmt: skip


def detections(pictures: Dict[str, Sequence[Json]]) -> Json:
    """A detections file by file name."""
    return {
        'images': [
            {'file_name': name, 'width': 640, 'height': 480, 'milliseconds': 5.0, 'obstacles': list(obstacles)}
            for name, obstacles in pictures.items()
        ]
    }


def written(path: Path, content: Any) -> str:
    """The path of a new JSON file."""
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content if isinstance(content, str) else json.dumps(content))
    return str(path)


def many(count: int, seed: int = 0) -> Json:
    """Labels of so many pictures, with up to 5 boxes each."""
    rng = random.Random(seed)
    pictures = {}
    for number in range(count):
        boxes = []
        for _ in range(rng.randint(0, 5)):
            height = rng.uniform(12, 120)
            box = [rng.uniform(0, 560), rng.uniform(100, 350), height * rng.uniform(0.7, 1.2), height]
            boxes.append((rng.choice([DUCKIE, DUCKIE, CONE, ROBOT]), [round(value, 1) for value in box]))
        pictures['%06d.jpg' % number] = boxes
    labels = coco(pictures)
    for number, image in enumerate(labels['images']):
        image['lighting'] = ('bright', 'dark', 'red')[number % 3]
    for annotation in labels['annotations']:
        annotation.update(x=round(rng.uniform(0.2, 1.2), 3), y=round(rng.gauss(0, 0.2), 3), radius=0.03)
        annotation['in_lane'] = rng.random() < 0.5
    return labels


def jittered(labels: Json, seed: int) -> Json:
    """Detections made of labels: hits, feet, fragments, twice the same, wrong kinds, too large ones, false alarms."""
    rng = random.Random(seed)
    names = {item['id']: item['name'] for item in labels['categories']}
    boxes: Dict[Any, List[Json]] = {}
    for annotation in labels['annotations']:
        boxes.setdefault(annotation['image_id'], []).append(annotation)
    images = []
    for image in labels['images']:
        obstacles: List[Json] = []
        for annotation in boxes.get(image['id'], []):
            obstacles += _of_label(annotation['bbox'], names[annotation['category_id']], rng)
        for _ in range(rng.choice([0, 0, 1, 2])):
            box = [rng.uniform(0, 600), rng.uniform(120, 440), rng.uniform(8, 80), rng.uniform(8, 80)]
            obstacles.append(_obstacle(rng.choice(['duckie', 'cone']), box, rng))
        rng.shuffle(obstacles)
        images.append({
            'file_name': image['file_name'], 'width': image['width'], 'height': image['height'],
            'milliseconds': round(rng.lognormvariate(1, 0.5), 3), 'obstacles': obstacles,
        })  # fmt: skip
    return {'images': images}


def _of_label(box: Sequence[float], name: str, rng: random.Random) -> List[Json]:
    x, y, w, h = box
    if name not in ('duckie', 'cone'):
        inside = [x + 0.3 * w, y + 0.3 * h, 0.4 * w, 0.4 * h]
        return [_obstacle('duckie', inside, rng)] if rng.random() < 0.1 else []
    kind = name if rng.random() < 0.9 else {'duckie': 'cone', 'cone': 'duckie'}[name]
    shifted = [
        x + rng.gauss(0, 0.08) * w, y + rng.gauss(0, 0.08) * h, w * rng.uniform(0.8, 1.2), h * rng.uniform(0.8, 1.2)
    ]  # fmt: skip
    sorts = [
        (0.45, [shifted]),
        (0.15, [[x + 0.2 * w, y + 0.5 * h, 0.6 * w, 0.5 * h]]),
        (0.10, [[x + 0.1 * w, y, 0.4 * w, 0.3 * h]]),
        (0.10, [[x, y, w, h], [x + 1, y + 2, w, h]]),
        (0.05, [[x - 0.6 * w, y - 0.5 * h, 2.2 * w, 2 * h]]),
        (0.15, []),
    ]
    chosen = rng.choices([boxes for _, boxes in sorts], [weight for weight, _ in sorts])[0]
    return [_obstacle(kind, item, rng) for item in chosen]


def _obstacle(kind: str, box: Sequence[float], rng: random.Random) -> Json:
    rounded = [round(float(value), 2) for value in box]
    return {
        **found(kind, rounded, round(rng.random(), 4), rng.choice([True, False, None])),
        'x': round(rng.uniform(0.2, 1.2), 4), 'y': round(rng.gauss(0, 0.2), 4),
    }  # fmt: skip
