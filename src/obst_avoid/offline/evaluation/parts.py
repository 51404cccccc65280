"""What the pages are made of: cells, tables, words for numbers, and the template that they go into."""

import os
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import jinja2

Content = Mapping[str, Any]

MOST_NAMES = 50
"""Of broken or missing pictures in a list."""
SHOWN_OPTIONS = 400
"""[characters] of an option's value."""


@dataclass(frozen=True)
class Cell:
    """text: large. small: below it. mark: class in the page's style."""

    text: str
    small: str = ''
    mark: str = ''


@dataclass(frozen=True)
class Table:
    """head: of the columns. rows: of cells, one a column. left: so many columns are names, the others numbers."""

    head: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    left: int = 1


@dataclass(frozen=True)
class Trouble:
    """Something that went wrong with several names. more: that are not in the list."""

    title: str
    names: Sequence[str]
    more: int


def percent(value: float) -> str:
    """0.9342 as 93.4 %."""
    return '%.1f %%' % (100 * value)


def share_cell(share: Optional[Content], between: str = ' ', note: str = '') -> Cell:
    """A share with its interval and counts in small type. between: the two."""
    if not share:
        return Cell('-')
    counts = together('(%d of %d)' % (share['k'], share['n']))
    return Cell(percent(share['value']), interval(share) + between + counts + note)


def interval(share: Content) -> str:
    """The 95 % interval of a share, in per cent."""
    low, high = share['ci95']
    return together('%.1f to %.1f' % (100 * low, 100 * high))


def together(words: str) -> str:
    """Words between which no line breaks."""
    return words.replace(' ', '\u00a0')


def number(value: Optional[float], form: str, small: str = '') -> Cell:
    """A number by a %-format; a dash for None. small: below it."""
    return Cell('-' if value is None else form % value, '' if value is None else small)


def counted(number: int, word: str) -> str:
    """1 picture, 2 pictures."""
    return '%d %s%s' % (number, word, '' if number == 1 else 's')


def at(figures: Content, place: Sequence[str]) -> Any:
    """A value in nested mappings; None when it, or what it is in, is not there."""
    value: Any = figures
    for name in place:
        value = (value or {}).get(name)
    return value


def difference_of_shares(shares: Sequence[Optional[Content]], good: int) -> List[Cell]:
    """Points of percent, and whether the intervals overlap; nothing for one run."""
    if len(shares) < 2:
        return []
    first, second = shares
    if not first or not second:
        return [Cell('-'), Cell('-')]
    apart = first['ci95'][1] < second['ci95'][0] or second['ci95'][1] < first['ci95'][0]
    difference = second['value'] - first['value']
    mark = '' if not apart else 'better' if difference * good > 0 else 'worse'
    return [Cell('%+.1f points' % (100 * difference), mark=mark), Cell('apart' if apart else 'overlap', mark=mark)]


def difference_of_values(values: Sequence[Optional[float]], form: str) -> List[Cell]:
    """Second minus first, and an empty cell; nothing for one run."""
    if len(values) < 2:
        return []
    if values[0] is None or values[1] is None:
        return [Cell('-'), Cell('')]
    return [Cell(form.replace('%.', '%+.') % (values[1] - values[0])), Cell('')]


def trouble(title: str, names: Sequence[str], count: Optional[int] = None) -> Trouble:
    """The first MOST_NAMES of what went wrong. count: of all, when names are not all."""
    count = len(names) if count is None else count
    return Trouble('%s (%d)' % (title, count), names[:MOST_NAMES], count - min(len(names), MOST_NAMES))


def items(values: Mapping[str, Any]) -> List[Tuple[str, str]]:
    """Names with their values in words, long ones cut."""

    def words(value: Any) -> str:
        text = ', '.join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
        return text if len(text) <= SHOWN_OPTIONS else text[:SHOWN_OPTIONS] + ' …'

    return [(name, words(value)) for name, value in values.items()]


def called(content: Content) -> Dict[str, Any]:
    """How the tool was called: its version, and the options that are set."""
    options = [(name, value) for name, value in content['options'].items() if value not in (None, '', [], (), False)]
    return {'version': content['version'], 'options': items(dict(options))}


def write(path: str, template: str, words: Mapping[str, Any]) -> None:
    """Fill a template of this folder and write the page. Raises OSError."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(os.path.dirname(os.path.abspath(__file__))),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template(template).render(words)
    with open(path, 'w', encoding='utf-8') as file:
        file.write(page)
