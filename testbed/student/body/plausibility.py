"""How well a body explains what was felt: the log posterior of Section 3.2's search, in place of Eq. 1.

The loss lives on the direction of gravity rather than on two tilt angles, which are ill-defined when the body stands
on its end. It grows like a logarithm (Student's t), so that a posture with several ways to lie, where the imagined
body ended on another side than the real one, costs a bounded amount instead of deciding everything. With many limbs a
swift motion often ends so; there a body is asked only whether it would lie as it was felt to lie.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.body.settling import up_of_tilt
from testbed.student.parameters import PlausibilityParameters


@dataclass(frozen=True)
class Felt:
    """What was commanded and felt so far.

    Attributes:
        commands: (m, n) rad.
        tilt: (m, 2) rad.
    """

    commands: Vector
    tilt: Vector

    @property
    def up(self) -> Vector:
        """(m, 3) the world's up in the root's frame."""
        return up_of_tilt(self.tilt)

    @property
    def bias_effect(self) -> Vector:
        """(m, 3, 2) how that changes with a bias of the two tilt readings."""
        side, nose = self.tilt.T
        zero = np.zeros(len(side))
        by_side = [zero, np.cos(nose) * np.cos(side), -np.cos(nose) * np.sin(side)]
        by_nose = [-np.cos(nose), -np.sin(nose) * np.sin(side), -np.sin(nose) * np.cos(side)]
        return np.stack([np.stack(by_side, 1), np.stack(by_nose, 1)], axis=2)

    def with_reading(self, command: Vector, tilt: Vector) -> Felt:
        """One more reading."""
        return Felt(np.vstack([self.commands, command]), np.vstack([self.tilt, tilt]))


@dataclass(frozen=True)
class Fit:
    """How plausible some bodies are.

    Attributes:
        log_posterior: (c,) up to a constant.
        bias: (c, 2) what the sensor adds to the tilt, as goes best with each, rad.
        residuals: (c, m, 3) imagined minus felt, bias removed.
        weights: (c, m) how much each reading counts; an outlier hardly does.
    """

    log_posterior: Vector
    bias: Vector
    residuals: Vector
    weights: Vector


def judge_bodies(ups: Vector, values: Vector, felt: Felt, beliefs: PlausibilityParameters) -> Fit:
    """The log posterior of bodies that would have felt ``ups`` (c, m, 3) and have these ``values`` (c, 3 n)."""
    scale, freedom = beliefs.spread, beliefs.freedom
    limbs = values.shape[1] // 3
    raw, effect = ups - felt.up, felt.bias_effect
    ridge = np.eye(2) / np.radians(beliefs.bias_deg) ** 2
    bias = np.zeros((len(ups), 2))
    residuals = raw
    for _ in range(3):
        squares = np.sum(residuals**2, axis=2) / scale**2
        weights = (freedom + 2) / (freedom + squares) / scale**2
        normal = np.einsum("cm,mij,mik->cjk", weights, effect, effect) + ridge
        pull = -np.einsum("cm,mij,cmi->cj", weights, effect, raw)
        bias = np.linalg.solve(normal, pull[..., None])[..., 0]
        residuals = raw + np.einsum("mij,cj->cmi", effect, bias)
    squares = np.sum(residuals**2, axis=2) / scale**2
    loss = (freedom + 2) / 2 * np.log1p(squares / freedom).sum(axis=1)
    scaled = values / beliefs.prior_widths(limbs)
    loss = (
        loss
        + 0.5 * np.sum(scaled**2, axis=1)
        + 0.5 * np.sum((bias / np.radians(beliefs.bias_deg)) ** 2, axis=1)
    )
    return Fit(-loss, bias, residuals, (freedom + 2) / (freedom + squares) / scale**2)
