"""Where a run was computed: in simulation, or on a bench."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from testbed.experiment.run_directory import RunDirectory, default_path
from testbed.scenario import Scenario

SIMULATION, HARDWARE = "simulation", "hardware"
BACKENDS = (SIMULATION, HARDWARE)


def backend_of(run: RunDirectory) -> str:
    """Where a run was computed: in ``simulation``, or on ``hardware``."""
    return str(run.provenance.get("backend", SIMULATION))


def sim_and_bench(folders: Sequence[Path]) -> tuple[RunDirectory, RunDirectory] | None:
    """The two runs, simulation first, if they are one scenario in simulation and on the bench; None otherwise."""
    if len(folders) != 2:
        return None
    runs = sorted((RunDirectory.open(folder) for folder in folders), key=backend_of, reverse=True)
    simulation, bench = runs
    if (backend_of(simulation), backend_of(bench)) != (SIMULATION, HARDWARE):
        return None
    return (simulation, bench) if simulation.hash8 == bench.hash8 else None


def bench_path(scenario: Scenario) -> Path:
    """``runs/<scenario>-<hash8>-bench``: beside the same scenario's run in simulation."""
    path = default_path(scenario)
    return path.with_name(f"{path.name}-bench")
