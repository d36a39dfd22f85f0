"""Measure everything and write benchmarks/results.json; exit status 1 if a target is missed."""

from __future__ import annotations

import json
import os
import platform
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import asking, living, rendering, seeing, sweeping


def main() -> int:
    rows = [*seeing.rows(), *living.rows(), *rendering.rows(), *sweeping.rows(), *asking.rows()]
    machine = {"processor": _processor(), "cores": os.cpu_count(), "python": platform.python_version()}
    file = Path(__file__).parent / "results.json"
    file.write_text(json.dumps({"rows": rows, "machine": machine}, indent=2) + "\n")

    columns = ("what", "against", "times faster", "95% interval", "target", "met", "note")
    table = Table(*columns, title="Benchmarks")
    for row in rows:
        interval = f"{row['ratio_low']:.3g} to {row['ratio_high']:.3g}"
        met = "yes" if row["met"] else "NO"
        table.add_row(
            row["name"], row["peer"], f"{row['ratio']:.3g}", interval, f"{row['target']:g}", met, row["note"]
        )
    console = Console()
    console.print(table)
    console.print(f"written to {file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file}")
    return 0 if all(row["met"] for row in rows) else 1


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "unknown")


if __name__ == "__main__":
    sys.exit(main())
