"""Two students on the same teachers: how much better is one, and could it be chance?

Verdicts of a trial share a world, and in matched cells a trial shares its number's chances; so trials are what is drawn
and what is exchanged, never single verdicts. Intervals are percentile bootstraps over trials; where a bootstrap has no
width, because a student makes no mistake, an interval that knows the number of trials stands in.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse, stats

from testbed.experiment.statistics import RESAMPLES, Interval, Vector, checked, quantiles, wilson

_CHUNK = 200  # resamples at a time: memory stays small with thousands of trials
_NO_WIDTH = 1e-12


class Paired(NamedTuple):
    """A figure of two students over the same teachers.

    Attributes:
        n: Over how many teachers.
        trials: Of how many trials.
        first: The figure of the first student.
        second: Of the second.
        difference: Second less first: above zero the second is better.
        interval: Of the difference; None with fewer than two trials.
        p_value: How often chance alone would make so large a difference, either way.
    """

    n: int
    trials: int
    first: float
    second: float
    difference: float
    interval: Interval | None
    p_value: float


def paired_accuracy(
    first: ArrayLike,
    second: ArrayLike,
    trials: Sequence[Any] | NDArray[Any],
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
) -> Paired:
    """Compare shares of right verdicts.

    The p-value is exact: every trial's difference is as likely to be the other way round. With one teacher a trial it
    is McNemar's exact test.

    Args:
        first: (n,) whether the first student was right about each teacher, at least one.
        second: (n,) the same of the second.
        trials: (n,) to which trial each teacher belongs.
        rng: Source of the resamples.
        confidence: Coverage of the interval.
        resamples: How many.

    Raises:
        ValueError: If the lengths differ or there is no teacher.
    """
    ours, theirs = np.asarray(first, dtype=bool).ravel(), np.asarray(second, dtype=bool).ravel()
    names, trial = np.unique(np.asarray(trials), return_inverse=True)
    if not ours.shape == theirs.shape == trial.shape or not ours.size:
        raise ValueError("both students and the trials must have the same number of teachers, at least one")
    gained: Vector = np.bincount(trial, theirs.astype(float) - ours).astype(float)
    sizes = np.bincount(trial).astype(float)
    count, interval = len(names), None
    if count > 1:
        shares = [(drawn @ gained) / (drawn @ sizes) for drawn in _draws(count, resamples, rng)]
        interval = quantiles(np.concatenate(shares), confidence)
        if interval.high - interval.low < _NO_WIDTH:
            interval = _bonett_price(gained, sizes, confidence)
    return Paired(
        n=ours.size,
        trials=count,
        first=float(ours.mean()),
        second=float(theirs.mean()),
        difference=float(gained.sum() / ours.size),
        interval=interval,
        p_value=_sign_flips(gained.round().astype(int)),
    )


def paired_auc(
    first: ArrayLike,
    second: ArrayLike,
    positive: ArrayLike,
    trials: Sequence[Any] | NDArray[Any],
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
) -> Paired | None:
    """Compare areas under the ROC curve.

    The p-value exchanges the students' ranks trial by trial (Braun and Alonzo 2008: scores have scales of their own,
    ranks do not).

    Args:
        first: (n,) finite scores of the first student, one a teacher.
        second: (n,) of the second.
        positive: (n,) whether each teacher is appropriate.
        trials: (n,) to which trial each belongs.
        rng: Source of resamples and exchanges.
        confidence: Coverage of the interval.
        resamples: How many of each.

    Returns:
        None where one kind of teacher is absent.

    Raises:
        ValueError: If the lengths differ or a score is not finite.
    """
    scores = [checked(first), checked(second)]
    truth = np.asarray(positive, dtype=bool).ravel()
    names, trial = np.unique(np.asarray(trials), return_inverse=True)
    if not scores[0].shape == scores[1].shape == truth.shape == trial.shape:
        raise ValueError("both students, truths and trials must have the same number of teachers")
    if not 0 < truth.sum() < truth.size:
        return None
    ranks = [stats.rankdata(each) for each in scores]
    sides = [_Side.of(each, truth, trial, np.unique(ranks)) for each in ranks]
    everybody = np.ones((1, len(names)))
    areas = [float(side.areas(everybody)[0]) for side in sides]
    difference, interval = areas[1] - areas[0], None
    if len(names) > 1:
        interval = _auc_interval(sides, areas, len(names), rng, confidence, resamples)
    exchanged = np.concatenate(list(_exchanged(sides, len(names), resamples, rng)))
    beyond = np.count_nonzero(np.abs(exchanged) >= abs(difference) - 1e-9)
    p_value = (beyond + 1) / (len(exchanged) + 1)
    return Paired(truth.size, len(names), areas[0], areas[1], difference, interval, float(p_value))


def holm(p_values: Sequence[float]) -> tuple[float, ...]:
    """Holm's adjusted p-values: each of them below a level keeps the chance of any false alarm below it."""
    order = np.argsort(p_values, kind="stable")
    factors = len(p_values) - np.arange(len(p_values))
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(
        1.0, np.maximum.accumulate(factors * np.asarray(p_values, dtype=float)[order])
    )
    return tuple(float(value) for value in adjusted)


class _Side(NamedTuple):
    """One student's scores, counted by trial (rows) and by level of the score (columns, from the lowest)."""

    positives: Any
    negatives: Any

    @classmethod
    def of(cls, ranks: Vector, positive: NDArray[np.bool_], trial: NDArray[Any], levels: Vector) -> _Side:
        level, shape = np.searchsorted(levels, ranks), (int(trial.max()) + 1, len(levels))
        made = (
            sparse.csr_array((np.ones(kind.sum()), (trial[kind], level[kind])), shape=shape)
            for kind in (positive, ~positive)
        )
        return cls(*made)

    def areas(self, weights: Vector) -> Vector:
        """(r,) the AUC with each trial counted so often, (r, trials); NaN without one of the classes."""
        return _areas(weights @ self.positives, weights @ self.negatives)


def _areas(positives: Vector, negatives: Vector) -> Vector:
    """(r,) the AUC of counts by level (r, levels): how often a positive lies above a negative, ties half."""
    below = np.cumsum(negatives, axis=1) - negatives / 2
    pairs = positives.sum(axis=1) * negatives.sum(axis=1)
    wins = (positives * below).sum(axis=1)
    return np.asarray(np.divide(wins, pairs, out=np.full(len(wins), math.nan), where=pairs > 0))


def _draws(count: int, resamples: int, rng: np.random.Generator) -> Iterator[Vector]:
    for start in range(0, resamples, _CHUNK):
        size = min(_CHUNK, resamples - start)
        yield rng.multinomial(count, np.full(count, 1 / count), size=size).astype(float)


def _exchanged(
    sides: Sequence[_Side], count: int, resamples: int, rng: np.random.Generator
) -> Iterator[Vector]:
    """Differences that there would be if it were chance which of the students a trial's ranks belong to."""
    (p, n), (q, m) = sides
    for start in range(0, resamples, _CHUNK):
        kept = rng.integers(0, 2, (min(_CHUNK, resamples - start), count)).astype(float)
        given = 1 - kept
        yield _areas(given @ p + kept @ q, given @ n + kept @ m) - _areas(
            kept @ p + given @ q, kept @ n + given @ m
        )


def _auc_interval(
    sides: Sequence[_Side],
    areas: Sequence[float],
    count: int,
    rng: np.random.Generator,
    confidence: float,
    resamples: int,
) -> Interval | None:
    both = [np.array([side.areas(drawn) for side in sides]) for drawn in _draws(count, resamples, rng)]
    drawn = np.concatenate(both, axis=1)
    drawn = drawn[:, np.isfinite(drawn).all(axis=0)]
    if not drawn.size:
        return None
    ends = [quantiles(each, confidence) for each in drawn]
    if all(end.high - end.low >= _NO_WIDTH for end in ends):
        return quantiles(drawn[1] - drawn[0], confidence)
    # A perfect student's area has no spread: Wilson's interval for it, then Newcombe's square-and-add.
    first, second = (
        end if end.high - end.low >= _NO_WIDTH else _wilson(area, count, confidence)
        for end, area in zip(ends, areas, strict=True)
    )
    low = areas[1] - areas[0] - math.hypot(areas[1] - second.low, first.high - areas[0])
    high = areas[1] - areas[0] + math.hypot(second.high - areas[1], areas[0] - first.low)
    return Interval(low, high)


def _wilson(area: float, count: int, confidence: float) -> Interval:
    return wilson(round(area * count), count, confidence)


def _bonett_price(gained: Vector, sizes: Vector, confidence: float) -> Interval:
    """Bonett and Price's (2012) interval of the difference of paired shares, trials taken for pairs."""
    count = len(gained)
    better, worse = ((np.count_nonzero(sign * gained > 0) + 1) / (count + 2) for sign in (1, -1))
    z = float(stats.norm.ppf(0.5 + confidence / 2))
    half = z * math.sqrt((better + worse - (better - worse) ** 2) / (count + 2))
    middle = float(gained.sum() / sizes.sum())
    return Interval(max(-1.0, middle - half), min(1.0, middle + half))


def _sign_flips(gained: NDArray[np.int64]) -> float:
    """How often random signs of these whole numbers give a sum at least as far from zero: by convolution, exactly."""
    chances = np.ones(1)  # of sums, from the smallest to the largest, two apart
    for size in np.abs(gained[gained != 0]):
        wider = np.zeros(len(chances) + int(size))
        wider[: len(chances)] += chances / 2
        wider[int(size) :] += chances / 2
        chances = wider
    reach = len(chances) - 1
    sums = 2 * np.arange(len(chances)) - reach
    return min(1.0, float(chances[np.abs(sums) >= abs(int(gained.sum()))].sum()))
