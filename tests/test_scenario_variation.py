"""Distributions in scenario files: what they mean, where they may stand, and how mistakes in them are told."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from testbed.errors import UserError
from testbed.scenario import Scenario, content_hash, parse_scenario, resolve
from testbed.scenario.variation import (
    DISTRIBUTIONS,
    chance,
    corners,
    distribution_of,
    middle,
    place_of,
    realised,
    replaced,
    spelled,
    varied,
)

TEACHER = "teachers:\n  - robot: crawler\n    gait: crawl\n"


def draws(raw: dict[str, object], count: int = 2000) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.array([distribution_of(raw, ()).draw(rng) for _ in range(count)])


@pytest.mark.parametrize(
    ("raw", "reference"),
    [
        ({"uniform": [2, 5]}, stats.uniform(2, 3)),
        ({"log_uniform": [0.5, 2]}, stats.loguniform(0.5, 2)),
        ({"normal": [10, 3]}, stats.norm(10, 3)),
    ],
)
def test_draws_follow_the_distribution_that_is_named(raw: dict[str, object], reference: object) -> None:
    assert stats.kstest(draws(raw), reference.cdf).pvalue > 0.01  # type: ignore[attr-defined]


def test_a_choice_is_even_and_what_stands_twice_comes_twice_as_often() -> None:
    values, counts = np.unique(draws({"choice": ["a", "b", "b", "c"]}), return_counts=True)
    assert values.tolist() == ["a", "b", "c"]
    assert counts / 2000 == pytest.approx([0.25, 0.5, 0.25], abs=0.04)


@given(st.floats(-50, 50), st.floats(0, 50), st.integers(0, 2**32 - 1))
def test_draws_stay_between_the_ends(low: float, width: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for raw in (
        {"uniform": [low, low + width]},
        {"log_uniform": [abs(low) + 0.01, abs(low) + 0.01 + width]},
        {"normal": [low, width]},
    ):
        distribution = distribution_of(raw, ())
        below, above = distribution.ends
        assert below <= distribution.draw(rng) <= above
        assert below - 1e-9 <= distribution.middle <= above + 1e-9


DATA = {
    "a": {"uniform": [0, 1]},
    "b": [1, {"choice": [{"c": {"normal": [5, 1]}}, "x"]}],
    "random": {"uniform": [3, 4]},
    "d": "text",
}


def test_distributions_are_found_by_place_and_not_below_keys_that_are_drawn_elsewhere() -> None:
    assert list(varied(DATA)) == [("a",), ("b", 1)]
    assert middle(DATA) == {"a": 0.5, "b": [1, {"c": 5.0}], "random": {"uniform": [3, 4]}, "d": "text"}
    drawn = realised(DATA, np.random.default_rng(0))
    assert varied(drawn) == {}
    assert drawn["random"] == {"uniform": [3, 4]}


def test_corners_are_the_ends_one_by_one_with_those_inside_choices() -> None:
    seen = [(corner["a"], corner["b"][1]) for corner in corners(DATA)]
    assert (0, {"c": 5.0}) in seen
    assert (1, {"c": 5.0}) in seen
    assert {"c": 2.0} in [b for _, b in seen]
    assert {"c": 8.0} in [b for _, b in seen]
    assert "x" in [b for _, b in seen]
    assert all(a == 0.5 or b == {"c": 5.0} for a, b in seen)


def test_places_are_spelled_and_read_back() -> None:
    place = ("teachers", 0, "gait", "joints", "joint_a")
    assert place_of(spelled(place)) == place
    assert replaced({"x": [1, 2]}, ("x", 1), 5) == {"x": [1, 5]}


def test_chance_depends_on_seed_trial_and_place_and_nothing_else() -> None:
    def first(*key: object) -> float:
        return float(chance(*key).random())  # type: ignore[arg-type]

    base = first(1, 2, ("a", 0))
    assert base == first(1, 2, ("a", 0))
    assert len({base, first(2, 2, ("a", 0)), first(1, 3, ("a", 0)), first(1, 2, ("a", 1))}) == 4


def test_any_number_robot_or_block_may_be_drawn_and_the_resolved_text_says_so_again() -> None:
    text = (
        "world: {gravity: {uniform: [9, 10]}}\n"
        "rig: {camera_noise: {choice: [1, 2, 3]}}\n"
        "student: {position: [{uniform: [-0.1, 0.1]}, -1]}\n"
        "teachers:\n"
        "  - {robot: {choice: [crawler, splayed]}, gait: {choice: [crawl, still]}, scale: {log_uniform: [0.8, 1.2]}}\n"
        "  - choice:\n"
        "      - {robot: crawler, gait: still, bearing_deg: {uniform: [60, 70]}}\n"
        "      - {robot: splayed, gait: still, bearing_deg: -60}\n"
    )
    scenario = parse_scenario(text, "x.yaml")
    assert scenario.world.gravity == 9.5
    assert len(scenario.variation) == 7  # the nested one belongs to its choice
    again = parse_scenario(resolve(scenario), "x.yaml")
    assert again == scenario
    assert content_hash(again) == content_hash(scenario)
    other = parse_scenario(text.replace("[9, 10]", "[9, 10.5]"), "x.yaml")
    assert content_hash(other) != content_hash(scenario)
    assert Scenario.model_validate(scenario.template) == scenario


@pytest.mark.parametrize(
    ("more", "line", "fragments"),
    [
        ("    scale: {uniform: [2, 1]}", 4, ["uniform goes from 2 to 1", "smaller number first"]),
        ("    scale: {uniform: [2]}", 4, ["uniform needs two numbers", "{uniform: [a, b]}"]),
        ("    scale: {log_uniform: [0, 1]}", 4, ["log_uniform goes from 0 to 1", "above 0"]),
        ("    scale: {normal: [1, -1]}", 4, ["standard deviation is -1"]),
        ("    scale: {choice: []}", 4, ["choice needs values"]),
        ("    scale: {unifrm: [1, 2]}", 4, ["teachers[0].scale must be a number"]),
        ("    scale: {uniform: [1, 12]}", 4, ["teachers[0].scale must be between 0.1 and 10, not 12"]),
        ("    scale: {choice: [1, x]}", 4, ["teachers[0].scale must be a number, not the text 'x'"]),
        ("    distance: {normal: [1, 0.5]}", 4, ["teachers[0].distance must be between 0.3 and 5 m"]),
        ("seed: {choice: [1, 2]}", 4, ["seed must be a whole number"]),
        ("rig: {background: {uniform: [200, 203]}}", 4, ["rig.background must be a whole number"]),
        ("    scale: {choice: [{uniform: [3, 2]}, 1]}", 4, ["uniform goes from 3 to 2"]),
    ],
)
def test_a_mistake_in_a_distribution_is_told_with_its_line(
    more: str, line: int, fragments: list[str]
) -> None:
    with pytest.raises(UserError) as caught:
        parse_scenario(TEACHER + more, "x.yaml")
    assert str(caught.value).startswith(f"x.yaml:{line}: ")
    for fragment in fragments:
        assert fragment in str(caught.value)


def test_every_distribution_is_known_by_its_only_field() -> None:
    for name, kind in DISTRIBUTIONS.items():
        assert list(kind.model_fields) == [name]
