"""A short version of each scenario that this project's claims rest on runs to the end, with its report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from testbed.experiment.runner import run
from testbed.report.page import write_report
from testbed.scenario import Scenario, load_scenario, with_overrides


def short(name: str, seed: int | None = None) -> Scenario:
    """Cut down to seconds, and seen with fewer and coarser pictures."""
    scenario = with_overrides(load_scenario(name), seed=seed, smoke=True)
    rig = scenario.rig.model_copy(update={"camera_rate": 5.0, "supersample": 1})
    return scenario.model_copy(update={"rig": rig})


def told(scenario: Scenario, out: Path) -> tuple[dict[str, Any], str]:
    """The contents of ``verdicts.json`` and of the page."""
    assert not run(scenario, out=out).failed
    page = write_report(out).read_text(encoding="utf-8")
    return json.loads((out / "verdicts.json").read_text()), page


@pytest.mark.parametrize(("name", "like"), [("crowd", 1), ("nobody", 0)])
def test_worlds_of_many(name: str, like: int, tmp_path: Path) -> None:
    scenario = short(name)
    contents, page = told(scenario, tmp_path)
    rows = contents["verdicts"]
    assert [row["truth"] for row in rows].count("appropriate") == like
    assert [row["robot"] for row in rows] == [teacher.robot for teacher in scenario.teachers]
    # In so short a life who left has not yet returned.
    assert [row["found"] for row in rows] == [not teacher.away for teacher in scenario.teachers]
    assert all(row["reason"] for row in rows if row["found"])
    assert sum(row["chosen"] for row in rows) <= 1
    assert "Regret of its choice: " in page
    for row in rows:
        assert f"{row['teacher']} ({row['robot']}), <span" in page


def test_the_leaderboard(tmp_path: Path) -> None:
    scenario = short("leaderboard", seed=7)  # the held-out seed is for the whole of it
    contents, page = told(scenario, tmp_path)
    minds = {"like_me", "paper", "known_body", "oracle", "lookalike", "nearest", "random"}
    assert set(contents["summary"]) == minds
    for name in minds:
        assert contents["summary"][name]["n"] == 2
        assert contents["summary"][name]["accuracy"] in (0, 0.5, 1)
        assert f"<td>{name}</td>" in page
    assert "What was reproduced and what was not" in page  # by the paper's student


@pytest.mark.parametrize(("name", "block"), [("generalisation", "size_and_distance"), ("reality_gap", "gap")])
def test_sweeps(name: str, block: str, tmp_path: Path) -> None:
    whole = short(name)
    contents, page = told(whole.model_copy(update={"sweep": {block: whole.sweep[block]}}), tmp_path)
    assert len(contents["cells"]) == 2
    assert contents["split"] == "development"
    assert "Does it hold elsewhere?" in page
    assert "cannot tell at this N" in page
    assert (tmp_path / "figures" / f"sweep-{block}.svg").is_file()
