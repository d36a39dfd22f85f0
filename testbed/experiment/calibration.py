"""Whether probabilities mean what they say: of what is called 90% likely, nine tenths should be so.

The expected calibration error of few rows is never zero, for even with perfect probabilities the share of each bin is
drawn by chance: with N rows in B bins that alone is some sqrt(B / N) times a third. The interval has the same lean, so
that an upper end below a limit is honest evidence, and one above it need not speak against the probabilities.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from testbed.experiment.statistics import RESAMPLES, Interval, Vector, checked, quantiles

BINS = 10


class ReliabilityBin(NamedTuple):
    """The rows whose probability lies in one of equally wide bins.

    Attributes:
        low: Lower edge of the bin.
        high: Upper edge.
        n: How many rows.
        stated: Their mean probability.
        share: What share of them is truly positive.
        positives: How many.
    """

    low: float
    high: float
    n: int
    stated: float
    share: float
    positives: int


def reliability(
    probabilities: ArrayLike, positive: ArrayLike, bins: int = BINS
) -> tuple[ReliabilityBin, ...]:
    """The bins that have rows, from the lowest.

    Args:
        probabilities: (n,) that the row is positive, 0 to 1.
        positive: (n,) truth values.
        bins: Into how many equal parts 0 to 1 is cut; an upper edge belongs to the next bin, 1 to the last.

    Raises:
        ValueError: If the lengths differ or a probability is none.
    """
    stated, truth, places = _binned(probabilities, positive, bins)
    found = []
    for place in np.unique(places):
        own = places == place
        found.append(
            ReliabilityBin(
                low=float(place / bins),
                high=float((place + 1) / bins),
                n=int(own.sum()),
                stated=float(stated[own].mean()),
                share=float(truth[own].mean()),
                positives=int(truth[own].sum()),
            )
        )
    return tuple(found)


def calibration_error(probabilities: ArrayLike, positive: ArrayLike, bins: int = BINS) -> float | None:
    """Expected calibration error: how far bins' stated probabilities are from their shares, weighed by their rows.

    Returns:
        A number in [0, 1], or None without rows.
    """
    found = reliability(probabilities, positive, bins)
    count = sum(each.n for each in found)
    return sum(each.n * abs(each.stated - each.share) for each in found) / count if count else None


def calibration_interval(
    probabilities: ArrayLike,
    positive: ArrayLike,
    trials: Sequence[Any] | NDArray[Any],
    rng: np.random.Generator,
    *,
    bins: int = BINS,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
) -> Interval | None:
    """Percentile bootstrap interval of the expected calibration error over trials; None with fewer than two."""
    stated, truth, places = _binned(probabilities, positive, bins)
    names, trial = np.unique(np.asarray(trials), return_inverse=True)
    if trial.shape != stated.shape:
        raise ValueError("probabilities, truths and trials must have the same number of values")
    count = len(names)
    if count < 2:
        return None
    gaps = np.zeros((count, bins))  # what each trial adds to stated minus true of each bin
    np.add.at(gaps, (trial, places), stated - truth)
    drawn = rng.multinomial(count, np.full(count, 1 / count), size=resamples).astype(float)
    errors = np.abs(drawn @ gaps).sum(axis=1) / (drawn @ np.bincount(trial))
    return quantiles(errors, confidence)


def _binned(
    probabilities: ArrayLike, positive: ArrayLike, bins: int
) -> tuple[Vector, Vector, NDArray[np.int64]]:
    stated, truth = checked(probabilities), np.asarray(positive, dtype=bool).ravel().astype(float)
    if stated.shape != truth.shape:
        raise ValueError("probabilities and truths must have the same number of values")
    if np.any((stated < 0) | (stated > 1)):
        raise ValueError("a probability is a number from 0 to 1")
    # Edges by division: 0.3 times 10 is a hair below 3, 3 divided by 10 is 0.3.
    edges = np.arange(1, bins) / bins
    return stated, truth, np.searchsorted(edges, stated, side="right").astype(np.int64)
