"""A robot in pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from testbed.bodies.morphology import Cuboid, Mesh, Morphology, Part, Vector
from testbed.report.drawing import OBLIQUE, SIDE, TOP, View, draw_body, extent, flat_on_ground, frame, tilted
from testbed.report.style import INK, MUTED, PAPER, stacked, styled, svg

_BAR = 0.10  # metres
_NAMED = 4
"""So many parts have room for their names in a picture; more are in the table alone."""


@styled
def robot_picture(morphology: Morphology, path: Path | str) -> Path:
    """Draw a robot: lying flat with the names of its parts and joints, in two postures, from above and from the side.

    Args:
        morphology: The robot.
        path: Where to; the ending says how (.png, .svg, .pdf).

    Returns:
        The path.
    """
    figure = Figure(figsize=(9.0, 5.2), layout="constrained", facecolor=PAPER)
    upper, lower = stacked(figure, 1.25, 1.0)
    large, *postures = upper.subplots(1, 3, width_ratios=[1.9, 1, 1])
    flat = flat_on_ground(morphology)
    draw_body(large, morphology, flat, OBLIQUE)
    if len(morphology.parts) <= _NAMED:
        _name_parts(large, morphology, flat, OBLIQUE)
    frame(large, extent(morphology, flat, OBLIQUE), 0.06)
    for axes, angles in zip(postures, _postures(morphology), strict=True):
        poses = tilted(morphology, angles, np.zeros(2))
        draw_body(axes, morphology, poses, OBLIQUE)
        corners = extent(morphology, flat, OBLIQUE)
        frame(axes, np.stack([corners[0], np.maximum(corners[1], extent(morphology, poses, OBLIQUE)[1])]))
        shown = ", ".join(f"{angle:+.0f}°" for angle in np.degrees(angles)).replace("-", "\N{MINUS SIGN}")
        title = f"joints at {shown}" if len(angles) <= _NAMED else f"{len(angles)} joints turned"
        axes.set_title(title if len(angles) else "no joints", loc="center", fontsize=9)
    views = (("from above", TOP), ("from the side", SIDE))
    for axes, (title, view) in zip(lower.subplots(1, 2), views, strict=True):
        draw_body(axes, morphology, flat, view)
        corners = extent(morphology, flat, view)
        _scale_bar(axes, corners)
        frame(axes, corners + np.array([[0, -0.05], [0, 0.02]]), 0.03)
        axes.set_title(title, loc="center", fontsize=9)
    figure.suptitle(
        f"{morphology.name}   {morphology.mass * 1000:.0f} g", x=0.01, ha="left", fontweight="bold"
    )
    target = Path(path)
    if target.suffix == ".svg":
        target.write_text(svg(figure, morphology.name), encoding="utf-8")
    else:
        figure.savefig(target, dpi=160)
    return target


def _postures(morphology: Morphology) -> tuple[Vector, Vector]:
    """Two postures within the joints' limits in which the main body lies flat: limbs raised, and raised and bent."""
    inner = np.array([joint.parent == morphology.root for joint in morphology.joints.values()], dtype=bool)
    low, high = morphology.limits.T
    return np.clip(np.full(len(inner), np.radians(-40.0)), low, high), np.clip(
        np.radians(np.where(inner, -70.0, 90.0)), low, high
    )


def _name_parts(axes: Axes, body: Morphology, poses: dict[str, Vector], view: View) -> None:
    """Part names above their parts with their sizes, joint names below their hinges."""
    bottom, top = extent(body, poses, view)[:, 1].tolist()
    for name, part in body.parts.items():
        place = view.flat(poses[name][None, :3, 3])[0]
        axes.annotate(
            f"{name}\n{_size(part)}", place, (place[0], top + 0.035), ha="center", va="bottom", fontsize=8.5,
            color=INK, arrowprops={"arrowstyle": "-", "color": MUTED, "linewidth": 0.7, "shrinkB": 2}, zorder=20,
        )  # fmt: skip
    for name, joint in body.joints.items():
        hinge = (poses[joint.parent] @ body.mount(joint))[None, :3, 3]
        place = view.flat(hinge)[0]
        axes.plot(*place, "o", markersize=4.5, markerfacecolor=PAPER, markeredgecolor=INK, zorder=21)
        axes.annotate(
            name, place, (place[0], bottom - 0.03), ha="center", va="top", fontsize=8.5, color=MUTED,
            arrowprops={"arrowstyle": "-", "color": MUTED, "linewidth": 0.7, "shrinkB": 4}, zorder=20,
        )  # fmt: skip


def _size(part: Part) -> str:
    if isinstance(part, Cuboid):
        return " × ".join(f"{side * 100:g}" for side in part.size) + " cm"
    if isinstance(part, Mesh):
        return " × ".join(f"{side * 100:.3g}" for side in part.size) + " cm"
    length = getattr(part, "length", None)
    radius = f"r {part.radius * 100:g}"
    return f"{radius} cm" if length is None else f"{radius}, h {length * 100:g} cm"


def _scale_bar(axes: Axes, corners: Vector) -> None:
    left, bottom = corners[0, 0], corners[0, 1] - 0.03
    axes.plot([left, left + _BAR], [bottom, bottom], color=INK, linewidth=2, solid_capstyle="butt")
    axes.annotate(
        "10 cm",
        (left + _BAR, bottom),
        (4, 0),
        textcoords="offset points",
        va="center",
        fontsize=8,
        color=MUTED,
    )
