"""What the student knows of its own equipment, and the forms in which it senses and acts."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.vision.camera import StereoRig

Observation = Mapping[str, NDArray[Any]]
Acting = Generator[NDArray[np.float32], Observation, Observation]
"""Yields actions, receives observations, returns the last observation."""

Progress = Callable[[str, int, int], None]
"""Called with the phase, how much of it is done, and how much there is."""


def silent(phase: str, done: int, total: int) -> None:
    """Reports no progress."""


@dataclass(frozen=True)
class Senses:
    """What the student knows of its own equipment.

    Attributes:
        rig: Its eyes.
        pan_limit: How far the rig turns to either side, rad.
        pan_speed: How fast it turns, rad/s.
        control_step: Seconds between two actions.
        frame_time: Seconds between two pairs of images.
    """

    rig: StereoRig
    pan_limit: float
    pan_speed: float
    control_step: float
    frame_time: float
