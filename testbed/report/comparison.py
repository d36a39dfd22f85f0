"""Students against each other, cells against their control, robots against each other: tables over many trials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from testbed.experiment.roc import Difference, auc_difference
from testbed.experiment.statistics import Interval, wilson
from testbed.experiment.verdicts import scored, summarise
from testbed.report import html
from testbed.report.candidates import truth_mark
from testbed.report.reading import TRUTHS, Row, RunRecord

CONTROL = "control"
"""The cell that every other is held against."""
SAME = 0.02
"""Areas under the curve that differ by less than this count as the same."""
_SEED = 0  # the page must not change when it is made again
_MEASURES = (
    ("AUC", "auc", False),
    ("right verdicts", "accuracy", True),
    ("calibration error", "calibration_error", False),
    ("AUC of the controller alone", "controller_auc", False),
    ("regret of its choice, 0 to 2", "regret", False),
)


def student_table(run: RunRecord, cell: str) -> str:
    """A line a student: how well it tells who is like it in a cell, each figure with its interval."""
    summaries = summaries_of(run, cell)
    shown = [name for name in run.students if name in summaries]
    kept = [entry for entry in _MEASURES if any(summaries[name].get(entry[1]) is not None for name in shown)]
    body = []
    for name in shown:
        own = [row for row in run.verdicts(cell=cell, student=name) if row["truth"] == "appropriate"]
        line = [html.text(name), str(summaries[name]["n"])]
        line += [_measured(summaries[name], *entry) for entry in kept]
        body.append([*line, *_seen(own)])
    titles = ["student", "verdicts", *(title for title, _, _ in kept), _FOUND, _IN_PLACE, _ROLLS]
    return html.table(titles, body, css="figures")


def _seen(rows: Sequence[Row]) -> list[str]:
    """Of teachers like the student: how many were found, all parts right in all frames, the error of their rolls."""
    errors = [float(row["imitated_roll_error_median_deg"]) for row in rows
              if row.get("imitated_roll_error_median_deg") is not None]  # fmt: skip
    placed = [bool(row["parts_in_place"]) for row in rows if row.get("parts_in_place") is not None]
    return [
        share([bool(row["found"]) for row in rows]),
        share(placed) if placed else "",
        f"{np.median(errors):.2f}°<br><small>median of {len(errors)}</small>" if errors else "",
    ]


_FOUND = "found, of those like it"
_IN_PLACE = "all its parts within 15° in all frames"
_ROLLS = "roll error as imitated"


def cell_table(run: RunRecord, student: str) -> str:
    """A line a cell: how well a student does there, and how that compares with the same trials of the control."""
    rows = {cell: run.verdicts(cell=cell, student=student) for cell in run.cells}
    controlled = bool(rows.get(CONTROL))
    body = []
    for cell, own in rows.items():
        if not own:
            continue
        summary = summaries_of(run, cell)[student]
        line = [html.text(cell), str(summary["n"])]
        line += [_measured(summary, *entry) for entry in _MEASURES[:2]]
        if controlled:
            line += ["", "the control"] if cell == CONTROL else _against(own, rows[CONTROL])
        body.append(line)
    header = ["cell", "verdicts", "AUC", "right verdicts"]
    return html.table([*header, *(["AUC less the control's", ""] * controlled)], body, css="figures")


def robot_table(rows: Sequence[Row], students: Sequence[str]) -> str:
    """A line a kind of robot: how many of its verdicts each student got right, with Wilson's interval."""
    kinds = sorted(
        {(str(row["truth"]), str(row["robot"])) for row in rows},
        key=lambda kind: (TRUTHS.index(kind[0]), kind),
    )
    body = []
    for truth, robot in kinds:
        line = [html.text(robot), truth_mark(truth)]
        for student in students:
            own = [row for row in rows if (row["student"], row["robot"]) == (student, robot)]
            line.append(share([row["verdict"] == row["truth"] for row in own if row["truth"] == truth]))
        body.append(line)
    return html.table(["robot", "truth", *map(html.text, students)], body, css="figures")


def summaries_of(run: RunRecord, cell: str) -> Mapping[str, Mapping[str, Any]]:
    """The statistics of a cell, by student: those of ``verdicts.json``, or made anew where it is an older one."""
    found = run.summaries.get(cell) or (run.summary if len(run.cells) == 1 else {})
    if any("calibration_error" not in summary for summary in found.values()) or not found:
        return summarise(run.verdicts(cell=cell), run.scenario.seed)
    return found


def verdict_on(difference: Difference) -> str:
    """A difference of areas in plain words."""
    n, interval = difference.n, difference.interval
    if interval is None:
        return f"cannot tell from {n} trial{'' if n == 1 else 's'}"
    if interval.low > SAME:
        return f"better by more than {SAME:.2f}"
    if interval.high < -SAME:
        return f"worse by more than {SAME:.2f}"
    if max(-interval.low, interval.high) <= SAME:
        return f"within {SAME:.2f}"
    return f"cannot tell whether within {SAME:.2f} from {n} trials"


def share(right: Sequence[bool]) -> str:
    """A share with its count and Wilson's interval; a dash for none."""
    if not right:
        return html.number(None)
    hits, n = sum(right), len(right)
    return f"{hits} of {n}{_small(wilson(hits, n), percent=True)}"


def figure_with(value: float, interval: Interval | None, *, percent: bool = False) -> str:
    """A figure above its interval."""
    shown = f"{value:.0%}" if percent else f"{value:.3f}"
    return _minus(shown) + (_small(interval, percent=percent) if interval is not None else "")


def _against(own: Sequence[Row], control: Sequence[Row]) -> list[str]:
    """Trials of the same number were drawn alike: they are matched."""
    here, there = (scored([{**row, "cell": ""} for row in rows]) for rows in (own, control))
    difference = auc_difference(here, there, np.random.default_rng(_SEED))
    if difference is None:
        return [html.number(None), "cannot tell: no common trials"]
    interval = difference.interval
    gap = _minus(f"{difference.value:+.3f}") + (_small(interval, signed=True) if interval else "")
    return [gap, html.text(verdict_on(difference))]


def _measured(summary: Mapping[str, Any], _title: str, name: str, percent: bool) -> str:
    value, low, high = (summary.get(f"{name}{end}") for end in ("", "_low", "_high"))
    if value is None:
        return html.number(None)
    shown = f"{value:.1%}" if percent else f"{value:.3f}"
    interval = None if low is None or high is None else Interval(low, high)
    few = "<br><small>too few for an interval</small>"
    return f'<data value="{value!r}">{shown}</data>{_small(interval, percent=percent) if interval else few}'


def _small(interval: Interval, *, percent: bool = False, signed: bool = False) -> str:
    form = ".0%" if percent else "+.3f" if signed else ".3f"
    low, high = (_minus(f"{end:{form}}") for end in interval)
    return f"<br><small>{low} to {high}</small>"


def _minus(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}")
