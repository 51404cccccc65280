"""core.detection.paper.tracking: how often a duckie must be seen, and what counts as the same one."""

from dataclasses import replace
from typing import List, Sequence

import pytest

from obst_avoid.core.detection.paper.settings import PaperSettings
from obst_avoid.core.detection.paper.shape import Blob
from obst_avoid.core.detection.paper.tracking import Track, confirmed, frames_needed, track
from obst_avoid.core.detection.settings import DetectionSettings
from obst_avoid.core.types import Kind
from unit.scenes import SCALE, blob


@pytest.fixture
def paper(detection_settings: DetectionSettings) -> PaperSettings:
    """The report's rule, in pixels of SCALE: 100 px^2, 2 or 3 pictures, 50 %, 60 px, 5 px."""
    return replace(
        detection_settings.paper,
        reference_scale=SCALE,
        sure_eigenvalue=100.0,
        sure_frames=2,
        unsure_frames=3,
        size_change=0.5,
        same_place=60.0,
        moved_up=5.0,
    )


def run(pictures: Sequence[Sequence[Blob]], paper: PaperSettings, scale: float = SCALE) -> List[Track]:
    """The tracks after some pictures."""
    tracks: List[Track] = []
    for blobs in pictures:
        tracks = track(tracks, blobs, scale, paper)
    return tracks


def reported(pictures: Sequence[Sequence[Blob]], paper: PaperSettings) -> List[int]:
    """How many duckies count after each picture."""
    return [len(confirmed(run(pictures[: i + 1], paper), paper)) for i in range(len(pictures))]


LARGE, SMALL = blob(300, 100, major=101.0), blob(300, 100, major=100.0)
HALF_AGAIN = blob(300, 100, area=LARGE.area * 1.5)
MORE = blob(300, 100, area=LARGE.area * 1.51)
LESS = blob(300, 100, area=LARGE.area * 0.49)


@pytest.mark.parametrize(
    'pictures, counts',
    [
        pytest.param([], [], id='no picture'),
        pytest.param([[], []], [0, 0], id='nothing seen'),
        pytest.param([[LARGE], [LARGE], [LARGE]], [0, 1, 1], id='large: two pictures'),
        pytest.param([[SMALL], [SMALL], [SMALL], [SMALL]], [0, 0, 1, 1], id='small: three pictures'),
        pytest.param([[SMALL], [SMALL], [LARGE]], [0, 0, 1], id='small, then large'),
        pytest.param([[SMALL], [LARGE]], [0, 1], id='large when seen the second time'),
        pytest.param([[LARGE], [HALF_AGAIN]], [0, 1], id='half larger is no change'),
        pytest.param([[LARGE], [MORE], [MORE]], [0, 0, 1], id='more than half larger: three pictures'),
        pytest.param([[LARGE], [LESS], [LESS]], [0, 0, 1], id='less than half as large: three pictures'),
        pytest.param([[LARGE], [LARGE], [MORE]], [0, 1, 1], id='changed, but seen three times'),
        pytest.param([[LARGE], [], [LARGE], [LARGE]], [0, 0, 0, 1], id='an empty picture ends the track'),
        pytest.param([[SMALL], [SMALL], [], [SMALL]], [0, 0, 0, 0], id='pictures must be consecutive'),
        pytest.param([[LARGE], [blob(500, 100)], [LARGE]], [0, 0, 0], id='elsewhere in between'),
    ],
)
def test_how_often_a_duckie_must_be_seen(
    paper: PaperSettings, pictures: Sequence[Sequence[Blob]], counts: List[int]
) -> None:
    assert reported(pictures, paper) == counts


@pytest.mark.parametrize(
    'right, down, same',
    [
        pytest.param(0, 0, True, id='at rest'),
        pytest.param(60, 0, True, id='60 px to the right'),
        pytest.param(-60, 0, True, id='60 px to the left'),
        pytest.param(61, 0, False, id='farther to the right'),
        pytest.param(0, 60, True, id='60 px nearer'),
        pytest.param(0, 61, False, id='farther than 60 px nearer'),
        pytest.param(36, 48, True, id='60 px slantwise'),
        pytest.param(37, 48, False, id='farther slantwise'),
        pytest.param(0, -5, True, id='5 px away from the robot'),
        pytest.param(0, -6, False, id='6 px away from the robot'),
        pytest.param(30, -5.5, False, id='sidewards and away'),
    ],
)
def test_what_is_the_same_duckie(paper: PaperSettings, right: float, down: float, same: bool) -> None:
    tracks = run([[blob(300, 100)], [blob(300 + right, 100 + down)]], paper)
    assert [item.seen for item in tracks] == [2 if same else 1]


def test_the_place_is_the_middle_of_the_lower_edge(paper: PaperSettings) -> None:
    wider = blob(300 - 100, 100, width=10 + 200, height=80)
    assert [item.seen for item in run([[blob(300, 100)], [wider]], paper)] == [2]


@pytest.mark.parametrize('scale', [70.0, 140.0, 280.0])
def test_distances_grow_with_the_scale_of_the_bird_view(paper: PaperSettings, scale: float) -> None:
    factor = scale / SCALE
    for right, down, same in ((59, 0, True), (62, 0, False), (0, -4.9, True), (0, -5.1, False)):
        tracks = run([[blob(300, 100)], [blob(300 + right * factor, 100 + down * factor)]], paper, scale)
        assert [item.seen for item in tracks] == [2 if same else 1], (right, down)


def test_two_blobs_cannot_share_a_track(paper: PaperSettings) -> None:
    tracks = run([[blob(300, 100)], [blob(310, 100), blob(295, 100)]], paper)
    assert [item.seen for item in tracks] == [1, 2], 'the nearer one takes it'


def test_two_tracks_cannot_share_a_blob(paper: PaperSettings) -> None:
    tracks = run([[blob(300, 100), blob(330, 100)], [blob(310, 100)]], paper)
    assert [item.seen for item in tracks] == [2]


def test_a_blob_continues_the_nearer_of_two_tracks(paper: PaperSettings) -> None:
    for near, far in ((5, 1), (1, 5)):
        tracks = [Track(blob(305, 100), near, False), Track(blob(330, 100), far, False)]
        for order in (tracks, tracks[::-1]):
            assert [item.seen for item in track(order, [blob(310, 100)], SCALE, paper)] == [near + 1]


def test_nearest_pairs_first_leaves_the_rest_to_each_other(paper: PaperSettings) -> None:
    tracks = run([[blob(300, 100), blob(340, 100)], [blob(338, 100), blob(318, 100)]], paper)
    assert [item.seen for item in tracks] == [2, 2]


def test_side_by_side_duckies_are_each_confirmed(paper: PaperSettings) -> None:
    pair = [blob(300, 100), blob(330, 100)]
    assert reported([pair, pair, pair], paper) == [0, 2, 2]


@pytest.mark.parametrize(
    'other', [blob(300, 100, kind=Kind.CONE), blob(300, 100, refused='too small')], ids=['cone', 'refused']
)
def test_only_accepted_duckies_are_tracked(paper: PaperSettings, other: Blob) -> None:
    assert run([[other], [other]], paper) == []
    assert [item.seen for item in run([[blob(300, 100)], [other], [blob(300, 100)]], paper)] == [1]


@pytest.mark.parametrize(
    'major, changed, needed', [(101.0, False, 2), (101.0, True, 3), (100.0, False, 3), (50.0, True, 3)]
)
def test_pictures_needed(paper: PaperSettings, major: float, changed: bool, needed: int) -> None:
    assert frames_needed(Track(blob(0, 0, major=major), 1, changed), paper) == needed


def test_the_tracks_given_are_left_alone(paper: PaperSettings) -> None:
    tracks = run([[blob(300, 100)]], paper)
    before = list(tracks)
    track(tracks, [blob(305, 100)], SCALE, paper)
    assert tracks == before
