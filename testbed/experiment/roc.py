"""ROC curves, and whether one is better than another over the same trials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from testbed.experiment.statistics import (
    RESAMPLES,
    Interval,
    Vector,
    areas_of,
    auc,
    auc_interval,
    checked,
    pair_wins,
    quantiles,
)


class Scored(NamedTuple):
    """Scores of what is truly positive or not.

    Attributes:
        scores: (n,) finite; higher means more likely positive.
        positive: (n,) truth values.
        trials: (n,) to which trial each belongs.
    """

    scores: Vector
    positive: NDArray[np.bool_]
    trials: NDArray[Any]

    @classmethod
    def of(cls, scores: ArrayLike, positive: ArrayLike, trials: Sequence[Any] | NDArray[Any]) -> Scored:
        """Checked and as arrays.

        Raises:
            ValueError: If the lengths differ or a score is not finite.
        """
        found = cls(checked(scores), np.asarray(positive, dtype=bool).ravel(), np.asarray(trials).ravel())
        if not found.scores.shape == found.positive.shape == found.trials.shape:
            raise ValueError("scores, truths and trials must have the same number of values")
        return found

    def within(self, trials: NDArray[Any]) -> Scored:
        """Only these trials."""
        kept = np.isin(self.trials, trials)
        return Scored(self.scores[kept], self.positive[kept], self.trials[kept])


class Difference(NamedTuple):
    """How much larger one AUC is than another.

    Attributes:
        n: Over how many common trials.
        value: The difference.
        interval: Its interval; None with fewer than two trials.
    """

    n: int
    value: float
    interval: Interval | None


def roc_points(scores: ArrayLike, positive: ArrayLike) -> tuple[Vector, Vector]:
    """The ROC curve: (m,) false alarm rates and (m,) hit rates, from (0, 0) to (1, 1).

    Rows of equal score cross the threshold together, so that the area below the straight lines is :func:`auc`.

    Raises:
        ValueError: If one of the classes is absent.
    """
    values, truth = checked(scores), np.asarray(positive, dtype=bool).ravel()
    if not 0 < truth.sum() < truth.size:
        raise ValueError("a ROC curve needs both classes")
    order = np.argsort(-values, kind="stable")
    last_of_equals = np.append(np.diff(values[order]) != 0, True)
    hits, alarms = (np.cumsum(kind[order])[last_of_equals] for kind in (truth, ~truth))
    start = np.zeros(1)
    return np.append(start, alarms / (~truth).sum()), np.append(start, hits / truth.sum())


def auc_difference(
    one: Scored,
    other: Scored,
    rng: np.random.Generator,
    *,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
) -> Difference | None:
    """AUC of ``one`` less that of ``other`` over the trials that both have, matched: a resample draws trials for both.

    Where either separates its classes perfectly its bootstrap has no width, and would make the difference look more
    certain than it is. Its interval then follows from those of both areas (Newcombe's square-and-add), as if they
    were independent.

    Returns:
        None where they have no trial in common or lack one of the classes.
    """
    common = np.intersect1d(one.trials, other.trials)
    sides = [side.within(common) for side in (one, other)]
    areas = [auc(side.scores, side.positive) if len(side.scores) else None for side in sides]
    if areas[0] is None or areas[1] is None:
        return None
    value, count = areas[0] - areas[1], len(common)
    if count < 2:
        return Difference(count, value, None)
    seed = rng.integers(2**63)
    if any(area in (0.0, 1.0) for area in areas):
        low_high = [auc_interval(*side, np.random.default_rng(seed), confidence=confidence) for side in sides]
        return Difference(count, value, _square_and_add((areas[0], areas[1]), low_high))
    drawn = rng.multinomial(count, np.full(count, 1 / count), size=resamples).astype(float)
    first, second = (areas_of(drawn, *pair_wins(*side)) for side in sides)
    gaps = first - second
    return Difference(count, value, quantiles(gaps[np.isfinite(gaps)], confidence))


def _square_and_add(areas: tuple[float, float], ends: Sequence[Interval | None]) -> Interval | None:
    (a, b), (first, second) = areas, ends
    if first is None or second is None:
        return None
    low = a - b - math.hypot(a - first.low, second.high - b)
    high = a - b + math.hypot(first.high - a, b - second.low)
    return Interval(low, high)
