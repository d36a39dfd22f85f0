"""One trial from end to end, and that no truth gets through the door between the student and the world."""

from __future__ import annotations

import ast
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import testbed.student
from testbed.errors import UserError
from testbed.experiment.record import Row, TrialResult
from testbed.experiment.teacher_report import rig_of
from testbed.experiment.trial import live, run_trial, student_of
from testbed.experiment.trial_report import match
from testbed.experiment.truth import overlap, teacher_model_error
from testbed.experiment.witness import Witness
from testbed.scenario import Scenario
from testbed.scenario.student import RealityGap
from testbed.student.agent import Student
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World


@pytest.fixture(scope="module")
def result(hasty: Scenario) -> TrialResult:
    return run_trial(hasty, 0)


def same(one: TrialResult, other: TrialResult) -> bool:
    return one.rows == other.rows and all(
        one.arrays[key].tobytes() == other.arrays[key].tobytes() for key in one.arrays | other.arrays
    )


def verdicts(result: TrialResult) -> list[Row]:
    return [row for row in result.rows if row["kind"] == "verdict"]


def test_a_trial_has_a_row_for_each_teacher_and_one_for_the_student(result: TrialResult) -> None:
    names = [(row["teacher"], row["robot"], row["truth"]) for row in verdicts(result)]
    assert names == [("teacher_0", "crawler", "appropriate"), ("teacher_1", "splayed", "inappropriate")]
    (itself,) = (row for row in result.rows if row["kind"] == "self")
    assert itself["student"] == "paper"
    assert itself["topology_right"] in (True, False)
    for row in verdicts(result):
        assert row["found"]
        assert row["verdict"] in ("appropriate", "inappropriate")
        assert isinstance(row["score"], float)
        assert row["final_error"] <= row["initial_error"]


def test_a_student_looks_only_at_what_it_said_it_would_look_at(
    result: TrialResult, hasty: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        World, "looking", property(lambda world: True, lambda world, looking: None), raising=False
    )
    assert same(run_trial(hasty, 0), result)


def test_arrays_have_the_shapes_that_the_documentation_tells(result: TrialResult, hasty: Scenario) -> None:
    parameters = hasty.student.parameters
    shapes = {key: value.shape for key, value in result.arrays.items()}
    iterations, passes = parameters.imitation.iterations, 3 * parameters.teacher_modelling.passes_per_image
    assert shapes["self/parents"] == shapes["self/angles"] == (parameters.self_discovery.iterations + 1, 2)
    assert shapes["teacher_0/images"] == (3, 2, 75, 100)
    assert shapes["teacher_0/model_history"] == (passes + 1, 3, 8)
    assert shapes["teacher_0/model_position_error"] == (passes + 1,)
    assert shapes["teacher_0/truth_parts"] == (3, 3, 8)
    assert shapes["teacher_0/controller_objective"] == (iterations + 1,)
    assert shapes["teacher_0/self_rolls"] == (3, parameters.imitation.samples, 3)
    assert shapes["truth/teacher_1/base"] == (len(result.arrays["truth/student/base"]), 7)
    assert all(value.dtype != object for value in result.arrays.values())


def test_the_errors_of_a_teacher_model_are_those_of_its_belief_after_each_pass(
    result: TrialResult, hasty: Scenario
) -> None:
    """What is measured once for passes that changed nothing, against every pass by itself."""
    arrays, rig = result.arrays, rig_of(hasty)
    beliefs, true = arrays["teacher_1/model_history"], arrays["teacher_1/truth_parts"]
    passes = len(beliefs) - 1
    assert len(np.unique(beliefs, axis=0)) < passes
    for number in range(passes + 1):
        seen = true[max(number - 1, 0) // (passes // 3)]
        position, roll = teacher_model_error(beliefs[number], seen)
        assert arrays["teacher_1/model_position_error"][number] == position
        assert arrays["teacher_1/model_roll_error"][number] == roll
        assert arrays["teacher_1/model_overlap"][number] == overlap(beliefs[number], seen, rig)


def test_the_true_parts_lie_where_the_images_are_dark(result: TrialResult, hasty: Scenario) -> None:
    """The truth that beliefs are measured against, drawn by the analytic kernel over what the camera saw."""
    from testbed.vision.camera import StereoRig
    from testbed.vision.kernel import render

    rig = StereoRig(field_of_view=np.radians(hasty.rig.field_of_view_deg), baseline=hasty.rig.baseline)
    for name in ("teacher_0", "teacher_1"):
        for pair, parts in zip(
            result.arrays[f"{name}/images"], result.arrays[f"{name}/truth_parts"], strict=True
        ):
            seen, drawn = pair < 180, render(parts, rig) < 255
            overlap = (seen & drawn).sum() / (seen | drawn).sum()
            assert overlap > 0.7


def test_a_trial_repeats_bit_for_bit(result: TrialResult, hasty: Scenario) -> None:
    assert same(run_trial(hasty, 0), result)
    assert not same(run_trial(hasty, 1), result)


# No truth reaches the student.


def relabelled(scenario: Scenario) -> Scenario:
    """The same bodies at the same places, with every word about them turned round."""
    first, second = scenario.teachers
    teachers = (
        second.model_copy(update={"appropriate": True}),
        first.model_copy(update={"appropriate": False}),
    )
    return scenario.model_copy(update={"teachers": teachers, "description": "swapped"})


def test_swapping_names_order_and_labels_changes_nothing_that_the_student_does(
    result: TrialResult, hasty: Scenario
) -> None:
    swapped = run_trial(relabelled(hasty), 0)
    for ours, theirs in zip(verdicts(result), reversed(verdicts(swapped)), strict=True):
        assert ours["robot"] == theirs["robot"]
        assert ours["truth"] != theirs["truth"]
        assert (ours["verdict"], ours["score"]) == (theirs["verdict"], theirs["score"])
    assert np.array_equal(
        result.arrays["teacher_0/controller_weights"], swapped.arrays["teacher_1/controller_weights"]
    )
    assert np.array_equal(result.arrays["truth/student/joints"], swapped.arrays["truth/student/joints"])


class Recorder:
    """Keeps what a student senses and does."""

    def __init__(self, student: Student) -> None:
        self.student = student
        self.sensed: list[dict[str, Any]] = []
        self.done_actions: list[bytes] = []

    @property
    def done(self) -> bool:
        return self.student.done

    @property
    def looking(self) -> bool:
        return self.student.looking

    def act(self, observation: dict[str, Any]) -> Any:
        self.sensed.append({key: value.copy() for key, value in observation.items()})
        action = self.student.act(observation)
        self.done_actions.append(action.tobytes())
        return action


@pytest.mark.parametrize("method", ["paper", "like_me"])
def test_the_observations_alone_decide_what_the_student_does(hasty: Scenario, method: str) -> None:
    """The same stream of observations without any world behind it: the same life, bit for bit.

    The second student is even made from another world, with the other body, a reality gap, slippery ground and half the
    gravity, which must make no difference either: all that it may know beforehand is the same in both.
    """
    mind = hasty.student.model_copy(update={"method": method, "name": method})
    hasty = hasty.model_copy(update={"student": mind})
    backend = SimulatedBackend(hasty)
    world = World(hasty, backend=backend)
    seeds = np.random.SeedSequence(7)
    recorder = Recorder(student_of(hasty, seeds))
    witness = Witness(hasty, backend)
    live(world, backend, recorder, 11, witness)  # type: ignore[arg-type]
    world.close()

    elsewhere = hasty.world.model_copy(update={"ground_friction": 0.3, "gravity": 4.9, "tilt_noise_deg": 9.0})
    gap = RealityGap(servo_offset_deg=(5.0, -5.0), limb_length=(0.8, 1.3))
    splayed = hasty.student.model_copy(update={"robot": "splayed", "reality_gap": gap})
    other = hasty.model_copy(update={"world": elsewhere, "student": splayed})
    blind = student_of(other, np.random.SeedSequence(7))
    assert [blind.act(sensed).tobytes() for sensed in recorder.sensed] == recorder.done_actions
    ours, theirs = recorder.student.life, blind.life
    assert ours is not None
    assert theirs is not None
    assert ours.selves[method].body == theirs.selves[method].body
    assert np.array_equal(ours.selves[method].errors, theirs.selves[method].errors)
    for candidate, another in zip(ours.candidates, theirs.candidates, strict=True):
        one, other = candidate.judgements[method], another.judgements[method]
        assert one.verdict == other.verdict
        assert np.array_equal(one.model.motion.parts, other.model.motion.parts)
        assert np.array_equal(one.imitation.weights, other.imitation.weights)


def test_the_students_room_has_no_window_to_the_world() -> None:
    """Nothing in testbed/student imports the world, the scenario, the experiment or a backend."""
    for file in Path(testbed.student.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{file.name} imports relatively"
                modules += [f"{node.module}.{alias.name}" for alias in node.names]
            for module in modules:
                for room in ("world", "experiment", "scenario", "hardware", "report", "resources"):
                    assert not module.startswith(f"testbed.{room}"), f"{file.name} imports {module}"
                assert module != "pybullet", f"{file.name} imports pybullet"


def test_who_finds_an_appropriate_teacher_imitates_it_and_its_path_is_recorded(hasty: Scenario) -> None:
    generous = {"verdict": {"threshold": -10.0}}
    parameters = hasty.student.parameters.model_validate(hasty.student.parameters.model_dump() | generous)
    student = hasty.student.model_copy(update={"parameters": parameters})
    result = run_trial(hasty.model_copy(update={"student": student}), 0)
    chosen = [row for row in verdicts(result) if row["chosen"]]
    assert len(chosen) == 1
    assert chosen[0]["score"] == max(row["score"] for row in verdicts(result))
    steps, start = int(result.arrays["perform/steps"]), int(result.arrays["perform/start_step"])
    assert steps == parameters.imitation.samples
    assert result.arrays["perform/path"].shape == (steps + 1, 3)
    assert np.array_equal(
        result.arrays["perform/path"][0], result.arrays["truth/student/base"][start - 1, :3]
    )
    assert np.ptp(result.arrays["truth/student/joints"][start : start + steps], axis=0).max() > 0.05
    assert chosen[0]["path_length"] > 0


def test_a_life_that_does_not_fit_the_episode_is_a_users_mistake(hasty: Scenario) -> None:
    short = hasty.model_copy(update={"world": hasty.world.model_copy(update={"max_cycles": 50})})
    with pytest.raises(UserError, match="max_cycles = 50"):
        run_trial(short, 0)


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        ((-29.0, 31.0), {"teacher_0": 0, "teacher_1": 1}),
        ((31.0, -29.0), {"teacher_0": 1, "teacher_1": 0}),
        ((-5.0,), {}),
        ((-15.0,), {"teacher_0": 0}),
        ((-30.0, -26.0, 75.0), {"teacher_0": 0}),
        ((331.0, 28.0), {"teacher_0": 0, "teacher_1": 1}),
        ((), {}),
    ],
)
def test_a_candidate_is_at_most_one_teacher(
    hasty: Scenario, seen: tuple[float, ...], expected: object
) -> None:
    candidates = tuple(SimpleNamespace(bearing=math.radians(bearing), distance=None) for bearing in seen)
    assert match(candidates, hasty) == expected  # type: ignore[arg-type]
