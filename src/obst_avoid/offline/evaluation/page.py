"""The page of an evaluation against labels: one HTML file, without scripts and without anything from elsewhere.

Here the content of evaluation.json becomes rows and words; page.html says where they stand.
"""

from typing import Any, Callable, Dict, Iterator, List, Optional, Sequence, Tuple

from obst_avoid.core.types import Array
from obst_avoid.offline.evaluation import plots
from obst_avoid.offline.evaluation.cards import Cards
from obst_avoid.offline.evaluation.matching import KINDS
from obst_avoid.offline.evaluation.parts import (
    Cell,
    Content,
    Table,
    Trouble,
    at,
    called,
    counted,
    difference_of_shares,
    difference_of_values,
    interval,
    items,
    number,
    percent,
    share_cell,
    together,
    trouble,
    write,
)

PICTURES_BUDGET = 5_800_000
"""[characters] of all annotated pictures together: with plots and tables the page stays below 8 MB, so that it goes
through mail.
"""
LEGEND = (
    ('#3cc83c', '', 'labelled and found'),
    ('#e62828', '', 'labelled and missed'),
    ('#a0a0a0', '', 'labelled, does not count'),
    ('#ffffff', '#555', 'detection, right'),
    ('#e628e6', '', 'detection, false alarm (its kind, confidence) or wrong side'),
    ('#3ca0eb', '', 'detection that does not count (says why)'),
)
REPORT = (
    ('Report, 19.12.2017', ('423', '192', '14', '8', '9', '45'), ('', '', '3.2 %', '4 %', '1.4 %', '7.2 %')),
    ('Report, 21.12.2017', ('387', '103', '10', '5', '15', '28'), ('', '', '2.5 %', '4.4 %', '3 %', '5.7 %')),
)
"""Source: report, table "Results": counts, and percentages as printed there."""
REPORT_COLUMNS = (
    ('correct_duckies', 'correctly detected duckies'),
    ('correct_cones', 'correctly detected cones'),
    ('missed_duckies', 'missed ducks'),
    ('missed_cones', 'missed cones'),
    ('false_positives', 'false positive'),
    ('false_position', 'false position'),
)
HEADLINES: Tuple[Tuple[str, Tuple[str, ...], int], ...] = (
    ('found (recall)', ('recall',), 1),
    ('found, near', ('recall_near',), 1),
    ('found and called by the right kind', ('recall_kind',), 1),
    ('duckies found', ('duckie', 'recall'), 1),
    ('cones found', ('cone', 'recall'), 1),
    ('pictures with a false alarm', ('false_alarms', 'frames_with_any'), -1),
    ('precision', ('precision',), 1),
    ('precision, indicative', ('precision_indicative',), 1),
    ('wrong side of the line', ('side', 'wrong'), -1),
    ('wrong side, duckies', ('side', 'wrong_duckie'), -1),
    ('wrong side, cones', ('side', 'wrong_cone'), -1),
    ('side not known', ('side', 'unknown'), -1),
)
"""Shares: words, where in the figures, and whether more is better (1) or worse (-1)."""


def write_page(content: Content, path: str, picture_of: Callable[[Dict[str, Any]], Optional[Array]]) -> None:
    """Write the page of an evaluation against labels.

    content: of evaluation.json. picture_of: from one of its PICTUREs to (H, W, 3) uint8 BGR, or None when it cannot
    be had. Raises OSError.
    """
    runs = content['runs']
    comparison = content.get('comparison')
    shown = [picture for run in runs for picture in run['worst']]
    shown += [picture for picture in (comparison or {}).get('pictures', ()) for _ in picture['runs']]
    cards = Cards(picture_of, PICTURES_BUDGET // max(len(shown), 1), content['options'].get('robot') or '')
    words = {
        'title': 'Detections against labels',
        'lead': _lead(content),
        'troubles': _troubles(content),
        'report': report_table(runs),
        'headline': headline(runs),
        'headline_note': _headline_note(runs),
        'plots': _plots(runs),
        'groups': list(_group_tables(runs)),
        'comparison': comparison and _comparison(comparison, runs, cards),
        'worst': [
            {
                'title': 'The worst of %s' % run['name']
                if len(runs) > 1
                else 'Most missed, false and wrong side first',
                'pictures': [cards.of(picture, [run['name']], run) for picture in run['worst']],
            }
            for run in runs
        ],
        'legend': [{'color': color, 'ground': ground, 'words': text} for color, ground, text in LEGEND],
        'rules': _rules(content['constants']),
        'constants': items(content['constants']),
    }
    write(path, 'page.html', {**words, **called(content)})


def _lead(content: Content) -> List[str]:
    """What was evaluated, and what was not."""
    runs = content['runs']
    objects = runs[0]['groups']['all'].get('relevant_gt', 0)
    what = ', and beside it with '.join('%s (%s)' % (run['name'], run['what']) for run in runs)
    first = '%s with %s that count%s evaluated with %s; labels: %s.' % (
        counted(content['pictures'], 'picture'),
        counted(objects, 'labelled duckie and cone') if objects == 1 else '%d labelled duckies and cones' % objects,
        ' was' if content['pictures'] == 1 else ' were',
        what,
        content.get('labels') or 'none',
    )
    broken, missing, bad = (content[name + '_count'] for name in ('broken', 'missing', 'bad'))
    sentences = []
    if broken:
        words = '1 picture or bag' if broken == 1 else '%d pictures or bags' % broken
        sentences.append('%s could not be read.' % words)
    if missing:
        words = '1 labelled picture has' if missing == 1 else '%d labelled pictures have' % missing
        files = content['options'].get('detections')
        what = 'counted as nothing found' if files else 'not in the PATHs, left out'
        sentences.append('%s no detections (%s).' % (words, what))
    if bad:
        sentences.append('%s left out as wrong.' % ('1 entry was' if bad == 1 else '%d entries were' % bad))
    everything = 'Every picture could be read, and every labelled picture has its detections.'
    return [first, ' '.join(sentences) or everything]


def _troubles(content: Content) -> List[Trouble]:
    return [
        trouble(
            'Could not be read',
            ['%s: %s' % (item['path'], item['why']) for item in content['broken']],
            content['broken_count'],
        ),
        trouble('Labelled, without detections', content['missing'], content['missing_count']),
        trouble('Entries left out', content['bad_entries'], content['bad_count']),
    ]


def report_table(runs: Sequence[Content]) -> Table:
    """What was found in the form of the report's table, above the report's own rows."""
    rows = []
    for run in runs:
        found = run['groups']['all'].get('report_table') or {}
        cells = [Cell(run['name'])]
        for key, _ in REPORT_COLUMNS:
            share, note = found.get(key), ''
            if not share and found.get(key + '_indicative'):
                share, note = found[key + '_indicative'], '\nindicative'
            if not share:
                cells.append(Cell('-'))
                continue
            small = '%s (%s)' % (together(percent(share['value'])), interval(share))
            cells.append(Cell(str(share['k']), small + note))
        rows.append(cells)
    for name, counts, shares in REPORT:
        rows.append([Cell(together(name), mark='quiet'), *(Cell(n, p, 'quiet') for n, p in zip(counts, shares))])
    return Table(['', *(words for _, words in REPORT_COLUMNS)], rows)


def headline(runs: Sequence[Content]) -> Table:
    """The figures that count most; two runs in adjacent columns, with their difference."""
    figures = [run['groups']['all'] for run in runs]
    rows = []
    for words, place, good in HEADLINES:
        shares = [at(item, place) for item in figures]
        if place == ('precision_indicative',) and all(item.get('precision') for item in figures):
            continue
        if any(shares):
            rows.append([Cell(words), *map(share_cell, shares), *difference_of_shares(shares, good)])
        if place == ('false_alarms', 'frames_with_any'):
            alarms = [_false_alarms(item) for item in figures]
            cells = [number(value, '%.3f', small) for value, small in alarms]
            difference = difference_of_values([value for value, _ in alarms], '%.3f')
            rows.append([Cell('false alarms a picture'), *cells, *difference])
            for kind in KINDS:
                numbers = [_false_alarms_called(item, kind) for item in figures]
                cells = [number(value, '%d', small) for value, small in numbers]
                difference = difference_of_values([value for value, _ in numbers], '%.0f')
                rows.append([Cell('false alarms called %s' % kind), *cells, *difference])
    for words, place, form, small in (
        ('position error, median', ('position', 'median'), '%.3f m', 'of %d objects'),
        ('position error, 95 % below', ('position', 'p95'), '%.3f m', ''),
        ('position, mean error along and across', ('position', 'along_bias'), '%+.3f m', ''),
        ('radius error, median', ('radius', 'median_error'), '%+.3f m', 'of %d objects'),
        ('time a picture, median', ('milliseconds', 'median'), '%.1f ms', ''),
        ('time a picture, 95 % below', ('milliseconds', 'p95'), '%.1f ms', ''),
    ):
        values = [at(item, place) for item in figures]
        if all(value is None for value in values):
            continue
        cells = [
            number(value, form, small % at(item, (place[0], 'n')) if small else '')
            for item, value in zip(figures, values)
        ]
        if place == ('position', 'along_bias'):
            cells = [_bias(item.get('position')) for item in figures]
            rows.append([Cell(words), *cells, *([Cell(''), Cell('')] if len(runs) > 1 else [])])
            continue
        rows.append([Cell(words), *cells, *difference_of_values(values, form)])
    names = [run['name'] for run in runs]
    return Table(['', *names, *(['difference', '95 % intervals'] if len(runs) > 1 else [])], rows)


def _bias(position: Optional[Content]) -> Cell:
    if not position:
        return Cell('-')
    along, across = position['along_bias'], position['across_bias']
    ahead, aside = 'far' if along >= 0 else 'near', 'left' if across >= 0 else 'right'
    return Cell('%.3f m too %s' % (abs(along), ahead), '%.3f m too far %s' % (abs(across), aside))


def _false_alarms(figures: Content) -> Tuple[Optional[float], str]:
    """False alarms a picture, and of how many; where no labels are complete, the indicative number."""
    alarms = figures.get('false_alarms')
    shown = alarms or figures.get('false_alarms_indicative')
    if not shown or shown['per_frame'] is None:
        return None, ''
    pictures = alarms['valid_frames'] if alarms else figures['frames']
    small = '%d in %s' % (shown['count'], counted(pictures, 'picture'))
    return shown['per_frame'], small + ('' if alarms else ', indicative')


def _false_alarms_called(figures: Content, kind: str) -> Tuple[Optional[int], str]:
    """False alarms of that name; where no labels are complete, the indicative number."""
    counts = figures.get('false_alarms_by_kind')
    if counts:
        return counts[kind], ''
    count = (figures.get('false_alarms_indicative') or {}).get('as_' + kind)
    return count, '' if count is None else 'indicative'


def _headline_note(runs: Sequence[Content]) -> str:
    note = (
        'Small print: 95 % Wilson interval, then how many of how many. The intervals take objects for independent; '
        'neighbouring pictures show the same ones, so the true intervals are wider.'
    )
    if len(runs) > 1:
        note += ' Difference: %s minus %s; green is better, red worse, only where the intervals are apart.' % (
            runs[1]['name'],
            runs[0]['name'],
        )
    if not any(run['groups']['all'].get('false_alarms') for run in runs):
        note += ' No picture has complete labels, so false alarms and precision are indicative only.'
    return note


def _plots(runs: Sequence[Content]) -> List[plots.Plot]:
    made = [plots.precision_recall(runs)]
    made += [plots.precision_recall(runs, kind) for kind in ('duckie', 'cone')]
    made += [plots.recall_bars(name, values, shares) for name, values, shares in _recalls(runs)]
    made.append(plots.histogram('Position error', 'm', [(run['name'], run.get('position_histogram')) for run in runs]))
    made.append(
        plots.histogram('Time a picture', 'ms', [(run['name'], run.get('milliseconds_histogram')) for run in runs])
    )
    return [plot for plot in made if plot]


def _recalls(runs: Sequence[Content]) -> Iterator[Tuple[str, List[str], List[Tuple[str, List[Any]]]]]:
    """Name, values, and each run's recall by value, of all bands and groups."""
    made: List[Any] = []
    for section in ('bands', 'groups'):
        for name in _keys(run[section] for run in runs):
            parts = [_parts(run[section].get(name)) for run in runs]
            values = _keys(parts)
            recalls = [
                (run['name'], [(part.get(v) or {}).get('recall') for v in values]) for run, part in zip(runs, parts)
            ]
            if (values, recalls) not in made:  # a layout is often its own split_block
                made.append((values, recalls))
                yield name, values, recalls


def _keys(mappings: Any) -> List[str]:
    """All keys, in order of first appearance."""
    return list(dict.fromkeys(key for mapping in mappings for key in mapping))


def _parts(group: Optional[Content]) -> Content:
    """The figures by value; a group may be figures itself."""
    if group is None:
        return {}
    return {'all': group} if 'frames' in group else group


def _group_tables(runs: Sequence[Content]) -> Iterator[Dict[str, Any]]:
    """A table a group and a band, with a row a value and run."""
    for section, columns in (('groups', GROUP_COLUMNS), ('bands', BAND_COLUMNS)):
        for name in _keys(run[section] for run in runs):
            parts = [_parts(run[section].get(name)) for run in runs]
            rows = []
            for value in _keys(parts):
                for index, (run, part) in enumerate(zip(runs, parts)):
                    figures = part.get(value) or {}
                    cells = [Cell(value if index == 0 else '')]
                    cells += [Cell(run['name'], mark='name')] if len(runs) > 1 else []
                    cells += [cell(figures) for _, cell in columns]
                    first = index == 0 and len(runs) > 1
                    rows.append([Cell(c.text, c.small, (c.mark + ' first').strip()) for c in cells] if first else cells)
            head = ['', *(['run'] if len(runs) > 1 else []), *(words for words, _ in columns)]
            title = (
                'All pictures' if name == 'all' else 'Objects by %s' % name if section == 'bands' else 'By %s' % name
            )
            yield {'title': title, 'table': Table(head, rows, len(head) - len(columns)), 'open': name == 'subset'}


def _share_of(*place: str) -> Callable[[Content], Cell]:
    return lambda figures: share_cell(at(figures, place), '\n')


def _value_of(form: str, *place: str) -> Callable[[Content], Cell]:
    return lambda figures: number(at(figures, place), form)


def _position_cell(figures: Content) -> Cell:
    position = figures.get('position')
    if not position:
        return Cell('-')
    return Cell('%.3f m' % position['median'], '95 %%: %.3f\n(%d)' % (position['p95'], position['n']))


def _precision_cell(figures: Content) -> Cell:
    if figures.get('precision'):
        return share_cell(figures['precision'], '\n')
    return share_cell(figures.get('precision_indicative'), '\n', '\nindicative')


def _false_alarms_cell(figures: Content) -> Cell:
    value, small = _false_alarms(figures)
    return number(value, '%.3f', small.replace(' pictures', '').replace(' picture', '').replace(', ', '\n'))


GROUP_COLUMNS: Tuple[Tuple[str, Callable[[Content], Cell]], ...] = (
    ('pictures', _value_of('%d', 'frames')),
    ('found (recall)', _share_of('recall')),
    ('found, near', _share_of('recall_near')),
    ('right kind', _share_of('recall_kind')),
    ('cones found', _share_of('cone', 'recall')),
    ('false alarms a picture', _false_alarms_cell),
    ('precision', _precision_cell),
    ('wrong side', _share_of('side', 'wrong')),
    ('position error', _position_cell),
    ('ms', _value_of('%.1f', 'milliseconds', 'median')),
)
BAND_COLUMNS: Tuple[Tuple[str, Callable[[Content], Cell]], ...] = (
    ('found (recall)', _share_of('recall')),
    ('right kind', _share_of('recall_kind')),
    ('duckies found', _share_of('duckie', 'recall')),
    ('cones found', _share_of('cone', 'recall')),
    ('wrong side', _share_of('side', 'wrong')),
    ('position error', _position_cell),
    ('radius error', _value_of('%+.3f m', 'radius', 'median_error')),
)


def _comparison(comparison: Content, runs: Sequence[Content], cards: 'Cards') -> Dict[str, Any]:
    names = [run['name'] for run in runs]
    rows = [[Cell('labelled objects that both find'), Cell(str(comparison['both']))]]
    rows += [[Cell('only %s finds' % name), Cell(str(comparison['only'][name]))] for name in names]
    rows.append([Cell('neither finds'), Cell(str(comparison['neither']))])
    rows += [[Cell('false alarms of %s' % name), Cell(str(comparison['false_alarms'][name]))] for name in names]
    pictures = [cards.of(picture, names, runs[0]) for picture in comparison['pictures']]
    return {'table': Table(['', 'number'], rows), 'pictures': pictures}


def _rules(constants: Content) -> List[str]:
    return [
        'A labelled duckie or cone counts when its box is at least %(min_height)s px high, ends at row %(min_bottom)s '
        'or below (near: row %(near_bottom)s), is not marked as a crowd, does not ride on a Duckiebot, and is not cut '
        'by more than half by the edge of the picture. All others are ignored: neither found nor missed.' % constants,
        'A detection finds it when the boxes overlap by at least %(iou)s (shared area over united area). What is left '
        'over finds it by its foot: the middle of its lower edge lies in the labelled box grown by %(grow)s of its '
        'size at the left, right and below, but not in its upper %(foot_top)s, and the areas differ by less than a '
        'factor of %(area_factor)s.' % constants,
        'One detection finds one object, the surest detections first. The kind need not be right to be found; whether '
        'it was is counted apart.',
        'A detection without a partner is, in this order: ignored (on an ignored label), duplicate (of an object that '
        'another one has found), loose (at least half of it covered by labels), far (it ends above row '
        '%(min_bottom)s), or else a false alarm.' % constants,
        'False alarms count in pictures whose labels are complete, and on the road of pictures with lane polygons. '
        'Elsewhere the number is indicative only: what stands there may not be labelled.',
        'Wrong side: found, but called inside our lane where the label says outside, or the other way round. '
        'Position error: distance on the road between the true and the found nearest point.',
        'Detections less confident than %(min_confidence)s were left out.' % constants,
    ]
