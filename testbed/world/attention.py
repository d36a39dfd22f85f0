"""When teachers move: while they are watched, always, or in answer to what the student does.

A teacher knows what it senses: ``gaze``, how far the rig's axis passes it by, and ``movement``, how fast the student's
fastest limb turns. A new occasion is a class with ``calls`` and ``reset`` and one line in :func:`occasion_of`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

from testbed.bodies.morphology import Vector
from testbed.scenario.gait import AnswerSpec, GaitSpec

ATTENTION = math.radians(10)
"""A rig whose axis passes a teacher by less than this is watching it (rad); well under half the field of view, so
that two teachers who do not share a view are never both watched."""


class Occasion(Protocol):
    """What makes a teacher move."""

    def reset(self) -> None:
        """An episode begins."""
        ...

    def calls(self, observation: Mapping[str, Vector]) -> bool:
        """Whether to move in this step; asked once a step."""
        ...


class Always:
    """Moves at all times."""

    def reset(self) -> None:
        """Nothing to forget."""

    def calls(self, observation: Mapping[str, Vector]) -> bool:
        """Yes."""
        return True


class Watched:
    """Moves while the student looks: who crawled all the time would be out of sight before it does."""

    def reset(self) -> None:
        """Nothing to forget."""

    def calls(self, observation: Mapping[str, Vector]) -> bool:
        """If the rig is turned this way."""
        return watched(float(observation["gaze"][0]))


class Answering:
    """Moves after the student has moved: a little later, and for a while after the last movement that it saw.

    Section 5 of the paper calls it a social contingency cue: a student could find out by moving who answers.
    """

    def __init__(self, answer: AnswerSpec, control_step: float) -> None:
        self._least = math.radians(answer.least_speed_deg)
        self._delay = round(answer.delay / control_step)
        self._duration = max(1, round(answer.duration / control_step))
        self.reset()

    def reset(self) -> None:
        """It has seen nothing yet."""
        self._since_first: int | None = None
        self._since_last = 0

    def calls(self, observation: Mapping[str, Vector]) -> bool:
        """If what it saw is long enough ago to answer, and not longer."""
        if self._since_first is not None:
            self._since_first += 1
            self._since_last += 1
        if float(observation["movement"][0]) >= self._least:
            self._since_first = self._since_first or 0
            self._since_last = 0
        if self._since_first is None or self._since_first < self._delay:
            return False
        if self._since_last >= self._delay + self._duration:
            self._since_first = None
            return False
        return True


def watched(gaze: float) -> bool:
    """Whether a rig whose axis passes a teacher by this angle (rad) is watching it."""
    return abs(gaze) <= ATTENTION


def occasion_of(gait: GaitSpec, control_step: float) -> Occasion:
    """What makes a teacher with this gait move."""
    if gait.when == "answering":
        return Answering(gait.answer, control_step)
    return Always() if gait.when == "always" else Watched()
