"""Recordings: a bag or a folder of pictures, as one stream of messages in time order."""

import os
from dataclasses import dataclass, field
from typing import Any, Dict, Iterator, Set, Tuple

import genpy
import rosbag

from obst_avoid.core.picture import PictureError
from obst_avoid.core.types import Array
from obst_avoid.offline.pictures import read_jpeg
from obst_avoid.offline.tool import ToolError, picture_files, stamp_of_frame
from obst_avoid.ros import border

JPEG, RAW, CAMERA_INFO, LANE_POSE = 'jpeg', 'raw', 'camera_info', 'lane_pose'
TOPICS = {
    JPEG: 'camera_node/image/compressed',
    RAW: 'camera_node/image',
    CAMERA_INFO: 'camera_node/camera_info',
    LANE_POSE: 'lane_filter_node/lane_pose',
}
"""What is read of a recording, by the end of its topic's name: a bag may come from a robot of another name."""
TYPES = {JPEG: 'sensor_msgs/CompressedImage', RAW: 'sensor_msgs/Image', CAMERA_INFO: 'sensor_msgs/CameraInfo'}
CAR_CMD, TRUE_POSE, TURN = 'car_cmd', 'true_pose', 'turn'
MOTION = {CAR_CMD: 'lane_controller_node/car_cmd', TRUE_POSE: 'simulator_node/truth/pose', TURN: 'turn'}
"""What says how the robot moved and will, by the end of its topic's name; read only by those who ask for it."""
MOTION_TYPES = {CAR_CMD: 'Twist2DStamped', TRUE_POSE: 'PoseStamped', TURN: 'String'}
"""Ends of the types' names: a command's class may be our own or duckietown_msgs'."""


@dataclass(frozen=True)
class Recorded:
    """One message. role: a key of TOPICS or MOTION. time: [ns] when it was recorded."""

    role: str
    time: int
    msg: Any


@dataclass(frozen=True)
class Recording:
    """A bag or a folder. topics: by role, as far as it has them; for a folder only JPEG. pictures: how many.

    motion: topics of MOTION of the robot that took the pictures, by role, as far as it has them.
    """

    path: str
    topics: Dict[str, str]
    pictures: int
    files: Tuple[str, ...] = ()
    rate: float = 30.0
    motion: Dict[str, str] = field(default_factory=dict)

    @property
    def picture_role(self) -> str:
        """JPEG where there are JPEGs, else RAW."""
        return JPEG if JPEG in self.topics else RAW


def open_bag(path: str, vehicle: str = '', topic: str = '') -> Recording:
    """Look into a bag. vehicle: whose topics, needed when several have pictures. topic: of the pictures, by name.

    Raises ToolError in one sentence when it cannot be read or has no pictures.
    """
    if not os.path.isfile(path):
        found = 'is a folder' if os.path.isdir(path) else 'does not exist'
        raise ToolError('%s %s, expected a bag' % (path, found))
    try:
        with rosbag.Bag(path) as bag:
            info = bag.get_type_and_topic_info().topics
    except (rosbag.ROSBagException, ValueError, OSError) as error:
        raise ToolError('%s cannot be read as a bag: %s' % (path, error)) from error
    if topic and topic not in info:
        raise ToolError('%s has no topic %s, expected one of: %s' % (path, topic, ', '.join(sorted(info)) or 'none'))
    prefix = '/%s/' % vehicle.strip('/') if vehicle else '/'
    topics: Dict[str, str] = {}
    for role, ending in TOPICS.items():
        found = [name for name in sorted(info) if name.startswith(prefix) and name.endswith('/' + ending)]
        if role in (JPEG, RAW) and topic:
            found = [topic]
        types = TYPES.get(role)
        found = [name for name in found if types is None or info[name].msg_type == types]
        if len(found) > 1:
            raise ToolError('%s has several robots, expected one of them by name: %s' % (path, ', '.join(found)))
        if found and found[0] not in topics.values():
            topics[role] = found[0]
    recording = Recording(path, topics, 0)
    if recording.picture_role not in topics:
        wanted = 'a topic that ends in %s or %s' % (TOPICS[JPEG], TOPICS[RAW])
        robot = ' of %s' % vehicle if vehicle else ''
        raise ToolError(
            '%s has no pictures%s, expected %s, found: %s' % (path, robot, wanted, ', '.join(sorted(info)) or 'nothing')
        )
    pictures = info[topics[recording.picture_role]].message_count
    own = {role: '/%s/%s' % (robot_of(recording), ending) for role, ending in MOTION.items()}
    types = {name: info[name].msg_type for name in own.values() if name in info}
    motion = {role: name for role, name in own.items() if types.get(name, '').endswith('/' + MOTION_TYPES[role])}
    return Recording(path, topics, pictures, motion=motion)


def open_folder(path: str, rate: float) -> Recording:
    """Take the pictures of a folder as a recording with rate pictures a second. Raises ToolError."""
    files = picture_files([path])
    return Recording(path, {JPEG: ''}, len(files), tuple(files), rate)


def readable(name: str) -> str:
    """A file's name as text that can be written anywhere: another one when the name is not UTF-8."""
    return os.fsencode(name).decode('utf-8', 'replace')


def robot_of(recording: Recording) -> str:
    """Name of the robot that recorded a bag."""
    return recording.topics[recording.picture_role].strip('/').split('/')[0]


def picture_of(item: Recorded) -> Array:
    """(H, W, 3) uint8, BGR, of a picture message. Raises PictureError."""
    if item.role == JPEG:
        return border.picture_from_compressed_image(item.msg)
    return border.picture_from_image(item.msg)


def named_pictures(recording: Recording) -> Iterator[Tuple[int, str, Recorded]]:
    """A recording's picture messages: number, name without ending, message. A name is its stamp, and tells it alone."""
    names: Set[str] = set()
    pictures = (item for item in messages(recording) if item.role in (JPEG, RAW))
    for number, item in enumerate(pictures):
        stamp = border.nanoseconds(item.msg.header.stamp)
        name = '%d_%09d' % (stamp // 10**9, stamp % 10**9)
        name += '_%d' % number if name in names else ''
        names.add(name)
        yield number, name, item


def messages(recording: Recording, motion: bool = False) -> Iterator[Recorded]:
    """All messages in time order. A file that is no readable picture is passed on empty: its reader complains.

    motion: also those that say how the robot moved.
    """
    if recording.files:
        for index, path in enumerate(recording.files):
            stamp = stamp_of_frame(index, recording.rate)
            try:
                jpeg = read_jpeg(path)
            except (PictureError, OSError):
                jpeg = b''
            name = readable(os.path.basename(path))
            yield Recorded(JPEG, stamp, border.compressed_image_from_jpeg(jpeg, stamp, name))
        return
    roles = {name: role for role, name in recording.topics.items() if role != RAW or recording.picture_role == RAW}
    if motion:
        roles.update({name: role for role, name in recording.motion.items()})
    with rosbag.Bag(recording.path) as bag:
        try:
            for topic, msg, time in bag.read_messages(topics=list(roles)):
                yield Recorded(roles[topic], border.nanoseconds(time), msg)
        except (rosbag.ROSBagException, genpy.DeserializationError, OSError, EOFError) as error:
            raise ToolError('%s is damaged: %s' % (recording.path, error)) from error
