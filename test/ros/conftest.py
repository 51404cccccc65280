"""Fixtures of the tests of tools."""

from __future__ import annotations  # the robot's pytest does not export its fixtures' types

from typing import Callable

import pytest


@pytest.fixture
def sentence(capsys: pytest.CaptureFixture) -> Callable[[str], str]:
    """Of a tool that failed: the one line on stderr, beginning with the tool's name."""

    def read(tool: str) -> str:
        lines = [line for line in capsys.readouterr().err.splitlines() if line.strip()]
        assert len(lines) == 1, lines
        assert lines[0].startswith(tool + ': ')
        return lines[0]

    return read
