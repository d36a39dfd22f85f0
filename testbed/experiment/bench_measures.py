"""What a comparison of bench and simulation comes to: one line a measure, each with its N and its interval."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.experiment.sim_and_bench import Comparison, Row
from testbed.experiment.statistics import Interval, bootstrap_mean, wilson

_SEED = 0  # the page must not change when it is made again
Values = Sequence[tuple[int, float]]
"""(trial, value) each."""


class Measure(NamedTuple):
    """One thing that was measured on both sides.

    Attributes:
        name: What.
        unit: Of all figures; "" for shares.
        n: How many values ...
        of: ... of what.
        trials: In how many trials.
        simulation: Its mean in simulation; None where only the difference means anything.
        bench: Its mean on the bench.
        gap: The mean of bench less simulation, or of the size of their difference.
        interval: 95%, of the gap; None where there is too little for one.
        over: What the interval was drawn over.
    """

    name: str
    unit: str
    n: int
    of: str
    trials: int
    simulation: float | None
    bench: float | None
    gap: float
    interval: Interval | None
    over: str


def measures(told: Comparison) -> list[Measure]:
    """Every measure for which there is something on both sides."""
    return [*_tilt(told), *_rolls(told), *_verdicts(told), *_paths(told)]


def document(told: Comparison) -> dict[str, Any]:
    """The contents of ``comparison.json``."""
    return {
        "scenario": told.bench.scenario.name,
        "hash": told.bench.hash8,
        "simulation": str(told.simulation.path),
        "bench": str(told.bench.path),
        "trials": [str(job) for job in told.jobs],
        "measures": [
            {**each._asdict(), "interval": None if each.interval is None else list(each.interval)}
            for each in measures(told)
        ],
        "lags": [
            {"trial": each.trial, "teacher": each.teacher, "lag_s": round(each.lag, 9)} for each in told.rolls
        ],
        "verdicts": [
            {
                **{key: ours[key] for key in ("cell", "trial", "student", "teacher", "robot", "truth")},
                "simulation": ours["verdict"],
                "bench": theirs["verdict"],
                "simulation_score": ours["score"],
                "bench_score": theirs["score"],
            }
            for ours, theirs in told.verdicts
        ],
    }


def agreed(told: Comparison) -> tuple[int, int]:
    """In how many verdicts, of how many, the two agree."""
    return sum(ours["verdict"] == theirs["verdict"] for ours, theirs in told.verdicts), len(told.verdicts)


def _tilt(told: Comparison) -> list[Measure]:
    if not told.tilts:
        return []
    found = []
    for axis, name in ((1, "nose-down"), (0, "to the side")):
        triples = [
            (each.trial, float(felt), float(simulated))
            for each in told.tilts
            for felt, simulated in zip(
                np.degrees(each.felt[:, axis]), np.degrees(each.simulated[:, axis]), strict=True
            )
        ]
        gaps = [(trial, felt - simulated) for trial, felt, simulated in triples]
        found.append(
            _measure(
                f"tilt after a command, {name}",
                "°",
                "commands",
                gaps,
                simulation=float(np.mean([row[2] for row in triples])),
                bench=float(np.mean([row[1] for row in triples])),
            )
        )
    sizes = [
        (each.trial, float(math.degrees(np.linalg.norm(gap))))
        for each in told.tilts
        for gap in each.felt - each.simulated
    ]
    return [*found, _measure("size of the difference in tilt", "°", "commands", sizes)]


def _rolls(told: Comparison) -> list[Measure]:
    found = []
    for truth in ("appropriate", "inappropriate"):
        kinds = {
            (row["trial"], row["teacher"]): row["truth"] for row, _ in told.verdicts
        }  # of every mind the same
        rolls = [each for each in told.rolls if kinds.get((each.trial, each.teacher)) == truth]
        # A part of a teacher is one piece of evidence: its frames follow from each other.
        gaps = [
            (each.trial, float(np.degrees(np.sqrt(np.mean(column**2)))))
            for each in rolls
            for column in each.gaps.T
        ]
        if gaps:
            word = "like" if truth == "appropriate" else "unlike"
            frames = sum(each.bench.size for each in rolls)
            name = f"rolls of teachers {word} the student, rms difference"
            found.append(_measure(name, "°", f"parts ({frames} rolls)", gaps))
    return found


def _verdicts(told: Comparison) -> list[Measure]:
    found = []
    for student in dict.fromkeys(str(ours["student"]) for ours, _ in told.verdicts):
        pairs = [pair for pair in told.verdicts if pair[0]["student"] == student]
        n = len(pairs)
        same = sum(ours["verdict"] == theirs["verdict"] for ours, theirs in pairs)
        right = [sum(_right(pair[side]) for pair in pairs) / n for side in (0, 1)]
        trials = len({(ours["cell"], ours["trial"]) for ours, _ in pairs})
        found.append(
            Measure(
                f"verdicts of {student} that agree",
                "",
                n,
                "verdicts",
                trials,
                right[0],
                right[1],
                same / n,
                wilson(same, n),
                "verdicts",
            )
        )
    return found


def _right(row: Row) -> bool:
    return bool(row["verdict"] == row["truth"])


def _paths(told: Comparison) -> list[Measure]:
    if not told.paths:
        return []

    def end(path: NDArray[Any]) -> float:
        return 100 * float(np.hypot(*path[-1]))

    ways = [(each.trial, end(each.simulation), end(each.bench), end(each.twin)) for each in told.paths]
    apart = [
        (each.trial, 100 * float(np.linalg.norm(each.bench - each.twin, axis=1).max())) for each in told.paths
    ]

    def mean(value: Callable[[tuple[int, float, float, float]], float]) -> float:
        return float(np.mean([value(way) for way in ways]))

    return [
        _measure(
            "distance performed",
            "cm",
            "performances",
            [(way[0], way[2] - way[1]) for way in ways],
            simulation=mean(lambda way: way[1]),
            bench=mean(lambda way: way[2]),
        ),
        _measure(
            "distance under the bench's own commands",
            "cm",
            "performances",
            [(way[0], way[2] - way[3]) for way in ways],
            simulation=mean(lambda way: way[3]),
            bench=mean(lambda way: way[2]),
        ),
        _measure("farthest that the two paths are apart, same commands", "cm", "performances", apart),
    ]


def _measure(
    name: str,
    unit: str,
    of: str,
    values: Values,
    *,
    simulation: float | None = None,
    bench: float | None = None,
) -> Measure:
    by_trial: dict[int, list[float]] = {}
    for trial, value in values:
        by_trial.setdefault(trial, []).append(value)
    several = len(by_trial) > 1
    # Values of a trial share a body and a calibration: with several trials these are what is drawn.
    drawn = [float(np.mean(group)) for group in by_trial.values()] if several else [v for _, v in values]
    interval = bootstrap_mean(drawn, np.random.default_rng(_SEED)) if len(drawn) > 1 else None
    mean = float(np.mean([value for _, value in values]))
    over = "trials" if several else of.split(" ")[0]
    return Measure(name, unit, len(values), of, len(by_trial), simulation, bench, mean, interval, over)
