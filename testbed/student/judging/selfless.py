"""Verdicts that need no self: what any claim about the others is measured against."""

from __future__ import annotations

import math

import numpy as np

from testbed.student.judging.likeness import decided
from testbed.student.judging.verdict import Verdict
from testbed.student.parameters import GlanceParameters
from testbed.student.seeing.glance import Glance


def by_chance(rng: np.random.Generator) -> Verdict:
    """A coin; its score is how it fell."""
    score = float(rng.uniform(-1, 1))
    return Verdict("appropriate" if score >= 0 else "inappropriate", score, 0.5, "a coin fell so")


def by_distance(seen: Glance, parameters: GlanceParameters) -> Verdict:
    """The nearer, the better."""
    return decided(np.array([seen.distance]), parameters.near, f"it is {seen.distance:.2f} m away")


def by_look(seen: Glance, parameters: GlanceParameters) -> Verdict:
    """The more its outline is one that the own kind shows from the side in some posture, the better."""
    if not math.isfinite(seen.likeness):
        return Verdict("inappropriate", -1e3, 0.0, "there was nothing to look at")
    reason = f"its looks are {seen.likeness:.1f} (log density) like those of my kind"
    return decided(np.array([seen.likeness]), parameters.look, reason)
