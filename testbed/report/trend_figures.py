"""Pictures of space-filling sweeps: verdicts and scores along each axis, all others varying, with a smoothed trend.

No two conditions of such a design differ in one axis alone, so that single conditions say little: what is drawn is the
local mean along an axis over all of them. Its interval resamples conditions and trials alike, since both are chances.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from testbed.bodies.morphology import Vector
from testbed.report.reading import Row
from testbed.report.style import BLUE, INK, OF_TRUTH, styled
from testbed.report.sweep_figures import labelled
from testbed.scenario.points import Block
from testbed.scenario.sweep import Axis, Level, level_name

_WIDE = 7.4
_FEWEST = 4
"""Conditions below which there is no trend to speak of."""
_BANDWIDTH = 0.15
"""Of the Gaussian that weighs neighbours, as a share of the axis: a bend over a third of it is still seen."""
_STEPS = 40
_RESAMPLES, _SEED = 400, 0x7E4D  # the same picture whenever the page is made


class Trend(NamedTuple):
    """A local mean along an axis with its 95% interval, (n,) each."""

    at: Vector
    mean: Vector
    low: Vector
    high: Vector


@styled
def trend_figure(block: Block, rows: Sequence[Row]) -> Figure | None:
    """Shares of right verdicts, and scores by truth, along each axis of a space-filling design.

    Args:
        block: The block.
        rows: Verdicts of one student in its cells.

    Returns:
        The figure; None for other designs, and where fewer than four conditions have verdicts.
    """
    points = {point.cell: point for point in (block.control, *block.points)}
    judged = [row for row in rows if row["cell"] in points]
    found = {row["cell"] for row in judged} - {block.control.cell}
    if block.spec.listed or len(found) < _FEWEST:
        return None
    figure = Figure(figsize=(_WIDE, 2.0 * len(block.axes) + 0.5), layout="constrained")
    panels = figure.subplots(len(block.axes), 2, squeeze=False, sharey="col")
    for (left, right), (name, axis) in zip(panels, block.axes.items(), strict=True):
        levels = {cell: level for cell, point in points.items() if (level := point.levels[name]) is not None}
        scale = _scale_of(axis, list(levels.values()))
        there = [row for row in judged if row["cell"] in levels]
        places = [scale.places[levels[str(row["cell"])]] for row in there]
        shares = [float(row["verdict"] == row["truth"]) for row in there]
        _draw(left, scale, places, there, shares, BLUE, block.control.cell)
        left.set_ylim(-0.04, 1.04)
        for truth, colour in OF_TRUTH.items():
            own = [
                (place, row)
                for place, row in zip(places, there, strict=True)
                if row["truth"] == truth and row["score"] is not None
            ]
            scores = [float(row["score"]) for _, row in own]
            at, which = [place for place, _ in own], [row for _, row in own]
            _draw(right, scale, at, which, scores, colour, block.control.cell, truth)
        for panel, title in ((left, "right verdicts"), (right, "score")):
            panel.set_xlabel(labelled(name))
            panel.set_ylabel(title)
            panel.grid(axis="y")
            if scale.logarithmic:
                panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
                panel.xaxis.set_major_formatter(lambda number, _: f"{number:g}")
                panel.minorticks_off()
            if scale.ticks:
                panel.set_xticks([scale.places[level] for level in scale.ticks], map(level_name, scale.ticks))
                panel.minorticks_off()
    figure.legend(*panels[0][1].get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize=8)
    return figure


class _Scale(NamedTuple):
    """An axis of a picture: where each level stands; the levels of a listed one; whether it is logarithmic."""

    places: dict[Level, float]
    ticks: list[Level]
    logarithmic: bool


def _scale_of(axis: Axis, levels: Sequence[Level]) -> _Scale:
    ticks = [level for level, _ in axis.levels()] if axis.ends is None else []
    every = dict.fromkeys((*ticks, *levels))
    if all(isinstance(level, int | float) and not isinstance(level, bool) for level in every):
        places = {level: float(level) for level in every}
        return _Scale(places, ticks, axis.logarithmic and min(places.values()) > 0)
    return _Scale({level: float(number) for number, level in enumerate(every)}, ticks, False)


def _draw(
    panel: Axes,
    scale: _Scale,
    places: Sequence[float],
    rows: Sequence[Row],
    values: Sequence[float],
    colour: str,
    control: str,
    label: str | None = None,
) -> None:
    """A dot a condition, the trend over them, and the control as an open circle."""
    at, measured = np.array(places), np.array(values)
    cells = np.array([str(row["cell"]) for row in rows])
    trials = np.array([int(row["trial"]) for row in rows])
    if scale.logarithmic:
        panel.set_xscale("log")
    for cell in dict.fromkeys(cells.tolist()):
        mine = cells == cell
        look = (
            {"markerfacecolor": "none", "markersize": 6}
            if cell == control
            else {"markersize": 3, "alpha": 0.5}
        )
        ink = INK if cell == control else colour
        panel.plot(at[mine][:1], measured[mine].mean(), "o", color=ink, zorder=3, **look)
    swept = cells != control
    if not swept.any():
        return
    along = np.log(at) if scale.logarithmic else at
    few = sorted(set(along[swept].tolist())) if scale.ticks else []
    trend = trend_of(along[swept], measured[swept], cells[swept], trials[swept], few)
    shown = np.exp(trend.at) if scale.logarithmic else trend.at
    if few:
        ends = np.stack([trend.mean - trend.low, trend.high - trend.mean]).clip(0)
        panel.errorbar(
            shown, trend.mean, ends, fmt="s", color=colour, markersize=5, linewidth=1.6, label=label
        )
    else:
        panel.fill_between(shown, trend.low, trend.high, color=colour, alpha=0.18, linewidth=0)
        panel.plot(shown, trend.mean, color=colour, label=label)


def trend_of(
    places: Vector, values: Vector, cells: Vector, trials: Vector, levels: Sequence[float] = ()
) -> Trend:
    """The local mean of values along an axis, by locally linear regression.

    Args:
        places: (n,) along the axis.
        values: (n,) there.
        cells: (n,) which condition each value is of.
        trials: (n,) and which trial.
        levels: Where the axis has these only, the mean at each of them instead.
    """
    at = np.array(levels) if levels else np.linspace(places.min(), places.max(), _STEPS)
    away = places - at[:, None]  # (steps, n)
    width = max(float(np.ptp(places)) * _BANDWIDTH, 1e-12)
    kernel = np.asarray(np.isclose(away, 0), float) if levels else np.exp(-((away / width) ** 2) / 2)
    rng = np.random.default_rng(_SEED)
    weights = _drawn(cells, rng) * _drawn(trials, rng)
    weights = np.concatenate([np.ones((1, len(values))), weights])
    s0, s1, s2 = (weights @ (kernel * away**power).T for power in range(3))  # (resamples + 1, steps)
    t0, t1 = (weights @ (kernel * away**power * values).T for power in range(2))
    level = s0 * s2 - s1**2
    flat = level <= 1e-6 * s0 * (s2 + width**2 * s0)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = np.where(flat, t0 / s0, (s2 * t0 - s1 * t1) / level)
    means = np.clip(means, values.min(), values.max())
    low, high = np.nanquantile(means[1:], [0.025, 0.975], axis=0)
    return Trend(at, means[0], low, high)


def _drawn(kinds: Vector, rng: np.random.Generator) -> Vector:
    """(resamples, n) how often each value is there when its kinds are drawn anew; once each where there is one kind."""
    which, index = np.unique(kinds, return_inverse=True)
    if len(which) < 2:
        return np.ones((_RESAMPLES, len(kinds)))
    counts = rng.multinomial(len(which), np.full(len(which), 1 / len(which)), size=_RESAMPLES)
    return np.asarray(counts[:, index], dtype=float)
