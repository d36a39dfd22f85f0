"""How a measurement is taken: everybody's turns alternate, on one core, and a ratio carries an interval."""

from __future__ import annotations

import contextlib
import os
import resource
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Seconds = NDArray[np.float64]  # (rounds,)
ROUNDS = 9
"""A median of nine has an interval that a single disturbed round does not widen much."""
GIVEN = frozenset(os.sched_getaffinity(0))
"""The cores that this process had when it began."""
_TURN = 0.03  # s: a turn lasts at least so long, so that the clock's own cost does not count
_RESAMPLES = 4000


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How much is measured.

    Attributes:
        rounds: Turns of each contender.
        full: Whether what is otherwise scaled from a part is measured as a whole.
    """

    rounds: int = ROUNDS
    full: bool = False


def interleaved(
    contenders: Mapping[str, Callable[[], object]],
    rounds: int,
    *,
    turn: float = _TURN,
    once: bool = False,
    before: Callable[[], object] | None = None,
    clock: Callable[[], float] = time.process_time,
) -> dict[str, Seconds]:
    """Seconds a call of each contender in each round; the order rotates, and all are warm.

    Args:
        contenders: What to call, by name.
        rounds: How often each has its turn.
        turn: A turn makes as many calls as fit into this (s), at least one.
        once: A turn is one call, and the first calls, which warm up, count like the others.
        before: Called before each turn, unmeasured; makes caches cold.
        clock: Processor time by default: a neighbour's load on the machine hardly counts. In seconds.
    """
    counts = dict.fromkeys(contenders, 1)
    if not once:
        for name, call in contenders.items():
            call()
            begin = clock()
            call()
            spent = max(clock() - begin, 1e-6)
            counts[name] = max(1, int(turn / spent)) if before is None else 1
    names = list(contenders)
    times = {name: np.empty(rounds) for name in names}
    for this in range(rounds):
        first = this % len(names)
        for name in names[first:] + names[:first]:
            if before is not None:
                before()
            call, count = contenders[name], counts[name]
            begin = clock()
            for _ in range(count):
                call()
            times[name][this] = (clock() - begin) / count
    return times


def ratio(theirs: Seconds, ours: Seconds) -> tuple[float, float, float]:
    """How many times faster we are: the median of the rounds' ratios, and its 95 % bootstrap interval.

    Both have their turns right after each other: a machine that is slow for a while is slow to both.
    """
    each = theirs / ours
    pick = np.random.default_rng(0).integers(0, len(each), (_RESAMPLES, len(each)))
    low, high = np.quantile(np.median(each[pick], axis=1), (0.025, 0.975))
    return float(np.median(each)), float(low), float(high)


def exponent(sizes: Sequence[float], seconds: NDArray[np.float64]) -> tuple[float, float, float]:
    """How cost grows, as a power of the size, with a 95 % bootstrap interval over the rounds.

    Args:
        sizes: (n,) how large.
        seconds: (rounds, n) what it cost.
    """
    logs = np.log(np.asarray(sizes, dtype=float))
    pick = np.random.default_rng(0).integers(0, len(seconds), (_RESAMPLES, len(seconds)))
    slopes = np.polyfit(logs, np.log(np.median(seconds[pick], axis=1)).T, 1)[0]
    low, high = np.quantile(slopes, (0.025, 0.975))
    return float(np.polyfit(logs, np.log(np.median(seconds, axis=0)), 1)[0]), float(low), float(high)


@contextlib.contextmanager
def pinned(*, pin: bool) -> Iterator[None]:
    """Keep this process, and those that it starts, on one core while this lasts; or on all that it was given."""
    before = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {max(GIVEN)} if pin else GIVEN)
        yield
    finally:
        os.sched_setaffinity(0, before)


def command(arguments: Sequence[str], **environment: str) -> tuple[float, float]:
    """Run a command to its end: seconds by the clock, and of processors, its children's included.

    Raises:
        RuntimeError: If it fails; with the end of what it said.
    """
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begin = time.perf_counter()
    done = subprocess.run(arguments, capture_output=True, text=True, env={**os.environ, **environment})
    wall = time.perf_counter() - begin
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)} failed: {(done.stdout + done.stderr)[-500:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
