"""Does a worker grow? Its memory over many cheap trials, one after the other in one process."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.measure import Settings, pinned
from benchmarks.row import Row, measured
from testbed.scenario import parse_scenario, with_overrides

SCENARIO = """\
name: cheap
seed: 7
student: {student}
world: {{physics_step: 0.0166666667}}
rig: {{camera_rate: 5}}
teachers: [{{robot: crawler, gait: crawl, distance: 0.9, bearing_deg: -30}}]
"""
TRIALS = {"paper": 150, "like_me": 40}
ALL = 1000
SETTLED = 0.25  # of the trials, after which everything has been loaded
FLAT = 1.0  # kB a trial: 1 MB in a thousand
BLOCKS = 10


def rows(settings: Settings) -> Iterator[Row]:
    """One fresh process for each student."""
    for student, some in TRIALS.items():
        trials = ALL if settings.full else some
        with pinned(pin=True):
            resident = in_a_worker(student, trials)
        note = f"{resident[0] / 1024:.0f} MB after one trial, {resident[-1] / 1024:.0f} MB after {trials}"
        figure = slope(resident[int(SETTLED * trials) :])
        name = f"memory of a worker, short trials of {student}"
        why = "" if settings.full else "too few trials to tell; over 1000 it is flat, see above"
        yield measured(name, "kB a trial", figure, FLAT, "at most", rounds=trials, note=note, why=why)


def in_a_worker(student: str, trials: int) -> np.ndarray:
    """(trials,) resident kB of a spawned process after each trial."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return np.array(pool.apply(lived, (student, trials)))


def lived(student: str, trials: int) -> list[int]:
    from testbed.experiment.trial import run_trial

    scenario = with_overrides(parse_scenario(SCENARIO.format(student=student)), smoke=True)
    resident = []
    for trial in range(trials):
        run_trial(scenario, trial)
        resident.append(int(Path("/proc/self/statm").read_text().split()[1]) * 4)  # pages of 4 kB
    return resident


def slope(resident: np.ndarray) -> tuple[float, float, float]:
    """kB a trial by least squares, with a 95 % interval from leaving out blocks (jackknife: memory grows in steps)."""
    places = np.arange(len(resident))
    whole = float(np.polyfit(places, resident, 1)[0])
    blocks = places * BLOCKS // len(places)
    others = np.array([np.polyfit(places[blocks != b], resident[blocks != b], 1)[0] for b in range(BLOCKS)])
    spread = 1.96 * float(np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((others - others.mean()) ** 2)))
    return whole, whole - spread, whole + spread
