"""A trial's journal, from the trial's point of view: what was lived before, and what is lived now."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from testbed.bodies.morphology import Vector
from testbed.errors import UserError, shown_path
from testbed.experiment.lived import Lived, resting_place
from testbed.experiment.stage import Stage
from testbed.hardware.failures import HardwareFailure
from testbed.hardware.journal import Journal, Lost, Note, Places, read_journal, whole_steps
from testbed.scenario import Scenario
from testbed.world.bullet import bodies_of

FINISHED, FAILED, RESUMED, UNFINISHED = "finished", "failed", "resumed", "unfinished"
"""Kinds of notes; an unfinished step's says, in JSON, which it was and what had been commanded."""


class Told:
    """What a journal holds of a trial.

    Attributes:
        steps: As they count: all up to the first that is lost.
        notes: How often it broke off and why, where it went on, whether it was finished.
        lost: How many bytes of it are damaged.
        places: By step, where everybody really was, as far as somebody knew.
        resumed: The steps after which everybody was put in place again.
    """

    def __init__(self, path: Path) -> None:
        records = read_journal(path)
        self.steps, self._whole = whole_steps(records)
        self.notes = [record for record in records if isinstance(record, Note)]
        self.lost = sum(record.count for record in records if isinstance(record, Lost))
        self.places = {record.number: record for record in records if isinstance(record, Places)}
        self.resumed: list[int] = []
        for note in self.notes:
            if note.kind == RESUMED:
                at = int(note.text.rpartition(" ")[2])
                self.resumed = [before for before in self.resumed if before < at] + [at]

    @property
    def finished(self) -> bool:
        """Whether the student had lived its life, and none of it is lost."""
        return self._whole and any(note.kind == FINISHED for note in self.notes)


class Diary:
    """Keeps a trial's journal while it is lived. A context manager; an error that passes through is noted.

    Attributes:
        journal: The file.

    Args:
        path: Where; a trial that is there already is told again first.
    """

    def __init__(self, path: Path) -> None:
        self._told = Told(path) if path.exists() else None
        self._finished = self._told is not None and self._told.finished
        self._stage: Stage | None = None
        self.journal = Journal(path)

    def lived(self, scenario: Scenario, stage: Stage) -> Lived:
        """The world as the student meets it: what was lived before, then the stage's."""
        self._stage, robots, told = stage, bodies_of(scenario), self._told
        steps = told.steps if told is not None else []
        if not self._finished:
            steps = steps[: resting_place(steps, robots)]
        return Lived(
            robots,
            steps,
            live=stage.backend,
            truth=stage.truth,
            control_step=scenario.world.control_step,
            now=stage.now,
            write=self.journal.step,
            known=told.places if told is not None else {},
            know=self.journal.places,
            put_back=told.resumed if told is not None else (),
            resumed=lambda number: self._note(RESUMED, f"from step {number}"),
            broke_off=self._broke_off,
            name=shown_path(self.journal.path),
        )

    def finish(self) -> None:
        """The student has lived its life."""
        if not self._finished:
            self._note(FINISHED, "")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(UserError) if error is not None else contextlib.nullcontext():
            if error is not None:
                outcome = error.outcome if isinstance(error, HardwareFailure) else type(error).__name__
                self._note(FAILED, f"{outcome}: {error}")
            self.journal.close()

    def _broke_off(self, number: int, commands: Mapping[str, Vector], pan: float) -> None:
        told = {name: targets.tolist() for name, targets in commands.items()}
        self._note(UNFINISHED, json.dumps({"number": number, "commands": told, "pan_command": pan}))

    def _note(self, kind: str, text: str) -> None:
        clock = self._stage.now if self._stage is not None else None
        self.journal.note(clock() if clock is not None else 0.0, kind, text)
