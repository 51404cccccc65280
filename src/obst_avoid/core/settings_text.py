"""Settings files as people read and write them: the comment beside each number, and numbers changed in their place."""

from dataclasses import dataclass
from typing import Any, Dict, Iterator, List, Mapping, Tuple, Union

import yaml

Path = Tuple[Union[str, int], ...]
"""Where a value stands: keys, and in a list of colours its place."""
COLOR_CHANNELS = ('hue', 'saturation', 'value')


@dataclass(frozen=True)
class Described:
    """One value of a settings file. comment: what stands beside it, its unit first; '' where nothing does."""

    path: Tuple[str, ...]
    value: Any
    comment: str


def described(text: str) -> List[Described]:
    """All values of a settings file in order, groups included (their value is None), each with its comment.

    A comment stands on the line where the value ends, and goes on in the lines below that hold nothing else.
    Raises yaml.YAMLError.
    """
    lines, content = text.splitlines(), yaml.safe_load(text)
    found = []
    for path, key, value in _entries(yaml.compose(text, yaml.SafeLoader), ()):
        block = isinstance(value, yaml.CollectionNode) and not value.flow_style  # ends where the next one begins
        mark = key.end_mark if block else value.end_mark
        held = None if isinstance(value, yaml.MappingNode) else value_at(content, path)
        found.append(Described(path, held, _comment(lines, mark.line, mark.column)))
    return found


def with_values(text: str, values: Mapping[Tuple[str, ...], Any]) -> str:
    """A settings file with some values changed, and everything else as it was.

    values: by path; a number, a name, a truth value or a list of these. Raises KeyError for a path that it has not.
    """
    places = {path: node for path, _, node in _entries(yaml.compose(text, yaml.SafeLoader), ())}
    spans: List[Tuple[int, int, Any]] = [
        (places[path].start_mark.index, places[path].end_mark.index, value) for path, value in values.items()
    ]
    spans.sort(key=lambda span: -span[0])  # from the end, so that those before stay where they are
    for begin, end, value in spans:
        written = yaml.safe_dump(value, default_flow_style=True, width=1000).replace('\n...\n', '').strip()
        text = text[:begin] + written + text[end:]
    return text


def flat(settings: Mapping[str, Any]) -> Dict[str, Path]:
    """The path of each single value by a name for tools that know no groups: paper_yellow_low_hue."""
    return {'_'.join(_word(part) for part in path): path for path in _leaves(settings, ())}


def value_at(settings: Any, path: Path) -> Any:
    """The value at a path of nested settings."""
    for part in path:
        settings = settings[part]
    return settings


def changed(settings: Any, path: Path, value: Any) -> Any:
    """A copy of nested settings with another value at a path."""
    if not path:
        return value
    copy: Any = dict(settings) if isinstance(settings, Mapping) else list(settings)
    copy[path[0]] = changed(settings[path[0]], path[1:], value)
    return copy


def _entries(node: Any, above: Tuple[str, ...]) -> Iterator[Tuple[Tuple[str, ...], Any, Any]]:
    """(path, key's node, value's node) in order, a group before what is in it."""
    if not isinstance(node, yaml.MappingNode):
        return
    for key, value in node.value:
        path = above + (key.value,)
        yield path, key, value
        yield from _entries(value, path)


def _comment(lines: List[str], line: int, column: int) -> str:
    _, sign, first = lines[line][column:].partition('#')
    words = [first.strip()] if sign else []
    for below in lines[line + 1 :] if words else ():
        if not below.startswith(' ') or not below.strip().startswith('#'):  # at the margin it is of what follows
            break
        words.append(below.strip().lstrip('#').strip())
    return ' '.join(words)


def _leaves(settings: Any, above: Path) -> Iterator[Path]:
    if isinstance(settings, Mapping):
        for key, value in settings.items():
            yield from _leaves(value, above + (str(key),))
    elif isinstance(settings, (list, tuple)):
        yield from (above + (index,) for index in range(len(settings)))
    else:
        yield above


def _word(part: Union[str, int]) -> str:
    return part if isinstance(part, str) else COLOR_CHANNELS[part] if part < len(COLOR_CHANNELS) else str(part)
