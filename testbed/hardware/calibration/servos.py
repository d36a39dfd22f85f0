"""Finding out which pulse turns a servo where.

Each servo is brought to some pulses and a person reads the angle off a protractor; or the person brings the joint to
known angles by saying how much further it has to turn. Either way there are pairs of pulse and angle, and a line
through them. Marks that lie on no plausible line are refused: a servo that is driven by a wrong line breaks itself.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbed.bodies.parts import Vector
from testbed.errors import UserError
from testbed.hardware.calibration.records import JointCalibration, ServoCalibration, today
from testbed.hardware.line.protocol import Flags
from testbed.hardware.prompt import Prompt, Question
from testbed.hardware.robots.board import Board
from testbed.hardware.robots.feetech import FeetechRobot

_BY_HAND_DEG = (0.0, -45.0, 45.0)

Mark = tuple[float, float]
"""Pulse (us) and angle (rad)."""


@dataclass(frozen=True, kw_only=True)
class ServoFitSpec:
    """Which servos are believed, and how they are measured.

    Attributes:
        least_us_per_rad: A servo that turns 270 degrees in 2000 us has 424; less is a misread angle ...
        most_us_per_rad: ... and so is more: 180 degrees in 2000 us are 637, the smallest servos have 950.
        usual_centre_us: Where a joint is meant to lie flat.
        most_off_centre_us: The horn's splines are 14 degrees apart, 70 us to either side; beyond 400 the horn is on
            wrong.
        most_residual_deg: rms; a protractor is read to 2.
        least_span_deg: Marks nearer together say little about the slope.
        pulses_us: Where the servo is brought to: far from both ends, so that no servo reaches a stop.
        nearest_us: Hard limits of the firmware ...
        farthest_us: ... which no calibration goes beyond.
        slew_us: Change in 20 ms while calibrating: slow enough to pull one's fingers out.
        settle: Seconds until a servo stands still at its last pulse.
        nudge_us: One step of the nudging way.
    """

    least_us_per_rad: float = 350.0
    most_us_per_rad: float = 1200.0
    usual_centre_us: float = 1500.0
    most_off_centre_us: float = 400.0
    most_residual_deg: float = 3.0
    least_span_deg: float = 30.0
    pulses_us: tuple[float, ...] = (1500.0, 1250.0, 1000.0, 1750.0, 2000.0)
    nearest_us: float = 500.0
    farthest_us: float = 2500.0
    slew_us: float = 10.0
    settle: float = 0.5
    nudge_us: float = 10.0


BUS_SERVOS = ServoFitSpec(
    least_us_per_rad=620.0,  # 4096 ticks to a turn are 652 to a rad
    most_us_per_rad=685.0,
    usual_centre_us=2048.0,
    most_off_centre_us=900.0,  # so that 90 degrees to either side remain before the turn's end
    nearest_us=0.0,
    farthest_us=4095.0,
)
"""The same for bus servos, with ticks in place of microseconds."""


def fit_joint(
    name: str, marks: Sequence[Mark], limits_deg: tuple[float, float], spec: ServoFitSpec | None = None
) -> JointCalibration:
    """The line through marks, by least squares.

    Args:
        name: The joint, for messages.
        marks: At least three.
        limits_deg: How far the body's joint may turn; less where the servo's pulses end before.
        spec: Which servos are believed.

    Raises:
        UserError: If the marks are too few, too near together, on no line, or on a line that is no servo's.
    """
    spec = spec or ServoFitSpec()
    mend = "look at the horn and read the angles again: 0 lies flat, positive is downward"
    pulses, angles = np.array(marks, dtype=float).reshape(-1, 2).T
    if len(marks) < 3 or not np.isfinite(angles).all():
        raise UserError(f"joint '{name}': at least three marks are needed", mend)
    span = math.degrees(np.ptp(angles))
    if span < spec.least_span_deg or np.ptp(pulses) == 0:
        raise UserError(f"joint '{name}': the angles are all within {span:.0f} degrees", mend)
    # Pulses are exact and angles are read: the line is fitted to the angles.
    rad_per_us, offset = np.polyfit(pulses - pulses.mean(), angles, 1)
    if rad_per_us == 0:
        raise UserError(f"joint '{name}' does not turn with its pulse", mend)
    slope = float(1 / rad_per_us)
    centre = float(pulses.mean() - offset * slope)
    off = np.degrees(angles - (pulses - centre) / slope)
    residual = float(np.sqrt(np.mean(off**2)))
    if residual > spec.most_residual_deg:
        worst = int(np.abs(off).argmax())
        where = f"worst at {pulses[worst]:.0f}: {off[worst]:+.1f} degrees off"
        raise UserError(
            f"joint '{name}': the marks lie on no line, {residual:.1f} degrees rms, {where}", mend
        )
    if not spec.least_us_per_rad <= abs(slope) <= spec.most_us_per_rad:
        raise UserError(
            f"joint '{name}': {abs(slope) * math.pi / 180:.1f} us a degree is no servo's gain", mend
        )
    if abs(centre - spec.usual_centre_us) > spec.most_off_centre_us:
        raise UserError(f"joint '{name}' would lie flat at {centre:.0f}", "put its horn on anew")
    low, high = _reachable(centre, slope, limits_deg, spec)
    return JointCalibration(
        centre_us=centre, us_per_rad=slope, low_deg=low, high_deg=high, residual_deg=residual
    )


def calibrate_servos(
    board: Board,
    limits_deg: Mapping[str, tuple[float, float]],
    prompt: Prompt,
    *,
    nudging: bool = False,
    spec: ServoFitSpec | None = None,
) -> ServoCalibration:
    """Go through a connected board's servos with a person.

    Args:
        board: Connected; it is limp afterwards.
        limits_deg: By joint, in the order of the board's channels: how far the body's joints may turn.
        prompt: Asks the person.
        nudging: Instead of reading angles, the person brings the joint to angles.
        spec: How it is done.

    Raises:
        UserError: If the answers make no sense, see :func:`fit_joint`.
        HardwareFailure: If the board fails.
    """
    spec = spec or ServoFitSpec()
    joints = list(limits_deg)
    ends = np.tile([spec.nearest_us, spec.farthest_us], (len(joints), 1))
    board.limit(ends, spec.slew_us)
    board.arm()
    found = {}
    try:
        driver = _Driver(board, np.full(len(joints), 1500.0), prompt, spec)
        for channel, joint in enumerate(joints):
            measured = driver.nudged if nudging else driver.read
            found[joint] = fit_joint(joint, measured(channel, joint), limits_deg[joint], spec)
    finally:
        with contextlib.suppress(UserError):  # what went wrong is told; its watchdog makes it limp
            board.limp()
    identity = board.identity
    return ServoCalibration(
        unique_id=identity.unique_id, board_id=identity.board_id, created=today(), joints=found
    )


def calibrate_bus(
    robot: FeetechRobot,
    limits_deg: Mapping[str, tuple[float, float]],
    prompt: Prompt,
    *,
    spec: ServoFitSpec = BUS_SERVOS,
) -> ServoCalibration:
    """Go through a robot of bus servos with a person, who turns the limp joints by hand; the servos say where they are.

    Args:
        robot: Connected, limp.
        limits_deg: By joint, in the robot's order.
        prompt: Asks the person.
        spec: Which servos are believed.

    Raises:
        UserError: See :func:`fit_joint`.
        HardwareFailure: If a servo fails.
    """
    found = {}
    for number, joint in enumerate(limits_deg):
        marks = []
        for goal in _BY_HAND_DEG:
            text = f"Turn {joint} of {robot.name} by hand to {goal:+.0f} degrees (0 flat, down positive), press Enter:"
            prompt(Question("servo_by_hand", robot.name, text, {"joint": joint, "angle_deg": goal}))
            marks.append((float(robot.positions()[number]), math.radians(goal)))
        found[joint] = fit_joint(joint, marks, limits_deg[joint], spec)
    return ServoCalibration(
        unit="ticks", unique_id=robot.unique_id, board_id=robot.name, created=today(), joints=found
    )


class _Driver:
    """Brings servos to pulses and asks."""

    def __init__(self, board: Board, pulses: Vector, prompt: Prompt, spec: ServoFitSpec) -> None:
        self._board, self._pulses, self._prompt, self._spec = board, pulses, prompt, spec

    def read(self, channel: int, joint: str) -> list[Mark]:
        """The person reads the angle at each of some pulses."""
        marks = []
        for pulse in self._spec.pulses_us:
            self._go(channel, pulse)
            text = f"{joint} at {pulse:.0f} us: how many degrees (0 flat, down positive)?"
            marks.append((pulse, math.radians(self._number("servo_angle", joint, text, {"pulse_us": pulse}))))
        self._go(channel, 1500.0)
        return marks

    def nudged(self, channel: int, joint: str) -> list[Mark]:
        """The person says, again and again, how far (deg, by eye) the joint still is from each of some angles."""
        marks = []
        for goal in _BY_HAND_DEG:
            while True:
                text = (
                    f"{joint} is to be at {goal:+.0f} degrees: how many steps of pulse more (0: it is there)?"
                )
                details = {
                    "angle_deg": goal,
                    "pulse_us": self._pulses[channel],
                    "step_us": self._spec.nudge_us,
                }
                steps = self._number("servo_nudge", joint, text, details)
                if steps == 0:
                    break
                wanted = self._pulses[channel] + steps * self._spec.nudge_us
                self._go(channel, float(np.clip(wanted, self._spec.nearest_us, self._spec.farthest_us)))
            marks.append((float(self._pulses[channel]), math.radians(goal)))
        self._go(channel, 1500.0)
        return marks

    def _go(self, channel: int, pulse: float) -> None:
        self._pulses[channel] = pulse
        while self._board.feed(self._pulses, 0.1).flags & Flags.SLEWING:
            pass
        self._board.feed(self._pulses, self._spec.settle)

    def _keep(self) -> None:
        self._board.drive(self._pulses)

    def _number(self, kind: str, joint: str, text: str, details: Mapping[str, float]) -> float:
        while True:
            question = Question(kind, self._board.name, text, {**details, "joint": joint})
            answer = self._prompt(question, self._keep)
            self._keep()
            try:
                number = float(answer.strip().removesuffix("°").replace(",", "."))
            except ValueError:
                number = math.nan
            if math.isfinite(number):
                return number
            text = f"'{answer}' is no number; {joint}?"


def _reachable(
    centre: float, slope: float, limits_deg: tuple[float, float], spec: ServoFitSpec
) -> tuple[float, float]:
    """The body's limits (deg), or as far as pulses go."""
    ends = sorted(math.degrees((pulse - centre) / slope) for pulse in (spec.nearest_us, spec.farthest_us))
    return max(limits_deg[0], ends[0]), min(limits_deg[1], ends[1])
