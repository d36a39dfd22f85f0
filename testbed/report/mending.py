"""What students made of damage to their bodies: when they noticed it, and after they had modelled themselves anew."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from testbed.report import html
from testbed.report.comparison import share
from testbed.report.knowing import SOON
from testbed.report.reading import Array, Row, RunRecord, chosen_rows
from testbed.report.style import INK, MUTED, styled

_MEASURES = (
    ("left_angle_error_deg", "largest angle error of the limbs left (°)"),
    ("locked_error_deg", "error of the angle where a joint is stuck (°)"),
)
_FLOOR = 0.05  # degrees; the figure's scale is logarithmic
_FIRST = "_first"


def damaged(run: RunRecord) -> list[Row]:
    """Of every body that broke, what the leader made of it."""
    leader = run.students[0] if run.students else None
    return [row for row in chosen_rows(run.selves, student=leader) if row.get("damage")] if leader else []


def damage_table(run: RunRecord) -> str:
    """A line a cell in which bodies broke; empty if none did, or nobody looked.

    What is known of the limbs left is compared where damage was noticed and they hang as the student says.
    """
    lines = []
    for cell in run.cells:
        rows = [row for row in damaged(run) if row["cell"] == cell]
        if not any(row.get("left_topology_right") is not None for row in rows):
            continue
        noticed = [row.get("damage_noticed_after") is not None for row in rows]
        soon = [seen and row["damage_noticed_after"] <= SOON for seen, row in zip(noticed, rows, strict=True)]
        figures = [
            share(soon),
            _flags(rows, f"damage_named_right{_FIRST}"),
            _flags(rows, "damage_named_right"),
        ]
        figures += [_flags(rows, "left_topology_right"), *(_pair(rows, column) for column, _ in _MEASURES)]
        lines.append([html.text(cell), str(len(rows)), *figures, _flags(rows, "alarm_withdrawn")])
    return html.table(_TITLES, lines, css="figures") if lines else ""


_TITLES = (
    "cell",
    "bodies that broke",
    f"noticed within {SOON} commands",
    "right limb named when noticed",
    "right limb named in the end",
    "limbs left hang as it says",
    "angle error of limbs left, when noticed → anew",
    "error of the stuck angle, when noticed → anew",
    "true alarm withdrawn",
)


@styled
def damage_figure(run: RunRecord) -> Figure | None:
    """How many bodies are known how exactly: grey when damage was noticed, black after further commands."""
    rows = damaged(run)
    drawn = [(column, title) for column, title in _MEASURES if len(_both(rows, column)) > 1]
    if not drawn:
        return None
    figure = Figure(figsize=(3.7 * len(drawn), 2.5), layout="constrained")
    panels = np.reshape(figure.subplots(1, len(drawn), sharey=True), -1)
    for axes, (column, title) in zip(panels, drawn, strict=True):
        errors = np.maximum(np.sort(_both(rows, column), axis=0), _FLOOR)
        part = np.arange(1, len(errors) + 1) / len(errors)
        for which, (colour, name) in enumerate(((MUTED, "when noticed"), (INK, "modelled anew"))):
            axes.step(errors[:, which], part, where="post", color=colour, label=name)
        axes.set_xscale("log")
        axes.set_xlim(_FLOOR, 180)
        axes.set_xticks([0.1, 1, 10, 100], ["0.1", "1", "10", "100"])
        axes.set_xticks([], minor=True)
        axes.set_ylim(0, 1.02)
        axes.set_xlabel(title)
        axes.annotate(
            f"N = {len(errors)}", (1, 1.01), xycoords="axes fraction", ha="right", fontsize=8, color=MUTED
        )
        axes.grid(axis="both")
    panels[0].set_ylabel("share of bodies within")
    panels[0].legend(loc="upper left", frameon=False)
    return figure


def _flags(rows: Sequence[Row], column: str) -> str:
    return share([bool(row[column]) for row in rows if row.get(column) is not None])


def _both(rows: Sequence[Row], column: str) -> Array:
    """(n, 2) errors when noticed and anew, of bodies of which both are known."""
    pairs = [(row.get(column + _FIRST), row.get(column)) for row in rows]
    return np.array([pair for pair in pairs if None not in pair], dtype=float).reshape(-1, 2)


def _pair(rows: Sequence[Row], column: str) -> str:
    errors = _both(rows, column)
    if not len(errors):
        return html.number(None)
    (first, anew), (worst_first, worst) = np.quantile(errors, [0.5, 0.95], axis=0)
    return (
        f"{first:.1f}° → {anew:.1f}°<br><small>95th percentile {worst_first:.1f}° → {worst:.1f}°, "
        f"N = {len(errors)}</small>"
    )
