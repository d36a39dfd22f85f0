"""One look for every picture: colours that colour-blind readers tell apart, and SVG that repeats byte for byte.

Figures use a handful of named colours. On the page each becomes a CSS variable, so that the same drawing is
readable on light and on dark paper; in the files under ``figures/`` they stay what they are here.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure, SubFigure

P = ParamSpec("P")
R = TypeVar("R")

INK, MUTED, GRID, PAPER, SHADOW = "#1c2127", "#66707b", "#dde1e6", "#fefefe", "#e4e7eb"
BLUE, ORANGE = "#0b6bb8", "#d9620a"
TRUE, ASKED = "#c2185b", "#5fb4cf"  # drawn over images, which stay white on dark paper too
MAIN, LIMB_A, LIMB_B, LIMB_C, LIMB_D = "#8a95a1", "#10967f", "#b3569f", "#c9a013", "#5b6fd6"

OF_TRUTH = {"appropriate": BLUE, "inappropriate": ORANGE}
OF_PART = (MAIN, LIMB_A, LIMB_B, LIMB_C, LIMB_D)

VARIABLES = {
    INK: "ink", MUTED: "muted", GRID: "grid", PAPER: "paper", SHADOW: "shadow", BLUE: "blue", ORANGE: "orange",
    MAIN: "part-0", LIMB_A: "part-1", LIMB_B: "part-2", LIMB_C: "part-3", LIMB_D: "part-4",
}  # fmt: skip

_SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.5,
    "text.color": INK,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.facecolor": "none",
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "figure.facecolor": "none",
    "savefig.facecolor": "auto",
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "hatch.linewidth": 0.6,
}

_SVG_DPI = 72  # points of a page, in which matplotlib lays out what it writes as SVG


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Let a function draw in this look without touching matplotlib's settings for anybody else."""

    @wraps(draw)
    def drawing(*args: P.args, **kwargs: P.kwargs) -> R:
        with mpl.rc_context(_SETTINGS):
            return draw(*args, **kwargs)

    return drawing


def svg(figure: Figure, name: str) -> str:
    """The figure as SVG text, the same bytes every time; ``name`` keeps its ids apart from other figures'."""
    with mpl.rc_context({**_SETTINGS, "svg.hashsalt": name}):
        buffer = io.StringIO()
        _lay_out(figure)
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = _own_ids(text, name)
    text = re.sub(r'(?<= d=")[^"]+', _short, text)
    return re.sub(r"[ \t]+\n", "\n", text)


def _lay_out(figure: Figure) -> None:
    """Put everything in its place: left to do it, ``savefig`` draws the figure twice, the first time for nothing."""
    engine = figure.get_layout_engine()
    if engine is not None:
        FigureCanvasSVG(figure)
        figure.dpi = _SVG_DPI
        engine.execute(figure)
        figure.set_layout_engine(None)


def _own_ids(text: str, name: str) -> str:
    """The same drawing with ids of its own: numbered, and with the figure's name before them.

    matplotlib makes ids from places down to the last bit, and its layout solver may differ there from run to run.
    """
    numbers: dict[str, int] = {}
    given: set[str] = set()

    def renamed(match: re.Match[str]) -> str:
        own = match.group(2)
        if match.group(1) == 'id="':
            own += f" {len(numbers)}" * (
                own in given
            )  # an image that is drawn twice has one id, made from its pixels
            given.add(own)
        return f"{match.group(1)}{name}-{numbers.setdefault(own, len(numbers))}"

    return re.sub(r'((?<=\s)id="|url\(#|xlink:href="#)([^")]+)', renamed, text)


def _short(path: re.Match[str]) -> str:
    """A path's coordinates to a hundredth of a point."""
    return re.sub(r"(\.\d\d)\d+", r"\1", path.group())


def inline(text: str, label: str) -> str:
    """An SVG file's text made fit for the page: colours that follow the page's theme, a label for readers."""
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    head, rest = text.split(">", 1)
    head = re.sub(r' (width|height)="[^"]*pt"', "", head)
    for colour, variable in VARIABLES.items():
        rest = rest.replace(colour, f"var(--{variable})")
    rest = rest.replace("'DejaVu Sans'", "var(--font)")
    escaped = label.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return f'{head} role="img" aria-label="{escaped}">{rest}'


def stacked(figure: Figure, upper: float, lower: float) -> tuple[SubFigure, SubFigure]:
    """The figure in two storeys of these relative heights."""
    storeys: Any = figure.subfigures(2, 1, height_ratios=[upper, lower])
    return storeys[0], storeys[1]


def name_row(axes: Axes, title: str) -> None:
    """Write the name of a row of pictures to the left of its first one."""
    axes.annotate(
        title,
        (-0.03, 0.5),
        xycoords="axes fraction",
        ha="right",
        va="center",
        fontsize=9,
        fontweight="bold",
    )
