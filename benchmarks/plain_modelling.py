"""Section 3.3.3 as one would write it around somebody else's renderer: the estimation-exploration algorithm in Python.

The same passes, draws and mutations as :mod:`testbed.student.seeing.teacher_modelling`; whoever sees is asked about
whole models, for nobody else remembers which part darkened a pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from testbed.student.parameters import TeacherModellingParameters
from testbed.student.seeing._mutation import mutate
from testbed.student.seeing.teacher_modelling import Modelling, draw
from testbed.vision.kernel import PART_LUMINOSITY, WHITE

Model = NDArray[np.float64]
See = Callable[[Model, int, NDArray[np.int64]], NDArray[np.bool_]]
"""Model (k, 8), camera, pixels (K,): which of them it darkens."""


class PlainModelling:
    """Two models, a training buffer, and a way to see.

    Args:
        modelling: Where models and rules come from; it is not run.
        see: Whoever can tell which pixels a model darkens.
        images: (2, pixels) uint8
        passes: How many passes to run; they are spread evenly over the ``total``, so that the buffer fills as in all.
        total: How many passes they stand for.
        seed: Of everything random.
    """

    def __init__(
        self, modelling: Modelling, see: See, images: NDArray[np.uint8], *, passes: int, total: int, seed: int
    ) -> None:
        rng = np.random.default_rng(seed)
        parameters = TeacherModellingParameters(passes_per_image=passes)
        self._draws = draw(modelling.parts, images.shape[1], parameters, rng)
        self._rules, self._see, self._images = modelling._rules, see, images
        self._candidates, self._stride = parameters.candidate_pixels, total // passes
        self.models = [model.copy() for model in modelling.models]
        self._buffer = np.array([rng.integers(0, images.shape[1], parameters.buffer) for _ in range(2)])
        self._rng = rng

    def run(self) -> list[float]:
        """All passes; the better model's error after each (Eq. 4)."""
        passes, iterations = self._draws.counts.shape[:2]
        slots, errors = self._buffer.shape[1], []
        touched = np.empty(len(self.models[0]), np.bool_)
        for t in range(passes):
            done = t * self._stride
            self._explore(done % slots)
            filled = min(done + 1, slots)
            error = [self._error(model, filled) for model in self.models]
            for step in range(iterations):
                for m in range(2):
                    child = self.models[m].copy()
                    mutate(child, touched, self._draws, t, step, m, self._rules)
                    found = self._error(child, filled)
                    if found < error[m]:
                        self.models[m], error[m] = child, found
            errors.append(min(error))
        return errors

    def _explore(self, slot: int) -> None:
        """Eq. 3: a pixel that the two models see differently, in each camera."""
        chosen = self._rng.permutation(self._images.shape[1])[: self._candidates]
        for camera in range(2):
            one, other = (self._see(model, camera, chosen) for model in self.models)
            self._buffer[camera, slot] = chosen[np.argmax(one != other)]

    def _error(self, model: Model, filled: int) -> float:
        """Eq. 4."""
        error = 0.0
        for camera in range(2):
            asked = self._buffer[camera, :filled]
            shades = np.where(self._see(model, camera, asked), PART_LUMINOSITY, WHITE)
            error += math.sqrt(np.sum((self._images[camera, asked].astype(int) - shades) ** 2)) / filled
        return error
