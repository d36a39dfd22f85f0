"""Several runs held against each other: whose verdicts are about the same teachers in the same trials?

Two verdicts are matched if they are about the same teacher: the same trial of the same cell under the same seed, and
the teacher drawn alike: body, size, gait, place and truth. Everything else may differ between the runs; what does is
listed.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from testbed.errors import UserError
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.tables import Damage, Progress, read_tables, run_names
from testbed.scenario import Scenario, cell_names, drawn, in_cell, with_robot_files

Row = dict[str, Any]
Key = tuple[str, int, str]
"""Cell, trial and teacher."""

_STAGED = ("robot", "truth", "scale", "distance", "bearing_deg", "facing_deg")
_NOT_COMPARED = ("name", "description", "trials")
_LONGEST = 80


class Contender(NamedTuple):
    """A student of a run.

    Attributes:
        label: What it is called here: by the student's name; with the run's where two students share a name.
        run: The run's name.
        student: Its name in the run.
    """

    label: str
    run: str
    student: str


class Match(NamedTuple):
    """The verdicts of two contenders on the same teachers, in order.

    Attributes:
        first: Of the first contender.
        second: Of the second, row by row about the same teacher.
        alone: How many verdicts of either have no counterpart.
    """

    first: tuple[Row, ...]
    second: tuple[Row, ...]
    alone: int


@dataclass(frozen=True)
class Side:
    """One of the runs.

    Attributes:
        name: What it is called here.
        directory: The run directory.
        rows: Its verdicts.
        damaged: Trials that cannot be read.
    """

    name: str
    directory: RunDirectory
    rows: tuple[Row, ...]
    damaged: tuple[Damage, ...]

    @property
    def scenario(self) -> Scenario:
        """What was run."""
        return self.directory.scenario

    @cached_property
    def students(self) -> tuple[str, ...]:
        """Its students, those of its first cell in the scenario's order, the leader first."""
        there = dict.fromkeys(str(row["student"]) for row in self.rows)
        cells = dict.fromkeys(str(row["cell"]) for row in self.rows)
        listed = [mind.name for cell in cells for mind in in_cell(self.scenario, cell).minds]
        return tuple(dict.fromkeys([*(name for name in listed if name in there), *there]))

    def by_key(self, student: str) -> dict[Key, Row]:
        """The verdicts of a student by the teacher that they are about."""
        own = [row for row in self.rows if row["student"] == student]
        return {(row["cell"], row["trial"], row["teacher"]): row for row in own}

    @cached_property
    def said(self) -> dict[str, Any]:
        """The scenario by place, robots' and recordings' files by what is in them."""
        return {
            place: value
            for place, value in _flat(with_robot_files(self.scenario, _by_contents).template)
            if place.split(".")[0] not in _NOT_COMPARED
        }

    def teacher(self, key: Key) -> Any:
        """A teacher as it was drawn: how it stood and moved, and its body."""
        cell, trial, name = key
        if (cell, trial) not in self._drawn:
            self._drawn[cell, trial] = drawn(in_cell(self.scenario, cell), trial)
        spec = self._drawn[cell, trial].teachers[int(name.rpartition("_")[2])]
        return spec.model_dump(exclude={"robot"}), spec.body()

    @cached_property
    def _drawn(self) -> dict[tuple[str, int], Scenario]:
        return {}


def read_sides(folders: Sequence[Path], progress: Progress = lambda done, total: None) -> tuple[Side, ...]:
    """Read the runs.

    Raises:
        UserError: If one is no run directory, is given twice, or has no verdict.
    """
    sides = []
    for name, folder in zip(run_names(folders), folders, strict=True):
        directory, tables = RunDirectory.open(folder), read_tables([folder], progress)
        rows = tuple(tables.by_name["verdicts"].to_pylist())
        if not rows:
            raise UserError(f"{name} has no verdict yet", "run its scenario first")
        sides.append(Side(name, directory, rows, tables.damaged))
    return tuple(sides)


def contenders(sides: Sequence[Side]) -> tuple[Contender, ...]:
    """Every student of every run, the first run's leader first."""
    everybody = [(side.name, student) for side in sides for student in side.students]
    names = [student for _, student in everybody]
    return tuple(
        Contender(student if names.count(student) == 1 else f"{student} ({run})", run, student)
        for run, student in everybody
    )


def matched(one: Side, first: str, other: Side, second: str) -> Match:
    """The verdicts of two students on the same teachers.

    Args:
        one: A run.
        first: Its student.
        other: Another run, or the same.
        second: Its student.
    """
    ours, theirs = one.by_key(first), other.by_key(second)
    alike = _alike(one, other)
    common = [key for key in ours if key in theirs and alike(key, ours[key], theirs[key])]
    return Match(
        tuple(ours[key] for key in common),
        tuple(theirs[key] for key in common),
        len(ours) + len(theirs) - 2 * len(common),
    )


def differences(sides: Sequence[Side]) -> list[tuple[str, tuple[str, ...]]]:
    """Where the runs' scenarios differ: each place with what every run has there."""
    places = dict.fromkeys(itertools.chain.from_iterable(side.said for side in sides))
    found = []
    for place in places:
        values = tuple(_shown(side.said.get(place)) for side in sides)
        if len(set(values)) > 1:
            found.append((place, values))
    return found


def why_unmatched(one: Side, other: Side) -> UserError:
    """What to tell of two runs that have no teacher in common."""
    what = f"{one.name} and {other.name} have no teacher in common"
    seeds = one.scenario.seed, other.scenario.seed
    if seeds[0] != seeds[1]:
        return UserError(
            f"{what}: their seeds are {seeds[0]} and {seeds[1]}", "run one again with the other's --seed"
        )
    cells = [set(cell_names(side.scenario)) for side in (one, other)]
    if not cells[0] & cells[1]:
        shown = " and ".join(", ".join(list(cell_names(side.scenario))[:3]) for side in (one, other))
        return UserError(f"{what}: their cells are {shown}", "compare runs of the same scenario")
    for place, values in differences((one, other)):
        if place.startswith(("teachers", "cells", "sweep", "variation")):
            return UserError(
                f"{what}: {place} is {values[0]} and {values[1]}", "compare students on the same teachers"
            )
    return UserError(
        f"{what}: no trial is finished in both", "run either again until both have the same trials"
    )


def _alike(one: Side, other: Side) -> Any:
    """Tells of a teacher whether it is the same in both runs."""
    if one is other:
        return lambda key, ours, theirs: True
    if one.scenario.seed != other.scenario.seed:
        return lambda key, ours, theirs: False
    about = ("teachers", "cells", "sweep", "variation")
    same = {place.split(".")[0] for place, _ in differences((one, other))}.isdisjoint(about)

    def alike(key: Key, ours: Row, theirs: Row) -> bool:
        staged = all(ours.get(name) == theirs.get(name) for name in _STAGED)
        return staged and (same or one.teacher(key) == other.teacher(key))

    return alike


def _by_contents(path: str) -> str:
    file = Path(path)
    digest = hashlib.sha256(file.read_bytes()).hexdigest()[:8]
    return f"{file.stem} {digest}{file.suffix}"


def _flat(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    items: Iterable[tuple[Any, Any]] = ()
    if isinstance(value, Mapping):
        items = value.items()
    elif isinstance(value, list | tuple) and any(isinstance(each, Mapping) for each in value):
        items = enumerate(value)
    else:
        yield place, value
    for key, below in items:
        yield from _flat(below, f"{place}.{key}" if place else str(key))


def _shown(value: Any) -> str:
    text = "-" if value is None else str(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."
