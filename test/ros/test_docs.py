"""The documentation: every command line, link and picture in it is real, and the site builds without a warning."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import html
import importlib
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, Iterator, List, Optional, Set, Tuple
from unittest import mock
from xml.etree import ElementTree

import pytest
from helpers import REPOSITORY

from obst_avoid.core.settings_text import described

sys.path.append(str(REPOSITORY / 'docs'))
import reference

PAGES = [REPOSITORY / 'README.md', *sorted((REPOSITORY / 'docs').glob('*.md'))]
CONFIG = sorted((REPOSITORY / 'config').glob('*.yaml'))
LEFT_OUT = '…'
"""Stands in a command line for what the reader has to fill in."""
ADDED = {'avoid_right': 'avoid_all', 'orange': 'paper'}
"""What the examples of extending.md add, and what there is of its kind."""


def code_of(page: str) -> Iterator[str]:
    """What stands in a page as code: lines of blocks, continued ones joined, and what is between backticks."""
    page = re.sub(r'\\\n\s*', '', page)
    fenced = False
    for line in page.splitlines():
        if line.strip().startswith('```'):
            fenced = not fenced
        elif fenced or line.startswith('    '):
            yield line
        else:
            yield from re.findall('`([^`]+)`', line)


def commands_of(page: str) -> List[str]:
    """The calls of rosrun, roslaunch and make in a page."""
    plain = (re.sub(r'\$\([^()]*\)', 'X', code).split(' #')[0] for code in code_of(page))
    calls = (call.strip() for code in plain for call in re.split(r'&&|;|\|\|', code))
    return [call for call in calls if re.match('(rosrun obst_avoid|roslaunch .*obst_avoid|make) [a-z]', call)]


def why_wrong(command: str) -> Optional[str]:
    """What is not real in a command line, or None."""
    words = [ADDED.get(word, word) for word in shlex.split(command)]
    if words[0] == 'make':
        return why_no_target(words[1:])
    if words[0] == 'rosrun':
        return why_no_tool(words[2], words[3:])
    words = [word for word in words[1:] if not word.startswith('-')]
    return why_no_launch(words[1], words[2:])


def why_no_target(words: List[str]) -> Optional[str]:
    makefile = (REPOSITORY / 'Makefile').read_text()
    targets = set(re.findall('^([a-z0-9-]+):', makefile, re.MULTILINE))
    for word in words:
        name, sign, _ = word.partition('=')
        if sign and '$(%s)' % name not in makefile:
            return 'make knows no %s' % name
        if not sign and name not in targets:
            return 'make has no target %s' % name
    return None


def why_no_tool(name: str, arguments: List[str]) -> Optional[str]:
    if not (REPOSITORY / 'scripts' / name).is_file():
        return 'there is no scripts/%s' % name
    if name.endswith('_node') or not arguments:  # mentioned, not called
        return None
    if LEFT_OUT in arguments:
        known = reference.parser_of(name)._option_string_actions
        return next(
            ('%s has no %s' % (name, word) for word in arguments if word[:2] == '--' and word not in known), None
        )
    said: List[str] = []

    def parse(_: Any, parser: Any, given: Any = None) -> int:
        parser.parse_args(given)
        return 0

    with mock.patch('obst_avoid.offline.tool.run', parse), mock.patch('argparse.ArgumentParser._print_message') as told:
        try:
            importlib.import_module('obst_avoid.offline.' + name).main(arguments)
        except SystemExit as end:
            said = [str(call.args[0]) for call in told.call_args_list] if end.code else []
    return ' '.join(said).strip() or None


def why_no_launch(name: str, arguments: List[str]) -> Optional[str]:
    path = REPOSITORY / 'launch' / name
    if not path.is_file():
        return 'there is no launch/%s' % name
    args = ElementTree.parse(str(path)).getroot().findall('arg')
    declared = {arg.get('name'): arg.get('default') for arg in args if arg.get('value') is None}
    given = {word.partition(':=')[0] for word in arguments if word != LEFT_OUT}
    missing = [arg for arg, default in declared.items() if default is None and arg not in given]
    unknown = sorted(given - set(declared))
    if unknown:
        return '%s has no argument %s' % (name, unknown[0])
    return '%s is missing' % missing[0] if missing and arguments and LEFT_OUT not in arguments else None


COMMANDS = [(page.name, command) for page in PAGES for command in commands_of(page.read_text(encoding='utf-8'))]


@pytest.mark.parametrize(('page', 'command'), COMMANDS)
def test_a_command_is_one_that_there_is(page: str, command: str) -> None:
    assert why_wrong(command) is None


def test_there_are_commands_to_look_at() -> None:
    assert {'README.md', 'quick_start_robot.md', 'quick_start_laptop.md', 'quick_start_recordings.md'} <= {
        page for page, _ in COMMANDS
    }


def test_programs_of_ros_are_installed() -> None:
    words = {word for page in PAGES for code in code_of(page.read_text(encoding='utf-8')) for word in code.split()}
    named = {word for word in words if re.fullmatch('ros(bag|launch|node|pack|param|run|service|topic)', word)}
    assert {'rosnode', 'rosservice', 'rostopic'} <= named
    assert not {name for name in named if not shutil.which(name)}


@pytest.mark.parametrize(
    ('command', 'wanted'),
    [
        ('make demo', None),
        ('make dmeo', 'make has no target dmeo'),
        ('make demo RVIZ=1', None),
        ('make demo RIVZ=1', 'make knows no RIVZ'),
        ('rosrun obst_avoid detect_imags x.jpg', 'there is no scripts/detect_imags'),
        ('rosrun obst_avoid show_steps --output steps x.jpg', None),
        ('rosrun obst_avoid show_steps … --outputs steps', 'show_steps has no --outputs'),
        ('rosrun obst_avoid show_steps … --output steps', None),
        ('roslaunch obst_avoid daffy.launch veh:=a', None),
        ('roslaunch obst_avoid daffi.launch veh:=a', 'there is no launch/daffi.launch'),
        ('roslaunch obst_avoid daffy.launch veh:=a stag:=stop_only', 'daffy.launch has no argument stag'),
        ('roslaunch obst_avoid daffy.launch stage:=stop_only', 'veh is missing'),
    ],
)
def test_a_misspelt_command_is_found(command: str, wanted: Optional[str]) -> None:
    assert why_wrong(command) == wanted


@pytest.mark.parametrize(
    'command', ['show_steps --outputs steps x.jpg', 'show_steps x.jpg', 'bench --graph-seconds soon']
)
def test_what_a_tool_does_not_take_is_found(command: str) -> None:
    assert 'error' in str(why_wrong('rosrun obst_avoid ' + command))


def test_commands_are_found_in_blocks_tables_and_sentences() -> None:
    page = """
Call `make demo`, or:

    rosrun obst_avoid run_bag --output a.bag \\
      drive.bag   # a comment

| you want | `roslaunch obst_avoid replay.launch bag:=a.bag` |

```
source x && make test
```
"""
    assert commands_of(page) == [
        'make demo',
        'rosrun obst_avoid run_bag --output a.bag drive.bag',
        'roslaunch obst_avoid replay.launch bag:=a.bag',
        'make test',
    ]


def anchors_of(page: Path) -> Set[str]:
    """The names by which GitHub and the site link to a page's headings."""
    headings = re.findall('^#+ (.+)$', page.read_text(encoding='utf-8'), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


LINKS: List[Tuple[str, str]] = [
    (str(page.relative_to(REPOSITORY)), target)
    for page in PAGES
    for target in re.findall(r'\]\(([^)\s]+)\)', page.read_text(encoding='utf-8'))
    if not re.match('https?:', target)
]


@pytest.mark.parametrize(('page', 'target'), LINKS)
def test_a_link_leads_somewhere(page: str, target: str) -> None:
    path, _, anchor = target.partition('#')
    there = (REPOSITORY / page).parent / path if path else REPOSITORY / page
    assert there.is_file()
    if anchor:
        assert anchor in anchors_of(there)


def test_links_have_words() -> None:
    # The site would put the page's title there, GitHub puts nothing.
    assert [page.name for page in PAGES if re.search(r'[^!]\[\]\(', page.read_text(encoding='utf-8'))] == []


def test_pictures_are_small() -> None:
    sizes = {path.name: path.stat().st_size for path in (REPOSITORY / 'docs' / 'images').iterdir()}
    assert {name: size for name, size in sizes.items() if size > 150e3} == {}


def test_a_setting_without_a_comment_ends_the_build(tmp_path: Path) -> None:
    path = tmp_path / 'some_node.yaml'
    path.write_text('fast: 1.0  # m/s\ngroup:\n  slow: 0.5\n')
    with pytest.raises(reference.PageError, match='group/slow has no comment, expected its unit and reason'):
        reference.settings(str(path))


def test_a_group_whose_parts_say_nothing_of_their_own_is_one_row(tmp_path: Path) -> None:
    path = tmp_path / 'some_node.yaml'
    path.write_text('color:    # hue, saturation, value\n  low: [1, 2, 3]\n  high: [4, 5, 6]\n')
    assert '| `color` | `{low: [1, 2, 3], high: [4, 5, 6]}` | hue, saturation, value |' in reference.settings(str(path))


@pytest.fixture(scope='module')
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as `make docs` does."""
    for package in ('sphinx', 'myst_parser', 'furo', 'sphinx_copybutton'):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp('site')
    built = subprocess.run(
        [sys.executable, '-m', 'sphinx', '-W', '--keep-going', '-q', '-b', 'html', 'docs', str(folder)],
        cwd=str(REPOSITORY),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stdout
    return folder


def words_of(page: Path) -> Set[str]:
    return set(re.findall(r'[\w/]+', html.unescape(re.sub('<[^>]+>', ' ', page.read_text(encoding='utf-8')))))


@pytest.mark.parametrize('path', CONFIG, ids=lambda path: path.name)
def test_the_page_of_settings_names_every_setting(site: Path, path: Path) -> None:
    shown = words_of(site / 'settings.html')
    hidden = ('layouts',)  # what is too long for a table stands in the file
    named = [item.path for item in described(path.read_text(encoding='utf-8')) if item.path[0] not in hidden]
    assert [names for names in named if not {names[-1], '/'.join(names)} & shown] == []


def test_the_pages_show_every_message_launch_file_and_tool(site: Path) -> None:
    assert {path.stem for path in (REPOSITORY / 'msg').iterdir()} <= words_of(site / 'messages.html')
    text = (site / 'launch_files.html').read_text(encoding='utf-8')
    assert [path.name for path in (REPOSITORY / 'launch').iterdir() if path.name not in text] == []
    tools = {path.name for path in (REPOSITORY / 'scripts').iterdir() if not path.name.endswith('_node')}
    assert tools <= words_of(site / 'commands.html')


def test_links_within_the_site_lead_to_a_heading(site: Path) -> None:
    lost = []
    for page in site.glob('*.html'):
        for path, anchor in re.findall(r'href="([^":#]*)#([^"]+)"', page.read_text(encoding='utf-8')):
            there = (site / path) if path else page
            if there.suffix == '.html' and 'id="%s"' % anchor not in there.read_text(encoding='utf-8'):
                lost.append('%s: %s#%s' % (page.name, path, anchor))
    assert lost == []
