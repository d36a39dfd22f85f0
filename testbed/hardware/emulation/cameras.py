"""Emulated cameras: what a lens shows of a scene, on a sensor with noise, thirty times a second of the clock.

A frame is due at fixed times of the clock. When it is exposed only a snapshot of the scene is taken; the image is made
when somebody looks at it, which is not often. Its noise depends on the frame's number alone, so it is the same whoever
looks, and when.
"""

from __future__ import annotations

import functools
import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.hardware.clock import Clock
from testbed.hardware.emulation.lens import SIZE, Lens, Mount, RigTruth, Sensor
from testbed.hardware.emulation.scenes import Scene, Shot
from testbed.hardware.failures import CameraMissing
from testbed.hardware.rig.cameras import KEPT, Frame, Image
from testbed.vision.noise import QuickNoise

RATE = 30.0
"""Frames a second of common webcams."""
_BLACK_LEVEL = 6.0  # what a covered sensor reads


@dataclass
class CameraFaults:
    """What can be wrong with a camera; changed at will while it runs.

    Attributes:
        frozen: It repeats its last frame, to the bit, as if it were new.
        stalled: No new frames come.
        black: The lens is covered.
        gone: It is unplugged.
        dropping: Probability that a frame is lost.
        late: Seconds by which its frames, which are exposed at the right time, carry a later time.
        gain: What is read out is so many times as bright.
        turned: Rotation vector (rad) by which somebody knocked it, in its own frame.
    """

    frozen: bool = False
    stalled: bool = False
    black: bool = False
    gone: bool = False
    dropping: float = 0.0
    late: float = 0.0
    gain: float = 1.0
    turned: tuple[float, float, float] = (0.0, 0.0, 0.0)


class EmulatedCamera:
    """A :class:`~testbed.hardware.rig.cameras.Camera` of an emulated bench.

    Args:
        id: Its name.
        lens: How it bends light.
        mount: Where it sits.
        scene: What is there to be seen; may be exchanged while it runs.
        clock: When; ``expose`` is to be called often enough, or frames are taken when somebody looks.
        sensor: What becomes of the light.
        rate: Frames a second.
        phase: When its first frame is due, s after the start.
        seed: Of its noise and of lost frames.
    """

    def __init__(
        self,
        id: str,
        lens: Lens,
        mount: Mount,
        scene: Scene,
        clock: Clock,
        *,
        sensor: Sensor | None = None,
        rate: float = RATE,
        phase: float = 0.0,
        seed: int = 0,
    ) -> None:
        self._id, self.lens, self.mount, self.scene, self._clock = id, lens, mount, scene, clock
        self.sensor, self._rate, self._seed = sensor or Sensor(), rate, seed
        self.faults = CameraFaults()
        self._start = clock.now() + phase
        self._count = -1
        self._frames: deque[Frame] = deque(maxlen=KEPT)
        self._frozen: Frame | None = None

    @property
    def id(self) -> str:
        """See :class:`~testbed.hardware.rig.cameras.Camera`."""
        return self._id

    @property
    def due(self) -> float:
        """When the next frame is due, s on the clock."""
        return self._start + (self._count + 1) / self._rate

    def expose(self) -> None:
        """Take the frame that is due, if one is; of several only the last, for the scene is no longer as it was."""
        elapsed = (self._clock.now() - self._start) * self._rate
        count = math.floor(elapsed + 1e-6)
        if count <= self._count:
            return
        self._count = count
        chance = np.random.default_rng((self._seed, count, 1)).random()
        if self.faults.stalled or self.faults.gone or chance < self.faults.dropping:
            return
        at = self._start + count / self._rate + self.faults.late
        if self.faults.frozen and self._frames:
            self._frozen = self._frozen or self._frames[-1]
            last = self._frozen
            self._frames.append(Frame(lambda: last.image, at, count))
            return
        self._frozen = None
        mount = self.mount.moved(self.faults.turned) if any(self.faults.turned) else self.mount
        light = 0.0 if self.faults.black else self.faults.gain
        take = functools.partial(self._developed, self.scene.snapshot(), mount, light, count)
        self._frames.append(Frame(take, at, count))

    def newest(self) -> Frame | None:
        """See :class:`~testbed.hardware.rig.cameras.Camera`."""
        frames = self.recent()
        return frames[-1] if frames else None

    def recent(self) -> Sequence[Frame]:
        """See :class:`~testbed.hardware.rig.cameras.Camera`."""
        if self.faults.gone:
            raise CameraMissing(f"camera {self._id} gives no more frames: it was unplugged")
        self.expose()
        return tuple(self._frames)

    def settings(self) -> Mapping[str, float]:
        """See :class:`~testbed.hardware.rig.cameras.Camera`."""
        return {"exposure": self.sensor.exposure * self.faults.gain, "automatic exposure": 1.0}

    def lock(self) -> Sequence[str]:
        """See :class:`~testbed.hardware.rig.cameras.Camera`; nothing of it is automatic."""
        return ()

    def close(self) -> None:
        """See :class:`~testbed.hardware.rig.cameras.Camera`."""

    def _developed(self, shot: Shot, mount: Mount, light: float, number: int) -> Image:
        return developed(
            shot(self.lens, mount),
            self.sensor,
            QuickNoise(np.random.default_rng((self._seed, number)).bit_generator),
            light,
        )


def developed(
    luminosity: NDArray[np.float32], sensor: Sensor, rng: np.random.Generator, light: float = 1.0
) -> Image:
    """What a sensor reads of the luminosities (480, 640) behind a lens, uint8; ``light``: so many times as bright."""
    lit = luminosity * (_falloff(sensor.vignetting) * np.float32(sensor.exposure * light))
    if sensor.blur:
        lit = cv2.GaussianBlur(lit, (0, 0), sensor.blur, borderType=cv2.BORDER_REPLICATE)
    lit = np.maximum(np.asarray(lit, dtype=np.float32), _BLACK_LEVEL)
    noisy = lit + rng.normal(0.0, sensor.noise, lit.shape).astype(np.float32, copy=False)
    exposed: Image = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return exposed


@functools.lru_cache(maxsize=4)
def _falloff(vignetting: float) -> NDArray[np.float32]:
    """(480, 640) share of the light that reaches each pixel: less with the square of the distance from the middle."""
    x = (np.arange(SIZE[0]) + 0.5) / SIZE[0] * 2 - 1
    y = (np.arange(SIZE[1]) + 0.5) / SIZE[1] * 2 - 1
    wide, high = SIZE[0] ** 2, SIZE[1] ** 2
    square = (x[None, :] ** 2 * wide + y[:, None] ** 2 * high) / (wide + high)
    falloff: NDArray[np.float32] = (1 - vignetting * square).astype(np.float32)
    return falloff


def emulated_pair(
    rig: RigTruth, scene: Scene, clock: Clock, *, seed: int = 0, ids: tuple[str, str] = ("left", "right")
) -> tuple[EmulatedCamera, EmulatedCamera]:
    """The two cameras of a rig; their frames are 4 ms apart, as those of free-running cameras happen to be."""
    left, right = (
        EmulatedCamera(
            ids[eye],
            rig.lenses[eye],
            rig.mounts[eye],
            scene,
            clock,
            sensor=rig.sensor,
            phase=0.004 * eye,
            seed=2 * seed + eye,
        )
        for eye in (0, 1)
    )
    return left, right


def swap(left: EmulatedCamera, right: EmulatedCamera) -> None:
    """Exchange where two cameras sit, as when their cables are."""
    left.mount, right.mount = right.mount, left.mount
