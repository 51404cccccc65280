"""Where the page's pictures come from: a folder, files, or a bag; any of them, in any order."""

import os
import sys
from dataclasses import dataclass
from typing import List, Sequence, Tuple

import genpy
import rosbag

from obst_avoid.core.types import Array
from obst_avoid.offline import tool
from obst_avoid.offline.pictures import read_picture
from obst_avoid.offline.recording import Recorded, open_bag, picture_of


@dataclass(frozen=True)
class Pictures:
    """names: of the pictures in order. bag: '' for files. times: of a bag's messages, (secs, nsecs)."""

    names: Sequence[str]
    files: Sequence[str] = ()
    bag: str = ''
    topic: str = ''
    role: str = ''
    times: Sequence[Tuple[int, int]] = ()


def open_pictures(paths: Sequence[str], vehicle: str) -> Pictures:
    """One bag, or pictures and folders of them. Raises ToolError."""
    bags = [path for path in paths if path.endswith('.bag')]
    if bags and len(paths) > 1:
        raise tool.ToolError('%s beside others, expected one bag, or pictures and folders' % bags[0])
    if not bags:
        files = tool.picture_files(paths)
        names = tool.short_names(files)
        return Pictures([names[path] for path in files], files)
    try:
        recording = open_bag(bags[0], vehicle)
    except tool.ToolError as error:
        recording = open_bag(bags[0])  # a calibration may be another robot's, as long as the bag has only one
        print('%s; taking those that are there' % str(error).split(', expected')[0], file=sys.stderr)
    role = recording.picture_role
    topic = recording.topics[role]
    with rosbag.Bag(bags[0]) as bag:
        read = tool.progress(bag.read_messages(topics=[topic], raw=True), 'reading', recording.pictures)
        stamps = [time for _, _, time in read]
    if not stamps:
        raise tool.ToolError('%s has no pictures, expected messages on %s' % (bags[0], topic))
    times = [(time.secs, time.nsecs) for time in stamps]
    names = ['%.2f s' % (time - stamps[0]).to_sec() for time in stamps]
    return Pictures(names, bag=bags[0], topic=topic, role=role, times=times)


def picture_at(pictures: Pictures, index: int) -> Array:
    """(H, W, 3) uint8, BGR. Raises PictureError, OSError, ToolError."""
    if not pictures.bag:
        return read_picture(pictures.files[index])
    time = genpy.Time(*pictures.times[index])
    before = sum(other == pictures.times[index] for other in pictures.times[:index])
    with rosbag.Bag(pictures.bag) as bag:
        found: List[Array] = []
        for _, msg, _ in bag.read_messages(topics=[pictures.topic], start_time=time, end_time=time):
            found.append(msg)
    if before >= len(found):
        raise tool.ToolError('%s has changed, expected a picture at %s' % (pictures.bag, pictures.names[index]))
    return picture_of(Recorded(pictures.role, 0, found[before]))


def title_of(pictures: Pictures) -> str:
    """What is looked at."""
    return os.path.basename(pictures.bag) or (
        pictures.names[0] if len(pictures.names) == 1 else '%d pictures' % len(pictures.names)
    )
