"""A run in simulation and the same run on the bench, held against each other: tilt, rolls, verdicts, paths.

Trials are matched by number: the same scenario and seed draw the same teachers, gaits and chances in both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.errors import UserError, shown_path
from testbed.experiment.bench_twin import Twin, rests, twin_of
from testbed.experiment.jobs import Job, jobs_of
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.trial_files import DamagedError, decode
from testbed.student.moving.rolls import read_rolls
from testbed.vision.primitives import OMEGA
from testbed.world.placement import STUDENT, teacher_names

Array = NDArray[Any]
Arrays = Mapping[str, Array]
Row = Mapping[str, Any]

MOST_LAG = 0.5
"""Seconds by which one side's rolls may be behind the other's: servos lag, and looks begin at different steps."""
_LAGS = 61


@dataclass(frozen=True)
class Tilts:
    """What the student felt after each command of its self-discovery, and what its simulated twin does.

    Attributes:
        trial: Of which trial.
        commands: (k, n) rad.
        felt: (k, 2) rad, on the bench: to the side, nose-down.
        simulated: (k, 2) rad, of the twin under the same actions.
    """

    trial: int
    commands: Array
    felt: Array
    simulated: Array


@dataclass(frozen=True)
class Rolls:
    """How a teacher moved as the student saw it, in simulation and on the bench.

    Attributes:
        trial: Of which trial.
        teacher: Which teacher.
        times: (F,) s, of the bench's frames, from the first on.
        bench: (F, k) rad, of the main body and the limbs in motor order.
        simulation: (F, k) rad, at the same moments less the lag.
        shared: (F,) at which of these moments the simulation's were seen too.
        lag: s, by which the bench is behind.
        of_simulation: Times (s) and rolls (rad) as they were seen in simulation.
    """

    trial: int
    teacher: str
    times: Array
    bench: Array
    simulation: Array
    shared: Array
    lag: float
    of_simulation: tuple[Array, Array]

    @property
    def gaps(self) -> Array:
        """(frames that both have, k) rad, bench less simulation."""
        return read_rolls((self.bench - self.simulation)[self.shared], "half_turn")


@dataclass(frozen=True)
class Paths:
    """Where the student went while it imitated, from where it began, its own x axis to the right: (steps, 2) m.

    Attributes:
        trial: In which trial.
        step: From one place to the next, s.
        simulation: In simulation.
        bench: On the bench.
        twin: In simulation, commanded as on the bench.
    """

    trial: int
    step: float
    simulation: Array
    bench: Array
    twin: Array


@dataclass(frozen=True)
class Comparison:
    """Two runs of one scenario.

    Attributes:
        simulation: The run in simulation.
        bench: The run on the bench.
        jobs: The trials that both have finished.
        verdicts: Pairs of rows about the same teacher and mind, simulation first.
        tilts: One a trial.
        rolls: One a trial and teacher that both have found.
        paths: One a trial in which both imitated and places are known.
        placeless: Whether the bench knows no places.
        images: (2, 2, 75, 100) a teacher in both, simulation first, where there is one.
    """

    simulation: RunDirectory
    bench: RunDirectory
    jobs: tuple[Job, ...]
    verdicts: tuple[tuple[Row, Row], ...]
    tilts: tuple[Tilts, ...]
    rolls: tuple[Rolls, ...]
    paths: tuple[Paths, ...]
    placeless: bool
    images: Array | None


def compared(
    simulation: RunDirectory,
    bench: RunDirectory,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Comparison:
    """Hold the two against each other; each trial of the bench is lived through by its simulated twin.

    Raises:
        UserError: If they have no finished trial in common, or one is damaged.
    """
    jobs = [job for job in jobs_of(bench.scenario) if simulation.is_finished(job) and bench.is_finished(job)]
    if not jobs:
        what = f"{shown_path(simulation.path)} and {shown_path(bench.path)} have no finished trial in common"
        raise UserError(what, "run the scenario in simulation and on the bench")
    verdicts, tilts, rolls, paths = [], [], [], []
    images: Array | None = None
    placeless = True
    for number, job in enumerate(jobs):
        progress(number, len(jobs))
        verdicts += _verdict_pairs(simulation, bench, job)
        ours, theirs = _arrays(simulation, job), _arrays(bench, job)
        actions = theirs[f"truth/{STUDENT}/actions"]
        twin = twin_of(bench.scenario, job, actions)
        tilts += _tilts(job, theirs, twin, actions)
        for teacher in teacher_names(bench.scenario):
            rolls += _rolls(job, teacher, ours, theirs)
            images = _images(teacher, ours, theirs) if images is None else images
        placeless &= not _has_places(theirs)
        paths += _paths(job, ours, theirs, twin)
    progress(len(jobs), len(jobs))
    return Comparison(
        simulation,
        bench,
        tuple(jobs),
        tuple(verdicts),
        tuple(tilts),
        tuple(rolls),
        tuple(paths),
        placeless,
        images,
    )


def _verdict_pairs(simulation: RunDirectory, bench: RunDirectory, job: Job) -> list[tuple[Row, Row]]:
    def by_name(run: RunDirectory) -> dict[tuple[str, str], Row]:
        rows = run.read_rows(job)
        return {
            (row["student"], row["teacher"]): row for row in rows if row.get("kind", "verdict") == "verdict"
        }

    ours, theirs = by_name(simulation), by_name(bench)
    return [(row, theirs[key]) for key, row in ours.items() if key in theirs]


def _tilts(job: Job, bench: Arrays, twin: Twin, actions: Array) -> list[Tilts]:
    if "self/commands" not in bench or not len(bench["self/commands"]):
        return []
    steps = rests(bench["self/commands"], actions)
    kept = [(number, step) for number, step in enumerate(steps) if step is not None]
    if not kept:
        return []
    numbers = [number for number, _ in kept]
    return [
        Tilts(
            job.trial,
            bench["self/commands"][numbers],
            bench["self/tilt"][numbers],
            twin.tilt[[step for _, step in kept]],
        )
    ]


def _rolls(job: Job, teacher: str, ours: Arrays, theirs: Arrays) -> list[Rolls]:
    seen = [_seen(teacher, arrays) for arrays in (ours, theirs)]
    if seen[0] is None or seen[1] is None or seen[0][1].shape[1] != seen[1][1].shape[1]:
        return []
    (times, rolls), (bench_times, bench_rolls) = seen[0], seen[1]
    best: tuple[float, Rolls] | None = None
    for lag in np.linspace(-MOST_LAG, MOST_LAG, _LAGS).tolist():
        moments = bench_times - lag
        shared = (moments >= times[0]) & (moments <= times[-1])
        if not shared.any():
            continue
        shown = _at(moments, times, rolls)
        made = Rolls(job.trial, teacher, bench_times, bench_rolls, shown, shared, lag, (times, rolls))
        gap = float(np.sqrt(np.mean(made.gaps**2)))
        # Of equal fits the smaller lag: somebody who stands still has none.
        if best is None or gap < best[0] - 1e-9 or (gap < best[0] + 1e-9 and abs(lag) < abs(best[1].lag)):
            best = gap, made
    return [best[1]] if best is not None else []


def _seen(teacher: str, arrays: Arrays) -> tuple[Array, Array] | None:
    """Times (s) from the first frame on, and rolls (rad) of the parts that stand for the student's own."""
    names = [f"{teacher}/{name}" for name in ("motion_times", "motion_parts", "order")]
    if any(name not in arrays for name in names):
        return None
    times, parts, order = (arrays[name] for name in names)
    return times - times[0], parts[:, order, OMEGA]


def _at(moments: Array, times: Array, rolls: Array) -> Array:
    """(F, k) rolls at other moments; what is before the first or after the last frame stays as it is there."""
    # A roll is the same after half a turn: what is interpolated is the direction of twice the angle.
    turning = np.unwrap(2 * rolls, axis=0) / 2
    return np.stack([np.interp(moments, times, line) for line in turning.T], axis=1)


def _images(teacher: str, ours: Arrays, theirs: Arrays) -> Array | None:
    name = f"{teacher}/images"
    return np.stack([ours[name][0], theirs[name][0]]) if name in ours and name in theirs else None


def _has_places(arrays: Arrays) -> bool:
    base = arrays.get(f"truth/{STUDENT}/base")
    return base is not None and base.size > 0 and bool(np.isfinite(base).all())


def _paths(job: Job, ours: Arrays, theirs: Arrays, twin: Twin) -> list[Paths]:
    if not (_has_places(ours) and _has_places(theirs)):
        return []
    if not (int(ours["perform/steps"]) and int(theirs["perform/steps"])):
        return []
    if "time/put_back" in theirs and "perform/path" not in theirs:  # carried back to its place in between
        return []
    return [
        Paths(
            job.trial,
            float(theirs["time/control_step"]),
            _travelled(ours[f"truth/{STUDENT}/base"], ours),
            _travelled(theirs[f"truth/{STUDENT}/base"], theirs),
            _travelled(twin.base, theirs),
        )
    ]


def _travelled(base: Array, arrays: Arrays) -> Array:
    start, steps = int(arrays["perform/start_step"]), int(arrays["perform/steps"])
    moved = base[start - 1 : start + steps]
    x, y, z, w = moved[0, 3:]
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    shift = moved[:, :2] - moved[0, :2]
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    return np.asarray(shift @ turn.T)


def _arrays(run: RunDirectory, job: Job) -> Arrays:
    stem = run.path / "trials" / job.cell / str(job.trial)
    try:
        contents = [stem.with_name(f"{stem.name}{ending}").read_bytes() for ending in (".npz", ".parquet")]
        return decode(*contents).arrays
    except (OSError, DamagedError) as error:
        what = f"{job} of {shown_path(run.path)} cannot be read ({error})"
        raise UserError(what, "run the scenario again to compute it anew") from error
