#!/usr/bin/env python3
"""The simulated drive through the detector: what is on the wire is compared with what stood there."""

import sys
import time
from typing import List

import rosbag
import rospy
import rostest
from geometry_msgs.msg import Pose, PoseArray
from helpers import (
    ANSWER,
    REPOSITORY,
    START,
    Inbox,
    Prepared,
    Repeating,
    default_calibration,
    nanoseconds,
    publisher,
    run_program,
)
from std_msgs.msg import Header

from obst_avoid.core.bird_view import BirdViewSettings, ground_from_bird, make_bird_view
from obst_avoid.core.settings import load, read_yaml
from obst_avoid.msg import LanePose, Twist2DStamped
from obst_avoid.offline import simulated_bag
from obst_avoid.sim.things import foot

BIRD_VIEW = read_yaml(str(REPOSITORY / 'config' / 'bird_view.yaml'))
DRIVE = simulated_bag.scripted()
PICTURES = '/simulated/camera_node/image/compressed'
FEWEST = 70
"""Of 279 pictures. The detector takes the newest and drops the others, on a busy machine many."""
RATES = (1.0, 0.4)
"""Of the player: when too few were answered it plays again, slower."""
SETTLED = 0.5
"""[s] into the drive, after which the tracker has confirmed what it sees."""
EMPTY = simulated_bag.DRIVES_ON + 2.95
"""[s] into the drive, when the last duckie has dropped out of the bird view."""
FORGETTING = {'paper': 0.1, 'robust': 0.8}
"""[s] after which what went away is not reported any more; robust goes by several pictures, of which some are lost."""
RANGE = 0.65
"""[m] within which the duckie must be found: farther away it is a few pixels, and the report finds it 6 cm off."""


def seconds_of(msg: PoseArray) -> float:
    """Into the drive; its first picture is stamped 1 s."""
    return nanoseconds(msg) / 1e9 - 1.0


def commanded(now: rospy.Time) -> Twist2DStamped:
    """What the robot of the recording is told: it is not in the bag."""
    seconds = now.to_sec() - 1.0
    stands = simulated_bag.STANDS <= seconds < simulated_bag.DRIVES_ON
    return Twist2DStamped(Header(stamp=now), 0.0 if stands else simulated_bag.SPEED, 0.0)


class Detection(Prepared):
    profile: str
    stamps: List[int]
    lists: List[PoseArray]
    lane_poses: List[LanePose]

    @classmethod
    def prepare(cls) -> None:
        cls.profile = rospy.get_param('~profile')
        bag = rospy.get_param('~bag')
        with rosbag.Bag(bag) as content:
            cls.stamps = [nanoseconds(msg) for _, msg, _ in content.read_messages(topics=[PICTURES])]
        inbox = Inbox('/simulated/obstacle_detection_node/posearray', PoseArray).connected()
        command = publisher('/simulated/lane_controller_node/car_cmd', Twist2DStamped)
        lane_poses = Inbox('/simulated/obstacle_detection_node/lane_pose', LanePose)
        for rate in RATES:
            time.sleep(1.0)  # an answer to the last picture may still be on its way
            before, poses_before = len(inbox.all()), len(lane_poses.all())
            options = ['-q', '--clock', '--wait-for-subscribers', '-d', '1', '-r', str(rate), '--topics', PICTURES]
            with Repeating(lambda: command.publish(commanded(rospy.Time.now()))):
                played = run_program(['rosrun', 'rosbag', 'play', *options, '--bags=' + bag], START + 30)
            assert played.code == 0, played.output
            # Not the very last picture: the player may be gone before it is delivered.
            inbox.wait(lambda msg: seconds_of(msg) > EMPTY, 'an answer to the last pictures', ANSWER, since=before)
            cls.lists, cls.lane_poses = inbox.all()[before:], lane_poses.all()[poses_before:]
            if len(cls.lists) >= FEWEST:
                break

    def test_enough_pictures_are_answered(self) -> None:
        self.assertGreaterEqual(len(self.lists), FEWEST)

    def test_each_stamp_is_exactly_a_pictures_stamp_and_comes_once(self) -> None:
        stamps = [nanoseconds(msg) for msg in self.lists]
        self.assertEqual([stamp for stamp in stamps if stamp not in self.stamps], [])
        self.assertEqual(len(set(stamps)), len(stamps))
        self.assertEqual(sorted(stamps), stamps)

    def test_the_frame_is_the_robots(self) -> None:
        self.assertEqual({msg.header.frame_id for msg in self.lists}, {'simulated/footprint'})

    def test_an_empty_list_is_published_when_nothing_is_there(self) -> None:
        self.assertTrue(any(not msg.poses for msg in self.lists))  # one picture confirms nothing
        last = [msg for msg in self.lists if seconds_of(msg) > EMPTY]
        self.assertTrue(last)
        if self.profile == 'paper':
            self.assertEqual([msg.poses for msg in last if msg.poses], [])

    def test_the_profile_robust_still_knows_of_the_last_duckie(self) -> None:
        for msg in self.lists if self.profile == 'robust' else ():
            if seconds_of(msg) > EMPTY:
                true = foot(DRIVE.beside, DRIVE.at(seconds_of(msg))[1])
                near = [pose for pose in msg.poses if abs(pose.position.y) < 0.15]  # and not the cone that it passes
                self.assertEqual(len(near), 1, '%.2f s into the drive' % seconds_of(msg))
                for pose in near:
                    self.assertAlmostEqual(pose.position.x, true.x, delta=0.05)
                    self.assertAlmostEqual(pose.position.y, true.y, delta=0.03)

    def test_the_profile_robust_says_where_in_the_lane_the_robot_is(self) -> None:
        if self.profile == 'paper':
            self.assertEqual(self.lane_poses, [])
            return
        self.assertGreater(len(self.lane_poses), 0.8 * len(self.lists))
        self.assertEqual([msg for msg in self.lane_poses if nanoseconds(msg) not in self.stamps], [])
        for msg in self.lane_poses:
            self.assertAlmostEqual(msg.d, 0.0, delta=0.03)
            self.assertAlmostEqual(msg.phi, 0.0, delta=0.1)
            self.assertAlmostEqual(msg.curvature, 0.0, delta=1.5)
            self.assertGreater(msg.d_phi_covariance[0], 0)
            self.assertGreater(msg.d_phi_covariance[3], 0)

    def test_the_blocking_duckie_is_in_the_lane_and_where_it_stood(self) -> None:
        seen = 0
        for msg in self.lists:
            seconds = seconds_of(msg)
            true = foot(DRIVE.blocking, DRIVE.at(seconds)[1])
            if not SETTLED < seconds < simulated_bag.DUCKIE_GONE - SETTLED or true.x > RANGE:
                continue
            near = [pose.position for pose in msg.poses if abs(pose.position.y) < 0.07]
            if len(near) != 1:  # a flicker, or dropped pictures made the tracker start anew
                continue
            seen += 1
            self.assertAlmostEqual(near[0].x, true.x, delta=0.05, msg='%.2f s into the drive' % seconds)
            self.assertAlmostEqual(near[0].y, true.y, delta=0.03, msg='%.2f s into the drive' % seconds)
            self.assertGreater(near[0].z, 0, '%.2f s into the drive' % seconds)
            self.assertAlmostEqual(near[0].z, true.radius, delta=0.02)
        self.assertGreaterEqual(seen, 10)

    def test_the_duckie_that_went_away_is_not_seen_any_more(self) -> None:
        for msg in self.lists:
            if simulated_bag.DUCKIE_GONE + FORGETTING[self.profile] < seconds_of(msg) < simulated_bag.DRIVES_ON:
                self.assertEqual([pose for pose in msg.poses if abs(pose.position.y) < 0.07], [])

    def test_the_cone_beyond_the_white_line_is_outside(self) -> None:
        outside = 0
        for msg in self.lists:
            if SETTLED < seconds_of(msg) < simulated_bag.DRIVES_ON:
                beyond = [pose.position for pose in msg.poses if pose.position.y < -0.2]
                outside += len(beyond)
                self.assertEqual([place for place in beyond if place.z >= 0], [])
        self.assertGreaterEqual(outside, 10)

    def test_each_box_lies_inside_the_bird_view(self) -> None:
        poses: List[Pose] = [pose for msg in self.lists for pose in msg.poses]
        self.assertGreaterEqual(len(poses), FEWEST)
        for pose in poses:
            top, bottom, left, right = pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w
            self.assertTrue(0 <= left < right <= 640, (left, right))
            self.assertTrue(0 <= top < bottom <= 640, (top, bottom))

    def test_each_box_stands_where_its_obstacle_stands(self) -> None:
        # The middle of its lower edge, seen from above, is the place: top, bottom, left and right are not mixed up.
        view = make_bird_view(default_calibration(), load(BirdViewSettings, BIRD_VIEW['bird_view'], 'bird_view'))
        for pose in (pose for msg in self.lists for pose in msg.poses):
            bottom, left, right = pose.orientation.y, pose.orientation.z, pose.orientation.w
            x, y = ground_from_bird(view, [((left + right - 1) / 2, bottom - 0.5)])[0]
            # robust: the box is of the last picture, the place of several
            delta = 0.02 if self.profile == 'paper' else 0.02 + 0.04 * pose.position.x
            self.assertAlmostEqual(pose.position.x, x, delta=delta)
            self.assertAlmostEqual(pose.position.y, y, delta=delta)


if __name__ == '__main__':
    rospy.init_node('detection')
    rostest.rosrun('obst_avoid', 'detection', Detection, sys.argv)
