"""How far students come with what they learnt, over many trials: a table, and student against teacher."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from testbed.experiment.statistics import bootstrap_median
from testbed.report import html
from testbed.report.comparison import figure_with, share
from testbed.report.desk import Desk
from testbed.report.reading import Row
from testbed.report.style import BLUE, GRID, INK, LIMB_A, LIMB_B, LIMB_C, LIMB_D, MUTED, ORANGE, styled

TRAVELS = 0.02
"""A teacher that comes less far than this (m) with each stroke of its gait goes nowhere: it is not counted."""
_COLOURS = (INK, ORANGE, LIMB_A, LIMB_B, LIMB_C, LIMB_D, BLUE)
_SEED = 0


def travelled(desk: Desk, cell: str) -> list[Row]:
    """The rows of a cell in which the student imitated a teacher that travels, and came to a ratio."""
    return [
        row for row in imitated(desk, cell) if row.get("distance_ratio") is not None and travels(desk, row)
    ]


def imitated(desk: Desk, cell: str) -> list[Row]:
    """The rows of a cell in which the student imitated a teacher."""
    return [row for row in desk.run.verdicts(cell=cell, student=desk.mind) if row["chosen"]]


def travels(desk: Desk, row: Row) -> bool:
    """Whether the imitated teacher came on by :data:`TRAVELS` with each stroke while it was watched."""
    forward, seconds = row.get("teacher_forward"), row.get("watched_seconds")
    trial = next(
        (trial for trial in desk.run.of_cell(str(row["cell"])) if trial.number == row["trial"]), None
    )
    if forward is None or not seconds or trial is None:
        return False
    gait = desk.concrete(trial).teachers[int(str(row["teacher"]).rpartition("_")[2])].gait
    return abs(float(forward)) / float(seconds) * float(gait.period) >= TRAVELS


def travel_table(desk: Desk) -> str:
    """A line a cell: how often the student went the teacher's way, and how far compared with it."""
    body = []
    for cell in desk.run.cells:
        verdicts, copied = desk.run.verdicts(cell=cell, student=desk.mind), imitated(desk, cell)
        if not verdicts:
            continue
        trials, rows = len({row["trial"] for row in verdicts}), travelled(desk, cell)
        ratios = [float(row["distance_ratio"]) for row in rows]
        body.append(
            [
                html.text(cell),
                f"{len(copied)} of {trials}",
                str(len(rows)),
                share([ratio > 0 for ratio in ratios]),
                _median(ratios),
            ]
        )
    header = ["cell", "imitated", "teacher travels", "went its way", "median of its distance"]
    return html.table(header, body, css="figures")


@styled
def travel_figure(desk: Desk) -> Figure | None:
    """How far the student came per second against its teacher, in the student's measure: a dot a trial."""
    cells = {cell: rows for cell in desk.run.cells if (rows := travelled(desk, cell))}
    if sum(map(len, cells.values())) < 2:
        return None
    points = {cell: np.array([speeds(row) for row in rows]) * 100 for cell, rows in cells.items()}
    figure = Figure(figsize=(7.4, 3.9), layout="constrained")
    axes = figure.subplots()
    everything = np.concatenate(list(points.values()))
    low, high = min(0.0, float(everything.min()) * 1.1), float(everything.max()) * 1.1
    axes.plot([low, high], [low, high], color=GRID, linewidth=1.4)
    axes.annotate("as far as the teacher", (high, high), ha="right", va="bottom", fontsize=8, color=MUTED)
    axes.axhline(0, color=MUTED, linewidth=0.6)
    for number, (cell, values) in enumerate(points.items()):
        colour = _COLOURS[number % len(_COLOURS)]
        axes.plot(*values.T, "o", markersize=4.5, color=colour, alpha=0.75, label=cell, markeredgewidth=0)
    if len(points) > 1:
        axes.legend(fontsize=8.5, loc="upper left", handletextpad=0.2)
    axes.set_xlabel("teacher, in the student's size (cm/s)")
    axes.set_ylabel("student (cm/s)")
    axes.grid()
    return figure


def speeds(row: Row) -> tuple[float, float]:
    """How fast the teacher and the student came along, m/s, the teacher scaled to the student's size.

    Both in the teacher's direction: what the student does the other way is negative.
    """
    student = float(row["path_forward"]) / float(row["performed_seconds"])
    ratio = float(row["distance_ratio"])
    teacher = abs(student / ratio) if ratio else 0.0
    return teacher, math.copysign(abs(student), ratio)


def _median(ratios: Sequence[float]) -> str:
    if not ratios:
        return html.number(None)
    interval = bootstrap_median(ratios, np.random.default_rng(_SEED)) if len(ratios) > 1 else None
    return figure_with(float(np.median(ratios)), interval)
