"""The paper's result figures, from whatever trials there are.

Mean over the trials with a band of one standard error of the mean, the single trials behind it, and above it a
sample of what the errors mean. A run of one trial gives the same figures with one curve.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from testbed.bodies.morphology import Morphology
from testbed.report.bodies import draw_self_models, self_models
from testbed.report.reading import Array, Row, Trial
from testbed.report.seen import draw_imagined, models_of
from testbed.report.series import Series, present_truths, self_series, teacher_series
from testbed.report.style import GRID, INK, MUTED, OF_TRUTH, stacked, styled
from testbed.vision import StereoRig

_WIDE = 7.4


@styled
def figure_6(trials: Sequence[Trial], student: Morphology) -> Figure | None:
    """Objective error of the student's self-models over the iterations of its search, or over its commands (Fig. 6)."""
    objective = self_series(trials, "objective")
    if objective is None:
        return None
    figure = Figure(figsize=(_WIDE, 4.6), layout="constrained")
    top, bottom = stacked(figure, 1.25, 2.4)
    draw_self_models(top, trials[0], student)
    axes = bottom.subplots()
    _curve(axes, objective, INK)
    marks = [0, len(objective.steps) // 2, len(objective.steps) - 1]
    axes.plot(marks, objective.mean[marks], "o", color=INK, markersize=5, zorder=5, clip_on=False)
    models = self_models(trials[0], student)
    counted = "iteration t" if models is None or models.unit == "t" else models.unit
    _finish(axes, objective, counted, "objective error (m)")
    return figure


@styled
def figure_7(
    trials: Sequence[Trial],
    truth: str,
    sample: tuple[Trial, str] | None = None,
    rig: StereoRig | None = None,
) -> Figure | None:
    """Objective error of the models of one kind of teacher over the passes (Fig. 7a or 7b), and their overlap.

    Args:
        trials: Over which to average.
        truth: Which kind of teacher.
        sample: The trial and the teacher whose models to draw above; none are drawn where it is None.
        rig: The student's eyes.
    """
    error = teacher_series(trials, truth, "model_position_error")
    if error is None:
        return None
    arrays = {} if sample is None else models_of(*sample)
    figure = Figure(figsize=(_WIDE, 4.4 if arrays else 2.9), layout="constrained")
    if arrays:
        top, bottom = stacked(figure, 1.2, 2.4)
        draw_imagined(top, arrays, rig)
    panels = (bottom if arrays else figure).subplots(1, 2)
    overlap = teacher_series(trials, truth, "model_overlap")
    for axes, series, label in (
        (panels[0], error, "error of part positions (m)"),
        (panels[1], overlap, "overlap of silhouettes"),
    ):
        if series is not None:
            _curve(axes, series, OF_TRUTH[truth])
            _mark_image_pairs(axes, _image_pairs(trials), len(series.steps) - 1)
            _finish(axes, series, "pass", label)
    panels[1].set_ylim(0, 1)
    return figure


def _mark_image_pairs(axes: Axes, pairs: int, passes: int) -> None:
    for change in range(1, pairs):
        axes.axvline(change * passes / pairs, color=MUTED, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
        axes.annotate(
            f"pair {change + 1}", (change * passes / pairs, 0.97), xycoords=("data", "axes fraction"), fontsize=8,
            color=MUTED, xytext=(4, 0), textcoords="offset points", va="top",
        )  # fmt: skip


@styled
def figure_8(trials: Sequence[Trial]) -> Figure | None:
    """Errors of the neural controllers over the iterations, for each kind of teacher (Fig. 8)."""
    figure = Figure(figsize=(_WIDE, 3.5), layout="constrained")
    panels = figure.subplots(1, 2)
    names = {
        "controller_objective": ("objective: against the true rolls", "rms roll error (rad)"),
        "controller_error": ("subjective: what the student judges by", "error, Eq. 5 (rad)"),
    }
    drawn = False
    truths = present_truths(row for trial in trials for row in trial.rows)
    for axes, (name, (title, label)) in zip(panels, names.items(), strict=True):
        all_series = {truth: teacher_series(trials, truth, name) for truth in truths}
        for truth, series in all_series.items():
            if series is not None:
                _curve(axes, series, OF_TRUTH[truth], truth)
                drawn = True
        some = next((series for series in all_series.values() if series is not None), None)
        if some is not None:
            _finish(axes, some, "iteration", label)
            axes.set_ylim(top=1.15 * axes.get_ylim()[1])  # room for a name above the highest curve
        axes.set_title(title, fontsize=9, pad=16)
        _name_curves(axes, all_series)
    return figure if drawn else None


@styled
def score_figure(rows: Sequence[Row], *, roc: bool = True) -> Figure | None:
    """How the scores of true and false teachers lie, where the verdict falls, and the ROC curve."""
    truths = present_truths(rows)
    scores = {
        truth: np.sort([float(row["score"]) for row in rows if row["truth"] == truth]) for truth in truths
    }
    both = len(truths) == 2
    enough = roc and both and min(map(len, scores.values())) > 1
    figure = Figure(figsize=(_WIDE, 2.9 if enough else 1.7), layout="constrained")
    panels = figure.subplots(1, 2, width_ratios=[1.9, 1]) if enough else [figure.subplots()]
    _strip(panels[0], scores, rows)
    if enough:
        _roc(panels[1], scores)
    return figure


def _image_pairs(trials: Sequence[Trial]) -> int:
    """How many image pairs a candidate was modelled from."""
    for trial in trials:
        for row in trial.rows:
            looks = trial.array(f"{row['teacher']}/look_steps")
            if looks is not None:
                return len(looks)
    return 1


def threshold(rows: Sequence[Row]) -> tuple[float, float] | None:
    """Between which two scores the verdict changes; None where all verdicts agree or do not follow the scores.

    A score with a probability changes its verdict at zero, where that is one half.
    """
    if rows and all(row.get("probability") is not None for row in rows):
        return 0.0, 0.0
    yes = [float(row["score"]) for row in rows if row["verdict"] == "appropriate"]
    no = [float(row["score"]) for row in rows if row["verdict"] == "inappropriate"]
    return (max(no), min(yes)) if yes and no and max(no) <= min(yes) else None


def _curve(axes: Axes, series: Series, colour: str, label: str | None = None) -> None:
    if series.n > 1:
        for single in series.curves[:40]:
            axes.plot(series.steps, single, color=colour, linewidth=0.5, alpha=0.22, zorder=2)
    axes.plot(series.steps, series.mean, color=colour, zorder=4, label=label)
    if series.sem is not None:
        for sign in (-1, 1):
            edge = series.mean + sign * series.sem
            axes.plot(series.steps, edge, color=colour, linewidth=0.9, linestyle=(0, (1, 1.6)), zorder=4)
        axes.fill_between(
            series.steps, series.mean - series.sem, series.mean + series.sem, color=colour, alpha=0.16,
            linewidth=0, zorder=3,
        )  # fmt: skip


def _finish(axes: Axes, series: Series, x: str, y: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_xlim(0, len(series.steps) - 1)
    axes.xaxis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 2.5, 5, 10], integer=True))
    axes.set_ylim(bottom=0)
    axes.grid(axis="y")
    shown = f"mean ± SEM of {series.n} trials" if series.n > 1 else "one trial"
    axes.annotate(
        shown, (1, 1.01), xycoords="axes fraction", ha="right", va="bottom", fontsize=8, color=MUTED
    )  # fmt: skip


def _name_curves(axes: Axes, all_series: dict[str, Series | None]) -> None:
    """Write each curve's name at its end rather than in a legend."""
    ends = {truth: float(series.mean[-1]) for truth, series in all_series.items() if series is not None}
    top = axes.get_ylim()[1]
    ordered = sorted(ends, key=lambda truth: ends[truth])
    for rank, truth in enumerate(ordered):
        above = rank == len(ordered) - 1
        axes.annotate(
            truth, (1, ends[truth] / top), xycoords="axes fraction", xytext=(0, 6 if above else -6),
            textcoords="offset points", ha="right", va="bottom" if above else "top", fontsize=9,
            fontweight="bold", color=OF_TRUTH[truth],
        )  # fmt: skip


def _strip(axes: Axes, scores: dict[str, Array], rows: Sequence[Row]) -> None:
    for height, (truth, values) in enumerate(reversed(scores.items())):
        lift = _spread(values)
        verdicts = {round(float(row["score"]), 12): row["verdict"] for row in rows if row["truth"] == truth}
        right = np.array([verdicts[round(float(value), 12)] == truth for value in values])
        for chosen, face in ((right, OF_TRUTH[truth]), (~right, "none")):
            axes.scatter(
                values[chosen], height + lift[chosen], s=34, facecolor=face, edgecolor=OF_TRUTH[truth],
                linewidth=1.3, zorder=3,
            )  # fmt: skip
    between = threshold(rows)
    if between is not None:
        axes.axvline(sum(between) / 2, color=INK, linewidth=1, linestyle=(0, (4, 3)), zorder=1)
        axes.annotate(
            "verdict: inappropriate  ◂ ▸  appropriate", (sum(between) / 2, 1.02), fontsize=8, color=MUTED,
            xycoords=("data", "axes fraction"), ha="center", va="bottom",
        )  # fmt: skip
    axes.set_yticks(range(len(scores)), [f"truly {truth}" for truth in reversed(scores)])
    for label, truth in zip(axes.get_yticklabels(), reversed(scores), strict=True):
        label.set_color(OF_TRUTH[truth])
        label.set_fontweight("bold")
    axes.set_ylim(-0.6, len(scores) - 0.4)
    axes.set_xlabel("score: how much like me (filled: right verdict, open: wrong)")
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.margins(x=0.12)
    axes.grid(axis="x")


def _spread(values: Array) -> Array:
    """Lifts equal scores off each other, up and down in turn."""
    if len(values) < 2:
        return np.zeros(len(values))
    width = max(float(np.ptp(values)), 1e-9) / 28
    lifts, last = np.zeros(len(values)), [-np.inf] * 7
    for index, value in enumerate(values):
        lane = next((lane for lane in range(7) if value - last[lane] > width), 6)
        last[lane] = float(value)
        lifts[index] = (lane + 1) // 2 * (0.11 if lane % 2 else -0.11)
    return lifts


def _roc(axes: Axes, scores: dict[str, Array]) -> None:
    cuts = np.unique(np.concatenate(list(scores.values())))[::-1]
    rates = [[0.0, 0.0], *([float(np.mean(values >= cut)) for values in scores.values()] for cut in cuts)]
    hits, false_alarms = np.array(rates).T
    axes.plot([0, 1], [0, 1], color=GRID, linewidth=1.2)
    axes.plot(false_alarms, hits, color=INK, linewidth=1.8)
    axes.fill_between(false_alarms, hits, color=INK, alpha=0.07, linewidth=0)
    axes.set_xlabel("false alarms")
    axes.set_ylabel("hits")
    axes.set_xticks([0, 0.5, 1])
    axes.set_yticks([0, 0.5, 1])
    axes.set_aspect("equal")
    axes.set_title("ROC", fontsize=9)
