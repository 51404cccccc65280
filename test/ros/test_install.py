"""The install space, and an ordinary catkin workspace: what is not in the devel space's layout is missing there."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

import os
import shutil
import subprocess
from pathlib import Path
from typing import List

import pytest
from helpers import REPOSITORY, jpeg_of

PLAIN = {'PATH': '/usr/bin:/bin', 'HOME': os.environ.get('HOME', '/')}
NOETIC = '[ ! -f /opt/ros/noetic/setup.bash ] || source /opt/ros/noetic/setup.bash; '


def shell(command: str, folder: Path, seconds: float = 120) -> str:
    """Run in a bare environment. Fails unless it ends with success."""
    ended = subprocess.run(
        ['bash', '-c', 'set -e; ' + NOETIC + command],
        cwd=str(folder),
        env=PLAIN,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=seconds,
        check=False,
    )
    output = ended.stdout.decode(errors='replace')
    assert ended.returncode == 0, output[-3000:]
    return output


def works(setup: Path, folder: Path) -> None:
    """A tool, a launch file and the compiled loops, from where setup leads."""
    (folder / 'a.jpg').write_bytes(jpeg_of())
    shell(
        'source %s; rosrun obst_avoid detect_images --calibration $(rospack find obst_avoid)/config/calibrations '
        '--vehicle default --output found.json a.jpg' % setup,
        folder,
    )
    assert '"kind": "duckie"' in (folder / 'found.json').read_text()
    nodes = shell('source %s; roslaunch --nodes obst_avoid daffy.launch veh:=duck1' % setup, folder).split()
    assert '/duck1/daffy_adapter_node' in nodes
    nodes = shell('source %s; roslaunch --nodes obst_avoid simulation.launch' % setup, folder).split()
    assert '/simulated/simulator_node' in nodes
    where: List[str] = shell(
        'source %s; /usr/bin/python3 -c "import obst_avoid; from obst_avoid.core.detection.robust import native; '
        'print(obst_avoid.__file__); print(native.LIBRARY is not None)"' % setup,
        folder,
    ).split()
    assert where[-1] == 'True', where


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A copy without what was built here."""
    ignored = shutil.ignore_patterns('build', '.git', '__pycache__', '.*_cache', '.hypothesis')
    return Path(shutil.copytree(str(REPOSITORY), str(tmp_path / 'source' / 'obst_avoid'), ignore=ignored))


def test_the_install_space(source: Path, tmp_path: Path) -> None:
    prefix = tmp_path / 'install'
    shell(
        'cmake -S %s -B build -DPYTHON_EXECUTABLE=/usr/bin/python3 -DCMAKE_INSTALL_PREFIX=%s; '
        'cmake --build build; cmake --install build' % (source, prefix),
        tmp_path,
    )
    shutil.rmtree(str(source))
    shutil.rmtree(str(tmp_path / 'build'))
    works(prefix / 'setup.bash', tmp_path)


def test_an_ordinary_workspace(source: Path, tmp_path: Path) -> None:
    workspace = tmp_path / 'workspace'
    (workspace / 'src').mkdir(parents=True)
    source.rename(workspace / 'src' / 'obst_avoid')
    shell('catkin_make -DPYTHON_EXECUTABLE=/usr/bin/python3', workspace)
    works(workspace / 'devel' / 'setup.bash', tmp_path)
