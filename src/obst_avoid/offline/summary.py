"""What happened in a drive, in numbers."""

import statistics
from typing import Any, Dict, List, Sequence

from obst_avoid.core.types import Decision, Obstacle, State


def summarise(
    pictures: int,
    obstacle_lists: Sequence[Sequence[Obstacle]],
    decisions: Sequence[Decision],
    latencies: Sequence[float],
    skipped: int = 0,
) -> Dict[str, Any]:
    """Count what the detector saw and what the avoider did.

    pictures: that were shown. obstacle_lists: one a picture that was worked on. decisions: in order of time.
    latencies: [s] from each picture to its decision. skipped: pictures that could not be used.
    A stop is the change into STOPPED; a release is the change from STOPPED to driving, CLEAR or AVOIDING.
    """
    found = [obstacle for obstacles in obstacle_lists for obstacle in obstacles]
    states = [decision.state for decision in decisions]
    changes = [(before, after) for before, after in zip(states, states[1:]) if before is not after]
    active = [decision.active for decision in decisions]
    driving = (State.CLEAR, State.SLOWING, State.AVOIDING)
    return {
        'pictures': pictures,
        'pictures_answered': len(obstacle_lists),
        'pictures_skipped': skipped,
        'obstacles_inside': sum(obstacle.in_lane is not False for obstacle in found),
        'obstacles_outside': sum(obstacle.in_lane is False for obstacle in found),
        'activations': sum(after and not before for before, after in zip(active, active[1:])),
        'stops': sum(after is State.STOPPED for _, after in changes),
        'releases': sum(before is State.STOPPED and after in driving for before, after in changes),
        'faults': sum(after is State.FAULT for _, after in changes),
        'median_latency_ms': round(1e3 * statistics.median(latencies), 1) if latencies else None,
    }


def table(summary: Dict[str, Any]) -> str:
    """The summary for a terminal."""
    lines: List[str] = []
    for name, value in summary.items():
        words = name.replace('_ms', ' [ms]').replace('_gap_m', '_gap [m]').replace('_', ' ')
        lines.append('  %-25s %s' % (words, 'none' if value is None else value))
    return '\n'.join(lines)
