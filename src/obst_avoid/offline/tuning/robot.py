"""A running robot: its settings, its camera, and what it decides. Settings are changed where rqt_reconfigure would."""

import queue
import threading
import time
from typing import Any, Dict, Optional, Tuple

import rosgraph
import rospy
from dynamic_reconfigure import DynamicReconfigureCallbackException, DynamicReconfigureParameterException
from dynamic_reconfigure.client import Client
from sensor_msgs.msg import CompressedImage, Image

from obst_avoid.core.picture import PictureError
from obst_avoid.core.settings_text import changed, flat
from obst_avoid.core.types import Array
from obst_avoid.msg import LaneControl
from obst_avoid.offline import tool
from obst_avoid.offline.tuning.settings import AVOIDER, DETECTOR, NODES, OTHERS, Tunable, Values, from_parameters
from obst_avoid.ros import border

WAIT = 5.0
"""[s] of wall time for a node to answer."""
OLD = 2.0
"""[s] of wall time since a picture or a decision came, after which it is said how old it is."""
ERRORS = (
    DynamicReconfigureCallbackException,
    DynamicReconfigureParameterException,
    rospy.ROSException,
    rospy.ServiceException,
    OSError,
)
"""Of a call of dynamic_reconfigure's client."""


class Robot:
    """Its nodes of ours that run; the newest picture and decision. Raises ToolError where there is none."""

    def __init__(self, veh: str) -> None:
        self.veh = veh
        if not rosgraph.is_master_online():
            raise tool.ToolError('no ROS master at %s, expected that of %s' % (rosgraph.get_master_uri(), veh))
        rospy.init_node('tune', anonymous=True, disable_signals=True)
        self._clients: Dict[str, Client] = {}
        for node in NODES:
            if rospy.has_param('/%s/%s' % (veh, node)):
                self._clients[node] = self._client(node)
        if DETECTOR not in self._clients or AVOIDER not in self._clients:
            raise tool.ToolError('no %s and %s of %s run, expected obst_avoid.launch' % (DETECTOR, AVOIDER, veh))
        self._lock = threading.Lock()
        self._picture: Tuple[Optional[Any], float] = None, 0.0
        self._decision: Tuple[Optional[LaneControl], float] = None, 0.0
        raw = rospy.get_param('/%s/%s/input' % (veh, DETECTOR), 'compressed') == 'raw'
        topic, cls = ('image', Image) if raw else ('image/compressed', CompressedImage)
        rospy.Subscriber('/%s/camera_node/%s' % (veh, topic), cls, self._on_picture, queue_size=1, buff_size=2**24)
        rospy.Subscriber('/%s/%s/lane_control' % (veh, AVOIDER), LaneControl, self._on_decision, queue_size=1)

    def _client(self, node: str) -> Client:
        name = '/%s/%s' % (self.veh, node)
        try:
            return Client(name, timeout=WAIT)
        except rospy.ROSException as error:
            raise tool.ToolError('%s does not answer, expected it to run' % name) from error

    def _on_picture(self, msg: Any) -> None:
        with self._lock:
            self._picture = msg, time.monotonic()

    def _on_decision(self, msg: LaneControl) -> None:
        with self._lock:
            self._decision = msg, time.monotonic()

    def picture(self) -> Array:
        """The newest, (H, W, 3) uint8, BGR. Raises PictureError."""
        with self._lock:
            msg, came = self._picture
        if msg is None:
            raise PictureError('no picture of %s yet, expected its camera to run' % self.veh)
        if time.monotonic() - came > OLD:
            seconds = time.monotonic() - came
            raise PictureError('no picture of %s for %.0f s, expected its camera to run' % (self.veh, seconds))
        if isinstance(msg, CompressedImage):
            return border.picture_from_compressed_image(msg)
        return border.picture_from_image(msg)

    def decision(self) -> str:
        """The robot's last one, for a person."""
        with self._lock:
            msg, came = self._decision
        if msg is None:
            return 'nothing decided yet'
        if time.monotonic() - came > OLD:
            return 'nothing decided for %.0f s' % (time.monotonic() - came)
        decision = border.decision_from_lane_control(msg)
        return '%s: %s' % (decision.state.name, decision.reason)

    def values(self) -> Values:
        """The settings that the nodes run with. Raises ToolError."""
        found = {}
        for node, client in self._clients.items():
            nested, config = from_parameters(self._parameters(node), node), client.get_configuration(WAIT)
            if config is None:
                raise tool.ToolError('/%s/%s does not say how it is tuned, expected it to run' % (self.veh, node))
            for name, path in flat(nested).items():
                if name in config:  # a change that could not be kept as a parameter holds all the same
                    nested = changed(nested, path, config[name])
            found[node] = nested
        return found

    def others(self) -> Values:
        """Those of the nodes that cannot be tuned, as far as they run. Raises ToolError."""
        names = [name for name in OTHERS if rospy.has_param('/%s/%s' % (self.veh, name))]
        return {name: self._parameters(name) for name in names}

    def _parameters(self, node: str) -> Dict[str, Any]:
        try:
            return dict(rospy.get_param('/%s/%s' % (self.veh, node)))
        except (KeyError, OSError, rosgraph.MasterException) as error:
            raise tool.ToolError('%s of %s has no parameters any more' % (node, self.veh)) from error

    def change(self, item: Tunable, value: Any) -> None:
        """Set one there. Raises ToolError when the node is gone, hangs, or did not take it."""
        what = '/%s/%s' % (self.veh, item.node), item.name, value
        answer: queue.Queue[Any] = queue.Queue()

        def call() -> None:
            try:
                answer.put(self._clients[item.node].update_configuration({item.name: value}))
            except ERRORS as error:
                answer.put(error)

        threading.Thread(target=call, daemon=True).start()  # the call itself would wait for ever
        try:
            after = answer.get(timeout=WAIT)
        except queue.Empty as error:
            raise tool.ToolError('%s does not answer; whether it took %s = %s is not known' % what) from error
        if isinstance(after, Exception):
            raise tool.ToolError('%s did not take %s = %s: %s' % (*what, after)) from after
        if after is None or after[item.name] != value:
            raise tool.ToolError('%s did not take %s = %s; its log says why' % what)
