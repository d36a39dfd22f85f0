"""Cameras: a device, a stream or a file, each read by a thread of its own, each frame with the time of its arrival.

A camera is named by what does not change when it is plugged in elsewhere: on Linux its name in /dev/v4l/by-id.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from testbed.errors import one_line
from testbed.hardware.clock import Clock
from testbed.hardware.failures import CameraMissing

Image = NDArray[np.uint8]

KEPT = 8
"""How many frames are remembered, so that one can be paired with another camera's that came a little later."""
BY_ID = Path("/dev/v4l/by-id")
BY_PATH = Path("/dev/v4l/by-path")
_FIRST_FRAME = 5.0  # s; webcams take their time to wake up


class Frame:
    """One image of a camera.

    Attributes:
        at: When it was exposed or, where that is not known, arrived; s on the clock.
        number: Which frame of this camera it is, counted from 0.
    """

    def __init__(self, image: Image | Callable[[], Image], at: float, number: int) -> None:
        self._image, self.at, self.number = image, at, number

    @cached_property
    def image(self) -> Image:
        """(H, W) luminosities or (H, W, 3) blue, green and red."""
        return self._image() if callable(self._image) else self._image


class Camera(Protocol):
    """Something that gives frames."""

    @property
    def id(self) -> str:
        """A name that stays the same when it is plugged in elsewhere."""
        ...

    def newest(self) -> Frame | None:
        """The last frame, or None before the first.

        Raises:
            CameraMissing: If there will be no more.
        """
        ...

    def recent(self) -> Sequence[Frame]:
        """The last few frames, the newest last; raises as :meth:`newest`."""
        ...

    def settings(self) -> Mapping[str, float]:
        """What the camera says about exposure, gain, white balance and focus; only what it has."""
        ...

    def lock(self) -> Sequence[str]:
        """Fix exposure, white balance and focus as they are now; returns, in words, what could not be fixed."""
        ...

    def close(self) -> None:
        """Let go of it; harmless when repeated."""
        ...


@dataclass(frozen=True)
class CameraInfo:
    """A camera that is plugged in.

    Attributes:
        id: What to write into the bench file.
        device: What that is just now, such as /dev/video0.
    """

    id: str
    device: str


def found_cameras(*folders: Path) -> list[CameraInfo]:
    """The cameras that are plugged in, by stable name.

    Two cameras of one make without serial numbers share a name in by-id; those are named by their socket instead.
    """
    places = folders or (BY_ID, BY_PATH)
    by_device: dict[str, str] = {}
    for folder in places:
        for link in sorted(folder.glob("*-video-index0")) if folder.is_dir() else ():
            by_device.setdefault(str(link.resolve()), str(link))
    return sorted((CameraInfo(name, device) for device, name in by_device.items()), key=lambda info: info.id)


class Capture(Protocol):
    """The part of ``cv2.VideoCapture`` that has to do with settings."""

    def get(self, setting: int) -> float:
        """A setting's value."""
        ...

    def set(self, setting: int, value: float) -> bool:
        """Change a setting; the answer cannot be trusted."""
        ...


_SHOWN = {
    "exposure": cv2.CAP_PROP_EXPOSURE,
    "automatic exposure": cv2.CAP_PROP_AUTO_EXPOSURE,
    "gain": cv2.CAP_PROP_GAIN,
    "white balance": cv2.CAP_PROP_WB_TEMPERATURE,
    "automatic white balance": cv2.CAP_PROP_AUTO_WB,
    "focus": cv2.CAP_PROP_FOCUS,
    "automatic focus": cv2.CAP_PROP_AUTOFOCUS,
}
_MANUAL = {
    "automatic exposure": 1.0,
    "automatic white balance": 0.0,
    "automatic focus": 0.0,
}  # 1: V4L2's manual
_HELD = ("exposure", "gain", "white balance", "focus")


def read_settings(capture: Capture) -> dict[str, float]:
    """The settings that a camera has; drivers answer -1, 0 or nothing sensible for those that it has not."""
    values = {name: float(capture.get(key)) for name, key in _SHOWN.items()}
    return {name: value for name, value in values.items() if np.isfinite(value) and value != -1.0}


def lock_settings(capture: Capture) -> list[str]:
    """Switch everything automatic off and hold the values of this moment; returns what did not obey.

    ``set`` answers yes to much that then does not happen, so all is read back.
    """
    before, refused = read_settings(capture), []
    for name, manual in _MANUAL.items():
        if name not in before:
            continue
        capture.set(_SHOWN[name], manual)
        got = capture.get(_SHOWN[name])
        if got != manual:
            refused.append(f"{name} stays at {got:g}")
    for name in _HELD:
        if name in before:
            capture.set(_SHOWN[name], before[name])
            got = capture.get(_SHOWN[name])
            if abs(got - before[name]) > 0.01 * abs(before[name]):
                refused.append(f"{name} is {got:g} instead of {before[name]:g}")
    return refused


class VideoCamera:
    """A camera that OpenCV can read: a device, a stream's address, a film or a sequence of pictures.

    Args:
        source: A stable device name, an address such as http://127.0.0.1:8080/left, a file, or a pattern of files
            such as frames/%04d.png.
        clock: Gives the frames their time.
        rate: Frames a second at which a file is played; None as the file says. Devices and streams give their own.
        size: Width and height that a device is asked for, and frames must have; None for any.

    Raises:
        CameraMissing: If it cannot be opened, gives no first frame, or frames of another size.
    """

    def __init__(
        self,
        source: str,
        clock: Clock,
        *,
        rate: float | None = None,
        size: tuple[int, int] | None = (640, 480),
    ) -> None:
        self._source, self._clock, self._size = source, clock, size
        self._frames: deque[Frame] = deque(maxlen=KEPT)
        self._ended: str | None = None
        self._stop = threading.Event()
        self._came = threading.Event()
        self._device = source.startswith("/dev/")
        if self._device and not Path(source).exists():
            raise CameraMissing(f"there is no camera {source}")
        self._capture = self._opened()
        live = self._device or "://" in source
        self._interval = None if live else 1 / (rate or self._capture.get(cv2.CAP_PROP_FPS) or 30.0)
        self._thread = threading.Thread(target=self._read, name=f"camera {source}", daemon=True)
        self._thread.start()
        self._came.wait(_FIRST_FRAME)
        if not self._frames:
            self.close()
            raise CameraMissing(
                f"camera {source} gives no frames" + (f": {self._ended}" if self._ended else "")
            )

    @property
    def id(self) -> str:
        """See :class:`Camera`."""
        return self._source

    def newest(self) -> Frame | None:
        """See :class:`Camera`."""
        return self.recent()[-1]

    def recent(self) -> Sequence[Frame]:
        """See :class:`Camera`."""
        if self._ended is not None:
            raise CameraMissing(f"camera {self._source} gives no more frames: {self._ended}")
        return tuple(self._frames)

    def settings(self) -> Mapping[str, float]:
        """See :class:`Camera`."""
        return read_settings(self._capture) if self._device else {}

    def lock(self) -> Sequence[str]:
        """See :class:`Camera`; a stream or a file has nothing that could change by itself."""
        return lock_settings(self._capture) if self._device else ()

    def close(self) -> None:
        """See :class:`Camera`."""
        self._stop.set()
        self._thread.join(timeout=2 * _FIRST_FRAME)
        if not self._thread.is_alive():  # a reader that hangs in the driver keeps it
            self._capture.release()

    def _opened(self) -> cv2.VideoCapture:
        if self._device:
            capture = cv2.VideoCapture(self._source, cv2.CAP_V4L2)
            if self._size is not None:
                # Two cameras of 640 x 480 fit on one USB 2 bus only when compressed.
                capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
                capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
                capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
            capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        else:
            capture = cv2.VideoCapture(self._source)
        if not capture.isOpened():
            raise CameraMissing(f"camera {self._source} cannot be opened")
        return capture

    def _read(self) -> None:
        """The thread: reads until it is told to stop; whatever ends it is kept and told."""
        try:
            number = 0
            while not self._stop.is_set():
                there, image = self._capture.read()
                at = self._clock.now()
                if not there or image is None:
                    self._ended = "the stream has ended" if number else "nothing came"
                    return
                if self._size is not None and (image.shape[1], image.shape[0]) != self._size:
                    found = f"{image.shape[1]} x {image.shape[0]}"
                    self._ended = f"its frames are {found} instead of {self._size[0]} x {self._size[1]}"
                    return
                self._frames.append(Frame(np.asarray(image, dtype=np.uint8), at, number))
                self._came.set()
                number += 1
                if self._interval is not None:
                    self._stop.wait(self._interval)
        except Exception as error:  # a thread that dies must not die unheard
            self._ended = one_line(f"{type(error).__name__}: {error}")
        finally:
            self._came.set()
