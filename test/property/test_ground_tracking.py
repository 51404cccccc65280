"""core.detection.robust.tracking: order and side do not matter, and nothing is seen twice."""

import math
from typing import Any, List, Sequence, Tuple

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from unit.ground_drives import CAMERA, SETTINGS, START, visible

from obst_avoid.core.detection.robust.tracking import Sighting, Track, confirmed, track
from obst_avoid.core.motion import Motion, carried
from obst_avoid.core.types import Kind, Obstacle
from property.strategies import numbers

MS = 1_000_000
sightings = st.builds(
    Sighting,
    obstacle=st.builds(
        Obstacle,
        kind=st.sampled_from(list(Kind)),
        x=numbers(0.15, 1.6),
        y=numbers(-0.5, 0.5),
        radius=numbers(0.01, 0.08),
        in_lane=st.sampled_from([True, False, None]),
        confidence=numbers(0.05, 1.0),
    ),
    top_distance=st.none() | numbers(1.6, 3.0),
    cut=st.booleans(),
)
pictures = st.lists(
    st.tuples(
        st.lists(sightings, max_size=5),
        st.none() | st.builds(Motion, numbers(-0.02, 0.05), numbers(-0.01, 0.01), numbers(-0.2, 0.2)),
        st.integers(1, 300),
    ),
    max_size=6,
)


def followed(seen: Sequence[Any]) -> List[Track]:
    tracks: List[Track] = []
    stamp = START
    for shown, motion, period in seen:
        stamp += period * MS
        tracks = track(tracks, shown, stamp, motion, visible, SETTINGS, CAMERA)
    return tracks


def values(item: Track) -> Tuple[float, ...]:
    return item.x, item.y, item.radius, item.along, item.across, item.evidence, item.height_evidence


def middle(item: Track) -> Tuple[float, float]:
    """[m] of its footprint."""
    outwards = 1 + item.radius / math.hypot(item.x, item.y)
    return outwards * item.x, outwards * item.y


def untied(seen: Sequence[Any]) -> bool:
    """Of two things that are as sure and as far away, either may come first."""
    everything = [one.obstacle for shown, _, _ in seen for one in shown]
    ranks = [(one.confidence, one.x * one.x + one.y * one.y) for one in everything]
    return len({confidence for confidence, _ in ranks}) == len(ranks) == len({far for _, far in ranks})


@given(seen=pictures, data=st.data())
def test_the_order_of_detections_is_irrelevant(seen: Any, data: Any) -> None:
    assume(untied(seen))
    shuffled = [(data.draw(st.permutations(shown)), motion, period) for shown, motion, period in seen]
    assert followed(shuffled) == followed(seen)


@given(seen=pictures)
def test_a_mirrored_road_gives_mirrored_tracks(seen: Any) -> None:
    assume(untied(seen))

    def flipped(one: Sighting) -> Sighting:
        obstacle = one.obstacle
        return Sighting(
            Obstacle(obstacle.kind, obstacle.x, -obstacle.y, obstacle.radius, obstacle.in_lane, obstacle.confidence),
            one.top_distance,
            one.cut,
        )

    mirrored = [
        ([flipped(one) for one in shown], motion and Motion(motion.x, -motion.y, -motion.turn), period)
        for shown, motion, period in seen
    ]
    for here, there in zip(followed(seen), followed(mirrored)):
        assert values(there._replace(y=-there.y)) == pytest.approx(values(here), abs=1e-9)
        assert (there.confirmed, there.hidden, there.votes) == (here.confirmed, here.hidden, here.votes)
    assert len(followed(mirrored)) == len(followed(seen))


@given(seen=pictures)
def test_each_detection_belongs_to_one_track_at_most(seen: Any) -> None:
    assume(untied(seen))
    tracks = followed(seen)
    lasts = [id(item.last) for item in tracks if item.seen == item.stamp]
    assert len(set(lasts)) == len(lasts)
    assert len(tracks) <= sum(len(shown) for shown, _, _ in seen)


@given(seen=pictures)
def test_what_counts_was_seen_more_than_once_and_is_ordered(seen: Any) -> None:
    tracks = followed(seen)
    found = confirmed(tracks, SETTINGS)
    assert len(found) == sum(item.confirmed for item in tracks)
    assert all(item.seen > item.born for item in tracks if item.confirmed)
    assert all(0 < one.confidence < 1 and one.radius > 0 for one in found)
    distances = [one.x * one.x + one.y * one.y for one in found]
    assert distances == sorted(distances)


@given(seen=pictures, motion=st.builds(Motion, numbers(0, 0.05), numbers(-0.01, 0.01), numbers(-0.2, 0.2)))
def test_what_is_out_of_sight_stands_still_on_the_road(seen: Any, motion: Motion) -> None:
    tracks = [item for item in followed(seen) if item.x > 0.2]
    if tracks:
        carried_on = track(tracks, [], tracks[0].stamp + 1, motion, lambda x, y: False, SETTINGS)
        wanted = sorted(carried(motion, *middle(item)) for item in tracks)
        assert sorted(map(middle, carried_on)) == [pytest.approx(place, abs=1e-9) for place in wanted]
        assert {item.evidence for item in carried_on} == {item.evidence for item in tracks}
