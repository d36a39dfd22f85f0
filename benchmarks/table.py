"""The results to look at: a table for the terminal, and one for docs/benchmarks.md, both from the same rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.row import LIMIT

COLUMNS = ("what", "against", "ours", "theirs", "times faster", "95% interval", "to reach", "met", "note")
BEGIN, END = "<!-- begin: written by make bench -->", "<!-- end -->"

Entry = Mapping[str, Any]  # a row as it is in results.json


def cells(row: Entry) -> tuple[str, ...]:
    """What stands in each column."""
    unit = f" {row['unit']}" if row["unit"] else ""
    figure = "-" if row["ratio"] is None else f"{_short(row['ratio'])}{unit}"
    interval = "" if row["ratio"] is None else f"{_short(row['ratio_low'])} to {_short(row['ratio_high'])}"
    target = _target(row, unit)
    met = {True: "yes", False: "NO", None: ""}[row["met"]]
    return row["name"], row["peer"], row["ours"], row["theirs"], figure, interval, target, met, remark(row)


def _target(row: Entry, unit: str) -> str:
    if row["target"] is None:
        return ""
    if row["peer"] == LIMIT and not unit:
        return f"≤ {row['theirs']}"
    return f"{'≥' if row['sense'] == 'at least' else '≤'} {_short(row['target'])}{unit}"


def remark(row: Entry) -> str:
    """The note; where the target is missed also how far, and why."""
    words = [row["note"]] if row["note"] else []
    if row["met"] is False:
        words.append(f"missed: {_far(row)}{': ' + row['why'] if row['why'] else ''}")
    return "; ".join(words)


def _far(row: Entry) -> str:
    reached = row["ratio_low"] if row["sense"] == "at least" else row["ratio_high"]
    middle = (row["ratio"] >= row["target"]) == (row["sense"] == "at least")
    if middle:
        return f"by its interval only, which ends at {_short(reached)}"
    share = row["ratio"] / row["target"] if row["target"] else 0.0
    return f"{_short(row['ratio'])} instead of {_short(row['target'])}, {share:.0%} of it"


def _short(figure: float) -> str:
    if abs(figure) >= 1000:
        return f"{figure:,.0f}"
    return f"{figure:.3g}"


def terminal(groups: Mapping[str, Mapping[str, Any]]) -> Table:
    """All groups, one below the other."""
    table = Table(*COLUMNS, title="Benchmarks", show_lines=False)
    for name, group in groups.items():
        table.add_section()
        table.add_row(f"[bold]{name}[/bold]", f"[dim]measured at {group['revision']}[/dim]")
        for row in group["rows"]:
            table.add_row(*cells(row), style="red" if row["met"] is False else None)
    return table


def markdown(results: Mapping[str, Any]) -> str:
    """The same for the documentation, with what it was measured on."""
    machine = results["machine"]
    lines = [f"{machine['processor']}, {machine['cores']} cores, Python {machine['python']}.", ""]
    for name, group in results["groups"].items():
        lines += [f"### {name}", "", f"{group['about']} Measured at {group['revision']}.", ""]
        lines += [_line(COLUMNS), _line(["---"] * len(COLUMNS))]
        lines += [_line(cells(row)) for row in group["rows"]]
        lines.append("")
    return "\n".join(lines)


def _line(words: Sequence[str]) -> str:
    return "| " + " | ".join(word.replace("|", "\\|") for word in words) + " |"


def put_between_markers(file: Path, text: str) -> None:
    """Replace what stands between the markers of a file.

    Raises:
        ValueError: If they are not there.
    """
    before, begin, rest = file.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{file} has no {BEGIN} ... {END}")
    file.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}", encoding="utf-8")
