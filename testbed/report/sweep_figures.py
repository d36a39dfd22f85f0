"""Pictures of sweeps: a tile a condition where two axes cross, a point a condition along a single axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from testbed.experiment.conditions import MEASURES, Condition, Measured
from testbed.report.style import BLUE, GRID, INK, MUTED, ORANGE, styled
from testbed.scenario.points import Block
from testbed.scenario.sweep import Axis, Level, level_name

_WIDE = 7.4
_DARK, _LIGHT = "#14181d", "#ffffff"  # text on tiles, whose colours do not follow the page's theme
_GOODNESS = LinearSegmentedColormap.from_list("goodness", ["#f3b27a", "#f4f1ea", "#8cc0e6", "#1668ad"])
_LOSS = LinearSegmentedColormap.from_list("loss", ["#c9540a", "#f3b27a", "#f4f1ea", "#a9cfeb", "#3f8fd0"])
_MOST_LOSS = 0.3  # colours end here
_SMALL = 6.8
_SIGNS = {"holds": "no worse", "does not hold": "worse", "cannot tell": "open"}
_LIKELY = "likely worse"


@styled
def tile_figure(block: Block, control: Condition | None, others: Sequence[Condition]) -> Figure | None:
    """Both measures and their differences to the control over two axes; None where there are not two.

    Rows are the first axis, upward; columns the second. What has no tile was left out or is not finished.
    """
    axes = block.axes
    if len(axes) != 2 or block.spec.design != "grid":
        return None
    (down, across) = axes
    rows, columns = (_levels(axes[name]) for name in (down, across))
    conditions = [*others, *([control] if control is not None else [])]
    found = {(one.levels[down], one.levels[across]): one for one in conditions}
    height = 0.75 + 0.47 * len(rows)
    figure = Figure(figsize=(_WIDE, 2 * height + 0.3), layout="constrained")
    panels = figure.subplots(2, 2, squeeze=False)
    for column, (measure, title) in enumerate(MEASURES.items()):
        for row, less in enumerate((False, True)):
            panel = panels[row][column]
            for y, level in enumerate(rows):
                for x, other in enumerate(columns):
                    condition = found.get((level, other))
                    _tile(panel, x, y, condition, measure, less, block.spec.margin, condition is control)
            panel.set_title(f"{title} less the control's" if less else title, fontsize=9)
            _frame(panel, (across, columns), (down, rows), named=(row == 1, column == 0))
    return figure


def _tile(
    panel: Axes,
    x: int,
    y: int,
    condition: Condition | None,
    measure: str,
    less: bool,
    margin: float,
    is_control: bool,
) -> None:
    measured = condition.measures[measure] if condition is not None else None
    told = None if measured is None else _told(measured, less, margin, is_control)
    corner = (x - 0.5, y - 0.5)
    if told is None:
        panel.add_patch(Rectangle(corner, 1, 1, facecolor="none", edgecolor=GRID, hatch="///", linewidth=0))
        return
    value, text, small = told
    scale = Normalize(-_MOST_LOSS, _MOST_LOSS) if less else Normalize(0.4, 1.0)
    colour = (_LOSS if less else _GOODNESS)(scale(np.clip(value, scale.vmin, scale.vmax)))
    ink = _LIGHT if np.dot(colour[:3], (0.299, 0.587, 0.114)) < 0.5 else _DARK
    panel.add_patch(Rectangle(corner, 1, 1, facecolor=colour, edgecolor="none"))
    if is_control:
        inner = (x - 0.46, y - 0.46)
        panel.add_patch(Rectangle(inner, 0.92, 0.92, fill=False, edgecolor=_DARK, linewidth=1.1))
    panel.text(x, y + 0.14, text, ha="center", va="center", color=ink, fontsize=8)
    panel.text(x, y - 0.22, small, ha="center", va="center", color=ink, fontsize=_SMALL)


def _told(measured: Measured, less: bool, margin: float, is_control: bool) -> tuple[float, str, str] | None:
    """What a tile's colour goes by, its figure, and the small print."""
    if not less:
        if measured.value is None:
            return None
        ends = measured.interval
        return (
            measured.value,
            f"{measured.value:.2f}",
            "" if ends is None else f"{ends.low:.2f}–{ends.high:.2f}",
        )
    if is_control:
        return 0.0, "0", "control"
    if measured.difference is None:
        return None
    value = measured.difference.value
    shown = f"{value:+.2f}".replace("-", "\N{MINUS SIGN}")
    return value, shown, sign(measured, margin)


def sign(measured: Measured, margin: float) -> str:
    """What a difference to the control comes to, in a word or two."""
    answer, difference = measured.answer(margin), measured.difference
    ends = difference.interval if difference is not None else None
    if answer == "cannot tell" and ends is not None and ends.high < -margin:
        return _LIKELY
    return _SIGNS[answer]


def _frame(
    panel: Axes,
    across: tuple[str, Sequence[Level]],
    up: tuple[str, Sequence[Level]],
    *,
    named: tuple[bool, bool],
) -> None:
    panel.set_xlim(-0.5, len(across[1]) - 0.5)
    panel.set_ylim(-0.5, len(up[1]) - 0.5)
    panel.set_xticks(range(len(across[1])), [level_name(level) for level in across[1]], fontsize=8)
    panel.set_yticks(range(len(up[1])), [level_name(level) for level in up[1]], fontsize=8)
    panel.tick_params(length=0)
    for side in panel.spines.values():
        side.set_visible(False)
    panel.set_xlabel(labelled(across[0]) if named[0] else "")
    panel.set_ylabel(labelled(up[0]) if named[1] else "")


@styled
def axis_figure(
    block: Block, control: Condition | None, others: Mapping[str, Sequence[Condition]]
) -> Figure | None:
    """Both measures along each axis, with 95% intervals; the control's as a band.

    Args:
        block: The block.
        control: Its control.
        others: By axis, the conditions that differ from the control in it alone.
    """
    shown = {name: conditions for name, conditions in others.items() if conditions}
    if not shown:
        return None
    figure = Figure(figsize=(_WIDE, 2.35 * len(shown) + 0.1), layout="constrained")
    panels = figure.subplots(len(shown), 2, squeeze=False, sharey="col")
    for row, (name, conditions) in zip(panels, shown.items(), strict=True):
        everybody = [*conditions, *([control] if control and control.levels[name] is not None else [])]
        levels = [level for level in _levels(block.axes[name])
                  if any(level == one.levels[name] for one in everybody)]  # fmt: skip
        levels += sorted({float(str(one.levels[name])) for one in everybody if _is_other(one, name, levels)})
        places = _places(block.axes[name], levels)
        for panel, measure in zip(row, MEASURES, strict=True):
            _along(panel, everybody, control, name, measure, dict(zip(levels, places, strict=True)))
            panel.set_xticks(places, [level_name(level) for level in levels], fontsize=8)
            panel.minorticks_off()
            panel.set_xlabel(labelled(name))
            panel.set_ylabel(MEASURES[measure])
            panel.grid(axis="y")
    for panel in panels[0]:  # a column shares its scale
        low, high = panel.get_ylim()
        panel.set_ylim(max(-0.02, min(low, 0.9)), min(high, 1.02))
    return figure


def _along(
    panel: Axes,
    conditions: Sequence[Condition],
    control: Condition | None,
    name: str,
    measure: str,
    places: Mapping[Level, float],
) -> None:
    base = control.measures[measure] if control is not None else None
    if base is not None and base.interval is not None and base.value is not None:
        panel.axhspan(*base.interval, color=GRID, linewidth=0, zorder=0)
        panel.axhline(base.value, color=MUTED, linewidth=0.8, zorder=1)
    for condition in conditions:
        measured, level = condition.measures[measure], condition.levels[name]
        if measured.value is None or level is None or level not in places:
            continue
        colour = INK if condition is control else BLUE if not _worse(measured) else ORANGE
        if measured.interval is not None:
            panel.plot([places[level]] * 2, measured.interval, color=colour, linewidth=1.6)
        face = "none" if condition is control else colour
        panel.plot(places[level], measured.value, "o", color=colour, markerfacecolor=face, markersize=5)


def _worse(measured: Measured) -> bool:
    """Whether it is surely worse than the control at all."""
    difference = measured.difference
    return difference is not None and difference.interval is not None and difference.interval.high < 0


def _is_other(condition: Condition, name: str, levels: Sequence[Level]) -> bool:
    level = condition.levels[name]
    return isinstance(level, int | float) and level not in levels


def _places(axis: Axis, levels: Sequence[Level]) -> list[float]:
    """Where levels stand along an axis: numbers by their size, or logarithm; others one after the other."""
    numbers = [float(level) for level in levels if isinstance(level, int | float)]
    if len(numbers) < len(levels):
        return [float(number) for number in range(len(levels))]
    if axis.logarithmic and min(numbers) > 0:
        return [float(np.log(number)) for number in numbers]
    return numbers


def _levels(axis: Axis) -> list[Level]:
    return [level for level, _ in axis.levels()]


def labelled(name: str) -> str:
    """An axis's name as a label, with its unit where the name tells it."""
    stem = name.removesuffix("_deg")
    return stem.replace("_", " ") + (" (°)" if stem != name else "")
