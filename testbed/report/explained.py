"""What the student saw, and its best explanations: by its own body, and by the best of other bodies."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from testbed.report.outlines import outline
from testbed.report.reading import Array, Trial
from testbed.report.seen import LEFT, draw_image, moments_of
from testbed.report.style import BLUE, LIMB_A, LIMB_B, LIMB_C, LIMB_D, name_row, styled
from testbed.vision import StereoRig

MOMENTS = 4
_OF_PART = (BLUE, LIMB_A, LIMB_B, LIMB_C, LIMB_D)
_WIDEST = 17  # letters in a line of a row's name
_DARK = 170
_MARGIN = 5  # pixels
_SMALLEST = 4.0  # the smallest window is 32 by 24 pixels


@dataclass(frozen=True)
class Explained:
    """One body laid over what was seen.

    Attributes:
        name: What the row of pictures is called.
        parts: (looks, m, 8) its parts, Eq. 2.
    """

    name: str
    parts: Array


def explanations(trial: Trial, teacher: str) -> list[Explained]:
    """How the mind explains the kept images of a teacher: its own body first; empty where it has no explanation."""
    shares, words = (trial.array(f"{teacher}/{name}") for name in ("explained", "explanation_words"))
    found = []
    for number in range(2):
        parts = next(
            (
                array
                for name in (f"explanation_parts_{number}", f"explanation_{number}")
                if (array := trial.array(f"{teacher}/{name}")) is not None
            ),
            None,
        )
        if parts is None or not np.any(np.isfinite(parts)):
            continue  # "a body that I cannot think of" has no parts
        name = "its own body" if number == 0 else "another body"
        if number and words is not None and len(words) > number and str(words[number]):
            name = f"another body: {words[number]}"
        if shares is not None and len(shares) > number and np.isfinite(shares[number]):
            name += f" ({float(shares[number]):.0%})"
        found.append(Explained("\n".join(textwrap.wrap(name, _WIDEST)), parts))
    return found or _free_parts(trial, teacher)


def _free_parts(trial: Trial, teacher: str) -> list[Explained]:
    """The objects of a mind that fits parts without saying how they hang together."""
    names = ("images", "motion_parts", "model_history")
    images, motion, history = (trial.array(f"{teacher}/{name}") for name in names)
    if images is None:
        return []
    if motion is not None:
        parts = motion[np.unique(np.linspace(0, len(motion) - 1, len(images)).round().astype(int))]
    elif history is not None:
        parts = history[moments_of(len(history) - 1, len(images))[1:]]
    else:
        return []
    return [Explained("what it\nmade of it", parts)]


@styled
def explanation_picture(trial: Trial, teacher: str, rig: StereoRig) -> Figure | None:
    """Left images at a few moments, each explanation's outlines over them: a row an explanation."""
    images, rows = trial.array(f"{teacher}/images"), explanations(trial, teacher)
    if images is None or not rows:
        return None
    looks = moments_shown(len(images))
    figure = Figure(figsize=(7.4, 1.17 * len(rows) + 0.25), layout="constrained")
    panels = np.atleast_2d(figure.subplots(len(rows), len(looks)))
    place = window(images[looks, LEFT])
    for line, row in zip(panels, rows, strict=True):
        for axes, look in zip(line, looks, strict=True):
            draw_explained(axes, images[look, LEFT], row.parts[look], rig, place)
        name_row(line[0], row.name)
    for axes, time in zip(panels[0], _times(trial, teacher, looks), strict=True):
        axes.set_title(time, loc="center", fontsize=9, fontweight="normal", pad=3)
    return figure


def draw_explained(axes: Axes, image: Array, parts: Array, rig: StereoRig, place: Array) -> None:
    """One image with a body's outlines over it, each part in its colour; of the image only this :func:`window`."""
    draw_image(axes, image)
    axes.set_xlim(*place[:, 0])
    axes.set_ylim(*place[::-1, 1])
    for number, part in enumerate(parts):
        seen = rig.project(outline(part))[LEFT]
        if np.all(np.isfinite(seen)):
            colour = _OF_PART[number % len(_OF_PART)]
            axes.add_patch(
                Polygon(seen, closed=True, fill=False, edgecolor=colour, linewidth=1.4, zorder=5 + number)
            )


def window(images: Array) -> Array:
    """(2, 2) corners, (u, v) each: the part of images (n, 75, 100) in which there is something to be seen.

    It keeps the images' shape. Noise is not dark enough to be something.
    """
    whole = np.array([[-0.5, -0.5], [99.5, 74.5]])
    v, u = np.nonzero((images < _DARK).any(axis=0))
    if not len(u):
        return whole
    low, high = np.array([u.min(), v.min()]) - _MARGIN, np.array([u.max(), v.max()]) + _MARGIN
    half = min(max(float(((high - low) / [4, 3]).max()) / 2, _SMALLEST), 12.5) * np.array([4, 3])
    middle = np.clip((low + high) / 2, whole[0] + half, whole[1] - half)
    return np.stack([middle - half, middle + half])


def moments_shown(looks: int, count: int = MOMENTS) -> list[int]:
    """Which of the kept images are shown: evenly spread, the first and the last among them."""
    return [int(look) for look in np.unique(np.linspace(0, looks - 1, min(count, looks)).round())]


def _times(trial: Trial, teacher: str, looks: Sequence[int]) -> list[str]:
    steps, control_step = trial.array(f"{teacher}/look_steps"), trial.array("time/control_step")
    if steps is None or control_step is None:
        return [""] * len(looks)
    return [f"{(steps[look] - steps[0]) * float(control_step):.1f} s" for look in looks]
