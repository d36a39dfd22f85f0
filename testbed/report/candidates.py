"""What each mind made of each candidate, side by side with the truth."""

from __future__ import annotations

from collections.abc import Sequence

from testbed.report import html
from testbed.report.reading import Row

_HEADER = ["candidate", "truth", "mind", "verdict", "probability", "why"]


def candidate_table(rows: Sequence[Row], students: Sequence[str]) -> str:
    """A line a candidate and mind: its verdict, how likely it thinks that the candidate is like it, and why.

    Args:
        rows: The verdicts of one trial.
        students: The minds, in the order in which to list them.
    """
    body = []
    for teacher in dict.fromkeys(str(row["teacher"]) for row in rows):
        own = {str(row["student"]): row for row in rows if row["teacher"] == teacher}
        for number, row in enumerate(own[name] for name in students if name in own):
            first = [
                f"{html.text(teacher)}<br><small>{html.text(row['robot'])}</small>",
                truth_mark(str(row["truth"])),
            ]
            body.append([*(first if number == 0 else ["", ""]), html.text(row["student"]), *_judged(row)])
    return html.table(_HEADER, body, css="minds")


def _judged(row: Row) -> list[str]:
    if not row["found"]:
        return ["not found", html.number(None), ""]
    why = html.text(sentence(row.get("reason")))
    imitated = " <small>imitated</small>" if row["chosen"] else ""
    return [verdict_mark(row) + imitated, chance(row.get("probability")), f"<small>{why}</small>"]


def truth_mark(truth: str) -> str:
    """A truth in its colour."""
    return f'<span class="{html.text(truth)}">{html.text(truth)}</span>'


def verdict_mark(row: Row) -> str:
    """A verdict, ticked if it is right."""
    right = row["truth"] == row["verdict"]
    mark, name = ("✓", "right") if right else ("✗", "wrong")
    return f'{html.text(row["verdict"])} <span class="{name}" title="{name}">{mark}</span>'


def chance(probability: float | None) -> str:
    """A probability as readers like it, never more certain than it is."""
    if probability is None:
        return html.number(None)
    shown = "&lt; 1%" if probability < 0.01 else "&gt; 99%" if probability > 0.99 else f"{probability:.0%}"
    return f'<data value="{probability!r}">{shown}</data>'


def sentence(words: str | None) -> str:
    """Words with a capital at their beginning and a stop at their end; nothing for none."""
    if not words:
        return ""
    return words[0].upper() + words[1:] + ("" if words[-1] in ".!?" else ".")


def verdict_table(rows: Sequence[Row], *, many: bool) -> str:
    """Every verdict with its numbers; with the trial (and the cell, and the mind) where there are several."""
    keys = [name for name in ("cell", "student") if len({row[name] for row in rows}) > 1]
    keys = [*keys[:1], "trial", *keys[1:]] if many and keys[:1] == ["cell"] else [*["trial"] * many, *keys]
    header = [*keys, "teacher", "robot", "truth", "verdict", "score", "error at start (Eq. 5)", "at end", ""]
    body = [
        [
            *(html.text(row[name]) for name in keys),
            html.text(row["teacher"]),
            html.text(row["robot"]),
            truth_mark(str(row["truth"])),
            verdict_mark(row),
            html.number(row["score"]),
            html.number(row.get("initial_error")),
            html.number(row.get("final_error")),
            "imitated" if row["chosen"] else "" if row["found"] else "not found",
        ]
        for row in rows
    ]
    return html.table(header, body, css="verdicts")
