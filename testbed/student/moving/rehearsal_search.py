"""How a controller's weights are found: a closed-form start, damped least squares, and the paper's hill climber."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.special import expit, logit

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.moving.rolls import view_of
from testbed.student.search import choose_variables

Residual = Callable[[Vector], Vector]
"""Parameters (p,) to residuals (m,)."""

Jacobian = Callable[[Vector, Vector], Vector]
"""Parameters (p,) and their residuals (m,) to derivatives (m, p)."""

Told = Callable[[Vector, Vector], None]
"""Is told every parameters (p,) that were tried, and their residuals (m,)."""


def root_roll(body: Morphology) -> float:
    """The main body's roll (rad) when the student lies flat in its own view: 0, or pi if it heads to the left."""
    return 0.0 if view_of(body)[0][0] >= 0 else math.pi


def joint_angles(body: Morphology, rolls: Vector) -> Vector:
    """The joint angles (samples, joints), rad, that the rolls of a body's parts (samples, k) tell of.

    Exact for a body whose limbs lie in the plane of the image; for a limb mounted aside the turn that would look
    the same from the front, which is only a place to start from.
    """
    places = list(body.parts)
    side = 1.0 if root_roll(body) == 0.0 else -1.0  # seen from the other side, down turns the other way
    angles = np.empty((len(rolls), len(body.joints)))
    for column, joint in enumerate(body.joints.values()):
        turned = side * (rolls[:, places.index(joint.child)] - rolls[:, places.index(joint.parent)])
        ahead = math.cos(math.radians(joint.angle_deg))
        angles[:, column] = np.arctan2(
            np.sin(turned) * abs(ahead), np.cos(turned) * math.copysign(1.0, ahead)
        )
    return angles


def logistic_start(inputs: Vector, angles: Vector, limits: Vector, margin: float = 0.03) -> Vector:
    """Weights (joints, k) of logistic units that turn rolls (samples, k) into joint angles (samples, joints), rad.

    A linear fit of the angles' logits, then damped least squares on the angles themselves; each motor for itself.

    Args:
        inputs: What is fed to the units.
        angles: What they should give.
        limits: (joints, 2) travel of the motors, rad.
        margin: Logits are taken no nearer to the ends than this share of the travel.
    """
    weights = np.empty((angles.shape[1], inputs.shape[1]))
    for joint, (low, high) in enumerate(limits):
        travel, wanted = high - low, angles[:, joint]

        def residual(w: Vector, low: float = low, travel: float = travel, wanted: Vector = wanted) -> Vector:
            return np.asarray(low + travel * expit(inputs @ w) - wanted)

        def jacobian(w: Vector, _: Vector, travel: float = travel) -> Vector:
            share = expit(inputs @ w)
            return np.asarray(travel * (share * (1 - share))[:, None] * inputs)

        share = np.clip((wanted - low) / travel, margin, 1 - margin)
        start, *_ = np.linalg.lstsq(inputs, logit(share), rcond=None)
        weights[joint], _ = damped_least_squares(residual, jacobian, np.clip(start, -20, 20), 12)
    return weights


def differences(residual: Residual, step: float = 1e-3) -> Jacobian:
    """The derivatives of residuals by forward differences."""

    def jacobian(here: Vector, now: Vector) -> Vector:
        columns = []
        for index in range(len(here)):
            moved = here.copy()
            moved[index] += step
            columns.append((residual(moved) - now) / step)
        return np.stack(columns, axis=1) if columns else np.empty((len(now), 0))

    return jacobian


def damped_least_squares(
    residual: Residual, jacobian: Jacobian, start: Vector, steps: int, told: Told | None = None
) -> tuple[Vector, Vector]:
    """Levenberg-Marquardt: the parameters found and their residuals.

    Args:
        residual: What to make small.
        jacobian: Its derivatives.
        start: (p,) where to begin.
        steps: How many steps are tried at most.
        told: Hears of every step, whether it was better or not.
    """
    here, now = start.astype(float), residual(start)
    damping, better = 1e-2, True
    slopes = np.empty(0)
    for _ in range(steps):
        if better:
            slopes = jacobian(here, now)
        normal = slopes.T @ slopes
        child = here - np.linalg.solve(normal + np.diag(damping * np.diag(normal) + 1e-9), slopes.T @ now)
        then = residual(child)
        gain = float(now @ now - then @ then)
        better = gain > 0
        if told is not None:
            told(child, then)
        if better:
            small = gain < 1e-4 * float(now @ now)
            here, now, damping = child, then, damping / 5
            if small:
                break
        else:
            damping *= 5
    return here, now


def climb(
    residual: Residual, start: Vector, iterations: int, width: float, rng: np.random.Generator, told: Told
) -> tuple[Vector, Vector]:
    """The paper's hill climber (Section 3.4.2): the parameters found and their residuals.

    Args:
        residual: What to make small.
        start: (p,) the first parent.
        iterations: How many children there are: one to three parameters change by a Gaussian, the better one stays.
        width: Standard deviation of a mutation.
        rng: Source of chance.
        told: Hears of every child.
    """
    parent, now = start, residual(start)
    for _ in range(iterations):
        child = parent.copy()
        chosen = choose_variables(rng, child.size, 1, 3)
        child[chosen] += rng.normal(0.0, width, len(chosen))
        then = residual(child)
        told(child, then)
        if float(then @ then) < float(now @ now):
            parent, now = child, then
    return parent, now
