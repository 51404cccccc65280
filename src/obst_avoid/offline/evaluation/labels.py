"""COCO labels, lane polygons and detections files, streamed into an index on disk, and typed records out of it.

The index is a private SQLite file that goes away with its connection: memory does not grow with the number of pictures.
"""

import itertools
import json
import os
import sqlite3
import sys
from dataclasses import dataclass
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

import ijson

from obst_avoid.offline.evaluation.matching import KINDS, Found, Label, Polygon, Rectangle
from obst_avoid.offline.evaluation.tally import BLUR_FIELD, SPEED_FIELD
from obst_avoid.offline.tool import ToolError

Index = sqlite3.Connection

TABLES = """
CREATE TABLE picture (number INTEGER PRIMARY KEY, id TEXT UNIQUE, name TEXT UNIQUE, base TEXT, stem TEXT, entry TEXT,
  source TEXT);
CREATE TABLE label (picture TEXT, entry TEXT);
CREATE TABLE lanes (name TEXT, stem TEXT, polygons TEXT);
CREATE TABLE detections (run INTEGER, name TEXT, base TEXT, stem TEXT, width, height, milliseconds, obstacles TEXT,
  UNIQUE (run, name));
CREATE TABLE source (path TEXT UNIQUE, base TEXT, stem TEXT, entry TEXT);
CREATE TABLE bad (sentence TEXT);
"""
INDICES = """
CREATE INDEX picture_by_base ON picture (base);
CREATE INDEX picture_by_stem ON picture (stem);
CREATE INDEX label_of_picture ON label (picture);
CREATE INDEX lanes_by_name ON lanes (name);
CREATE INDEX lanes_by_stem ON lanes (stem);
CREATE INDEX detections_by_stem ON detections (run, stem);
CREATE INDEX detections_by_base ON detections (run, base);
"""
MOST_VALUES = 200
"""Of a field by which pictures are grouped: more make no table, and memory would grow with them."""
FARTHEST = 1000.0
"""[m] what is so far away, or so large, is a slip of whoever wrote it."""
FLAGS = (None, True, False)
"""What may stand where a yes or no is expected; 0 and 1 are equal to the last two."""
BOM = b'\xef\xbb\xbf'


@dataclass(frozen=True)
class Source:
    """Where a labelled picture is: a file, or a picture of a bag or of a folder that is run as a sequence.

    number: of the picture in its recording; None: the picture stands alone. stamp, time: [ns] in a bag.
    """

    path: str
    recording: Optional[str] = None
    number: Optional[int] = None
    stamp: Optional[int] = None
    time: Optional[int] = None


@dataclass(frozen=True)
class Detected:
    """A picture's entry of a detections file. found: what was readable. milliseconds: None: not told."""

    found: Tuple[Found, ...]
    milliseconds: Optional[float]


@dataclass(frozen=True)
class LabelledPicture:
    """One picture of the labels, with all that belongs to it. polygons: None where no lanes are drawn.

    detected: by run, None where a file says nothing about the picture; empty without files.
    """

    name: str
    width: int
    height: int
    fields: Dict[str, Any]
    complete: bool
    labels: Tuple[Label, ...]
    polygons: Optional[Tuple[Polygon, ...]]
    source: Optional[Source]
    detected: Tuple[Optional[Detected], ...] = ()


def open_index() -> Index:
    """An empty index; SQLite removes it when it is closed."""
    index = sqlite3.connect('')
    index.executescript('PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF;' + TABLES)
    return index


def close_tables(index: Index) -> None:
    """To be called when all is read and before the first question: makes questions fast."""
    index.executescript(INDICES)


def add_labels(index: Index, path: str) -> int:
    """Read a COCO file; returns how many pictures it has. Raises ToolError in one sentence, OSError."""
    categories: Dict[str, str] = {}
    for number, item in enumerate(_items(path, 'categories.item')):
        if not isinstance(item, dict) or 'id' not in item or not isinstance(item.get('name'), str):
            raise ToolError('%s: category %d is %s, expected an id and a name' % (path, number + 1, _short(item)))
        categories[_id(item['id'])] = item['name']
    if not set(categories.values()) & set(KINDS):
        known = ', '.join(categories.values()) or 'none'
        raise ToolError('%s has no category duckie or cone, expected COCO labels of them, found: %s' % (path, known))
    into = 'picture (id, name, base, stem, entry) VALUES (?, ?, ?, ?, ?)'
    pictures = _insert(index, into, _picture_rows(path), path)
    if not pictures:
        raise ToolError('%s has no images, expected COCO labels' % path)
    sentences: List[str] = []
    if not _insert(index, 'label VALUES (?, ?)', _label_rows(path, categories, sentences), path, sentences):
        _expect(path, 'annotations', 'start_array', 'has no list of annotations, expected one, empty or not')
    lost = 'SELECT count(*), min(picture) FROM label WHERE picture NOT IN (SELECT id FROM picture)'
    number, example = index.execute(lost).fetchone()
    if number:
        add_bad(index, '%s: %d annotations of no picture in it, as of image_id %s' % (path, number, example))
    return pictures


def add_lanes(index: Index, path: str) -> None:
    """Read lane polygons. Raises ToolError, OSError."""
    if not _insert(index, 'lanes VALUES (?, ?, ?)', _lane_rows(path), path):
        _expect(path, '', 'start_map', 'has no lane polygons, expected a mapping from file names to them')


def add_detections(index: Index, path: str, run: int) -> None:
    """Read a detections file as that of a run. What is bad in it is kept for bad(). Raises ToolError, OSError."""
    sentences: List[str] = []
    rows = _detection_rows(path, run, sentences)
    into = 'INSERT OR REPLACE INTO detections VALUES (?, ?, ?, ?, ?, ?, ?, ?)'
    for chunk in iter(lambda: list(itertools.islice(rows, 1000)), []):
        before = index.execute('SELECT count(*) FROM detections WHERE run = ?', (run,)).fetchone()[0]
        index.executemany(into, chunk)
        after = index.execute('SELECT count(*) FROM detections WHERE run = ?', (run,)).fetchone()[0]
        if after - before < len(chunk):
            sentences.append(
                '%s: %d pictures are twice in it, the later one counts' % (path, len(chunk) - after + before)
            )
        _keep_bad(index, sentences)
    if not index.execute('SELECT count(*) FROM detections WHERE run = ?', (run,)).fetchone()[0]:
        raise ToolError('%s has no images, expected a detections file as detect_images writes it' % path)


def add_bad(index: Index, sentence: str) -> None:
    """Keep what was bad but not fatal."""
    index.execute('INSERT INTO bad VALUES (?)', (sentence,))


def bad(index: Index, most: int) -> Tuple[int, List[str]]:
    """How much was bad, and the first sentences."""
    rows = index.execute('SELECT sentence FROM bad ORDER BY rowid LIMIT ?', (most,))
    return index.execute('SELECT count(*) FROM bad').fetchone()[0], [row[0] for row in rows]


def add_sources(index: Index, sources: Iterable[Tuple[str, Source]]) -> None:
    """Pictures that may belong to labels, by their full path; a bag's as <bag without .bag>/<sec>_<nanosec>.jpg."""
    rows = ((path, *_names(path), json.dumps(vars(source))) for path, source in sources)
    index.executemany('INSERT OR IGNORE INTO source VALUES (?, ?, ?, ?)', rows)


def match_sources(index: Index) -> None:
    """Give each labelled picture its file or its place in a bag, where there is one.

    By the end of the full path, else by base name, else by stem. Raises ToolError when a name fits several pictures,
    or a picture several names.
    """
    index.executescript(
        'CREATE INDEX source_by_base ON source (base); CREATE INDEX source_by_stem ON source (stem);'
        'CREATE INDEX source_by_entry ON picture (source);'
    )
    names = index.execute('SELECT number, name FROM picture ORDER BY number')
    for number, name in names:
        found = _source_of(index, name)
        if found is None:
            continue
        other = index.execute('SELECT name FROM picture WHERE source = ?', (found,)).fetchone()
        if other:
            path = json.loads(found)['path']
            raise ToolError('%s and %s would both be %s, expected names that tell them apart' % (other[0], name, path))
        index.execute('UPDATE picture SET source = ? WHERE number = ?', (found, number))


def pictures(index: Index, runs: int, keep: Sequence[str]) -> Iterator[LabelledPicture]:
    """All labelled pictures, those of one recording after each other.

    runs: detections files that were read. keep: of the pictures' fields.
    """
    order = "ORDER BY coalesce(json_extract(source, '$.recording'), ''), number"
    for identity, name, entry, source in index.execute('SELECT id, name, entry, source FROM picture ' + order):
        fields = json.loads(entry)
        labels = index.execute('SELECT entry FROM label WHERE picture = ? ORDER BY rowid', (identity,))
        yield LabelledPicture(
            name=name,
            width=fields['width'],
            height=fields['height'],
            fields={key: fields[key] for key in keep if key in fields},
            complete=is_complete(fields),
            labels=tuple(_label_from(json.loads(row[0])) for row in labels),
            polygons=_polygons(index, name),
            source=None if source is None else Source(**json.loads(source)),
            detected=tuple(_detected(index, run, name, fields) for run in range(runs)),
        )


def folders_of(index: Index) -> List[str]:
    """The folders in the names of the labelled pictures."""
    names = (os.path.dirname(row[0]) for row in index.execute("SELECT name FROM picture WHERE name LIKE '%/%'"))
    return sorted(set(names))


def names_without_source(index: Index, most: int) -> Tuple[int, List[str]]:
    """How many labelled pictures were not found, and the first names."""
    number = index.execute('SELECT count(*) FROM picture WHERE source IS NULL').fetchone()[0]
    rows = index.execute('SELECT name FROM picture WHERE source IS NULL ORDER BY number LIMIT ?', (most,))
    return number, [row[0] for row in rows]


def is_complete(fields: Mapping[str, Any]) -> bool:
    """Whether all duckies and cones of a picture are labelled: its own word, as a mapping or one for all."""
    word = fields.get('complete')
    if word is None:
        return True
    words = [word.get(kind) for kind in KINDS] if isinstance(word, dict) else [word]
    return all(word is True or word == 'all' or str(word).startswith('all (') for word in words)


def too_many_values(index: Index, names: Sequence[str]) -> List[str]:
    """Those of the pictures' fields that have more than MOST_VALUES values."""
    found = []
    for name in names:
        query = "SELECT count(DISTINCT json_extract(entry, '$.' || ?)) FROM picture"
        if index.execute(query, ('"%s"' % name,)).fetchone()[0] > MOST_VALUES:
            found.append(name)
    return found


def unknown_fields(index: Index, names: Sequence[str]) -> List[str]:
    """Those names that no picture has as a field."""
    query = "SELECT 1 FROM picture WHERE json_extract(entry, '$.' || ?) IS NOT NULL LIMIT 1"
    return [name for name in names if index.execute(query, ('"%s"' % name,)).fetchone() is None]


def found_from(entry: Any) -> Optional[Found]:
    """One obstacle of a detections file; None when it is bad."""
    if not isinstance(entry, dict) or entry.get('kind') not in KINDS:
        return None
    box, confidence, in_lane = _rectangle(entry.get('bbox')), entry.get('confidence', 1.0), entry.get('in_lane')
    if box is None or not _finite(confidence) or not 0 <= confidence <= 1 or in_lane not in FLAGS:
        return None
    x, y, radius = entry.get('x'), entry.get('y'), entry.get('radius')
    if not all(value is None or _in_metres(value) for value in (x, y, radius)):
        return None
    return Found(entry['kind'], box, float(confidence), None if in_lane is None else bool(in_lane), x, y, radius)


def _insert(
    index: Index, words: str, rows: Iterator[Tuple[Any, ...]], path: str, sentences: Optional[List[str]] = None
) -> int:
    """How many rows there were. sentences: what the rows say of bad entries on the way."""
    count = 0
    try:
        for chunk in iter(lambda: list(itertools.islice(rows, 1000)), []):
            count += index.executemany('INSERT INTO ' + words, chunk).rowcount
            _keep_bad(index, sentences or [])
        _keep_bad(index, sentences or [])
        return count
    except sqlite3.IntegrityError as error:
        what = 'file_name' if 'name' in str(error) else 'id'
        raise ToolError('%s has two images of one %s, expected each once' % (path, what)) from error


def _keep_bad(index: Index, sentences: List[str]) -> None:
    """Keep and forget: the list does not grow."""
    for sentence in sentences:
        add_bad(index, sentence)
    sentences.clear()


def _picture_rows(path: str) -> Iterator[Tuple[str, str, str, str, str]]:
    for number, item in enumerate(_items(path, 'images.item')):
        if not isinstance(item, dict) or not isinstance(item.get('file_name'), str) or 'id' not in item:
            raise ToolError('%s: image %d is %s, expected id and file_name' % (path, number + 1, _short(item)))
        for name in ('width', 'height'):
            if not _finite(item.get(name)) or item[name] <= 0:
                words = (path, item['file_name'], name, _short(item.get(name)))
                raise ToolError('%s: %s has %s %s, expected a number of pixels' % words)
        for name in (SPEED_FIELD, BLUR_FIELD):
            if item.get(name) is not None and not _finite(item[name]):
                words = (path, item['file_name'], name, _short(item[name]))
                raise ToolError('%s: %s has %s %s, expected a finite number' % words)
        yield (_id(item['id']), item['file_name'], *_names(item['file_name']), json.dumps(item))


def _label_rows(path: str, categories: Mapping[str, str], sentences: List[str]) -> Iterator[Tuple[str, str]]:
    for number, item in enumerate(_items(path, 'annotations.item')):
        if not isinstance(item, dict):
            raise ToolError('%s: annotation %d is %s, expected a mapping' % (path, number + 1, _short(item)))
        where = '%s: annotation %s' % (path, _short(item.get('id', number + 1)))
        if 'image_id' not in item:
            raise ToolError('%s has no image_id' % where)
        category = categories.get(_id(item.get('category_id')))
        if category is None:
            known = ', '.join(categories)
            raise ToolError(
                '%s has category_id %s, expected one of: %s' % (where, _short(item.get('category_id')), known)
            )
        if _rectangle(item.get('bbox')) is None:
            expected = 'expected [left, top, width, height], finite, width and height > 0'
            sentence = '%s has bbox %s, %s' % (where, _short(item.get('bbox')), expected)
            if category in KINDS:
                raise ToolError(sentence)
            sentences.append(sentence)  # of a sign or the like: little depends on it
            continue
        for name in ('x', 'y', 'radius'):
            if item.get(name) is not None and not _in_metres(item[name]):
                words = (where, name, _short(item[name]), FARTHEST)
                raise ToolError('%s has %s %s, expected a number below %g (m)' % words)
        for name in ('iscrowd', 'riding', 'in_lane'):
            if item.get(name) not in FLAGS:
                raise ToolError('%s has %s %s, expected true or false' % (where, name, _short(item[name])))
        marks = (bool(item.get('iscrowd')), bool(item.get('riding')))
        metres = (item.get(name) for name in ('x', 'y', 'radius'))
        in_lane = item.get('in_lane')
        label = (category, item['bbox'], *marks, *metres, None if in_lane is None else bool(in_lane))
        yield _id(item['image_id']), json.dumps(label)


def _lane_rows(path: str) -> Iterator[Tuple[str, str, str]]:
    for name, entry in _read(path, lambda file: ijson.kvitems(file, '', use_float=True)):
        polygons = entry.get('polygons') if isinstance(entry, dict) else None
        if not isinstance(polygons, list) or not all(_is_polygon(polygon) for polygon in polygons):
            raise ToolError('%s: %s has no polygons, expected a list of label and points [[u, v], ...]' % (path, name))
        yield name, os.path.splitext(name)[0], json.dumps(polygons)


def _is_polygon(entry: Any) -> bool:
    if not isinstance(entry, dict) or not isinstance(entry.get('label'), str):
        return False
    points = entry.get('points')
    good = isinstance(points, list) and len(points) >= 3
    return good and all(isinstance(p, list) and len(p) == 2 and all(_finite(value) for value in p) for p in points)


def _detection_rows(path: str, run: int, sentences: List[str]) -> Iterator[Tuple[Any, ...]]:
    for number, item in enumerate(_items(path, 'images.item')):
        if not isinstance(item, dict) or not isinstance(item.get('file_name'), str):
            raise ToolError('%s: image %d is %s, expected a file_name' % (path, number + 1, _short(item)))
        name, obstacles = item['file_name'], item.get('obstacles')
        if not isinstance(obstacles, list):
            raise ToolError('%s: %s has no obstacles, expected a list, empty or not' % (path, name))
        good = []
        for entry in obstacles:
            found = found_from(entry)
            if found is None:
                sentences.append('%s: bad obstacle %s' % (name, _short(entry)))
            else:
                good.append(tuple(vars(found).values()))
        milliseconds = _number_or_none(item.get('milliseconds'))
        size = (_number_or_none(item.get('width')), _number_or_none(item.get('height')))
        yield (run, name, *_names(name), *size, milliseconds, json.dumps(good))


def _items(path: str, prefix: str) -> Iterator[Any]:
    return _read(path, lambda file: ijson.items(file, prefix, use_float=True))


def _expect(path: str, place: str, event: str, otherwise: str) -> None:
    """Raise ToolError when something else than what such an event begins is there, or nothing."""
    events = _read(path, lambda file: ijson.parse(file, use_float=True))
    if next((found for prefix, found, _ in events if prefix == place), None) != event:
        raise ToolError('%s %s' % (path, otherwise))


def _read(path: str, parse: Any) -> Iterator[Any]:
    """What is parsed of a file, with or without a byte order mark."""
    with open(path, 'rb') as file:
        if file.read(len(BOM)) != BOM:
            file.seek(0)
        try:
            yield from parse(file)
        except (ijson.JSONError, UnicodeError, ValueError) as error:
            words = (str(error).strip().splitlines() or ['nothing in it'])[0][:200].rstrip('. ')
            raise ToolError('%s is not JSON (%s), expected UTF-8 JSON without NaN' % (path, words)) from error


def _source_of(index: Index, name: str) -> Optional[str]:
    base, stem = _names(name)
    rows = index.execute('SELECT path, entry FROM source WHERE base = ?', (base,)).fetchall()
    exact = [row for row in rows if row[0] == name or row[0].endswith('/' + name)]
    rows = exact or rows or index.execute('SELECT path, entry FROM source WHERE stem = ?', (stem,)).fetchall()
    if len(rows) > 1:
        raise ToolError('%s could be %s or %s, expected one' % (name, rows[0][0], rows[1][0]))
    return rows[0][1] if rows else None


def _detected(index: Index, run: int, name: str, fields: Mapping[str, Any]) -> Optional[Detected]:
    row = _row_of(index, run, name)
    if row is None:
        return None
    width, height, milliseconds, obstacles = row
    if (width, height) != (fields['width'], fields['height']):
        sizes = (name, width or 0, height or 0, fields['width'], fields['height'])
        add_bad(index, '%s: size %gx%g, labels %gx%g' % sizes)
    found = (Found(kind, tuple(box), *rest) for kind, box, *rest in json.loads(obstacles))
    return Detected(tuple(found), milliseconds)


def _row_of(index: Index, run: int, name: str) -> Optional[Tuple[Any, ...]]:
    """A labelled picture's row of a detections file: of its own name, else of its base name, else of its stem.

    No row is taken twice: one of another label's own name stays that one's, and of a base name or stem that several
    labels or several rows share none is taken.
    """
    columns = 'SELECT width, height, milliseconds, obstacles FROM detections WHERE run = ? AND '
    row: Optional[Tuple[Any, ...]] = index.execute(columns + 'name = ?', (run, name)).fetchone()
    if row:
        return row
    free = ' AND NOT EXISTS (SELECT 1 FROM picture WHERE picture.name = detections.name) LIMIT 2'
    for part, value in zip(('base', 'stem'), _names(name)):
        rows = index.execute(columns + part + ' = ?' + free, (run, value)).fetchall()
        if rows:
            sharing = index.execute('SELECT count(*) FROM picture WHERE %s = ?' % part, (value,)).fetchone()[0]
            return rows[0] if len(rows) == sharing == 1 else None
    return None


def _polygons(index: Index, name: str) -> Optional[Tuple[Polygon, ...]]:
    for where, value in (('name', name), ('stem', os.path.splitext(name)[0])):
        row = index.execute('SELECT polygons FROM lanes WHERE %s = ?' % where, (value,)).fetchone()
        if row:
            entries = json.loads(row[0])
            return tuple(Polygon(item['label'], tuple((u, v) for u, v in item['points'])) for item in entries)
    return None


def _label_from(entry: List[Any]) -> Label:
    """As _label_rows wrote it."""
    category, (left, top, width, height), *rest = entry
    return Label(category, (left, top, width, height), *rest)


def _names(name: str) -> Tuple[str, str]:
    """Base name and stem."""
    base = os.path.basename(name)
    return base, os.path.splitext(base)[0]


def _rectangle(value: Any) -> Optional[Rectangle]:
    if not isinstance(value, list) or len(value) != 4 or not all(_finite(number) for number in value):
        return None
    left, top, width, height = (float(number) for number in value)
    return (left, top, width, height) if width > 0 and height > 0 else None


def _finite(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


def _in_metres(value: Any) -> bool:
    return _finite(value) and abs(value) < FARTHEST


def _number_or_none(value: Any) -> Optional[float]:
    return value if _finite(value) else None


def _id(value: Any) -> str:
    """Ids may be numbers or words; 1 and 1.0 are one."""
    return '%g' % value if isinstance(value, float) and value.is_integer() else str(value)


def _short(value: Any) -> str:
    return 'missing' if value is None else json.dumps(value, default=str)[:120]
