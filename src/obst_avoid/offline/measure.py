"""What the parts of bench measure with: percentiles, and what a process has used so far."""

import os
from typing import Dict, Sequence, Union

import numpy as np

PAGE, TICKS = (os.sysconf(name) for name in ('SC_PAGE_SIZE', 'SC_CLK_TCK'))


def percentiles(milliseconds: Sequence[float]) -> Dict[str, float]:
    """Median, p95 and p99 [ms], by name."""
    median, p95, p99 = np.percentile(milliseconds, [50, 95, 99])
    return {'median_ms': round(float(median), 4), 'p95_ms': round(float(p95), 4), 'p99_ms': round(float(p99), 4)}


def resident(pid: Union[int, str] = 'self') -> float:
    """[MB] of memory that a process has now. Raises OSError when it is gone."""
    with open('/proc/%s/statm' % pid, encoding='ascii') as file:
        return int(file.read().split()[1]) * PAGE / 1e6


def cpu_seconds(pid: int) -> float:
    """[s] that all threads of a process have computed since it began. Raises OSError when it is gone."""
    with open('/proc/%d/stat' % pid, encoding='utf-8', errors='replace') as file:
        fields = file.read().rpartition(')')[2].split()  # the name before that may hold anything
    return (int(fields[11]) + int(fields[12])) / TICKS
