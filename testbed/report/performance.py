"""How far the student came while it imitated, beside its teacher (the paper's Fig. 9)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from testbed.report.reading import Array, Row, Trial
from testbed.report.style import INK, MUTED, OF_TRUTH, PAPER, styled


@styled
def path_figure(trial: Trial) -> Figure | None:
    """How far the main bodies of the student and of the teacher it imitates moved, over time."""
    row = chosen(trial)
    path, step = trial.array("perform/path"), trial.array("time/control_step")
    if row is None or path is None or step is None or len(path) < 2:
        return None
    figure = Figure(figsize=(7.4, 2.5), layout="constrained")
    axes = figure.subplots()
    curves = [("student, imitating", path, INK)]
    looks, base = trial.array(f"{row['teacher']}/look_steps"), trial.array(f"truth/{row['teacher']}/base")
    if looks is not None and base is not None:
        first, last = int(looks[0]) - 1, int(looks[-1]) - 1
        curves.append((f"{row['teacher']}, watched", base[first : last + 1, :3], OF_TRUTH[row["truth"]]))
    for name, places, colour in curves:
        moved = _distance(places) * 100
        seconds = np.arange(len(moved)) * float(step)
        axes.plot(seconds, moved, color=colour)
        axes.annotate(
            name, (seconds[-1], moved[-1]), (5, 0), textcoords="offset points", va="center", fontsize=9,
            color=colour, fontweight="bold", zorder=9,
            bbox={"facecolor": PAPER, "edgecolor": "none", "alpha": 0.85, "pad": 1.5},
        )  # fmt: skip
    axes.axhline(0, color=MUTED, linewidth=0.6)
    axes.set_xlim(0, max(len(places) - 1 for _, places, _ in curves) * float(step) * 1.28)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("distance from start (cm)")
    axes.grid(axis="y")
    return figure


def chosen(trial: Trial) -> Row | None:
    """The row of the teacher that the student imitated."""
    return next((row for row in trial.rows if row["chosen"]), None)


def _distance(places: Array) -> Array:
    """(steps,) how far the body is from where it began, on the ground, m."""
    return np.asarray(np.linalg.norm((places - places[0])[:, :2], axis=1))
