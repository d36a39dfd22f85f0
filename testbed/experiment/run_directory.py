"""The folder that a run leaves behind, and continues from.

::

    <scenario>-<hash8>/
        scenario.resolved.yaml     everything, defaults filled in
        robots/                    copies of the robots and recordings that the scenario gives by path
        provenance.json            what computed it; written once
        trials/<cell>/<trial>.npz and .parquet
        verdicts.json  report.html  figures/  video/

A trial is finished when its table is there: arrays are written first, the table second, each whole or not at
all. One process writes at a time, held by a lock that dies with the process.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from testbed.bodies.robot_files import copies_of
from testbed.errors import UserError, shown_path
from testbed.experiment.atomic import refused_writes_explained, sweep, write_text, write_whole
from testbed.experiment.jobs import Job
from testbed.experiment.record import TrialResult
from testbed.experiment.trial_files import DamagedError, decode_rows, encode
from testbed.scenario import Scenario, content_hash, load_scenario, resolve, with_robot_files

_LOCK = ".lock"
_SCENARIO = "scenario.resolved.yaml"
_PROVENANCE = "provenance.json"
_ROBOTS = "robots"
_DAMAGED = ".damaged"
Notice = Callable[[str], None]


class RunDirectory:
    """A run directory that exists; make or find one with :meth:`prepare` or :meth:`open`."""

    def __init__(self, path: Path, scenario: Scenario, hash8: str) -> None:
        self.path = path
        self.scenario = scenario
        self.hash8 = hash8

    @classmethod
    def open(cls, path: Path) -> RunDirectory:
        """An existing run directory, to read from.

        Raises:
            UserError: If there is none at ``path``, or its scenario cannot be read.
        """
        if not (path / _SCENARIO).is_file():
            raise UserError(
                f"{shown_path(path)} is no run directory",
                "give the folder that `testbed run` printed, such as runs/whom_to_imitate-1a2b3c4d",
            )
        scenario = load_scenario(path / _SCENARIO)
        return cls(path, scenario, _recorded_hash(path) or content_hash(scenario))

    @classmethod
    @contextlib.contextmanager
    def prepare(cls, path: Path, scenario: Scenario, provenance: Callable[[], Any]) -> Iterator[RunDirectory]:
        """A run directory for this scenario to write into, locked for the length of the ``with`` block.

        Args:
            path: Where; made if missing, continued if it holds a run of the same scenario.
            scenario: What is run. Its number of trials may differ from last time.
            provenance: Called once in the life of the directory, for what ``provenance.json`` is to say.

        Raises:
            UserError: If the place cannot be written, is in use by another process, holds a run of another
                scenario, or is a folder of something else, or if two different robots' files have one name.
        """
        with refused_writes_explained(path):
            _refuse_foreign(path)
            path.mkdir(parents=True, exist_ok=True)
            lock = (path / _LOCK).open("w")
        with lock:
            _take(lock, path)
            sweep(path)
            run = cls(path, scenario, content_hash(scenario))
            run._refuse_another_scenario()
            _update(path / _SCENARIO, resolve(_with_robots_kept(scenario, path)).encode())
            if not (path / _PROVENANCE).exists():
                record = {"scenario": scenario.name, "hash": run.hash8, **provenance()}
                write_text(path / _PROVENANCE, json.dumps(record, indent=2) + "\n")
            yield run

    @property
    def provenance(self) -> dict[str, Any]:
        """What ``provenance.json`` says; empty where it is missing or broken."""
        return _provenance(self.path)

    def write_trial(self, job: Job, result: TrialResult) -> None:
        """Keep a finished trial: arrays first, then the table that marks it finished.

        Raises:
            UserError: If the disk is full or the folder cannot be written.
        """
        arrays, table = encode(result)
        write_whole(self._file(job, ".npz"), lambda file: _write(file, arrays))
        write_whole(self._file(job, ".parquet"), lambda file: _write(file, table))
        self.error_file(job).unlink(missing_ok=True)

    def write_error(self, job: Job, details: str) -> Path:
        """Keep the traceback of a trial that failed; returns its file."""
        write_text(self.error_file(job), details)
        return self.error_file(job)

    def error_file(self, job: Job) -> Path:
        """Where the traceback of a failed trial is kept."""
        return self._file(job, ".error.txt")

    def is_finished(self, job: Job) -> bool:
        """Whether the trial's table is there; says nothing of whether it is whole."""
        return self._file(job, ".parquet").is_file()

    def read_rows(self, job: Job) -> tuple[dict[str, Any], ...]:
        """The rows of a finished trial, checked, without its arrays.

        Raises:
            UserError: If its table is missing or damaged.
        """
        try:
            return decode_rows(self._read(job, ".parquet"))
        except DamagedError as error:
            raise self._unreadable(job, error) from error

    def finished(self, jobs: Sequence[Job], notice: Notice) -> frozenset[Job]:
        """Those of ``jobs`` that are finished and whole; damaged files are set aside as ``*.damaged``.

        Raises:
            UserError: If a damaged file cannot be set aside.
        """
        return frozenset(job for job in jobs if self.is_finished(job) and self._is_whole(job, notice))

    def _is_whole(self, job: Job, notice: Notice) -> bool:
        try:
            decode_rows(self._read(job, ".parquet"), arrays=self._read(job, ".npz"))
        except DamagedError as error:
            with refused_writes_explained(self.path):
                for suffix in (
                    ".parquet",
                    ".npz",
                ):  # the table first: without it the trial counts as unfinished
                    with contextlib.suppress(FileNotFoundError):
                        file = self._file(job, suffix)
                        file.replace(file.with_name(file.name + _DAMAGED))
            notice(f"{job}: {error}; its files are set aside as *{_DAMAGED} and it is computed again")
            return False
        return True

    def _read(self, job: Job, suffix: str) -> bytes:
        try:
            return self._file(job, suffix).read_bytes()
        except OSError as error:
            reason = os.strerror(error.errno or 0).lower()
            raise DamagedError(f"{self._file(job, suffix).name} cannot be read ({reason})") from error

    def _unreadable(self, job: Job, error: DamagedError) -> UserError:
        return UserError(
            f"{job} in {shown_path(self.path)}: {error}", "run the scenario again to compute the trial anew"
        )

    def _file(self, job: Job, suffix: str) -> Path:
        return self.path / "trials" / job.cell / f"{job.trial}{suffix}"

    def _refuse_another_scenario(self) -> None:
        recorded = _recorded_hash(self.path)
        if recorded is None and (self.path / _SCENARIO).is_file():  # killed before provenance was written
            recorded = content_hash(load_scenario(self.path / _SCENARIO))
        if recorded not in (None, self.hash8):
            raise UserError(
                f"{shown_path(self.path)} holds a run of another scenario or seed "
                f"({recorded}, not {self.hash8})",
                "give another folder with --out DIR, or delete that one",
            )


def default_path(scenario: Scenario) -> Path:
    """``runs/<scenario>-<hash8>`` below the working directory."""
    return Path("runs") / f"{scenario.name}-{content_hash(scenario)}"


def _refuse_foreign(path: Path) -> None:
    if path.exists() and not path.is_dir():
        raise UserError(f"{shown_path(path)} is a file, not a folder", "give another place with --out DIR")
    ours = (_SCENARIO, _PROVENANCE, _LOCK)
    if path.is_dir() and any(path.iterdir()) and not any((path / name).exists() for name in ours):
        raise UserError(
            f"{shown_path(path)} holds files but no run", "give a new or an empty folder with --out DIR"
        )


def _take(lock: IO[str], path: Path) -> None:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise UserError(
            f"another process is writing {shown_path(path)}", "wait until it ends, or give another --out DIR"
        ) from None
    except OSError as error:
        raise UserError(
            f"{shown_path(path)} cannot be locked ({os.strerror(error.errno or 0).lower()})",
            "give a folder on a local disk with --out DIR",
        ) from error


def _with_robots_kept(scenario: Scenario, folder: Path) -> Scenario:
    """The scenario with copies of its robots' files, so that the folder means the same wherever it goes."""
    kept: dict[str, bytes] = {}

    def keep(robot: str) -> str:
        copies = copies_of(Path(robot))
        for name, contents in copies.items():
            if kept.setdefault(name, contents) != contents:
                raise UserError(
                    f"two different robots are in files named '{name}'", "rename one of the files"
                )
        return f"{_ROBOTS}/{next(iter(copies))}"

    relative = with_robot_files(scenario, keep)
    for name, contents in kept.items():
        _update(folder / _ROBOTS / name, contents)
    return relative


def _update(path: Path, contents: bytes) -> None:
    if not path.is_file() or path.read_bytes() != contents:
        write_whole(path, lambda file: _write(file, contents))


def _provenance(path: Path) -> dict[str, Any]:
    try:
        record = json.loads((path / _PROVENANCE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def _recorded_hash(path: Path) -> str | None:
    recorded = _provenance(path).get("hash")
    return recorded if isinstance(recorded, str) else None


def _write(file: IO[bytes], contents: bytes) -> None:
    file.write(contents)
