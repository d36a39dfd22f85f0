"""The rows of runs as Arrow tables, with the columns of :mod:`testbed.experiment.columns`.

To open ten thousand small Parquet files takes any reader half a minute. Where there are many their rows are therefore
kept together in ``.rows.parquet``, by the run when it sums up and by who reads them, with size and date of every file
that they are from: a file that is new or has changed since is read again. The copy is a convenience: nothing is lost
with it, and where it cannot be written nothing is said.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from testbed.errors import UserError, shown_path
from testbed.experiment.atomic import write_whole
from testbed.experiment.columns import CELLS, SELVES, TABLES, TRIALS, VERDICTS, Column
from testbed.experiment.jobs import Job, jobs_of
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.trial_files import DamagedError, decode_rows
from testbed.scenario import Scenario
from testbed.scenario.cells import sweep_of
from testbed.scenario.variation import is_distribution

KEPT = ".rows.parquet"
MANY = 200
"""Rows are kept together where there are so many files."""

_STAMPS = b"testbed.stamps"
_TYPES = {"text": pa.string(), "whole": pa.int64(), "number": pa.float64(), "flag": pa.bool_()}
_KINDS = {each.name: _TYPES[each.kind] for each in (*VERDICTS, *SELVES)} | {"kind": pa.string()}

Row = Mapping[str, Any]
Stamp = str
Progress = Callable[[int, int], None]
"""(done, total), called while files are read."""


class Damage(NamedTuple):
    """A trial whose table cannot be read, and why."""

    run: str
    job: Job
    why: str

    def __str__(self) -> str:
        return f"{self.job} of {self.run} is damaged ({self.why})"


@dataclass(frozen=True)
class Tables:
    """The rows of one or more runs.

    Attributes:
        by_name: ``verdicts``, ``selves``, ``trials`` and ``cells``: the documented columns, then any others that a run
            has.
        damaged: Trials that are left out because their file is damaged.
    """

    by_name: Mapping[str, pa.Table]
    damaged: tuple[Damage, ...]


def read_tables(folders: Sequence[Path], progress: Progress = lambda done, total: None) -> Tables:
    """Read the rows of finished trials of run directories.

    Raises:
        UserError: If one is no run directory, or is given twice.
    """
    runs = dict(zip(run_names(folders), folders, strict=True))
    read = [_read_run(name, RunDirectory.open(folder), progress) for name, folder in runs.items()]
    return Tables(
        {name: _joined([tables[name] for tables, _ in read], columns) for name, columns in TABLES.items()},
        tuple(damage for _, damaged in read for damage in damaged),
    )


def keep(run: RunDirectory, jobs: Sequence[Job], rows: Sequence[Row]) -> None:
    """Keep all rows of a run together, for the first question about them; those of few trials are read soon enough.

    Args:
        run: The run.
        jobs: Its finished trials.
        rows: All their rows, as they are on the disk.
    """
    if len(jobs) < MANY:
        return
    files = _files(run.path, dict.fromkeys(job.cell for job in jobs))
    stamps = {place_of(job): files.get(f"{place_of(job)}.parquet", "") for job in jobs}
    if _kept(run.path)[1] != stamps:
        _keep(run.path, _table(rows), stamps)


def run_names(folders: Sequence[Path]) -> tuple[str, ...]:
    """What runs are called: each by as many of its last folders as tell them all apart.

    Raises:
        UserError: If one is given twice.
    """
    paths = [folder.resolve() for folder in folders]
    for path, folder in zip(paths, folders, strict=True):
        if paths.count(path) > 1:
            raise UserError(f"{shown_path(folder)} is given twice", "give each run once")
    depth = 1
    while len(names := {"/".join(path.parts[-depth:]) for path in paths}) < len(paths):
        depth += 1
    return tuple("/".join(path.parts[-depth:]) for path in paths) if names else ()


def _read_run(name: str, run: RunDirectory, progress: Progress) -> tuple[dict[str, pa.Table], list[Damage]]:
    jobs = jobs_of(run.scenario)
    files = _files(run.path, dict.fromkeys(job.cell for job in jobs))
    stamps = {job: stamp for job in jobs if (stamp := files.get(f"{job.cell}/{job.trial}.parquet"))}
    rows, damaged = _rows(name, run.path, stamps, progress)
    faults = {damage.job: damage.why for damage in damaged}
    about = {"run": name, "scenario": run.scenario.name, "hash": run.hash8, "seed": run.scenario.seed}
    trials = []
    for job in jobs:
        state, why = "finished" if job in stamps else "missing", faults.get(job)
        if why:
            state = "damaged"
        elif state == "missing" and f"{job.cell}/{job.trial}.error.txt" in files:
            state, why = "failed", _last_line(run.error_file(job))
        trials.append({**about, "cell": job.cell, "trial": job.trial, "state": state, "why": why})
    kinds = pc.fill_null(rows["kind"], "verdict")
    named = rows.drop_columns(["kind"]).add_column(0, "run", pa.array([name] * len(rows), pa.string()))
    tables = {
        "verdicts": named.filter(pc.equal(kinds, "verdict")),
        "selves": named.filter(pc.equal(kinds, "self")),
        "trials": pa.Table.from_pylist(trials, schema=_schema(TRIALS)),
        "cells": pa.Table.from_pylist(list(_changes(name, run.scenario)), schema=_schema(CELLS)),
    }
    return tables, damaged


def _changes(name: str, scenario: Scenario) -> Iterator[Row]:
    """What every cell changes, as rows of the table ``cells``."""
    for cell, changes in cell_changes(scenario).items():
        for place, value in changes:
            number = isinstance(value, int | float) and not isinstance(value, bool)
            yield {
                "run": name,
                "cell": cell,
                "place": place,
                "value": value if isinstance(value, str) else json.dumps(value),
                "number": float(value) if number else None,
            }


def cell_changes(scenario: Scenario) -> dict[str, list[tuple[str, Any]]]:
    """By cell: what it changes, as (axis of the sweep or place in the scenario, value)."""
    if scenario.sweep:
        points = sweep_of(scenario).points
        return {cell: list(point.levels.items()) for cell, point in points.items()}
    return {cell: list(_leaves(changes)) for cell, changes in scenario.cells.items()}


def _leaves(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    if not isinstance(value, dict) or is_distribution(value):
        yield place, value
        return
    for key, below in value.items():
        yield from _leaves(below, f"{place}.{key}" if place else str(key))


def _files(folder: Path, cells: Iterable[str]) -> dict[str, Stamp]:
    """Every file of these cells' trials, ``<cell>/<file>``, with its size and date."""
    found = {}
    for cell in cells:
        with contextlib.suppress(FileNotFoundError), os.scandir(folder / "trials" / cell) as entries:
            for entry in entries:
                status = entry.stat()
                found[f"{cell}/{entry.name}"] = f"{status.st_size} {status.st_mtime_ns}"
    return found


def _rows(
    name: str, folder: Path, stamps: Mapping[Job, Stamp], progress: Progress
) -> tuple[pa.Table, list[Damage]]:
    """All rows of the trials, from the copy as far as it is fresh; and the trials that are damaged."""
    kept, known = _kept(folder)
    fresh = {job for job, stamp in stamps.items() if known.get(place_of(job)) == stamp}
    remaining = [job for job in stamps if job not in fresh]
    rows: list[Row] = []
    damaged: list[Damage] = []
    for number, job in enumerate(remaining):
        progress(number, len(remaining))
        try:
            rows += decode_rows(_contents(folder / "trials" / job.cell / f"{job.trial}.parquet"))
        except DamagedError as error:
            damaged.append(Damage(name, job, str(error)))
    if remaining:
        progress(len(remaining), len(remaining))
    parts = [_table(rows)]
    if kept is not None:
        names = pc.binary_join_element_wise(kept["cell"], kept["trial"].cast(pa.string()), "/")
        valid = pa.array([place_of(job) for job in fresh], pa.string())
        parts.insert(0, kept.filter(pc.is_in(names, value_set=valid)))
    table = pa.concat_tables(parts, promote_options="default").combine_chunks()
    if len(remaining) >= MANY:
        sound = {place_of(job): stamp for job, stamp in stamps.items()}
        for damage in damaged:
            del sound[place_of(damage.job)]
        _keep(folder, table, sound)
    return table, damaged


def place_of(job: Job) -> str:
    """A trial's place below ``trials/``, without the ending."""
    return f"{job.cell}/{job.trial}"


def _kept(folder: Path) -> tuple[pa.Table | None, dict[str, Stamp]]:
    """The copy, and from which files it is; nothing where there is none that can be read."""
    try:
        contents = (folder / KEPT).read_bytes()
        table = pq.read_table(pa.BufferReader(contents), page_checksum_verification=True)
        stamps = json.loads(table.schema.metadata[_STAMPS])
    except Exception:  # damaged bytes may raise anything; the rows are read from their own files then
        return None, {}
    return table.replace_schema_metadata(None), stamps


def _keep(folder: Path, table: pa.Table, stamps: Mapping[str, Stamp]) -> None:
    marked = table.replace_schema_metadata({_STAMPS: json.dumps(stamps)})
    with contextlib.suppress(UserError, OSError):  # somebody else's folder, or a full disk
        write_whole(folder / KEPT, lambda file: pq.write_table(marked, file, write_page_checksum=True))


def _contents(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise DamagedError(f"it cannot be read ({os.strerror(error.errno or 0).lower()})") from error


def _last_line(path: Path) -> str:
    """What a traceback ends with."""
    with contextlib.suppress(OSError):
        lines = path.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        return lines[-1] if lines else ""
    return ""


def _table(rows: Sequence[Row]) -> pa.Table:
    names = dict.fromkeys(("kind", "cell", "trial", *(name for row in rows for name in row)))
    columns = {name: [row.get(name) for row in rows] for name in names}
    return pa.table({name: _array(name, values) for name, values in columns.items()})


def _array(name: str, values: Sequence[Any]) -> pa.Array:
    if name not in _KINDS:  # of another version of this project; whatever fits
        return pa.array(values)
    return pa.array(values, pa.float64() if _KINDS[name] == pa.int64() else _KINDS[name]).cast(_KINDS[name])


def _schema(columns: Sequence[Column]) -> pa.Schema:
    return pa.schema([(each.name, _TYPES[each.kind]) for each in columns])


def _joined(tables: Sequence[pa.Table], columns: Sequence[Column]) -> pa.Table:
    """The runs' rows below each other: documented columns first, missing ones empty."""
    everything = [_schema(columns).empty_table(), *(_without_strangers(each, columns) for each in tables)]
    return pa.concat_tables(everything, promote_options="permissive")


def _without_strangers(table: pa.Table, columns: Sequence[Column]) -> pa.Table:
    """The table without columns that are empty and not documented here: those of the other kind of rows."""
    documented = {each.name for each in columns}
    return table.drop_columns(
        [
            name
            for name in table.column_names
            if name not in documented and table[name].null_count == len(table)
        ]
    )
