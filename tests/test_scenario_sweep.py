"""Sweeps: which cells they have, what each changes, and what is told of mistakes."""

from __future__ import annotations

import itertools
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.errors import UserError
from testbed.experiment.jobs import jobs_of
from testbed.scenario import (
    Scenario,
    cell_names,
    check,
    check_trial,
    content_hash,
    drawn,
    in_cell,
    parse_scenario,
    resolve,
    sweep_of,
    with_overrides,
)

HEAD = """\
name: x
seed: 9
trials: 3
student: like_me
teachers:
  - {robot: crawler, gait: random, bearing_deg: -30, distance: 1.0}
  - {robot: {choice: [splayed, ball]}, gait: random, bearing_deg: 30, distance: 1.0, fit: false}
"""
GRID = """\
sweep:
  design: grid
  over:
    teachers.all.distance: [0.9, 1.0, 1.2]
    rig.camera_noise: {log_uniform: [1, 4], steps: 3}
"""


def swept(text: str) -> Scenario:
    return parse_scenario(HEAD + text, "x.yaml")


def test_a_grid_is_what_cells_written_by_hand_would_be() -> None:
    grid = swept(GRID)
    lines = ["  control: {}"]
    for distance, noise in itertools.product(("0.9", "1", "1.2"), ("1", "2", "4")):
        if (distance, noise) != ("1", "2"):
            change = f"{{teachers: {{all: {{distance: {distance}}}}}, rig: {{camera_noise: {noise}}}}}"
            lines.append(f"  d{distance.replace('.', '_')}n{noise}: {change}")
    by_hand = parse_scenario(HEAD + "\n".join(["cells:", *lines]), "x.yaml")
    assert cell_names(grid)[:3] == (
        "control",
        "distance_0.9+camera_noise_1",
        "distance_0.9+camera_noise_2",
    )
    assert len(cell_names(grid)) == len(cell_names(by_hand)) == 9
    for one, other in zip(cell_names(grid), cell_names(by_hand), strict=True):
        assert in_cell(grid, one) == in_cell(by_hand, other)
        assert drawn(in_cell(grid, one), 2) == drawn(in_cell(by_hand, other), 2)


def test_the_control_is_the_scenario_as_it_stands_and_no_point_twice() -> None:
    grid = swept(GRID)
    assert in_cell(grid, "control").teachers == grid.teachers
    assert "distance_1+camera_noise_2" not in cell_names(grid)  # it is the control
    assert sweep_of(grid).blocks["sweep"].control.levels == {"distance": 1.0, "camera_noise": 2.0}
    elsewhere = swept(GRID + "  control: {teachers.all.distance: 1.2, student.robot: splayed}\n")
    assert in_cell(elsewhere, "control").teachers[0].distance == 1.2
    assert "distance_1.2+camera_noise_2" not in cell_names(elsewhere)
    assert {in_cell(elsewhere, cell).student.robot for cell in cell_names(elsewhere)} == {"splayed"}


def test_one_axis_at_a_time() -> None:
    axes = swept(GRID.replace("grid", "axes"))
    assert cell_names(axes) == (
        "control",
        "distance_0.9",
        "distance_1.2",
        "camera_noise_1",
        "camera_noise_4",
    )
    assert in_cell(axes, "distance_1.2").rig.camera_noise == 2
    assert in_cell(axes, "camera_noise_4").teachers[1].distance == 1.0


def test_an_axis_may_move_several_places_and_have_blocks_for_values() -> None:
    text = """\
sweep:
  gap:
    over:
      gap: {values: [0.5, 2], of: {student.reality_gap.friction: 0.2, student.reality_gap.servo_offset_deg: 3}}
  who:
    over:
      teachers.1: {values: {flat: {robot: splayed}, round: {robot: ball, distance: 1.3}}, name: unlike}
    control: {teachers.1: flat}
"""
    scenario = swept(text)
    assert cell_names(scenario) == ("control", "gap-gap_0.5", "gap-gap_2", "who-control", "who-unlike_round")
    gap = in_cell(scenario, "gap-gap_2").student.reality_gap
    assert gap is not None
    assert (gap.friction, gap.servo_offset_deg) == (0.4, 6)
    assert in_cell(scenario, "control").student.reality_gap is None
    assert in_cell(scenario, "who-control").teachers[1].robot == "splayed"
    assert in_cell(scenario, "who-unlike_round").teachers[1].distance == 1.3


@settings(max_examples=15, deadline=None)
@given(
    count=st.integers(1, 70),
    seed=st.integers(0, 2**32 - 1),
    design=st.sampled_from(["sobol", "latin_hypercube"]),
)
def test_space_filling_points_fill_the_space(count: int, seed: int, design: str) -> None:
    text = f"""\
sweep:
  design: {{{design}: {count}}}
  over:
    teachers.all.distance: {{log_uniform: [0.8, 3.2]}}
    rig.camera_noise: {{uniform: [0, 10]}}
"""
    scenario = with_overrides(swept(text), seed=seed)
    points = [point for cell, point in sweep_of(scenario).points.items() if cell != "control"]
    assert len(points) == count
    noises = sorted(float(point.levels["camera_noise"]) for point in points)  # type: ignore[arg-type]
    assert all(0 <= noise <= 10 for noise in noises)
    assert all(0.8 <= float(point.levels["distance"]) <= 3.2 for point in points)  # type: ignore[arg-type]
    if design == "latin_hypercube":  # one in each slice, to the rounding of the values
        slack = 0.01
        for number, noise in enumerate(noises):
            assert 10 * number / count - slack <= noise <= 10 * (number + 1) / count + slack
    else:  # half of every power of two lies in the upper half
        whole = 2 ** (count.bit_length() - 1)
        first = [float(point.levels["camera_noise"]) for point in points[:whole]]  # type: ignore[arg-type]
        assert sum(noise >= 5 for noise in first) == whole // 2 or whole == 1


def test_more_sobol_points_continue_fewer_and_the_seed_counts() -> None:
    def points(count: int, seed: int = 9) -> list[object]:
        text = f"sweep: {{design: {{sobol: {count}}}, over: {{rig.camera_noise: {{uniform: [0, 10]}}}}}}\n"
        scenario = with_overrides(swept(text), seed=seed)
        return [(cell, point.levels) for cell, point in sweep_of(scenario).points.items()]

    assert points(40)[:12] == points(11)
    assert points(5) != points(5, seed=10)


def test_a_sweep_survives_the_round_trip_and_counts_in_the_hash() -> None:
    grid = swept(GRID)
    again = parse_scenario(resolve(grid), "elsewhere.yaml")
    assert again == grid
    assert cell_names(again) == cell_names(grid)
    assert content_hash(again) == content_hash(grid)
    assert content_hash(swept(GRID.replace("1.2", "1.3"))) != content_hash(grid)
    assert content_hash(with_overrides(grid, trials=8)) == content_hash(grid)


@pytest.mark.parametrize(
    ("old", "new", "line", "fragments"),
    [
        (
            "teachers.all.distance:",
            "teachers.all.distanc:",
            11,
            ["unknown key 'distanc'", "did you mean 'distance'"],
        ),
        (
            "teachers.all.distance:",
            "techers.all.distance:",
            11,
            ["unknown key 'techers'", "did you mean 'teachers'"],
        ),
        ("teachers.all.distance:", "teachers.5.distance:", 11, ["changes teacher '5'"]),
        ("[0.9, 1.0, 1.2]", "[0.9, 1.0, 12]", 11, ["teachers[0].distance must be between", "not 12"]),
        ("[0.9, 1.0, 1.2]", "[0.9, 90, 1.2]", 11, ["teachers[0].distance must be between", "not 90"]),
        ("[0.9, 1.0, 1.2]", "[0.9, 0.9]", 11, ["two values are called '0.9'"]),
        ("[0.9, 1.0, 1.2]", "{uniform: [2, 1], steps: 3}", 11, ["the range goes from 2 to 1"]),
        ("[0.9, 1.0, 1.2]", "{uniform: [1, 2]}", 10, ["'teachers.all.distance' has no steps"]),
        ("[0.9, 1.0, 1.2]", "{value: [1, 2]}", 11, ["unknown key 'value'", "did you mean 'values'"]),
        ("rig.camera_noise:", "seed:", 12, ["seed cannot be swept"]),
        ("design: grid", "desing: grid", 9, ["unknown key 'desing' in a sweep", "did you mean 'design'"]),
        ("design: grid", "design: gird", 9, ["there is no such design", "did you mean 'grid'"]),
        ("design: grid", "design: {sobl: 8}", 9, ["there is no such design", "did you mean 'sobol'"]),
        ("sweep:\n", "cells: {a: {}}\nsweep:\n", 9, ["either cells or a sweep"]),
    ],
)
def test_a_mistake_is_told_with_its_line(old: str, new: str, line: int, fragments: list[str]) -> None:
    assert old in GRID
    with pytest.raises(UserError) as caught:
        swept(GRID.replace(old, new))
    assert str(caught.value).startswith(f"x.yaml:{line}: ")
    for fragment in fragments:
        assert fragment in str(caught.value)


def test_thousands_of_cells_are_quick() -> None:
    began = time.process_time()
    scenario = swept(
        "sweep:\n  over:\n"
        "    teachers.all.distance: {uniform: [1, 2], steps: 80}\n"
        "    rig.camera_noise: {uniform: [1, 10], steps: 80}\n"
    )
    assert len(jobs_of(scenario)) == 3 * 6401
    for cell in itertools.islice(cell_names(scenario), 0, None, 500):
        assert in_cell(scenario, cell).cells == {}
    assert time.process_time() - began < 4


IMPOSSIBLE = """\
sweep:
  over: {teachers.0.distance: [0.4, 1.0, 1.2]}
"""


def test_cells_that_cannot_be_are_refused_by_the_check_or_left_out() -> None:
    refused = swept(IMPOSSIBLE)
    with pytest.raises(UserError, match=r"^x.yaml:9: cell 'distance_0.4': .*does not fit in view.*leave_out"):
        check(refused)
    left_out = swept(IMPOSSIBLE + "  impossible: leave_out\n")
    check(left_out)
    with pytest.raises(UserError, match="does not fit in view"):
        check_trial(left_out, "distance_0.4", 0)
    check_trial(left_out, "distance_1.2", 0)
    no_control = swept(IMPOSSIBLE + "  impossible: leave_out\n  control: {teachers.0.distance: 0.4}\n")
    with pytest.raises(UserError, match="cell 'control'"):
        check(no_control)


@pytest.mark.parametrize("name", ["generalisation", "reality_gap"])
def test_the_shipped_sweeps_have_cells(name: str) -> None:
    from testbed.scenario import load_scenario

    scenario = load_scenario(name)
    assert scenario.split == "development"
    assert len(cell_names(scenario)) > 15
    check_trial(scenario, cell_names(scenario)[0], 0)
