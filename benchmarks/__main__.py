"""Measure, print the table, and write benchmarks/results.json and docs/benchmarks.md.

    python -m benchmarks                  everything
    python -m benchmarks seeing living    some groups; the others keep the figures that they have
    python -m benchmarks --full           what is otherwise scaled from a part is measured as a whole

Exit status 1 if a target is missed. Ctrl-C keeps the groups that are finished.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks import groups, results, table
from benchmarks.measure import ROUNDS, Settings, pinned

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "benchmarks.md"
_STOPPED = 130  # 128 + SIGINT


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    parser = _parser()
    wanted = parser.parse_args(arguments)
    names = wanted.groups or list(groups.GROUPS)
    unknown = [name for name in names if name not in groups.GROUPS]
    if unknown:
        parser.error(f"there is no group {', '.join(unknown)}; there are {', '.join(groups.GROUPS)}")
    settings, console = Settings(rounds=wanted.rounds, full=wanted.full), Console()
    status = _all(names, settings, console)
    found = results.known()
    shown = {name: group for name, group in found["groups"].items() if name in names}
    if not sys.stdout.isatty():
        console.width = 240
    console.print(table.terminal(shown))
    if wanted.write:
        console.print(_documented(found), markup=False, soft_wrap=True)
    missed = results.missed(shown)
    rows = sum(len(group["rows"]) for group in shown.values())
    console.print(f"{len(missed)} of {rows} rows missed; {results.FILE}", soft_wrap=True)
    return status or int(bool(missed))


def _all(names: Sequence[str], settings: Settings, console: Console) -> int:
    """Measure group after group; one that fails does not keep the others from being measured. Returns a status."""
    expected, status = {name: _seconds_before(name) for name in names}, 0
    for number, name in enumerate(names):
        left = sum(expected[later] for later in names[number:])
        console.print(f"[{number + 1}/{len(names)}] {name}: about {left / 60:.0f} min to go", markup=False)
        try:
            _measured(name, settings, console)
        except KeyboardInterrupt:
            console.print(f"stopped in {name}; what was finished is kept", markup=False)
            return _STOPPED
        except Exception:
            console.print_exception()
            console.print(f"{name} failed; it keeps the figures that it had", markup=False)
            status = 1
    return status


def _measured(name: str, settings: Settings, console: Console) -> None:
    """Measure a group and keep it; says each row as it comes."""
    rows, begin = [], time.perf_counter()
    with pinned(pin=True):
        for row in groups.GROUPS[name].rows(settings):
            rows.append(row)
            what, against, *_, figure, interval, target, met, _note = table.cells(row.as_json())
            line = f"  {what} / {against}: {figure} ({interval}) {target} {met}"
            console.print(line, markup=False, highlight=False, soft_wrap=True)
    spent = time.perf_counter() - begin
    results.entered(name, groups.GROUPS[name].about, rows, spent, list(groups.GROUPS))


def _documented(found: Mapping[str, Any]) -> str:
    """Write the documentation's table, if there is all of it; says which."""
    absent = [name for name in groups.GROUPS if name not in found["groups"]]
    if absent:
        return f"{DOCUMENT} stays as it is: {', '.join(absent)} not measured on this machine"
    table.put_between_markers(DOCUMENT, table.markdown(found))
    return f"written to {DOCUMENT}"


def _seconds_before(name: str) -> float:
    """How long a group took the last time, or may take."""
    before = results.known()["groups"].get(name)
    return float(before["seconds"]) if before else groups.GROUPS[name].seconds


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Measures how fast the testbed is."
    )
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=", ".join(groups.GROUPS))
    parser.add_argument(
        "--full", action="store_true", help="measure as a whole what is otherwise scaled from a part"
    )
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"turns of everybody; {ROUNDS} by default")
    parser.add_argument(
        "--no-write", dest="write", action="store_false", help="leave docs/benchmarks.md as it is"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
