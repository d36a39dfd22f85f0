"""Looking over a board: does it answer, is it the right one, is its sensor sane, how clean is its line?

Nothing is armed and nothing moves.
"""

from __future__ import annotations

import grp
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from testbed.bodies.parts import Vector
from testbed.hardware.calibration.records import (
    ServoCalibration,
    TiltCalibration,
    load_servos,
    load_tilt,
    tilt_from,
)
from testbed.hardware.clock import Clock
from testbed.hardware.doctor.checks import Check, Outcome, checked, failed, passed, skipped
from testbed.hardware.failures import (
    HardwareFailure,
    ImuMissing,
    ImuStuck,
    LinkLost,
    PortDenied,
    Stopped,
    TiltImplausible,
    WrongFirmware,
)
from testbed.hardware.line.handshake import find_board, reset_cause, shake_hands
from testbed.hardware.line.link import Link
from testbed.hardware.line.ports import found_ports, open_port
from testbed.hardware.line.protocol import NO_IMU_AGE, Flags, Identity, Request, State
from testbed.hardware.robots.board import Address

READS = 300
"""So many exchanges tell a line that loses 1% of them from one that loses none (95%)."""
MOST_RETRIES = 0.02
"""Of the exchanges on a good cable none is repeated; 2% still leave one lost command in 10**8."""
_COUNTS_PER_G = 16384.0
AT_REST = (0.8, 1.2)
"""g: what a calibrated sensor at rest feels."""


def machine_checks(globs: tuple[str, ...]) -> Iterator[Check]:
    """Whether there are serial ports, and whether this user may open them."""
    ports = found_ports(globs)
    yield (
        passed("this machine", "serial ports", f"{len(ports)} found")
        if ports
        else skipped("this machine", "serial ports", "none found")
    )
    yield checked("this machine", "permissions", lambda: _allowed([port.path for port in ports]))


def _allowed(paths: list[str]) -> str:
    denied = [path for path in paths if not os.access(path, os.R_OK | os.W_OK)]
    if not denied:
        return f"all {len(paths)} ports may be opened" if paths else "no port to open"
    group = _group_of(denied[0])
    mend = f"sudo adduser $USER {group}, then log in again" if group else None
    raise PortDenied(f"this user may not open {', '.join(denied)}", mend)


def _group_of(path: str) -> str | None:
    """The group that may open a port, which on Debian is dialout."""
    try:
        status = Path(path).stat()
        if status.st_mode & (stat.S_IRGRP | stat.S_IWGRP):
            return grp.getgrgid(status.st_gid).gr_name
    except (OSError, KeyError):
        pass
    return None


class BoardDoctor:
    """Looks one board over.

    Args:
        address: Which board.
        clock: The bench's.
        calibrations: The folder of calibrations.
        imu: Whether it should have a tilt sensor.
        servos: Whether it moves servos; one of build B only feels.
        reads: How many exchanges the line is judged by.
    """

    def __init__(
        self,
        address: Address,
        clock: Clock,
        calibrations: Path,
        *,
        imu: bool,
        servos: bool = True,
        reads: int = READS,
    ) -> None:
        self._address, self._clock, self._folder = address, clock, calibrations
        self._has_imu, self._has_servos, self._reads = imu, servos, reads
        self._name = address.name

    def checks(self) -> Iterator[Check]:
        """One after the other; the first that makes the others pointless is the last."""
        name = self._name
        address = self._address
        try:
            path = address.port
            if path is None:
                path = find_board(str(address.unique_id), self._clock, address.globs, name=name).path
            port = open_port(path)
        except HardwareFailure as failure:
            yield failed(name, "port", failure)
            return
        link = Link(port, self._clock, name=name)
        yield passed(name, "port", link.path)
        try:
            yield from self._of(link)
        finally:
            link.close()

    def _of(self, link: Link) -> Iterator[Check]:
        try:
            identity = shake_hands(link, self._clock)
        except HardwareFailure as failure:
            yield failed(self._name, "firmware", failure)
            return
        yield self._identified(identity)
        states: list[State] = []
        line = checked(self._name, "line", lambda: self._line(link, states))
        if not states:
            yield line
            return
        yield checked(self._name, "emergency stop", lambda: _not_stopped(self._name, states[0], identity))
        yield line
        if self._has_imu:
            yield from self._sensor(identity, states)
        if self._has_servos:
            yield checked(self._name, "servo calibration", lambda: self._servos(identity))

    def _identified(self, identity: Identity) -> Check:
        version = ".".join(map(str, identity.firmware))
        found = (
            f"'{identity.board_id}', {identity.unique_id}, firmware {version}, protocol {identity.protocol}"
        )
        wanted = self._address.unique_id
        if wanted is not None and len(wanted) == len(identity.unique_id) and wanted != identity.unique_id:
            return Check(
                self._name,
                "firmware",
                Outcome.FAILED,
                f"{found} answers, not {wanted}",
                "check which cable is which; 'testbed hardware find' lists the boards by name",
                "WrongBoard",
            )
        return passed(self._name, "firmware", found)

    def _line(self, link: Link, states: list[State]) -> str:
        before = link.statistics.retries
        for _ in range(self._reads):
            try:
                states.append(State.decode(link.request(Request.READ).body))
            except ValueError as error:
                raise WrongFirmware(f"it replies what is no state ({error})") from None
        retries = link.statistics.retries - before
        times = np.array(link.statistics.times)[-self._reads :]
        first, last = states[0].counters, states[-1].counters
        heard = sum(later - sooner for sooner, later in zip(first[:3], last[:3], strict=True))
        found = (
            f"{self._reads} reads, {retries} repeated, {link.statistics.late} late, "
            f"{link.statistics.crc + link.statistics.framing} garbled here, {heard} there; "
            f"{1000 * np.median(times):.1f} ms, {1000 * np.quantile(times, 0.99):.1f} ms at worst of a hundred"
        )
        if retries > MOST_RETRIES * self._reads:
            mend = "use a shorter USB cable, away from the servos' wires; give the servos their own supply"
            raise LinkLost(f"a bad line: {found}", mend)
        return found

    def _sensor(self, identity: Identity, states: list[State]) -> Iterator[Check]:
        name, last = self._name, states[-1]
        try:
            if not identity.imu or last.flags & Flags.IMU_MISSING or last.imu_age_ms == NO_IMU_AGE:
                raise ImuMissing("the tilt sensor does not answer")
            if last.flags & Flags.IMU_STUCK:
                raise ImuStuck("the tilt sensor repeats one reading to the bit")
        except HardwareFailure as failure:
            yield failed(name, "tilt sensor", failure)
            return
        counts = np.array([state.acceleration for state in states], dtype=float)
        noise = float(counts.std(axis=0).max()) / _COUNTS_PER_G
        yield passed(name, "tilt sensor", f"WHO_AM_I {identity.imu:#x}, noise {1000 * noise:.1f} mg")
        yield checked(name, "tilt calibration", lambda: self._tilt(identity, counts.mean(axis=0)))

    def _tilt(self, identity: Identity, counts: Vector) -> str:
        calibration = load_tilt(self._folder, identity.unique_id, identity.board_id)
        up = calibration.acceleration(counts.tolist())
        size = float(np.linalg.norm(up))
        side, nose = np.degrees(tilt_from(up))
        found = (
            f"{_age(calibration)}, residual {calibration.residual_deg:.2f}°; now {size:.3f} g, "
            f"{side:+.1f}° to the side, {nose:+.1f}° nose-down"
        )
        if not AT_REST[0] <= size <= AT_REST[1]:
            raise TiltImplausible(f"at rest it feels {size:.2f} g instead of 1 ({found})")
        return found

    def _servos(self, identity: Identity) -> str:
        return servos_in_words(load_servos(self._folder, identity.unique_id, identity.board_id))


def servos_in_words(calibration: ServoCalibration) -> str:
    """How old a servo calibration is, and how far its joints may turn."""
    joints = ", ".join(
        f"{name} {joint.low_deg:.0f} to {joint.high_deg:.0f}°" for name, joint in calibration.joints.items()
    )
    return f"{_age(calibration)}; {joints}"


def _not_stopped(name: str, state: State, identity: Identity) -> str:
    if state.flags & Flags.STOPPED:
        raise Stopped(f"the emergency stop of {name} is latched")
    latched = [
        words
        for flag, words in ((Flags.LATCHED_LIMP, "had gone limp"), (Flags.LATCHED_HELD, "had held still"))
        if state.flags & flag
    ]
    armed = "armed!" if state.flags & Flags.ARMED else "disarmed"
    return ", ".join([armed, *latched, f"last boot by {reset_cause(identity)}"])


def _age(calibration: ServoCalibration | TiltCalibration) -> str:
    return "made today" if calibration.age < 1 else f"{calibration.age:.0f} days old"
