"""A bench on which everything is emulated but the firmware: boards, bodies, cables and cameras in one virtual time.

One process and no threads. Time passes only when somebody waits for it (:meth:`EmulatedBench.sleep`,
:meth:`EmulatedBench.wait`), so a run is the same to the bit however slow the machine is. What happens in it:

- each board's microcontroller runs the firmware, cycle by cycle, and hears and says bytes through a real port;
- its pulses, decoded from the pins, are what its servos hear; servos that hear none are limp;
- the bodies move in a physics world, and each board's tilt sensor feels how its body does;
- the rig's servo pans the cameras, which expose a frame whenever one is due.

The truth about everybody (:meth:`EmulatedBench.state`) is for whoever checks afterwards what a student believed.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Self

import numpy as np
import serial

from testbed.bodies.morphology import Morphology, Vector
from testbed.errors import UserError
from testbed.hardware.bench_file import RIG
from testbed.hardware.clock import readable
from testbed.hardware.emulation.board import EmulatedBoard
from testbed.hardware.emulation.cameras import EmulatedCamera, emulated_pair
from testbed.hardware.emulation.lens import RigTruth, built_rig
from testbed.hardware.emulation.microcontroller import Microcontroller
from testbed.hardware.emulation.mounting import Mounting, felt
from testbed.hardware.emulation.scenes import RobotScene
from testbed.hardware.emulation.servos import Servo, Servos
from testbed.hardware.emulation.wire import Wire
from testbed.physics import Simulation
from testbed.scenario import Scenario
from testbed.world.bullet import bodies_of, physics_of
from testbed.world.placement import STUDENT, placements

SLICE = 5e-4
"""s that a board runs at a time while somebody waits for its answer. USB carries bytes in parcels, too, one a ms."""
_PAN_SERVO_SPEED = math.radians(300)
_SMOOTHING = 0.01
"""s; a sensor's low-pass filter: of the jerks of a contact it feels the mean."""
SERVOS = 2
"""How many servos a board drives."""


class EmulatedBench:
    """A :class:`~testbed.hardware.clock.Clock`, and everything whose time it is.

    Args:
        scenario: Who stands where; nothing left to chance.
        seed: Of what came out of the shop: servos, lenses, how sensors are glued, their noise.
        ports: A folder for names of the ports that stay when a cable is pulled and plugged in again.
        rig: The cameras; drawn by the seed if not given.

    Attributes:
        boards: By agent; ``rig`` is the one that pans.
        cameras: Left and right.
        held: Orientation (xyzw) of the robots that somebody holds in the air.

    Raises:
        UserError: If somebody of the scenario cannot be built with a board of two servos, or simavr is missing.
    """

    def __init__(
        self, scenario: Scenario, *, seed: int = 0, ports: Path | None = None, rig: RigTruth | None = None
    ) -> None:
        self.scenario, self._seed = scenario, seed
        self._robots = bodies_of(scenario)
        for name, body in self._robots.items():
            if not 1 <= len(body.joints) <= SERVOS:
                what = f"{name}, a '{body.name}', has {len(body.joints)} joints, an emulated board {SERVOS} servos"
                raise UserError(what, "use robots of one or two joints, or --backend simulation")
        self._now, self._steps = 0.0, 0
        self._pan, self._exposures = 0.0, 0
        self.held: dict[str, Vector] = {}
        self._happenings: list[tuple[float, Callable[[], None]]] = []
        self.boards: dict[str, EmulatedBoard] = {}
        self.simulation = Simulation(physics_of(scenario))
        spots = placements(scenario, self._robots)
        for name, body in self.bodies.items():
            spot = spots[name]
            self.simulation.add(name, body, place=spot.place, yaw=spot.yaw, height=spot.height)
        self._velocity = {name: np.zeros(3) for name in self._robots}
        self._felt = {name: np.zeros(3) for name in self._robots}
        try:
            for name, body in self._robots.items():
                self.boards[name] = self._board(name, len(body.joints), ports, imu=True)
            self.boards[RIG] = self._board(RIG, 1, ports, imu=False)
        except BaseException:
            self.close()
            raise
        truth = rig or built_rig(self._chance("lenses"), scenario.rig.baseline)
        self.rig = truth
        self.scene = RobotScene(self.simulation, scenario.rig, lambda: self._pan)
        self.cameras: tuple[EmulatedCamera, EmulatedCamera] = emulated_pair(
            truth, self.scene, self, seed=seed
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Time ---------------------------------------------------------------------------------------------------------

    def now(self) -> float:
        """See :class:`~testbed.hardware.clock.Clock`."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """See :class:`~testbed.hardware.clock.Clock`."""
        self.advance(seconds)

    def wait(self, port: serial.Serial, deadline: float) -> bool:
        """See :class:`~testbed.hardware.clock.Clock`; the board at the port runs finely, the others keep up."""
        boards = tuple(board for board in self.boards.values() if board.wire.path == port.port)
        while not readable(port):
            for board in boards:
                board.catch_up(self._now)
                board.listen(self._now)
            said = False
            while not said:  # asking the system each time takes longer than all the rest
                if self._now >= deadline:
                    return readable(port)
                before = [board.delivered for board in boards]
                self._advance_to(min(self._now + SLICE, deadline), boards)
                said = not boards or before != [board.delivered for board in boards]
        return True

    def advance(self, seconds: float) -> None:
        """Let virtual time pass."""
        for board in self.boards.values():
            board.catch_up(self._now)
            board.listen(self._now)
        until = self._now + max(0.0, seconds)
        while self._now < until:
            self._advance_to(until, ())

    def _advance_to(self, until: float, attended: tuple[EmulatedBoard, ...]) -> None:
        """Let time pass until then, or until the next step of the physics, which all boards see."""
        boundary = (self._steps + 1) * self.simulation.spec.step
        if until < boundary:
            self._now = until
            for board in attended:
                board.catch_up(until)
            return
        self._now = boundary
        for board in self.boards.values():
            board.catch_up(boundary)
            board.listen(boundary)
        self._steps += 1
        self._step()

    # What happens -------------------------------------------------------------------------------------------------

    def _step(self) -> None:
        """One step of the physics: servos pull, bodies move and feel it, the rig turns, cameras expose."""
        step = self.simulation.spec.step
        due = [happens for at, happens in self._happenings if at <= self._now]
        self._happenings = [(at, happens) for at, happens in self._happenings if at > self._now]
        for happens in due:
            happens()
        for name in self._robots:
            self.simulation.command(name, self.boards[name].targets)
        self.simulation.step()
        for name, orientation in self.held.items():
            self._hold(name, orientation)
        for name in self._robots:
            velocity = self.simulation.velocity(name)
            jerk = (velocity - self._velocity[name]) / step
            self._velocity[name] = velocity
            share = min(1.0, step / _SMOOTHING)
            self._felt[name] += share * (jerk - self._felt[name])
            if name in self.held:
                self._felt[name] = np.zeros(3)
            orientation = self.simulation.base(name)[3:]
            gravity = self.scenario.world.gravity
            self.boards[name].feel(felt(orientation, self._felt[name], gravity))
        (target,) = self.boards[RIG].targets
        if not math.isnan(target):
            most = _PAN_SERVO_SPEED * step
            self._pan += min(max(target - self._pan, -most), most)
        for camera in self.cameras:
            camera.expose()

    def _hold(self, name: str, orientation: Vector) -> None:
        place = self.simulation.base(name)[:2]
        self.simulation.pose(name, np.array([*place, 1.0, *orientation]), self.simulation.joints(name))

    # The truth ----------------------------------------------------------------------------------------------------

    @property
    def bodies(self) -> Mapping[str, Morphology]:
        """Everybody's true body."""
        return {**self._robots, STUDENT: self.scenario.student.true_body()}

    @property
    def pan(self) -> float:
        """Where the rig really looks, rad, positive to the right."""
        return self._pan

    def state(self, robot: str) -> tuple[Vector, Vector]:
        """A robot's base (7,), position (m) and quaternion of its root, and its joint angles (rad)."""
        return self.simulation.base(robot), self.simulation.joints(robot)

    # What somebody at the bench can do ------------------------------------------------------------------------------

    def later(self, seconds: float, happens: Callable[[], None]) -> None:
        """Something happens so many seconds from now: a cable is pulled, a board loses its supply."""
        self._happenings.append((self._now + seconds, happens))

    def put_back(self, *robots: str) -> None:
        """Put robots back to where they started, flat and at rest."""
        for name in robots or self._robots:
            self.held.pop(name, None)
            self.simulation.reset(name)
            self._velocity[name] = np.zeros(3)
            self._felt[name] = np.zeros(3)

    def close(self) -> None:
        """Pull all plugs; harmless when repeated."""
        for board in self.boards.values():
            board.close()
        self.simulation.close()

    # What came out of the shop ----------------------------------------------------------------------------------------

    def _board(self, name: str, joints: int, ports: Path | None, *, imu: bool) -> EmulatedBoard:
        chance = self._chance(name)
        unique_id = hashlib.sha256(f"{self._seed} {name}".encode()).hexdigest()[:16]
        return EmulatedBoard(
            unique_id=unique_id,
            chip=Microcontroller(
                name=name, unique_id=unique_id, imu=imu, servos=joints, seed=int(chance.integers(2**31))
            ),
            wire=Wire(None if ports is None else ports / f"tty-{name}", seed=int(chance.integers(2**31))),
            servos=Servos([Servo.drawn(chance) for _ in range(joints)]),
            mounting=Mounting.drawn(chance) if imu else None,
        )

    def _chance(self, what: str) -> np.random.Generator:
        return np.random.default_rng([self._seed, *what.encode()])
