"""Pictures of students of several runs against each other."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbed.experiment.paired import Paired
from testbed.experiment.rivals import SAME, Contest
from testbed.report.style import BLUE, GRID, INK, MUTED, OF_TRUTH, ORANGE, styled

_ROW = 0.34  # inches a line
MOST_LINES = 60
"""What does not fit is in the table."""


@styled
def difference_figure(contests: Sequence[Contest], reference: str) -> Figure | None:
    """Every contest's differences of accuracy and AUC from the reference, with their intervals.

    Args:
        contests: A line each, from the top.
        reference: What the student is called that they are held against.
    """
    shown = contests[:MOST_LINES]
    if not shown:
        return None
    figure = Figure(figsize=(7.4, 1.15 + _ROW * len(shown)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for axes, title, figures in (
        (left, "right verdicts", [(each.accuracy, each.adjusted[0]) for each in shown]),
        (right, "AUC", [(each.auc, each.adjusted[1]) for each in shown]),
    ):
        axes.axvspan(-SAME, SAME, color=GRID, linewidth=0, alpha=0.7)
        axes.axvline(0, color=MUTED, linewidth=0.8)
        for line, (paired, p_value) in enumerate(figures):
            if paired is not None:
                _whisker(axes, line, paired, p_value)
        axes.set_title(title, fontsize=9)
        axes.set_xlabel(f"less than {reference}  |  more than {reference}", fontsize=8.5)
        axes.grid(axis="x")
        reach = max(0.05, *(abs(end) for end in axes.get_xlim()))
        axes.set_xlim(-reach, reach)
    left.set_yticks(range(len(shown)), [_name(each) for each in shown])
    left.set_ylim(len(shown) - 0.5, -0.5)
    return figure


def _whisker(axes: Axes, line: int, paired: Paired, p_value: float | None) -> None:
    colour = INK
    if p_value is not None and p_value < 0.05:
        colour = BLUE if paired.difference > 0 else ORANGE
    if paired.interval is not None:
        axes.plot(paired.interval, [line, line], color=colour, linewidth=1.6, solid_capstyle="butt")
    axes.plot(paired.difference, line, "o", color=colour, markersize=5, zorder=4)


def _name(contest: Contest) -> str:
    return contest.rival.label if contest.cell is None else f"{contest.rival.label}, {contest.cell}"


@styled
def robot_figure(contest: Contest, reference: str) -> Figure | None:
    """How many of each kind of robot two students are right about, a line a robot."""
    pairs = list(zip(contest.match.first, contest.match.second, strict=True))
    kinds = sorted({(row["truth"], row["robot"]) for row, _ in pairs})
    if len(kinds) < 2:
        return None
    figure = Figure(figsize=(7.4, 0.95 + _ROW * len(kinds)), layout="constrained")
    axes = figure.subplots()
    labels = []
    for line, kind in enumerate(kinds):
        own = [pair for pair in pairs if (pair[0]["truth"], pair[0]["robot"]) == kind]
        shares = [
            sum(row["verdict"] == row["truth"] for row in rows) / len(own) for rows in zip(*own, strict=True)
        ]
        axes.plot(shares, [line, line], color=GRID, linewidth=3, zorder=2)
        axes.plot(shares[0], line, "o", color=MUTED, markersize=8, markerfacecolor="none", zorder=3)
        axes.plot(shares[1], line, "o", color=OF_TRUTH[kind[0]], markersize=5, zorder=4)
        labels.append(f"{kind[1]}  ({len(own)})")
    axes.set_yticks(range(len(kinds)), labels)
    axes.set_ylim(len(kinds) - 0.5, -0.5)
    axes.set_xlim(-0.03, 1.03)
    axes.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "25%", "50%", "75%", "100%"])
    axes.set_xlabel(f"right verdicts: open {reference}, filled {contest.rival.label}", fontsize=8.5)
    axes.grid(axis="x")
    return figure
