"""Which views of the board are still missing, in words: what makes a calibration good is where the board was held.

A lens is known only where corners were seen, and a board that always faces the camera cannot tell a long lens from a
far board. So every part of either image has to be filled, and the board tilted each way, near and far.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from testbed.bodies.morphology import Vector
from testbed.hardware.calibration.charuco import BoardView, CharucoSpec
from testbed.hardware.calibration.rig_fit import GUESS, BoardPair
from testbed.hardware.rig.pairing import SIDES

COLUMNS, ROWS = 4, 3
PER_CELL = 12
"""Corners that each cell of each image must have: a third of a board at least."""
PER_LEANING = 3
"""Views that lean each way."""
LEAST_LEAN = math.radians(12)
NEAR, FAR = 0.38, 0.4
"""m: views that are nearer, and farther, must both be there."""

_ACROSS = ("far left", "left", "right", "far right")
_DOWN = ("upper", "middle", "lower")
_LEANINGS = {
    "top": (28.0, 0.0),
    "bottom": (-28.0, 0.0),
    "left": (0.0, -28.0),
    "right": (0.0, 28.0),
}
"""Which edge comes toward the cameras, and the turns about x and y (degrees) that do that."""


@dataclass(frozen=True)
class Wish:
    """How the board should be held next.

    Attributes:
        text: In words.
        details: As numbers: ``u``, ``v`` (-1 to 1 over the picture), ``distance`` (m), ``lean_x_deg``, ``lean_y_deg``.
    """

    text: str
    details: dict[str, float | str]


class Coverage:
    """Counts what has been seen.

    Args:
        spec: The board.
        size: Width and height of the images.
    """

    def __init__(self, spec: CharucoSpec, size: tuple[int, int]) -> None:
        self._spec, self._size = spec, size
        self.cells = np.zeros((2, ROWS, COLUMNS), np.int64)
        self.leanings = dict.fromkeys(_LEANINGS, 0)
        self.near, self.far = 0, 0

    def add(self, pair: BoardPair) -> None:
        """Count a pair of views."""
        for eye, view in enumerate((pair.left, pair.right)):
            if view is not None:
                columns = np.clip(view.points[:, 0] * COLUMNS // self._size[0], 0, COLUMNS - 1).astype(int)
                rows = np.clip(view.points[:, 1] * ROWS // self._size[1], 0, ROWS - 1).astype(int)
                np.add.at(self.cells[eye], (rows, columns), 1)
        if pair.left is not None:
            turn, distance = self._held(pair.left)
            # How much farther the lower and the right edge are than the opposite ones, per metre of board.
            down, right = turn[2, 1], turn[2, 0]
            if max(abs(down), abs(right)) > math.sin(LEAST_LEAN):
                way = ("top" if down > 0 else "bottom", "left" if right > 0 else "right")
                self.leanings[way[0] if abs(down) >= abs(right) else way[1]] += 1
            self.near += distance < NEAR
            self.far += distance > FAR

    def missing(self) -> list[str]:
        """What is still missing, in words; empty when all is there."""
        words = [
            f"the {_DOWN[row]} {_ACROSS[column]} of the {SIDES[eye]} camera's image"
            for eye, row, column in np.argwhere(self.cells < PER_CELL).tolist()
        ]
        words += [
            f"views with the {edge} edge toward the cameras"
            for edge, count in self.leanings.items()
            if count < PER_LEANING
        ]
        words += ["views from near"] * (self.near < PER_LEANING) + ["views from far"] * (
            self.far < PER_LEANING
        )
        return words

    def wish(self) -> Wish:
        """How the board should be held next: where, and leaning as, it has been seen least."""
        seen = self.cells.min(axis=0)
        row, column = divmod(int(np.argmin(seen)), COLUMNS)
        edge = min(self.leanings, key=lambda name: self.leanings[name])
        distance = 0.33 if self.near <= self.far else 0.45
        x, y = _LEANINGS[edge]
        text = (
            f"Hold the board in the {_DOWN[row]} {_ACROSS[column]} of both pictures, some {distance * 100:.0f} cm "
            f"away, its {edge} edge leaning well toward the cameras, and keep it still."
        )
        details: dict[str, float | str] = {
            # Not quite as far out: half a board in the corner tells more than a strip of it.
            "u": (column - (COLUMNS - 1) / 2) / 2.5,
            "v": (row - (ROWS - 1) / 2) / 1.9,
            "distance": distance,
            "lean_x_deg": x,
            "lean_y_deg": y,
        }
        return Wish(text, details)

    def _held(self, view: BoardView) -> tuple[Vector, float]:
        """Roughly how the board was turned (3, 3) and how far off its middle was (m), by a guessed lens."""
        width, height = self._size
        focal = GUESS * width
        lens = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        _, turn, place = cv2.solvePnP(self._spec.corners()[view.ids], view.points, lens, None)
        axes = np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64)
        middle = np.ravel(place) + axes[:, :2] @ np.array(self._spec.extent) / 2
        return axes, float(middle[2])


def upright() -> Wish:
    """The last view: tells the cameras where level is."""
    text = (
        "Stand the board on its longer edge, exactly upright (set square), facing the cameras, some 40 cm away, on a "
        "block so that it is in the middle of the picture."
    )
    return Wish(
        text, {"u": 0.0, "v": 0.0, "distance": 0.4, "lean_x_deg": 0.0, "lean_y_deg": 0.0, "upright": "yes"}
    )
