"""Calibrating everything on a bench, one device after the other, with whoever stands beside it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence

from testbed.bodies.morphology import load_robot
from testbed.errors import UserError, shown_path
from testbed.hardware.bench_file import PAN, RIG, BenchSpec
from testbed.hardware.calibration.records import ServoCalibration, save_calibration
from testbed.hardware.calibration.servos import calibrate_bus, calibrate_servos
from testbed.hardware.calibration.tilt import calibrate_tilt
from testbed.hardware.operating.workbench import Workbench, joints_of
from testbed.hardware.robots.board import Board
from testbed.hardware.robots.feetech import FeetechRobot

_PAN_LIMIT = 90.0
"""Degrees to either side; scenarios may ask for less."""


def calibrate_robots_servos(
    place: Workbench, agents: Sequence[str] = (), *, nudging: bool = False
) -> Iterator[tuple[str, str]]:
    """Calibrate servos; yields an agent and what came of it, one after the other.

    Args:
        place: The bench.
        agents: Whose; everybody's if none is named.
        nudging: See :func:`~testbed.hardware.calibration.servos.calibrate_servos`.

    Raises:
        UserError: As that function does; what was calibrated before is kept.
    """
    for agent in _chosen(place.spec, agents, rig=True):
        limits = limits_deg(place.spec, agent)
        if place.spec.board(agent).build == "feetech":
            found = _bus_servos(place, agent, limits)
        else:
            with Board(place.address(agent), len(limits), place.clock) as board:
                board.connect()
                found = calibrate_servos(board, limits, place.prompt, nudging=nudging)
        file = save_calibration(found, place.spec.calibration_folder)
        unit = found.unit
        told = ", ".join(
            f"{name} {joint.centre_us:.0f} {unit} flat, {joint.us_per_rad * math.pi / 180:+.2f} {unit} a degree, "
            f"{joint.low_deg:.0f} to {joint.high_deg:.0f}° (residual {joint.residual_deg:.2f}°)"
            for name, joint in found.joints.items()
        )
        yield agent, f"{told}; kept in {shown_path(file)}"


def calibrate_robots_tilt(place: Workbench, agents: Sequence[str] = ()) -> Iterator[tuple[str, str]]:
    """Calibrate tilt sensors; yields an agent and what came of it, one after the other.

    Raises:
        UserError: As :func:`~testbed.hardware.calibration.tilt.calibrate_tilt` does.
    """
    for agent in _chosen(place.spec, agents, rig=False):
        with contextlib.ExitStack() as connected:
            if place.spec.board(agent).build == "feetech":
                robot = connected.enter_context(_bus_robot(place, agent))
                board = robot.imu
                if board is None:
                    raise UserError(
                        f"{agent} has no tilt sensor", "name its board as 'imu' in the bench file"
                    )
            else:
                count = len(joints_of(place.spec, agent))
                board = connected.enter_context(Board(place.address(agent), count, place.clock))
                board.connect()
            found = calibrate_tilt(board, place.clock, place.prompt, robot=agent)
        file = save_calibration(found, place.spec.calibration_folder)
        bias = ", ".join(f"{1000 * value:+.0f}" for value in found.bias)
        yield agent, f"bias {bias} mg, residual {found.residual_deg:.2f}°; kept in {shown_path(file)}"


def _bus_servos(place: Workbench, agent: str, limits: dict[str, tuple[float, float]]) -> ServoCalibration:
    with _bus_robot(place, agent) as robot:
        return calibrate_bus(robot, limits, place.prompt)


def _bus_robot(place: Workbench, agent: str) -> FeetechRobot:
    """A robot of bus servos, connected; disconnects itself as a context manager."""
    robot = place.robot(agent)
    assert isinstance(robot, FeetechRobot)
    robot.connect()
    return robot


def limits_deg(spec: BenchSpec, agent: str) -> dict[str, tuple[float, float]]:
    """By joint, how far the body's joints may turn, degrees."""
    if agent == RIG:
        return {PAN: (-_PAN_LIMIT, _PAN_LIMIT)}
    body = load_robot(spec.board(agent).robot)
    return {name: joint.limits_deg for name, joint in body.joints.items()}


def _chosen(spec: BenchSpec, agents: Sequence[str], *, rig: bool) -> tuple[str, ...]:
    """The agents that were named, each known; or all that have such a thing."""
    for agent in agents:
        spec.board(agent)
        if agent == RIG and not rig:
            raise UserError("the rig has no tilt sensor", "name robots only")
    everybody = (*spec.robots, *([RIG] if rig and RIG in spec.boards else []))
    return tuple(dict.fromkeys(agents)) or everybody
