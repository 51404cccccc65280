"""detect_images: obstacles in picture files, as JSON and as annotated pictures."""

import argparse
import os
import sys
import time
from typing import Any, Dict, List, Sequence

from obst_avoid.core import detection
from obst_avoid.core.calibration import CalibrationError
from obst_avoid.core.picture import PictureError, decode_jpeg
from obst_avoid.core.types import Obstacle
from obst_avoid.offline import tool
from obst_avoid.offline.pictures import read_jpeg
from obst_avoid.viz.overlay import draw_on_picture


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog='detect_images', description='Find duckies and cones in pictures.')
    tool.add_calibration_arguments(parser)
    parser.add_argument('--sequence', action='store_true', help='the pictures follow each other: use the tracker')
    parser.add_argument('--rate', type=tool.rate, default=30.0, help='pictures a second of a sequence (default: 30)')
    parser.add_argument('--output', metavar='FILE', required=True, help='JSON file to write')
    parser.add_argument('--annotated', metavar='DIR', help='write each picture with its boxes there')
    parser.add_argument('paths', metavar='PATH', nargs='+', help='pictures, or folders of pictures')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    files = tool.picture_files(options.paths)
    names = tool.short_names(files)
    tool.writable(options.output)
    detector = detection.start(tool.calibration_of(options), tool.detection_settings(options))
    if options.annotated:
        os.makedirs(options.annotated, exist_ok=True)
    images: List[Dict[str, Any]] = []
    broken: List[str] = []
    for index, path in enumerate(tool.progress(files, 'detecting')):
        try:
            jpeg = read_jpeg(path)
            begin = time.perf_counter()
            picture = decode_jpeg(jpeg)
            stamp = tool.stamp_of_frame(index, options.rate) if options.sequence else None
            scene, detector = detection.detect(detector, picture, stamp)
            milliseconds = 1e3 * (time.perf_counter() - begin)
        except (PictureError, CalibrationError, OSError) as error:
            broken.append('%s: %s' % (path, error.strerror if isinstance(error, OSError) else error))
            continue
        images.append(
            {
                'file_name': names[path],
                'width': picture.shape[1],
                'height': picture.shape[0],
                'milliseconds': round(milliseconds, 3),
                'obstacles': [json_from_obstacle(obstacle) for obstacle in in_sight(scene.obstacles)],
            }
        )
        if options.annotated:
            name = names[path] if names[path].lower().endswith('.jpg') else names[path] + '.jpg'
            target = os.path.join(options.annotated, name)
            if os.path.exists(target) and os.path.samefile(target, path):
                raise tool.ToolError('--annotated %s would overwrite the pictures themselves' % options.annotated)
            os.makedirs(os.path.dirname(target), exist_ok=True)
            tool.write_picture(target, draw_on_picture(picture, scene.obstacles, detector.view))
    tool.write_json(options.output, {'images': images})
    found = sum(len(image['obstacles']) for image in images)
    print('%d pictures, %d obstacles: %s' % (len(images), found, options.output))
    for sentence in broken:
        print('detect_images: %s' % sentence, file=sys.stderr)
    return 1 if broken else 0


def in_sight(obstacles: Sequence[Obstacle]) -> List[Obstacle]:
    """Those that a picture shows: a tracker also remembers what it does not show any more."""
    return [obstacle for obstacle in obstacles if obstacle.image_box is not None]


def json_from_obstacle(obstacle: Obstacle) -> Dict[str, Any]:
    """One entry of the detections file: m, and bbox = [left, top, width, height] in pixels of the picture as given."""
    box = obstacle.image_box
    assert box is not None and obstacle.kind is not None, 'detectors say both'
    return {
        'kind': obstacle.kind.value,
        'bbox': [round(v, 2) for v in (box.left, box.top, box.right - box.left, box.bottom - box.top)],
        'x': round(obstacle.x, 4),
        'y': round(obstacle.y, 4),
        'radius': round(obstacle.radius, 4),
        'in_lane': obstacle.in_lane,
        'confidence': round(obstacle.confidence, 4),
    }
