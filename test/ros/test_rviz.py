"""visualizer.launch with rviz, as a person at the laptop sees it: markers, the annotated picture, the bird view."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Dict, Iterator, Optional, Tuple

import cv2
import numpy as np
import pytest
import yaml
from helpers import REPOSITORY, jpeg_of
from screen import MISSING, Screen

from obst_avoid.offline.graph import launched

pytestmark = pytest.mark.skipif(
    bool(MISSING), reason='not installed: %s, see deps/install desktop' % ', '.join(MISSING)
)

START = 180.0
"""[s] of wall time for rviz to draw without a graphics card on a busy machine."""
INSIDE, OUTSIDE = (0.55, 0.03, 0.03), (0.60, -0.30, -0.04)
"""(x, y, z) on the wire."""
ALIKE = 0.8
"""Correlation with what was published from which a panel shows it."""
Area = Tuple[int, int, int, int]


def find(screen: Any, picture: Any) -> Optional[Area]:
    """Where a picture is shown at whatever size: left, top, width, height, None when it is nowhere."""
    small = cv2.cvtColor(cv2.resize(screen, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2GRAY)
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    best, where = ALIKE, None
    for width in range(120, min(small.shape[1], 400), 2):
        size = (width, round(width * grey.shape[0] / grey.shape[1]))
        if size[1] > small.shape[0]:
            break
        alike = cv2.matchTemplate(small, cv2.resize(grey, size, interpolation=cv2.INTER_AREA), cv2.TM_CCOEFF_NORMED)
        _, value, _, (left, top) = cv2.minMaxLoc(alike)
        if value > best:
            best, where = value, (2 * left, 2 * top, 2 * size[0], 2 * size[1])
    return where


def view_of_rviz() -> Dict[str, Any]:
    """The camera of the 3D view, from the configuration."""
    content = yaml.safe_load((REPOSITORY / 'rviz' / 'obst_avoid.rviz').read_text())
    return dict(content['Visualization Manager']['Views']['Current'])


def seen_at(point: Tuple[float, float, float], panel: Area) -> Tuple[float, float]:
    """Where an orbit view shows a point of the robot frame, [px]. rviz's opening angle is 45 degrees upwards."""
    view = view_of_rviz()
    focus = np.array([view['Focal Point'][axis] for axis in 'XYZ'])
    yaw, pitch = view['Yaw'], view['Pitch']
    back = np.array([math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)])
    ahead = -back
    right = np.cross(ahead, (0, 0, 1)) / np.linalg.norm(np.cross(ahead, (0, 0, 1)))
    x, y, z = (np.array(point) - focus - view['Distance'] * back) @ np.column_stack(
        [right, np.cross(right, ahead), ahead]
    )
    left, top, width, height = panel
    focal = height / 2 / math.tan(math.radians(22.5))
    return left + width / 2 + focal * x / z, top + height / 2 - focal * y / z


def blob(screen: Any, panel: Area, color: str) -> Optional[Tuple[float, float, int]]:
    """The largest patch of red or green in the 3D view: its middle and its pixels; None without any."""
    left, top, width, height = panel
    part = screen[top : top + height, left : left + width].astype(int)
    blue, green, red = part[..., 0], part[..., 1], part[..., 2]
    strong, weak = (red, green) if color == 'red' else (green, red)
    mask = ((strong > 90) & (strong > 2.2 * weak) & (strong > 2.2 * blue)).astype(np.uint8)
    count, _, stats, middles = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return None
    index = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return left + middles[index][0], top + middles[index][1], int(stats[index, cv2.CC_STAT_AREA])


@pytest.fixture(scope='module')
def screen() -> Iterator[Screen]:
    with Screen() as made:
        yield made


def published(folder: Path, name: str) -> Any:
    """What the visualizer published last, None before."""
    path = folder / (name + '.png')
    return cv2.imread(str(path)) if path.exists() else None


def what_is_missing(screen: Any, folder: Path) -> str:
    """What of the scene is not on the screen, '' when all is."""
    areas = {}
    for name in ('image', 'bird_view'):
        picture = published(folder, name)
        if picture is None:
            return '%s: not published' % name
        areas[name] = find(screen, picture)
    absent = [name for name, area in areas.items() if area is None]
    if absent:
        return '%s: not in any panel' % absent[0]
    camera, bird = areas['image'], areas['bird_view']
    assert camera is not None and bird is not None
    if min(camera[2], bird[2]) < 300:
        return 'panels of %d and %d pixels cannot be read' % (camera[2], bird[2])
    panel = central_panel(screen, min(camera[0], bird[0]))
    for color, (x, y, _) in (('red', INSIDE), ('green', OUTSIDE)):
        found = blob(screen, panel, color)
        u, v = seen_at((x, y, 0.03), panel)
        if found is None or found[2] < 60:
            return 'no %s marker: %s' % (color, found)
        if math.hypot(found[0] - u, found[1] - v) > 40:
            return 'the %s marker is at %.0f, %.0f, expected %.0f, %.0f' % (color, found[0], found[1], u, v)
    return ''


def central_panel(screen: Any, right: int) -> Area:
    """The 3D view: the rows and columns left of the pictures' panels where its background is."""
    content = yaml.safe_load((REPOSITORY / 'rviz' / 'obst_avoid.rviz').read_text())
    red, green, blue = (
        int(part) for part in content['Visualization Manager']['Global Options']['Background Color'].split(';')
    )
    ground = (np.abs(screen[:, :right].astype(int) - (blue, green, red)) <= 3).all(axis=2)
    rows, columns = (np.flatnonzero(ground.mean(axis=axis) > 0.1) for axis in (1, 0))
    if not len(rows):
        return 0, 0, right, screen.shape[0]
    return int(columns[0]), int(rows[0]), int(columns[-1] - columns[0]) + 1, int(rows[-1] - rows[0]) + 1


def test_markers_picture_and_bird_view_are_there_to_see(screen: Screen, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv('DISPLAY', screen.display)
    monkeypatch.setenv('LIBGL_ALWAYS_SOFTWARE', '1')
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(tmp_path))
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path))
    call = ['visualizer.launch', 'veh:=duck1', 'allow_default_calibration:=true', 'rviz:=true']
    with open(str(tmp_path / 'log.txt'), 'wb') as log, launched(call, log.fileno()) as graph:
        scene = subprocess.Popen([sys.executable, __file__, str(tmp_path)], env=graph.environment)
        try:
            end = time.monotonic() + START
            while True:
                missing = what_is_missing(screen.picture(), tmp_path)
                if not missing or time.monotonic() > end:
                    break
                time.sleep(1.0)
            keep = os.environ.get('OBST_AVOID_SCREENSHOT')
            if keep:
                screen.write(keep)
            assert not missing, missing
        finally:
            scene.kill()
            scene.wait()


def show_scene(folder: str) -> None:
    """What a robot would publish, over and over, and the visualizer's pictures into files. A program of its own."""
    import rospy
    from cv_bridge import CvBridge
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from geometry_msgs.msg import PoseArray
    from helpers import compressed_image, pose_array
    from sensor_msgs.msg import CompressedImage, Image
    from visualization_msgs.msg import MarkerArray

    from obst_avoid.core.avoidance.corridor import View
    from obst_avoid.core.types import Decision, State
    from obst_avoid.ros.markers import markers_from_decision

    rospy.init_node('scene', anonymous=True)

    def keep(msg: Any, name: str) -> None:
        part = '%s/part_%s.png' % (folder, name)
        cv2.imwrite(part, CvBridge().imgmsg_to_cv2(msg, 'bgr8'))
        os.replace(part, '%s/%s.png' % (folder, name))

    leave_out = os.environ.get('OBST_AVOID_LEAVE_OUT', '')  # to see the test fail
    node = '/duck1/obstacle_detection_visual_node/'
    for name in ('image', 'bird_view'):
        rospy.Subscriber(node + name, Image, keep, name, queue_size=1, buff_size=2**24)
    camera = rospy.Publisher('/duck1/camera_node/image/compressed', CompressedImage, queue_size=1)
    lists = rospy.Publisher('/duck1/obstacle_detection_node/posearray', PoseArray, queue_size=1)
    plans = rospy.Publisher('/duck1/obstacle_avoidance_node/markers', MarkerArray, queue_size=1)
    health = rospy.Publisher('/diagnostics', DiagnosticArray, queue_size=1)
    corners = np.array([(0.0, 0.11), (1.0, 0.11), (1.0, -0.11), (0.0, -0.11), (0.0, 0.11)])
    plan = View(corners, np.array([(0.0, 0.0), (1.0, 0.0)]), INSIDE)
    decision = Decision(State.SLOWING, 0.0, 0.1, 'slowing: 1 obstacle in the lane, nearest 0.52 m, no room to pass')
    jpeg = jpeg_of()
    while not rospy.is_shutdown():
        stamp = rospy.Time.now()
        if leave_out != 'picture':
            camera.publish(compressed_image(jpeg, stamp))
        obstacles = [] if leave_out == 'markers' else [INSIDE, OUTSIDE]
        plans.publish(markers_from_decision(decision, plan, stamp.to_nsec(), 'duck1/footprint'))
        lists.publish(pose_array(obstacles, stamp, 'duck1/footprint'))
        values = [KeyValue('calibration', '/data/config/calibrations/camera_extrinsic/duck1.yaml')]
        words = '30.0 pictures/s, 12 ms each, 0.03 s old: 2 obstacles, 1 in the lane'
        line = DiagnosticStatus(DiagnosticStatus.OK, 'duck1/obstacle_detection_node: state', words, 'duck1', values)
        health.publish(DiagnosticArray(status=[line]))
        time.sleep(0.1)


if __name__ == '__main__':
    show_scene(sys.argv[1])
