"""Several minds in one student, and the whole life of like_me in the world."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from testbed.experiment.record import Row, TrialResult
from testbed.experiment.trial import run_trial
from testbed.scenario import Scenario, parse_scenario, with_overrides
from testbed.student import phases

WHO = """
seed: 11
student: {student}
beside: {beside}
rig: {{camera_rate: 5}}  # it looks less often than that
teachers:
  - {{robot: crawler, gait: crawl, distance: 1.0, bearing_deg: -30}}
  - {{robot: splayed, gait: splayed_crawl, distance: 1.0, bearing_deg: 30, facing_deg: 180}}
"""


def scenario_of(student: str, beside: str = "[]", *, smoke: bool = False) -> Scenario:
    text = WHO.format(student=student, beside=beside)
    return with_overrides(parse_scenario(text, Path("who.yaml")), smoke=smoke)


def rows_of(result: TrialResult, student: str, kind: str = "verdict") -> list[Row]:
    return [row for row in result.rows if row["student"] == student and row["kind"] == kind]


@pytest.fixture(scope="module")
def life() -> TrialResult:
    return run_trial(scenario_of("like_me"), 0)


def test_like_me_tells_who_is_like_it_and_why(life: TrialResult) -> None:
    like, unlike = rows_of(life, "like_me")
    assert like["verdict"] == "appropriate"
    assert unlike["verdict"] == "inappropriate"
    for row in (like, unlike):
        assert 0 <= float(row["probability"] or -1) <= 1
        assert row["reason"]
        assert row["controller_verdict"] in ("appropriate", "inappropriate")
    assert like["parts_in_place"] is True
    assert float(like["motion_roll_error_median_deg"] or 99) < 3
    assert "%" in str(unlike["reason"])


def test_like_me_moves_forward_with_the_teacher_that_it_chose(life: TrialResult) -> None:
    like, unlike = rows_of(life, "like_me")
    assert like["chosen"] is True
    assert unlike["chosen"] is False
    assert float(like["path_forward"] or 0) > 0.02
    assert float(like["distance_ratio"] or 0) > 0.5


def test_like_me_knows_its_body_and_says_what_it_does_not_know(life: TrialResult) -> None:
    (itself,) = rows_of(life, "like_me", "self")
    assert itself["topology_right"] is True
    assert itself["posterior_holds_truth"] is True
    assert itself["damage_found"] is None
    assert len(life.arrays["self/words"]) >= 2


def test_the_pictures_kept_are_those_in_which_bodies_were_compared(life: TrialResult) -> None:
    kept = life.arrays["teacher_0/images"]
    assert kept.shape[1:] == (2, 75, 100)
    for name in ("explanation_parts_0", "explanation_parts_1", "truth_parts"):
        assert len(life.arrays[f"teacher_0/{name}"]) == len(kept)
    gaps = (
        life.arrays["teacher_0/explanation_parts_0"][..., 1:4]
        - life.arrays["teacher_0/truth_parts"][..., 1:4]
    )
    assert np.abs(gaps).max() < 0.15


def test_a_mind_beside_the_leader_changes_nothing_for_the_leader() -> None:
    alone = run_trial(scenario_of("paper", smoke=True), 0)
    both = run_trial(
        scenario_of("paper", "[{name: other, method: paper, imitation: rehearsed}]", smoke=True), 0
    )
    assert rows_of(both, "paper") == rows_of(alone, "paper")
    assert len(rows_of(both, "other")) == 2
    assert any(key.startswith("beside/other/teacher_0/") for key in both.arrays)
    assert np.array_equal(
        both.arrays["teacher_0/controller_weights"], alone.arrays["teacher_0/controller_weights"]
    )


def test_what_minds_have_in_common_is_thought_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def counted(name: str, think: Any) -> Any:
        def wrapper(*args: Any) -> Any:
            calls.append(name)
            return think(*args)

        return wrapper

    for table in (phases.TEACHER_MODELLING, phases.IMITATION):
        for name, think in table.items():
            monkeypatch.setitem(table, name, counted(name, think))
    beside = "[{name: same, method: paper}, {name: rehearsing, method: paper, imitation: rehearsed}]"
    result = run_trial(scenario_of("paper", beside, smoke=True), 0)
    assert sorted(calls) == ["eea"] * 2 + ["hill_climber"] * 2 + ["rehearsed"] * 2
    paper, same = (rows_of(result, name) for name in ("paper", "same"))
    assert [row["score"] for row in paper] == [row["score"] for row in same]


@pytest.mark.parametrize(
    ("damage", "found"),
    [("{limb_lost: limb_a, at: 34}", "limb_lost"), ("{joint_locked: joint_a, at: 34}", "joint_locked")],
)
def test_damage_in_the_middle_of_life_is_noticed(damage: str, found: str) -> None:
    text = f"""
student:
  method: like_me
  robot: {{tree: [{{on: main, angle_deg: 100}}, {{on: limb_a, angle_deg: 60}}]}}
  damage: {damage}
rig: {{camera_rate: 1, supersample: 1}}
teachers: []
"""
    result = run_trial(parse_scenario(text, Path("broken.yaml")), 0)
    (row,) = rows_of(result, "like_me", "self")
    assert str(row["damage_found"]).startswith(found)
    assert row["damage_named_right"] is True
    assert float(row["damage_noticed_after"] or 99) <= 3


def test_a_student_of_four_parts_lives_a_whole_life() -> None:
    text = """
student: {method: like_me, robot: four_chain}
rig: {camera_rate: 5}
teachers:
  - robot: four_chain
    distance: 1.4
    gait:
      joints:
        joint_a: {centre_deg: -20, amplitude_deg: 18}
        joint_b: {centre_deg: 30, amplitude_deg: 25, phase_deg: 90}
        joint_c: {centre_deg: 20, amplitude_deg: 30, phase_deg: 200}
"""
    result = run_trial(with_overrides(parse_scenario(text, Path("four.yaml")), smoke=True), 0)
    (row,) = rows_of(result, "like_me")
    assert row["truth"] == "appropriate"
    assert row["found"] is True
    assert result.arrays["teacher_0/controller_weights"].shape[1:] == (3, 4)
    assert result.arrays["teacher_0/motion_parts"].shape[1:] == (4, 8)
