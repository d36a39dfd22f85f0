"""benchmarks/results.json: what every group came to, kept from one time to the next."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.row import Row
from testbed.experiment.atomic import write_text
from testbed.experiment.provenance import source_revision

FILE = Path(__file__).parent / "results.json"


def known() -> dict[str, Any]:
    """What was measured on this machine before; nothing of another one."""
    try:
        before = json.loads(FILE.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        before = {}
    same = before.get("machine") == machine() and "groups" in before
    return {"machine": machine(), "groups": before["groups"] if same else {}}


def entered(name: str, about: str, rows: Sequence[Row], seconds: float, order: Sequence[str]) -> None:
    """Write a group's rows into the file, in its place among the others."""
    results = known()
    groups = results["groups"]
    groups[name] = {
        "about": about,
        "revision": revision(),
        "seconds": round(seconds, 1),
        "rows": [row.as_json() for row in rows],
    }
    results["groups"] = {each: groups[each] for each in order if each in groups}
    # For programs: every row in one list, as it was before there were groups.
    results["rows"] = [row for group in results["groups"].values() for row in group["rows"]]
    write_text(FILE, json.dumps(results, indent=1, ensure_ascii=False) + "\n")


def missed(groups: Mapping[str, Any]) -> list[str]:
    """Names of the rows whose target is not reached."""
    return [row["name"] for group in groups.values() for row in group["rows"] if row["met"] is False]


def machine() -> dict[str, Any]:
    """On what this runs."""
    return {"processor": _processor(), "cores": os.cpu_count(), "python": platform.python_version()}


def revision() -> str:
    """The commit, and whether files differ from it."""
    source = source_revision()
    if source is None:
        return "no checkout"
    return str(source["commit"])[:7] + (" with changes" if source["modified"] else "")


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "unknown")
