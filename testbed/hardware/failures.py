"""What can go wrong on a bench, each with its name and its mend.

Whatever fails on a bench ends in one of these, so that a trial's record can say in one word why it stopped and a
person reads in one line what to do. A failure's name is its class: ``failure.outcome``.
"""

from __future__ import annotations

from typing import ClassVar

from testbed.errors import UserError


class HardwareFailure(UserError):
    """A bench, or a part of it, that does not do what it should.

    Args:
        what: What is wrong, with the name of the part.
        mend: What to do about it; that of the class if not given.
    """

    usual_mend: ClassVar[str] = ""

    def __init__(self, what: str, mend: str | None = None) -> None:
        super().__init__(what, type(self).usual_mend if mend is None else mend)

    @property
    def outcome(self) -> str:
        """The failure's name, as records have it."""
        return type(self).__name__

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.what, self.mend)


class PortMissing(HardwareFailure):
    """There is no such serial port, or no port with such a device."""

    usual_mend = "check cable and power; 'testbed hardware find' lists what is there"


class PortDenied(HardwareFailure):
    """The port is there but this user may not open it."""

    usual_mend = "join the port's group (on Debian: sudo adduser $USER dialout) and log in again"


class PortBusy(HardwareFailure):
    """Another program has the port."""

    usual_mend = "close the other program (a serial monitor, another run)"


class NoAnswer(HardwareFailure):
    """The port is open and nothing that is understood comes back."""

    usual_mend = (
        "check power, the cable and that the firmware is on the board; a data cable, not a charging one"
    )


class LinkLost(HardwareFailure):
    """A device that has answered before does not any more."""

    usual_mend = "check cable and power and run again: the trial goes on where it stopped"


class BoardRestarted(HardwareFailure):
    """The microcontroller has booted in between (brown-out, reset, power cycle); it is disarmed."""

    usual_mend = "check the supply (servos on their own, common ground) and run again"


class WrongProtocol(HardwareFailure):
    """The board speaks another version of the protocol."""

    usual_mend = "flash the firmware that comes with this version"


class WrongFirmware(HardwareFailure):
    """The board's firmware is another one than this version needs, or is not what it says."""

    usual_mend = "flash the firmware that comes with this version"


class WrongBoard(HardwareFailure):
    """Another device answers than the one that was asked for."""

    usual_mend = "check which cable is which; 'testbed hardware find' lists the boards by name"


class NotArmed(HardwareFailure):
    """A command that moves something came while the board is disarmed."""

    usual_mend = "arm it first"


class Stopped(HardwareFailure):
    """The emergency stop is latched."""

    usual_mend = "release the stop button and power-cycle the board"


class WentLimp(HardwareFailure):
    """The board heard no command for so long that it let its servos go."""

    usual_mend = "check the load of this machine and the cable and run again"


class ServoFault(HardwareFailure):
    """A bus servo reports a fault of its own: overload, heat, voltage, current or its angle sensor."""

    usual_mend = "let it cool, look for what blocks it, check its supply; the fault clears at power-on"


class ImuMissing(HardwareFailure):
    """The tilt sensor does not answer."""

    usual_mend = "check the four wires to the MPU-6050 (5 V, ground, SDA to A4, SCL to A5)"


class ImuStuck(HardwareFailure):
    """The tilt sensor gives the same reading over and over, to the bit."""

    usual_mend = "power-cycle the board; if it stays, change the MPU-6050"


class TiltImplausible(HardwareFailure):
    """What the tilt sensor reads cannot be."""

    usual_mend = "check that the sensor is screwed down, then 'testbed hardware calibrate tilt'"


class NotCalibrated(HardwareFailure):
    """A device without the calibration that this needs."""

    usual_mend = "run 'testbed hardware calibrate'"


class CalibrationForeign(HardwareFailure):
    """A calibration of another device, or of another version."""

    usual_mend = "calibrate this device anew"


class CalibrationStale(HardwareFailure):
    """A calibration that is too old, or no longer true."""

    usual_mend = "calibrate anew"


class CameraMissing(HardwareFailure):
    """There is no such camera, or it cannot be opened."""

    usual_mend = "check its cable; 'testbed hardware find' lists the cameras"


class CameraStalled(HardwareFailure):
    """A camera gives no new frames."""

    usual_mend = "check its cable; two cameras on one USB hub may need one each"


class CameraFrozen(HardwareFailure):
    """A camera gives the same frame over and over, to the bit."""

    usual_mend = "unplug the camera and plug it in again"


class CameraBlack(HardwareFailure):
    """A camera sees nothing."""

    usual_mend = "take off the lens cap, switch on the light"


class CamerasSwapped(HardwareFailure):
    """The left camera's picture is the right one's."""

    usual_mend = "exchange left and right in the bench file"


class CamerasApart(HardwareFailure):
    """The two cameras' frames are too far apart in time to be one look."""

    usual_mend = "give each camera a USB port of its own and the same frame rate"


class ExposureChanged(HardwareFailure):
    """A camera's exposure, gain or white balance is not what it was locked to."""

    usual_mend = "keep the light as it was; run again, which locks it anew"


class RigMoved(HardwareFailure):
    """The cameras are no longer where they were calibrated."""

    usual_mend = "fix the cameras and run 'testbed hardware calibrate stereo'"
