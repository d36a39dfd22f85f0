"""Asking the person at the bench: what to do with their hands, or what they see.

A question is plain data beside its text, so that an emulated bench's "hands" can do what it says. While a person
thinks, servos must go on being told where to be, or they go limp: whoever asks hands over what to do ``meanwhile``.
"""

from __future__ import annotations

import select
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

_PATIENCE = 0.1  # s between two calls of ``meanwhile``: a third of what a board bears in silence


@dataclass(frozen=True)
class Question:
    """Something that a person is asked.

    Attributes:
        kind: What is asked: ``servo_angle``, ``servo_nudge``, ``tilt``, ``place``, ``board``...
        about: The agent or device that it is about.
        text: The question in words.
        details: The same as plain data: numbers and words by name.
    """

    kind: str
    about: str
    text: str
    details: Mapping[str, float | str] = field(default_factory=dict)


def nothing() -> None:
    """Nothing is to be done meanwhile."""


class Prompt(Protocol):
    """Asks a question and returns the answer, as typed."""

    def __call__(self, question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        """``meanwhile`` is to be called some ten times a second until the answer is there."""
        ...


def console(question: Question, meanwhile: Callable[[], None] = nothing) -> str:
    """The :class:`Prompt` of a terminal: asks on standard error, reads a line of standard input."""
    sys.stderr.write(f"{question.text} ")
    sys.stderr.flush()
    while not select.select([sys.stdin], [], [], _PATIENCE)[0]:
        meanwhile()
    return sys.stdin.readline().strip()
