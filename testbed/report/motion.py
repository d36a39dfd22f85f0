"""How the student tried to move like a teacher: rolls as curves and as poses (the paper's Fig. 5)."""

from __future__ import annotations

import math
import string

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import MultipleLocator

from testbed.bodies.morphology import Cuboid, Morphology
from testbed.report.bodies import self_models
from testbed.report.outlines import outline
from testbed.report.reading import Array, Trial
from testbed.report.style import GRID, INK, MUTED, OF_PART, name_row, styled
from testbed.student.moving.rolls import view_of

_INSTANTS = 5
_SHAPE = 1.6  # width of a pose's window by its height


@styled
def roll_picture(trial: Trial, teacher: str) -> Figure | None:
    """Rolls of the self-model's parts against those of the teacher's corresponding objects, at three stages."""
    target, responses, order, errors = (
        trial.array(f"{teacher}/{name}")
        for name in ("teacher_rolls", "self_rolls", "order", "controller_error")
    )
    if target is None or responses is None or order is None or errors is None:
        return None
    parts = responses.shape[2]
    figure = Figure(figsize=(7.4, 0.95 * parts + 0.75), layout="constrained")
    panels = np.atleast_2d(figure.subplots(parts, 3, sharex=True, sharey=True))
    samples = np.arange(len(target))
    moments = (0, len(errors) // 2, len(errors) - 1)
    for part, line in enumerate(panels):
        colour = OF_PART[part % len(OF_PART)]
        wanted = np.degrees(target[:, order[part]])
        for stage, axes in enumerate(line):
            moved = np.degrees(responses[stage, :, part])
            axes.fill_between(samples, wanted, moved, color=colour, alpha=0.22, linewidth=0, zorder=2)
            axes.plot(samples, wanted, color=INK, linewidth=1.1, zorder=4)
            axes.plot(samples, moved, color=colour, linewidth=1.6, zorder=3)
            axes.set_xlim(0, len(target) - 1)
            axes.grid(axis="y")
        line[0].set_ylabel(f"{part_name(part)}\nroll (°)", fontsize=8.5)
    furthest = max(100.0, 1.06 * float(np.degrees(max(np.abs(target).max(), np.abs(responses).max()))))
    panels[0, 0].set_ylim(-furthest, furthest)
    panels[0, 0].yaxis.set_major_locator(MultipleLocator(90 if furthest < 200 else 180))
    for axes, name, moment in zip(panels[0], ("start", "middle", "end"), moments, strict=True):
        axes.set_title(f"{name} (t = {moment}), Eq. 5: {errors[moment]:.1f}", fontsize=8.8)
    for axes in panels[-1]:
        axes.set_xlabel("time step")
    return figure


@styled
def pose_picture(trial: Trial, teacher: str, student: Morphology) -> Figure | None:
    """The teacher as the student imagines it, and below it the self-model under three controllers."""
    names = ("model_history", "self_rolls", "order")
    history, responses, order = (trial.array(f"{teacher}/{name}") for name in names)
    beliefs = self_models(trial, student)
    if history is None or responses is None or order is None or beliefs is None:
        return None
    body = beliefs.body(-1)
    samples = responses.shape[1]
    instants = np.linspace(samples / 12, samples - 1, _INSTANTS).astype(int)
    figure = Figure(figsize=(7.4, 3.3), layout="constrained")
    panels = figure.subplots(4, _INSTANTS)
    colours = [""] * history.shape[1]
    for part, chosen in enumerate(order):
        colours[chosen] = OF_PART[part % len(OF_PART)]
    truth = trial.array(f"{teacher}/truth_parts")
    models = [history[int((i + 1) * (len(history) - 1) / samples)] for i in instants]
    rows = [("teacher,\nas imagined", models, [colour or MUTED for colour in colours])]
    for stage, name in enumerate(("start", "middle", "end")):
        poses = [sticks(body, responses[stage, i]) for i in instants]
        rows.append((f"self,\n{name}", poses, list(OF_PART)))
    window = _window(truth.reshape(-1, truth.shape[-1]) if truth is not None else np.concatenate(models))
    for number, (line, (title, poses, shades)) in enumerate(zip(panels, rows, strict=True)):
        for axes, parts in zip(line, poses, strict=True):
            # The teacher stays where the student sees it; the self-model is centred.
            place = _window(np.concatenate(poses)) if number else window
            _draw_parts(axes, parts, shades, place)
        name_row(line[0], title)
    for axes, instant in zip(panels[0], instants, strict=True):
        axes.set_title(f"step {instant}", loc="center", fontsize=8.5, fontweight="normal", color=MUTED)
    return figure


def sticks(body: Morphology, rolls: Array) -> Array:
    """(k, 8) parts in the image plane that have these rolls (rad) and hang together as the body's do."""
    _, places = view_of(body)
    names = list(body.parts)
    ends: dict[str, Array] = {}
    rows: dict[str, list[float]] = {}
    parent_of = {joint.child: joint.parent for joint in body.joints.values()}
    for name in names:  # parents come before their children in a self-model
        part, index = body.parts[name], names.index(name)
        along = np.array([math.cos(rolls[index]), math.sin(rolls[index])])
        length = part.length_along_x
        if name in parent_of:
            parent = parent_of[name]
            gap = places[index, 0] - places[names.index(parent), 0]
            side = -1.0 if gap < -1e-6 else 1.0
            root = ends[parent] if parent != body.root else _edge(rows[parent], side)
            centre, ends[name] = root + side * along * length / 2, root + side * along * length
        else:
            centre = np.zeros(2)
        size = (*part.size,) if isinstance(part, Cuboid) else (part.radius, getattr(part, "length", 0.0), 0.0)
        shape = 0.0 if isinstance(part, Cuboid) else 2.0
        rows[name] = [shape, float(centre[0]), float(centre[1]), 1.0, float(rolls[index]), *size]
    return np.array([rows[name] for name in names])


def _edge(row: list[float], side: float) -> Array:
    """Where a limb meets the main body on one of its sides."""
    half = row[5] / 2 if row[0] == 0 else 0.0
    return np.array([row[1] + side * half * math.cos(row[4]), row[2] + side * half * math.sin(row[4])])


def _draw_parts(axes: Axes, parts: Array, colours: list[str], window: Array) -> None:
    for index, part in enumerate(parts):
        axes.add_patch(
            Polygon(
                _seen(part),
                closed=True,
                facecolor=colours[index],
                edgecolor=INK,
                linewidth=0.5,
                zorder=2 + index,
            )
        )
    axes.set_xlim(window[0, 0], window[1, 0])
    axes.set_ylim(window[1, 1], window[0, 1])
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(True)
        spine.set_color(GRID)


def _seen(part: Array) -> Array:
    """(n, 2) a part's outline as directions, so that what is far away looks small."""
    points = outline(part)
    return np.asarray(points[:, :2] / np.maximum(points[:, 2:], 0.05))


def _window(parts: Array) -> Array:
    """(2, 2): corners of the smallest window of fixed shape with all the parts in it."""
    points = np.concatenate([_seen(part) for part in parts])
    low, high = points.min(axis=0), points.max(axis=0)
    half = max(*(high - low) / 2 / [1.0, 1 / _SHAPE]) * 1.12
    return np.asarray((low + high) / 2 + np.array([[-half, -half / _SHAPE], [half, half / _SHAPE]]))


def part_name(part: int) -> str:
    """What the pictures call a part of the student, in the order of its motors."""
    return f"limb {string.ascii_lowercase[part - 1]}" if part else "main body"
