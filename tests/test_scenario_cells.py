"""Cells: what they change and what they share."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from testbed.errors import UserError
from testbed.resources import robot_path
from testbed.scenario import (
    cell_names,
    check,
    content_hash,
    drawn,
    in_cell,
    load_scenario,
    parse_scenario,
    resolve,
    with_overrides,
)

TEXT = """\
name: cells
seed: 9
trials: 5
student: paper
teachers:
  - {robot: crawler, gait: random, scale: {uniform: [0.8, 1.2]}, bearing_deg: -30}
  - {robot: {choice: [splayed, thin_splayed]}, gait: crawl, bearing_deg: 30, distance: 1.5}
cells:
  control:
  far:
    teachers: {all: {distance: 2}, 1: {distance: 2.5}}
  second:
    teachers: [{}, {robot: splayed, gait: {kind: still}}]
  mind: {student: like_me, beside: [paper], trials: 7}
  noise: {rig: {camera_noise: 6}, world: {gravity: 9}}
  drawn:
    teachers: {0: {scale: 1, distance: {uniform: [1.5, 2]}}}
"""


def test_a_cell_says_what_it_changes_and_shares_the_rest() -> None:
    scenario = parse_scenario(TEXT)
    assert cell_names(scenario) == ("control", "far", "second", "mind", "noise", "drawn")
    control, far, second, mind, noise, fixed = (in_cell(scenario, cell) for cell in cell_names(scenario))
    assert control.teachers == scenario.teachers
    assert control.cells == {}
    assert [teacher.distance for teacher in far.teachers] == [2, 2.5]
    assert far.teachers[0].robot == "crawler"
    assert second.teachers[0] == scenario.teachers[0]
    assert (second.teachers[1].robot, second.teachers[1].gait.kind) == ("splayed", "still")
    assert second.teachers[1].distance == 1.5
    assert [one.name for one in mind.minds] == ["like_me", "paper"]
    assert (mind.trials, control.trials) == (7, 5)
    assert mind.student.robot == scenario.student.robot
    assert (noise.rig.camera_noise, noise.world.gravity) == (6, 9)
    assert noise.rig.baseline == scenario.rig.baseline
    assert set(fixed.variation) == {"teachers/1/robot", "teachers/0/distance"}


def test_a_trial_draws_the_same_in_every_cell_but_for_what_the_cell_changes() -> None:
    scenario = parse_scenario(TEXT)
    for trial in range(5):
        control = drawn(in_cell(scenario, "control"), trial)
        far = drawn(in_cell(scenario, "far"), trial)
        fixed = drawn(in_cell(scenario, "drawn"), trial)
        for one, other in zip(control.teachers, far.teachers, strict=True):
            assert one.model_copy(update={"distance": other.distance}) == other
        assert fixed.teachers[1] == control.teachers[1]
        assert fixed.teachers[0].gait == control.teachers[0].gait


def test_a_scenario_without_cells_is_its_own_only_cell() -> None:
    scenario = load_scenario("paper")
    assert cell_names(scenario) == ("default",)
    assert in_cell(scenario, "default") is scenario
    with pytest.raises(UserError, match="there is no cell 'nowhere'"):
        in_cell(scenario, "nowhere")


def test_cells_survive_the_round_trip_and_count_in_the_hash() -> None:
    scenario = parse_scenario(TEXT)
    again = parse_scenario(resolve(scenario), "elsewhere.yaml")
    assert again == scenario
    assert content_hash(again) == content_hash(scenario)
    assert content_hash(parse_scenario(TEXT.replace("noise: 6", "noise: 7"))) != content_hash(scenario)
    assert in_cell(pickle.loads(pickle.dumps(scenario)), "far") == in_cell(scenario, "far")


@pytest.mark.parametrize(
    ("old", "new", "line", "fragments"),
    [
        ("{distance: 2.5}", "{distance: 25}", 11, ["teachers[1].distance must be between"]),
        ("{distance: 2.5}", "{distnce: 2}", 11, ["unknown key 'distnce'", "did you mean 'distance'"]),
        (" 1: {dist", " 2: {dist", 11, ["cell 'far' changes teacher '2'", "whom the scenario does not have"]),
        ("camera_noise: 6", "camera_noise: {uniform: [2, 100]}", 15, ["rig.camera_noise must be between"]),
        ("beside: [paper]", "beside: [like_me]", 14, ["two students are called 'like_me'"]),
        ("trials: 7", "seed: 7", 14, ["cell 'mind' cannot have a seed of its own"]),
        ("noise: {rig", "noise: {rigg", 15, ["unknown key 'rigg'", "did you mean 'rig'"]),
        ("noise: {rig: {camera_noise: 6}, world: {gravity: 9}}", "noise: 3", 15, ["must be a mapping"]),
    ],
)
def test_a_mistake_in_a_cell_is_told_with_its_line(
    old: str, new: str, line: int, fragments: list[str]
) -> None:
    assert old in TEXT
    with pytest.raises(UserError) as caught:
        parse_scenario(TEXT.replace(old, new), "x.yaml")
    assert str(caught.value).startswith(f"x.yaml:{line}: ")
    for fragment in fragments:
        assert fragment in str(caught.value)


def test_what_cannot_work_in_one_cell_is_found_by_the_check() -> None:
    scenario = parse_scenario(TEXT.replace("distance: 2.5", "bearing_deg: 120"), "x.yaml")
    with pytest.raises(UserError, match=r"x.yaml:11: bearing 120 degrees is beyond the rig's pan limit"):
        check(scenario)
    check(parse_scenario(TEXT))


def test_a_command_lines_trials_are_those_of_every_cell() -> None:
    scenario = parse_scenario(TEXT)
    more = with_overrides(scenario, trials=12, seed=3)
    assert {in_cell(more, cell).trials for cell in cell_names(more)} == {12}
    assert {in_cell(more, cell).seed for cell in cell_names(more)} == {3}
    smoke = with_overrides(scenario, smoke=True)
    assert {in_cell(smoke, cell).trials for cell in cell_names(smoke)} == {1}
    assert in_cell(smoke, "far").student.parameters == scenario.student.parameters.smoke()


def test_robots_of_ones_own_are_found_in_cells_choices_and_plans(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_bytes(robot_path("crawler").read_bytes())
    (tmp_path / "x.yaml").write_text(
        "student: {robot: {parts_of: ./mine.yaml, random: {limbs: 2}}}\n"
        "teachers: [{robot: {choice: [./mine.yaml, splayed]}, gait: still}]\n"
        "cells: {a: {teachers: {all: {robot: mine.yaml}}}}\n"
    )
    scenario = load_scenario(tmp_path / "x.yaml")
    check(scenario)
    mine = str(tmp_path / "mine.yaml")
    assert scenario.variation["teachers/0/robot"] == {"choice": [mine, "splayed"]}
    assert in_cell(scenario, "a").teachers[0].robot == mine
    before = content_hash(scenario)
    (tmp_path / "mine.yaml").write_text((tmp_path / "mine.yaml").read_text().replace("0.14", "0.15"))
    assert content_hash(scenario) != before
