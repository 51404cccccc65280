"""Which detection belongs to which label: each rule on a case made by hand, and the same figures as the scorer's."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import importlib.util
import json
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

import pytest
from labelled import jittered, written

from obst_avoid.offline import evaluate
from obst_avoid.offline.evaluation.matching import Found, Label, Polygon, covered, in_polygon, iou, judge, on_road

SIZE = (640, 480)
STANDS = (300.0, 200.0, 40.0, 50.0)
"""A box that counts: bottom row 250."""


def label(box: Sequence[float] = STANDS, category: str = 'duckie', **fields: Any) -> Label:
    return Label(category, tuple(box), **fields)  # type: ignore[arg-type]


def seen(box: Sequence[float] = STANDS, kind: str = 'duckie', confidence: float = 0.5, **fields: Any) -> Found:
    return Found(kind, tuple(box), confidence, **fields)  # type: ignore[arg-type]


def states(labels: Sequence[Label], found: Sequence[Found], **options: Any) -> List[str]:
    return [item.state for item in judge(labels, found, SIZE, **options).found]


def partners(labels: Sequence[Label], found: Sequence[Found]) -> List[Optional[int]]:
    return [item.partner for item in judge(labels, found, SIZE).labels]


@pytest.mark.parametrize(
    ('case', 'box', 'state'),
    [
        ('the same box', STANDS, 'hit'),
        ('overlap of a little more than 0.3', (300, 200, 40, 15.1), 'hit'),
        ('overlap of a little less, the foot in the upper 35 %', (300, 200, 40, 14.9), 'loose'),
        ('a small foot on the bottom', (310, 235, 20, 26), 'hit'),
        ('grown by 25 % below', (310, 240, 20, 22.4), 'fa'),
        ('grown by 25 % below, just', (300, 242, 40, 20.4), 'hit'),
        ('grown by 25 % at the side', (271, 220, 38, 30), 'hit'),
        ('farther at the side', (269, 220, 40, 30), 'fa'),
        ('a quarter of the area is too small', (310, 225, 20, 24.9), 'loose'),
        ('a little more than a quarter', (310, 225, 20, 25.1), 'hit'),
        ('four times the area is too large', (220, 190, 200, 60), 'fa'),
        ('nearly four times', (270.5, 172, 99, 80), 'hit'),
        ('half covered by the label', (320, 180, 40, 36), 'fa'),
        ('a fragment at the top', (305, 200, 30, 16), 'loose'),
        ('one over everything', (100, 0, 440, 470), 'fa'),
        ('far up', (300, 100, 20, 30), 'far'),
        ('beside', (100, 300, 30, 30), 'fa'),
        ('just near enough to be judged', (100, 150, 30, 30), 'fa'),
        ('just too far', (100, 149, 30, 30), 'far'),
    ],
)
def test_one_label_and_one_detection(case: str, box: Sequence[float], state: str) -> None:
    assert states([label()], [seen(box)]) == [state], case


def test_nothing_and_nothing() -> None:
    judged = judge([], [], SIZE)
    assert (judged.labels, judged.found) == ((), ())
    assert judged.judges_false_alarms


@pytest.mark.parametrize(
    ('case', 'item', 'why'),
    [
        ('good', label(), ''),
        ('15 px high', label((300, 235, 12, 15)), 'small'),
        ('16 px high', label((300, 235, 12, 16)), ''),
        ('ends at row 179', label((300, 150, 25, 29)), 'far'),
        ('ends at row 180', label((300, 150, 25, 30)), ''),
        ('crowd', label(iscrowd=True), 'iscrowd'),
        ('riding by its own word', label(riding=True), 'riding'),
        ('narrow at the left edge', label((1, 200, 22, 50)), 'cut'),
        ('wide enough at the left edge', label((1, 200, 22.6, 50)), ''),
        ('narrow away from the edge', label((3, 200, 20, 50)), ''),
        ('a cone may be narrower', label((1, 200, 15, 50), 'cone'), ''),
        ('a cone, too narrow', label((620, 200, 18, 70), 'cone'), 'cut'),
        ('low at the bottom edge', label((300, 455, 52, 24)), 'cut'),
        ('high enough at the bottom edge', label((300, 455, 46, 24)), ''),
        ('a cone low at the bottom edge', label((300, 455, 62, 24), 'cone'), 'cut'),
    ],
)
def test_why_a_label_is_ignored(case: str, item: Label, why: str) -> None:
    assert judge([item], [], SIZE).labels[0].ignored == why, case


@pytest.mark.parametrize(
    ('case', 'category', 'box', 'why'),
    [
        ('its foot on the robot', 'duckie', (310, 190, 30, 40), 'riding'),
        ('looks out above the robot', 'duckie', (310, 155, 30, 40), 'riding'),
        ('its foot at the bottom of the robot', 'duckie', (310, 230, 30, 40), ''),
        ('beside the robot', 'duckie', (410, 190, 30, 40), ''),
        ('a cone never rides', 'cone', (310, 190, 30, 40), ''),
    ],
)
def test_riding_on_a_robot(case: str, category: str, box: Sequence[float], why: str) -> None:
    robot = label((280, 190, 100, 80), 'duckiebot')
    assert judge([robot, label(box, category)], [], SIZE).labels[0].ignored == why, case


@pytest.mark.parametrize('why', ['iscrowd', 'riding', 'small', 'far'])
def test_a_detection_on_an_ignored_label_is_ignored(why: str) -> None:
    ignored = {
        'iscrowd': label(iscrowd=True),
        'riding': label(riding=True),
        'small': label((300, 235, 12, 15)),
        'far': label((300, 150, 25, 29)),
    }[why]
    assert states([ignored], [seen(ignored.box)]) == ['ignored']


def test_half_in_an_ignored_label_is_ignored() -> None:
    crowd = label((100, 190, 400, 200), iscrowd=True)
    assert states([crowd], [seen((480, 300, 38, 20))]) == ['ignored']
    assert states([crowd], [seen((482, 300, 38, 20))]) == ['fa']


def test_one_to_one() -> None:
    beside = (302.0, 201.0, 40.0, 50.0)
    assert states([label()], [seen(confidence=0.2), seen(beside, confidence=0.8)]) == ['duplicate', 'hit']
    assert partners([label(), label(beside)], [seen()]) == [0, None]


def test_the_surest_choose_first_and_overlap_comes_before_the_foot() -> None:
    by_foot = seen((310, 225, 20, 26), confidence=0.9)
    by_overlap = seen(confidence=0.1)
    assert states([label()], [by_foot, by_overlap]) == ['duplicate', 'hit']


def test_the_kind_breaks_ties_only() -> None:
    pair = [label(), label(category='cone')]
    assert partners(pair, [seen(kind='cone')]) == [None, 0]
    assert partners([label(), label((312, 200, 40, 50), 'cone')], [seen(kind='cone')]) == [0, None], 'a better overlap'
    assert partners([label()], [seen(kind='cone')]) == [0], 'found, under a wrong name'


def test_the_nearer_foot_breaks_what_is_left() -> None:
    small = seen((310, 225, 20, 25.5))
    near, far = label((300, 200.5, 40, 50)), label((299, 210, 40, 50))
    judged = judge([far, near], [replace_box(small, (330, 225, 24, 26))], SIZE)
    assert sum(item.partner is not None for item in judged.labels) == 1


def replace_box(item: Found, box: Tuple[float, float, float, float]) -> Found:
    return Found(item.kind, box, item.confidence)


def test_an_ignored_label_takes_no_partner_from_a_relevant_one() -> None:
    crowd = label((295, 195, 50, 60), iscrowd=True)
    assert states([crowd, label()], [seen()]) == ['hit']


def test_on_an_object() -> None:
    robot = label((280, 190, 100, 80), 'duckiebot')
    judged = judge([robot], [seen((300, 200, 20, 20)), seen((100, 200, 20, 20))], SIZE)
    assert [(item.state, item.on_object) for item in judged.found] == [('fa', True), ('fa', False)]


EGO = Polygon('Ego Lane', ((300, 180), (400, 180), (600, 480), (300, 480)))
OPPOSITE = Polygon('Opposite Lane', ((180, 180), (280, 180), (240, 480), (0, 480)))
OTHER_ROBOT = Polygon('Obstacle', ((180, 200), (280, 200), (280, 260), (180, 260)))


@pytest.mark.parametrize(
    ('case', 'box', 'complete', 'counts', 'on_obstacle'),
    [
        ('on our lane', (400, 300, 30, 30), False, True, False),
        ('on the opposite lane', (100, 400, 30, 30), False, True, False),
        ('in the gap of the middle line', (270, 380, 10, 20), False, True, False),
        ('beyond the road', (600, 230, 30, 30), False, False, False),
        ('on another robot', (220, 220, 20, 30), False, False, True),
        ('anywhere, where all is labelled', (600, 230, 30, 30), True, True, False),
        ('at the lowest row', (400, 440, 30, 40), False, True, False),
    ],
)
def test_where_a_false_alarm_counts(
    case: str, box: Sequence[float], complete: bool, counts: bool, on_obstacle: bool
) -> None:
    judged = judge([], [seen(box)], SIZE, [EGO, OPPOSITE, OTHER_ROBOT], complete)
    assert (judged.found[0].counts, judged.found[0].on_obstacle) == (counts, on_obstacle), case


def test_without_lanes_and_complete_labels_no_false_alarm_counts() -> None:
    judged = judge([], [seen((400, 300, 30, 30))], SIZE, None, complete=False)
    assert (judged.found[0].state, judged.found[0].counts, judged.judges_false_alarms) == ('fa', False, False)


def test_a_side_line_is_no_gap() -> None:
    side = Polygon('Side Lane', ((285, 300), (295, 300), (295, 480), (250, 480)))
    assert on_road(290, 400, [EGO, OPPOSITE])
    assert not on_road(290, 400, [EGO, OPPOSITE, side])


@pytest.mark.parametrize(
    ('case', 'truth', 'box', 'said', 'where', 'inside', 'wrong'),
    [
        ('the label says inside', True, STANDS, False, None, True, True),
        ('the label says outside', False, STANDS, False, None, False, False),
        ('the detector does not know', True, STANDS, None, None, True, False),
        ('nobody knows', None, STANDS, False, None, None, False),
        ('lanes: ours', None, (340, 250, 40, 50), False, 'ego', True, True),
        ('lanes: the opposite one', None, (100, 350, 40, 50), True, 'otherlane', False, True),
        ('lanes: on the middle line', None, (266, 350, 12, 30), True, 'otherlane', None, False),
        ('lanes: beyond the road', None, (600, 200, 30, 40), True, 'offroad', False, True),
        ('the label knows better than lanes', False, (340, 250, 40, 50), True, 'ego', False, True),
    ],
)
def test_the_side_of_the_line(
    case: str,
    truth: Optional[bool],
    box: Sequence[float],
    said: Optional[bool],
    where: Optional[str],
    inside: Optional[bool],
    wrong: bool,
) -> None:
    lanes = [EGO, OPPOSITE] if where else None
    judged = judge([label(box, in_lane=truth)], [seen(box, in_lane=said)], SIZE, lanes)
    assert judged.found[0].state == 'hit'
    assert (judged.labels[0].where, judged.labels[0].inside, judged.found[0].side_wrong) == (where, inside, wrong), case


def test_far_ones_are_a_side_figure_and_may_share_a_detection() -> None:
    far = [label((300, 120, 25, 30)), label((302, 120, 25, 30)), label((100, 120, 25, 30)), label((300, 60, 25, 30))]
    judged = judge(far, [seen((300, 120, 25, 30))], SIZE)
    assert [item.far_found for item in judged.labels] == [True, True, False, None]
    assert judged.found[0].state == 'ignored'


def test_geometry() -> None:
    assert iou((0, 0, 2, 2), (1, 1, 2, 2)) == pytest.approx(1 / 7)
    assert iou((0, 0, 2, 2), (2, 0, 2, 2)) == 0
    assert covered((0, 0, 10, 10), [(0, 0, 5, 10), (4, 0, 2, 10)]) == pytest.approx(0.6, abs=0.03)
    assert covered((0, 0, 10, 10), []) == 0
    square = ((0, 0), (10, 0), (10, 10), (0, 10))
    assert in_polygon(5, 5, square)
    assert not in_polygon(11, 5, square)
    assert not in_polygon(5, -1, square)


# The scorer, where it is to be had.


@pytest.fixture(scope='module')
def real(shared: Path) -> Path:
    return shared / 'real'


@pytest.fixture(scope='module')
def scorer(real: Path) -> Any:
    spec = importlib.util.spec_from_file_location('scorer', str(real / 'tools' / 'score.py'))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ('case', 'confidence'), [('jittered', 0.0), ('jittered', 0.5), ('nothing found', 0.0), ('no entries', 0.0)]
)
def test_the_same_figures_as_the_scorer(
    case: str, confidence: float, real: Path, scorer: Any, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    labels = json.loads((real / 'labels.json').read_text())
    for image in labels['images']:  # groups that the scorer makes of several fields
        block = image['split_block']
        image['block'] = block.rsplit('/', 1)[0] if image['subset'] == 'dt_od_2019' else block
        if image['subset'].startswith('amod18'):
            image['light'] = '%s / %s' % (image['subset'], image['lighting'])
            image['bot'] = '%s / robot %s' % (image['subset'], image['robot'])
    found = jittered(labels, seed=3)
    if case != 'jittered':
        for image in found['images']:
            image['obstacles'] = []
    if case == 'no entries':
        found['images'] = found['images'][:1]
    lanes = str(real / 'lane_polygons.json')
    files = ['--labels', written(tmp_path / 'l.json', labels), '--detections', written(tmp_path / 'd.json', found)]
    call = [*files, '--lanes', lanes, '--min-confidence', str(confidence), '--by', 'subset', 'block', 'light', 'bot']
    assert evaluate.main([*call, '--jobs', '1', '--output', str(tmp_path / 'out')]) == 0
    content = json.loads((tmp_path / 'out' / 'evaluation.json').read_text())
    assert content['missing_count'] == (758 if case == 'no entries' else 0)
    ours = content['runs'][0]['groups']
    theirs = scorer.evaluate(labels, found, json.loads(Path(lanes).read_text()), confidence, True)['groups']
    compared = 0
    for name, wanted in theirs.items():
        compare(named(ours, name), wanted, name)
        compared += 1
    assert compared > 40


def named(groups: Dict[str, Any], name: str) -> Dict[str, Any]:
    """Our group of the scorer's name."""
    places = {'ALL': ('all', ''), 'dt_od_2019 / with lane polygons': ('lane polygons', 'with')}
    if name in places:
        group, value = places[name]
    elif name.startswith('block '):
        group, value = 'block', name[len('block ') :]
    else:
        group, value = ('bot' if ' / robot ' in name else 'light' if ' / ' in name else 'subset'), name
    return groups['all'] if group == 'all' else groups[group][value]


def compare(ours: Dict[str, Any], theirs: Dict[str, Any], name: str) -> None:
    for key, wanted in theirs.items():
        if key == 'milliseconds' and wanted is not None:
            for which in ('median', 'p95'):  # a bin is 1 % wide
                assert ours[key][which] == pytest.approx(wanted[which], rel=0.011, abs=0.006), (name, key)
        else:
            assert ours[key] == wanted, (name, key)
