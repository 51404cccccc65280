"""bag_to_images: the pictures of a bag as files, named by their stamp."""

import argparse
import os
import sys
from typing import Any, Set

from obst_avoid.core.picture import PictureError, encode_jpeg
from obst_avoid.offline import tool
from obst_avoid.offline.recording import JPEG, RAW, messages, open_bag
from obst_avoid.ros import border


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        prog='bag_to_images', description='Write the pictures of a bag as JPEG files, named by their stamp.'
    )
    parser.add_argument('bag', metavar='BAG')
    parser.add_argument('--output', metavar='DIR', required=True, help='folder to write to')
    parser.add_argument(
        '--vehicle', metavar='NAME', default='', help='robot whose pictures are taken, if there are several'
    )
    parser.add_argument('--topic', metavar='TOPIC', default='', help='picture topic, if it has an unusual name')
    parser.add_argument('--every', metavar='N', type=tool.count, default=1, help='take every Nth picture (default: 1)')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    recording = open_bag(options.bag, options.vehicle, options.topic)
    os.makedirs(options.output, exist_ok=True)
    pictures = (item for item in messages(recording) if item.role in (JPEG, RAW))
    written = broken = 0
    names: Set[str] = set()
    for index, item in enumerate(tool.progress(pictures, 'writing', recording.pictures)):
        if index % options.every:
            continue
        stamp = border.nanoseconds(item.msg.header.stamp)
        name = '%d_%09d' % (stamp // 10**9, stamp % 10**9)
        name += '_%d.jpg' % index if name in names else '.jpg'
        names.add(name[: -len('.jpg')])
        try:
            if item.role == JPEG:
                border.picture_from_compressed_image(item.msg)
                jpeg = bytes(item.msg.data)  # as it came: encoding it anew would lose something
            else:
                jpeg = encode_jpeg(border.picture_from_image(item.msg), 95)
        except PictureError as error:
            print('bag_to_images: %s, picture %d: %s' % (options.bag, index, error), file=sys.stderr)
            broken += 1
            continue
        with open(os.path.join(options.output, name), 'wb') as file:
            file.write(jpeg)
        written += 1
    print('%d pictures: %s' % (written, options.output))
    return 1 if broken else 0
