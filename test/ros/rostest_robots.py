#!/usr/bin/env python3
"""Two robots on one master, each in its namespace: one sees a duckie in its lane and stands, the other drives."""

import sys

import rosgraph
import rospy
import rostest
from geometry_msgs.msg import PoseArray
from helpers import ANSWER, Inbox, Prepared, Repeating, compressed_image, jpeg_of, publisher, wait_for
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header
from unit.drawn import Scene, Thing

from obst_avoid.core.types import Kind
from obst_avoid.msg import LaneControl, LanePose, Twist2DStamped

ROBOTS = {'duck1': jpeg_of(Scene((Thing(Kind.DUCKIE, 0.35, 0.0),))), 'duck2': jpeg_of(Scene(()))}


class Robots(Prepared):
    @classmethod
    def prepare(cls) -> None:
        cls.commands = {veh: Inbox('/%s/lane_controller_node/car_cmd' % veh, Twist2DStamped) for veh in ROBOTS}
        cls.controls = {veh: Inbox('/%s/obstacle_avoidance_node/lane_control' % veh, LaneControl) for veh in ROBOTS}
        cls.lists = {veh: Inbox('/%s/obstacle_detection_node/posearray' % veh, PoseArray) for veh in ROBOTS}
        pictures = {veh: publisher('/%s/camera_node/image/compressed' % veh, CompressedImage) for veh in ROBOTS}
        poses = {veh: publisher('/%s/lane_filter_node/lane_pose' % veh, LanePose) for veh in ROBOTS}

        def live() -> None:
            for veh, jpeg in ROBOTS.items():
                pictures[veh].publish(compressed_image(jpeg, rospy.Time.now()))
                poses[veh].publish(LanePose(header=Header(stamp=rospy.Time.now())))

        with Repeating(live):
            wait_for(
                lambda: {veh: [msg.state for msg in inbox.all()[-20:]] for veh, inbox in cls.controls.items()}
                == {'duck1': [LaneControl.STOPPED] * 20, 'duck2': [LaneControl.CLEAR] * 20},
                3 * ANSWER,
                'one stands and one drives',
            )

    def test_each_has_its_own_wheels(self) -> None:
        self.assertEqual({msg.v for msg in self.commands['duck1'].all()[-10:]}, {0.0})
        self.assertTrue(all(msg.v > 0.1 for msg in self.commands['duck2'].all()[-10:]))

    def test_each_has_its_own_frame(self) -> None:
        for veh, inbox in self.lists.items():
            self.assertEqual({msg.header.frame_id for msg in inbox.all()}, {veh + '/footprint'})

    def test_nothing_of_one_reaches_the_other(self) -> None:
        publishers, subscribers, _ = rosgraph.Master('/test').getSystemState()
        for topic, nodes in [*publishers, *subscribers]:
            for veh, other in (('duck1', 'duck2'), ('duck2', 'duck1')):
                if topic.startswith('/%s/' % veh):
                    self.assertEqual([node for node in nodes if node.startswith('/%s/' % other)], [], topic)


if __name__ == '__main__':
    rospy.init_node('robots')
    rostest.rosrun('obst_avoid', 'robots', Robots, sys.argv)
