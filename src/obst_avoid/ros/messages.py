"""Which package's classes to use for messages that Duckietown's stack defines too."""

import importlib
from dataclasses import dataclass
from typing import Any, List

OWN, DUCKIETOWN = 'obst_avoid', 'duckietown_msgs'


class MessagesError(ValueError):
    """The package with the message classes cannot be used."""


@dataclass(frozen=True)
class Messages:
    """Message classes; ROS refuses a type of another package's name, so a robot's own must be used there."""

    LanePose: Any
    BoolStamped: Any
    Twist2DStamped: Any


def find_messages(package: str) -> Messages:
    """The classes of one package; '' takes duckietown_msgs where it is installed, else our own."""
    if not package:
        try:
            return find_messages(DUCKIETOWN)
        except MessagesError:
            return find_messages(OWN)
    return Messages(*find_classes(package, 'LanePose', 'BoolStamped', 'Twist2DStamped'))


def find_classes(package: str, *names: str) -> List[Any]:
    """Message classes of one package by their names. Raises MessagesError."""
    try:
        module = importlib.import_module(package + '.msg')
        return [getattr(module, name) for name in names]
    except (ImportError, AttributeError) as error:
        raise MessagesError('msgs_package = %s, expected a package with messages: %s' % (package, error)) from error
