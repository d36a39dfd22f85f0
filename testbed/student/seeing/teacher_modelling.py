"""Teacher modelling (Section 3.3): from stereo images of a teacher to a model of it.

The estimation-exploration algorithm keeps two models, A and B, each k primitives (Eq. 2). A pass is

- exploration: of 1000 random pixels, find one that A and B see differently (Eq. 3), in the left images and in
  the right ones; ask the student's own images what is there; remember the answers in a buffer of 2 x 1000;
- estimation: eight times for either model, mutate one to five variables and keep the child if it explains the
  buffered pixels better (Eq. 4).

After 1000 passes the student takes a new image pair; remembered pixels keep the labels of the image that they
were taken from until they are overwritten. Three pairs make 3000 passes. The best model's parameters after each
of the 24 000 iterations are the record that imitation (Section 3.4) reads: as the teacher moves, they change.

    modelling = Modelling(rig, parts=3, parameters=TeacherModellingParameters(), rng=np.random.default_rng(7))
    for left, right in image_pairs:
        modelling.observe(left, right)
    rolls = modelling.record().motion.sampled(240)[:, :, 4]
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbed.student.motion import TeacherMotion
from testbed.student.parameters import TeacherModellingParameters
from testbed.student.seeing import _eea, _mutation
from testbed.vision.camera import StereoRig
from testbed.vision.primitives import COLUMNS, CUBOID, D1, OMEGA, SHAPE, X, Y, Z


@dataclass(frozen=True)
class TeacherRecord:
    """What modelling one candidate leaves behind; shorter if fewer image pairs were observed."""

    initial: NDArray[np.float64]  # (k, 8): the best model at random start
    history: NDArray[np.float64]  # (passes x iterations = 24 000, k, 8): the best model, see `history_of`
    error: NDArray[np.float64]  # (passes, 2): Eq. 4 of A and B after each pass
    pixels: NDArray[np.int16]  # (passes, 2, 2): the pixel (u, v) learnt by the left and by the right camera
    disagreed: NDArray[np.bool_]  # (passes, 2): whether A and B disagreed on it (Eq. 3)
    images: NDArray[np.uint8]  # (pairs, 2, height, width): what the student saw
    times: NDArray[np.float64]  # (pairs,): when, s

    @property
    def final(self) -> NDArray[np.float64]:
        """(k, 8): the better model at the end."""
        model: NDArray[np.float64] = self.history[-1]
        return model

    @property
    def motion(self) -> TeacherMotion:
        """The history as a motion: each image pair's share of it lasts until the next pair."""
        pairs = len(self.times)
        lasts = float(self.times[-1] - self.times[0]) / max(pairs - 1, 1) * pairs or 1.0
        times = self.times[0] + np.arange(1, len(self.history) + 1) * (lasts / len(self.history))
        return TeacherMotion(times, self.history)


def random_models(
    count: int, parts: int, rig: StereoRig, parameters: TeacherModellingParameters, rng: np.random.Generator
) -> NDArray[np.float64]:
    """(count, parts, 8): random instances of Eq. 2, every variable uniform in its initial range."""
    models = np.empty((count, parts, len(COLUMNS)))
    shape = (count, parts)
    models[..., SHAPE] = rng.integers(0, 3, shape)
    models[..., Z] = rng.uniform(*parameters.initial_depth, shape)
    for axis, pixels in ((X, rig.width), (Y, rig.height)):
        reach = parameters.initial_view * pixels / 2.0 / rig.focal
        models[..., axis] = models[..., Z] * rng.uniform(-reach, reach, shape)
    models[..., OMEGA] = rng.uniform(-math.pi / 2.0, math.pi / 2.0, shape)
    models[..., D1:] = rng.uniform(*parameters.initial_extent, (*shape, 3))
    models[..., D1] *= np.where(models[..., SHAPE] == CUBOID, 1.0, 0.5)  # d1 is a radius there
    return models


def draw(
    parts: int, pixels: int, parameters: TeacherModellingParameters, rng: np.random.Generator
) -> _mutation.Draws:
    """The random numbers of the passes on one image pair."""
    passes, most = parameters.passes_per_image, parameters.mutations_max
    each = (passes, parameters.estimation_iterations, 2)
    return _mutation.Draws(
        candidates=rng.random((passes, min(parameters.candidate_pixels, pixels))),
        counts=rng.integers(parameters.mutations_min, most + 1, each),
        variables=rng.integers(0, parts * len(COLUMNS), (*each, most)),
        normals=rng.standard_normal((*each, most)),
        shapes=rng.integers(0, 3, (*each, most)),
    )


class Modelling:
    """Models one candidate teacher, image pair by image pair.

    ``parts`` is the number of parts of the student's own body. Everything random comes from ``rng``: the same
    seed and the same images give the same record, bit for bit.
    """

    def __init__(
        self,
        rig: StereoRig,
        parts: int,
        parameters: TeacherModellingParameters,
        rng: np.random.Generator,
    ) -> None:
        if parts < 1:
            raise ValueError(f"a model needs at least one part, not {parts}")
        self.rig, self.parts, self.parameters = rig, parts, parameters
        self.models = random_models(2, parts, rig, parameters, rng)
        self._initial = self.models.copy()
        self._rng = rng
        self._rays = rig.rays().astype(np.float32).reshape(-1, 2)
        self._order = np.arange(len(self._rays))
        slots = parameters.buffer
        self.memory = _eea.Memory(
            dx=np.zeros((2, slots), np.float32),
            dy=np.zeros((2, slots), np.float32),
            if_white=np.zeros((2, slots), np.int32),
            if_dark=np.zeros((2, slots), np.int32),
            rows=np.zeros((2, 2, parts, slots), np.uint8),
            sums=np.zeros((2, 2), np.int64),
        )
        self._rules = _rules(rig, parameters)
        self._images: list[NDArray[np.uint8]] = []
        self._traces: list[_eea.Trace] = []

    def observe(self, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> None:
        """Run the passes on one image pair, each (height, width) uint8 with a white background.

        Raises ValueError for images that this rig cannot have taken.
        """
        images = np.stack([np.asarray(left), np.asarray(right)])
        if images.shape != (2, self.rig.height, self.rig.width) or images.dtype != np.uint8:
            expected = f"({self.rig.height}, {self.rig.width}) uint8"
            raise ValueError(f"an image is {expected}, not {images.shape[1:]} {images.dtype}")
        p = self.parameters
        passes, iterations = p.passes_per_image, p.estimation_iterations
        trace = _eea.Trace(
            histories=np.empty((passes * iterations, 2, self.parts, len(COLUMNS))),
            better=np.empty(passes * iterations, np.uint8),
            error=np.empty((passes, 2)),
            pixels=np.empty((passes, 2), np.int64),
            disagreed=np.empty((passes, 2), np.bool_),
        )
        view = _eea.View(
            images=images.reshape(2, -1),
            dx=np.ascontiguousarray(self._rays[:, 0]),
            dy=np.ascontiguousarray(self._rays[:, 1]),
            eyes=self.rig.eyes,
        )
        draws = draw(self.parts, len(self._rays), p, self._rng)
        done = len(self._images) * passes
        _eea.run_passes(done, self.models, view, self.memory, self._order, draws, self._rules, trace)
        self._images.append(images)
        self._traces.append(trace)

    def record(self, times: NDArray[np.float64] | None = None) -> TeacherRecord:
        """The record so far; ``times`` (pairs,) says when the image pairs were seen (s), one a second if not given.

        Raises ValueError before the first image pair.
        """
        if not self._traces:
            raise ValueError("nothing has been observed yet")
        histories = np.concatenate([t.histories for t in self._traces])
        better = np.concatenate([t.better for t in self._traces])
        if self.parameters.history_of == "final_best":
            better = np.full_like(better, better[-1])
        v, u = np.divmod(np.concatenate([t.pixels for t in self._traces]), self.rig.width)
        return TeacherRecord(
            initial=self._initial[better[0]],
            history=histories[np.arange(len(histories)), better],
            error=np.concatenate([t.error for t in self._traces]),
            pixels=np.stack([u, v], axis=-1).astype(np.int16),
            disagreed=np.concatenate([t.disagreed for t in self._traces]),
            images=np.stack(self._images),
            times=np.arange(len(self._images), dtype=float) if times is None else times,
        )


def _rules(rig: StereoRig, p: TeacherModellingParameters) -> _mutation.Rules:
    shape = 0.0  # a shape is drawn anew, not perturbed
    widths = [shape, p.position_width, p.position_width, p.depth_width, p.roll_width, *[p.size_width] * 3]
    return _mutation.Rules(
        luminosity=p.part_luminosity,
        widths=np.array(widths),
        depth=p.depth_bounds,
        extent=p.extent_bounds,
        tangent=(rig.width / 2.0 / rig.focal, rig.height / 2.0 / rig.focal),
        girth=2.0 if p.shape_change == "equal_extent" else 2.0 * math.pi,
    )
