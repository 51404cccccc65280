"""Settings: frozen dataclasses whose fields carry their own checks, loaded whole from a mapping or a YAML file.

A field has no default: tuned numbers live in config/*.yaml and nowhere else.
"""

import dataclasses
import difflib
import operator
import sys
from typing import Any, Callable, Dict, Mapping, Optional, Tuple, Type, TypeVar

import yaml

S = TypeVar('S')
_CHECK = 'check'


class SettingsError(ValueError):
    """A setting is missing, misspelt, mistyped or out of range. The message names it in full."""


def number(
    unit: str,
    above: Optional[float] = None,
    at_least: Optional[float] = None,
    below: Optional[float] = None,
    at_most: Optional[float] = None,
) -> Any:
    """A field that holds a finite number within the given limits."""
    limits = [
        (above, '>', operator.gt),
        (at_least, '>=', operator.ge),
        (below, '<', operator.lt),
        (at_most, '<=', operator.le),
    ]
    given = [(limit, sign, holds) for limit, sign, holds in limits if limit is not None]
    wanted = ' '.join(['a number'] + [' and '.join('%s %g' % (sign, limit) for limit, sign, _ in given)]).strip()
    wanted = '%s (%s)' % (wanted, unit)

    def check(value: Any, where: str) -> float:
        usable = isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
        if not usable or not all(holds(value, limit) for limit, _, holds in given):
            raise SettingsError('%s = %r, expected %s' % (where, value, wanted))
        return float(value)

    return checked(check)


def integers(count: int, at_least: int, at_most: int) -> Any:
    """A field that holds a tuple of so many whole numbers within the given limits, both included."""

    def check(value: Any, where: str) -> Any:
        usable = isinstance(value, (list, tuple)) and len(value) == count
        if not usable or not all(type(v) is int and at_least <= v <= at_most for v in value):
            raise SettingsError(
                '%s = %r, expected %d whole numbers from %d to %d' % (where, value, count, at_least, at_most)
            )
        return tuple(value)

    return checked(check)


def integer(at_least: int) -> Any:
    """A field that holds a whole number, at_least or greater."""

    def check(value: Any, where: str) -> int:
        if type(value) is not int or value < at_least:
            raise SettingsError('%s = %r, expected a whole number >= %d' % (where, value, at_least))
        return value

    return checked(check)


def choice(*names: str) -> Any:
    """A field that holds one of the given names."""

    def check(value: Any, where: str) -> str:
        if value not in names:
            raise SettingsError('%s = %r, expected one of: %s' % (where, value, ', '.join(names)))
        return str(value)

    return checked(check)


def text() -> Any:
    """A field that holds text, possibly empty."""

    def check(value: Any, where: str) -> str:
        if not isinstance(value, str):
            raise SettingsError('%s = %r, expected text' % (where, value))
        return value

    return checked(check)


def names() -> Any:
    """A field that holds a list of words."""

    def check(value: Any, where: str) -> Tuple[str, ...]:
        if not isinstance(value, (list, tuple)) or not all(isinstance(item, str) and item for item in value):
            raise SettingsError('%s = %r, expected a list of names' % (where, value))
        return tuple(value)

    return checked(check)


def flag() -> Any:
    """A field that holds true or false."""

    def check(value: Any, where: str) -> bool:
        if not isinstance(value, bool):
            raise SettingsError('%s = %r, expected true or false' % (where, value))
        return value

    return checked(check)


def group(settings: Type[Any]) -> Any:
    """A field that holds a settings class of its own, a nested mapping in YAML."""
    return checked(lambda value, where: load(settings, value, where))


def load(settings: Type[S], mapping: Any, where: str) -> S:
    """Build a settings object from a mapping, checked whole.

    where: the mapping's full name (a ROS namespace or a file), for the messages.
    Raises SettingsError for the first thing that is missing, misspelt, mistyped or out of range.
    """
    if not isinstance(mapping, Mapping):
        raise SettingsError('%s = %r, expected a mapping of settings' % (where, mapping))
    checks: Dict[str, Callable[[Any, str], Any]] = {
        field.name: field.metadata[_CHECK] for field in dataclasses.fields(settings)
    }
    for name in mapping:
        if name not in checks:
            near = difflib.get_close_matches(str(name), list(checks), 1)
            hint = ', did you mean %s?' % near[0] if near else ', expected one of: ' + ', '.join(sorted(checks))
            raise SettingsError('%s/%s is not a setting%s' % (where, name, hint))
    for name in checks:
        if name not in mapping:
            raise SettingsError('%s/%s is missing' % (where, name))
    return settings(**{name: check(mapping[name], '%s/%s' % (where, name)) for name, check in checks.items()})


def read_yaml(path: str) -> Any:
    """The content of one YAML file, loaded safely. Raises SettingsError, in one sentence, when it cannot be had."""
    try:
        with open(path, encoding='utf-8') as file:
            return yaml.safe_load(file)
    except OSError as error:
        raise SettingsError('%s cannot be read: %s' % (path, error.strerror)) from error
    except (
        yaml.YAMLError,
        ValueError,
        RecursionError,
    ) as error:  # 2019-13-01, bytes
        mark = getattr(error, 'problem_mark', None)
        line = '' if mark is None else ' at line %d' % (mark.line + 1)
        raise SettingsError('%s does not parse as YAML%s' % (path, line)) from error


def checked(check: Callable[[Any, str], Any]) -> Any:
    """A field with a check of its own: it gets the value and its full name, and returns what the field shall hold."""
    return dataclasses.field(metadata={_CHECK: check})
