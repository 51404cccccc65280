"""Tools on a disk that is full: one sentence, exit code 1, and no half file under the name that was asked for."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any, List

import pytest
from helpers import REPOSITORY, jpeg_of

CALIBRATION = ['--calibration', str(REPOSITORY / 'config' / 'calibrations'), '--vehicle', 'default']
ROOM = 3000
"""[bytes] that fit into a file."""


def full() -> None:
    """A file may not grow beyond ROOM: writing fails as on a full disk, if with another number."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, ROOM))


def run(call: List[str], **options: Any) -> subprocess.CompletedProcess:
    script = [sys.executable, str(REPOSITORY / 'scripts' / call[0]), *call[1:]]
    environment = dict(os.environ, PYTHONDONTWRITEBYTECODE='1')
    return subprocess.run(script, capture_output=True, timeout=120, check=False, env=environment, **options)


@pytest.fixture(scope='module')
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of them, and a bag."""
    folder = tmp_path_factory.mktemp('disk')
    (folder / 'pictures').mkdir()
    for index in range(3):
        (folder / 'pictures' / ('%d.jpg' % index)).write_bytes(jpeg_of())
    made = run(['images_to_bag', '--output', str(folder / 'good.bag'), str(folder / 'pictures')])
    assert made.returncode == 0, made.stderr
    return folder


CALLS = {
    'detect_images': ['detect_images', *CALIBRATION, '--output', '{out}', *['{folder}/pictures'] * 40],
    'detect_images, annotated': [
        'detect_images', *CALIBRATION, '--output', '{out}', '--annotated', '{out}.d', '{folder}/pictures',
    ],
    'images_to_bag': ['images_to_bag', '--output', '{out}', '{folder}/pictures'],
    'bag_to_images': ['bag_to_images', '--output', '{out}', '{folder}/good.bag'],
    'run_bag': ['run_bag', *CALIBRATION, '--output', '{out}', '{folder}/good.bag'],
    'show_steps': ['show_steps', *CALIBRATION, '--output', '{out}', '{folder}/pictures/0.jpg'],
}  # fmt: skip


@pytest.mark.parametrize('name', CALLS)
def test_a_full_disk(name: str, pictures: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out'
    call = [part.format(out=out, folder=pictures) for part in CALLS[name]]
    ended = run(call, preexec_fn=full)
    said = [line for line in ended.stderr.decode().splitlines() if line.startswith(call[0] + ': ')]
    assert ended.returncode == 1, ended.stderr
    assert 'Traceback' not in ended.stderr.decode(), ended.stderr
    assert len(said) == 1, ended.stderr
    assert not out.is_file(), 'a half file'
