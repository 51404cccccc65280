"""Tallies add up in any order; figures from them are what a plain count gives."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import json
from collections import Counter
from typing import Any, Dict, List, Optional

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from obst_avoid.offline.evaluation import figures, tally
from obst_avoid.offline.evaluation.labels import Detected, LabelledPicture
from obst_avoid.offline.evaluation.matching import Found, Label
from obst_avoid.offline.evaluation.tasks import Job, Run, Task
from obst_avoid.offline.evaluation.work import Total, evaluate_pictures
from obst_avoid.offline.evaluation.worst import choose_worst, keep_worst

boxes = st.tuples(st.integers(0, 600), st.integers(90, 440), st.integers(8, 120), st.integers(8, 120))
kinds = st.sampled_from(['duckie', 'cone'])
sides = st.sampled_from([True, False, None])
places = st.floats(-1, 1)
label_lists = st.lists(st.builds(Label, kinds, boxes, x=places, y=places, radius=st.floats(0.01, 0.1), in_lane=sides))
found_lists = st.lists(
    st.builds(Found, kinds, boxes, st.floats(0, 1), sides, x=places, y=places, radius=st.floats(0.01, 0.1))
)


def picture(name: str, labels: Any = (), found: Any = (), complete: bool = True, **fields: Any) -> LabelledPicture:
    """With the answers of two detections files, the second one empty."""
    detected = (Detected(tuple(found), 5.0), Detected((), None))
    return LabelledPicture(name, 640, 480, fields, complete, tuple(labels), None, None, detected)


JOB = Job((Run('a'), Run('b')), by=('light',), worst=6)


def summed(parts: List[List[LabelledPicture]], job: Job = JOB) -> Any:
    """Everything that is said of pictures, worked on in parts, by way of JSON."""
    total = Total(job)
    for part in parts:
        total.add(json.loads(json.dumps(evaluate_pictures(job, Task('', tuple(part))))))
    runs = []
    for groups, bands, worst in zip(total.groups, total.bands, total.worst):
        runs.append(
            {
                'groups': {(g, v): figures.figures(t) for g, values in groups.items() for v, t in values.items()},
                'bands': {(g, v): figures.object_figures(t) for g, values in bands.items() for v, t in values.items()},
                'curves': figures.curves(groups['all']['all']),
                'worst': choose_worst(worst, job.worst),
            }
        )
    return runs, total.comparison, total.pictures


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(label_lists, found_lists, st.booleans(), st.sampled_from('xy')), min_size=1, max_size=8),
    st.randoms(use_true_random=False),
)
def test_any_split_in_any_order_gives_the_same(contents: List[Any], random: Any) -> None:
    pictures = [
        picture(str(number), labels, found, complete, light=light)
        for number, (labels, found, complete, light) in enumerate(contents)
    ]
    whole = summed([pictures])
    random.shuffle(pictures)
    cuts = sorted(random.randint(0, len(pictures)) for _ in range(2))
    assert summed([pictures[: cuts[0]], pictures[cuts[0] : cuts[1]], pictures[cuts[1] :]]) == whole


@pytest.mark.parametrize('name', ['milliseconds', 'position', 'radius', 'radius_size', 'confidence'])
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_quantiles_are_within_a_bin_of_numpys(name: str, data: Any) -> None:
    bins = tally.HISTOGRAMS[name]
    values = data.draw(st.lists(st.floats(bins.low, bins.high * 0.999), min_size=1, max_size=60))
    counts: Counter = Counter()
    for value in values:
        tally.count_value(counts, name, value)
    edges = bins.edges()
    for share in (0.5, 0.95):
        wanted = float(np.quantile(values, share))
        rank = share * (len(values) - 1)
        nearby = sorted(values)[int(np.floor(rank)) : int(np.ceil(rank)) + 1]
        width = max(float(np.diff(edges)[bins.index(value)]) for value in nearby)
        found = tally.quantile(tally.histogram(counts, name), bins, share)
        assert found == pytest.approx(wanted, abs=width * 1.0001)


def test_values_beyond_a_histogram_are_kept_at_its_ends() -> None:
    counts: Counter = Counter()
    for value in (-5.0, 0.0005, 99.0):
        tally.count_value(counts, 'position', value)
    filled = tally.histogram(counts, 'position')
    assert (filled[0], filled[-1], filled.sum()) == (2, 1, 3)


def test_histograms_side_by_side_have_the_same_bins() -> None:
    first, second = Counter(), Counter()  # type: ignore[var-annotated]
    for value in (0.1, 0.15):
        tally.count_value(first, 'position', value)
    tally.count_value(second, 'position', 0.5)
    written = [figures.written_histogram(a, 'position', [b]) for a, b in ((first, second), (second, first))]
    assert written[0] is not None and written[1] is not None
    assert written[0]['edges'] == written[1]['edges']
    assert [sum(item['counts']) for item in written if item] == [2, 1]
    assert figures.written_histogram(Counter(), 'position', [first]) is None


def test_steps_of_a_hundredth_have_each_their_own_bin() -> None:
    assert [tally.HISTOGRAMS['confidence'].index(step / 100) for step in range(101)] == list(range(101))


@pytest.mark.parametrize(
    ('band', 'value', 'words'),
    [
        (tally.DISTANCE, 0.2, '0.2 to 0.4'),
        (tally.DISTANCE, 0.39999, '0.2 to 0.4'),
        (tally.DISTANCE, 0.4, '0.4 to 0.6'),
        (tally.DISTANCE, 5.0, '2 and more'),
        (tally.HEIGHT, 16.0, '16 to 24'),
        (tally.HEIGHT, 100.0, '96 and more'),
        (tally.BOTTOM, 199.0, '180 to 200'),
        (tally.SPEED, 0.0, '0 to 0.1'),
        (tally.PICTURE_BANDS['exposure_error_stops'], -9.0, 'below -3'),
    ],
)
def test_bands(band: tally.Band, value: float, words: str) -> None:
    assert band.of(value) == words
    assert words in band.order()


def test_bands_of_a_label() -> None:
    far = Label('duckie', (0, 170, 30, 40), x=0.3, y=0.4, radius=0.035)
    assert tally.bands_of_label(far, 0.25, 3.0) == [
        ('distance [m]', '0.4 to 0.6'),
        ('box height [px]', '32 to 48'),
        ('radius [m]', '0.03 to 0.04'),
        ('speed [m/s]', '0.2 to 0.3'),
    ]
    assert tally.bands_of_label(Label('duckie', (0, 170, 30, 40)), None, 3.0) == [
        ('bottom row [px]', '200 to 240'),
        ('box height [px]', '32 to 48'),
        ('blur [px]', '2 to 5'),
    ]


def test_groups_of_a_picture() -> None:
    fields = {'lighting': 'dark', 'robot': None, 'glare': 0.3}
    by = ('lighting', 'robot', 'glare', 'layout')
    assert tally.groups_of_picture(fields, by, True) == [
        ('all', 'all'), ('lighting', 'dark'), ('glare', '0.25 to 0.5'), ('lane polygons', 'with'),
    ]  # fmt: skip


BOX = (300, 200, 40, 50)


def figures_of(labels: List[Label], found: List[Found], complete: bool = True) -> Dict[str, Any]:
    groups = Total(JOB)
    groups.add(evaluate_pictures(JOB, Task('', (picture('a', labels, found, complete),))))
    return figures.figures(groups.groups[0]['all']['all'])


def test_errors_of_place_radius_and_side() -> None:
    said = figures_of(
        [Label('duckie', BOX, x=0.4, y=0.3, radius=0.03, in_lane=True)],
        [Found('duckie', BOX, 0.9, False, x=0.48, y=0.36, radius=0.025)],
    )
    assert said['position'] == {
        'median': pytest.approx(0.1, abs=0.001), 'p95': pytest.approx(0.1, abs=0.001), 'n': 1,
        'along_bias': 0.1, 'across_bias': 0.0,
    }  # fmt: skip
    assert said['radius']['median_error'] == pytest.approx(-0.005, abs=0.0005)
    assert said['radius']['p95_abs'] == pytest.approx(0.005, abs=0.0005)
    assert said['side']['wrong']['k'] == said['side']['inside_called_outside'] == 1
    assert (said['side']['wrong_duckie']['k'], said['side']['wrong_cone']) == (1, None)
    left = figures_of(
        [Label('duckie', BOX, x=0.5, y=0.0, in_lane=False)], [Found('duckie', BOX, 0.9, None, x=0.5, y=0.02)]
    )
    assert (left['position']['along_bias'], left['position']['across_bias']) == (0.0, 0.02)
    assert (left['side']['wrong']['k'], left['side']['unknown']['k'], left['side']['wrong']['n']) == (0, 1, 1)


def test_of_nothing() -> None:
    said = figures_of([], [])
    assert said['recall'] is said['precision'] is said['position'] is said['side'] is None
    assert said['report_table']['correct_duckies'] is None
    assert figures.share(0, 0) is None
    assert figures.share(1, 2) == {'value': 0.5, 'k': 1, 'n': 2, 'ci95': [0.0945, 0.9055]}


def test_the_reports_own_table() -> None:
    labels = [
        Label('duckie', BOX, in_lane=True), Label('duckie', (100, 300, 40, 50)), Label('cone', (500, 300, 40, 50))
    ]  # fmt: skip
    found = [Found('duckie', BOX, 0.9, False), Found('duckie', (500, 300, 40, 50)), Found('cone', (200, 400, 30, 30))]
    table = figures_of(labels, found)['report_table']
    assert list(table)[:4] == ['correct_duckies', 'correct_cones', 'missed_duckies', 'missed_cones']
    numbers = {name: (value['k'], value['n']) for name, value in table.items()}
    assert numbers == {
        'correct_duckies': (1, 2), 'correct_cones': (1, 1), 'missed_duckies': (1, 2), 'missed_cones': (0, 1),
        'false_positives': (1, 3), 'false_positives_indicative': (1, 3), 'false_position': (1, 1),
    }  # fmt: skip
    assert figures_of(labels, found, complete=False)['report_table']['false_positives'] is None
    assert figures_of(labels, found)['false_alarms_by_kind'] == {'duckie': 0, 'cone': 1}
    assert figures_of(labels, found, complete=False)['false_alarms_by_kind'] is None


def test_precision_and_recall_over_confidence() -> None:
    labels = [Label('duckie', BOX), Label('cone', (500, 300, 40, 50))]
    found = [
        Found('duckie', BOX, 0.9), Found('duckie', (500, 300, 40, 50), 0.5), Found('duckie', (100, 300, 30, 30), 0.25)
    ]  # fmt: skip
    pictures = [picture('a', labels, found), picture('b', labels, [Found('cone', (10, 300, 30, 30), 1.0)], False)]
    total = Total(JOB)
    total.add(evaluate_pictures(JOB, Task('', tuple(pictures))))
    curves = figures.curves(total.groups[0]['all']['all'])

    def at(which: str, kind: str, confidence: float) -> Optional[Any]:
        points = {point['confidence']: (point['recall'], point['precision']) for point in curves[which][kind]}
        assert len(points) <= 101
        return points.get(confidence)

    assert at('curve', 'all', 0.25) == (1.0, 0.6667)
    assert at('curve', 'all', 0.26) == (1.0, 1.0)
    assert at('curve', 'all', 0.51) == (0.5, 1.0)
    assert at('curve', 'all', 0.91) is None
    assert at('curve', 'duckie', 0.5) == (1.0, 0.5), 'the cone under a wrong name'
    assert curves['curve']['cone'] == []
    assert at('curve_indicative', 'all', 0.0) == (0.5, 0.5)
    total = Total(JOB)
    total.add(evaluate_pictures(JOB, Task('', (pictures[1],))))
    assert figures.curves(total.groups[0]['all']['all'])['curve'] is None


def entry(name: str, missed: int = 0, false: int = 0, side: int = 0) -> Dict[str, Any]:
    return {'name': name, 'missed': missed, 'false': false, 'side': side, 'score': missed + false + side}


def test_the_worst_pictures_have_a_third_of_each_sort() -> None:
    entries = [entry('m%02d' % i, missed=9) for i in range(20)]
    entries += [entry('f%02d' % i, false=2) for i in range(20)] + [entry('s%02d' % i, side=1) for i in range(20)]
    names = [item['name'] for item in choose_worst(entries, 9)]
    assert names == ['m00', 'm01', 'm02', 'f00', 'f01', 'f02', 's00', 's01', 's02']
    kept: List[Dict[str, Any]] = []
    for item in entries[::-1]:
        kept = keep_worst([*kept, item], 9)
    assert [item['name'] for item in choose_worst(kept, 9)] == names, 'kept on the way'
    assert [item['name'] for item in choose_worst(entries[:20] + entries[20:21], 6)] == [
        'm00', 'm01', 'm02', 'm03', 'm04', 'f00',
    ]  # fmt: skip
    assert choose_worst([], 6) == []


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 3)), max_size=60), st.integers(1, 9))
def test_the_worst_are_the_same_when_kept_on_the_way(errors: List[Any], most: int) -> None:
    entries = [entry('%02d' % number, *error) for number, error in enumerate(errors)]
    kept: List[Dict[str, Any]] = []
    for item in entries:
        kept = keep_worst([*kept, item], most)
        assert len(kept) <= 2 * most
    assert choose_worst(kept, most) == choose_worst(entries, most)


def test_two_runs_side_by_side() -> None:
    labels = [Label('duckie', BOX), Label('duckie', (100, 300, 40, 50)), Label('cone', (500, 300, 40, 50))]
    labels.append(Label('cone', (400, 400, 40, 50), iscrowd=True))
    first = [Found('duckie', BOX), Found('duckie', (100, 300, 40, 50)), Found('cone', (20, 400, 30, 30))]
    second = [Found('duckie', BOX), Found('cone', (200, 400, 30, 30)), Found('cone', (250, 400, 30, 30))]
    both = (Detected(tuple(first), 1.0), Detected(tuple(second), 1.0))
    total = Total(JOB)
    task = Task('', (LabelledPicture('p', 640, 480, {}, True, tuple(labels), None, None, both),))
    total.add(evaluate_pictures(JOB, task))
    said = total.comparison
    assert said is not None
    assert (said['both'], said['only'], said['neither']) == (1, {'a': 1, 'b': 0}, 1)
    assert said['false_alarms'] == {'a': 1, 'b': 2}
    (shown,) = said['pictures']
    assert (shown['name'], shown['score']) == ('p', 2)
    assert [item['states'] for item in shown['labels']] == [
        {'a': 'hit', 'b': 'hit'}, {'a': 'hit', 'b': 'missed'}, {'a': 'missed', 'b': 'missed'},
        {'a': 'ignored', 'b': 'ignored'},
    ]  # fmt: skip
    assert 'a: 1 cone missed, 1 false alarm; b: 1 cone missed, 1 duckie missed, 2 false alarms' == shown['why']
    assert {name: len(items) for name, items in shown['runs'].items()} == {'a': 3, 'b': 3}
