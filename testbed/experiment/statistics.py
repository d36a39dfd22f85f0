"""How sure one can be: intervals, ranks and tests over independent trials.

Every resampling takes its generator as an argument, so that equal data and seed give equal numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]
RESAMPLES = 4000
SHARE_SEED = 0x5A4E
"""Seeds the interval of the share of right verdicts, so that every page and file tells the same one."""


class Interval(NamedTuple):
    """A confidence interval, both ends included."""

    low: float
    high: float


class MeanSem(NamedTuple):
    """Mean and standard error of the mean along an axis; the error is NaN where there is only one value."""

    mean: Vector
    sem: Vector


@dataclass(frozen=True)
class PairedTest:
    """Whether an error changed between start and end of the same trials.

    Attributes:
        n: Number of pairs.
        start_mean: Mean at the start, and its standard error ``start_sem``.
        start_sem: NaN for a single pair.
        end_mean: Mean at the end, and its standard error ``end_sem``.
        end_sem: NaN for a single pair.
        difference: Mean of end - start; negative where the error fell.
        difference_low: Lower end of its bootstrap interval; NaN for a single pair.
        difference_high: Upper end of it.
        p_value: Wilcoxon signed-rank test, two-sided; 1 where nothing changed.
    """

    n: int
    start_mean: float
    start_sem: float
    end_mean: float
    end_sem: float
    difference: float
    difference_low: float
    difference_high: float
    p_value: float

    @property
    def fell(self) -> bool:
        """Whether the error fell significantly at the 5% level."""
        return self.p_value < 0.05 and self.difference < 0


def wilson(successes: int, n: int, confidence: float = 0.95) -> Interval:
    """Wilson's score interval of a proportion.

    Raises:
        ValueError: If ``n`` < 1 or ``successes`` is not within 0..n.
    """
    _check_count(successes, n)
    return wilson_of(successes / n, n, confidence)


def wilson_of(share: float, n: float, confidence: float = 0.95) -> Interval:
    """Wilson's score interval of a share of ``n`` independent pieces of evidence, which need not be a whole number."""
    from scipy.special import ndtri  # slow to load

    z = float(ndtri(0.5 + confidence / 2))
    centre = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return Interval(max(0.0, centre - half), min(1.0, centre + half))


def auc(scores: ArrayLike, positive: ArrayLike) -> float | None:
    """Area under the ROC curve: how often a positive scores above a negative, ties counting half.

    Args:
        scores: (n,) finite numbers; higher means more likely positive.
        positive: (n,) truth values.

    Returns:
        A number in [0, 1], or None where one of the classes is absent.
    """
    return _area(*pair_wins(scores, positive, np.zeros(np.size(scores))))


def auc_interval(
    scores: ArrayLike,
    positive: ArrayLike,
    trials: Sequence[Any] | NDArray[Any],
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
) -> Interval | None:
    """Bootstrap interval of the AUC over trials: rows of a trial share a student, so they are drawn together.

    Where every resample agrees (a perfect separation) the bootstrap has no width; Wilson's interval of that
    proportion over the trials then stands in, so that few trials never look certain.

    Args:
        scores: (n,) as for :func:`auc`.
        positive: (n,) as for :func:`auc`.
        trials: (n,) which trial a row belongs to.
        rng: Source of the resamples.
        confidence: Coverage.
        resamples: How many.

    Returns:
        None with fewer than two trials, or where one of the classes is absent.
    """
    wins, positives, negatives = pair_wins(scores, positive, trials)
    area = _area(wins, positives, negatives)
    count = len(wins)
    if area is None or count < 2:
        return None
    drawn = rng.multinomial(count, np.full(count, 1 / count), size=resamples).astype(float)
    areas = areas_of(drawn, wins, positives, negatives)
    low, high = quantiles(areas[np.isfinite(areas)], confidence)
    if high - low < 1e-12:
        low, high = wilson_of(area, count, confidence)
    return Interval(low, high)


def share_interval(
    right: ArrayLike,
    trials: Sequence[Any] | NDArray[Any],
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
) -> Interval:
    """Bootstrap interval of a share over trials: verdicts of a trial share a student and are no independent evidence.

    With a single trial, or where every trial has the same share, the bootstrap has no width; Wilson's interval over
    the verdicts then stands in.

    Args:
        right: (n,) truth values, at least one.
        trials: (n,) which trial a value belongs to.
        rng: Source of the resamples.
        confidence: Coverage.
        resamples: How many.

    Raises:
        ValueError: If the lengths differ or there is no value.
    """
    values = np.asarray(right, dtype=bool).ravel()
    names, trial = np.unique(np.asarray(trials), return_inverse=True)
    if values.shape != trial.shape:
        raise ValueError("values and trials must have the same number")
    count = len(names)
    if count > 1:
        hits, sizes = np.bincount(trial, values), np.bincount(trial)
        drawn = rng.multinomial(count, np.full(count, 1 / count), size=resamples)
        low, high = quantiles((drawn @ hits) / (drawn @ sizes), confidence)
        if high - low > 1e-12:
            return Interval(low, high)
    return wilson(int(values.sum()), values.size, confidence)


def paired_test(start: ArrayLike, end: ArrayLike, rng: np.random.Generator) -> PairedTest:
    """Compare the start and the end of the same trials (the paper's significance in Fig. 6-8).

    Args:
        start: (n,) finite errors at the start, one a trial.
        end: (n,) the same at the end.
        rng: Source of the bootstrap's resamples.

    Raises:
        ValueError: If the lengths differ, there is no pair, or a value is not finite.
    """
    before, after = checked(start), checked(end)
    if before.shape != after.shape or before.size == 0:
        raise ValueError("start and end must have the same number of values, at least one")
    change = after - before
    low, high = bootstrap_mean(change, rng)
    return PairedTest(
        n=before.size,
        start_mean=float(before.mean()),
        start_sem=float(mean_sem(before).sem),
        end_mean=float(after.mean()),
        end_sem=float(mean_sem(after).sem),
        difference=float(change.mean()),
        difference_low=low,
        difference_high=high,
        p_value=_signed_ranks(change) if np.any(change != 0) else 1.0,
    )


def _signed_ranks(change: Vector) -> float:
    if change.size == 1:
        return 1.0
    from scipy.stats import wilcoxon  # slow to load

    return float(wilcoxon(change).pvalue)


def bootstrap_mean(
    values: ArrayLike, rng: np.random.Generator, *, confidence: float = 0.95, resamples: int = RESAMPLES
) -> Interval:
    """Percentile bootstrap interval of a mean; NaN, NaN for a single value."""
    return _bootstrap(values, np.mean, rng, confidence, resamples)


def bootstrap_median(
    values: ArrayLike, rng: np.random.Generator, *, confidence: float = 0.95, resamples: int = RESAMPLES
) -> Interval:
    """Percentile bootstrap interval of a median; NaN, NaN for a single value."""
    return _bootstrap(values, np.median, rng, confidence, resamples)


def _bootstrap(
    values: ArrayLike, of: Callable[..., Any], rng: np.random.Generator, confidence: float, resamples: int
) -> Interval:
    data = checked(values)
    if data.size < 2:
        return Interval(math.nan, math.nan)
    return quantiles(of(data[rng.integers(data.size, size=(resamples, data.size))], axis=1), confidence)


def mean_sem(values: ArrayLike, axis: int = 0) -> MeanSem:
    """Mean and standard error of the mean (with n - 1) along ``axis``."""
    data = np.asarray(values, dtype=float)
    n = data.shape[axis]
    mean = data.mean(axis=axis)
    if n < 2:
        return MeanSem(mean, np.full_like(mean, math.nan))
    return MeanSem(mean, data.std(axis=axis, ddof=1) / math.sqrt(n))


def pair_wins(scores: ArrayLike, positive: ArrayLike, trials: ArrayLike) -> tuple[Vector, Vector, Vector]:
    """(trials, trials) how many positives of a trial beat negatives of another; (trials,) positives, and negatives."""
    values, truth = checked(scores), np.asarray(positive, dtype=bool)
    names, trial = np.unique(np.asarray(trials), return_inverse=True)
    if not values.shape == truth.shape == trial.shape:
        raise ValueError("scores, truths and trials must have the same number of values")
    member = (trial == np.arange(len(names))[:, None]).astype(float)
    beats = (values[:, None] > values) + 0.5 * (values[:, None] == values)
    compared = beats * (truth[:, None] & ~truth)
    return member @ compared @ member.T, member @ truth, member @ ~truth


def areas_of(drawn: Vector, wins: Vector, positives: Vector, negatives: Vector) -> Vector:
    """The AUC of each resample; NaN for one without one of the classes.

    Args:
        drawn: (resamples, trials) how often each trial was drawn.
        wins: (trials, trials) see :func:`pair_wins`; ``positives`` and ``negatives`` too.
        positives: (trials,)
        negatives: (trials,)
    """
    pairs = (drawn @ positives) * (drawn @ negatives)
    ordered = np.einsum("ri,ij,rj->r", drawn, wins, drawn, optimize=True)
    return np.asarray(np.divide(ordered, pairs, out=np.full(len(drawn), math.nan), where=pairs > 0))


def _area(wins: Vector, positives: Vector, negatives: Vector) -> float | None:
    pairs = positives.sum() * negatives.sum()
    return float(wins.sum() / pairs) if pairs else None


def quantiles(values: Vector, confidence: float) -> Interval:
    """The interval that holds the middle ``confidence`` of the values."""
    low, high = np.quantile(values, [(1 - confidence) / 2, (1 + confidence) / 2])
    return Interval(float(low), float(high))


def _check_count(successes: int, n: int) -> None:
    if n < 1 or not 0 <= successes <= n:
        raise ValueError(f"{successes} successes of {n} is no proportion")


def checked(values: ArrayLike) -> Vector:
    """The values as an array (n,).

    Raises:
        ValueError: If one is not finite.
    """
    data = np.asarray(values, dtype=float).ravel()
    if not np.all(np.isfinite(data)):
        raise ValueError("every value must be a finite number")
    return data
