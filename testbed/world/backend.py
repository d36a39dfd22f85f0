"""What a world must be able to do, simulated or physical: the only thing that the two have in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Morphology, Vector

Pair = NDArray[np.uint8]


class Backend(Protocol):
    """Robots with joints and a tilt sensor, and a stereo rig that pans."""

    @property
    def robots(self) -> Mapping[str, Morphology]:
        """The bodies by agent name, ``student`` first; their joints give the order of commands."""
        ...

    @property
    def pan(self) -> float:
        """Where the rig looks now, rad, positive to the right."""
        ...

    @property
    def exposed(self) -> int:
        """How many steps since the reset had passed when the pair of images that :meth:`look` gives was exposed."""
        ...

    def reset(self, seeds: np.random.SeedSequence) -> None:
        """Put every robot back to its start, flat and at rest, and the rig straight ahead."""
        ...

    def apply(self, commands: Mapping[str, Vector], pan: float) -> None:
        """Let one control step pass while every robot's servos and the rig go for these targets (rad)."""
        ...

    def tilt(self, robot: str) -> Vector:
        """(2,) tilt of a robot's main body, rad, as its sensor reads it."""
        ...

    def progress(self, robot: str) -> float:
        """How far a robot has come along its starting direction since the reset, in metres; 0 if unknown."""
        ...

    def movement(self, robot: str) -> float:
        """How fast a robot's fastest limb turned in the last control step, rad/s; 0 if unknown."""
        ...

    def look(self, wanted: bool = True) -> Pair:
        """(2, 75, 100) luminosity: the newest left and right image of the rig.

        A pair that begins while nobody wants it may be white: a simulation is spared the picture. All later ones are
        as if it had been taken.
        """
        ...

    def picture(self, width: int, height: int) -> NDArray[np.uint8]:
        """(height, width, 3) an overview of the scene, for people."""
        ...

    def close(self) -> None:
        """Let go of everything; harmless when repeated."""
        ...
