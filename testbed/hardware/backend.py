"""The physical backend: robots at the ends of cables and two cameras on a rig that pans, real or emulated.

It knows what boards and cameras say and nothing else. What it cannot know, how far a robot has come, it does not
pretend to know.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Morphology, Vector
from testbed.errors import UserError
from testbed.hardware.clock import Clock
from testbed.hardware.failures import HardwareFailure
from testbed.hardware.prompt import Prompt, Question
from testbed.hardware.robots.robot import Robot, RobotState
from testbed.scenario import Scenario
from testbed.world.backend import Pair
from testbed.world.bullet import bodies_of
from testbed.world.placement import STUDENT, Placement, placements

_SETTLING = 1.0  # s; a robot that was put down rocks for less
_KEPT_STEPS = 64  # for which a pair of images may have been exposed: two seconds
_PATIENCE = 30  # late steps in a row that are borne


class Overrun(HardwareFailure):
    """The bench takes twice as long as a control step to hear all commands and to answer, again and again."""

    usual_mend = "lengthen world.control_step, or give each board a USB port of its own"


class Eyes(Protocol):
    """The stereo rig's cameras."""

    def look(self) -> Pair:
        """(2, 75, 100) luminosity: the newest pair."""
        ...

    @property
    def at(self) -> float:
        """When that pair was exposed, s on the clock."""
        ...

    def picture(self) -> NDArray[np.uint8]:
        """(H, W, 3) both cameras' newest images side by side, for people."""
        ...

    def close(self) -> None:
        """Let go of the cameras; harmless when repeated."""
        ...


@dataclass
class Punctuality:
    """How well the control steps were kept.

    Attributes:
        steps: How many there were.
        late: How many took longer than they should.
        worst: By how much the worst was late, s.
    """

    steps: int = 0
    late: int = 0
    worst: float = 0.0


class HardwareBackend:
    """A :class:`~testbed.world.backend.Backend` of robots on a bench.

    Args:
        scenario: Who stands where; nothing left to chance.
        robots: By agent.
        rig: The board that pans the cameras.
        eyes: The cameras.
        clock: The bench's.
        prompt: Asks the person at the bench to put the robots in place.

    Attributes:
        punctuality: How well the control steps were kept.

    Raises:
        UserError: If the scenario has something that no bench can do.
    """

    def __init__(
        self,
        scenario: Scenario,
        robots: Mapping[str, Robot],
        rig: Robot,
        eyes: Eyes,
        clock: Clock,
        prompt: Prompt,
    ) -> None:
        refuse_what_no_bench_does(scenario)
        self._scenario, self._robots = scenario, bodies_of(scenario)
        missing = self._robots.keys() - robots.keys()
        if missing:
            raise UserError(f"the bench has no robot for {min(missing)}", "add its board to the bench file")
        self._boards = {name: robots[name] for name in self._robots}
        self._rig, self._eyes, self._clock, self._prompt = rig, eyes, clock, prompt
        self._control_step = scenario.world.control_step
        self._steps_per_frame = max(1, round(1 / (scenario.rig.camera_rate * self._control_step)))
        self._pan_limit = math.radians(scenario.rig.pan_limit_deg)
        self._states: dict[str, RobotState] = {}
        self._commands: dict[str, Vector] = {}
        self._pan_step = math.radians(scenario.rig.pan_speed_deg) * self._control_step
        self._pan = 0.0
        self.punctuality = Punctuality()

    @property
    def robots(self) -> Mapping[str, Morphology]:
        """See :class:`Backend`."""
        return self._robots

    @property
    def pan(self) -> float:
        """See :class:`Backend`: where its board says that it sends its servo."""
        return self._pan

    @property
    def exposed(self) -> int:
        """See :class:`Backend`."""
        return self._exposed

    def reset(self, seeds: np.random.SeedSequence) -> None:
        """See :class:`Backend`. What happens on a bench is not drawn from seeds."""
        for board in (*self._boards.values(), self._rig):
            board.connect()  # limp: whoever puts a robot down does not fight its servos
            board.configure()
        self._put_in_place()
        self._commands = {name: body.rest for name, body in self._robots.items()}
        self._aim = 0.0
        for board in (*self._boards.values(), self._rig):
            board.arm()
        self.keep()
        self._pass(_SETTLING)
        self._step, self._late_in_a_row = 0, 0
        self._states = {name: board.observe() for name, board in self._boards.items()}
        self._before, self._turned = self._states[STUDENT].applied, 0.0
        self._ends = [self._clock.now()]
        self._frame: tuple[int, Pair] | None = None
        self._exposed = 0
        self._due = self._clock.now()
        self.punctuality = Punctuality()

    def apply(self, commands: Mapping[str, Vector], pan: float) -> None:
        """See :class:`Backend`.

        Raises:
            Overrun: If the bench takes twice as long as the control step, again and again.
            HardwareFailure: If anything on the bench fails.
        """
        now = self._clock.now()
        # A little late is made up for; whoever thinks for longer does not make the bench late.
        begun = self._due if now - self._due < self._control_step else now
        self._due = begun + self._control_step
        self._commands = {**self._commands, **commands}
        way = float(np.clip(pan, -self._pan_limit, self._pan_limit)) - self._aim
        self._aim += float(np.clip(way, -self._pan_step, self._pan_step))  # its servo could turn faster
        self.keep()
        self._watch_the_time()
        self._clock.sleep(self._due - self._clock.now())
        # The student's own senses are asked for at the end of the step; of the others what they said at its beginning.
        self._states[STUDENT] = self._boards[STUDENT].observe()
        applied = self._states[STUDENT].applied
        self._turned = float(np.abs(applied - self._before).max(initial=0.0)) / self._control_step
        self._before = applied
        self._step += 1
        self._ends = [*self._ends[-_KEPT_STEPS:], self._clock.now()]

    def keep(self) -> None:
        """Tell everybody again what they were told last, or they take the silence for a broken cable.

        Before the reset nobody is armed, as in a trial that is told again from its journal: there is nothing to keep.
        """
        if not self._commands:
            return
        for name, board in self._boards.items():
            self._states[name] = board.act(self._commands[name])
        self._pan = float(self._rig.act(np.array([self._aim])).targets[0])

    def tilt(self, robot: str) -> Vector:
        """See :class:`Backend`."""
        tilt = self._states[robot].tilt
        assert tilt is not None, "a robot is not armed without its tilt calibration"
        return tilt

    def progress(self, robot: str) -> float:
        """See :class:`Backend`; unknown."""
        return 0.0

    def movement(self, robot: str) -> float:
        """See :class:`Backend`; how fast the student's servos were told to turn."""
        return self._turned if robot == STUDENT else 0.0

    def look(self, wanted: bool = True) -> Pair:
        """See :class:`Backend`. A new pair at the scenario's rate, which may be less than the cameras'."""
        frame = self._step // self._steps_per_frame
        if self._frame is None or self._frame[0] != frame:
            self._frame = frame, self._eyes.look()
            gaps = np.abs(np.array(self._ends) - self._eyes.at)
            self._exposed = max(0, self._step - len(gaps) + 1 + int(np.argmin(gaps)))
        return self._frame[1]

    def picture(self, width: int, height: int) -> NDArray[np.uint8]:
        """See :class:`Backend`; what both cameras see, for there is no third."""
        seen = self._eyes.picture()
        shrunk = cv2.resize(seen, (width, height * width // max(1, width)), interpolation=cv2.INTER_AREA)
        return np.asarray(shrunk, dtype=np.uint8)

    def close(self) -> None:
        """See :class:`Backend`; everybody is limp."""
        for board in (*self._boards.values(), self._rig):
            with contextlib.suppress(HardwareFailure):
                board.disconnect()
        self._eyes.close()

    def _pass(self, seconds: float) -> None:
        """Let time pass while everybody stays where they are."""
        until = self._clock.now() + seconds
        while self._clock.now() < until:
            self._clock.sleep(min(self._control_step, until - self._clock.now()))
            self.keep()

    def _put_in_place(self) -> None:
        spots = placements(self._scenario, self._robots)
        for name, spot in spots.items():
            details = {"x": spot.place[0], "y": spot.place[1], "yaw_deg": math.degrees(spot.yaw)}
            self._prompt(Question("place", name, _where(name, self._robots[name], spot), details))

    def _watch_the_time(self) -> None:
        late = self._clock.now() - self._due
        kept = self.punctuality
        kept.steps += 1
        if late <= 0:
            self._late_in_a_row = 0
            return
        kept.late += 1
        kept.worst = max(kept.worst, late)
        self._late_in_a_row = self._late_in_a_row + 1 if late > self._control_step else 0
        if self._late_in_a_row >= _PATIENCE:
            took = f"{(late + self._control_step) * 1e3:.0f} ms"
            raise Overrun(f"control steps of {self._control_step * 1e3:.0f} ms take {took} on this bench")


def refuse_what_no_bench_does(scenario: Scenario) -> None:
    """Look for what a scenario has that only a simulation can do.

    Raises:
        UserError: For the first such thing.
    """
    mend = "use --backend simulation, or take it out of the scenario"
    for index, teacher in enumerate(scenario.teachers):
        if teacher.gait.kind == "push":
            raise scenario.source.error(
                ("teachers", index, "gait"), "nobody pushes teachers on a bench", mend
            )
        if teacher.away:
            raise scenario.source.error(("teachers", index, "away"), "teachers do not leave a bench", mend)
    if scenario.student.damage is not None:
        raise scenario.source.error(("student", "damage"), "nothing is broken on purpose on a bench", mend)


def _where(name: str, body: Morphology, spot: Placement) -> str:
    x, y = (round(100 * metres) for metres in spot.place)
    aside = f"{abs(x)} cm to the {'right' if x > 0 else 'left'}" if x else "straight"
    depth = f"{abs(y)} cm {'in front of' if y > 0 else 'behind'} the rig's post"
    return (
        f"Put {name} ('{body.name}') flat, its main body's middle {aside} and {depth}, its x axis turned "
        f"{math.degrees(spot.yaw):.0f} degrees counter-clockwise from the rig's right; then press Enter."
    )
