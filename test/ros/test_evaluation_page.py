"""The pages of `evaluate`: what stands on them, that they are whole in themselves, safe and small."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import base64
import copy
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

import cv2
import numpy as np
import pytest

from obst_avoid.offline.evaluation import cards, page, parts, plots, recordings, recordings_page
from obst_avoid.offline.evaluation.figures import share

CONSTANTS = {
    'min_height': 16,
    'min_bottom': 180,
    'near_bottom': 200,
    'iou': 0.3,
    'grow': 0.25,
    'foot_top': 0.35,
    'area_factor': 4.0,
    'min_confidence': 0.0,
}
LIMIT = 8_000_000
"""[bytes] of a page."""


def figures_of(rng: np.random.Generator, frames: int, objects: int, recall: float, complete: bool) -> Dict[str, Any]:
    """FIGURES as evaluate makes them, by chance."""
    cones = int(objects * 0.15)
    duckies = objects - cones
    hit_duckies, hit_cones = (int(rng.binomial(n, recall)) for n in (duckies, cones))
    hits = hit_duckies + hit_cones
    near, near_hits = objects * 2 // 3, int(rng.binomial(objects * 2 // 3, min(recall + 0.06, 1)))
    right = int(rng.binomial(hits, 0.96))
    false = int(rng.poisson(0.11 * frames))
    wrong = int(rng.binomial(hits, 0.06))
    precision = share(hits, hits + false)
    return {
        'frames': frames,
        'relevant_gt': objects,
        'recall': share(hits, objects),
        'recall_near': share(near_hits, near),
        'recall_far_indicative': share(int(0.3 * objects), objects),
        'recall_kind': share(right, objects),
        'duckie': {'recall': share(hit_duckies, duckies), 'recall_near': None, 'recall_kind': None},
        'cone': {'recall': share(hit_cones, cones), 'recall_near': None, 'recall_kind': None},
        'bands': {},
        'confusion': {},
        'false_alarms': {
            'valid_frames': frames,
            'count': false,
            'per_frame': round(false / frames, 4),
            'frames_with_any': share(min(false, frames) * 4 // 5, frames),
            'on_obstacle_polygon': 0,
        }
        if complete
        else None,
        'false_alarms_indicative': {'count': false, 'per_frame': round(false / frames, 4)},
        'precision': precision if complete else None,
        'precision_indicative': precision,
        'other_detections': {},
        'in_lane_flag': {},
        'milliseconds': {'median': round(6 + rng.random(), 2), 'p95': round(9 + rng.random(), 2)},
        'report_table': {
            'correct_duckies': share(hit_duckies, duckies),
            'correct_cones': share(hit_cones, cones),
            'missed_duckies': share(duckies - hit_duckies, duckies),
            'missed_cones': share(cones - hit_cones, cones),
            'false_positives': share(false, hits + false) if complete else None,
            'false_positives_indicative': share(false, hits + false),
            'false_position': share(wrong, hits),
        },
        'position': {'median': 0.021, 'p95': 0.083, 'n': hits, 'along_bias': 0.0124, 'across_bias': -0.0031},
        'radius': {'median_error': -0.0012, 'p95_abs': 0.011, 'n': hits},
        'side': {
            'wrong': share(wrong, hits),
            'unknown': share(3, hits),
            'inside_called_outside': wrong,
            'outside_called_inside': 0,
        }
        if hits
        else None,
    }


def curve_of(best: float) -> List[Dict[str, float]]:
    """Recall falls and precision rises with confidence."""
    steps = np.linspace(0, 0.98, 99)
    return [
        {'confidence': round(c, 2), 'recall': round(best * (1 - c**4), 4), 'precision': round(0.86 + 0.135 * c, 4)}
        for c in steps.tolist()
    ]


def picture_entry(name: str, runs: Tuple[str, ...], rng: np.random.Generator, **more: Any) -> Dict[str, Any]:
    """A PICTURE with every state of labels and detections."""
    states = ('hit', 'missed', 'ignored', 'hit')
    boxes = [[80 + 130 * i, 190 + 30 * (i % 3), 44, 52] for i in range(4)]
    labels = [
        {
            'kind': 'duckie' if i % 2 else 'cone',
            'bbox': box,
            'state': state,
            'why': 'riding' if state == 'ignored' else '',
        }
        for i, (box, state) in enumerate(zip(boxes, states))
    ]
    for item in labels:
        if len(runs) > 1:
            item['states'] = {runs[0]: item['state'], runs[1]: 'hit' if item['state'] == 'missed' else item['state']}
    detections = [
        {'kind': 'cone', 'bbox': [84, 193, 40, 48], 'confidence': 0.93, 'state': 'hit', 'side_wrong': False},
        {'kind': 'duckie', 'bbox': [472, 188, 40, 50], 'confidence': 0.71, 'state': 'hit', 'side_wrong': True},
        {'kind': 'cone', 'bbox': [300, 350, 60, 70], 'confidence': 0.44, 'state': 'fa', 'side_wrong': False},
        {'kind': 'duckie', 'bbox': [20, 120, 30, 25], 'confidence': 0.31, 'state': 'far', 'side_wrong': False},
    ]
    found = {run: detections if i == 0 else detections[:1] for i, run in enumerate(runs)}
    entry = {
        'name': name,
        'path': '/data/real pictures/%s' % name,
        'in_bag': None,
        'score': 3,
        'missed': 1,
        'false': 1,
        'side': 1,
        'why': '1 duckie missed, 1 false alarm, 1 on the wrong side',
        'labels': labels,
        'runs': found,
    }
    entry.update(more)
    return entry


def evaluation(runs: int = 2, pictures: int = 24, seed: int = 0) -> Dict[str, Any]:
    """What evaluation.json may hold."""
    rng = np.random.default_rng(seed)
    names = ('paper', 'robust')[:runs]
    made = []
    for index, name in enumerate(names):
        better = 0.12 * index
        subsets = {
            'amod18_dark_or_coloured': (140, 196, 0.55, False),
            'amod18_white_light': (150, 260, 0.72, False),
            'dt_od_2019': (270, 410, 0.66, False),
            'empty_road': (87, 0, 0.5, True),
            'kvatitown2026': (104, 221, 0.81, True),
        }
        lighting = {
            'bright': (300, 480, 0.78),
            'medium': (210, 300, 0.71),
            'dark': (120, 160, 0.48),
            'green': (40, 60, 0.4),
        }
        distance = {'%.1f to %.1f' % (d / 10, d / 10 + 0.2): (90, 90, 0.95 - d / 20) for d in (2, 4, 6, 8, 10)}
        height = {
            '16 to 24': 0.42,
            '24 to 32': 0.6,
            '32 to 48': 0.77,
            '48 to 64': 0.85,
            '64 to 96': 0.93,
            '96 and more': 0.95,
        }
        speed = {'0 to 0.1': 0.9, '0.1 to 0.2': 0.84, '0.2 to 0.3': 0.7}
        made.append(
            {
                'name': name,
                'what': 'profile %s, calibration nominal of vehicle nominal' % name,
                'arguments': ['--calibration', '/data/cal', '--vehicle', 'nominal', '--profile', name],
                'groups': {
                    'all': figures_of(rng, 759, 1087, 0.69 + better, True),
                    'subset': {
                        key: figures_of(rng, frames, objects, min(recall + better, 1), complete)
                        for key, (frames, objects, recall, complete) in subsets.items()
                    },
                    'lighting': {
                        key: figures_of(rng, frames, objects, recall + better, False)
                        for key, (frames, objects, recall) in lighting.items()
                    },
                },
                'bands': {
                    'distance [m]': {
                        key: figures_of(rng, f, o, min(r + better, 1), False) for key, (f, o, r) in distance.items()
                    },
                    'box height [px]': {
                        key: figures_of(rng, 90, 150, min(r + better, 1), False) for key, r in height.items()
                    },
                    'speed [m/s]': {
                        key: figures_of(rng, 90, 80, min(r + better, 1), False) for key, r in speed.items()
                    },
                },
                'curve': {kind: curve_of(0.69 + better) for kind in ('all', 'duckie', 'cone')},
                'curve_indicative': {'all': curve_of(0.6)},
                'position_histogram': {
                    'edges': np.linspace(0, 0.3, 61).round(4).tolist(),
                    'counts': np.histogram(rng.gamma(2, 0.014, 800), np.linspace(0, 0.3, 61))[0].tolist(),
                },
                'milliseconds_histogram': {
                    'edges': np.geomspace(3, 90, 61).round(3).tolist(),
                    'counts': np.histogram(5 + index + rng.gamma(3, 0.7, 759), np.geomspace(3, 90, 61))[0].tolist(),
                },
                'worst': [picture_entry('kvatitown_%03d.jpg' % i, (name,), rng) for i in range(pictures)],
            }
        )
    comparison = None
    if runs == 2:
        comparison = {
            'both': 720,
            'only': {'paper': 31, 'robust': 160},
            'neither': 176,
            'false_alarms': {'paper': 84, 'robust': 77},
            'pictures': [picture_entry('differs_%d.jpg' % i, names, rng) for i in range(min(pictures, 6))],
        }
    return {
        'tool': 'evaluate',
        'version': '0.1.0',
        'options': {'labels': 'labels.json', 'profile': list(names), 'sequence': False, 'by': [], 'jobs': 2},
        'labels': 'labels.json',
        'pictures': 759,
        'broken': [{'path': 'a/broken.jpg', 'why': 'the picture is empty, expected JPEG bytes'}],
        'broken_count': 1,
        'missing': ['lost.jpg', 'gone.jpg'],
        'missing_count': 2,
        'bad_entries': ['odd.jpg: kind horse'],
        'bad_count': 1,
        'constants': CONSTANTS,
        'runs': made,
        'comparison': comparison,
    }


def nothing() -> Dict[str, Any]:
    """An evaluation of no picture at all."""
    empty = figures_of(np.random.default_rng(0), 1, 0, 0.5, False)
    for key in ('milliseconds', 'position', 'radius', 'side'):
        empty[key] = None
    content = evaluation(runs=1, pictures=0)
    content.update(
        pictures=0, broken=[], broken_count=0, missing=[], missing_count=0, bad_entries=[], bad_count=0, options={}
    )
    content['runs'][0].update(
        groups={'all': empty},
        bands={},
        curve=None,
        curve_indicative={'all': [], 'duckie': [], 'cone': []},
        position_histogram=None,
        milliseconds_histogram=None,
        worst=[],
    )
    return content


def road(seed: int = 0, size: Tuple[int, int] = (480, 640)) -> Any:
    """A picture to draw on: a grey road with a yellow line."""
    picture = np.full((*size, 3), 70, np.uint8)
    picture[: size[0] // 3] = (190, 170, 150)
    cv2.line(picture, (size[1] // 2, size[0] // 3), (size[1] // 4, size[0]), (40, 190, 220), 14)
    noise = np.random.default_rng(seed).integers(0, 14, picture.shape)
    return (picture + noise).clip(0, 255).astype(np.uint8)


class Read(HTMLParser):
    """What a browser would see: words, addresses, tags that were opened and never closed."""

    VOID = ('meta', 'img', 'br', 'link')

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: List[str] = []
        self.commands: List[str] = []
        self.tables: List[List[List[str]]] = []
        self.images: List[Tuple[str, str]] = []
        self.links: List[str] = []
        self.tags: List[str] = []
        self.seen: List[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: List[Tuple[str, Optional[str]]]) -> None:
        values = {name: value or '' for name, value in attrs}
        self.seen.append(tag)
        self.tags += [] if tag in self.VOID else [tag]
        if tag == 'img':
            self.images.append((values['src'], values.get('alt', '')))
        elif tag == 'a':
            self.links.append(values['href'])
        elif tag == 'pre':
            self.commands.append('')
        elif tag == 'table':
            self.tables.append([])
        elif tag == 'tr':
            self.tables[-1].append([])
        elif tag in ('td', 'th'):
            self.tables[-1][-1].append('')

    def handle_endtag(self, tag: str) -> None:
        assert self.tags.pop() == tag

    def handle_data(self, data: str) -> None:
        data = data.replace('\u00a0', ' ')
        if 'style' in self.tags:
            return
        self.words.append(data)
        if 'pre' in self.tags:
            self.commands[-1] += data
        elif 'td' in self.tags or 'th' in self.tags:
            self.tables[-1][-1][-1] += ('|' if self.tags[-1] == 'small' else '') + data

    @property
    def text(self) -> str:
        """All words, in one line."""
        return ' '.join(' '.join(self.words).split())

    def row(self, name: str, table: int = 1) -> List[str]:
        """The cells behind a row's name."""
        return next(row[1:] for row in self.tables[table] if row[0].split('|')[0] == name)


def written(content: Dict[str, Any], folder: Path, picture: Any = None) -> Tuple[Read, str]:
    """Write a page; what a browser sees of it, and its text."""
    path = folder / 'evaluation.html'
    page.write_page(content, str(path), lambda _: picture)
    text = path.read_text(encoding='utf-8')
    return Read(text), text


@pytest.fixture(scope='module')
def both(tmp_path_factory: pytest.TempPathFactory) -> Tuple[Read, str]:
    """Two runs side by side."""
    return written(evaluation(2, 4), tmp_path_factory.mktemp('page'), road())


class TestPage:
    def test_of_nothing(self, tmp_path: Path) -> None:
        read, _ = written(nothing(), tmp_path)
        assert '0 pictures with 0 labelled duckies and cones that count were evaluated with paper' in read.text
        assert 'Every picture could be read' in read.text
        assert 'Nothing to plot' in read.text
        assert 'None: nothing was missed' in read.text
        assert read.images == []

    def test_it_is_whole_in_itself(self, both: Tuple[Read, str]) -> None:
        read, text = both
        assert read.tags == [], 'every tag is closed'
        assert read.images
        assert all(uri.startswith('data:image/') for uri, _ in read.images)
        rest = re.sub(r'"data:[^"]*"', '', text)
        assert not re.search(r'https?:|//[a-z]|url\(|@import|<script|<link|<iframe|<object', rest, re.IGNORECASE)
        assert not re.search(r'\bon[a-z]+=', rest), 'no handlers'
        assert all(link.startswith('#') and 'id="%s"' % link[1:] in text for link in read.links)

    def test_pictures_have_words(self, both: Tuple[Read, str]) -> None:
        read, _ = both
        assert all(len(alt) > 20 for _, alt in read.images)
        assert any('Recall by distance' in alt and 'paper: 0.2 to 0.4 0.' in alt for _, alt in read.images)

    def test_the_report_and_we(self, both: Tuple[Read, str]) -> None:
        read, _ = both
        assert read.tables[0][0][1:] == [
            'correctly detected duckies',
            'correctly detected cones',
            'missed ducks',
            'missed cones',
            'false positive',
            'false position',
        ]
        assert read.row('Report, 19.12.2017', 0) == ['423', '192', '14|3.2 %', '8|4 %', '9|1.4 %', '45|7.2 %']
        assert read.row('Report, 21.12.2017', 0) == ['387', '103', '10|2.5 %', '5|4.4 %', '15|3 %', '28|5.7 %']
        found = evaluation(2, 4)['runs'][0]['groups']['all']['report_table']
        cells = read.row('paper', 0)
        assert [cell.split('|')[0] for cell in cells] == [str(found[key]['k']) for key, _ in page.REPORT_COLUMNS]

    def test_figures_and_their_difference(self, tmp_path: Path) -> None:
        content = evaluation(2, 0)
        first, second = (run['groups']['all'] for run in content['runs'])
        first.update(recall=share(50, 100), false_alarms=None, precision=None)
        second.update(recall=share(90, 100), recall_near=None)
        first['report_table'].update(false_positives=None, false_positives_indicative=share(10, 100))
        read, _ = written(content, tmp_path)
        assert read.row('paper', 0)[4] == '10|10.0 % (5.5 to 17.4)\nindicative'
        assert read.tables[1][0] == ['', 'paper', 'robust', 'difference', '95 % intervals']
        assert read.row('found (recall)') == [
            '50.0 %|40.4 to 59.6 (50 of 100)',
            '90.0 %|82.6 to 94.5 (90 of 100)',
            '+40.0 points',
            'apart',
        ]
        assert read.row('found, near')[1:] == ['-', '-', '-']
        assert read.row('cones found')[3] in ('apart', 'overlap')
        assert read.row('pictures with a false alarm')[0] == '-'
        assert read.row('false alarms a picture')[0].endswith('in 759 pictures, indicative')
        assert read.row('position error, median')[:1] == ['0.021 m|of %d objects' % first['position']['n']]
        assert read.row('position, mean error along and across')[0] == '0.012 m too far|0.003 m too far right'

    @pytest.mark.parametrize(
        ('first', 'second', 'good', 'wanted'),
        [
            ((50, 100), (90, 100), 1, ('+40.0 points', 'apart', 'better')),
            ((50, 100), (90, 100), -1, ('+40.0 points', 'apart', 'worse')),
            ((90, 100), (50, 100), 1, ('-40.0 points', 'apart', 'worse')),
            ((50, 100), (55, 100), 1, ('+5.0 points', 'overlap', '')),
            ((0, 0), (55, 100), 1, ('-', '-', '')),
        ],
    )
    def test_a_difference(self, first: Any, second: Any, good: int, wanted: Any) -> None:
        cells = parts.difference_of_shares([share(*first), share(*second)], good)
        assert (cells[0].text, cells[1].text, cells[1].mark) == wanted

    def test_one_run_has_no_difference(self, tmp_path: Path) -> None:
        read, _ = written(evaluation(1, 2), tmp_path, road())
        assert read.tables[1][0] == ['', 'paper']
        assert 'Side by side' not in read.text
        assert 'difference' not in read.text.lower().replace('differences', '')

    def test_every_group_and_band_has_its_table(self, both: Tuple[Read, str]) -> None:
        read, _ = both
        content = evaluation(2, 4)['runs'][0]
        summaries = [*('By ' + name for name in content['groups'] if name != 'all')]
        summaries += ['Objects by ' + name for name in content['bands']]
        assert all(title in read.text for title in summaries)
        names = {row[0] for table in read.tables for row in table}
        wanted = {value for section in ('groups', 'bands') for group in content[section].values() for value in group}
        assert wanted - set(content['groups']['all']) <= names

    def test_all_rows_are_as_wide_as_their_head(self, both: Tuple[Read, str]) -> None:
        for table in both[0].tables:
            assert {len(row) for row in table} == {len(table[0])}

    def test_what_went_wrong_is_named(self, both: Tuple[Read, str]) -> None:
        text = both[0].text
        assert '1 picture or bag could not be read. 2 labelled pictures have no detections' in text
        for name in ('a/broken.jpg: the picture is empty', 'lost.jpg', 'gone.jpg', 'odd.jpg: kind horse'):
            assert name in text

    def test_only_what_went_wrong_is_said_and_all_of_it_is_counted(self, tmp_path: Path) -> None:
        content = evaluation(1, 0)
        content.update(broken_count=4321, missing=[], missing_count=0, bad_entries=[], bad_count=0)
        read, _ = written(content, tmp_path)
        assert '4321 pictures or bags could not be read.' in read.text
        assert 'Could not be read (4321)' in read.text
        assert 'no detections' not in read.text.split('Could not be read (')[0]
        assert 'left out as wrong' not in read.text

    def test_errors_by_kind(self, tmp_path: Path) -> None:
        content = evaluation(2, 0)
        first, second = (run['groups']['all'] for run in content['runs'])
        first['side'].update(wrong_duckie=share(1, 10), wrong_cone=None)
        second['side'].update(wrong_duckie=share(2, 10), wrong_cone=share(1, 1))
        first['false_alarms_by_kind'] = {'duckie': 7, 'cone': 2}
        second['false_alarms_indicative'].update(as_duckie=9, as_cone=1)
        read, _ = written(content, tmp_path)
        assert [cell.split('|')[0] for cell in read.row('wrong side, duckies')[:2]] == ['10.0 %', '20.0 %']
        assert [cell.split('|')[0] for cell in read.row('wrong side, cones')[:2]] == ['-', '100.0 %']
        assert read.row('false alarms called duckie') == ['7', '9|indicative', '+2', '']
        assert read.row('false alarms called cone') == ['2', '1|indicative', '-1', '']

    def test_what_is_the_same_is_plotted_once(self, tmp_path: Path) -> None:
        content = evaluation(1, 0)
        groups = content['runs'][0]['groups']
        groups['split_block'] = groups['layout'] = groups['lighting']
        read, _ = written(content, tmp_path)
        assert [alt.split('.')[0] for _, alt in read.images if 'Recall by' in alt].count('Recall by lighting') == 1
        assert not any('split_block' in alt or 'layout' in alt for _, alt in read.images)

    def test_long_lists_are_cut_and_say_so(self, tmp_path: Path) -> None:
        content = evaluation(1, 0)
        content.update(missing=['%d.jpg' % i for i in range(100)], missing_count=4321)
        read, _ = written(content, tmp_path)
        assert 'Labelled, without detections (4321)' in read.text
        assert 'and %d more' % (4321 - parts.MOST_NAMES) in read.text
        assert '49.jpg' in read.text and '50.jpg' not in read.text

    def test_names_are_no_markup(self, tmp_path: Path) -> None:
        content = evaluation(2, 2)
        evil = '<img src=x onerror="alert(1)">&amp;"\'.jpg'
        content['labels'] = evil
        content['options']['labels'] = evil
        content['broken'] = [{'path': evil, 'why': evil}]
        content['missing'] = [evil]
        content['runs'][0]['name'] = evil
        content['comparison']['only'] = {evil: 1, 'robust': 2}
        content['comparison']['false_alarms'] = {evil: 1, 'robust': 2}
        content['runs'][0]['groups'][evil] = {evil: content['runs'][0]['groups']['all']}
        for entry in content['runs'][0]['worst'] + content['comparison']['pictures']:
            entry.update(name=evil, path='/a/' + evil, why=evil)
            entry['runs'] = {evil: entry['runs']['paper']}
        read, text = written(content, tmp_path, road())
        assert '<img src=x' not in text
        assert all(uri.startswith('data:image/') for uri, _ in read.images)
        assert read.text.count(evil) > 8
        assert '\'/a/<img src=x onerror="alert(1)">&amp;"\'"\'"\'.jpg\'' in read.commands[0]

    def test_constants_and_rules(self, both: Tuple[Read, str]) -> None:
        text = both[0].text
        assert 'at least 16 px high, ends at row 180 or below (near: row 200)' in text
        assert 'overlap by at least 0.3' in text
        assert 'differ by less than a factor of 4.0' in text

    def test_the_options_that_were_set(self, both: Tuple[Read, str]) -> None:
        text = both[0].text
        assert 'labels labels.json profile paper, robust jobs 2' in text
        assert 'sequence' not in text.split('How it was called')[1]

    def test_the_same_content_makes_the_same_page(self, tmp_path: Path) -> None:
        texts = [written(evaluation(1, 2), tmp_path, road())[1] for _ in range(2)]
        assert texts[0] == texts[1]

    def test_the_content_is_not_changed(self, tmp_path: Path) -> None:
        content = evaluation(2, 2)
        before = copy.deepcopy(content)
        written(content, tmp_path, road())
        assert content == before

    def test_a_folder_that_is_not_there(self, tmp_path: Path) -> None:
        with pytest.raises(OSError, match='No such file'):
            page.write_page(nothing(), str(tmp_path / 'none' / 'page.html'), lambda _: None)


class TestWorstPictures:
    def test_each_has_name_why_and_command(self, both: Tuple[Read, str]) -> None:
        read, _ = both
        for index in range(4):
            name = 'kvatitown_%03d.jpg' % index
            assert read.text.count(name) >= 4, 'once as a title and once in the command, of each run'
            for profile in ('paper', 'robust'):
                wanted = (
                    'rosrun obst_avoid show_steps --calibration /data/cal --vehicle nominal --profile %s '
                    "--output steps '/data/real pictures/%s'" % (profile, name)
                )
                assert wanted in read.commands
        assert '1 duckie missed, 1 false alarm, 1 on the wrong side' in read.text

    def test_a_command_of_a_picture_in_a_bag(self) -> None:
        entry = {'name': '1511_000000042.jpg', 'path': None, 'in_bag': {'path': '/a b/drive.bag', 'stamp': 0}}
        assert cards.command_of(entry, ['--vehicle', 'v']) == (
            "rosrun obst_avoid bag_to_images --output pictures '/a b/drive.bag' &&\n"
            'rosrun obst_avoid show_steps --vehicle v --output steps pictures/1511_000000042.jpg'
        )

    def test_a_command_of_a_bag_of_several_robots(self, tmp_path: Path) -> None:
        content = evaluation(1, 1)
        content['options']['robot'] = 'duck1'
        content['runs'][0]['worst'][0].update(path=None, in_bag={'path': '/drive.bag', 'stamp': 0})
        read, _ = written(content, tmp_path)
        assert 'bag_to_images --vehicle duck1 --output pictures /drive.bag' in read.commands[0]

    def test_a_picture_that_is_nowhere_is_still_named(self, tmp_path: Path) -> None:
        content = evaluation(1, 1)
        content['runs'][0]['worst'][0]['path'] = None
        read, _ = written(content, tmp_path, None)
        assert 'Picture not found.' in read.text
        assert (
            'show_steps --calibration /data/cal --vehicle nominal --profile paper --output steps kvatitown_000.jpg'
            in (read.commands[0])
        )

    @pytest.mark.parametrize('count', [24, 300])
    def test_the_page_stays_small(self, count: int, tmp_path: Path) -> None:
        noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
        big = cv2.resize(noise, (2592, 1944), interpolation=cv2.INTER_NEAREST)
        content = evaluation(1, count)
        read, text = written(content, tmp_path, big if count == 24 else cv2.resize(big, (640, 480)))
        assert len(text.encode()) < LIMIT
        jpegs = [uri for uri, _ in read.images if uri.startswith('data:image/jpeg')]
        assert len(jpegs) == (24 if count == 24 else 0)
        for uri in jpegs[:2]:
            decoded = cv2.imdecode(np.frombuffer(base64.b64decode(uri.split(',')[1]), np.uint8), cv2.IMREAD_COLOR)
            assert 320 <= decoded.shape[1] <= 640
        assert ('Left out, so that the page stays small.' in read.text) == (count == 300)

    def test_plain_pictures_keep_their_size(self, tmp_path: Path) -> None:
        read, _ = written(evaluation(1, 24), tmp_path, road(size=(960, 1280)))
        uris = [uri for uri, _ in read.images if uri.startswith('data:image/jpeg')]
        decoded = cv2.imdecode(np.frombuffer(base64.b64decode(uris[0].split(',')[1]), np.uint8), cv2.IMREAD_COLOR)
        assert decoded.shape == (480, 640, 3)

    def test_boxes_have_their_colors(self) -> None:
        black = np.zeros((960, 1280, 3), np.uint8)
        marks = picture_entry('a', ('paper', 'robust'), np.random.default_rng(0))
        for item in marks['labels'] + [found for run in marks['runs'].values() for found in run]:
            item['bbox'] = [2 * value for value in item['bbox']]
        paper, robust = (cards.annotated(black, marks, run) for run in ('paper', 'robust'))
        assert paper.shape == (480, 640, 3)
        small = black[:480, :640].copy()
        assert cards.annotated(small, marks, 'paper').any()
        assert not black.any() and not small.any(), 'drawn on a copy'

        def left_edge(drawn: Any, bbox: Any) -> Tuple[int, ...]:
            return tuple(int(v) for v in drawn[round(bbox[1] / 2 + bbox[3] / 2 * 0.9), round(bbox[0] / 2)])

        hit, missed, ignored, _ = (item['bbox'] for item in marks['labels'])
        right, _, false, far = (item['bbox'] for item in marks['runs']['paper'])
        assert left_edge(paper, hit) == cards.GREEN
        assert left_edge(paper, missed) == cards.RED
        assert left_edge(robust, missed) == cards.GREEN
        assert left_edge(paper, ignored) == cards.GREY
        assert left_edge(paper, right) == cards.WHITE
        assert left_edge(paper, false) == cards.MAGENTA
        assert left_edge(paper, far) == cards.BLUE
        wrong_side = marks['runs']['paper'][1]['bbox']
        assert left_edge(paper, wrong_side) == cards.MAGENTA, 'as the legend says'
        assert left_edge(robust, false) == (0, 0, 0)


class TestPlots:
    def test_of_nothing(self) -> None:
        assert plots.precision_recall([{'name': 'a', 'curve': None, 'curve_indicative': {'all': []}}]) is None
        assert plots.recall_bars('lighting', [], [('a', [])]) is None
        assert (
            plots.recall_bars('lighting', ['x', 'y'], [('a', [share(1, 2), None])]) is None
        ), 'one bar compares nothing'
        assert plots.histogram('Time', 'ms', [('a', None), ('b', {'edges': [0, 1], 'counts': [0]})]) is None

    def test_too_many_bars(self) -> None:
        names = [str(i) for i in range(plots.MOST_BARS + 1)]
        assert plots.recall_bars('robot', names, [('a', [share(1, 2)] * len(names))]) is None
        assert plots.recall_bars('robot', names[1:], [('a', [share(1, 2)] * (len(names) - 1))]) is not None

    def test_incomplete_labels_give_an_indicative_curve(self) -> None:
        run = {'name': 'a', 'curve': None, 'curve_indicative': {'all': curve_of(0.5)}}
        assert plots._curve(run, 'all') == (curve_of(0.5), True)
        assert plots._curve({**run, 'curve': {'all': curve_of(0.6)}}, 'all') == (curve_of(0.6), False)
        assert plots.precision_recall([run]) is not None

    def test_one_point_is_a_curve(self) -> None:
        run = {'name': 'a', 'curve': {'all': [{'confidence': 0.0, 'recall': 0.2, 'precision': None}, curve_of(0.5)[0]]}}
        plot = plots.precision_recall([run])
        assert plot is not None
        assert 'recall 0.50, precision 0.86' in plot.words

    @pytest.mark.parametrize(
        ('value', 'wanted'),
        [
            ('0.2 to 0.4', '0.2\u20130.4'),
            ('-1 to -0.5', '-1 to -0.5'),
            ('96 and more', '\u2265 96'),
            ('below 16', '< 16'),
            ('bright', 'bright'),
            ('x' * 30, 'x' * 25 + '…'),
        ],
    )
    def test_names_below_an_axis(self, value: str, wanted: str) -> None:
        assert plots._short(value) == wanted

    @pytest.mark.parametrize('count', [4, 10, 100, 5000])
    def test_bins_are_as_many_as_the_values_can_fill(self, count: int) -> None:
        content = {'edges': list(range(61)), 'counts': np.bincount(np.arange(count) % 60, minlength=60).tolist()}
        edges, counts = plots._merged(content, 60.0, count)
        assert len(counts) == len(edges) - 1 <= min(np.ceil(np.sqrt(count)), plots.BINS)
        assert sum(counts) == count
        assert set(edges) <= set(content['edges'])
        assert plots._merged(content, 7.0, count)[0][-1] >= 7
        assert plots.histogram('Time', 'ms', [('a', content)]) is not None

    @pytest.mark.parametrize(('low', 'high'), [(21.0, 49.0), (5.2, 5.7), (0.01, 60000.0), (3.0, 90.0), (12.0, 19.0)])
    def test_an_axis_of_times_has_ticks(self, low: float, high: float) -> None:
        ticks = plots.log_ticks(low, high)
        assert len(ticks) >= 2
        assert all(low - 0.01 <= tick <= high + 0.01 for tick in ticks)

    def test_precision_begins_at_0(self, monkeypatch: pytest.MonkeyPatch) -> None:
        limits = []
        plot = plots._plot

        def looked_at(draw: Any, *words: str) -> plots.Plot:
            def drawn(axes: Any) -> None:
                draw(axes)
                limits.append(axes.get_ylim())

            return plot(drawn, *words)

        monkeypatch.setattr(plots, '_plot', looked_at)
        assert plots.precision_recall([{'name': 'a', 'curve': {'all': curve_of(0.9)}}]) is not None
        assert limits == [(0, 1.02)]

    def test_a_histogram_in_words(self) -> None:
        content = {'edges': [0, 1, 2, 3], 'counts': [10, 60, 30]}
        plot = plots.histogram('Time', 'ms', [('a', content)])
        assert plot is not None
        assert plot.words == 'a: half of 100 below 2 ms'
        assert base64.b64decode(plot.uri.split(',')[1]).startswith(b'<?xml')


def checked_of(name: str, alarms: int = 6, sheets: Tuple[str, ...] = ()) -> recordings.RecordingChecked:
    """A drive of 300 pictures."""
    return recordings.RecordingChecked(
        path='/data/drives/' + name,
        pictures=300,
        broken=2,
        why_broken=['10_000000000.jpg: the picture is empty, expected JPEG bytes', '11_000000000.jpg: too'],
        seconds=10.0,
        metres=1.84,
        metres_from='commands',
        found={'duckie': {'inside': alarms, 'outside': 1}, 'cone': {'unknown': 2}},
        with_any=alarms,
        longest_run=4,
        longest_from='1511_100000000.jpg',
        longest_to='1511_200000000.jpg',
        flicker=recordings.Flicker(tracks=5, judged=5, flashes=2, gaps=3, missed=9, between=90, changes=1),
        milliseconds={'milliseconds|700': 298},
        sheets=list(sheets),
        unshown=7,
    )


def recordings_content(empty: bool, runs: int = 1, sheets: Tuple[str, ...] = ()) -> Dict[str, Any]:
    """What evaluation.json holds without labels."""
    made = []
    for index, name in enumerate(('paper', 'robust')[:runs]):
        checked = [checked_of('one.bag', 6 + 40 * index, sheets), checked_of('two', 3)]
        made.append({'name': name, 'what': 'profile %s' % name, 'figures': recordings.figures(checked, empty)})
    return {
        'tool': 'evaluate',
        'version': '0.1.0',
        'options': {'empty': empty, 'paths': ['one.bag', 'two']},
        'empty': empty,
        'broken': [{'path': '/data/bad.bag', 'why': 'it cannot be read as a bag'}],
        'broken_count': 1,
        'runs': made,
    }


def written_recordings(content: Dict[str, Any], folder: Path) -> Tuple[Read, str]:
    path = folder / 'evaluation.html'
    recordings_page.write_recordings_page(content, str(path), str(folder / 'sheets'))
    text = path.read_text(encoding='utf-8')
    return Read(text), text


@pytest.fixture
def sheets(tmp_path: Path) -> Tuple[str, ...]:
    """Three contact sheets with an odd name."""
    names = tuple('0001_drive %d.jpg' % i for i in range(3))
    (tmp_path / 'sheets').mkdir()
    for name in names:
        cv2.imwrite(str(tmp_path / 'sheets' / name), road(size=(900, 1440)))
    return names


class TestRecordingsPage:
    def test_of_nothing(self, tmp_path: Path) -> None:
        content = recordings_content(True)
        content.update(broken=[], broken_count=0)
        content['runs'][0]['figures'] = recordings.figures([], True)
        read, _ = written_recordings(content, tmp_path)
        assert '0 recordings with 0 pictures over 0.0 s were run through paper' in read.text
        assert 'Nothing was found, so there is nothing to show.' in read.text

    def test_of_an_empty_road(self, tmp_path: Path, sheets: Tuple[str, ...]) -> None:
        read, text = written_recordings(recordings_content(True, sheets=sheets), tmp_path)
        assert read.tags == []
        assert '2 recordings with 600 pictures over 20.0 s and 3.7 m were run through paper' in read.text
        assert '4 pictures could not be read. 1 recording was left out as a whole. All were declared empty' in read.text
        assert '/data/bad.bag: it cannot be read as a bag' in read.text
        assert read.row('pictures with a false alarm', 0) == ['1.5 %|0.8 to 2.8 (9 of 600)']
        assert read.row('longest run of pictures with one', 0)[0].startswith('4|one.bag\n1511_100000000.jpg\nto')
        assert read.row('false alarms a picture', 0) == ['0.025']
        assert read.row('false alarms a metre', 0) == ['4.076']
        assert read.row('detections called duckie', 0) == ['11|9 in our lane, 2 outside']
        assert read.row('lost and found again', 0) == ['6|0.60 a thing']
        assert '14 more are on no sheet' not in read.text
        assert '7 more are on no sheet: too many.' in read.text
        assert len(read.images) == 3
        assert not re.search(r'https?://|<script|<link', text)

    def test_not_declared_empty(self, tmp_path: Path) -> None:
        read, _ = written_recordings(recordings_content(False), tmp_path)
        assert 'false alarm' not in read.text
        assert read.row('detections a picture', 0) == ['0.025']

    def test_two_runs(self, tmp_path: Path) -> None:
        read, _ = written_recordings(recordings_content(True, runs=2), tmp_path)
        assert read.tables[0][0] == ['', 'paper', 'robust', 'difference', '95 % intervals']
        assert read.row('pictures with a false alarm', 0)[2:] == ['+6.7 points', 'apart']
        for table in read.tables:
            assert {len(row) for row in table} == {len(table[0])}

    def test_sheets_beyond_the_budget_are_links(
        self, tmp_path: Path, sheets: Tuple[str, ...], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        size = (tmp_path / 'sheets' / sheets[0]).stat().st_size
        (tmp_path / 'sheets' / sheets[2]).write_bytes(b'would still fit')
        monkeypatch.setattr(recordings_page, 'SHEETS_BUDGET', size * 2)
        read, _ = written_recordings(recordings_content(False, sheets=sheets), tmp_path)
        assert len(read.images) == 1
        assert read.images[0][0].startswith('data:image/jpeg;base64,')
        links = [link for link in read.links if not link.startswith('#')]
        assert links == ['sheets/0001_drive%201.jpg', 'sheets/0001_drive%202.jpg']

    def test_a_sheet_that_is_gone(self, tmp_path: Path) -> None:
        with pytest.raises(OSError, match='No such file'):
            written_recordings(recordings_content(False, sheets=('gone.jpg',)), tmp_path)


def test_the_example_is_json() -> None:
    content = evaluation()
    assert json.loads(json.dumps(content)) == content
