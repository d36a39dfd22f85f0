"""A check and what came of it: passed, failed with its mend, or left out with the reason."""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from testbed.errors import UserError
from testbed.hardware.failures import HardwareFailure


class Outcome(enum.StrEnum):
    """What came of a check."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "left out"


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        about: An agent, ``left camera``, ``cameras`` or ``this machine``.
        name: What was checked.
        outcome: What came of it.
        found: What was seen, in words, with numbers.
        mend: What to do about it; empty unless it failed.
        failure: The failure's name, where it has one.
    """

    about: str
    name: str
    outcome: Outcome
    found: str
    mend: str = ""
    failure: str | None = None

    def as_row(self) -> dict[str, str | None]:
        """As plain data."""
        return {
            "about": self.about,
            "check": self.name,
            "outcome": str(self.outcome),
            "found": self.found,
            "mend": self.mend,
            "failure": self.failure,
        }


def passed(about: str, name: str, found: str) -> Check:
    """A check that found all well."""
    return Check(about, name, Outcome.PASSED, found)


def skipped(about: str, name: str, why: str) -> Check:
    """A check that could not be made."""
    return Check(about, name, Outcome.SKIPPED, why)


def failed(about: str, name: str, error: UserError) -> Check:
    """A check that found something wrong."""
    outcome = error.outcome if isinstance(error, HardwareFailure) else None
    return Check(about, name, Outcome.FAILED, error.what, error.mend, outcome)


def checked(about: str, name: str, look: Callable[[], str]) -> Check:
    """Make a check that says what it found, or raises what is wrong."""
    try:
        return passed(about, name, look())
    except UserError as error:
        return failed(about, name, error)


def all_well(checks: Iterable[Check]) -> bool:
    """Whether nothing failed."""
    return all(check.outcome is not Outcome.FAILED for check in checks)
