"""One emulated board on the bench: the microcontroller, its cable, its servos and how its sensor is glued on."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from testbed.bodies.morphology import Vector
from testbed.hardware.emulation.microcontroller import Microcontroller, Pulse
from testbed.hardware.emulation.mounting import Mounting
from testbed.hardware.emulation.servos import Servos
from testbed.hardware.emulation.wire import Wire

_PARCEL = 62  # bytes in a packet of common USB adapters


@dataclass
class EmulatedBoard:
    """A board on the bench.

    Attributes:
        unique_id: What the firmware calls it.
        chip: The microcontroller with the firmware in it.
        wire: From it to a serial port of this machine.
        servos: What its pulses move.
        mounting: How its tilt sensor sits; None without one.
        pulses: All that ever left its pins.
        delivered: Grows whenever there may be something new for the host.
    """

    unique_id: str
    chip: Microcontroller
    wire: Wire
    servos: Servos
    mounting: Mounting | None
    pulses: list[Pulse] = field(default_factory=list)
    delivered: int = 0
    _parcel: bytearray = field(default_factory=bytearray)
    _ran_until: float = 0.0

    def catch_up(self, now: float) -> None:
        """Run until now (s) without hearing anything new."""
        if now > self._ran_until:
            self.chip.run_until(now)
            self._ran_until = now
            for pulse in self.chip.pulses():
                self.pulses.append(pulse)
                self.servos.hear(now, pulse.channel, pulse.width_us)
            self._deliver(self.chip.read(), now)

    def _deliver(self, said: bytes, now: float) -> None:
        """Adapters gather bytes: they pass on a full parcel, or what they have when the line falls silent."""
        self._parcel += said
        if said and len(self._parcel) < _PARCEL and not self.wire.faults.delay:
            return
        if self._parcel or self.wire.faults.delay:
            self.wire.to_host(bytes(self._parcel), now)
            self._parcel.clear()
            self.delivered += 1

    def listen(self, now: float) -> None:
        """Hear what the host has sent until now (s)."""
        said = self.wire.from_host(now)
        if said:
            self.chip.write(said)

    def feel(self, felt: Vector) -> None:
        """The body feels this specific force (3,) in g, in its root's axes."""
        if self.mounting is not None:
            self.chip.set_acceleration(*self.mounting.says(felt).tolist())

    @property
    def targets(self) -> Vector:
        """(n,) where its servos pull to, rad; NaN where one has let go."""
        return self.servos.targets(self._ran_until)

    @property
    def limp(self) -> bool:
        """Whether none of its servos hears anything."""
        return all(math.isnan(target) for target in self.targets)

    def close(self) -> None:
        """Pull the plug; harmless when repeated."""
        self.wire.close()
        self.chip.close()
