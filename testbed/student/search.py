"""The hill climber of self-discovery and imitation (Sections 3.2.3 and 3.4.2).

Teacher modelling climbs likewise (Section 3.3.3), in a compiled loop of its own.
"""

from __future__ import annotations

import numpy as np

from testbed.bodies.morphology import Vector


class HillClimber:
    """One parent, one child: the child that is strictly better takes the parent's place.

    Mutate the parent and evaluate the child as you like, then tell its error::

        climber = HillClimber(start, error_of(start))
        child = mutate(climber.parent)
        climber.tell(child, error_of(child))

    Attributes:
        parent: (n,) the best genome so far.
        error: Its error.
        parents: Every parent so far, the start first, one a told child.
        errors: Their errors.
    """

    def __init__(self, start: Vector, error: float) -> None:
        self.parent, self.error = start, error
        self.parents, self.errors = [start], [error]

    def tell(self, child: Vector, error: float) -> bool:
        """Take the child if it is strictly better; returns whether it was taken."""
        better = error < self.error
        if better:
            self.parent, self.error = child, error
        self.parents.append(self.parent)
        self.errors.append(self.error)
        return better


def choose_variables(rng: np.random.Generator, count: int, fewest: int, most: int) -> Vector:
    """Between ``fewest`` and ``most`` different variables out of ``count``, as a sorted index array."""
    number = int(rng.integers(fewest, min(most, count) + 1))
    return np.sort(rng.choice(count, size=number, replace=False))
