"""The hands of an emulated bench: they do what a person at the bench is asked to do, and read what a person reads."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from testbed.bodies.morphology import Vector
from testbed.errors import UserError
from testbed.hardware.bench_file import RIG
from testbed.hardware.calibration.charuco import CharucoSpec
from testbed.hardware.calibration.tilt import ORIENTATIONS
from testbed.hardware.emulation.bench import EmulatedBench
from testbed.hardware.emulation.poses import held, held_about
from testbed.hardware.emulation.scenes import BoardScene
from testbed.hardware.prompt import Question, nothing

_TAKES = 0.6
"""s from a question to its answer: robots have come to rest by then."""
_MEANWHILE = 0.1
_ASKEW_DEG = 0.3
"""Standard deviation of how a table stands and a box is laid on it, about each axis."""
_UNSTEADY_DEG = 3.0
"""Likewise of how a board is held up."""
_READ_TO_DEG = 0.5
"""As fine as a protractor is read."""


class Hands:
    """A :class:`~testbed.hardware.prompt.Prompt`.

    Args:
        bench: Where they are.
        board: The calibration board that they hold up.
        seed: Of how unsteady they are.
    """

    def __init__(self, bench: EmulatedBench, board: CharucoSpec | None = None, *, seed: int = 0) -> None:
        self._bench, self._board = bench, board or CharucoSpec()
        self._chance = np.random.default_rng([seed, 1])
        self._poses = self._any_pose()
        self._does: Mapping[str, Callable[[Question, Callable[[], None]], str]] = {
            "place": self._place,
            "tilt": self._tilt,
            "servo_angle": self._servo_angle,
            "servo_nudge": self._servo_nudge,
            "board": self._show_board,
            "board_away": self._board_away,
        }

    def __call__(self, question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        """See :class:`~testbed.hardware.prompt.Prompt`.

        Raises:
            UserError: If they do not know how to do it.
        """
        if question.kind not in self._does:
            raise UserError(
                f"the hands of an emulated bench cannot do '{question.kind}'", "do it on a real bench"
            )
        return self._does[question.kind](question, meanwhile)

    def _wait(self, meanwhile: Callable[[], None], seconds: float = _TAKES) -> None:
        for _ in range(round(seconds / _MEANWHILE)):
            self._bench.sleep(_MEANWHILE)
            meanwhile()

    def _place(self, question: Question, meanwhile: Callable[[], None]) -> str:
        """Everybody's place is the scenario's."""
        self._bench.put_back(question.about)
        self._wait(meanwhile, _MEANWHILE)
        return ""

    def _tilt(self, question: Question, meanwhile: Callable[[], None]) -> str:
        up = np.array(ORIENTATIONS[str(question.details["orientation"])])
        askew = Rotation.from_rotvec(self._chance.normal(0, math.radians(_ASKEW_DEG), 3))
        self._bench.held[question.about] = (askew * _upright(up)).as_quat()
        self._wait(meanwhile)
        return ""

    def _servo_angle(self, question: Question, meanwhile: Callable[[], None]) -> str:
        """A robot's limbs hang free while they are measured."""
        if question.about != RIG:
            self._bench.held.setdefault(question.about, np.array([0.0, 0.0, 0.0, 1.0]))
        self._wait(meanwhile)
        read = math.degrees(self._angle(question)) / _READ_TO_DEG
        return f"{round(read) * _READ_TO_DEG:g}"

    def _servo_nudge(self, question: Question, meanwhile: Callable[[], None]) -> str:
        details = question.details
        if question.about != RIG:
            self._bench.held.setdefault(question.about, np.array([0.0, 0.0, 0.0, 1.0]))
        self._wait(meanwhile)
        joint = self._channel(question)
        servo = self._bench.boards[question.about].servos.servos[joint]
        missing = servo.width(math.radians(float(details["angle_deg"]))) - float(details["pulse_us"])
        return str(round(missing / float(details["step_us"])))

    def _show_board(self, question: Question, meanwhile: Callable[[], None]) -> str:
        """As the question says, or some other way than last time."""
        details = question.details
        if "distance" in details:
            x, y = (math.radians(float(details.get(f"lean_{axis}_deg", 0))) for axis in "xy")
            turn = (x, y, 0.0)
            if "upright" not in details:  # nobody holds it quite as they were told
                x, y, z = (self._chance.normal(0, math.radians(_UNSTEADY_DEG), 3) + turn).tolist()
                turn = (x, y, z)
            pose = held(
                self._board,
                u=float(details["u"]),
                v=float(details["v"]),
                distance=float(details["distance"]),
                turn=turn,
            )
        else:
            pose = next(self._poses)
        for camera in self._bench.cameras:
            camera.scene = BoardScene(self._board, pose)
        self._wait(meanwhile)
        return ""

    def _board_away(self, question: Question, meanwhile: Callable[[], None]) -> str:
        for camera in self._bench.cameras:
            camera.scene = self._bench.scene
        self._wait(meanwhile)
        return ""

    def _any_pose(self) -> Iterator[Vector]:
        return itertools.chain.from_iterable(held_about(self._board, self._chance) for _ in itertools.count())

    def _channel(self, question: Question) -> int:
        if question.about == RIG:
            return 0
        return list(self._bench.bodies[question.about].joints).index(str(question.details["joint"]))

    def _angle(self, question: Question) -> float:
        if question.about == RIG:
            return self._bench.pan
        return float(self._bench.simulation.joints(question.about)[self._channel(question)])


def _upright(up: Vector) -> Rotation:
    """A turn of the body after which this direction (3,) of its own points up."""
    return Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])[0]
