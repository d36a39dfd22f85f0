"""What a sweep says: every condition against its matched control, and whether a claim holds over all of them.

The claim is that a condition makes nothing worse: that scores tell teachers apart as well as in the control (AUC), and
that as many verdicts are right. Trials of the same number have the same students, teachers and noise but for what the
condition changes, so that differences are paired, and resampling draws whole trials.

It *holds* where every condition's 95% interval of the difference stays above minus the margin; that takes all of them,
so nothing is gained by chance. It *does not hold* where some condition's interval lies below minus the margin, at a
level shared among the conditions (Bonferroni). Otherwise the trials cannot tell.

Near perfection resampling has no width and would make few trials look certain; there the interval follows from
Wilson's of both shares.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from testbed.experiment.roc import Difference, Scored, auc_difference
from testbed.experiment.statistics import (
    RESAMPLES,
    SHARE_SEED,
    Interval,
    auc,
    auc_interval,
    quantiles,
    share_interval,
    wilson_of,
)
from testbed.experiment.verdicts import scored
from testbed.scenario.points import Point
from testbed.scenario.sweep import Level

Answer = Literal["holds", "does not hold", "cannot tell"]
Row = Mapping[str, Any]
MEASURES = {"auc": "AUC", "accuracy": "right verdicts"}
_SEED = 0x5EE  # the same numbers whenever the page is made
_CONFIDENCE = 0.95
_Z2 = 1.96**2
_FEWEST_WRONG = 5  # trials' worth of errors, below which resampling is not trusted


@dataclass(frozen=True)
class Measured:
    """One figure of a condition.

    Attributes:
        value: The figure; None where it cannot be told.
        interval: Its 95% interval over trials; None with too few.
        difference: Less that of the control, over the trials that both have; None for the control itself.
        strict: The interval of the difference at the level that all conditions share.
    """

    value: float | None
    interval: Interval | None
    difference: Difference | None = None
    strict: Interval | None = None

    def answer(self, margin: float) -> Answer:
        """Whether the condition is no worse than the control."""
        if self.difference is None or self.difference.interval is None:
            return "cannot tell"
        if self.difference.interval.low > -margin:
            return "holds"
        worse = self.strict is not None and self.strict.high < -margin
        return "does not hold" if worse else "cannot tell"

    def trials_needed(self, margin: float) -> int | None:
        """About how many trials would tell, if all stays as it is; None where no number would."""
        if self.difference is None:
            return None
        n, value, interval = self.difference
        if interval is None:
            return None
        half, room = value - interval.low, margin + value
        if room <= 0:
            return None
        if value == 0 and self.value in (
            0.0,
            1.0,
        ):  # both perfect: Wilson's interval is z**2 / (n + z**2) wide
            return math.ceil((n + _Z2) * half / room - _Z2)
        return math.ceil(n * (half / room) ** 2)


@dataclass(frozen=True)
class Condition:
    """A cell of a sweep as a student fares in it.

    Attributes:
        cell: The cell.
        levels: Of its axes.
        n: Verdicts.
        trials: Trials.
        measures: By the keys of ``MEASURES``.
    """

    cell: str
    levels: Mapping[str, Level | None]
    n: int
    trials: int
    measures: Mapping[str, Measured]


@dataclass(frozen=True)
class Finding:
    """Whether a claim holds over some conditions.

    Attributes:
        answer: Over all of them.
        conditions: How many there are.
        holding: In how many it holds.
        worst: The condition with the largest loss; None if there is none with a difference.
        needed: About how many trials a condition would tell; None where none would, or the answer is known.
    """

    answer: Answer
    conditions: int
    holding: int
    worst: Condition | None
    needed: int | None


def conditions_of(
    rows: Sequence[Row], control: Point, points: Sequence[Point]
) -> tuple[Condition | None, tuple[Condition, ...]]:
    """The control and the other conditions, as far as they have verdicts.

    Args:
        rows: Verdicts of one student.
        control: What the others are held against.
        points: The others.
    """
    by_cell: dict[str, list[Row]] = {}
    for row in rows:
        by_cell.setdefault(str(row["cell"]), []).append(row)
    base = by_cell.get(control.cell, [])
    present = [point for point in points if point.cell in by_cell]
    shared = 1 - (1 - _CONFIDENCE) / max(1, len(present))
    others = tuple(_condition(point, by_cell[point.cell], base, shared) for point in present)
    return (_condition(control, base, None, shared) if base else None), others


def finding(conditions: Sequence[Condition], measure: str, margin: float) -> Finding:
    """Whether the claim holds in all these conditions."""
    answers = [condition.measures[measure].answer(margin) for condition in conditions]
    holding = answers.count("holds")
    told = [condition for condition in conditions if condition.measures[measure].difference is not None]
    worst = min(told, key=lambda condition: _loss(condition, measure), default=None)
    if "does not hold" in answers:
        return Finding("does not hold", len(answers), holding, worst, None)
    if answers and holding == len(answers):
        return Finding("holds", len(answers), holding, worst, None)
    open_ones = [condition.measures[measure] for condition in told
                 if condition.measures[measure].answer(margin) == "cannot tell"]  # fmt: skip
    needs = [measured.trials_needed(margin) for measured in open_ones]
    known = [need for need in needs if need is not None]
    needed = max(known) if known and len(known) == len(needs) and len(told) == len(conditions) else None
    return Finding("cannot tell", len(answers), holding, worst, needed)


def share_difference(
    one: Sequence[Row], other: Sequence[Row], rng: np.random.Generator, *, confidence: float = _CONFIDENCE
) -> Difference | None:
    """Share of right verdicts of ``one`` less that of ``other`` over the trials that both have, matched.

    Returns:
        None where they have no trial in common.
    """
    common = sorted({int(row["trial"]) for row in one} & {int(row["trial"]) for row in other})
    if not common:
        return None
    sides = [_right_by_trial(rows, common) for rows in (one, other)]
    (a, b) = (float(right.sum() / sizes.sum()) for right, sizes in sides)
    count = len(common)
    if count < 2:
        return Difference(count, a - b, None)
    drawn = rng.multinomial(count, np.full(count, 1 / count), size=RESAMPLES)
    first, second = ((drawn @ right) / (drawn @ sizes) for right, sizes in sides)
    if not _few_wrong((a, b), count):
        return Difference(count, a - b, quantiles(first - second, confidence))
    ends = [quantiles(shares, confidence) for shares in (first, second)]
    return Difference(count, a - b, _added((a, b), ends, count, confidence))


def area_difference(
    one: Sequence[Row], other: Sequence[Row], *, confidence: float = _CONFIDENCE
) -> Difference | None:
    """AUC of ``one`` less that of ``other`` over the trials that both have, matched.

    Returns:
        None where they have no trial in common or lack one of the classes.
    """
    here, there = _scored(one), _scored(other)
    difference = auc_difference(here, there, _rng(), confidence=confidence)
    if difference is None or difference.interval is None:
        return difference
    common = np.intersect1d(here.trials, there.trials)
    sides = [side.within(common) for side in (here, there)]
    areas = [auc(side.scores, side.positive) for side in sides]
    ends = [auc_interval(*side, _rng(), confidence=confidence) for side in sides]
    if areas[0] is None or areas[1] is None or ends[0] is None or ends[1] is None:
        return difference
    if not _few_wrong((areas[0], areas[1]), difference.n):
        return difference
    interval = _added((areas[0], areas[1]), (ends[0], ends[1]), difference.n, confidence)
    return difference._replace(interval=interval)


def _few_wrong(shares: tuple[float, float], count: int) -> bool:
    """Whether either share is so near 0 or 1 that resampling so many trials makes it look too certain."""
    return any(min(share, 1 - share) * count < _FEWEST_WRONG for share in shares)


def _added(shares: tuple[float, float], ends: Sequence[Interval], count: int, confidence: float) -> Interval:
    """The interval of a difference from those of both shares, as if they were independent (Newcombe's square-and-add).

    Each share's interval is at least Wilson's over the trials.
    """
    (a, b), wide = shares, []
    for share, interval in zip(shares, ends, strict=True):
        wilson = wilson_of(share, count, confidence)
        wide.append(Interval(min(interval.low, wilson.low), max(interval.high, wilson.high)))
    low = a - b - math.hypot(a - wide[0].low, wide[1].high - b)
    high = a - b + math.hypot(wide[0].high - a, b - wide[1].low)
    return Interval(low, high)


def _condition(point: Point, rows: Sequence[Row], base: Sequence[Row] | None, shared: float) -> Condition:
    right = [row["verdict"] == row["truth"] for row in rows]
    trials = [int(row["trial"]) for row in rows]
    having = _scored(rows)
    measures = {
        "auc": Measured(auc(having.scores, having.positive), auc_interval(*having, _rng())),
        "accuracy": Measured(
            sum(right) / len(right), share_interval(right, trials, np.random.default_rng(SHARE_SEED))
        ),
    }
    if base is not None:
        for name, pair in {
            "auc": [area_difference(rows, base, confidence=level) for level in (_CONFIDENCE, shared)],
            "accuracy": [
                share_difference(rows, base, _rng(), confidence=level) for level in (_CONFIDENCE, shared)
            ],
        }.items():
            own, strict = measures[name], pair[1]
            measures[name] = Measured(
                own.value, own.interval, pair[0], strict.interval if strict is not None else None
            )
    return Condition(point.cell, point.levels, len(rows), len(set(trials)), measures)


def _scored(rows: Sequence[Row]) -> Scored:
    return scored([{**row, "cell": ""} for row in rows])  # trials of the same number are matched


def _right_by_trial(rows: Sequence[Row], common: Sequence[int]) -> tuple[Any, Any]:
    """(trials,) right verdicts and (trials,) verdicts of each of the common trials."""
    index = {trial: number for number, trial in enumerate(common)}
    kept = [row for row in rows if int(row["trial"]) in index]
    where = [index[int(row["trial"])] for row in kept]
    right = np.array([row["verdict"] == row["truth"] for row in kept], dtype=float)
    return np.bincount(where, right, len(common)), np.bincount(where, minlength=len(common)).astype(float)


def _loss(condition: Condition, measure: str) -> float:
    difference = condition.measures[measure].difference
    return 0.0 if difference is None else difference.value


def _rng() -> np.random.Generator:
    return np.random.default_rng(_SEED)
