"""The page's sentences about verdicts follow the rows."""

from __future__ import annotations

from typing import Any

import pytest

from testbed.report.words import explanation

LIKE, UNLIKE = "appropriate", "inappropriate"


def rows(*worlds: tuple[tuple[str, str], ...], student: str = "like_me") -> list[dict[str, Any]]:
    return [
        {"student": student, "cell": "default", "trial": trial, "teacher": f"teacher_{number}", "robot": "crawler",
         "truth": truth, "verdict": verdict, "score": float(verdict == LIKE), "found": True, "chosen": False}
        for trial, world in enumerate(worlds)
        for number, (truth, verdict) in enumerate(world)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("world", "told"),
    [
        (((LIKE, LIKE), (UNLIKE, UNLIKE)), "0 of at most 2, no other would have been better."),
        (
            ((LIKE, UNLIKE), (UNLIKE, UNLIKE)),
            "1 of at most 2, nobody while an appropriate teacher was there.",
        ),
        (((UNLIKE, LIKE),), "1 of at most 2, a teacher while none was appropriate."),
        (
            ((LIKE, UNLIKE), (UNLIKE, LIKE)),
            "2 of at most 2, an inappropriate teacher while an appropriate one",
        ),
    ],
)
def test_one_trial_tells_the_regret_of_its_choice(world: tuple[tuple[str, str], ...], told: str) -> None:
    assert f"Regret of its choice: {told}" in explanation(rows(world))
    assert f"of {len(world)} (regret {told[0]})" in explanation(rows(world), rows(world, student="paper"))


def test_several_trials_tell_it_in_their_table() -> None:
    both = ((LIKE, LIKE),), ((LIKE, UNLIKE),)
    assert "egret" not in explanation(rows(*both), rows(*both, student="paper"))
