"""What a run has left behind, read for the report (the layout is that of `testbed.experiment`)."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.errors import UserError
from testbed.scenario import Scenario, cell_names, load_scenario, mind_names

Array = NDArray[Any]
Row = Mapping[str, Any]
APPROPRIATE, INAPPROPRIATE = "appropriate", "inappropriate"
TRUTHS = (APPROPRIATE, INAPPROPRIATE)
_COMMON = ("truth", "time", "perform")
"""Arrays that are about the world and not about what a mind made of it."""


@dataclass(frozen=True)
class Trial:
    """One finished trial: its rows, and its arrays, read when asked for.

    Attributes:
        cell: Of which cell.
        number: Which trial of it.
        path: The file with its arrays.
        rows: Verdicts, one a teacher and mind.
        selves: What the minds found out about their body, one row a mind.
        leader: The mind whose arrays have plain names; those of others are under ``beside/<name>/``.
        mind: Whose arrays and rows these are; everybody's rows and the leader's arrays if it is None.
    """

    cell: str
    number: int
    path: Path
    rows: tuple[Row, ...]
    selves: tuple[Row, ...] = ()
    leader: str = ""
    mind: str | None = None

    def of(self, mind: str) -> Trial:
        """The trial as one mind tells it."""
        own = tuple(row for row in self.rows if row["student"] == mind)
        selves = tuple(row for row in self.selves if row["student"] == mind)
        return replace(self, rows=own, selves=selves, mind=mind)

    def arrays(self) -> dict[str, Array]:
        """All arrays of the trial by their names in the file.

        Raises:
            UserError: If the file is damaged.
        """
        return self._read(None)

    def array(self, name: str) -> Array | None:
        """One array of the world or of this mind, or None where there is none of that name."""
        beside = self.mind not in (None, self.leader) and name.split("/")[0] not in _COMMON
        place = f"beside/{self.mind}/{name}" if beside else name
        return self._read(place).get(place)

    def _read(self, name: str | None) -> dict[str, Array]:
        try:
            with np.load(self.path, allow_pickle=False) as file:
                wanted = file.files if name is None else [name] if name in file.files else []
                return {key: file[key] for key in wanted}
        except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
            mend = "run the scenario again: damaged trials are set aside and computed anew"
            raise UserError(f"trial {self.number} cannot be read ({error})", mend, file=self.path) from error


@dataclass(frozen=True)
class RunRecord:
    """A run directory's contents.

    Attributes:
        directory: Where it is.
        name: The scenario's name.
        content_hash: The scenario's hash.
        scenario: The scenario, cells and distributions included.
        provenance: Versions, machine and seed.
        rows: Every verdict: one a teacher, mind and trial.
        selves: What every mind found out about its body: one a mind and trial.
        summary: The statistics of ``verdicts.json``, by student.
        summaries: The same by cell, then by student; empty where there is only one cell.
        trials: The trials whose arrays are at hand, in order.
    """

    directory: Path
    name: str
    content_hash: str
    scenario: Scenario
    provenance: Mapping[str, Any]
    rows: tuple[Row, ...]
    selves: tuple[Row, ...]
    summary: Mapping[str, Mapping[str, Any]]
    summaries: Mapping[str, Mapping[str, Mapping[str, Any]]]
    trials: tuple[Trial, ...]

    @cached_property
    def cells(self) -> tuple[str, ...]:
        """The cells that have rows, in the scenario's order; ("default",) without cells."""
        there = dict.fromkeys(str(row["cell"]) for row in (*self.rows, *self.selves))
        known = [cell for cell in cell_names(self.scenario) if cell in there]
        return tuple(dict.fromkeys([*known, *there]))

    @cached_property
    def students(self) -> tuple[str, ...]:
        """All minds by name: those of the first cell in the scenario's order, the leader first, then any others."""
        there = dict.fromkeys(str(row["student"]) for row in (*self.rows, *self.selves))
        listed = [name for cell in self.cells for name in minds_of(self.scenario, cell) if name in there]
        return tuple(dict.fromkeys([*listed, *there]))

    @property
    def trial_count(self) -> int:
        """How many trials there are, over all cells."""
        return len({(row["cell"], row["trial"]) for row in (*self.rows, *self.selves)})

    def of_cell(self, cell: str) -> tuple[Trial, ...]:
        """The trials of a cell."""
        return tuple(trial for trial in self.trials if trial.cell == cell)

    def verdicts(self, *, cell: str | None = None, student: str | None = None) -> list[Row]:
        """The verdicts in a cell and of a student; of all where None."""
        return chosen_rows(self.rows, cell=cell, student=student)


def chosen_rows(rows: Sequence[Row], *, cell: str | None = None, student: str | None = None) -> list[Row]:
    """The rows of a cell and of a student; of all where None."""
    return [row for row in rows if cell in (None, row["cell"]) and student in (None, row["student"])]


def minds_of(scenario: Scenario, cell: str) -> tuple[str, ...]:
    """The names of the minds in a cell, the leader first; none where the scenario does not have the cell."""
    if cell not in cell_names(scenario):
        return ()
    return mind_names(scenario, cell)


def read_run(directory: Path) -> RunRecord:
    """Read a run directory.

    Raises:
        UserError: If it is none, or its files are damaged.
    """
    verdicts = _json(directory / "verdicts.json")
    rows, selves = tuple(verdicts["verdicts"]), tuple(verdicts.get("selves", ()))
    if not rows and not selves:
        raise UserError("this run has no finished trial", "run its scenario first", file=directory)
    _text(directory / "scenario.resolved.yaml")
    scenario = load_scenario(directory / "scenario.resolved.yaml")
    return RunRecord(
        directory=directory,
        name=str(verdicts["scenario"]),
        content_hash=str(verdicts["hash"]),
        scenario=scenario,
        provenance=_json(directory / "provenance.json"),
        rows=rows,
        selves=selves,
        summary=verdicts.get("summary", {}),
        summaries=verdicts.get("cells", {}),
        trials=_trials(directory, scenario, rows, selves),
    )


def _trials(
    directory: Path, scenario: Scenario, rows: Sequence[Row], selves: Sequence[Row]
) -> tuple[Trial, ...]:
    by_trial: dict[tuple[str, int], tuple[list[Row], list[Row]]] = {}
    for kind, listed in enumerate((rows, selves)):
        for row in listed:
            by_trial.setdefault((str(row["cell"]), int(row["trial"])), ([], []))[kind].append(row)
    leaders = {cell: next(iter(minds_of(scenario, cell)), "") for cell, _ in by_trial}
    files = {
        cell: {_number(path): path for path in sorted((directory / "trials" / cell).glob("*.npz"))}
        for cell in leaders
    }
    return tuple(
        Trial(cell, number, files[cell][number], tuple(own), tuple(itself), leaders[cell])
        for (cell, number), (own, itself) in sorted(by_trial.items())
        if number in files[cell]
    )


def _number(path: Path) -> int:
    digits = "".join(letter for letter in path.stem if letter.isdigit())
    return int(digits) if digits else -1


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        mend = "give the directory of a finished run, or run its scenario again"
        raise UserError(f"{path.name} cannot be read", mend, file=path.parent) from error


def _json(path: Path) -> Any:
    try:
        return json.loads(_text(path))
    except json.JSONDecodeError as error:
        mend = "run the scenario again, which writes it anew"
        raise UserError("this is no JSON", mend, file=path, line=error.lineno) from error
