"""What the site shows of the package's own files: made at build time, so that it cannot go stale.

A line `<!-- KIND: NAME -->` of a page, which nobody sees on GitHub, becomes a table or a text made from a file:

    settings: config/NAME.yaml      one row a setting, from its comment
    message: NAME                   one row a field, from the comments of msg/NAME.msg
    launch: NAME.launch             one row an argument, from its doc attribute
    tool: NAME                      what `NAME --help` prints
    readme: HEADING                 that section of the README, without its heading, up to <!-- README only -->
"""

import argparse
import importlib
import os
import re
from pathlib import Path
from typing import Any, Callable, Dict, List, Sequence, Tuple
from unittest import mock
from xml.etree import ElementTree

import yaml

from obst_avoid.core.settings_text import described, value_at

LONGEST = 60
"""Characters of a value in a table."""
Names = Tuple[str, ...]
ROOT = Path(__file__).resolve().parents[1]
_MARK = re.compile(r'^<!-- (settings|message|launch|tool|readme): (.+) -->$', re.MULTILINE)


class PageError(RuntimeError):
    """A file does not say what the site has to show. The message names the file and the place."""


def filled(page: str) -> str:
    """A page with every mark replaced. Raises PageError."""
    return _MARK.sub(lambda mark: _MAKERS[mark.group(1)](mark.group(2)), page)


def settings(path: str) -> str:
    """A table for each group of settings in a YAML file; groups within the file get a heading.

    A group that has a comment, and nothing in it has another, is a single row.
    """
    text = (ROOT / path).read_text(encoding='utf-8')
    content = yaml.safe_load(text)
    comments = {item.path: item.comment for item in described(text)}
    rows: Dict[Names, List[Sequence[str]]] = {}
    whole: List[Names] = []
    for names, comment in comments.items():
        within = [inner for inner in comments if inner[: len(names)] == names and inner != names]
        if any(names[: len(above)] == above for above in whole):
            continue
        if within and (not comment or any(comments[inner] not in ('', comment) for inner in within)):
            rows.setdefault(names, [])
            continue
        if not comment:
            raise PageError('%s: %s has no comment, expected its unit and reason' % (path, '/'.join(names)))
        whole += [names] if within else []
        row = ['`%s`' % names[-1], _shown(value_at(content, names)), _sentence(comment)]
        rows.setdefault(names[:-1], []).append(row)
    parts: List[str] = []
    for group, table in rows.items():
        if table:
            parts += ['### %s' % '/'.join(group)] if group and group != (Path(path).stem,) else []
            parts += [_sentence(comments[group])] if comments.get(group) else []
            parts.append(_table(['setting', 'as shipped', 'unit, meaning and reason'], table))
    return '\n\n'.join(parts)


def message(name: str) -> str:
    """A table of a message's fields, and one of its constants if it has any."""
    constants, fields, about = [], [], []
    for line in (ROOT / 'msg' / (name + '.msg')).read_text(encoding='utf-8').splitlines():
        code, _, comment = (part.strip() for part in line.partition('#'))
        if not code:
            about += [comment] if comment else []
            continue
        kind, rest = code.split(None, 1)
        row = ['`%s`' % rest.replace('=', ' = '), '`%s`' % kind, _sentence(comment)]
        (constants if '=' in rest else fields).append(row)
    parts = [' '.join(about), _table(['field', 'type', 'meaning'], fields)]
    if constants:
        parts.append(_table(['constant', 'type', 'meaning'], constants))
    return '\n\n'.join(parts)


def launch(name: str) -> str:
    """What a launch file's first comment says, and a table of its arguments."""
    text = (ROOT / 'launch' / name).read_text(encoding='utf-8')
    about = re.search('<!--(.*?)-->', text, re.DOTALL)
    rows = []
    for argument in ElementTree.fromstring(text).findall('arg'):
        if argument.get('value') is not None:  # the file's own, nobody can give it
            continue
        if not argument.get('doc'):
            raise PageError('launch/%s: %s has no doc, expected what it is for' % (name, argument.get('name')))
        default = argument.get('default')
        shown = 'has to be given' if default is None else '`%s`' % default if default else 'empty'
        rows.append(['`%s`' % argument.get('name'), shown, _sentence(str(argument.get('doc')))])
    words = ' '.join(about.group(1).split()) if about else ''
    return '%s\n\n%s' % (re.sub('(<.*?>)', r'`\1`', words), _table(['argument', 'default', 'meaning'], rows))


def tool(name: str) -> str:
    """What --help prints."""
    with mock.patch.dict(os.environ, COLUMNS='88'):
        return '```text\n%s```' % parser_of(name).format_help()


def parser_of(name: str) -> argparse.ArgumentParser:
    """The argument parser of a tool, without running the tool."""

    class Parsing(Exception):  # noqa: N818 - it ends main where it would parse
        pass

    def parse(parser: argparse.ArgumentParser, *_: Any) -> None:
        raise Parsing(parser)

    with mock.patch.object(argparse.ArgumentParser, 'parse_args', parse):
        try:
            importlib.import_module('obst_avoid.offline.' + name).main([])
        except Parsing as found:
            return found.args[0]  # type: ignore[no-any-return]
    raise PageError('%s parses no arguments, expected a tool' % name)


def readme(heading: str) -> str:
    """The README's section of that heading; links lead from here instead of from there."""
    sections = re.split('^## (.+)$', (ROOT / 'README.md').read_text(encoding='utf-8'), flags=re.MULTILINE)[1:]
    if heading not in sections[::2]:
        raise PageError('README.md has no section %s, expected one of: %s' % (heading, ', '.join(sections[::2])))
    text = sections[2 * sections[::2].index(heading) + 1].split('<!-- README only -->')[0].strip()
    return re.sub(r'\]\((?!http|#)', '](../', text).replace('](../docs/', '](')


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ['---'] * len(head), *([cell.replace('|', r'\|') for cell in row] for row in rows)]
    return '\n'.join('| %s |' % ' | '.join(line) for line in lines)


def _shown(value: Any) -> str:
    """A value as YAML writes it, where that is short."""
    text = (
        str(yaml.safe_dump(value, default_flow_style=True, width=10000, sort_keys=False)).replace('\n...', '').strip()
    )
    return '`%s`' % text if len(text) <= LONGEST else 'see the file'


def _sentence(comment: str) -> str:
    """A comment on one line, in which nothing is taken for markup."""
    return re.sub(r'([*_<>\[\]])', r'\\\1', ' '.join(comment.split()))


_MAKERS: Dict[str, Callable[[str], str]] = {
    'settings': settings,
    'message': message,
    'launch': launch,
    'tool': tool,
    'readme': readme,
}
