"""images_to_bag: picture files as a bag that replay.launch and run_bag take."""

import argparse
import sys
from typing import Any

import rosbag

from obst_avoid.core.picture import PictureError, decode_jpeg
from obst_avoid.offline import tool
from obst_avoid.offline.pictures import read_jpeg
from obst_avoid.offline.recording import JPEG, TOPICS
from obst_avoid.ros import border


def main(arguments: Any = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog='images_to_bag', description='Write picture files into a bag, in order.')
    parser.add_argument('--output', metavar='BAG', required=True, help='bag to write')
    parser.add_argument(
        '--vehicle', metavar='NAME', default='images', help='robot under whose name they stand (default: images)'
    )
    parser.add_argument('--rate', metavar='HZ', type=tool.rate, default=30.0, help='pictures a second (default: 30)')
    parser.add_argument('paths', metavar='PATH', nargs='+', help='pictures, or folders of pictures')
    return tool.run(_main, parser, arguments)


def _main(options: argparse.Namespace) -> int:
    tool.new_file(options.output)
    files = tool.picture_files(options.paths)
    topic = '/%s/%s' % (options.vehicle.strip('/'), TOPICS[JPEG])
    written = broken = 0
    with tool.whole(options.output) as part, rosbag.Bag(part, 'w') as bag:
        for path in tool.progress(files, 'writing'):
            try:
                jpeg = read_jpeg(path)
                decode_jpeg(jpeg)
            except (PictureError, OSError) as error:
                why = error.strerror if isinstance(error, OSError) else error
                print('images_to_bag: %s: %s' % (path, why), file=sys.stderr)
                broken += 1
                continue
            stamp = tool.stamp_of_frame(written, options.rate)
            msg = border.compressed_image_from_jpeg(jpeg, stamp, border.camera_frame(options.vehicle))
            bag.write(topic, msg, border.ros_time(stamp))
            written += 1
    print('%d pictures on %s: %s' % (written, topic, options.output))
    return 1 if broken else 0
