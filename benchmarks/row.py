"""A line of the table is data: what was measured against what, what came out, and whether that is enough."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import Seconds, ratio

LIMIT = "limit"
"""In a peer's place: the longest that something may take."""
Sense = Literal["at least", "at most"]
_UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns"))


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line.

    Attributes:
        name: What was done.
        peer: By whom else; or ``limit``, where there is a time that it may take and nobody else.
        ratio: How many times faster we are than the peer, or than the limit; or what ``unit`` says. None: left out.
        ratio_low: Lower end of its 95 % interval.
        ratio_high: Upper end.
        target: What ``ratio`` is to be; None where the row only informs.
        sense: On which side of the target it is to be.
        unit: Of the ratio and the target; empty for times faster.
        ours: Our median, with its unit.
        theirs: The peer's, or the limit.
        rounds: How many turns each had.
        note: What else is worth knowing.
        why: Why the target is missed, if it is.
    """

    name: str
    peer: str
    ratio: float | None
    ratio_low: float | None = None
    ratio_high: float | None = None
    target: float | None = None
    sense: Sense = "at least"
    unit: str = ""
    ours: str = ""
    theirs: str = ""
    rounds: int = 0
    note: str = ""
    why: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the whole interval is on the right side of the target; None where there is nothing to meet."""
        if self.target is None or self.ratio_low is None or self.ratio_high is None:
            return None
        return self.ratio_low >= self.target if self.sense == "at least" else self.ratio_high <= self.target

    def as_json(self) -> dict[str, Any]:
        """Everything, ``met`` included."""
        return {**asdict(self), "met": self.met}


def faster(
    name: str, peer: str, theirs: Seconds, ours: Seconds, target: float | None = None, **words: Any
) -> Row:
    """How many times faster we were than a peer, each (rounds,) seconds a call."""
    middle, low, high = ratio(theirs, ours)
    return Row(
        name=name,
        peer=peer,
        ratio=middle,
        ratio_low=low,
        ratio_high=high,
        target=target,
        rounds=len(ours),
        ours=in_words(ours),
        theirs=in_words(theirs),
        **words,
    )


def within(name: str, limit: float, ours: Seconds, **words: Any) -> Row:
    """Whether something takes no longer than ``limit`` (s); the ratio is how many times it would fit in."""
    return faster(name, LIMIT, np.full_like(ours, limit), ours, 1.0, **words)


def measured(
    name: str,
    unit: str,
    figure: tuple[float, float, float],
    target: float | None,
    sense: Sense,
    **words: Any,
) -> Row:
    """Something that is no time: its middle and its interval, in a unit."""
    middle, low, high = figure
    peer = words.pop("peer", LIMIT)
    return Row(
        name=name,
        peer=peer,
        ratio=middle,
        ratio_low=low,
        ratio_high=high,
        target=target,
        sense=sense,
        unit=unit,
        **words,
    )


def left_out(name: str, peer: str, why: str) -> Row:
    """A line that could not be measured here, and why."""
    return Row(name=name, peer=peer, ratio=None, note=f"left out: {why}")


def in_words(seconds: NDArray[np.float64]) -> str:
    """The median with a unit that suits it."""
    middle = float(np.median(seconds))
    for size, unit in _UNITS:
        if middle >= size:
            return f"{middle / size:.3g} {unit}"
    return f"{middle:.3g} s"
