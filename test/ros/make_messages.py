#!/usr/bin/env python3
"""Builds the Python classes of test/ros/duckietown_msgs, which the machine of a test does not have.

make_messages.py FOLDER: into FOLDER/duckietown_msgs/msg.
"""

import os
import sys
from pathlib import Path

import rospkg
from genpy.generate_initpy import write_modules
from genpy.generator import MsgGenerator

SOURCE = Path(__file__).resolve().parent / 'duckietown_msgs'


def main(folder: str) -> int:
    out = Path(folder) / 'duckietown_msgs' / 'msg'
    out.mkdir(parents=True, exist_ok=True)
    (out.parent / '__init__.py').write_text('')
    paths = {'duckietown_msgs': [str(SOURCE)]}
    for package in ('std_msgs', 'geometry_msgs'):
        paths[package] = [os.path.join(rospkg.RosPack().get_path(package), 'msg')]
    files = sorted(str(path) for path in SOURCE.glob('*.msg'))
    code = int(MsgGenerator().generate_messages('duckietown_msgs', files, str(out), paths))
    write_modules(str(out))
    return code


if __name__ == '__main__':
    sys.exit(main(sys.argv[1]))
