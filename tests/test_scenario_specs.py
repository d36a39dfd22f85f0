from __future__ import annotations

import pytest
from pydantic import ValidationError

from testbed.errors import UserError
from testbed.scenario import StudentSpec, WorldSpec, parse_scenario
from testbed.world.gaits import PRESETS

TEACHER = "teachers:\n  - robot: crawler\n    gait: crawl\n"


def refusal(text: str) -> UserError:
    with pytest.raises(UserError) as caught:
        parse_scenario(text, "x.yaml")
    return caught.value


def test_a_file_states_only_what_is_particular() -> None:
    scenario = parse_scenario(TEACHER, "some/where/duel.yaml")
    assert scenario.name == "duel"
    assert (scenario.seed, scenario.trials) == (0, 1)
    assert scenario.student == StudentSpec()
    assert scenario.world.physics_steps == 4
    assert scenario.teachers[0].gait == PRESETS["crawl"]
    assert scenario.source.line(("teachers", 0, "gait")) == 3


def test_a_bare_word_names_the_student() -> None:
    assert parse_scenario(TEACHER + "student: paper").student == StudentSpec(method="paper")


BAD = [
    ("name: x", 1, ["'teachers' is missing", "add 'teachers: ...'"]),
    ("teachers:", 1, ["teachers has no value", "a list"]),
    ("teachers:\n" + "  - {robot: crawler, gait: crawl}\n" * 9, 1, ["9 values", "at most 8"]),
    ("teachers:\n  - {gait: crawl}", 2, ["teachers[0] has no 'robot'", "add 'robot: ...'"]),
    (TEACHER + "    distnce: 2", 4, ["unknown key 'distnce' in teachers[0]", "did you mean 'distance'?"]),
    (
        TEACHER + "    distance: 90",
        4,
        ["between 0.3 and 5 m, not 90", "lengths are in metres", "0.9 (90 cm)"],
    ),
    (TEACHER + "    distance: 0.2", 4, ["between 0.3 and 5 m, not 0.2"]),
    (TEACHER + "    bearing_deg: 200", 4, ["between -180 and 180 degrees"]),
    (TEACHER + "    appropriate: yes", 4, ["write true or false"]),
    ("teachers:\n  - robot: crawler\n    gait: crwal", 3, ["unknown gait 'crwal'", "did you mean 'crawl'?"]),
    ("teachers:\n  - robot: crawler\n    gait: {}", 3, ["moves no joint", "kind: still"]),
    ("teachers:\n  - robot: crawler\n    gait:\n      kind: stil", 4, ["gait.kind", "did you mean 'still'?"]),
    (
        "teachers:\n  - robot: crawler\n    gait:\n      kind: still\n      joints: {a: {}}",
        5,
        ["still gait", "remove 'joints:'"],
    ),
    (
        "teachers:\n  - robot: crawler\n    gait:\n      joints:\n        a: {amplitude: 1}",
        5,
        ["unknown key 'amplitude' in teachers[0].gait.joints.a", "did you mean 'amplitude_deg'?"],
    ),
    (TEACHER + "student: papper", 4, ["unknown student 'papper'", "did you mean 'paper'?"]),
    (TEACHER + "student:\n  method: papper", 5, ["unknown student 'papper'", "did you mean 'paper'?"]),
    (
        TEACHER + "student: {parameters: {imitation: {iterations: -1}}}",
        4,
        ["student.parameters.imitation.iterations must be", "not -1"],
    ),
    (TEACHER + "seed: -1", 4, ["between 0 and 4294967295, not -1"]),
    (TEACHER + "seed: 1.5", 4, ["a whole number, not 1.5"]),
    (TEACHER + "trials: 0", 4, ["trials must be between 1 and"]),
    (TEACHER + "world:\n  gravity: 1:30", 5, ["world.gravity must be a number", "'1:30'"]),
    (
        TEACHER + "world:\n  control_step: 0.01",
        5,
        ["whole multiple of physics_step", "try control_step: 0.0083"],
    ),
    (TEACHER + "world:\n  control_step: 0.001", 5, ["whole multiple", "try control_step: 0.0041666"]),
    (TEACHER + "world:\n  max_cycles: 1\n  gravity: .nan", 6, ["not a finite number"]),
    (TEACHER + "rig:\n  baseline: 10", 5, ["lengths are in metres; did you mean 0.1 (10 cm)?"]),
    (TEACHER + "rig:\n  background: 256", 5, ["between 0 and 255 grey levels"]),
    (TEACHER + "rig:\n  light:\n    direction: [0, 0, 0]", 6, ["no usable length", "[0.3, -1.0, 1.5]"]),
    (TEACHER + "rig:\n  light:\n    direction: [0, 1]", 6, ["too few values", "give 3"]),
    (TEACHER + "rig:\n  height: 1\n  camera_rate: 100", 6, ["faster than the control steps", "at most 60"]),
    (
        TEACHER + "rig:\n  camera_rate: 25",
        5,
        ["every 2.4 control steps", "whole number", "nearest rates that fit are 20 and 30"],
    ),
    (
        TEACHER + "world:\n  control_step: 0.02\n  physics_step: 0.005",
        1,
        ["camera_rate of 15", "every 3.333", "12.5 and 16.6667"],
    ),
    (
        TEACHER + "rig:\n  background: 180",
        5,
        ["rig.background of 180", "dark_below of 180", "raise rig.background or lower student.parameters"],
    ),
    (
        TEACHER + "rig: {background: 200}\nstudent: {parameters: {looking: {dark_below: 210}}}",
        4,
        ["rig.background of 200", "dark_below of 210"],
    ),
    (TEACHER + "rig: {camera_rate: 1e-320}", 4, ["between 0.001 and 1000 images/s"]),
    (TEACHER + "world: {control_step: 1e-320, physics_step: 1e-320}", 4, ["between 1e-05 and 0.5 s"]),
    (TEACHER + "world: {physics_step: 1e-320}", 4, ["between 1e-05 and 0.02 s"]),
    (TEACHER + "name: two words", 4, ["name cannot be the text 'two words'", "start with a letter"]),
    (TEACHER + "name: 2", 4, ["name must be text, not 2", "quotes"]),
    (TEACHER + "seed: 1\nseed: 2", 5, ["'seed' stands twice, first in line 4"]),
]


@pytest.mark.parametrize(("text", "line", "fragments"), BAD)
def test_a_mistake_is_one_line_with_its_place_and_a_mend(text: str, line: int, fragments: list[str]) -> None:
    error = refusal(text)
    message = str(error)
    assert message.startswith(f"x.yaml:{line}: ")
    assert "\n" not in message
    assert error.mend
    for fragment in fragments:
        assert fragment in message


def test_steps_written_by_hand_need_not_be_exact() -> None:
    assert WorldSpec(control_step=0.01667, physics_step=0.004167).physics_steps == 4
    with pytest.raises(ValidationError):
        WorldSpec(control_step=0.0150, physics_step=0.004167)


@pytest.mark.parametrize("rate", [1, 7.5, 12, 15, 20, 30, 60, 16.6667, 12.5])
def test_cameras_take_an_image_every_whole_number_of_steps(rate: float) -> None:
    step = "world: {control_step: 0.02, physics_step: 0.005}\n" if rate in (16.6667, 12.5) else ""
    assert parse_scenario(f"{TEACHER}{step}rig: {{camera_rate: {rate}}}").rig.camera_rate == rate


def test_a_background_may_be_just_above_what_is_dark() -> None:
    assert parse_scenario(TEACHER + "rig: {background: 181}").rig.background == 181


def test_specs_are_frozen() -> None:
    scenario = parse_scenario(TEACHER)
    with pytest.raises(ValidationError):
        scenario.seed = 1  # type: ignore[misc]


@pytest.mark.parametrize(
    ("phases", "mend"),
    [
        ("teacher_modelling: joint_fit", "verdict: controller"),
        ("verdict: attachment", "teacher_modelling: joint_fit"),
    ],
)
def test_phases_that_do_not_fit_together_are_refused_with_their_mend(phases: str, mend: str) -> None:
    text = f"student: {{method: like_me, {phases}}}\nteachers: [{{robot: crawler, gait: crawl}}]\n"
    with pytest.raises(UserError, match=mend) as caught:
        parse_scenario(text)
    assert caught.value.line == 1
