"""Finding out how a tilt sensor sits on its body, and what is wrong with it.

The robot is laid on a level table on some of its sides. In each pose it is known which way is up in the body's frame;
the sensor says what it feels. Its turning against the body (3), its biases (3) and its scales (3) are fitted to four
poses or more, which leaves enough over to see a pose that was a wrong one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.optimize import least_squares

from testbed.bodies.parts import Vector
from testbed.errors import UserError
from testbed.frames import rotation_about
from testbed.hardware.calibration.records import TiltCalibration, today
from testbed.hardware.clock import Clock
from testbed.hardware.failures import ImuMissing, ImuStuck
from testbed.hardware.line.protocol import NO_IMU_AGE, Flags, Request
from testbed.hardware.prompt import Prompt, Question
from testbed.hardware.robots.board import Board

_COUNTS_PER_G = 16384.0

ORIENTATIONS: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {
        "level": (0.0, 0.0, 1.0),
        "nose_down": (-1.0, 0.0, 0.0),
        "left_side": (0.0, -1.0, 0.0),
        "upside_down": (0.0, 0.0, -1.0),
        "nose_up": (1.0, 0.0, 0.0),
        "right_side": (0.0, 1.0, 0.0),
    }
)
"""Poses on a level table, and which way is up in the body's frame: x to the nose, y to the left, z up."""

_WORDS = {
    "level": "as it walks, level",
    "nose_down": "on its nose, tail up",
    "left_side": "on its left side",
    "upside_down": "on its back",
    "nose_up": "on its tail, nose up",
    "right_side": "on its right side",
}


@dataclass(frozen=True, kw_only=True)
class TiltFitSpec:
    """Which sensors are believed.

    Attributes:
        fewest: Poses; nine unknowns need three and a fourth to check them.
        most_residual_deg: rms; a box stands on its side to a degree or two.
        most_bias: g; the MPU-6050's data sheet allows 0.05 to 0.08.
        most_scale: What the scale may be off 1; the data sheet allows 3 percent.
        readings: How many are averaged in each pose ...
        apart: ... and how many seconds apart they are.
        most_moving: g; a spread of readings beyond this is a robot that is not at rest.
    """

    fewest: int = 4
    most_residual_deg: float = 4.0
    most_bias: float = 0.3
    most_scale: float = 0.15
    readings: int = 20
    apart: float = 0.02
    most_moving: float = 0.1


@dataclass(frozen=True)
class TiltFit:
    """What was found.

    Attributes:
        rotation: (3, 3) from the sensor's axes to the body's.
        bias: (3,) g.
        scale: (3,) true over measured.
        residuals_deg: How far each pose is from what it should have been.
    """

    rotation: Vector
    bias: Vector
    scale: Vector
    residuals_deg: Mapping[str, float]

    @property
    def residual_deg(self) -> float:
        """Root of the mean square."""
        return math.sqrt(sum(off**2 for off in self.residuals_deg.values()) / len(self.residuals_deg))


def fit_tilt(counts: Mapping[str, Sequence[float]], spec: TiltFitSpec | None = None) -> TiltFit:
    """Fit a sensor to the mean counts (3,) of each pose.

    Raises:
        UserError: If poses are missing, contradict each other, or make a sensor that cannot be.
    """
    spec = spec or TiltFitSpec()
    if len(counts) < spec.fewest:
        raise UserError(f"{len(counts)} poses say too little", f"lay it down in at least {spec.fewest}")
    felt = np.array([counts[pose] for pose in counts], dtype=float) / _COUNTS_PER_G
    up = np.array([ORIENTATIONS[pose] for pose in counts])
    if np.linalg.matrix_rank(up) < 3:
        raise UserError("the poses are all alike", "lay it on its nose and on one side too")
    start = _turning(felt - felt.mean(axis=0), up - up.mean(axis=0))
    solved = least_squares(
        lambda x: (_body(x, start, felt) - up).ravel(), np.r_[np.zeros(6), np.ones(3)], method="lm"
    )
    seen = _body(solved.x, start, felt)
    size = np.linalg.norm(seen, axis=1)
    off = np.degrees(np.arccos(np.clip((seen * up).sum(axis=1) / np.maximum(size, 1e-9), -1, 1)))
    fit = TiltFit(
        rotation=rotation_about(solved.x[:3].tolist())[:3, :3] @ start,
        bias=solved.x[3:6],
        scale=solved.x[6:],
        residuals_deg=dict(zip(counts, off.tolist(), strict=True)),
    )
    _plausible(fit, size, spec)
    return fit


def calibrate_tilt(
    board: Board,
    clock: Clock,
    prompt: Prompt,
    *,
    robot: str | None = None,
    poses: Sequence[str] = tuple(ORIENTATIONS),
    spec: TiltFitSpec | None = None,
) -> TiltCalibration:
    """Go through the poses with a person; those that cannot be had may be left out with "skip".

    Args:
        board: Connected, limp.
        clock: The bench's.
        prompt: Asks the person.
        robot: Who carries the board, if it is not called so itself.
        poses: Which of :data:`ORIENTATIONS`.
        spec: Which sensors are believed.

    Raises:
        UserError: See :func:`fit_tilt`.
        ImuMissing: If the sensor does not answer.
        ImuStuck: If it repeats itself.
    """
    spec, robot = spec or TiltFitSpec(), robot or board.name
    counts: dict[str, Sequence[float]] = {}
    for pose in poses:
        text = f"Lay {robot} on a level table {_WORDS[pose]}, let go of it, and press Enter ('skip' to leave out):"
        while prompt(Question("tilt", robot, text, {"orientation": pose})).strip() != "skip":
            readings = _readings(board, clock, spec)
            spread = float(np.ptp(readings, axis=0).max()) / _COUNTS_PER_G
            if spread <= spec.most_moving:
                counts[pose] = readings.mean(axis=0).tolist()
                break
            text = f"It moved ({spread:.2f} g). Lay it {_WORDS[pose]}, let go of it, and press Enter:"
    fit = fit_tilt(counts, spec)
    identity = board.identity
    rows = [(float(x), float(y), float(z)) for x, y, z in fit.rotation]
    (bx, by, bz), (sx, sy, sz) = fit.bias.tolist(), fit.scale.tolist()
    return TiltCalibration(
        unique_id=identity.unique_id,
        board_id=identity.board_id,
        created=today(),
        rotation=(rows[0], rows[1], rows[2]),
        bias=(bx, by, bz),
        scale=(sx, sy, sz),
        residual_deg=fit.residual_deg,
    )


def _readings(board: Board, clock: Clock, spec: TiltFitSpec) -> Vector:
    readings = []
    for _ in range(spec.readings):
        clock.sleep(spec.apart)
        state = board.ask(Request.READ)
        if state.flags & Flags.IMU_MISSING or state.imu_age_ms == NO_IMU_AGE:
            raise ImuMissing(f"the tilt sensor of {board.name} does not answer")
        if state.flags & Flags.IMU_STUCK:
            raise ImuStuck(f"the tilt sensor of {board.name} repeats one reading to the bit")
        readings.append(state.acceleration)
    return np.array(readings, dtype=float)


def _turning(felt: Vector, up: Vector) -> Vector:
    """(3, 3) the rotation that brings directions nearest to each other (Kabsch)."""
    left, _, right = np.linalg.svd(up.T @ felt)
    handed = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    return np.asarray(left @ handed @ right)


def _body(x: Vector, start: Vector, felt: Vector) -> Vector:
    """(n, 3) what was felt, in the body's frame, with the unknowns x: turning, bias, scale."""
    turned = rotation_about(x[:3].tolist())[:3, :3] @ start
    return np.asarray(((felt - x[3:6]) * x[6:]) @ turned.T)


def _plausible(fit: TiltFit, size: Vector, spec: TiltFitSpec) -> None:
    worst = max(fit.residuals_deg, key=lambda pose: fit.residuals_deg[pose])
    if fit.residual_deg > spec.most_residual_deg:
        what = f"the poses contradict each other by {fit.residual_deg:.1f} degrees rms, most '{worst}'"
        raise UserError(what, "lay the robot down again, exactly on its sides")
    if np.abs(fit.bias).max() > spec.most_bias or np.abs(fit.scale - 1).max() > spec.most_scale:
        bias, scale = np.abs(fit.bias).max(), fit.scale[np.abs(fit.scale - 1).argmax()]
        what = f"this sensor cannot be: a bias of {bias:.2f} g, a scale of {scale:.2f}"
        raise UserError(what, "check the sensor's wiring and its range, and lay the robot down again")
    if not (size.min() > 0.8 and size.max() < 1.2):
        what = f"at rest it feels {size.min():.2f} to {size.max():.2f} g"
        raise UserError(what, "lay the robot down again and let go of it")
