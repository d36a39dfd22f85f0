"""The same quantity over many trials: gathered, averaged, and tested start against end."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from testbed.experiment.statistics import (
    SHARE_SEED,
    Interval,
    PairedTest,
    mean_sem,
    paired_test,
    share_interval,
)
from testbed.report.reading import TRUTHS, Array, Row, Trial

_BOOTSTRAP_SEED = 0  # the page must not change when it is made again


@dataclass(frozen=True)
class Series:
    """A quantity over the steps of a search, one curve a trial.

    Attributes:
        curves: (n, steps), finite.
    """

    curves: Array

    @property
    def n(self) -> int:
        """How many trials."""
        return len(self.curves)

    @property
    def steps(self) -> Array:
        """(steps,) 0, 1, 2, ..."""
        return np.arange(self.curves.shape[1])

    @property
    def mean(self) -> Array:
        """(steps,) mean over the trials."""
        return mean_sem(self.curves).mean

    @property
    def sem(self) -> Array | None:
        """(steps,) standard error of the mean; None for a single trial."""
        return mean_sem(self.curves).sem if self.n > 1 else None


def self_series(trials: Sequence[Trial], name: str) -> Series | None:
    """``self/<name>`` of every trial; None where no trial has it."""
    return _series(trial.array(f"self/{name}") for trial in trials)


def teacher_series(trials: Sequence[Trial], truth: str, name: str) -> Series | None:
    """``<teacher>/<name>`` of every trial, averaged within a trial over the teachers of this truth."""
    return _series(_teacher_mean(trial, truth, name) for trial in trials)


def _teacher_mean(trial: Trial, truth: str, name: str) -> Array | None:
    own = [row["teacher"] for row in trial.rows if row["truth"] == truth]
    found = [array for teacher in own if (array := trial.array(f"{teacher}/{name}")) is not None]
    means = [mean for array in found if np.all(np.isfinite(mean := _last_axis_mean(array)))]
    return np.mean(means, axis=0) if means else None


def _last_axis_mean(array: Array) -> Array:
    return array if array.ndim == 1 else array.mean(axis=-1)


def _series(curves: Iterable[Array | None]) -> Series | None:
    usable = [curve for curve in curves if curve is not None and np.all(np.isfinite(curve))]
    if not usable:
        return None
    steps = min(len(curve) for curve in usable)
    return Series(np.stack([curve[:steps] for curve in usable]))


def right_verdicts(rows: Sequence[Row]) -> tuple[int, Interval]:
    """How many verdicts were right, and the 95% interval of their share over trials."""
    right = [row["verdict"] == row["truth"] for row in rows]
    trials = [f"{row['cell']}/{row['trial']}" for row in rows]
    return sum(right), share_interval(right, trials, np.random.default_rng(SHARE_SEED))


def start_end(rows: Iterable[Row], start: str, end: str, truth: str | None = None) -> PairedTest | None:
    """The test of one error at the start against its end: one pair a trial, teachers of a trial averaged.

    Args:
        rows: Verdict rows.
        start: Column with the error at the start.
        end: Column with the error at the end.
        truth: Only teachers that are truly so.

    Returns:
        None where no row has both numbers.
    """
    pairs: dict[tuple[object, ...], list[tuple[float, float]]] = {}
    for row in rows:
        if (truth is None or row["truth"] == truth) and _number(row.get(start)) and _number(row.get(end)):
            key = (row["student"], row["cell"], row["trial"])
            pairs.setdefault(key, []).append((float(row[start]), float(row[end])))
    if not pairs:
        return None
    means = np.array([np.mean(values, axis=0) for values in pairs.values()])
    return paired_test(means[:, 0], means[:, 1], np.random.default_rng(_BOOTSTRAP_SEED))


def present_truths(rows: Iterable[Row]) -> tuple[str, ...]:
    """Which truths occur, the appropriate first."""
    seen = {row["truth"] for row in rows}
    return tuple(truth for truth in TRUTHS if truth in seen)


def _number(value: object) -> bool:
    return isinstance(value, int | float) and bool(np.isfinite(value))
