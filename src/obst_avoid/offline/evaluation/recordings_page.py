"""The page of the label-free checks."""

import base64
import os
from typing import Any, Dict, Iterator, List, Mapping, Sequence
from urllib.parse import quote

from obst_avoid.offline.evaluation import recordings
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
    number,
    share_cell,
    trouble,
    write,
)

SHEETS_BUDGET = 5_000_000
"""[characters] of contact sheets within the page; the others are linked."""
SIDES = (('inside', 'in our lane'), ('outside', 'outside'), ('unknown', 'side unknown'))


def write_recordings_page(content: Content, path: str, sheets: str) -> None:
    """Write the page of the label-free checks.

    content: tool, version, options, empty, broken, and runs with name, what and figures. sheets: the folder of the
    contact sheets; those beyond SHEETS_BUDGET are linked relative to the page. Raises OSError.
    """
    runs = content['runs']
    words = {
        'title': 'Recordings without labels',
        'lead': _recordings_lead(content),
        'troubles': _recordings_troubles(content),
        'empty': content['empty'],
        'headline': _recordings_headline(runs, content['empty']),
        'recordings': _recordings_table(runs, content['empty']),
        'sheets': list(_sheet_lists(runs, sheets, os.path.dirname(os.path.abspath(path)))),
        'rules': _recordings_rules(content['empty']),
    }
    write(path, 'recordings.html', {**words, **called(content)})


def _recordings_lead(content: Content) -> List[str]:
    runs = content['runs']
    total = runs[0]['figures']['total']
    driven = '' if total['metres'] is None else ' and %.1f m' % total['metres']
    first = '%s with %s over %.1f s%s %s run through %s.' % (
        counted(len(runs[0]['figures']['recordings']), 'recording'),
        counted(total['pictures'], 'picture'),
        total['seconds'],
        driven,
        'was' if len(runs[0]['figures']['recordings']) == 1 else 'were',
        ', and beside it '.join('%s (%s)' % (run['name'], run['what']) for run in runs),
    )
    broken = total['broken']
    second = 'Every picture could be read.' if not broken else '%s could not be read.' % counted(broken, 'picture')
    left_out = content['broken_count']
    if left_out:
        words = '1 recording was' if left_out == 1 else '%d recordings were' % left_out
        second += ' %s left out as a whole.' % words
    if content['empty']:
        second += ' All were declared empty: whatever was found is a false alarm.'
    return [first, second]


def _recordings_troubles(content: Content) -> List[Trouble]:
    total = content['runs'][0]['figures']['total']
    left_out = ['%s: %s' % (item['path'], item['why']) for item in content['broken']]
    return [
        trouble('Recordings left out', left_out, content['broken_count']),
        trouble('Pictures that could not be read', total['why_broken'], total['broken']),
    ]


def _recordings_headline(runs: Sequence[Content], empty: bool) -> Table:
    totals = [run['figures']['total'] for run in runs]
    rows = []
    if empty:
        shares = [item['false_alarms']['pictures_with_any'] for item in totals]
        rows.append([Cell('pictures with a false alarm'), *map(share_cell, shares), *difference_of_shares(shares, -1)])
        rows.append(
            [
                Cell('longest run of pictures with one'),
                *(_longest_cell(item, named=True) for item in totals),
                *_blank(runs),
            ]
        )
    for words, place, form in (
        ('false alarms a picture' if empty else 'detections a picture', ('per_picture',), '%.3f'),
        ('false alarms a metre' if empty else 'detections a metre', ('per_metre',), '%.3f'),
    ):
        values = [at(item, place) for item in totals]
        rows.append([Cell(words), *(number(v, form) for v in values), *difference_of_values(values, form)])
    for kind in sorted({kind for item in totals for kind in item['found']}):
        cells = [_sides_cell(item['found'].get(kind, {})) for item in totals]
        rows.append([Cell('detections called %s' % kind), *cells, *_blank(runs)])
    rows.append([Cell('things followed'), *(Cell(str(item['flicker']['tracks'])) for item in totals), *_blank(runs)])
    for words, name in (
        ('seen in one picture only (flashes)', 'flashes'),
        ('missing between first and last sighting', 'missing'),
    ):
        shares = [item['flicker'][name] for item in totals]
        rows.append([Cell(words), *map(share_cell, shares), *difference_of_shares(shares, -1)])
    gaps = [Cell(str(item['flicker']['gaps']), _per_thing(item['flicker'])) for item in totals]
    rows.append([Cell('lost and found again'), *gaps, *_blank(runs)])
    rows.append([Cell('kind changed'), *(Cell(str(item['flicker']['kind_changes'])) for item in totals), *_blank(runs)])
    for words, name in (('time a picture, median', 'median'), ('time a picture, 95 % below', 'p95')):
        values = [at(item, ('milliseconds', name)) for item in totals]
        rows.append([Cell(words), *(number(v, '%.1f ms') for v in values), *difference_of_values(values, '%.1f ms')])
    return Table(
        ['', *(run['name'] for run in runs), *(['difference', '95 % intervals'] if len(runs) > 1 else [])], rows
    )


def _blank(runs: Sequence[Content]) -> List[Cell]:
    return [Cell(''), Cell('')] if len(runs) > 1 else []


def _per_thing(flicker: Content) -> str:
    return '' if flicker['gaps_per_track'] is None else '%.2f a thing' % flicker['gaps_per_track']


def _sides_cell(sides: Mapping[str, int]) -> Cell:
    words = ['%d %s' % (sides[side], name) for side, name in SIDES if sides.get(side)]
    return Cell(str(sum(sides.values())), ', '.join(words))


def _longest_cell(figures: Content, named: bool = False) -> Cell:
    """named: with the recording's name."""
    alarms = figures['false_alarms']
    if not alarms['longest_run']:
        return Cell('0')
    name = alarms['longest_in'] + '\n' if named else ''
    return Cell(str(alarms['longest_run']), '%s%s\nto %s' % (name, alarms['longest_from'], alarms['longest_to']))


def _recordings_table(runs: Sequence[Content], empty: bool) -> Table:
    """A row a recording and run."""
    rows = []
    for recordings_of_runs in zip(*(run['figures']['recordings'] for run in runs)):
        for index, (run, item) in enumerate(zip(runs, recordings_of_runs)):
            metres = (
                '' if item['metres'] is None else '%.1f m\nby %s' % (item['metres'], ', '.join(item['metres_from']))
            )
            cells = [Cell(item['name'] if index == 0 else '', item['path'] if index == 0 else '')]
            cells += [Cell(run['name'], mark='name')] if len(runs) > 1 else []
            cells += [
                Cell(str(item['pictures']), '%d broken' % item['broken'] if item['broken'] else ''),
                Cell('%.1f s' % item['seconds'], metres),
                Cell(str(item['detections']), _kinds_words(item['found'])),
                number(item['per_picture'], '%.3f'),
                number(item['per_metre'], '%.2f'),
                share_cell(item['pictures_with_any'], '\n'),
                *([_longest_cell(item)] if empty else []),
                Cell(str(item['flicker']['tracks'])),
                share_cell(item['flicker']['flashes'], '\n'),
                share_cell(item['flicker']['missing'], '\n'),
                Cell(str(item['flicker']['gaps']), _per_thing(item['flicker'])),
                number(at(item, ('milliseconds', 'median')), '%.1f'),
            ]
            rows.append(cells)
    found = 'false alarms' if empty else 'detections'
    head = [
        '',
        *(['run'] if len(runs) > 1 else []),
        'pictures',
        'length',
        found,
        'a picture',
        'a metre',
        'pictures with any',
    ]
    head += ['longest run'] if empty else []
    return Table([*head, 'things', 'flashes', 'missing', 'lost, found again', 'ms'], rows, len(runs))


def _kinds_words(found: Mapping[str, Mapping[str, int]]) -> str:
    return '\n'.join('%d %s' % (sum(sides.values()), kind) for kind, sides in found.items())


def _sheet_lists(runs: Sequence[Content], folder: str, beside: str) -> Iterator[Dict[str, Any]]:
    """Sheets by run and recording: in the page as long as there is room, then as links from the page's folder."""
    room = SHEETS_BUDGET
    for run in runs:
        for item in run['figures']['recordings']:
            if not item['sheets']:
                continue
            shown = []
            for name in item['sheets']:
                path = os.path.join(folder, name)
                size = os.path.getsize(path) * 4 // 3 + 40
                uri = ''
                if size <= room:
                    room -= size
                    with open(path, 'rb') as file:
                        uri = 'data:image/jpeg;base64,' + base64.b64encode(file.read()).decode()
                else:
                    room = 0  # in order: what comes after a link is linked too
                link = quote(os.path.relpath(path, beside).replace(os.sep, '/'))
                shown.append({'uri': uri, 'link': link, 'words': 'Contact sheet %s of %s' % (name, item['name'])})
            title = item['name'] + (', %s' % run['name'] if len(runs) > 1 else '')
            title += ': %s on %s' % (counted(item['detections'], 'detection'), counted(len(shown), 'sheet'))
            note = '%d more are on no sheet: too many.' % item['unshown'] if item['unshown'] else ''
            yield {'title': title, 'sheets': shown, 'note': note}


def _recordings_rules(empty: bool) -> List[str]:
    rules = [
        'Each recording ran through the detector as a sequence, tracker on, as on the robot.',
        'Metres are from the simulator where the recording has its truth, else from the commands to the wheels, which '
        'a robot follows only roughly. Recordings without either are left out of all figures a metre, and so are '
        'drives of less than %g m.' % recordings.LEAST_METRES,
        'A detection belongs to a thing that was seen before when it lies within %g m and %g of its distance of where '
        "that thing should be now, the robot's own motion taken out; nearest pairs first, whatever the kind. While a "
        'thing is lost that grows by %g m a second, or %g m where the motion is not known.'
        % (recordings.GATE, recordings.GATE_SHARE, recordings.COMMAND_ERROR, recordings.UNKNOWN_SPEED),
        'Lost and found again: not detected in one or more pictures, and again within %g s. Flash: seen in one picture '
        'and not in the next. Missing: of all pictures between the first and the last sighting of a thing, those '
        'without it.' % recordings.MEMORY,
    ]
    if empty:
        rules.append('Longest run: pictures in a row that each have a false alarm. Those stop a robot.')
    return rules
