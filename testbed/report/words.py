"""The page's sentences about the verdicts, made from the rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from testbed.experiment.regret import regret
from testbed.report.reading import Row
from testbed.report.series import right_verdicts

_NOTABLE = 0.1  # of the images
_SEVERAL = 0.6  # how clear two distances are; from here on the student says so itself
_BULKY = 0.01  # of an outline; likewise
_NUMBERS = ("none", "one", "two", "three", "four", "five", "six", "seven", "eight")


def headline(rows: Sequence[Row], cell: str | None = None) -> str:
    """What came out, in one sentence; of this cell, where there are several."""
    trials = {(row["cell"], row["trial"], row["student"]) for row in rows}
    if len(trials) == 1:
        return _one_trial(rows)
    right, (low, high) = right_verdicts(rows)
    n = len(rows)
    known = (
        "better than a coin" if low > 0.5 else "worse than a coin" if high < 0.5 else "no better than a coin"
    )
    where = "" if cell is None else f" of the cell {cell}"
    return f"In {len(trials)} trials{where} the student was right about {right} of {n} teachers: {known}."


def explanation(rows: Sequence[Row], others: Sequence[Row] = ()) -> str:
    """What stands behind the headline.

    Args:
        rows: The verdicts of the student that decides.
        others: Those of the students who judged beside it.
    """
    lost = [row for row in rows if not row["found"]]
    trials = {(row["cell"], row["trial"], row["student"]) for row in rows}
    if len(trials) == 1:
        parts = [*(_about(row) for row in rows), _missed(rows)]
    else:
        imitated = [row for row in rows if row["chosen"]]
        good = sum(row["truth"] == "appropriate" for row in imitated)
        parts = [
            f"It imitated a teacher in {len(imitated)} of {len(trials)} trials, an appropriate one in {good}."
        ]
        if lost:
            parts.append(f"It did not find {len(lost)} of {len(rows)} teachers.")
    return " ".join([*parts, *_beside(others)])


def _beside(others: Sequence[Row]) -> list[str]:
    """How right those were who judged the same candidates without a say."""
    students = list(dict.fromkeys(str(row["student"]) for row in others))
    counts = []
    for student in students:
        own = [row for row in others if row["student"] == student]
        alone = len({(row["cell"], row["trial"]) for row in own}) == 1
        told = f" (regret {regret(own)})" if alone else ""
        counts.append(f"{student} was right about {sum(map(_is_right, own))} of {len(own)}{told}")
    if not counts:
        return []
    listed = counts[0] if len(counts) == 1 else f"{', '.join(counts[:-1])} and {counts[-1]}"
    return [f"Beside it, with the same eyes, {listed}."]


def _is_right(row: Row) -> bool:
    return bool(row["truth"] == row["verdict"])


def summary_facts(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """(name, value, interval) of a student's statistics that are there."""
    facts = []
    n = summary.get("n")
    if (accuracy := summary.get("accuracy")) is not None:
        facts.append(("right verdicts", f"{accuracy:.0%}", _between(summary, "accuracy", percent=True, n=n)))
    if (area := summary.get("auc")) is not None:
        facts.append(
            (
                "AUC of the score",
                f"{area:.3f}",
                _between(summary, "auc", percent=False, n=summary.get("trials")),
            )
        )
    if (error := summary.get("calibration_error")) is not None:
        number = summary.get("calibrated")
        interval = _between(summary, "calibration_error", percent=False, n=number)
        facts.append(("calibration error", f"{error:.3f}", interval))
    return facts


def in_the_way(rows: Sequence[Row]) -> str:
    """Who could not be seen alone, in sentences; empty if everybody could.

    Args:
        rows: The verdicts of one student.
    """
    found = [row for row in rows if row["found"]]
    hidden = sum((row.get("hidden") or 0) >= _NOTABLE for row in found)
    crowded = sum((row.get("crowded") or 0) >= _NOTABLE > (row.get("hidden") or 0) for row in found)
    several = sum((row.get("several") or 0) >= _SEVERAL for row in found)
    bulky = sum((row.get("left_over") or 0) >= _BULKY for row in found)
    said = []
    if hidden:
        said.append(f"{hidden} of {len(found)} candidates stood partly behind somebody else.")
    if crowded:
        said.append(f"The outlines of {crowded} of {len(found)} ran into another's.")
    if several:
        said.append(
            f"{several} of {len(found)} lay at two distances: more than one body may have stood there, and a verdict "
            "about them may be about two at once."
        )
    if bulky:
        said.append(
            f"Of {bulky} of {len(found)} more was left unexplained than limbs: more than one body may have stood there."
        )
    return " ".join(said)


def _between(summary: Mapping[str, Any], name: str, *, percent: bool, n: int | None) -> str:
    low, high = summary.get(f"{name}_low"), summary.get(f"{name}_high")
    count = "" if n is None else f"N = {n}"
    if low is None or high is None:
        return f"{count}, too few for an interval" if count else "too few for an interval"
    span = f"{low:.0%} to {high:.0%}" if percent else f"{low:.3f} to {high:.3f}"
    return ", ".join(part for part in (f"95% interval {span}", count) if part)


def _one_trial(rows: Sequence[Row]) -> str:
    chosen = next((row for row in rows if row["chosen"]), None)
    if chosen is not None:
        fit = "rightly" if chosen["truth"] == "appropriate" else "wrongly"
        return f"The student imitated {chosen['teacher']} ({chosen['robot']}), {fit}: an {chosen['truth']} teacher."
    among = "neither teacher" if len(rows) == 2 else f"none of the {_count(len(rows))} teachers"
    answer = "did not imitate the only teacher" if len(rows) == 1 else f"imitated {among}"
    missed = sum(row["truth"] == "appropriate" for row in rows)
    if not missed:
        return f"The student {answer}, rightly: none was appropriate."
    return f"The student {answer}, wrongly: {_count(missed)} {'was' if missed == 1 else 'were'} appropriate."


def _about(row: Row) -> str:
    name = f"{row['teacher']} ({row['robot']})"
    if not row["found"]:
        return f"It did not find {name}, which is {row['truth']}."
    fit = "rightly" if row["truth"] == row["verdict"] else "wrongly"
    return f"It took {name} for an {row['verdict']} teacher, {fit}."


def _missed(rows: Sequence[Row]) -> str:
    """Regret of the choice in one world, in words."""
    missed = regret(rows)
    if missed == 0:
        why = "no other would have been better"
    elif missed == 2:
        why = "an inappropriate teacher while an appropriate one was there"
    else:
        there = any(row["truth"] == "appropriate" for row in rows)
        why = (
            "nobody while an appropriate teacher was there"
            if there
            else "a teacher while none was appropriate"
        )
    return f"Regret of its choice: {missed} of at most 2, {why}."


def _count(number: int) -> str:
    return _NUMBERS[number] if number < len(_NUMBERS) else str(number)
