"""Where a trial takes place: a world for the student, and perhaps somebody who knows the truth about it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, TypeAlias, TypeVar

from testbed.bodies.morphology import Vector
from testbed.scenario import Scenario
from testbed.world.backend import Backend
from testbed.world.bullet import SimulatedBackend

if TYPE_CHECKING:
    from testbed.hardware.journal import Journal

T = TypeVar("T")


class Truth(Protocol):
    """Somebody who knows; the witness asks, and no agent ever does."""

    def state(self, robot: str) -> tuple[Vector, Vector] | None:
        """A robot's base (7,), position (m) and quaternion of its root, and its joint angles (rad); None: unknown."""
        ...


class Stage(Protocol):
    """A world that is ready for one trial."""

    @property
    def backend(self) -> Backend:
        """The world."""
        ...

    @property
    def truth(self) -> Truth | None:
        """Who knows how everybody really is; nobody does on a real bench."""
        ...

    @property
    def now(self) -> Callable[[], float] | None:
        """Its clock (s), if it has one."""
        ...

    def think(self, thought: Callable[[], T]) -> T:
        """The outcome of a thought, and what the world needs while it is thought."""
        ...

    def close(self) -> None:
        """Let go of everything; harmless when repeated."""
        ...


Opener: TypeAlias = "Callable[[Scenario, Journal | None], Stage]"
"""Opens a stage for a trial's own scenario; what goes over its wires goes into the journal."""


class SimulatedStage:
    """The simulated world, which waits while the student thinks and hides nothing from the witness."""

    def __init__(self, scenario: Scenario) -> None:
        self.backend = SimulatedBackend(scenario)
        self.truth = self.backend
        self.now = None

    def think(self, thought: Callable[[], T]) -> T:
        """See :class:`Stage`."""
        return thought()

    def close(self) -> None:
        """See :class:`Stage`."""
        self.backend.close()


def simulated(scenario: Scenario, journal: Journal | None = None) -> Stage:
    """The :data:`Opener` of the simulation, which has no wires."""
    return SimulatedStage(scenario)
