"""What one view of the board tells about a calibrated rig: whether it is level, and whether it has been knocked."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Vector
from testbed.hardware.calibration.charuco import CharucoSpec
from testbed.hardware.calibration.rig_fit import FEWEST_CORNERS, BoardPair, Geometry, off_row
from testbed.hardware.failures import NotCalibrated, RigMoved

MOVED_OFF_ROW = 0.6
"""Pixels of the full image off the row, root mean square, that tell of a knock: 2.4 times what a new one may have."""
MOVED_SCALE = 0.01
"""How much larger or smaller than it is the board may be measured before the cameras count as moved."""
STEEPEST = math.radians(5)
"""rad: a rig that looks up or down more than this should be shimmed, not computed straight."""
MOST_ROLL = math.radians(1)
"""rad: a baseline that hangs to one side more than this should be shimmed: no rectification can undo it."""


def pitch_of(geometry: Geometry, upright: BoardPair, board: CharucoSpec) -> float:
    """How far (rad) the rectified rig looks down, from a view of the board standing upright on its longer edge.

    Raises:
        NotCalibrated: If the board is not seen, or the rig hangs so askew that it must be mended by hand.
    """
    points, ids = _seen_in_space(geometry, upright)
    flat = board.corners()[ids]
    # The rotation that lays the board's own axes on what is seen (Kabsch).
    u, _, vt = np.linalg.svd((points - points.mean(0)).T @ (flat - flat.mean(0)))
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    pitch, roll = down_of(turn[:, 1])
    if abs(roll) > MOST_ROLL:
        side = "right" if roll > 0 else "left"
        what = f"the rig hangs {math.degrees(abs(roll)):.1f} degrees down to the {side}"
        raise NotCalibrated(what, "level the rig's plate, and see that the board stands on its longer edge")
    if abs(pitch) > STEEPEST:
        what = f"the rig looks {math.degrees(abs(pitch)):.1f} degrees {'down' if pitch > 0 else 'up'}"
        raise NotCalibrated(what, "level the rig's plate, and see that the board stands upright")
    return pitch


def down_of(down: Vector) -> tuple[float, float]:
    """How far (rad) a rig looks down, and hangs down to its right, in whose frame this direction (3,) is down."""
    return math.atan2(down[2], down[1]), math.atan2(down[0], down[1])


def check_rig(
    geometry: Geometry, pair: BoardPair, board: CharucoSpec, when_calibrated: float
) -> tuple[float, float]:
    """Look once at the board to see whether a calibration is still true, whose rows were off ``when_calibrated``.

    Returns:
        Pixels off the row (root mean square), and how large the board is measured over how large it is.

    Raises:
        RigMoved: If the corners lie off their rows, or the board has not the size that it has.
        NotCalibrated: If the board is not seen well enough.
    """
    points, ids = _seen_in_space(geometry, pair)
    both = pair.common()
    assert both is not None
    off = off_row(geometry, [both])
    flat = board.corners()[ids]
    spread = float(np.sqrt(((points - points.mean(0)) ** 2).sum() / ((flat - flat.mean(0)) ** 2).sum()))
    if off > MOVED_OFF_ROW:
        raise RigMoved(
            f"corners of the board lie {off:.2f} pixels off their row, {when_calibrated:.2f} when calibrated"
        )
    if abs(spread - 1) > MOVED_SCALE:
        raise RigMoved(
            f"the board is measured {abs(spread - 1):.1%} too {'large' if spread > 1 else 'small'}"
        )
    return off, spread


def _seen_in_space(geometry: Geometry, pair: BoardPair) -> tuple[Vector, NDArray[np.int64]]:
    """(N, 3) where the corners that both see are in the rectified frame (m; origin in the left eye), and their ids."""
    both = pair.common()
    if both is None:
        raise NotCalibrated(
            f"fewer than {FEWEST_CORNERS} corners of the board are seen by both cameras",
            "hold the board where both see it, and well lit",
        )
    turns = geometry.rows_aligned()
    left, right = (geometry.slopes(eye, both[eye].points, turns[eye]) for eye in (0, 1))
    gaps = left[:, 0] - right[:, 0]
    if np.any(gaps <= 0):
        raise RigMoved("the board is seen behind the cameras")
    depth = geometry.baseline / gaps
    rows = (left[:, 1] + right[:, 1]) / 2
    return np.stack([left[:, 0] * depth, rows * depth, depth], axis=-1), both[0].ids
