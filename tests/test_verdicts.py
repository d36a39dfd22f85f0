"""``verdicts.json``: same trials, same bytes; and the numbers mean what they say."""

from __future__ import annotations

import json
import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trial_builder import trial_result

from testbed.experiment import verdicts
from testbed.experiment.statistics import SHARE_SEED, auc, share_interval, wilson


def rows_of(trials: int) -> list[dict[str, Any]]:
    return [dict(row) for trial in range(trials) for row in trial_result(trial).rows]


def text_of(rows: list[dict[str, Any]], seed: int = 5) -> str:
    return verdicts.text(verdicts.document("name", "1a2b3c4d", rows, seed))


def test_the_order_in_which_trials_finish_does_not_show() -> None:
    rows = rows_of(12)
    shuffled = rows.copy()
    random.Random(1).shuffle(shuffled)
    assert text_of(rows) == text_of(shuffled)


def test_rows_are_listed_by_trial_and_teacher_as_numbers() -> None:
    rows = [
        {**rows_of(1)[0], "trial": trial, "teacher": f"teacher_{t}"} for trial in (10, 2) for t in (10, 2)
    ]
    listed = json.loads(text_of(rows))["verdicts"]
    assert [(row["trial"], row["teacher"]) for row in listed] == [
        (2, "teacher_2"),
        (2, "teacher_10"),
        (10, "teacher_2"),
        (10, "teacher_10"),
    ]


def test_the_file_is_json_with_its_keys_in_order() -> None:
    text = text_of(rows_of(3))
    contents = json.loads(text)
    assert list(contents) == ["scenario", "hash", "verdicts", "selves", "summary"]
    first = ["trial", "cell", "student", "teacher", "robot", "truth", "verdict", "score"]
    assert list(contents["verdicts"][0])[:8] == first
    assert text.endswith("}\n")


def test_every_row_has_every_column() -> None:
    rows = rows_of(2)
    rows[1]["path_length"] = 0.25
    listed = json.loads(text_of(rows))["verdicts"]
    assert [row["path_length"] for row in listed] == [None, 0.25, None, None]


def test_numbers_are_rounded_to_nine_digits_and_nothing_is_nan() -> None:
    rows = rows_of(1)
    rows[0].update(score=np.float64(1 / 3), initial_error=math.nan, final_error=-0.0, found=np.bool_(True))
    row = json.loads(text_of(rows))["verdicts"][0]
    assert row["score"] == 0.333333333
    assert row["initial_error"] is None
    assert math.copysign(1, row["final_error"]) == 1
    assert row["found"] is True


def test_the_summary_says_what_the_statistics_say() -> None:
    rows = rows_of(20)
    summary = verdicts.summarise(rows, 5)["paper"]
    scored = [row for row in rows if row["score"] is not None]
    right = sum(row["truth"] == row["verdict"] for row in rows)
    assert (summary["n"], summary["trials"], summary["found"]) == (40, 20, 40)
    assert summary["auc"] == auc(
        [row["score"] for row in scored], [row["truth"] == "appropriate" for row in scored]
    )
    assert summary["auc_low"] < summary["auc"] < summary["auc_high"]
    assert summary["accuracy"] == right / 40
    trials = [f"{row['cell']}/{row['trial']}" for row in rows]
    interval = share_interval(
        [row["truth"] == row["verdict"] for row in rows], trials, np.random.default_rng(SHARE_SEED)
    )
    assert (summary["accuracy_low"], summary["accuracy_high"]) == interval


def test_verdicts_of_one_trial_are_not_taken_for_independent() -> None:
    rows = [{**row, "verdict": row["truth"] if row["trial"] < 8 else "neither"} for row in rows_of(12)]
    summary = verdicts.summarise(rows, 5)["paper"]
    low, high = wilson(16, 24)
    assert summary["accuracy_low"] < low
    assert summary["accuracy_high"] > high


def test_each_student_has_a_summary_of_its_own() -> None:
    rows = rows_of(4)
    others = [{**row, "student": "oracle", "verdict": row["truth"]} for row in rows]
    summary = verdicts.summarise([*rows, *others], 5)
    assert summary["oracle"]["accuracy"] == 1.0
    assert summary["paper"] == verdicts.summarise(rows, 5)["paper"]


def test_only_the_intervals_depend_on_the_seed() -> None:
    one, two = (verdicts.summarise(rows_of(20), seed)["paper"] for seed in (1, 2))
    assert one["auc"] == two["auc"]
    assert one["auc_low"] != two["auc_low"] or one["auc_high"] != two["auc_high"]


@pytest.mark.parametrize("rows", [[], [rows_of(1)[0]]])
def test_no_verdicts_or_one_class_are_no_error(rows: list[dict[str, Any]]) -> None:
    contents = json.loads(text_of(rows))
    assert all(summary["auc"] is None for summary in contents["summary"].values())


def test_writing_replaces_the_file(tmp_path: Path) -> None:
    for trials in (3, 1):
        contents = verdicts.document("name", "1a2b3c4d", rows_of(trials), 5)
        file = verdicts.write(tmp_path, contents)
        assert file.read_text() == verdicts.text(contents)
    assert [path.name for path in tmp_path.iterdir()] == ["verdicts.json"]


def with_probabilities(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of a mind that says 90% of what is appropriate, and 20% of what is not, and whose controller errs."""
    return [
        {
            **row,
            "probability": 0.9 if row["truth"] == "appropriate" else 0.2,
            "controller_score": -float(row["truth"] == "appropriate"),
        }
        for row in rows
    ]


def test_the_summary_has_calibration_and_the_controllers_area() -> None:
    plain = verdicts.summarise(rows_of(6), 5)["paper"]
    assert plain["calibration_error"] is None
    assert plain["calibrated"] == 0
    summary = verdicts.summarise(with_probabilities(rows_of(6)), 5)["paper"]
    share = sum(row["truth"] == "appropriate" for row in rows_of(6)) / len(rows_of(6))
    assert summary["calibration_error"] == pytest.approx(share * 0.1 + (1 - share) * 0.2)
    assert summary["calibration_error_low"] <= summary["calibration_error"] + 1e-12
    assert summary["calibrated"] == summary["n"]
    assert summary["controller_auc"] == 0.0
    assert summary["auc"] == plain["auc"]


def test_rows_without_a_probability_are_left_out_of_the_calibration() -> None:
    rows = with_probabilities(rows_of(6))
    rows[0]["probability"] = None
    assert verdicts.summarise(rows, 5)["paper"]["calibrated"] == len(rows) - 1


def test_several_cells_have_a_summary_each_and_one_cell_has_none() -> None:
    rows = rows_of(5)
    assert "cells" not in json.loads(text_of(rows))
    far = [{**row, "cell": "far", "verdict": row["truth"]} for row in rows]
    contents = json.loads(text_of([*rows, *far]))
    assert list(contents)[-2:] == ["summary", "cells"]
    assert contents["cells"]["far"]["paper"]["accuracy"] == 1.0
    own = str(rows[0]["cell"])
    assert contents["cells"][own] == json.loads(text_of(rows))["summary"]
    assert contents["summary"]["paper"]["n"] == 2 * len(rows)
