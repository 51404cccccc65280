"""The worst pictures, and those in which two runs differ most: bounded lists that add up in any order."""

import heapq
import itertools
from collections import Counter
from typing import Any, Dict, List, Mapping, Sequence, Tuple

from obst_avoid.offline.evaluation.matching import FALSE, HIT, Judged, JudgedFound, JudgedLabel
from obst_avoid.offline.evaluation.tasks import Job, Looked

MISSED, FALSE_ALARMS, SIDE = 'missed', 'false', 'side'
SORTS = (MISSED, FALSE_ALARMS, SIDE)
"""Of what can be wrong in a picture."""


def keep_worst(entries: Sequence[Dict[str, Any]], most: int) -> List[Dict[str, Any]]:
    """Of pictures, those among which choose_worst may choose: at most twice as many, however many are added later."""
    if len(entries) <= most:
        return list(entries)
    kept = {entry['name']: entry for entry in heapq.nsmallest(most, entries, key=_rank)}
    for entry in itertools.chain(*_thirds(entries, most)):
        kept[entry['name']] = entry
    return list(kept.values())


def choose_worst(entries: Sequence[Dict[str, Any]], most: int) -> List[Dict[str, Any]]:
    """The worst pictures, worst first; of each sort of error a third, where there are so many. Ties go by name."""
    chosen: Dict[str, Dict[str, Any]] = {}
    for entry in itertools.chain(*_thirds(entries, most), sorted(entries, key=_rank)):
        if len(chosen) < most:
            chosen.setdefault(entry['name'], entry)
    return sorted(chosen.values(), key=_rank)


def _thirds(entries: Sequence[Dict[str, Any]], most: int) -> List[List[Dict[str, Any]]]:
    third = most // len(SORTS)
    return [
        heapq.nsmallest(
            third, (entry for entry in entries if entry[sort]), key=lambda entry: (-entry[sort], *_rank(entry))
        )
        for sort in SORTS
    ]


def _rank(entry: Mapping[str, Any]) -> Tuple[int, str]:
    return -entry['score'], entry['name']


def if_wrong(job: Job, looked: Looked, runs: Sequence[int], judged: Sequence[Judged]) -> List[Dict[str, Any]]:
    """The picture, when something is wrong in it. runs: which are looked at."""
    missed = false = side = 0
    for index in runs:
        missed += sum(not label.ignored and label.partner is None for label in judged[index].labels)
        false += sum(item.counts for item in judged[index].found)
        side += sum(item.side_wrong for item in judged[index].found)
    if not missed + false + side:
        return []
    return [_entry(job, looked, runs, judged, missed + false + side, {MISSED: missed, FALSE_ALARMS: false, SIDE: side})]


def _entry(
    job: Job, looked: Looked, runs: Sequence[int], judged: Sequence[Judged], score: int, sorts: Mapping[str, int]
) -> Dict[str, Any]:
    """What is needed to rank a picture; 'judged' becomes words in described, for the few that are kept."""
    chosen = [(job.runs[index].name, judged[index]) for index in runs]
    return {'name': looked.picture.name, 'score': score, **sorts, 'judged': (looked.picture, chosen)}


def described(entry: Mapping[str, Any]) -> Dict[str, Any]:
    """A picture for JSON, with its labels and detections."""
    picture, chosen = entry['judged']
    source = picture.source
    in_bag = None
    if source is not None and source.stamp is not None:
        in_bag = {'path': source.recording, 'stamp': source.stamp, 'time': source.time}
    labels = []
    for index, label in enumerate(chosen[0][1].labels):
        states = {name: _state_of(judged.labels[index]) for name, judged in chosen}
        missing = [name for name, state in states.items() if state == MISSED]
        labels.append(
            {
                'kind': label.label.category,
                'bbox': [round(value, 2) for value in label.label.box],
                'state': MISSED if missing else states[chosen[0][0]],
                'states': states,
                'why': label.ignored or ('missed by %s' % ', '.join(missing) if missing and len(chosen) > 1 else ''),
            }
        )
    return {
        **{key: entry[key] for key in ('name', 'score', *SORTS)},
        'path': None if source is None or in_bag is not None else source.path,
        'in_bag': in_bag,
        'why': _words(chosen),
        'labels': labels,
        'runs': {name: [_drawn(item) for item in judged.found] for name, judged in chosen},
    }


def _state_of(label: JudgedLabel) -> str:
    return 'ignored' if label.ignored else MISSED if label.partner is None else HIT


def _drawn(item: JudgedFound) -> Dict[str, Any]:
    found = item.found
    return {
        'kind': found.kind,
        'bbox': [round(value, 2) for value in found.box],
        'confidence': found.confidence,
        'state': item.state,
        'side_wrong': item.side_wrong,
        'counts': item.counts,
    }


def _words(chosen: Sequence[Tuple[str, Judged]]) -> str:
    """What is wrong in a picture, by run when there are several."""
    parts = []
    for name, judged in chosen:
        missed = Counter(label.label.category for label in judged.labels if not label.ignored and label.partner is None)
        words = ['%s missed' % _plural(number, kind) for kind, number in sorted(missed.items())]
        false = sum(item.counts for item in judged.found)
        words += ['%s' % _plural(false, 'false alarm')] if false else []
        unjudged = sum(item.state == FALSE and not item.counts for item in judged.found)
        words += ['%s that may be unlabelled' % _plural(unjudged, 'detection')] if unjudged else []
        side = sum(item.side_wrong for item in judged.found)
        words += ['%d on the wrong side of the line' % side] if side else []
        sentence = ', '.join(words) or 'nothing wrong'
        parts.append('%s: %s' % (name, sentence) if len(chosen) > 1 else sentence)
    return '; '.join(parts)


def _plural(number: int, noun: str) -> str:
    return '%d %s%s' % (number, noun, '' if number == 1 else 's')


def empty_comparison(job: Job) -> Dict[str, Any]:
    """Of nothing yet."""
    names = [run.name for run in job.runs]
    zeros = dict.fromkeys(names, 0)
    return {'both': 0, 'only': dict(zeros), 'neither': 0, 'false_alarms': dict(zeros), 'pictures': []}


def compare(job: Job, looked: Looked, judged: Sequence[Judged], into: Dict[str, Any]) -> None:
    """Add a picture. Its labels are relevant for both runs or for none."""
    names = [run.name for run in job.runs]
    only = [0, 0]
    for first, second in zip(judged[0].labels, judged[1].labels):
        if first.ignored:
            continue
        found = (first.partner is not None, second.partner is not None)
        if found[0] == found[1]:
            into['both' if found[0] else 'neither'] += 1
        else:
            only[found.index(True)] += 1
    false = [sum(item.counts for item in result.found) for result in judged]
    for name, number, alarms in zip(names, only, false):
        into['only'][name] += number
        into['false_alarms'][name] += alarms
    differing = sum(only) + abs(false[0] - false[1])
    if differing:
        sorts = {MISSED: sum(only), FALSE_ALARMS: abs(false[0] - false[1]), SIDE: 0}
        entry = _entry(job, looked, (0, 1), judged, differing, sorts)
        into['pictures'] = heapq.nsmallest(job.worst, [*into['pictures'], entry], key=_rank)


def add_comparison(into: Dict[str, Any], other: Mapping[str, Any], most: int) -> None:
    """Add the comparison of other pictures."""
    for key in ('both', 'neither'):
        into[key] += other[key]
    for key in ('only', 'false_alarms'):
        for name, number in other[key].items():
            into[key][name] += number
    into['pictures'] = heapq.nsmallest(most, [*into['pictures'], *other['pictures']], key=_rank)
