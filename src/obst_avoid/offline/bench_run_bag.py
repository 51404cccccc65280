"""bench's third part: pictures a second of run_bag, by processes that work at the same time, each on a bag."""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from typing import Any, Dict, List, Sequence

import rosbag

from obst_avoid.offline import tool
from obst_avoid.offline.recording import JPEG, TOPICS
from obst_avoid.ros import border

PICTURES, RATE = 300, 30.0
PROCESSES = (1, 2)
COMMAND = 'import sys; from obst_avoid.offline.run_bag import main; sys.exit(main())'


def bench_run_bag(options: argparse.Namespace, jpegs: Sequence[bytes]) -> Dict[str, Any]:
    """Time the tool as a person starts it; prints a table and returns its figures.

    What a process takes to start is what it takes for a bag of one picture.
    """
    result: Dict[str, Any] = {'with_start': {}}
    with tempfile.TemporaryDirectory() as folder:
        bags = [_write(os.path.join(folder, '%d.bag' % count), jpegs, count) for count in (1, PICTURES)]
        print('\nrun_bag, pictures a second               steady   with start  (bags of %d)' % PICTURES)
        for processes in PROCESSES:
            start, whole = (_timed(options, bag, processes) for bag in bags)
            steady = processes * (PICTURES - 1) / max(whole - start, 1e-3)
            result[str(processes)] = round(steady, 1)
            result['with_start'][str(processes)] = round(processes * PICTURES / whole, 1)
            words = '%d process%s, a bag each' % (processes, 'es'[: 2 * (processes > 1)])
            print('%-38s %8.1f %12.1f' % (words, steady, processes * PICTURES / whole))
    return result


def _write(path: str, jpegs: Sequence[bytes], count: int) -> str:
    with rosbag.Bag(path, 'w') as bag:
        for index in range(count):
            stamp = tool.stamp_of_frame(index, RATE)
            msg = border.compressed_image_from_jpeg(jpegs[index % len(jpegs)], stamp, border.camera_frame('bench'))
            bag.write('/bench/' + TOPICS[JPEG], msg, border.ros_time(stamp))
    return path


def _timed(options: argparse.Namespace, bag: str, processes: int) -> float:
    """[s] until the last of them has ended."""
    call: List[str] = [sys.executable, '-c', COMMAND, bag]
    for name in ('calibration', 'vehicle', 'config', 'profile', 'stage'):
        value = getattr(options, name)
        call += ['--%s=%s' % (name, value)] if value else []
    begin = time.perf_counter()
    with ExitStack() as ended:
        running = [
            ended.enter_context(subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True))
            for _ in range(processes)
        ]
        said = [process.communicate()[0] for process in running]
    if any(process.returncode for process in running):
        raise tool.ToolError('run_bag failed on the pictures: %s' % (said[0].strip().splitlines() or ['no word'])[-1])
    return time.perf_counter() - begin
