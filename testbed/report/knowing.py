"""What students found out about their own bodies, over many trials: tables, and errors over the commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from testbed.experiment.statistics import wilson
from testbed.report import html
from testbed.report.comparison import share
from testbed.report.reading import Array, Row, RunRecord, Trial, chosen_rows
from testbed.report.style import INK, MUTED, styled
from testbed.scenario import in_cell

SOON = 3
"""Damage that is noticed within so many commands is noticed in time."""
_WRONG = 180.0
"""Degrees that a model whose limbs hang on the wrong parts is off by in the figure."""
_FLOOR = 0.05  # degrees; the figure's scale is logarithmic
Values = Callable[[Sequence[Row]], str]


def self_table(run: RunRecord) -> str:
    """A line a cell and student: was it right about how its limbs hang, by how much, and about what it knows?"""
    columns = [entry for entry in _COLUMNS if any(row.get(entry[1]) is not None for row in run.selves)]
    listed = {cell: _discoverers(run, cell) for cell in run.cells}
    several = len({student for students in listed.values() for student in students}) > 1
    body = []
    for cell, students in listed.items():
        for student in students:
            rows = chosen_rows(run.selves, cell=cell, student=student)
            if rows:
                names = [html.text(cell), *([html.text(student)] if several else [])]
                body.append([*names, str(len(rows)), *(values(rows) for _, _, values in columns)])
    header = ["cell", *(["student"] if several else []), "trials", *(title for title, _, _ in columns)]
    return html.table(header, body, css="figures")


def _discoverers(run: RunRecord, cell: str) -> list[str]:
    """The students of a cell that discover themselves each in its own way: what is alike is discovered once."""
    methods = {mind.name: mind.phases.self_discovery for mind in in_cell(run.scenario, cell).minds}
    found: dict[str, str] = {}
    for student in run.students:
        if chosen_rows(run.selves, cell=cell, student=student):
            found.setdefault(methods.get(student, student), student)
    return list(found.values())


def self_headline(rows: Sequence[Row], cell: str | None = None) -> str:
    """What came out, in one sentence, for a run in which nobody was watched; of this cell, where there are several."""
    right = [bool(row["topology_right"]) for row in rows]
    if len(right) == 1:
        return f"The student found out {'rightly' if right[0] else 'wrongly'} how its limbs are joined."
    low, high = wilson(sum(right), len(right))
    where = "" if cell is None else f" of the cell {cell}"
    return (
        f"In {sum(right)} of {len(right)} trials{where} the student found out how its limbs are joined "
        f"(95% interval {low:.0%} to {high:.0%})."
    )


@styled
def angle_figure(run: RunRecord, student: str, cells: Sequence[str]) -> Figure | None:
    """The largest error of a mounting angle over the commands: a panel a cell, median and the middle 90%."""
    curves = {
        cell: curve
        for cell in cells
        if (curve := angle_errors([trial.of(student) for trial in run.of_cell(cell)])) is not None
    }
    if not curves:
        return None
    columns = min(3, len(curves))
    lines = -(-len(curves) // columns)
    figure = Figure(figsize=(7.4, 2.2 * lines + 0.3), layout="constrained")
    panels = np.reshape(figure.subplots(lines, columns, sharey=True), -1)
    for axes, (cell, errors) in zip(panels, curves.items(), strict=False):
        _draw_errors(axes, errors)
        axes.set_title(cell, fontsize=9)
        axes.annotate(
            f"N = {len(errors)}", (1, 1.01), xycoords="axes fraction", ha="right", fontsize=8, color=MUTED
        )
    for axes in panels[len(curves) :]:
        axes.set_axis_off()
    for axes in panels[::columns]:
        axes.set_ylabel("angle error (°)")
    for axes in panels[len(curves) - columns : len(curves)]:
        axes.set_xlabel("commands" if _by_commands(run, student, cells) else "iterations")
    return figure


def angle_errors(trials: Sequence[Trial]) -> Array | None:
    """(trials, steps) degrees, the largest error of a mounting angle; 180 while a limb hangs on a wrong part.

    Trials of which the search ended earlier keep their last error.
    """
    found = []
    for trial in trials:
        names = ("parents", "angles", "truth_parents", "truth_angles")
        arrays = [trial.array(f"self/{name}") for name in names]
        if any(array is None or not len(array) for array in arrays):
            continue
        parents, angles, true_parents, true_angles = (np.asarray(array) for array in arrays)
        gaps = np.degrees(np.abs((angles - true_angles + np.pi) % (2 * np.pi) - np.pi)).max(axis=1)
        found.append(np.where(np.all(parents == true_parents, axis=1), gaps, _WRONG))
    if not found:
        return None
    steps = max(len(errors) for errors in found)
    return np.array([np.pad(errors, (0, steps - len(errors)), mode="edge") for errors in found])


def _draw_errors(axes: Axes, errors: Array) -> None:
    steps = np.arange(errors.shape[1])
    shown = np.maximum(errors, _FLOOR)
    low, median, high = (np.quantile(shown, share, axis=0, method="nearest") for share in (0.05, 0.5, 0.95))
    if len(errors) > 1:
        axes.fill_between(steps, low, high, color=INK, alpha=0.14, linewidth=0)
    axes.plot(steps, median, color=INK)
    axes.set_yscale("log")
    axes.set_ylim(_FLOOR, 1.25 * _WRONG)
    axes.set_yticks([0.1, 1, 10, 180], ["0.1", "1", "10", "wrong"])
    axes.set_yticks([], minor=True)
    axes.set_xlim(0, max(len(steps) - 1, 1))
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    axes.grid(axis="y")


def _by_commands(run: RunRecord, student: str, cells: Sequence[str]) -> bool:
    trials = [trial.of(student) for cell in cells for trial in run.of_cell(cell)[:1]]
    return all(trial.array("self/believed_tilt") is None for trial in trials)


def _flags(column: str) -> Values:
    return lambda rows: share([bool(row[column]) for row in rows if row.get(column) is not None])


def _angles(rows: Sequence[Row]) -> str:
    """Median and 95th percentile; of bodies whose angles can be told where it is known which these are."""
    errors = [
        float(row["angle_error_deg"])
        for row in rows
        if row.get("angle_error_deg") is not None and row.get("identifiable") is not False
    ]
    if not errors:
        return html.number(None)
    median, high = np.quantile(errors, [0.5, 0.95])
    return f"{median:.1f}°, {high:.1f}°<br><small>N = {len(errors)}</small>"


def _spent(rows: Sequence[Row]) -> str:
    """How many commands and how many evaluations of self-models it took, on average."""
    means = [
        float(np.mean(values))
        for column in ("commands", "evaluations")
        if (values := [float(row[column]) for row in rows if row.get(column) is not None])
    ]
    return ", ".join(f"{mean:,.0f}" for mean in means)


def _damaged(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row.get("damage")]


def _noticed(rows: Sequence[Row]) -> str:
    return share([_within(row.get("damage_noticed_after")) for row in _damaged(rows)])


def _named(rows: Sequence[Row]) -> str:
    return share([bool(row.get("damage_named_right")) for row in _damaged(rows)])


def _alarmed(rows: Sequence[Row]) -> str:
    return share([bool(row.get("damage_found")) for row in rows if not row.get("damage")])


def _within(after: Any) -> bool:
    return after is not None and float(after) <= SOON


_COLUMNS: tuple[tuple[str, str, Values], ...] = (
    ("limbs hang as it says", "topology_right", _flags("topology_right")),
    ("angles can be told", "identifiable", _flags("identifiable")),
    ("angle error: median, 95%", "angle_error_deg", _angles),
    ("posterior holds the truth", "posterior_holds_truth", _flags("posterior_holds_truth")),
    (f"damage noticed within {SOON} commands", "damage", _noticed),
    ("right limb named", "damage_named_right", _named),
    ("false alarms", "damage_found", _alarmed),
    ("commands, evaluations", "commands", _spent),
)
