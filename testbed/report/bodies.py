"""What the student believes its body to be, drawn beside the body that it has (the paper's Fig. 3)."""

from __future__ import annotations

import math
import string
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import MaxNLocator

from testbed.bodies.morphology import Morphology, Vector
from testbed.report.drawing import OBLIQUE, View, draw_body, extent, flat_on_ground, frame, tilted
from testbed.report.reading import Array, Trial
from testbed.report.style import GRID, INK, MUTED, name_row, styled
from testbed.student.body.self_model import BodyPrior, joined
from testbed.student.body.settling import Settler

_MOST_LINES = 2
_TALLEST = 6.4  # inches
_ABOVE = View(-90, 55)  # from above and from the front: shows how limbs are attached and that they lie flat


def stages(count: int) -> tuple[int, int, int]:
    """Start, middle and end of a history of this length."""
    return 0, (count - 1) // 2, count - 1


def tree_text(parents: Array, angles: Array) -> str:
    """On what the limbs hang, as people read it: the paper's genome for two limbs, "a on main 30°, ..." for others."""
    turned = [f"{math.degrees(angle) % 360:.0f}°" for angle in angles]
    if len(parents) == 2 and parents[0] == 0:
        return f"α {turned[0]}  λ {int(parents[1] == 0)}  β {turned[1]}"
    names = ["main", *string.ascii_lowercase]
    limbs = [
        f"{names[limb + 1]} on {names[int(parent)]} {angle}"
        for limb, (parent, angle) in enumerate(zip(parents, turned, strict=True))
    ]
    lines = [", ".join(limbs[start : start + 2]) for start in range(0, len(limbs), 2)]
    return "\n".join(lines) if len(lines) <= _MOST_LINES else f"{len(limbs)} limbs"


@dataclass(frozen=True)
class SelfModels:
    """How a self-model came about.

    Attributes:
        prior: The parts.
        parents: (i + 1, l) on what each limb hangs after each iteration or command, 0 the main body.
        angles: (i + 1, l) the mounting angles, rad.
        unit: What is counted: "t" for iterations, "commands" for commands.
    """

    prior: BodyPrior
    parents: Array
    angles: Array
    unit: str

    def body(self, index: int) -> Morphology:
        """The self-model at that time."""
        parents = tuple(int(parent) for parent in self.parents[index])
        return joined(self.prior, parents, self.angles[index])

    def text(self, index: int) -> str:
        """The same in words."""
        return tree_text(self.parents[index], self.angles[index])

    def when(self, index: int) -> str:
        """How far the search was."""
        return f"t = {index}" if self.unit == "t" else f"{index} {self.unit}"


def self_models(trial: Trial, student: Morphology) -> SelfModels | None:
    """How the student's self-model came about; None where the trial does not tell."""
    parents, angles = trial.array("self/parents"), trial.array("self/angles")
    if parents is None or angles is None:
        return None
    unit = "commands" if trial.array("self/believed_tilt") is None else "t"
    return SelfModels(BodyPrior.of(student), parents, angles, unit)


def draw_self_models(figure: FigureBase, trial: Trial, student: Morphology) -> None:
    """A row of drawings: the self-model at start, middle and end, then the true body."""
    models = self_models(trial, student)
    if models is None:
        return
    columns = [(models.when(t), models.text(t), models.body(t)) for t in stages(len(models.parents))]
    parents, angles = trial.array("self/truth_parents"), trial.array("self/truth_angles")
    caption = "" if parents is None or angles is None else tree_text(parents, angles)
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
    commands, tilt = trial.array("self/commands"), trial.array("self/tilt")
    models = self_models(trial, student)
    if models is None or commands is None or tilt is None or not len(commands):
        return None
    telling = np.sort(_telling(commands, tilt, shown))
    rows: list[tuple[str, Morphology, Vector]] = [("true body", student, tilt)]
    for name, t in zip(("start", "middle", "end"), stages(len(models.parents)), strict=True):
        rows.append(
            (f"believed,\n{name} ({models.when(t)})", models.body(t), believed_tilt(trial, models, t))
        )
    drawings = [
        [flat_on_ground(body), *(tilted(body, commands[j], tilts[j]) for j in telling)]
        for _, body, tilts in rows
    ]
    corners = [
        [extent(body, poses, OBLIQUE) for poses in line]
        for (_, body, _), line in zip(rows, drawings, strict=True)
    ]
    span = np.max([ends[1] - ends[0] for line in corners for ends in line], axis=0) / 2
    height = min(7.4 * 0.92 * len(rows) / 4.6 * span[1] / span[0] + 0.9, _TALLEST)
    figure = Figure(figsize=(7.4, height), layout="constrained")
    panels = figure.subplots(len(rows), 1 + len(telling))
    for line, (title, body, _), poses_of, ends_of in zip(panels, rows, drawings, corners, strict=True):
        for axes, poses, ends in zip(line, poses_of, ends_of, strict=True):
            draw_body(axes, body, poses, OBLIQUE)
            frame(axes, ends.mean(axis=0) + np.array([-span, span]))
        name_row(line[0], title)
    panels[0][0].set_title("flat", loc="center", fontsize=8.5, fontweight="normal", color=MUTED)
    for axes, j in zip(panels[0][1:], telling, strict=True):
        axes.set_title(
            _command_text(commands[j], int(j)), loc="center", fontsize=8.5, fontweight="normal", color=MUTED
        )
    return figure


def _command_text(command: Array, number: int) -> str:
    """A command above its picture, in as much detail as there is room for."""
    angles = ", ".join(f"{math.degrees(angle):.0f}°".replace("-", "\N{MINUS SIGN}") for angle in command)
    return (
        f"command ({angles})"
        if len(command) < 3
        else f"({angles})"
        if len(command) < 5
        else f"command {number + 1}"
    )


def believed_tilt(trial: Trial, models: SelfModels, index: int) -> Vector:
    """(n, 2) rad, how a self-model thinks that the commands tilted it: as recorded, or else as it would settle."""
    recorded, commands = trial.array("self/believed_tilt"), trial.array("self/commands")
    if recorded is not None:
        return np.asarray(recorded[index], dtype=float)
    assert commands is not None
    return Settler(models.body(index)).tilt(commands.astype(float))


@styled
def tilt_picture(trial: Trial, student: Morphology) -> Figure | None:
    """Observed against believed tilt after each command, at start, middle and end."""
    tilt, models = trial.array("self/tilt"), self_models(trial, student)
    if tilt is None or models is None or not len(tilt):
        return None
    moments = stages(len(models.parents))
    believed = [believed_tilt(trial, models, t) for t in moments]
    figure = Figure(figsize=(7.4, 3.0), layout="constrained")
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    span = 1.1 * float(np.degrees(max(np.abs(tilt).max(), np.abs(believed).max())))
    for axes, name, t, predicted in zip(panels, ("start", "middle", "end"), moments, believed, strict=True):
        axes.plot([-span, span], [-span, span], color=GRID, linewidth=1.2, zorder=1)
        for column, marker in ((1, "o"), (0, "s")):
            axes.plot(
                np.degrees(tilt[:, column]), np.degrees(predicted[:, column]), marker, markersize=5,
                color=INK, markerfacecolor=INK if column else "none", alpha=0.75, zorder=3,
            )  # fmt: skip
        axes.set_title(f"{name} ({models.when(t)})", fontsize=9)
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
