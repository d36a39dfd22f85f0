"""How well students tell who is like them, as curves: ROC, and whether probabilities mean what they say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbed.experiment.calibration import BINS, reliability
from testbed.experiment.roc import Scored, roc_points
from testbed.experiment.statistics import auc, wilson
from testbed.experiment.verdicts import scored
from testbed.report.reading import Row
from testbed.report.style import BLUE, GRID, INK, LIMB_A, LIMB_B, LIMB_C, LIMB_D, MUTED, ORANGE, styled

_COLOURS = (INK, ORANGE, LIMB_A, LIMB_B, LIMB_C, LIMB_D, BLUE)
_STROKES = ((1, 0), (4, 1.5), (1, 1.2))


@styled
def roc_figure(rows: Sequence[Row], students: Sequence[str]) -> Figure | None:
    """The ROC curve of every student whose scores tell both kinds of teachers; the corner again, enlarged."""
    curves = {
        student: having
        for student in students
        if (having := scored([row for row in rows if row["student"] == student])) and _both(having)
    }
    if not curves:
        return None
    figure = Figure(figsize=(7.4, 3.0), layout="constrained")
    whole, corner, names = figure.subplots(1, 3, width_ratios=[1, 1, 0.72])
    for axes in (whole, corner):
        axes.plot([0, 1], [0, 1], color=GRID, linewidth=1.2)
        axes.set_xlabel("false alarms")
        axes.set_box_aspect(1)
        axes.grid()
    names.set_axis_off()
    for number, (student, having) in enumerate(curves.items()):
        colour = _COLOURS[number % len(_COLOURS)]
        stroke = (0, _STROKES[number % len(_STROKES)])
        alarms, hits = roc_points(having.scores, having.positive)
        for axes in (whole, corner):
            axes.plot(
                alarms,
                hits,
                color=colour,
                linestyle=stroke,
                linewidth=2.4 if number == 0 else 1.5,
                zorder=9 - number,
            )
        height = 0.92 - 0.105 * number
        names.plot(
            [0.0, 0.16],
            [height, height],
            color=colour,
            linestyle=stroke,
            linewidth=2.4 if number == 0 else 1.5,
        )
        names.text(
            0.22, height, f"{student}  {auc(having.scores, having.positive):.3f}", fontsize=8.5, va="center"
        )
    names.text(0.0, 1.0, "area under the curve", fontsize=8.5, color=MUTED, va="bottom")
    names.set_xlim(0, 1)
    names.set_ylim(0, 1)
    whole.set_ylabel("hits")
    for axes, ticks in ((whole, [0, 0.5, 1]), (corner, [0, 0.1, 0.2])):
        axes.set_xticks(ticks)
    whole.set_yticks([0, 0.5, 1])
    whole.set_xlim(-0.02, 1.02)
    whole.set_ylim(-0.02, 1.02)
    corner.set_yticks([0.8, 0.9, 1])
    corner.set_xlim(-0.004, 0.2)
    corner.set_ylim(0.8, 1.004)
    whole.set_title("ROC", fontsize=9)
    corner.set_title("its best corner", fontsize=9)
    return figure


@styled
def reliability_figure(rows: Sequence[Row]) -> Figure | None:
    """Of what a student calls so likely, what share is so: with Wilson's intervals, and how often it says it."""
    having = scored(rows, "probability")
    if not len(having.scores):
        return None
    bins = reliability(having.scores, having.positive)
    figure = Figure(figsize=(7.4, 3.3), layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=[2.4, 1], sharex=True)
    upper.plot([0, 1], [0, 1], color=GRID, linewidth=1.2)
    for each in bins:
        low, high = wilson(each.positives, each.n)
        upper.plot([each.stated] * 2, [low, high], color=INK, linewidth=1.2)
        upper.plot(each.stated, each.share, "o", color=INK, markersize=5, zorder=4)
        _bar(lower, each.low, 1 / BINS, each.n)
    upper.set_ylabel("share truly like it")
    upper.set_ylim(-0.04, 1.04)
    upper.set_yticks([0, 0.5, 1])
    upper.grid()
    lower.set_ylabel("verdicts")
    lower.set_xlabel("probability that the student gave")
    lower.set_xlim(-0.02, 1.02)
    lower.set_xticks(np.arange(0, 1.01, 0.2))
    lower.set_ylim(0, 1.25 * max(each.n for each in bins))
    return figure


def _bar(axes: Axes, low: float, width: float, count: int) -> None:
    axes.bar(low + width / 2, count, width * 0.92, color=MUTED, alpha=0.55, zorder=3)
    axes.annotate(
        str(count), (low + width / 2, count), (0, 2), textcoords="offset points", ha="center", fontsize=8,
        color=INK,
    )  # fmt: skip


def _both(having: Scored) -> bool:
    return 0 < int(having.positive.sum()) < len(having.positive)
