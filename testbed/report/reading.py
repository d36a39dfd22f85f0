"""What a run has left behind, read for the report (the layout is that of `testbed.experiment`)."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from testbed.errors import UserError

Array = NDArray[Any]
Row = Mapping[str, Any]
APPROPRIATE, INAPPROPRIATE = "appropriate", "inappropriate"
TRUTHS = (APPROPRIATE, INAPPROPRIATE)


@dataclass(frozen=True)
class Trial:
    """One finished trial: its rows, one a teacher, and its arrays, read when asked for."""

    cell: str
    number: int
    path: Path
    rows: tuple[Row, ...]

    def arrays(self) -> dict[str, Array]:
        """All arrays of the trial by name.

        Raises:
            UserError: If the file is damaged.
        """
        return self._read(None)

    def array(self, name: str) -> Array | None:
        """One array, or None where this trial has none of that name."""
        return self._read(name).get(name)

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
        scenario: The resolved scenario as plain data.
        provenance: Versions, machine and seed.
        rows: Every verdict: one a teacher and trial.
        summary: The statistics of ``verdicts.json``, by student.
        trials: The trials whose arrays are at hand, in order.
    """

    directory: Path
    name: str
    content_hash: str
    scenario: Mapping[str, Any]
    provenance: Mapping[str, Any]
    rows: tuple[Row, ...]
    summary: Mapping[str, Mapping[str, Any]]
    trials: tuple[Trial, ...]

    @property
    def cells(self) -> tuple[str, ...]:
        """The cells of the sweep, in the order of the rows; ("default",) without a sweep."""
        return tuple(dict.fromkeys(str(row["cell"]) for row in self.rows))

    def of_cell(self, cell: str) -> tuple[Trial, ...]:
        """The trials of a cell."""
        return tuple(trial for trial in self.trials if trial.cell == cell)


def read_run(directory: Path) -> RunRecord:
    """Read a run directory.

    Raises:
        UserError: If it is none, or its files are damaged.
    """
    verdicts = _json(directory / "verdicts.json")
    rows = tuple(verdicts["verdicts"])
    if not rows:
        raise UserError("this run has no finished trial", "run its scenario first", file=directory)
    scenario = yaml.safe_load(_text(directory / "scenario.resolved.yaml"))
    for owner in (scenario["student"], *scenario["teachers"]):
        if "/" in owner["robot"]:  # a file kept in the run directory, not a name
            owner["robot"] = str(directory / owner["robot"])
    return RunRecord(
        directory=directory,
        name=str(verdicts["scenario"]),
        content_hash=str(verdicts["hash"]),
        scenario=scenario,
        provenance=_json(directory / "provenance.json"),
        rows=rows,
        summary=verdicts.get("summary", {}),
        trials=_trials(directory, rows),
    )


def _trials(directory: Path, rows: tuple[Row, ...]) -> tuple[Trial, ...]:
    by_trial: dict[tuple[str, int], list[Row]] = {}
    for row in rows:
        by_trial.setdefault((str(row["cell"]), int(row["trial"])), []).append(row)
    found = []
    for (cell, number), own in by_trial.items():
        paths = [path for path in (directory / "trials" / cell).glob("*.npz") if _number(path) == number]
        found += [Trial(cell, number, path, tuple(own)) for path in paths[:1]]
    return tuple(found)


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
