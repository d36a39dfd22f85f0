"""The calibration board as a page to print: A4, to scale, with a ruler that tells whether the printer kept it.

Made by ``python -m testbed.hardware.calibration.board_pdf FILE``.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import IO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from testbed.errors import UserError
from testbed.experiment.atomic import write_whole
from testbed.hardware.calibration.charuco import RULER, TEXELS, CharucoSpec

PAGE = (0.297, 0.210)
"""A4 across, m."""
MARGIN = 0.012
"""m that printers leave white, and that the board needs to be white: its rim tells the outer squares from the wall."""
_FROM_TOP = 0.013
_RULER_FROM_BOTTOM = 0.0165


def board_figure(spec: CharucoSpec) -> Figure:
    """The page.

    Raises:
        UserError: If the board does not fit on it.
    """
    width, height = spec.extent
    if width > PAGE[0] - 2 * MARGIN or height > PAGE[1] - _FROM_TOP - 0.026:
        raise UserError(
            f"a board of {width * 1e3:.0f} x {height * 1e3:.0f} mm does not fit on A4",
            "fewer or smaller squares: 9 x 6 of 28 mm fit",
        )
    figure = Figure(figsize=(PAGE[0] / 0.0254, PAGE[1] / 0.0254))
    FigureCanvasPdf(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, PAGE[0] * 1e3), ylim=(PAGE[1] * 1e3, 0))  # millimetres from the upper left corner
    axes.axis("off")
    left, top = (PAGE[0] - width) / 2 * 1e3, _FROM_TOP * 1e3
    _draw_board(axes, spec, left, top)
    _draw_ruler(axes, left, (PAGE[1] - _RULER_FROM_BOTTOM) * 1e3)
    text = (
        'Print at 100 % ("actual size", never "fit to page"). Check with a steel rule: the ruler is '
        f"{RULER * 1e3:.0f}.0 mm from end to end,\n"
        f"within 0.2 mm, the board {width * 1e3:.1f} mm across and {height * 1e3:.1f} mm down. If not, write the "
        "measured side of a square into the\n"
        f"bench file (board_square). Glue it flat onto glass or a stiff board. {spec.columns} x {spec.rows} squares "
        f"of {spec.square * 1e3:g} mm,\nmarkers {spec.marker * 1e3:g} mm, dictionary 4x4_50."
    )
    axes.text(
        left + RULER * 1e3 + 8, (PAGE[1] - 0.0235) * 1e3, text, fontsize=5.6, va="top", family="DejaVu Sans"
    )
    return figure


def write_board(path: Path, spec: CharucoSpec | None = None) -> None:
    """Write the page as a PDF, whole or not at all; the same bytes each time.

    Raises:
        UserError: If the board does not fit on the page, or the place cannot be written.
    """
    figure = board_figure(spec or CharucoSpec())

    def write(file: IO[bytes]) -> None:
        figure.savefig(file, format="pdf", metadata={"CreationDate": None, "Title": "Calibration board"})

    write_whole(path, write)


def _draw_board(axes: Axes, spec: CharucoSpec, left: float, top: float) -> None:
    """Black squares, black markers, and the markers' white bits on top: no seams where texels meet."""
    side, texel = spec.square * 1e3, spec.square * 1e3 / TEXELS
    texels = spec.texels().reshape(spec.rows, TEXELS, spec.columns, TEXELS).transpose(0, 2, 1, 3)
    for row in range(spec.rows):
        for column in range(spec.columns):
            x, y, square = left + column * side, top + row * side, texels[row, column]
            if not square.any():
                _fill(axes, x, y, side, side, "black")
                continue
            inset = (TEXELS - 6) // 2
            _fill(axes, x + inset * texel, y + inset * texel, 6 * texel, 6 * texel, "black")
            marker = square[inset : inset + 6, inset : inset + 6]
            for v, first, last in _runs(marker > 0):
                _fill(
                    axes,
                    x + (inset + first) * texel,
                    y + (inset + v) * texel,
                    (last - first) * texel,
                    texel,
                    "white",
                )


def _runs(white: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> list[tuple[int, int, int]]:
    """Row, first and one after the last of each run of white bits."""
    found = []
    for row, bits in enumerate(white):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], bits, [False]]).astype(np.int8)))
        found += [(row, int(first), int(last)) for first, last in edges.reshape(-1, 2)]
    return found


def _draw_ruler(axes: Axes, left: float, y: float) -> None:
    _fill(axes, left, y, RULER * 1e3, 0.3, "black")
    for millimetre in range(round(RULER * 1e3) + 1):
        high = 5.0 if millimetre % 10 == 0 else 3.5 if millimetre % 5 == 0 else 2.0
        x = left + millimetre
        # The end marks lie within the ruler: it is measured over all.
        shift = 0.0 if millimetre == 0 else -0.15 if millimetre == round(RULER * 1e3) else -0.075
        _fill(axes, x + shift, y - high, 0.15, high, "black")
        if millimetre % 10 == 0:
            axes.text(x, y + 3.6, str(millimetre), fontsize=5.6, ha="center", family="DejaVu Sans")
    axes.text(left + RULER * 1e3 + 3, y + 3.6, "mm", fontsize=5.6, family="DejaVu Sans")


def _fill(axes: Axes, x: float, y: float, width: float, height: float, colour: str) -> None:
    axes.add_patch(Rectangle((x, y), width, height, facecolor=colour, edgecolor="none", linewidth=0))


def main() -> None:
    """Write the page to the file that is named."""
    write_board(Path(sys.argv[1] if len(sys.argv) > 1 else "board.pdf"))


if __name__ == "__main__":
    main()
