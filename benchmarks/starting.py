"""How long until something happens: the commands that only answer, and what is compiled once."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.measure import Seconds, Settings, command, pinned
from benchmarks.row import Row, measured, within

TESTBED = (sys.executable, "-m", "testbed")
HELP_SECONDS, CHECK_SECONDS, COMPILE_SECONDS = 0.3, 1.0, 10.0
COMPILING_ROUNDS = 3


def rows(settings: Settings) -> Iterator[Row]:
    """By the clock, each in a process of its own; the files are in the system's cache."""
    for name, arguments, limit in (
        ("`testbed --help`", ("--help",), HELP_SECONDS),
        ("`testbed check whom_to_imitate`", ("check", "whom_to_imitate"), CHECK_SECONDS),
    ):
        command([*TESTBED, *arguments])
        seconds = np.array([command([*TESTBED, *arguments])[0] for _ in range(settings.rounds)])
        yield within(name, limit, seconds, note="by the clock")
    yield from compiling(min(settings.rounds, COMPILING_ROUNDS))


def compiling(rounds: int) -> Iterator[Row]:
    """A short run of every phase with an empty cache, less the same run with what that left behind."""
    first, again, made = first_and_again(rounds)
    why = "some 80 functions, typed and lowered in Python and optimised by LLVM; why not C, see above"
    yield within(
        "compilation in an empty cache",
        COMPILE_SECONDS,
        first - again,
        note="on one core; " + in_short(first, again),
        why=why,
    )
    most = float(made)
    yield measured(
        "files compiled by the second run", "files", (most, most, most), 0.0, "at most", rounds=rounds
    )
    with pinned(pin=False):
        first, again, _ = first_and_again(rounds)
    yield within(
        "compilation in an empty cache, by the clock",
        COMPILE_SECONDS,
        first - again,
        note="all cores, what looking takes is compiled beside; " + in_short(first, again),
        why=why,
    )


def in_short(first: Seconds, again: Seconds) -> str:
    """What the compilation is the difference of."""
    return f"a first run of {np.median(first):.1f} s less the same again of {np.median(again):.1f} s"


def first_and_again(rounds: int) -> tuple[Seconds, Seconds, int]:
    """Seconds of runs with an empty cache (rounds,), of the same once more, and the most files these added."""
    first, again, made = [], [], []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            cache = Path(folder) / "cache"
            first.append(smoke(Path(folder) / "cold", cache))
            before = compiled_files(cache)
            again.append(smoke(Path(folder) / "warm", cache))
            made.append(len(compiled_files(cache) - before))
    return np.array(first), np.array(again), max(made)


def smoke(out: Path, cache: Path) -> float:
    """Seconds of the scenario of `make run`, cut down."""
    arguments = [*TESTBED, "run", "whom_to_imitate", "--smoke", "--out", str(out)]
    return command(arguments, NUMBA_CACHE_DIR=str(cache))[0]


def compiled_files(cache: Path) -> set[tuple[str, int]]:
    """Names and times of what is in the cache."""
    return {(str(file), file.stat().st_mtime_ns) for file in cache.rglob("*.nb*")}
