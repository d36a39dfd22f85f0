"""The report's sentences follow the numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.report.claims import Claim, claims
from testbed.report.reading import Trial
from testbed.report.series import start_end, teacher_series
from testbed.report.words import explanation, headline

SELF, MODEL_YES, MODEL_NO, CONTROLLER_YES, CONTROLLER_NO, CHANCE = range(6)


def rows(
    trials: int = 12,
    *,
    self_end: float = 0.1,
    model_end: float = 0.1,
    yes_end: float = 0.2,
    no_end: float = 1.0,
    noise: float = 0.01,
    wrong: int = 0,
) -> list[dict[str, Any]]:
    """Rows whose errors all start at 1 and end at what is asked for; the last ``wrong`` verdicts are wrong."""
    rng = np.random.default_rng(5)
    made = []
    for trial in range(trials):
        for index, truth in enumerate(("appropriate", "inappropriate")):
            end = yes_end if truth == "appropriate" else no_end
            made.append(
                {
                    "trial": trial, "cell": "default", "student": "paper", "teacher": f"teacher_{index}",
                    "robot": "crawler", "truth": truth, "verdict": truth, "score": 0.5, "found": True,
                    "chosen": truth == "appropriate",
                    "self_error_initial": 1.0, "self_error_final": self_end + rng.normal(0, noise),
                    "model_position_error_initial": 1.0,
                    "model_position_error_final": model_end + rng.normal(0, noise),
                    "objective_initial_error": 1.0, "objective_final_error": end + rng.normal(0, noise),
                }
            )  # fmt: skip
    opposite = {"appropriate": "inappropriate", "inappropriate": "appropriate"}
    for row in made[len(made) - wrong :]:
        row["verdict"] = opposite[str(row["truth"])]
    return made


def outcomes(found: tuple[Claim, ...]) -> list[str]:
    return [claim.outcome for claim in found]


def test_everything_that_the_paper_saw_is_reproduced() -> None:
    assert outcomes(claims(rows())) == ["reproduced"] * 6


@pytest.mark.parametrize(
    ("change", "which"),
    [
        ({"self_end": 1.01}, [SELF]),
        ({"self_end": 2.0}, [SELF]),
        ({"model_end": 1.0}, [MODEL_YES, MODEL_NO]),
        ({"yes_end": 1.0}, [CONTROLLER_YES]),
        ({"yes_end": 1.5}, [CONTROLLER_YES]),
        ({"no_end": 0.5}, [CONTROLLER_NO]),
        ({"no_end": 1.5}, [CONTROLLER_NO]),
        ({"wrong": 14}, [CHANCE]),
        ({"wrong": 24}, [CHANCE]),
    ],
)
def test_each_claim_turns_with_its_own_numbers(change: dict[str, Any], which: list[int]) -> None:
    expected = ["not reproduced" if index in which else "reproduced" for index in range(6)]
    assert outcomes(claims(rows(**change))) == expected


def test_right_verdicts_are_counted_by_trial() -> None:
    # 18 of 25 single verdicts would beat a coin; in five trials of five that agree nearly, they need not.
    made = [dict(row, trial=number // 5) for number, row in enumerate(rows(25)[:25])]
    for number, row in enumerate(made):
        row["verdict"] = row["truth"] if number < 16 or number > 22 else "neither"
    by_trial = claims(made)[CHANCE]
    single = claims([dict(row, trial=number) for number, row in enumerate(made)])[CHANCE]
    assert "18 of 25 verdicts were right" in by_trial.finding
    assert single.outcome == "reproduced"
    assert by_trial.outcome != "reproduced"


@pytest.mark.parametrize("values", [[np.nan, 1.0], [1.0, np.inf]])
def test_a_teacher_without_numbers_does_not_lose_its_trial(tmp_path: Path, values: list[float]) -> None:
    np.savez(tmp_path / "0.npz", **{"a/x": np.array([1.0, 3.0]), "b/x": np.array(values)})
    two = tuple({"teacher": name, "truth": "appropriate"} for name in "ab")
    series = teacher_series([Trial("default", 0, tmp_path / "0.npz", two)], "appropriate", "x")
    assert series is not None
    assert series.curves.tolist() == [[1.0, 3.0]]
    assert teacher_series([Trial("default", 0, tmp_path / "0.npz", two[1:])], "appropriate", "x") is None


@pytest.mark.parametrize("trials", [1, 2, 5])
def test_few_trials_cannot_show_a_change(trials: int) -> None:
    found = claims(rows(trials))
    assert outcomes(found)[:5] == ["cannot tell"] * 5
    assert f"N = {trials}" in found[SELF].finding


def test_a_wide_interval_is_not_called_flat() -> None:
    # Not significant, yet a change of a half is not excluded: absence of evidence.
    assert claims(rows(8, noise=0.8))[CONTROLLER_NO].outcome == "cannot tell"


def test_without_inappropriate_teachers_their_claims_cannot_be_told() -> None:
    found = claims([row for row in rows() if row["truth"] == "appropriate"])
    assert found[CONTROLLER_NO].outcome == found[MODEL_NO].outcome == "cannot tell"
    assert "no numbers" in found[CONTROLLER_NO].finding


def test_findings_carry_the_numbers_of_the_test() -> None:
    test = start_end(rows(), "self_error_initial", "self_error_final")
    assert test is not None
    finding = claims(rows())[SELF].finding
    assert finding.startswith(f"It fell from {test.start_mean:.3g} to {test.end_mean:.3g} m")
    assert "N = 12" in finding
    assert "p < 0.001" in finding


def test_teachers_of_one_trial_count_once() -> None:
    made = rows(4)
    for row in made:
        row["truth"] = "appropriate"
    test = start_end(made, "objective_initial_error", "objective_final_error", "appropriate")
    ends = np.array([row["objective_final_error"] for row in made]).reshape(4, 2).mean(axis=1)
    assert test is not None
    assert test.n == 4
    assert test.end_mean == pytest.approx(ends.mean())


@given(st.integers(1, 40), st.integers(0, 80))
def test_the_headline_counts_right_verdicts(trials: int, wrong: int) -> None:
    made = rows(trials, wrong=min(wrong, 2 * trials))
    right = sum(row["truth"] == row["verdict"] for row in made)
    if trials > 1:
        assert f"right about {right} of {2 * trials} teachers" in headline(made)


def test_the_headline_of_one_trial_says_whom() -> None:
    made = rows(1)
    assert headline(made) == "The student imitated teacher_0 (crawler), rightly: an appropriate teacher."
    made[0]["chosen"], made[1]["chosen"] = False, True
    assert "teacher_1 (crawler), wrongly" in headline(made)
    made[1]["chosen"] = False
    assert headline(made) == "The student imitated neither teacher, wrongly: one was appropriate."
    assert (
        headline(made[1:]) == "The student did not imitate the only teacher, rightly: none was appropriate."
    )


def test_a_teacher_that_was_not_found_is_said_to_be() -> None:
    made = rows(1)
    made[1]["found"] = False
    assert "did not find teacher_1" in explanation(made)
