"""What the student sees of a teacher, and what it makes of it (the paper's Fig. 4).

Images keep the 100 x 75 pixels that the student has; outlines of the true parts are drawn over them.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.patches import Polygon

from testbed.report.outlines import outline
from testbed.report.reading import Array, Trial
from testbed.report.style import ASKED, INK, MUTED, TRUE, stacked, styled
from testbed.vision import StereoRig, render

LEFT = 0
_HEIGHT, _WIDTH = 75, 100
_DARK = 220  # darker than this is robot, for colouring only


def draw_image(axes: Axes, image: Array) -> None:
    """One camera image, crisp, with a thin frame."""
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="none")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(True)
        spine.set_color(MUTED)
        spine.set_linewidth(0.6)
    axes.set_xlim(-0.5, _WIDTH - 0.5)
    axes.set_ylim(_HEIGHT - 0.5, -0.5)


def draw_outlines(axes: Axes, parts: Array, rig: StereoRig, colour: str = TRUE) -> None:
    """The outlines of true parts as the left camera would see them."""
    for part in parts:
        seen = rig.project(outline(part))[LEFT]
        if np.all(np.isfinite(seen)):
            axes.add_patch(Polygon(seen, closed=True, fill=False, edgecolor=colour, linewidth=1.0, zorder=5))


def models_of(trial: Trial, teacher: str) -> dict[str, Array]:
    """What is drawn of a teacher's models; empty where the student did not model it."""
    names = ("images", "truth_parts", "model_history", "pixels")
    arrays = {name: array for name in names if (array := trial.array(f"{teacher}/{name}")) is not None}
    return arrays if len(arrays) == len(names) else {}


def draw_imagined(
    figure: FigureBase, arrays: Mapping[str, Array], rig: StereoRig | None = None
) -> list[Axes]:
    """A row of images: the model at random start and at the end of each image pair, true outlines over it."""
    rig = rig or StereoRig()
    pairs = len(arrays["images"])
    moments = moments_of(len(arrays["model_history"]) - 1, pairs)
    panels = list(np.atleast_1d(figure.subplots(1, len(moments))))
    for number, (axes, moment) in enumerate(zip(panels, moments, strict=True)):
        draw_image(axes, render(arrays["model_history"][moment], rig)[LEFT])
        draw_outlines(axes, arrays["truth_parts"][max(number - 1, 0)], rig)
        axes.set_title(f"pass {moment}" if moment else "start", loc="center", fontsize=9, pad=3)
    return panels


def moments_of(passes: int, pairs: int) -> list[int]:
    """After how many passes the student has done with no image pair, with the first, with the second, and so on.

    Row p of a model's history is the model after p passes; row 0 is the random start.
    """
    return [-(-passes * pair // pairs) for pair in range(pairs + 1)]


@styled
def teacher_model_picture(trial: Trial, teacher: str, rig: StereoRig | None = None) -> Figure | None:
    """What the student took in (with the pixels that it asked for) and what it imagined, for each image pair."""
    arrays = models_of(trial, teacher)
    if not arrays:
        return None
    figure = Figure(figsize=(7.4, 3.2), layout="constrained")
    top, bottom = stacked(figure, 1.0, 1.0)
    pairs = len(arrays["images"])
    moments = moments_of(len(arrays["pixels"]), pairs)
    panels = list(top.subplots(1, pairs + 1))
    _key(panels[0])
    for pair, axes in enumerate(panels[1:]):
        asked = arrays["pixels"][moments[pair] : moments[pair + 1], LEFT].astype(int)
        draw_image(axes, _with_asked(arrays["images"][pair, LEFT], asked))
        axes.set_title(f"image pair {pair + 1}, left", loc="center", fontsize=9, pad=3)
    draw_imagined(bottom, arrays, rig)
    return figure


def _with_asked(image: Array, asked: Array) -> Array:
    """(75, 100, 3): the image with the pixels (n, 2) that the student asked for in colour."""
    picture = np.repeat(image[..., None], 3, axis=2)
    dark = image[asked[:, 1], asked[:, 0]] < _DARK
    for chosen, colour in ((asked[~dark], ASKED), (asked[dark], TRUE)):
        picture[chosen[:, 1], chosen[:, 0]] = [int(colour[start : start + 2], 16) for start in (1, 3, 5)]
    return picture


def _key(axes: Axes) -> None:
    axes.set_axis_off()
    lines = (
        (0.80, "●", ASKED, "asked: background"),
        (0.62, "●", TRUE, "asked: robot"),
        (0.30, "■", MUTED, "imagined teacher"),
        (0.12, "▭", TRUE, "true outline"),
    )
    for y, mark, colour, text in lines:
        axes.text(0.02, y, mark, color=colour, fontsize=9, va="center", transform=axes.transAxes)
        axes.text(0.16, y, text, color=INK, fontsize=8.5, va="center", transform=axes.transAxes)
