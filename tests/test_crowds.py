"""Worlds of many: the shipped scenarios with five teachers are sound; a short life in them judges everybody found."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.experiment.trial import run_trial
from testbed.experiment.trial_report import match
from testbed.experiment.truth import is_like
from testbed.morphology import load_robot
from testbed.resources import robot_names
from testbed.scenario import Scenario, check, drawn, load_scenario, parse_scenario, resolve, with_overrides


def short(name: str) -> Scenario:
    """The same world seen by the paper's student with its smallest parameters, and few pictures of it."""
    text = (
        resolve(load_scenario(name))
        .replace("method: like_me", "method: paper")
        .replace("name: like_me", "name: paper")
    )
    scenario = parse_scenario(text)
    rig = scenario.rig.model_copy(update={"camera_rate": 5.0, "supersample": 1})
    return with_overrides(scenario.model_copy(update={"rig": rig}), smoke=True)


@pytest.mark.parametrize(("name", "like"), [("crowd", 1), ("nobody", 0)])
def test_how_many_are_like_the_student(name: str, like: int) -> None:
    scenario = load_scenario(name)
    check(scenario)
    for trial in range(3):
        concrete = drawn(scenario, trial)
        mine = concrete.student.body()
        assert sum(is_like(mine, teacher.body()) for teacher in concrete.teachers) == like
        assert len({teacher.robot for teacher in concrete.teachers}) == 5


@pytest.mark.parametrize("name", ["crowd", "nobody"])
def test_a_short_life_among_many(name: str) -> None:
    rows = [row for row in run_trial(short(name), 0).rows if row["kind"] == "verdict"]
    assert len(rows) == 5
    # In so short a life who left has not yet returned.
    away = [bool(teacher.away) for teacher in load_scenario(name).teachers]
    assert [not row["found"] for row in rows] == away
    assert sum(row["chosen"] for row in rows) <= 1


ALIKE = {frozenset({"splayed", "thin_splayed"})}  # the same limbs on a thinner main body


@pytest.mark.parametrize("name", robot_names())
def test_robots_are_like_themselves_in_any_size_and_like_no_other(name: str) -> None:
    body = load_robot(name)
    assert is_like(body, body.scaled(0.6).stretched([1.3, 0.7]))
    others = [other for other in robot_names() if other != name]
    alike = [other for other in others if is_like(body, load_robot(other))]
    assert [frozenset({name, other}) for other in alike] == [pair for pair in ALIKE if name in pair]


def test_a_hinge_beside_the_middle_is_another_body() -> None:
    body = load_robot("hand")
    shifted = body.varied(joints={"joint_a": {"across": 0.0}})
    assert not is_like(body, shifted)


@given(
    st.lists(st.floats(-3, 3), min_size=1, max_size=6),
    st.lists(st.sampled_from([30, 48, -45, 83, 110, -100]), min_size=1, max_size=5, unique=True),
)
@settings(max_examples=60, deadline=None)
def test_things_that_are_nobody_take_no_teachers_place(offsets: list[float], strangers: list[int]) -> None:
    """Candidates near teachers are theirs, however many others are found elsewhere."""
    bearings = [-150.0, -70.0, 10.0, 65.0, 140.0, 175.0]
    teachers = "".join(
        f"  - {{robot: crawler, gait: crawl, bearing_deg: {bearing}}}\n" for bearing in bearings
    )
    scenario = parse_scenario(f"teachers:\n{teachers}")
    seen = {
        index: bearing + offset
        for index, (bearing, offset) in enumerate(zip(bearings, offsets, strict=False))
    }
    far = [one for one in strangers if all(abs(one - bearing) > 20 for bearing in bearings)]
    found = [*sorted([*seen.values()], reverse=True), *far]
    candidates: Any = tuple(SimpleNamespace(bearing=math.radians(bearing)) for bearing in found)
    expected = {f"teacher_{index}": found.index(bearing) for index, bearing in seen.items()}
    assert match(candidates, scenario) == expected
