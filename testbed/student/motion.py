"""What the student saw of a candidate, and how the candidate's parts moved in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Vector


@dataclass(frozen=True)
class Watched:
    """Stereo pairs of one candidate.

    Attributes:
        frames: (F, 2, height, width) luminosity, left then right.
        times: (F,) when each was seen, s, rising.
        unseen: (F, 2, height, width) where somebody else stood, so that nothing is known; None if nobody did.
    """

    frames: NDArray[np.uint8]
    times: Vector
    unseen: NDArray[np.bool_] | None = None

    def at(self, looks: Sequence[int]) -> Watched:
        """Some of the frames."""
        which = list(looks)
        unseen = None if self.unseen is None else self.unseen[which]
        return Watched(self.frames[which], self.times[which], unseen)


@dataclass(frozen=True)
class TeacherMotion:
    """A teacher model in motion: the same k objects at every time.

    Attributes:
        times: (F,) s.
        parts: (F, k, 8) the objects of Eq. 2 in the rig's frame (m, rad). Their roll omega never jumps by a turn, and
            an object's own x axis points away from what it hangs on, wherever that is known.
    """

    times: Vector
    parts: Vector

    def thinned(self, count: int) -> TeacherMotion:
        """The same motion at ``count`` moments spread evenly over it, or as it is if it has no more."""
        if len(self.times) <= count:
            return self
        last = len(self.times)
        times = np.interp(np.arange(1, count + 1) * (last / count) - 1, np.arange(last), self.times)
        return TeacherMotion(times, self.sampled(count))

    def sampled(self, count: int) -> Vector:
        """(count, k, 8): the motion at moments spread evenly over it, the last included.

        Section 3.4.1 takes every 100th of 24 000 entries. Where a moment lies between two entries, they are mixed.
        """
        last = len(self.times) - 1
        places = np.arange(1, count + 1) * (len(self.times) / count) - 1
        below = np.clip(np.floor(places).astype(int), 0, last)
        above, share = np.minimum(below + 1, last), np.clip(places - below, 0, 1)[:, None, None]
        return np.asarray(self.parts[below] * (1 - share) + self.parts[above] * share)
