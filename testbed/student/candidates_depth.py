"""Two bodies in one outline: told apart by their distances (an extension of Section 3.3).

Whoever stands before somebody else runs into the other's outline, and what is dark and hangs together is taken for one
candidate. Two eyes tell them apart: wherever there is an edge to be compared, its shift between the images is a
distance. One body gives distances that lie together, two give two heaps with hardly anything in between.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from testbed.frozen import Frozen
from testbed.vision.camera import StereoRig
from testbed.vision.foreground import foreground

Images = NDArray[np.uint8]
Vector = NDArray[np.float64]

FINE = 2  # columns in a column of an image, so that shifts of half a pixel are told
_BIN = 0.25  # pixels of disparity
_MOST = 80.0  # grey levels by which two pixels differ at most


class PartingParameters(Frozen):
    """When an outline is taken for two bodies. "Measured": 144 films of one body, 72 of two."""

    frames: int = Field(12, ge=1, le=1000, description="Of a film so many, evenly spread, are compared.")
    window: int = Field(5, ge=1, le=25, description="Pixels compared around each: twice a limb's thickness.")
    nearest: float = Field(0.3, gt=0, description="Nobody stands nearer, m: the largest shift that is tried.")
    worst: float = Field(
        15.0, gt=0, description="A match that differs by more grey levels in the mean is none."
    )
    edge: float = Field(
        4.0,
        gt=0,
        description="Where neighbours differ by less in the mean (grey levels) any shift would fit.",
    )
    windows: tuple[int, ...] = Field(
        (1, 3, 5, 9),
        description="To part two bodies surroundings of several sizes count alike: small ones keep edges sharp, large "
        "ones help where nothing is to be seen. Measured: 3.5% of the pixels go to the wrong body, without 9 4.7%.",
    )
    differ: float = Field(
        40.0, gt=0, description="Grey levels by which two pixels then differ at most: edges do."
    )
    hint: float = Field(
        5.0,
        ge=0,
        description="What a known neighbour counts, in grey levels: it decides where both shifts fit, as "
        "they do within a level limb.",
    )
    thick: float = Field(1.0, gt=0, description="A body's shifts then lie within so many pixels of its heap.")
    fleck: int = Field(6, ge=1, description="Pieces of fewer pixels than this are mistaken.")
    blur: float = Field(
        0.3, gt=0, description="Standard deviation of a shift, pixels: what its histogram is blurred by."
    )
    least_share: float = Field(
        0.07, gt=0, lt=0.5, description="The smaller heap has this share of the distances."
    )
    least_gap: float = Field(
        0.2, gt=0, description="Between the heaps, m: one body's parts that hide what joins them lie closer."
    )
    deep: float = Field(
        1.6,
        gt=0,
        description="Gap between the heaps in widths of the wider one up to which two bodies are certain: one alone "
        "that is seen askew was measured at 1.75.",
    )
    end_on: float = Field(
        3.3,
        gt=0,
        description="From here on it is taken for one body seen end on, its middle hidden. Such were measured at 2.4 "
        "to 3.9 and two far behind each other at 1.8 to 3.2: what lies between is said to be doubtful.",
    )
    clear: float = Field(
        0.88, gt=0, le=1, description="How clear the gap must be to take them for two; measured, see above."
    )
    doubtful: float = Field(0.6, gt=0, le=1, description="The same to say that there may be more than one.")


@dataclass(frozen=True)
class Depths:
    """At which distances an outline lies.

    Attributes:
        clearness: How empty the gap between two heaps of distances is: 0 for a single heap, 1 for two apart.
        gap: Disparity in between, pixels: who shifts by more is the nearer.
        far: Disparity of the farther heap, pixels.
        near: Of the nearer one.
    """

    clearness: float
    gap: float = 0.0
    far: float = 0.0
    near: float = 0.0


def depths_of(frames: Images, rig: StereoRig, dark_below: int, parameters: PartingParameters) -> Depths:
    """Whether what is dark in a film (F, 2, height, width) lies at one distance or at two."""
    if rig.baseline == 0:
        return Depths(0.0)
    some = np.unique(np.linspace(0, len(frames) - 1, parameters.frames).round().astype(int))
    shifts = [disparities(pair, rig, dark_below, parameters)[0] for pair in frames[some]]
    bins = np.arange(0, _largest(rig, parameters) + 1 + _BIN, _BIN)
    known = np.concatenate([each[np.isfinite(each)] for each in shifts])
    found = _two_heaps(np.histogram(known, bins)[0].astype(float), parameters)
    if found.clearness == 0:
        return found
    unit = rig.focal * rig.baseline
    apart = unit / found.far - unit / found.near
    wide = max(
        _width([(each < found.gap) for each in shifts], rig) * unit / found.far,
        _width([(each >= found.gap) for each in shifts], rig) * unit / found.near,
    )
    if apart < parameters.least_gap or apart > parameters.end_on * wide:
        return Depths(0.0)
    if apart > parameters.deep * wide:
        return replace(found, clearness=min(found.clearness, (parameters.doubtful + parameters.clear) / 2))
    return found


def disparities(pair: Images, rig: StereoRig, dark_below: int, parameters: PartingParameters) -> Vector:
    """(2, height, 2 width) by how many pixels each half pixel shifts from eye to eye; NaN where that cannot be told.

    Block matching: the shift at which the surroundings look most alike, if both eyes agree on it.
    """
    fine = pair.shape[-1] * FINE
    known = np.full((2, pair.shape[1], fine), np.nan)
    rows = np.flatnonzero(foreground(pair, dark_below).any(axis=(0, 2)))
    if not rows.size:
        return known
    band = slice(max(int(rows[0]) - parameters.window, 0), int(rows[-1]) + 1 + parameters.window)
    left, right = (finer(image[band]) for image in pair)
    block = block_of(parameters.window)
    area = float(block[0] * block[1])
    count = min(round(_largest(rig, parameters) * FINE) + 1, fine)
    costs = np.full((2, count, *left.shape), _MOST * area, np.float32)
    for shift in range(count):
        gap = np.full_like(left, _MOST)
        gap[:, shift:] = np.minimum(np.abs(left[:, shift:] - right[:, : fine - shift]), _MOST)
        costs[0, shift] = cv2.boxFilter(gap, -1, block, normalize=False)
        costs[1, shift, :, : fine - shift] = costs[0, shift, :, shift:]
    best = costs.argmin(axis=1)
    columns = np.arange(fine)[None]
    for eye, (image, sign) in enumerate(((left, -1), (right, 1))):
        there = np.clip(columns + sign * best[eye], 0, fine - 1)
        agreed = np.abs(np.take_along_axis(best[1 - eye], there, 1) - best[eye]) <= FINE // 2
        edges = np.abs(np.diff(image, axis=1, prepend=image[:, :1])) * FINE
        shifted, cost = _between(costs[eye], best[eye])
        good = agreed & (image < dark_below) & (cost < parameters.worst * area)
        good &= cv2.boxFilter(edges, -1, block, normalize=False) >= parameters.edge * area
        known[eye, band] = np.where(good, shifted / FINE, np.nan)
    return known


def finer(image: Images) -> NDArray[np.float32]:
    """An image with :data:`FINE` times the columns. Its levels are such fractions of grey levels as sum exactly."""
    height, width = image.shape
    fine = cv2.resize(image.astype(np.float32), (width * FINE, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(fine, np.float32)


def block_of(window: int) -> tuple[int, int]:
    """Fine columns and rows around a pixel that are compared."""
    return window * FINE + 1 - window * FINE % 2, window


def _two_heaps(counts: Vector, parameters: PartingParameters) -> Depths:
    """The emptiest place between two heaps of shifts, in a histogram of :data:`_BIN` pixels."""
    far = np.arange(-4 * parameters.blur, 4 * parameters.blur + _BIN / 2, _BIN)
    blur = np.exp(-0.5 * (far / parameters.blur) ** 2)
    heaps = np.convolve(counts, blur / blur.sum(), "same")
    best, total = Depths(0.0), heaps.sum()
    for place in range(1, len(heaps) - 1):
        below, above = heaps[:place], heaps[place:]
        lower, upper = int(below.argmax()), place + int(above.argmax())
        least = min(heaps[lower], heaps[upper])
        if min(below.sum(), above.sum()) < parameters.least_share * total or least <= 0:
            continue
        clearness = 1 - float(heaps[place] / least)
        if clearness > best.clearness:
            best = Depths(clearness, *(_BIN * (index + 0.5) for index in (place, lower, upper)))
    return best


def _between(costs: NDArray[np.float32], best: NDArray[np.int64]) -> tuple[Vector, Vector]:
    """The shift between the tried ones at which a parabola through the cheapest and its neighbours is least."""
    last = len(costs) - 1
    before, here, after = (
        np.take_along_axis(costs, np.clip(best + step, 0, last)[None], 0)[0].astype(float)
        for step in (-1, 0, 1)
    )
    inside = (best > 0) & (best < last)
    off = np.where(inside, 0.5 * (before - after) / np.maximum(before - 2 * here + after, 1e-6), 0.0)
    return best + np.clip(off, -0.5, 0.5), here


def _width(heaps: list[NDArray[np.bool_]], rig: StereoRig) -> float:
    """How wide a heap is seen, in focal lengths: the median over frames."""
    spans = [np.ptp(seen) for heap in heaps if (seen := np.flatnonzero(heap.sum(axis=0) >= FINE)).size]
    return float(np.median(spans)) / FINE / rig.focal if spans else 0.0


def _largest(rig: StereoRig, parameters: PartingParameters) -> float:
    """The disparity of who stands nearest, pixels."""
    return rig.focal * rig.baseline / parameters.nearest
