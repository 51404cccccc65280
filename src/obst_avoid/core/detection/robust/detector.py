"""Our detector, step by step: this file is its table of contents."""

import functools
from dataclasses import dataclass, replace
from typing import List, Optional, Sequence, Tuple

from obst_avoid.core.age import age
from obst_avoid.core.bird_view import BirdView, footprint_box
from obst_avoid.core.detection.robust.channels import channels_of
from obst_avoid.core.detection.robust.features import measure, measure_all
from obst_avoid.core.detection.robust.judgement import Candidate, judge, promising
from obst_avoid.core.detection.robust.lane import Lane, Side, lane_of, side_of
from obst_avoid.core.detection.robust.light import Light, estimate_light, followed
from obst_avoid.core.detection.robust.lines import find_lines
from obst_avoid.core.detection.robust.regions import find_regions
from obst_avoid.core.detection.robust.settings import RobustSettings
from obst_avoid.core.detection.robust.tracking import Sighting, Track, confirmed, track
from obst_avoid.core.detection.robust.view import View, shown, working_picture
from obst_avoid.core.motion import motion_between
from obst_avoid.core.types import Array, Command, Obstacle, Scene, Stamped, Trace, no_trace

NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class RobustState:
    """What the detector remembers from picture to picture. The empty state is the start of a sequence."""

    light: Optional[Stamped[Light]] = None
    tracks: Sequence[Track] = ()


def detect(
    picture: Array,
    bird: BirdView,
    view: View,
    settings: RobustSettings,
    state: RobustState,
    stamp: Optional[int],
    commands: Sequence[Stamped[Command]] = (),
    trace: Trace = no_trace,
) -> Tuple[Scene, RobustState]:
    """Find duckies, cones and our lane in one picture.

    picture: (H, W, 3) uint8, BGR, of the size that bird and view were made for. stamp: [ns]; None for a picture that
    stands alone: there is no tracker, and what one picture makes sure of is reported. commands: the robot's motion.
    """
    light = _light(picture, state.light, stamp)
    trace('light', light)
    small = working_picture(picture, view)
    channels = channels_of(small, light, view)
    trace('channels', (small, channels))
    regions = find_regions(channels, view)
    trace('regions', regions)
    quick = measure_all(regions, channels, view)
    chosen = promising(quick)
    trace('promising', chosen)
    lines = find_lines(picture, view.sampling, light.as_array())
    trace('lines', lines)
    values = measure(regions, chosen, quick, channels, view, lines)
    trace('values', values)
    candidates = judge(regions.box[chosen], values, view, bird.calibration, settings)
    trace('candidates', candidates)
    lane = lane_of(lines)
    trace('lane', lane)
    obstacles = [_obstacle(item, lane, bird) for item in candidates]
    tracks: Sequence[Track] = ()
    if stamp is None:
        obstacles = [item for item in obstacles if item.confidence >= settings.confidence]
    else:
        tracks = _tracked(candidates, obstacles, state, stamp, commands, bird, view, settings)
        obstacles = [
            item if item.bird_box else replace(item, bird_box=footprint_box(bird, item.x, item.y, item.radius))
            for item in confirmed(tracks, settings.tracking)
        ]
    trace('obstacles', obstacles)
    scene = Scene(obstacles, None if lane is None else lane.pose)
    return scene, RobustState(None if stamp is None else Stamped(stamp, light), tracks)


def _light(picture: Array, before: Optional[Stamped[Light]], stamp: Optional[int]) -> Light:
    seen = estimate_light(picture)
    if before is None or stamp is None:
        return seen
    return followed(before.value, seen, age(before.stamp, stamp))


def _tracked(
    candidates: Sequence[Candidate],
    obstacles: Sequence[Obstacle],
    state: RobustState,
    stamp: int,
    commands: Sequence[Stamped[Command]],
    bird: BirdView,
    view: View,
    settings: RobustSettings,
) -> List[Track]:
    lag = round(settings.tracking.command_delay * NANOSECONDS)
    motion = None
    if state.light is not None:
        motion = motion_between(commands, state.light.stamp - lag, stamp - lag)
    sightings = [Sighting(one, item.top_distance, item.cut) for one, item in zip(obstacles, candidates)]
    visible = functools.partial(shown, view)
    return track(state.tracks, sightings, stamp, motion, visible, settings.tracking, view.camera)


def _obstacle(item: Candidate, lane: Optional[Lane], bird: BirdView) -> Obstacle:
    side = Side(None, None, None) if lane is None else side_of(lane, item.x, item.y, item.radius)
    return Obstacle(
        item.kind,
        item.x,
        item.y,
        item.radius,
        side.in_lane,
        item.confidence,
        footprint_box(bird, item.x, item.y, item.radius),
        item.box,
        side.to_left,
        side.to_right,
    )
