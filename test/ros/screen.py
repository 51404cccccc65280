"""A screen that is none: what a program with windows shows, as a picture."""

import os
import shutil
import struct
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

MISSING = [program for program in ('Xvfb', 'rviz') if shutil.which(program) is None]
"""Programs that the tests of what rviz shows need, and this machine has not."""


class Screen:
    """An X server in memory, on a display of its own. Ends with the block.

    display: its name, for DISPLAY. It keeps its picture in a file in the format of xwd.
    """

    def __init__(self, width: int = 1280, height: int = 900) -> None:
        self._folder = tempfile.mkdtemp()
        read, write = os.pipe()
        call = ['Xvfb', '-displayfd', str(write), '-screen', '0', '%dx%dx24' % (width, height), '-nolisten', 'tcp']
        self._process = subprocess.Popen(
            [*call, '-fbdir', self._folder],
            pass_fds=[write],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(write)
        with os.fdopen(read) as file:
            number = file.readline().strip()
        assert number, 'Xvfb does not start'
        self.display = ':' + number

    def __enter__(self) -> 'Screen':
        return self

    def __exit__(self, *_: Any) -> None:
        self._process.terminate()
        self._process.wait()
        shutil.rmtree(self._folder, ignore_errors=True)

    def picture(self) -> Any:
        """(H, W, 3) uint8, BGR, of now."""
        data = (Path(self._folder) / 'Xvfb_screen0').read_bytes()
        header = struct.unpack('>25I', data[:100])
        size, width, height, bits, row, colors = header[0], header[4], header[5], header[11], header[12], header[19]
        assert (header[1], bits, header[7]) == (7, 32, 0), 'a version, depth or byte order of xwd that is not known'
        pixels = np.frombuffer(data, np.uint8, row * height, size + 12 * colors)
        return np.ascontiguousarray(pixels.reshape(height, row // 4, 4)[:, :width, :3])

    def write(self, path: str) -> None:
        """Keep what is shown, for a person to look at."""
        cv2.imwrite(path, self.picture())
