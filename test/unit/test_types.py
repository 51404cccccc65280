"""core.types: what a decision says."""

import pytest

from obst_avoid.core.types import State, in_words


@pytest.mark.parametrize(
    'state, reason, words',
    [
        (State.CLEAR, 'clear: no obstacle in the lane', 'CLEAR: no obstacle in the lane'),
        (State.CLEAR, '', 'CLEAR: '),
        (State.STOPPED, 'stopping: 1 obstacle: near', 'STOPPED: stopping: 1 obstacle: near'),
        (State.AVOIDING, 'passing: keeping', 'AVOIDING: passing: keeping'),
        (State.SLOWING, 'slowing', 'SLOWING: slowing'),
    ],
)
def test_a_decision_in_one_line(state: State, reason: str, words: str) -> None:
    assert in_words(state, reason) == words
