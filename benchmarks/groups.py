"""What is measured, in the order of the table. A new group is a module with ``rows`` and a line here."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from benchmarks import (
    asking,
    growing,
    living,
    modelling,
    phases,
    remembering,
    seeing,
    starting,
    sweeping,
    trials,
    worlds,
)
from benchmarks.measure import Settings
from benchmarks.row import Row


@dataclass(frozen=True)
class Group:
    """Rows that are measured together.

    Attributes:
        rows: Measures them.
        about: What they are about, for the table.
        seconds: How long that takes, roughly, where it has not been done yet.
    """

    rows: Callable[[Settings], Iterator[Row]]
    about: str
    seconds: float


GROUPS = {
    "seeing": Group(
        seeing.rows, "Which of K requested pixels does a model darken; time of one model in one camera.", 60
    ),
    "modelling": Group(modelling.rows, "The paper's estimation-exploration algorithm, one teacher.", 70),
    "living": Group(living.rows, "What the student tries out in its mind; five times as many turns.", 80),
    "worlds": Group(worlds.rows, "Control steps of the world; the peer's time over ours.", 40),
    "phases": Group(phases.rows, "Single phases of a life, with the shipped parameters.", 60),
    "trials": Group(trials.rows, "Whole trials and runs.", 400),
    "starting": Group(starting.rows, "Cold starts, each in a process of its own.", 120),
    "growing": Group(growing.rows, "Exponents of a power law: 1 is linear.", 150),
    "remembering": Group(remembering.rows, "Resident memory of one process, trial after trial.", 200),
    "sweeping": Group(sweeping.rows, "Sweeps: what they cost beyond their work.", 200),
    "asking": Group(asking.rows, "Questions to finished runs.", 20),
}
