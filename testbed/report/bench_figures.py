"""Pictures that hold a bench against its simulation: tilt, rolls, paths, and what the cameras saw."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbed.experiment.sim_and_bench import Paths, Rolls, Tilts
from testbed.report.motion import part_name
from testbed.report.reading import Array
from testbed.report.style import BLUE, GRID, INK, MUTED, OF_PART, ORANGE, styled

_AXES = ("to the side", "nose-down")
_COLOURS = (ORANGE, BLUE)
_NARROWEST = 20.0
"""Degrees that a panel of rolls shows at least, so that a part that hardly moves looks like one."""


@styled
def tilt_figure(tilts: Sequence[Tilts]) -> Figure | None:
    """Left: felt on the bench against the simulated twin. Right: the difference, command by command."""
    if not tilts:
        return None
    felt = np.degrees(np.concatenate([each.felt for each in tilts]))
    simulated = np.degrees(np.concatenate([each.simulated for each in tilts]))
    figure = Figure(figsize=(7.4, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    reach = 1.1 * max(5.0, float(np.abs([felt, simulated]).max()))
    left.plot([-reach, reach], [-reach, reach], color=GRID, linewidth=1.2)
    for axis, (name, colour) in enumerate(zip(_AXES, _COLOURS, strict=True)):
        left.plot(simulated[:, axis], felt[:, axis], "o", color=colour, markersize=4.5, alpha=0.8, label=name)
        gaps = felt[:, axis] - simulated[:, axis]
        right.plot(np.arange(1, len(gaps) + 1), gaps, "o", color=colour, markersize=4.5, alpha=0.8)
    right.axhline(0, color=GRID, linewidth=1.2, zorder=0)
    widest = max(2.0, 1.2 * float(np.abs(felt - simulated).max()))
    right.set_ylim(-widest, widest)
    left.set_xlim(-reach, reach)
    left.set_ylim(-reach, reach)
    left.set_box_aspect(1)
    left.set_xlabel("tilt in simulation (°)")
    left.set_ylabel("tilt on the bench (°)")
    left.legend(loc="upper left", fontsize=8.5, handletextpad=0.2)
    right.set_xlabel("command of the self-discovery")
    right.set_ylabel("bench less simulation (°)")
    for axes in (left, right):
        axes.grid()
    return figure


@styled
def roll_figure(rolls: Sequence[Rolls]) -> Figure | None:
    """A column a teacher, a row a part: as seen in simulation (line) and on the bench (dots)."""
    if not rolls:
        return None
    rows = max(each.bench.shape[1] for each in rolls)
    figure = Figure(figsize=(7.4, 0.95 * rows + 0.75), layout="constrained")
    panels = np.reshape(figure.subplots(rows, len(rolls), sharex="col", squeeze=False), (rows, len(rolls)))
    for column, each in enumerate(rolls):
        panels[0, column].set_title(each.teacher, fontsize=9)
        for part in range(rows):
            axes = panels[part, column]
            if part < each.bench.shape[1]:
                _roll_panel(axes, each, part)
            else:
                axes.set_axis_off()
            if column == 0:
                axes.set_ylabel(f"{part_name(part)}\nroll (°)", fontsize=8.5)
        panels[-1, column].set_xlabel("s")
    return figure


def _roll_panel(axes: Axes, rolls: Rolls, part: int) -> None:
    times, seen = rolls.of_simulation
    line = np.degrees(np.unwrap(2 * seen[:, part]) / 2)
    shown = np.degrees(np.unwrap(2 * rolls.bench[:, part]) / 2)
    shown = shown + 180 * round((float(np.median(line)) - float(np.median(shown))) / 180)
    axes.plot(times + rolls.lag, line, color=INK, linewidth=1.1)
    axes.plot(rolls.times, shown, "o", color=OF_PART[part % len(OF_PART)], markersize=2.8)
    low, high = axes.get_ylim()
    wider = max(0.0, _NARROWEST - (high - low)) / 2
    axes.set_ylim(low - wider, high + wider)
    axes.grid(axis="y")


@styled
def path_figure(paths: Sequence[Paths]) -> Figure | None:
    """A row a trial: where the student went while it imitated, from above and over time."""
    if not paths:
        return None
    figure = Figure(figsize=(7.4, 2.4 * len(paths) + 0.3), layout="constrained")
    for (above, over_time), each in zip(figure.subplots(len(paths), 2, squeeze=False), paths, strict=True):
        lines = (
            (each.simulation, INK, (0, (1, 0)), "simulation"),
            (each.bench, BLUE, (0, (1, 0)), "bench"),
            (each.twin, MUTED, (0, (3, 1.5)), "simulation, commanded as the bench was"),
        )
        for line, colour, stroke, name in lines:
            place = 100 * line
            above.plot(place[:, 0], place[:, 1], color=colour, linestyle=stroke, label=name)
            above.plot(*place[-1], "o", color=colour, markersize=4)
            over_time.plot(each.step * np.arange(len(place)), place[:, 0], color=colour, linestyle=stroke)
        above.plot(0, 0, "+", color=INK, markersize=8)
        above.set_aspect("equal", adjustable="datalim")
        above.set_title(f"trial {each.trial}", fontsize=9)
        above.set_xlabel("along its own axis (cm)")
        above.set_ylabel("across (cm)")
        over_time.set_xlabel("s")
        over_time.set_ylabel("along (cm)")
        above.grid()
        over_time.grid()
    handles, names = above.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3, fontsize=8.5)
    return figure


@styled
def image_figure(images: Array | None) -> Figure | None:
    """The first pair of a teacher: in simulation above, on the bench below."""
    if images is None:
        return None
    figure = Figure(figsize=(7.4, 5.4), layout="constrained")
    panels = figure.subplots(2, 2)
    for row, (name, pair) in enumerate(zip(("simulation", "bench"), images, strict=True)):
        for column, side in enumerate(("left", "right")):
            axes = panels[row, column]
            axes.imshow(pair[column], cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            axes.set_xticks([])
            axes.set_yticks([])
            axes.spines[:].set_visible(True)
            if row == 0:
                axes.set_title(side, fontsize=9)
            if column == 0:
                axes.set_ylabel(name, fontsize=9)
    return figure
