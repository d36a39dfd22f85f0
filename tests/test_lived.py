"""A world that is written down: nothing changes by it, and what broke off is told again and goes on."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.bodies.morphology import Morphology, load_robot
from testbed.errors import UserError
from testbed.experiment.diary import Diary, Told
from testbed.experiment.lived import EndOfRecordError, Lived, resting_place
from testbed.experiment.stage import SimulatedStage
from testbed.experiment.trial_report import _perform_arrays
from testbed.experiment.witness import Witness
from testbed.hardware.failures import LinkLost
from testbed.hardware.journal import Step
from testbed.scenario import Scenario, drawn, load_scenario
from testbed.world.backend import Backend
from testbed.world.env import World
from testbed.world.placement import STUDENT

STEPS = 40


@pytest.fixture(scope="module")
def here() -> Scenario:
    return drawn(load_scenario("bench"), 0)


class Failing(SimulatedStage):
    """A simulated world whose cable is pulled at a step."""

    def __init__(self, scenario: Scenario, fails_at: int | None) -> None:
        super().__init__(scenario)
        apply, done = self.backend.apply, 0

        def applied(commands: Any, pan: float) -> None:
            nonlocal done
            done += 1
            if done == fails_at:
                raise LinkLost("the port of student is gone")
            apply(commands, pan)

        self.backend.apply = applied  # type: ignore[method-assign]


def act(number: int, observation: dict[str, np.ndarray]) -> np.ndarray:
    """Depends on what is sensed, to the last bit."""
    leaning = 0.1 * float(observation["tilt"][1]) + 1e-3 * float(observation["left"].mean())
    return np.array([leaning, 0.3 * np.sin(number / 5), 0.01 * number], dtype=np.float32)


def teach(number: int) -> np.ndarray:
    """A teacher that lies still up to step 20 and moves then."""
    return np.array([0.2, 0.1 * number]) if number > 20 else np.zeros(2)


def episode(here: Scenario, backend: Backend, witness: Witness | None = None) -> list[bytes]:
    """What the student senses at each step."""
    world = World(here, backend=backend)
    observations, _ = world.reset(seed=4)
    notes = (lambda: None) if witness is None else witness.note
    notes()
    senses = []
    for number in range(1, STEPS + 1):
        senses.append(b"".join(sense.tobytes() for sense in observations[STUDENT].values()))
        actions = dict.fromkeys(("teacher_0", "teacher_1"), teach(number))
        observations, *_ = world.step({**actions, STUDENT: act(number, observations[STUDENT])})
        notes()
    return senses


def lead(here: Scenario, journal: Path, fails_at: int | None = None) -> list[bytes]:
    stage = Failing(here, fails_at)
    try:
        with Diary(journal) as diary:
            senses = episode(here, diary.lived(here, stage))
            diary.finish()
            return senses
    finally:
        stage.close()


def test_writing_changes_nothing(here: Scenario, tmp_path: Path) -> None:
    stage = SimulatedStage(here)
    assert lead(here, tmp_path / "journal") == episode(here, stage.backend)
    stage.close()
    told = Told(tmp_path / "journal")
    assert [step.number for step in told.steps] == list(range(STEPS + 1))
    assert told.finished


def test_what_was_lived_is_told_again_without_a_world(here: Scenario, tmp_path: Path) -> None:
    senses = lead(here, tmp_path / "journal")
    told = Told(tmp_path / "journal").steps
    robots = SimulatedStage(here).backend.robots
    assert episode(here, Lived(robots, told, live=None, control_step=1 / 30)) == senses
    with pytest.raises(EndOfRecordError):
        episode(here, Lived(robots, told[:-5], live=None, control_step=1 / 30))


def test_what_broke_off_goes_on(here: Scenario, tmp_path: Path) -> None:
    """From where the teachers lay still; what is sensed until then is what was sensed then."""
    undisturbed = lead(here, tmp_path / "undisturbed")
    with pytest.raises(LinkLost):
        lead(here, tmp_path / "journal", fails_at=31)
    broken = Told(tmp_path / "journal")
    assert [note.kind for note in broken.notes] == ["unfinished", "failed"]
    assert broken.notes[1].text.startswith("LinkLost: ")
    assert len(broken.steps) == 31

    senses = lead(here, tmp_path / "journal")
    assert senses[:21] == undisturbed[:21]
    again = Told(tmp_path / "journal")
    assert again.notes[2].text == "from step 20"
    assert [step.number for step in again.steps] == list(range(STEPS + 1))
    assert again.finished
    assert lead(here, tmp_path / "journal") == senses  # and is not lived a third time


def test_robots_take_their_posture_before_the_world_goes_on(here: Scenario, tmp_path: Path) -> None:
    with pytest.raises(LinkLost):
        lead(here, tmp_path / "journal", fails_at=31)
    lead(here, tmp_path / "journal")
    kept, later = Told(tmp_path / "journal").steps[20:22]
    assert kept.tilts[STUDENT] == pytest.approx(later.tilts[STUDENT], abs=0.06)
    assert abs(kept.pan - later.pan) < 0.02
    assert 18 <= later.exposed <= 21


def test_the_truth_of_what_is_told_again_is_kept(here: Scenario, tmp_path: Path) -> None:
    """Up to where the trial goes on; there everybody was carried back, which is said."""
    logs = []
    for name, fails_at in (("undisturbed", None), ("broken", 31), ("broken", None)):
        stage = Failing(here, fails_at)
        with contextlib.suppress(LinkLost), Diary(tmp_path / name) as diary:
            lived = diary.lived(here, stage)
            witness = Witness(here, lived, lived)
            episode(here, lived, witness)
            logs.append(witness.log()["truth/student/base"])
        stage.close()
    undisturbed, resumed = logs
    assert not np.isnan(resumed).any()
    assert resumed[:21].tobytes() == undisturbed[:21].tobytes()
    assert lived.put_back == [20]
    assert Told(tmp_path / "broken").resumed == [20]


@pytest.mark.parametrize(("put_back", "whole"), [(8, True), (9, False), (13, False), (14, True)])
def test_a_way_on_which_it_was_carried_back_is_no_path(put_back: int, whole: bool) -> None:
    """It performs from state 9 to state 14."""
    life: Any = SimpleNamespace(perform_start=10, perform_steps=5)
    log = {f"truth/{STUDENT}/base": np.zeros((20, 7)), "time/put_back": np.array([put_back])}
    assert np.isfinite(_perform_arrays(life, log)["perform/path"]).all() == whole


def test_who_knows_no_truth_keeps_none(here: Scenario, tmp_path: Path) -> None:
    stage = Failing(here, None)
    stage.truth = None  # type: ignore[assignment]
    with Diary(tmp_path / "journal") as diary:
        lived = diary.lived(here, stage)
        witness = Witness(here, lived, lived)
        episode(here, lived, witness)
        assert np.isnan(witness.log()["truth/student/base"]).all()
    stage.close()
    assert Told(tmp_path / "journal").places == {}


def test_a_hole_is_told_up_to_and_lived_anew_from_before_it(here: Scenario, tmp_path: Path) -> None:
    undisturbed = lead(here, tmp_path / "journal")
    contents = bytearray((tmp_path / "journal").read_bytes())
    place = contents.index(b'{"number": 27')
    contents[place + 4 : place + 20] = b"x" * 16
    (tmp_path / "journal").write_bytes(contents)
    spoilt = Told(tmp_path / "journal")
    assert (len(spoilt.steps), spoilt.finished) == (27, False)
    assert spoilt.lost > 100
    senses = lead(here, tmp_path / "journal")
    assert senses[:21] == undisturbed[:21]
    again = Told(tmp_path / "journal")
    assert again.finished
    assert [step.number for step in again.steps] == list(range(STEPS + 1))
    assert lead(here, tmp_path / "journal") == senses


def changed(step: Step, **changes: Any) -> Step:
    return dataclasses.replace(step, **changes)


CHANGES: dict[str, Callable[[Step], Step]] = {
    "student": lambda step: changed(
        step, commands={**step.commands, STUDENT: np.nextafter(step.commands[STUDENT], 1.0)}
    ),
    "teacher_0": lambda step: changed(step, commands={**step.commands, "teacher_0": np.ones(2)}),
    "pan": lambda step: changed(step, pan_command=step.pan_command + 1e-9),
    "sense": lambda step: changed(step, tilts={**step.tilts, STUDENT: step.tilts[STUDENT] + 1e-3}),
}


@pytest.mark.parametrize("what", CHANGES)
def test_whoever_does_something_else_is_noticed(here: Scenario, tmp_path: Path, what: str) -> None:
    lead(here, tmp_path / "journal")
    told = Told(tmp_path / "journal").steps
    told[12] = CHANGES[what](told[12])
    robots = SimulatedStage(here).backend.robots
    lived = Lived(robots, told, live=None, control_step=1 / 30, name="the journal")
    who = "teacher_0" if what == "teacher_0" else "student"
    at = 13 if what == "sense" else 12
    with pytest.raises(UserError, match=f"the journal: {who} does not do at step {at}"):
        episode(here, lived)


def robots() -> dict[str, Morphology]:
    return {STUDENT: load_robot("crawler"), "teacher_0": load_robot("crawler")}


@given(st.lists(st.tuples(st.booleans(), st.booleans()), max_size=30))
def test_a_trial_goes_on_where_all_teachers_lay_still(moving: list[tuple[bool, bool]]) -> None:
    """Whatever the student did."""
    steps = [
        Step(
            number,
            0.0,
            {STUDENT: np.full(2, float(ours)), "teacher_0": np.full(2, float(theirs))},
            0,
            0,
            {},
            0,
            0,
        )
        for number, (ours, theirs) in enumerate(moving)
    ]
    count = resting_place(steps, robots())
    still = [number for number, (_, theirs) in enumerate(moving) if not theirs]
    assert count == (max(still) + 1 if still else 0)
