"""Which of K requested pixels does a model darken? The project's kernel against everybody who can answer.

Time is that of one model in one camera. The kernel and its rival in C go through many models in a compiled loop, as
modelling does; the others are called from Python, which is how they are had.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.eyes import Look, MissingError, bullet, embree, lanes, mujoco_eyes, numpy_rays
from benchmarks.measure import Settings, interleaved
from benchmarks.row import Row, faster, left_out
from benchmarks.scenes import RIG, models, pixels, rays
from testbed.vision import luminosity
from testbed.vision._jit import compiled
from testbed.vision.kernel import PART_LUMINOSITY, WHITE, cover

PIXELS = (10, 100, 1000, 7500)
JUDGED = 1000
PARTS = 3
FUSED, PLAIN = "hand-vectorised C, fused", "hand-vectorised C, rounded alike"
PUBLIC = "the project's function `luminosity`"
TARGETS = {
    "PyBullet TinyRenderer, bodies rebuilt": 200.0,
    "PyBullet rayTestBatch, bodies rebuilt": 100.0,
    "MuJoCo mj_multiRay": 30.0,
    "NumPy": 35.0,
    PLAIN: 1 / 3,
    FUSED: 1 / 3,
}
"""At 1000 pixels: a ratio of 1/3 is three times slower."""
_FLUSHED = 1 << 26  # bytes, more than any cache keeps
_LEAST = 0.97  # of all pixels on which a peer must agree, or it has not done the same work


def rows(settings: Settings) -> Iterator[Row]:
    """Every number of pixels against every peer, and one of them with cold caches."""
    for count in PIXELS:
        yield from compared(count, settings)
    yield from cold(settings)


def compared(count: int, settings: Settings) -> Iterator[Row]:
    """Everybody at ``count`` pixels in the same rounds."""
    made, missing = contenders(count)
    times = interleaved({name: call for name, (call, _) in made.items()}, settings.rounds)
    each = {name: times[name] / made[name][1] for name in made}
    for name in made:
        if name == OURS:
            continue
        target = TARGETS.get(name) if count == JUDGED else None
        note = "two cameras and the checks of its arguments" if name == PUBLIC else ""
        if name in (PLAIN, FUSED):
            note = lanes.registers()
        yield faster(_name(count), name, each[name], each[OURS], target, note=note)
    for name, why in missing.items():
        yield left_out(_name(count), name, why)


OURS = "kernel"


def contenders(count: int) -> tuple[dict[str, tuple[Callable[[], object], int]], dict[str, str]]:
    """What each does in a call and how many models that are; and who is not here, and why."""
    chosen, scenes = pixels(count), models(PARTS)
    seen, eye = rays(chosen), RIG.eyes[0]
    expected = kernel(scenes, seen, eye)()
    made: dict[str, tuple[Callable[[], object], int]] = {OURS: (kernel(scenes, seen, eye), len(scenes))}
    missing: dict[str, str] = {}
    opened: dict[str, Callable[[], Look]] = {
        "NumPy": partial(numpy_rays.open_eye, seen, eye),
        "NumPy, float32": partial(numpy_rays.open_eye, seen, eye, np.float32),
        "PyBullet TinyRenderer, bodies rebuilt": partial(bullet.open_renderer, eye, chosen, RIG),
        "PyBullet rayTestBatch, bodies rebuilt": partial(bullet.open_rays, seen, eye),
        "MuJoCo mj_multiRay": partial(mujoco_eyes.open_rays, seen, eye, PARTS, RIG),
        "MuJoCo EGL": partial(mujoco_eyes.open_renderer, eye, PARTS, chosen, RIG),
        "Embree, tree rebuilt": partial(embree.open_eye, seen, eye),
    }
    for name, way in opened.items():
        try:
            look = way()
        except MissingError as why:
            missing[name] = str(why)
            continue
        agreement(name, look, scenes, expected)
        made[name] = (one_by_one(look, scenes), 1)
    for name, fused in ((PLAIN, False), (FUSED, True)):
        try:
            all_of_them = lanes.open_eye(seen, eye, fused=fused)
        except MissingError as why:
            missing[name] = str(why)
            continue
        same = np.mean(all_of_them(scenes) == expected)
        assert same == 1.0 if not fused else same > 0.999, f"{name} agrees on {same:.4%}"
        made[name] = (partial(all_of_them, scenes), len(scenes))
    grid = np.column_stack([chosen % RIG.width, chosen // RIG.width])
    made[PUBLIC] = (one_by_one(lambda model: luminosity(model, RIG, grid), scenes), 1)
    return made, missing


def agreement(name: str, look: Look, scenes: NDArray[np.float64], expected: NDArray[np.uint8]) -> None:
    """Edges of facets and of pixels aside, a peer must see the same."""
    same = np.mean([np.mean(look(model) == wanted) for model, wanted in zip(scenes, expected, strict=True)])
    assert same > _LEAST, f"{name} agrees on {same:.2%} of the pixels only"


def one_by_one(
    look: Callable[[NDArray[np.float64]], object], scenes: NDArray[np.float64]
) -> Callable[[], object]:
    """Another model at each call."""
    endless = itertools.cycle(list(scenes))
    return lambda: look(next(endless))


def kernel(
    scenes: NDArray[np.float64], seen: NDArray[np.float64], eye: float
) -> Callable[[], NDArray[np.uint8]]:
    """The project's kernel, once for all models."""
    dx, dy = np.ascontiguousarray(seen.T.astype(np.float32))
    out = np.empty((len(scenes), len(dx)), np.uint8)

    def look() -> NDArray[np.uint8]:
        look_at_all(scenes, eye, dx, dy, out)
        return out

    return look


@compiled
def look_at_all(
    scenes: NDArray[np.float64],
    eye: float,
    dx: NDArray[np.float32],
    dy: NDArray[np.float32],
    out: NDArray[np.uint8],
) -> None:
    """The luminosities ``out`` (n, K) of the rays (K,) for each of the models (n, k, 8)."""
    row = np.empty(dx.size, np.uint8)
    for m in range(scenes.shape[0]):
        seen = out[m]
        for i in range(row.size):
            seen[i] = WHITE
        for k in range(scenes.shape[1]):
            cover(scenes[m, k], eye, dx, dy, row)
            for i in range(row.size):
                seen[i] = PART_LUMINOSITY if row[i] else seen[i]


def cold(settings: Settings) -> Iterator[Row]:
    """One model after the caches were filled with something else."""
    seen, scene, eye = rays(pixels(JUDGED)), models(PARTS, 1), RIG.eyes[0]
    calls: dict[str, Callable[[], object]] = {
        OURS: kernel(scene, seen, eye),
        "NumPy": partial(numpy_rays.open_eye(seen, eye), scene[0]),
    }
    try:
        calls[PLAIN] = partial(lanes.open_eye(seen, eye, fused=False), scene)
    except MissingError as why:
        yield left_out(f"{_name(JUDGED)}, caches cold", PLAIN, str(why))
    flushed = np.zeros(_FLUSHED, np.uint8)
    times = interleaved(calls, 3 * settings.rounds, before=lambda: flushed.__iadd__(1))
    for name in calls:
        if name != OURS:
            yield faster(f"{_name(JUDGED)}, caches cold", name, times[name], times[OURS])


def _name(count: int) -> str:
    return f"luminosity of {count} pixels, {PARTS} parts"
