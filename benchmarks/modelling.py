"""One literal teacher-modelling run of 3000 passes, and the same loop over somebody else's eyes."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from benchmarks.eyes import bullet, numpy_rays
from benchmarks.measure import Settings, interleaved
from benchmarks.plain_modelling import Model, PlainModelling, See
from benchmarks.row import Row, faster, within
from benchmarks.scenes import RIG, models, rays
from testbed.student.parameters import TeacherModellingParameters
from testbed.student.seeing.teacher_modelling import Modelling
from testbed.vision import render

NAME = "teacher modelling, 3000 passes"
SECONDS = 1.0
STRETCH = 0.4
PARTS, PASSES = 3, 3000
OF_NUMPY, OF_RENDERER = 300, 100
WIDTHS = TeacherModellingParameters()


def rows(settings: Settings) -> Iterator[Row]:
    """The project's loop against its limit, and against the same loop over NumPy and TinyRenderer."""
    images = render(models(PARTS, 1)[0], RIG)
    of_numpy = PASSES if settings.full else OF_NUMPY
    seeds = itertools.count()
    calls: dict[str, Callable[[], object]] = {
        "ours": lambda: ours(images, next(seeds)),
        "NumPy": plainly(with_numpy(), images, of_numpy),
        "TinyRenderer": plainly(with_renderer(), images, OF_RENDERER),
    }
    calls["ours"]()  # compiles, or loads what was compiled
    times = interleaved(calls, settings.rounds, once=True)
    stretch = f"stretch goal {STRETCH} s"
    yield within(NAME, SECONDS, times["ours"], note=stretch)
    for name, passes in (("NumPy", of_numpy), ("TinyRenderer", OF_RENDERER)):
        note = f"extrapolated from {passes} passes, spread over the whole run" if passes < PASSES else ""
        yield faster(
            NAME, f"the same loop over {name}", times[name] * (PASSES / passes), times["ours"], note=note
        )


def ours(images: NDArray[np.uint8], seed: int) -> Modelling:
    """Three image pairs, a thousand passes on each."""
    modelling = Modelling(RIG, PARTS, WIDTHS, np.random.default_rng(seed))
    for _ in range(WIDTHS.image_pairs):
        modelling.observe(*images)
    return modelling


def plainly(see: See, images: NDArray[np.uint8], passes: int) -> Callable[[], object]:
    """Some of the passes in the plain loop; another seed at each call."""
    seeds = itertools.count()

    def run() -> list[float]:
        seed = next(seeds)
        start = Modelling(RIG, PARTS, WIDTHS, np.random.default_rng(seed))
        flat = images.reshape(2, -1)
        return PlainModelling(start, see, flat, passes=passes, total=PASSES, seed=seed).run()

    return run


def with_numpy() -> See:
    """The models are asked about the pixels alone."""
    x, y = np.ascontiguousarray(rays(np.arange(RIG.width * RIG.height)).T)

    def see(model: Model, camera: int, asked: NDArray[np.int64]) -> NDArray[np.bool_]:
        return numpy_rays.meets(model, RIG.eyes[camera], x[asked], y[asked])

    return see


def with_renderer() -> See:
    """The bodies are built once for both cameras."""
    client, built = bullet.connect(), np.empty(0)

    def see(model: Model, camera: int, asked: NDArray[np.int64]) -> NDArray[np.bool_]:
        nonlocal built
        if not np.array_equal(model, built):
            bullet.build(client, model, collide=False)
            built = model.copy()
        return bullet.drawn(client, RIG.eyes[camera], RIG)[asked]

    return see
