"""Two free-running cameras, one look: frames are paired by when they were exposed, not by when they were asked for.

And the first of the checks that what comes is really seen now: a camera that has stopped, repeats itself or is covered
is named as such.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from testbed.hardware.clock import Clock
from testbed.hardware.failures import CameraBlack, CameraFrozen, CamerasApart, CameraStalled
from testbed.hardware.rig.cameras import Camera, Frame

SIDES = ("left", "right")


class FramePair(NamedTuple):
    """A left and a right frame that belong together."""

    left: Frame
    right: Frame

    @property
    def at(self) -> float:
        """When the later of the two was exposed, s on the clock."""
        return max(self.left.at, self.right.at)


@dataclass(frozen=True)
class PairingSpec:
    """What counts as together, and as out of order.

    Attributes:
        apart: Frames further apart (s) are no pair: half a period of 30 frames a second, which is the worst that two
            cameras in order can do.
        patience: Seconds without a new frame, or without a pair, before the cameras count as stalled or apart: many
            frames may be lost before, and a robot does not go far.
        repeats: So many frames in a row that are equal to the bit are frozen: with noise two never are.
        black: A picture with nothing brighter than this is black: twice what covered sensors read with their noise.
    """

    apart: float = 0.017
    patience: float = 0.5
    repeats: int = 3
    black: int = 24


class Pairing:
    """Pairs the frames of two cameras.

    Args:
        left: The left camera.
        right: The right camera.
        clock: The cameras' clock.
        spec: Limits.
    """

    def __init__(self, left: Camera, right: Camera, clock: Clock, spec: PairingSpec | None = None) -> None:
        self.cameras, self._clock, self.spec = (left, right), clock, spec or PairingSpec()
        self._since = self._asked = (
            clock.now()
        )  # when it was last known that all is well, and was last asked for
        self._pair: FramePair | None = None
        self._repeated = [0, 0]

    def newest(self) -> FramePair:
        """The newest pair: the one of last time while no newer has come.

        Waits for the very first pair, and after a pause for the next.

        Raises:
            CameraStalled: If a camera gives no new frames.
            CamerasApart: If the frames that come are too far apart.
            CameraFrozen: If a camera gives the same frame over and over.
            CameraBlack: If a camera sees nothing.
            CameraMissing: If a camera is gone.
        """
        patience = self.spec.patience
        if self._clock.now() - self._asked > patience:
            self._since = (
                self._clock.now()
            )  # nobody looked for a while: the cameras are not to blame for that
        while True:
            pair = self._together()
            if pair is not None and (self._pair is None or pair.at > self._pair.at):
                self._examine(pair)
                self._pair, self._since = pair, self._clock.now()
            else:
                self._still_coming()
            self._asked = self._clock.now()
            if self._pair is not None and self._asked - self._pair.at <= patience:
                return self._pair
            self._clock.sleep(patience / 20)

    def _together(self) -> FramePair | None:
        """The newest two frames that are near enough to each other in time."""
        lefts, rights = (camera.recent() for camera in self.cameras)
        near = [
            FramePair(left, right)
            for left in lefts
            for right in rights
            if abs(left.at - right.at) <= self.spec.apart
        ]
        return max(near, key=lambda pair: (min(pair.left.at, pair.right.at), pair.at), default=None)

    def _still_coming(self) -> None:
        """No new pair: how long is that to be borne, and who is to blame?"""
        now = self._clock.now()
        if now - self._since <= self.spec.patience:
            return
        ages = []
        for camera in self.cameras:
            frames = camera.recent()
            ages.append(now - frames[-1].at if frames else now - self._since)
        stalled = [
            f"{side} camera ({camera.id})"
            for side, camera, age in zip(SIDES, self.cameras, ages, strict=True)
            if age > self.spec.patience
        ]
        if stalled:
            raise CameraStalled(f"the {' and the '.join(stalled)} gave no frame for {max(ages):.1f} s")
        gap = abs(ages[0] - ages[1])
        raise CamerasApart(
            f"for {now - self._since:.1f} s no two frames of the cameras were within "
            f"{self.spec.apart * 1e3:.0f} ms of each other, the last are {gap * 1e3:.0f} ms apart"
        )

    def _examine(self, pair: FramePair) -> None:
        for eye, (side, camera, frame) in enumerate(zip(SIDES, self.cameras, pair, strict=True)):
            name = f"the {side} camera ({camera.id})"
            if np.quantile(frame.image[::4, ::4], 0.995) < self.spec.black:
                raise CameraBlack(f"{name} sees nothing")
            if self._pair is None or frame.number == self._pair[eye].number:
                continue
            same = np.array_equal(frame.image, self._pair[eye].image)
            self._repeated[eye] = self._repeated[eye] + 1 if same else 0
            if self._repeated[eye] >= self.spec.repeats:
                raise CameraFrozen(f"{name} gave the same frame {self._repeated[eye] + 1} times")
