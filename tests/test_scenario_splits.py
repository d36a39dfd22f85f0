"""Splits: other teachers and other chances, and none of them shared."""

from __future__ import annotations

import pytest

from testbed.errors import UserError
from testbed.scenario import (
    cell_names,
    content_hash,
    in_cell,
    in_split,
    parse_scenario,
    resolve,
    split_names,
    with_overrides,
)

TEXT = """\
name: x
seed: 7
trials: 3
student: like_me
teachers:
  - {robot: crawler, gait: random, distance: 1.0}
splits:
  held_out: {seed: 100003, teachers: {0: {robot: splayed}}}
  final: {seed: 200003, trials: 9}
"""


def test_the_file_itself_is_development_and_runs_unless_another_is_asked_for() -> None:
    scenario = parse_scenario(TEXT)
    assert split_names(scenario) == ("development", "held_out", "final")
    assert with_overrides(scenario) == scenario
    held_out = with_overrides(scenario, split="held_out")
    assert (held_out.split, held_out.seed, held_out.trials) == ("held_out", 100003, 3)
    assert held_out.teachers[0].robot == "splayed"
    assert held_out.splits == {}
    assert with_overrides(scenario, split="final").trials == 9
    assert with_overrides(scenario, split="development") == scenario
    own = parse_scenario(TEXT.replace("seed: 7", "split: tuning\nseed: 7"))
    assert split_names(own)[0] == "tuning"


def test_cells_and_sweeps_are_those_of_every_split() -> None:
    for variants in (
        "cells: {a: {}, b: {rig: {camera_noise: 6}}}",
        "sweep: {over: {rig.camera_noise: [2, 6]}}",
    ):
        scenario = parse_scenario(TEXT + variants)
        held_out = in_split(scenario, "held_out")
        assert cell_names(held_out) == cell_names(scenario)
        last = in_cell(held_out, cell_names(held_out)[-1])
        assert (last.rig.camera_noise, last.teachers[0].robot, last.seed) == (6, "splayed", 100003)


def test_a_split_is_a_run_of_its_own_and_what_else_could_be_run_does_not_count() -> None:
    scenario = parse_scenario(TEXT)
    hashes = {content_hash(in_split(scenario, split)) for split in split_names(scenario)}
    assert len(hashes) == 3
    held_out = in_split(scenario, "held_out")
    assert parse_scenario(resolve(held_out)) == held_out
    assert content_hash(parse_scenario(TEXT.replace("200003", "300003"))) == content_hash(scenario)


@pytest.mark.parametrize(
    ("old", "new", "line", "fragments"),
    [
        ("100003", "7", 8, ["splits 'development' and 'held_out' have the same seed, 7"]),
        ("200003", "100003", 9, ["splits 'held_out' and 'final' have the same seed"]),
        ("seed: 200003, ", "", 9, ["split 'final' has no seed of its own", "add e.g. 'seed: 100003'"]),
        ("final:", "development:", 9, ["the file itself is the split 'development'"]),
        ("trials: 9", "cells: {}", 9, ["split 'final' cannot have a cells of its own"]),
        ("{robot: splayed}", "{robt: splayed}", 8, ["unknown key 'robt'", "did you mean 'robot'"]),
        ("{0: {robot", "{4: {robot", 8, ["split 'held_out' changes teacher '4'"]),
    ],
)
def test_a_mistake_is_told_with_its_line(old: str, new: str, line: int, fragments: list[str]) -> None:
    with pytest.raises(UserError) as caught:
        parse_scenario(TEXT.replace(old, new), "x.yaml")
    assert str(caught.value).startswith(f"x.yaml:{line}: ")
    for fragment in fragments:
        assert fragment in str(caught.value)


def test_a_command_line_cannot_make_splits_overlap() -> None:
    scenario = parse_scenario(TEXT, "x.yaml")
    with pytest.raises(UserError, match="seed 100003 is that of the split 'held_out'"):
        with_overrides(scenario, seed=100003)
    with pytest.raises(UserError, match="seed 7 is that of the split 'development'"):
        with_overrides(scenario, split="held_out", seed=7)
    assert with_overrides(scenario, split="held_out", seed=100003).seed == 100003
    assert with_overrides(scenario, seed=8).seed == 8
    with pytest.raises(UserError, match=r"there is no split 'heldout'; did you mean 'held_out'\?"):
        with_overrides(scenario, split="heldout")
    with pytest.raises(UserError, match="the scenario has no 'splits:'"):
        with_overrides(parse_scenario(TEXT[: TEXT.index("splits:")]), split="held_out")
