"""What there is to compute: the trials of a scenario, cell by cell."""

from __future__ import annotations

from dataclasses import dataclass

from testbed.scenario import Scenario, cell_names, trials_of

DEFAULT_CELL = "default"


@dataclass(frozen=True, order=True)
class Job:
    """One trial of one cell; a cell is one setting of what is swept."""

    cell: str
    trial: int

    def __str__(self) -> str:
        return f"trial {self.trial}" if self.cell == DEFAULT_CELL else f"{self.cell}, trial {self.trial}"


def jobs_of(scenario: Scenario) -> tuple[Job, ...]:
    """Every trial that the scenario asks for, in the order in which results are listed."""
    return tuple(
        Job(cell, trial) for cell in cell_names(scenario) for trial in range(trials_of(scenario, cell))
    )
