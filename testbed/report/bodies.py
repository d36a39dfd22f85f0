"""What the student believes its body to be, drawn beside the body that it has (the paper's Fig. 3)."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import MaxNLocator

from testbed.morphology import Morphology, Vector
from testbed.report.drawing import OBLIQUE, View, draw_body, extent, flat_on_ground, frame, tilted
from testbed.report.reading import Array, Trial
from testbed.report.style import GRID, INK, MUTED, name_row, styled
from testbed.student.self_model import BodyPrior, self_model

_ABOVE = View(-90, 55)  # from above and from the front: shows how limbs are attached and that they lie flat


def stages(count: int) -> tuple[int, int, int]:
    """Start, middle and end of a history of this length."""
    return 0, (count - 1) // 2, count - 1


def genome_text(genome: Array) -> str:
    """A genome as people read it."""
    alpha, branch, beta = genome
    return f"α {math.degrees(alpha) % 360:.0f}°  λ {branch:.0f}  β {math.degrees(beta) % 360:.0f}°"


def draw_self_models(figure: FigureBase, trial: Trial, student: Morphology) -> None:
    """A row of drawings: the self-model at start, middle and end, then the true body."""
    genomes = trial.array("self/genome")
    if genomes is None:
        return
    prior = BodyPrior.of(student)
    columns = [
        (f"t = {t}", genome_text(genomes[t]), self_model(prior, genomes[t])) for t in stages(len(genomes))
    ]
    truth = trial.array("self/truth_genome")
    caption = "" if truth is None else genome_text(truth)
    columns.append(("true body", caption, student))
    panels = figure.subplots(1, len(columns))
    drawings = [(body, flat_on_ground(body)) for _, _, body in columns]
    corners = [extent(body, poses, _ABOVE) for body, poses in drawings]
    span = np.max([ends[1] - ends[0] for ends in corners], axis=0) / 2
    for axes, (title, caption, _), (body, poses), ends in zip(
        panels, columns, drawings, corners, strict=True
    ):
        draw_body(axes, body, poses, _ABOVE)
        frame(axes, ends.mean(axis=0) + np.array([-span, span]))
        axes.set_title(title, loc="center", fontsize=9, pad=2)
        axes.annotate(
            caption, (0.5, -0.02), xycoords="axes fraction", ha="center", va="top", fontsize=7.8, color=MUTED
        )


@styled
def self_discovery_picture(trial: Trial, student: Morphology, shown: int = 3) -> Figure | None:
    """As the paper's Fig. 3: what the body did with some commands, and what three self-models would have done."""
    names = ("genome", "commands", "tilt", "believed_tilt")
    genomes, commands, tilt, believed = (trial.array(f"self/{name}") for name in names)
    if genomes is None or commands is None or tilt is None or believed is None:
        return None
    prior = BodyPrior.of(student)
    telling = np.sort(_telling(commands, tilt, shown))
    rows: list[tuple[str, Morphology, Vector]] = [("true body", student, tilt)]
    for name, t in zip(("start", "middle", "end"), stages(len(genomes)), strict=True):
        rows.append((f"believed,\n{name} (t = {t})", self_model(prior, genomes[t]), believed[t]))
    drawings = [
        [flat_on_ground(body), *(tilted(body, commands[j], tilts[j]) for j in telling)]
        for _, body, tilts in rows
    ]
    corners = [
        [extent(body, poses, OBLIQUE) for poses in line]
        for (_, body, _), line in zip(rows, drawings, strict=True)
    ]
    span = np.max([ends[1] - ends[0] for line in corners for ends in line], axis=0) / 2
    figure = Figure(
        figsize=(7.4, 7.4 * 0.92 * len(rows) / 4.6 * span[1] / span[0] + 0.9), layout="constrained"
    )
    panels = figure.subplots(len(rows), 1 + len(telling))
    for line, (title, body, _), poses_of, ends_of in zip(panels, rows, drawings, corners, strict=True):
        for axes, poses, ends in zip(line, poses_of, ends_of, strict=True):
            draw_body(axes, body, poses, OBLIQUE)
            frame(axes, ends.mean(axis=0) + np.array([-span, span]))
        name_row(line[0], title)
    panels[0][0].set_title("flat", loc="center", fontsize=8.5, fontweight="normal", color=MUTED)
    for axes, j in zip(panels[0][1:], telling, strict=True):
        angles = ", ".join(
            f"{math.degrees(angle):.0f}°".replace("-", "\N{MINUS SIGN}") for angle in commands[j]
        )
        axes.set_title(f"command ({angles})", loc="center", fontsize=8.5, fontweight="normal", color=MUTED)
    return figure


@styled
def tilt_picture(trial: Trial) -> Figure | None:
    """Observed against believed tilt after each command, at start, middle and end."""
    tilt, believed = trial.array("self/tilt"), trial.array("self/believed_tilt")
    if tilt is None or believed is None:
        return None
    figure = Figure(figsize=(7.4, 3.0), layout="constrained")
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    span = 1.1 * float(
        np.degrees(max(np.abs(tilt).max(), np.abs(believed[list(stages(len(believed)))]).max()))
    )
    for axes, name, t in zip(panels, ("start", "middle", "end"), stages(len(believed)), strict=True):
        axes.plot([-span, span], [-span, span], color=GRID, linewidth=1.2, zorder=1)
        for column, marker in ((1, "o"), (0, "s")):
            axes.plot(
                np.degrees(tilt[:, column]), np.degrees(believed[t, :, column]), marker, markersize=5,
                color=INK, markerfacecolor=INK if column else "none", alpha=0.75, zorder=3,
            )  # fmt: skip
        axes.set_title(f"{name} (t = {t})", fontsize=9)
        axes.set_xlabel("observed tilt (°)")
        axes.set_box_aspect(1)
        axes.set_xlim(-span, span)
        axes.set_ylim(-span, span)
        axes.xaxis.set_major_locator(MaxNLocator(5))
        axes.yaxis.set_major_locator(MaxNLocator(5))
    panels[0].set_ylabel("believed tilt (°)")
    return figure


def _telling(commands: Array, tilt: Array, count: int) -> Array:
    """Indices of the commands after which the body tilted most, different from each other."""
    order = np.argsort(-np.abs(tilt).sum(axis=1), kind="stable")
    return np.asarray(order[: min(count, len(commands))])
