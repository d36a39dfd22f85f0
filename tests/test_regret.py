"""What a choice was worth."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.experiment.regret import choice, regret, regrets

TRUTHS = ("appropriate", "inappropriate")


def row(truth: str, verdict: str, score: float | None, **more: Any) -> dict[str, Any]:
    return {
        "truth": truth,
        "verdict": verdict,
        "score": score,
        "student": "s",
        "cell": "c",
        "trial": 0,
        **more,
    }


LIKE, UNLIKE = "appropriate", "inappropriate"


@pytest.mark.parametrize(
    ("world", "expected"),
    [
        ([(LIKE, LIKE, 2.0), (UNLIKE, UNLIKE, -1.0)], 0),
        ([(LIKE, LIKE, 2.0), (UNLIKE, LIKE, 3.0)], 2),
        ([(LIKE, UNLIKE, -2.0), (UNLIKE, UNLIKE, -3.0)], 1),
        ([(UNLIKE, UNLIKE, -2.0), (UNLIKE, UNLIKE, -3.0)], 0),
        ([(UNLIKE, LIKE, 2.0)], 1),
        ([(LIKE, UNLIKE, None)], 1),  # never found
        ([], 0),
    ],
)
def test_regret_by_hand(world: list[tuple[str, str, float | None]], expected: int) -> None:
    assert regret([row(*one) for one in world]) == expected


@given(
    st.lists(
        st.tuples(st.sampled_from(TRUTHS), st.sampled_from(TRUTHS), st.floats(-5, 5)), min_size=1, max_size=8
    )
)
def test_nobody_does_better_than_who_knows(world: list[tuple[str, str, float]]) -> None:
    rows = [row(*one) for one in world]
    assert 0 <= regret(rows) <= 2
    assert regret([{**one, "verdict": one["truth"]} for one in rows]) == 0
    chosen = choice(rows)
    assert chosen is None or chosen["verdict"] == LIKE


def test_worlds_are_told_apart() -> None:
    rows = [
        row(LIKE, LIKE, 1.0, trial=1),
        row(LIKE, UNLIKE, -1.0, trial=0),
        row(UNLIKE, LIKE, 1.0, student="other"),
    ]
    assert regrets(rows) == {"s": [1, 0], "other": [1]}
