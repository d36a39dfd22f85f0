"""Phase four, the verdict (Sections 3.4 and 4): is that candidate like me, an appropriate teacher?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.parameters import VerdictParameters

Answer = Literal["appropriate", "inappropriate"]


@dataclass(frozen=True)
class Verdict:
    """An answer, and what it was drawn from.

    Attributes:
        answer: Appropriate or not.
        score: The higher, the more like the student.
        probability: That the candidate is appropriate, as far as the score tells; None if nobody calibrated it.
        reason: The same in words; empty if there are none.
    """

    answer: Answer
    score: float
    probability: float | None = None
    reason: str = ""

    def but(self, words: str) -> Verdict:
        """The same answer with what speaks against trusting it; who gives no reasons says nothing."""
        return replace(self, reason=f"{self.reason}; {words}") if words and self.reason else self


def judge(errors: Vector, terms: int, parameters: VerdictParameters) -> Verdict:
    """Draw a verdict from the errors of a controller's evolution.

    Args:
        errors: (iterations + 1,) Eq. 5 of the parent after each iteration.
        terms: How many squared differences Eq. 5 sums (samples times parts).
        parameters: Which score, and the threshold.
    """
    if parameters.score == "relative_reduction":
        score = 1 - float(errors[-1]) / max(float(errors[0]), 1e-12)
    else:
        score = -float(errors[-1]) / float(np.sqrt(terms))
    return Verdict("appropriate" if score >= parameters.decisive else "inappropriate", score)
