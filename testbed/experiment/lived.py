"""A world whose every step is written down, and told again instead of being lived again.

What a trial on a bench cannot go on with (a cable, a brown-out, a camera) ends it in the middle. All that the student
met until then is in the journal; a student that is made anew and meets it again does the same to the bit, and goes on
with the live world from there. So nothing of what a robot has done is lost, and a trial can be studied without it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Morphology, Vector
from testbed.errors import UserError
from testbed.experiment.stage import Truth
from testbed.hardware.journal import Places, Step
from testbed.world.backend import Backend, Pair
from testbed.world.placement import STUDENT

_POSTURE_TIME = 1.5
"""s; how long robots that were put in place again are given to take the posture in which they were left."""


class EndOfRecordError(Exception):
    """There is nothing more to be told again, and no live world to go on with."""


class Lived:
    """A :class:`~testbed.world.backend.Backend` that tells again what was lived before, and then goes on living.

    Attributes:
        put_back: The steps after which everybody was put in place again.

    Args:
        robots: The bodies by agent name.
        told: The steps that were lived before.
        live: The world to go on with; None to stop where the record ends.
        truth: Who knows how everybody really is in the live world.
        write: Told every new step.
        known: By step, where everybody really was when it was lived before.
        know: Told where everybody really is after every new step, if somebody knows.
        put_back: The told steps after which everybody had been put in place again.
        resumed: Told from which step on the live world takes over, before it does.
        broke_off: Told which step could not be finished, and what was commanded in it.
        control_step: In s.
        now: The live world's clock, s; control steps are counted if not given.
        name: What the record is called in messages.
    """

    def __init__(
        self,
        robots: Mapping[str, Morphology],
        told: Sequence[Step] = (),
        *,
        live: Backend | None,
        truth: Truth | None = None,
        control_step: float,
        now: Callable[[], float] | None = None,
        write: Callable[[Step], None] = lambda step: None,
        known: Mapping[int, Places] = MappingProxyType({}),
        know: Callable[[Places], None] = lambda places: None,
        put_back: Sequence[int] = (),
        resumed: Callable[[int], None] = lambda number: None,
        broke_off: Callable[[int, Mapping[str, Vector], float], None] = lambda number, commands, pan: None,
        name: str = "the record",
    ) -> None:
        self._robots, self._told, self._live, self._name = robots, tuple(told), live, name
        self._truth, self._known, self._know = truth, known, know
        self.put_back = [step for step in put_back if step < len(told) - 1]
        self._write, self._resumed, self._broke_off = write, resumed, broke_off
        self._control_step, self._clock = control_step, now
        self._posture_steps = round(_POSTURE_TIME / control_step)
        self._pair: Pair | None = None
        self._reliving = False

    @property
    def robots(self) -> Mapping[str, Morphology]:
        """See :class:`Backend`."""
        return self._robots

    @property
    def pan(self) -> float:
        """See :class:`Backend`."""
        return self._now.pan

    @property
    def exposed(self) -> int:
        """See :class:`Backend`."""
        return self._now.exposed

    def reset(self, seeds: np.random.SeedSequence) -> None:
        """See :class:`Backend`; the live world is left alone as long as there is something to tell again."""
        self._seeds, self._pair, self._ahead = seeds, None, 0
        self._reliving = bool(self._told)
        if self._reliving:
            self._tell(self._told[0])
        else:
            self._living().reset(seeds)
            self._experience(0, {}, 0.0)

    def apply(self, commands: Mapping[str, Vector], pan: float) -> None:
        """See :class:`Backend`.

        Raises:
            UserError: If somebody does not do what it did at that step before.
        """
        number = self._now.number + 1
        if number < len(self._told):
            self._compare(self._told[number], commands, pan)
            self._tell(self._told[number])
            return
        if self._reliving:
            self._take_over()
        try:
            self._living().apply(commands, pan)
            self._experience(number, commands, pan)
        except UserError:
            self._broke_off(number, commands, pan)
            raise

    def tilt(self, robot: str) -> Vector:
        """See :class:`Backend`."""
        return self._now.tilts[robot]

    def progress(self, robot: str) -> float:
        """See :class:`Backend`."""
        return 0.0 if self._reliving else self._living().progress(robot)

    def movement(self, robot: str) -> float:
        """See :class:`Backend`."""
        return self._now.movement if robot == STUDENT else 0.0

    def look(self, wanted: bool = True) -> Pair:
        """See :class:`Backend`."""
        assert self._pair is not None, "a world is reset before anybody looks"
        return self._pair

    def state(self, robot: str) -> tuple[Vector, Vector] | None:
        """See :class:`Truth`; of what is told again it is as known as it was then."""
        if self._truth is None:
            return None
        if self._reliving:
            then = self._known.get(self._now.number)
            return then.states.get(robot) if then is not None else None
        return self._truth.state(robot)

    def picture(self, width: int, height: int) -> NDArray[np.uint8]:
        """See :class:`Backend`."""
        return self._living().picture(width, height)

    def close(self) -> None:
        """See :class:`Backend`."""
        if self._live is not None:
            self._live.close()

    def _living(self) -> Backend:
        if self._live is None:
            raise EndOfRecordError
        return self._live

    def _take_over(self) -> None:
        """Everybody is put in place again and takes the posture of the last step that is told."""
        live, last = self._living(), self._now
        self._resumed(last.number)
        self.put_back.append(last.number)
        self._reliving = False
        live.reset(self._seeds)
        self._ahead = last.number  # of the live world, which counts its steps from its own reset
        if last.commands:
            for _ in range(self._posture_steps):
                live.apply(last.commands, last.pan_command)
            self._ahead -= self._posture_steps

    def _tell(self, step: Step) -> None:
        self._now = step
        if step.images is not None:
            self._pair = step.images

    def _experience(self, number: int, commands: Mapping[str, Vector], pan: float) -> None:
        live = self._living()
        pair = live.look()
        new = self._pair is None or not np.array_equal(pair, self._pair)
        self._tell(
            Step(
                number=number,
                at=self._clock() if self._clock is not None else number * self._control_step,
                commands={name: np.array(targets, dtype=float) for name, targets in commands.items()},
                pan_command=pan,
                pan=live.pan,
                tilts={name: live.tilt(name) for name in self._robots},
                movement=live.movement(STUDENT),
                exposed=max(0, live.exposed + self._ahead),
                images=pair.copy() if new else None,
            )
        )
        self._write(self._now)
        states = {name: state for name in self._robots if (state := self.state(name)) is not None}
        if states:
            self._know(Places(self._now.at, number, states))

    def _compare(self, then: Step, commands: Mapping[str, Vector], pan: float) -> None:
        for name, targets in then.commands.items():
            same = np.array_equal(targets, commands[name])
            if not same or (name == STUDENT and pan != then.pan_command):
                raise UserError(
                    f"{self._name}: {name} does not do at step {then.number} what it did when the trial was lived",
                    "use the versions that provenance.json names, or delete the journal and begin the trial anew",
                )


def resting_place(told: Sequence[Step], robots: Mapping[str, Morphology]) -> int:
    """How many of these steps to tell again before a broken-off trial goes on.

    All up to the last one in which every teacher was told to lie flat: what the student watched when the trial broke
    off is watched again from the beginning, for robots are put in place again in between.
    """
    rests = {name: body.rest for name, body in robots.items() if name != STUDENT}
    for step in reversed(told):
        if all(np.array_equal(step.commands.get(name, rest), rest) for name, rest in rests.items()):
            return step.number + 1
    return 0
