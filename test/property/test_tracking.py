"""core.detection.paper.tracking: one duckie, one track."""

import math
from dataclasses import replace
from typing import Any, List, Sequence

from hypothesis import assume, given
from hypothesis import strategies as st
from unit.scenes import SCALE, blob

from obst_avoid.core.detection.paper.shape import Blob
from obst_avoid.core.detection.paper.tracking import Track, confirmed, frames_needed, track
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.types import Kind
from property.strategies import numbers

blobs = st.lists(
    st.builds(
        blob,
        left=numbers(0, 200),
        bottom=numbers(60, 260),
        area=numbers(20, 500),
        major=numbers(21, 300),
        kind=st.sampled_from([Kind.DUCKIE, Kind.DUCKIE, Kind.CONE]),
        refused=st.sampled_from(['', '', 'too small']),
    ),
    max_size=6,
)


def distances(before: Sequence[Track], after: Sequence[Blob]) -> List[float]:
    """Between every track and every blob. [px]"""
    return [
        math.hypot(old.blob.box.left - new.box.left, old.blob.box.bottom - new.box.bottom)
        for old in before
        for new in after
    ]


def numbered(found: Sequence[Blob]) -> List[Track]:
    """Tracks that can be told apart by how often they were seen: 10, 20, 30, ..."""
    ducks = [one for one in found if one.kind is Kind.DUCKIE and not one.refused]
    return [Track(one, 10 * (i + 1), False) for i, one in enumerate(ducks)]


@given(before=blobs, after=blobs)
def test_tracks_and_blobs_are_matched_one_to_one(
    detection_settings: DetectionSettings, before: Any, after: Any
) -> None:
    tracks = track(numbered(before), after, SCALE, detection_settings.paper)
    assert [item.blob for item in tracks] == [one for one in after if one.kind is Kind.DUCKIE and not one.refused]
    continued = [item.seen - 1 for item in tracks if item.seen > 1]
    assert len(set(continued)) == len(continued), 'no track is shared'
    assert set(continued) <= {item.seen for item in numbered(before)}


@given(before=blobs, after=blobs)
def test_what_continues_a_track_is_near_it_and_not_above_it(
    detection_settings: DetectionSettings, before: Any, after: Any
) -> None:
    paper = replace(detection_settings.paper, reference_scale=SCALE)
    old = {item.seen: item.blob for item in numbered(before)}
    for item in track(numbered(before), after, SCALE, paper):
        if item.seen > 1:
            was = old[item.seen - 1]
            down = item.blob.box.bottom - was.box.bottom
            assert math.hypot(item.blob.box.left - was.box.left, down) <= paper.same_place + 1e-9
            assert down >= -paper.moved_up
            assert item.changed is (abs(item.blob.area / was.area - 1) > paper.size_change)


@given(before=blobs, after=blobs, data=st.data())
def test_the_order_of_blobs_is_irrelevant(
    detection_settings: DetectionSettings, before: Any, after: Any, data: Any
) -> None:
    tracks = numbered(before)
    apart = distances(tracks, after)
    assume(len(set(apart)) == len(apart))  # of two at the very same distance either may continue the track
    first = track(tracks, after, SCALE, detection_settings.paper)
    shuffled_tracks, shuffled_blobs = data.draw(st.permutations(tracks)), data.draw(st.permutations(after))
    second = track(shuffled_tracks, shuffled_blobs, SCALE, detection_settings.paper)
    assert {id(item.blob): (item.seen, item.changed) for item in first} == {
        id(item.blob): (item.seen, item.changed) for item in second
    }


@given(pictures=st.lists(blobs, min_size=1, max_size=5))
def test_nothing_counts_that_was_not_seen_in_as_many_pictures(
    detection_settings: DetectionSettings, pictures: Sequence[Any]
) -> None:
    paper = detection_settings.paper
    tracks: List[Track] = []
    for number, found in enumerate(pictures, 1):
        tracks = track(tracks, found, SCALE, paper)
        assert all(1 <= item.seen <= number for item in tracks)
        counted = confirmed(tracks, paper)
        assert [item.blob for item in tracks if item.seen >= frames_needed(item, paper)] == counted
        assert number >= min(paper.sure_frames, paper.unsure_frames) or counted == []
