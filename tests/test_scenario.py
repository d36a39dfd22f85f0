from __future__ import annotations

import contextlib
import math
import pickle
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from testbed.errors import UserError
from testbed.resources import robot_path, scenario_names
from testbed.scenario import (
    GaitSpec,
    JointWave,
    Scenario,
    TeacherSpec,
    as_scenario,
    content_hash,
    load_scenario,
    parse_scenario,
    resolve,
    with_overrides,
)
from testbed.student.parameters import StudentParameters

TEACHER = "teachers:\n  - robot: crawler\n    gait: crawl\n"
FULL = """\
name: full
description: "1e-3"
seed: 7
trials: 3
world:
  control_step: 0.02
  physics_step: 0.005
rig:
  height: 0.2
  camera_rate: 12.5
  light: {direction: [0, 0, 1], ambient: 0.5}
student:
  method: paper
  position: [0.5, -2]
  parameters:
    imitation: {iterations: 5}
teachers:
  - robot: crawler
    gait:
      kind: cyclic
      period: 1.5
      joints:
        joint_a: {centre_deg: 10, amplitude_deg: 5, phase_deg: 90}
      when: always
    bearing_deg: -40
  - robot: splayed
    gait: {kind: still}
    distance: 1.2
    bearing_deg: 40
    facing_deg: 180
    appropriate: false
"""


def test_a_file_may_state_everything() -> None:
    scenario = parse_scenario(FULL)
    assert scenario.description == "1e-3"
    assert scenario.rig.light.direction == (0.0, 0.0, 1.0)
    assert scenario.student.parameters.imitation.iterations == 5
    assert scenario.teachers[0].gait.joints["joint_a"].span_deg == (5.0, 15.0)
    assert scenario.teachers[1].appropriate is False


def test_a_file_name_that_is_no_name_asks_for_one() -> None:
    with pytest.raises(UserError, match=r"file's name '2 x' cannot be .* add a line such as 'name: my_scen"):
        parse_scenario(TEACHER, "2 x.yaml")
    assert parse_scenario(TEACHER + "name: fine", "2 x.yaml").name == "fine"


def test_shipped_scenarios_load_by_name_and_by_path(tmp_path: Path) -> None:
    for name in scenario_names():
        scenario = load_scenario(name)
        assert scenario.name == name
        assert as_scenario(scenario) is scenario
    assert as_scenario("paper") == load_scenario("paper")  # and passes the checks, as all do that are shipped
    (tmp_path / "mine.yaml").write_text(TEACHER)
    assert load_scenario(str(tmp_path / "mine.yaml")).name == "mine"
    with pytest.raises(
        UserError, match=r"unknown scenario 'whom_to_imitat'; did you mean 'whom_to_imitate'\?"
    ):
        load_scenario("whom_to_imitat")
    with pytest.raises(UserError, match=r"there is no such file; did you mean 'mine.yaml'\?"):
        load_scenario(tmp_path / "mime.yaml")


@pytest.mark.parametrize(
    "text", [TEACHER, FULL, TEACHER + "description: |\n  'on'\n\n  \u03b1: \"\u00e9\"\n"]
)
def test_the_resolved_text_reads_back_as_the_same_scenario(text: str) -> None:
    scenario = parse_scenario(text)
    again = parse_scenario(resolve(scenario), "elsewhere/y.yaml")
    assert again == scenario
    assert content_hash(again) == content_hash(scenario)
    assert resolve(again) == resolve(scenario)


@settings(max_examples=40)
@example("\x85")
@example(" \u2028 a\r\nb\t")
@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=40))
def test_any_description_survives_the_round_trip(description: str) -> None:
    scenario = parse_scenario(TEACHER).model_copy(update={"description": description})
    assert parse_scenario(resolve(scenario)) == scenario


def test_the_resolved_text_states_every_default() -> None:
    def keys(value: object) -> set[str]:
        if isinstance(value, dict):
            return {str(key) for key in value} | {k for inner in value.values() for k in keys(inner)}
        return {k for inner in value for k in keys(inner)} if isinstance(value, list) else set()

    stated = keys(yaml.safe_load(resolve(parse_scenario(TEACHER))))
    assert (
        set(Scenario.model_fields) - {"variation"}
        | set(StudentParameters.model_fields)
        | set(TeacherSpec.model_fields)
        <= stated
    )
    assert {"ambient", "iterations", "amplitude_deg"} <= stated


def test_the_number_of_trials_of_a_cell_is_no_content_either() -> None:
    few, many = (
        parse_scenario(TEACHER + f"cells: {{far: {{trials: {count}}}}}\n", "a.yaml") for count in (2, 9)
    )
    assert content_hash(few) == content_hash(many)
    other = parse_scenario(TEACHER + "cells: {far: {trials: 2, rig: {camera_noise: 6}}}\n", "a.yaml")
    assert content_hash(few) != content_hash(other)


def test_the_hash_follows_the_content_alone() -> None:
    base = content_hash(parse_scenario(TEACHER, "a.yaml"))
    assert re.fullmatch("[0-9a-f]{8}", base)
    same = [
        "# comment\nseed: 0\n" + TEACHER,
        TEACHER + "trials: 100",
        TEACHER + "student: paper",
        "teachers: [{gait: crawl, robot: crawler, distance: 0.90}]",
    ]
    different = [
        TEACHER + "seed: 1",
        TEACHER + "    distance: 0.91",
        TEACHER + "student: {parameters: {imitation: {iterations: 499}}}",
        TEACHER.replace("crawler", "splayed"),
        TEACHER.replace("gait: crawl", "gait: still"),
        TEACHER + "name: b",
    ]
    assert {content_hash(parse_scenario(text, "b/a.yaml")) for text in same} == {base}
    hashes = [content_hash(parse_scenario(text, "a.yaml")) for text in different]
    assert len({base, *hashes}) == len(different) + 1


def test_joint_order_in_a_gait_changes_nothing() -> None:
    text = "teachers: [{robot: crawler, gait: {joints: {%s}}}]"
    one, two = "joint_a: {amplitude_deg: 1}", "joint_b: {amplitude_deg: 2}"
    first, second = (parse_scenario(text % f"{a}, {b}") for a, b in ((one, two), (two, one)))
    assert content_hash(first) == content_hash(second)


def test_robots_of_ones_own_are_found_beside_the_file_and_hashed_by_content(tmp_path: Path) -> None:
    text = "teachers: [{robot: ./mine.yaml, gait: crawl}]"
    hashes = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "x.yaml").write_text(text)
        (tmp_path / folder / "mine.yaml").write_bytes(robot_path("crawler").read_bytes())
        scenario = load_scenario(tmp_path / folder / "x.yaml")
        assert scenario.teachers[0].robot == str(tmp_path / folder / "mine.yaml")
        hashes.append(content_hash(scenario))
    assert hashes[0] == hashes[1]  # the folder does not matter
    mine = tmp_path / "b" / "mine.yaml"
    mine.write_text(mine.read_text().replace("0.14", "0.15"))
    assert content_hash(scenario) != hashes[1]  # the body does


def test_overrides() -> None:
    scenario = parse_scenario(FULL)
    assert with_overrides(scenario) == scenario
    changed = with_overrides(scenario, seed=5, trials=9)
    assert (changed.seed, changed.trials) == (5, 9)
    assert changed.source is scenario.source
    smoke = with_overrides(scenario, smoke=True)
    assert smoke.trials == 1
    assert smoke.student.parameters == scenario.student.parameters.smoke()
    assert smoke.teachers == scenario.teachers
    assert with_overrides(scenario, smoke=True, trials=2).trials == 2
    for wrong in ({"seed": -1}, {"seed": 2**32}, {"trials": 0}):
        with pytest.raises(UserError) as caught:
            with_overrides(scenario, **wrong)
        assert caught.value.mend


def test_a_scenario_goes_to_other_processes_whole() -> None:
    scenario = parse_scenario(FULL)
    copy = pickle.loads(pickle.dumps(scenario))
    assert copy == scenario
    assert copy.source.line(("teachers", 1)) == scenario.source.line(("teachers", 1))


def test_scenarios_can_be_made_in_python() -> None:
    gait = GaitSpec(joints={"joint_a": JointWave(amplitude_deg=10)})
    scenario = Scenario(name="made", teachers=(TeacherSpec(robot="crawler", gait=gait),))
    assert parse_scenario(resolve(scenario)) == scenario
    assert math.isclose(scenario.world.control_step, 1 / 60)


MUTANTS = [
    "",
    "0",
    "-1",
    "1e9",
    "1e-9",
    "x",
    "true",
    "null",
    "[1, 2]",
    "{a: 1}",
    "'",
    "\t",
    "&a",
    "1:30",
    "\u2028",
]


@settings(max_examples=150)
@given(st.data())
def test_a_spoilt_file_gives_a_scenario_or_a_user_error(data: st.DataObject) -> None:
    words = re.split(r"(\s+|[:,{}\[\]-])", FULL)
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(words) - 1))
        words[place] = data.draw(st.sampled_from([*MUTANTS, *words[:40]]) | st.text(max_size=3))
    with contextlib.suppress(UserError):
        scenario = parse_scenario("".join(words))
        with contextlib.suppress(UserError):  # a robot of one's own that does not exist
            assert content_hash(parse_scenario(resolve(scenario))) == content_hash(scenario)


names = st.sampled_from(
    ["seed", "world", "rig", "student", "teachers", "gait", "robot", "gravity", "light", "x"]
)
values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from(["crawl", "paper"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=4),
    max_leaves=10,
)


@given(st.dictionaries(names, values, max_size=5))
def test_any_data_give_a_scenario_or_a_user_error(data: dict[str, object]) -> None:
    with contextlib.suppress(UserError):
        parse_scenario(yaml.safe_dump(data))
