"""What a run computes of a job: one whole life. Workers load this file and not what runs, sums up and writes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job
from testbed.experiment.record import TrialResult
from testbed.scenario import Scenario, check_trial

if TYPE_CHECKING:
    from testbed.experiment.stage import Opener


def live(scenario: Scenario, job: Job, progress: Progress, *, idle: int = 0) -> TrialResult:
    """Compute one trial: the student discovers itself, looks, imitates and decides; ``idle`` cores may help."""
    from testbed.experiment.trial import run_trial  # physics and compiled kernels, loaded by who computes

    if scenario.sweep:
        check_trial(scenario, job.cell, job.trial)  # the check before the run looks at some cells only
    return run_trial(scenario, job.trial, progress, cell=job.cell, idle=idle)


def live_on(stage: Opener, folder: Path, scenario: Scenario, job: Job, progress: Progress) -> TrialResult:
    """Compute one trial on a bench, with a journal in the run directory."""
    from testbed.experiment.replay import journal_below
    from testbed.experiment.trial import run_trial

    return run_trial(
        scenario, job.trial, progress, cell=job.cell, stage=stage, journal=journal_below(folder, job)
    )
