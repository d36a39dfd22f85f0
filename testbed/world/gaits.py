"""How teachers move: scripted policies that act through the same ``step`` as everybody else.

A policy is a motion, postures in the course of time, and the occasion on which it is performed (``attention.py``). A
new behaviour is a class with ``posture`` and one line in ``MOTIONS``; a new gait of a known kind is one line in
``PRESETS`` or a block in a scenario file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.errors import UserError
from testbed.recording import read_recording
from testbed.scenario.gait import GaitSpec, JointWave, waved
from testbed.world.attention import ATTENTION, occasion_of, watched
from testbed.world.mirror import twins

__all__ = [
    "ATTENTION",
    "MOTIONS",
    "PRESETS",
    "Motion",
    "Policy",
    "preset_names",
    "scripted_policy",
    "watched",
]

PRESETS: dict[str, GaitSpec] = {
    "still": GaitSpec(kind="still"),
    "random": GaitSpec(kind="random"),
    "roll": GaitSpec(kind="push"),
    "slide": GaitSpec(kind="push"),
    # It answers whatever the student does, with whatever joints it has: social contingency.
    "contingent": GaitSpec(kind="random", when="answering"),
    # Reach out with the foot lifted, put it down, pull: 5 cm a cycle for the crawler, for its foot grips better
    # than its body; with one coefficient of friction it stays where it is.
    "crawl": GaitSpec(
        period=2.0,
        joints={
            "joint_a": JointWave(centre_deg=0, amplitude_deg=33),
            "joint_b": JointWave(centre_deg=65, amplitude_deg=25, phase_deg=120),
        },
    ),
    # The same two joints the other way: the foot pushes, 2.6 cm a cycle backwards.
    "crawl_back": GaitSpec(
        period=2.0,
        joints={
            "joint_a": JointWave(centre_deg=0, amplitude_deg=33),
            "joint_b": JointWave(centre_deg=65, amplitude_deg=25, phase_deg=-140),
        },
    ),
    # Two fingers in turn, each as a crawler's two limbs: 9 cm a cycle for the hand.
    "finger_walk": GaitSpec(
        period=2.0,
        joints={
            "joint_a": JointWave(centre_deg=0, amplitude_deg=25),
            "joint_b": JointWave(centre_deg=60, amplitude_deg=25, phase_deg=-120),
            "joint_c": JointWave(centre_deg=0, amplitude_deg=25, phase_deg=180),
            "joint_d": JointWave(centre_deg=60, amplitude_deg=25, phase_deg=60),
        },
    ),
    # One limb props the body up while the other rows: 8 cm a cycle for the splayed body, by shifting load between
    # limbs and body; it would even work with one coefficient of friction.
    "splayed_crawl": GaitSpec(
        period=2.0,
        joints={
            "joint_a": JointWave(centre_deg=-28, amplitude_deg=19),
            "joint_b": JointWave(centre_deg=54, amplitude_deg=28, phase_deg=156),
        },
    ),
    # The first limb up in the air, what hangs on it to and fro.
    "wave": GaitSpec(
        period=1.6,
        joints={
            "joint_a": JointWave(centre_deg=-50, amplitude_deg=8),
            "joint_b": JointWave(centre_deg=0, amplitude_deg=35, phase_deg=90),
        },
    ),
}


def preset_names() -> tuple[str, ...]:
    """Names of the gaits that a scenario can use without spelling them out."""
    return tuple(PRESETS)


class Policy(Protocol):
    """Anybody who acts: observations in, joint targets (rad) out."""

    def act(self, observation: Mapping[str, Vector]) -> Vector:
        """The next action."""
        ...


class Motion(Protocol):
    """Postures in the course of time."""

    def posture(self, steps: float) -> Vector:
        """(joints,) targets (rad) so many control steps after it began."""
        ...


class Still:
    """Lies flat for ever."""

    def __init__(self, gait: GaitSpec, body: Morphology, control_step: float) -> None:
        self._rest = body.rest

    def posture(self, steps: float) -> Vector:
        """The body's rest."""
        return self._rest


class Cyclic:
    """Every joint follows its wave, see :class:`testbed.scenario.JointWave`."""

    def __init__(self, gait: GaitSpec, body: Morphology, control_step: float) -> None:
        waves = [gait.joints.get(joint, JointWave()) for joint in body.joints]
        self._centre = np.radians([wave.centre_deg for wave in waves])
        self._amplitude = np.radians([wave.amplitude_deg for wave in waves])
        self._phase = np.radians([wave.phase_deg for wave in waves])
        self._harmonics = [
            (joint, math.radians(wave.amplitude_deg), wave.order, math.radians(wave.phase_deg))
            for joint, swing in enumerate(waves)
            for wave in swing.harmonics
        ]
        self._form = gait.wave_form
        self._turn = 2 * math.pi * control_step / gait.period

    def posture(self, steps: float) -> Vector:
        """The waves at that time."""
        turned = self._turn * steps
        targets = self._centre + self._amplitude * waved(turned + self._phase, self._form)
        for joint, amplitude, order, phase in self._harmonics:
            targets[joint] += amplitude * math.sin(order * turned + phase)
        return np.asarray(targets)


class Replay:
    """As recorded, over and over; joints that were not recorded stay at rest."""

    def __init__(self, gait: GaitSpec, body: Morphology, control_step: float) -> None:
        assert gait.file is not None, "a replay has a file"
        self._recording = read_recording(gait.file)
        self._joints, self._rest, self._step = list(body.joints), body.rest, control_step

    def posture(self, steps: float) -> Vector:
        """Between two recorded postures in proportion."""
        return self._recording.posture(steps * self._step, self._joints, self._rest)


class Performer:
    """Performs a motion on its occasions, each time from the start, and lies flat in between."""

    def __init__(self, gait: GaitSpec, body: Morphology, control_step: float, motion: Motion) -> None:
        self._motion, self._rest = motion, body.rest
        self._occasion = occasion_of(gait, control_step)
        self._roles = twins(body) if gait.mirrored else None
        self._stretched = gait.stretched
        self._steps = 0

    def act(self, observation: Mapping[str, Vector]) -> Vector:
        """Joint targets of this step."""
        if not self._occasion.calls(observation):
            self._steps = 0
            return self._rest
        targets = self._motion.posture(self._steps / self._stretched)
        self._steps += 1
        return targets if self._roles is None else targets[self._roles]


MOTIONS: dict[str, Callable[[GaitSpec, Morphology, float], Motion]] = {
    "still": Still,
    "cyclic": Cyclic,
    "replay": Replay,
    "push": Still,  # the world does it, see events.py
}


def scripted_policy(gait: GaitSpec, body: Morphology, control_step: float) -> Policy:
    """The policy that performs a gait with this body.

    Raises:
        UserError: If the gait has yet to be drawn, or its recording cannot be read.
    """
    if gait.kind not in MOTIONS:
        raise UserError(
            f"the {gait.kind} gait has yet to be drawn", "use testbed.scenario.drawn(scenario, trial)"
        )
    return Performer(gait, body, control_step, MOTIONS[gait.kind](gait, body, control_step))
