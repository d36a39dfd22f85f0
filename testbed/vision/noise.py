"""A camera's read-out noise, quickly."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from testbed.vision._jit import compiled

LEVELS = 256


class QuickNoise(np.random.Generator):
    """A generator whose normal deviates come from a table: many times as fast, and no farther out than 4.1.

    Each is the sum of two deviates of half the variance, each of them one of 256 of the same probability.
    """

    def normal(self, loc: Any = 0.0, scale: Any = 1.0, size: Any = None) -> Any:
        """See numpy, for numbers ``loc`` and ``scale``."""
        out = np.empty(1 if size is None else size, np.float32)
        words = self.bit_generator.random_raw(-(-out.size // 4))
        _look_up(_deviates(), words.view(np.uint8), np.float32(loc), np.float32(scale), out.reshape(-1))
        return out if size is not None else float(out[0])


@functools.cache
def _deviates() -> NDArray[np.float32]:
    """(256,) the middles of intervals of the same probability, of variance one half."""
    middles = ndtri((np.arange(LEVELS) + 0.5) / LEVELS)
    deviates: NDArray[np.float32] = (middles / middles.std() / math.sqrt(2)).astype(np.float32)
    return deviates


@compiled
def _look_up(
    table: NDArray[np.float32],
    picks: NDArray[np.uint8],
    loc: np.float32,
    scale: np.float32,
    out: NDArray[np.float32],
) -> None:
    for i in range(out.size):
        out[i] = loc + scale * (table[picks[2 * i]] + table[picks[2 * i + 1]])
