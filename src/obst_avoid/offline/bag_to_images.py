"""bag_to_images: the pictures of a bag as files, named by their stamp."""

import argparse
import os
import sys
from typing import Any

from obst_avoid.core.picture import PictureError, encode_jpeg
from obst_avoid.offline import tool
from obst_avoid.offline.recording import JPEG, named_pictures, open_bag
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
    written = broken = 0
    for index, stem, item in tool.progress(named_pictures(recording), 'writing', recording.pictures):
        if index % options.every:
            continue
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
        with open(os.path.join(options.output, stem + '.jpg'), 'wb') as file:
            file.write(jpeg)
        written += 1
    print('%d pictures: %s' % (written, options.output))
    return 1 if broken else 0
