"""Drives past things on a road without a picture: what a detector would say of each picture, errors included."""

import math
import random
from dataclasses import dataclass, field
from typing import Any, Callable, Iterator, List, Optional, Sequence, Tuple

from obst_avoid.core.detection.robust.tracking import CameraPlace, Sighting, Track, TrackingSettings, confirmed, track
from obst_avoid.core.motion import Motion, carried, motion_between, then
from obst_avoid.core.types import Command, Kind, Obstacle, Stamped
from unit.shipped import detection_settings

START = 1_700_000_000_123_456_789
CAMERA = CameraPlace(ahead=0.06, height=0.105)
BLIND, FARTHEST, ASIDE = 0.2, 1.7, 1.0
"""[m] nearest foot straight ahead, farthest; [rad] to each side."""
ROW_ERROR, NOD = 0.003, 0.006
"""[rad] of a row, one pixel, and of the nodding camera, a third of a degree; standard deviations."""

SETTINGS = detection_settings().robust.tracking


def visible(x: float, y: float) -> bool:
    """Whether a foot is in the picture."""
    return x > BLIND and math.hypot(x, y) < FARTHEST and abs(math.atan2(y, x)) < ASIDE


@dataclass(frozen=True)
class Thing:
    """Stands on the road where x, y [m] of the robot's first frame say: its centre."""

    x: float
    y: float
    radius: float = 0.03
    kind: Kind = Kind.DUCKIE
    in_lane: Optional[bool] = True
    height: float = 0.05
    gone: Callable[[float], bool] = lambda seconds: False


@dataclass(frozen=True)
class Drive:
    """What happens. commands: (from [s], command), obeyed `late` s after. told: the tracker hears them.

    recall: of a thing nearer than 1 m, falling to half of it at FARTHEST. surest, unsure: a thing's confidence in a
    picture lies between them. false: begun blobs a picture, each lasting 1 to 3 pictures.
    """

    things: Sequence[Thing] = ()
    commands: Sequence[Tuple[float, Command]] = ((0.0, Command(0.2, 0.0)),)
    seconds: float = 6.0
    rate: float = 30.0
    told: bool = True
    late: float = 0.0
    recall: float = 0.92
    unsure: float = 0.5
    surest: float = 0.98
    false: float = 0.0
    seed: int = 0


@dataclass
class Moment:
    """What was true and what the tracker said at one picture. real: the things as they stand now, by number."""

    seconds: float
    real: List[Tuple[int, float, float]]
    tracks: List[Track]
    obstacles: List[Obstacle] = field(default_factory=list)


def drive(what: Drive, settings: TrackingSettings = SETTINGS) -> Iterator[Moment]:
    """Run the tracker through it, picture by picture."""
    generator = random.Random(what.seed)
    told = [Stamped(START + int(at * 1e9), command) for at, command in what.commands]
    pose, before, tracks = Motion(), START, []  # type: Motion, int, List[Track]
    blobs: List[Tuple[int, Any]] = []
    for number in range(int(what.seconds * what.rate)):
        seconds = number / what.rate
        stamp = START + int(seconds * 1e9)
        heard = motion_between(told, before, stamp, 1e9)
        late = int(what.late * 1e9)
        step = motion_between(told, before - late, stamp - late, 1e9)
        assert heard is not None and step is not None
        pose, before = then(pose, step), stamp
        nod = generator.gauss(0, NOD)
        real, sightings = [], []
        for index, thing in enumerate(what.things):
            x, y = carried(pose, thing.x, thing.y)
            if thing.gone(seconds):
                continue
            far = math.hypot(x, y)
            near = 1 - thing.radius / far
            real.append((index, near * x, near * y))
            share = what.recall * (1 if far < 1 else 1 - 0.5 * (far - 1) / (FARTHEST - 1))
            if visible(near * x, near * y) and generator.random() < share:
                sightings.append(_sighting(thing, near * x, near * y, nod, what, generator))
        if generator.random() < what.false:
            blobs.append((generator.randint(1, 3), _blob(generator)))
        sightings += [blob for _, blob in blobs]
        blobs = [(left - 1, blob) for left, blob in blobs if left > 1]
        generator.shuffle(sightings)
        tracks = track(tracks, sightings, stamp, heard if what.told else None, visible, settings, CAMERA)
        yield Moment(seconds, real, tracks, confirmed(tracks, settings))


def along_the_road(distance: float, angle: float) -> float:
    """[m] where a line of sight, tilted up by angle [rad], meets the road; inf at or above the horizon."""
    down = math.atan2(CAMERA.height, distance - CAMERA.ahead) - angle
    return CAMERA.height / math.tan(down) + CAMERA.ahead if down > 0.01 else math.inf


def top_of(distance: float, height: float) -> float:
    """[m] where the line of sight over something's top meets the road."""
    rest = CAMERA.height - height
    return CAMERA.ahead + (distance - CAMERA.ahead) * CAMERA.height / rest if rest > 0 else math.inf


def _sighting(thing: Thing, x: float, y: float, nod: float, what: Drive, generator: random.Random) -> Sighting:
    distance, bearing = math.hypot(x, y), math.atan2(y, x) + generator.gauss(0, 0.005)
    foot = along_the_road(distance, nod + generator.gauss(0, ROW_ERROR))
    top = top_of(distance + thing.radius, thing.height)
    top = top if math.isinf(top) else along_the_road(top, nod + generator.gauss(0, ROW_ERROR))
    confidence = generator.uniform(what.unsure, what.surest)
    radius = thing.radius * generator.gauss(1, 0.1)
    obstacle = Obstacle(
        thing.kind, foot * math.cos(bearing), foot * math.sin(bearing), radius, thing.in_lane, confidence
    )
    return Sighting(obstacle, max(top, foot))


def _blob(generator: random.Random) -> Sighting:
    distance, bearing = generator.uniform(0.3, 1.5), generator.uniform(-0.6, 0.6)
    place = distance * math.cos(bearing), distance * math.sin(bearing)
    return Sighting(Obstacle(Kind.DUCKIE, *place, 0.03, True, generator.uniform(0.1, 0.65)))
