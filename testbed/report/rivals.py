"""One page that holds the students of several runs against each other, on the teachers that they share."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from testbed.errors import UserError, shown_path
from testbed.experiment.atomic import write_text
from testbed.experiment.paired import Paired
from testbed.experiment.rivals import SAME, Contest, Rivalry, document, verdict_on
from testbed.report import html
from testbed.report.candidates import truth_mark
from testbed.report.curves import roc_figure
from testbed.report.rival_figures import MOST_LINES, difference_figure, robot_figure
from testbed.report.style import inline, svg

PAGE, NUMBERS = "report.html", "comparison.json"
_MOST_LISTED = 60
_NOT_THE_WORLD = ("student.parameters", "beside")


def write_comparison(told: Rivalry, out: Path) -> Path:
    """Write ``report.html``, ``comparison.json`` and ``figures/*.svg`` into a folder; returns the page's path.

    The same runs give the same files.

    Raises:
        UserError: If the folder holds something else, or cannot be written.
    """
    refuse_foreign(out)
    write_text(out / NUMBERS, json.dumps(document(told), indent=1, ensure_ascii=False) + "\n")
    names = " and ".join(side.name for side in told.sides)
    write_text(out / PAGE, html.page(f"{names}: compared", _body(told, out / "figures")))
    return out / PAGE


def refuse_foreign(out: Path) -> None:
    """Raise a :class:`UserError` if a folder holds something else than a comparison."""
    foreign = out.exists() and (not out.is_dir() or (any(out.iterdir()) and not (out / NUMBERS).is_file()))
    if foreign:
        raise UserError(
            f"{shown_path(out)} holds something else", "give a new or an empty folder with --out DIR"
        )


def headline(told: Rivalry) -> str:
    """What came out, in one sentence."""
    reference = told.reference.label
    if len(told.overall) == 1:
        (only,) = told.overall
        return (
            f"{only.rival.label} is right about {only.accuracy.second:.0%} of {only.accuracy.n} teachers, "
            f"{reference} about {only.accuracy.first:.0%}: {_outcome(only.accuracy, only.adjusted[0])}."
        )
    outcomes = ", ".join(
        f"{each.rival.label} {verdict_on(each.accuracy, each.adjusted[0])}" for each in told.overall
    )
    return f"Right verdicts against {reference}'s: {outcomes}."


def _body(told: Rivalry, folder: Path) -> str:
    kicker = html.text(" · ".join(["comparison", *(side.name for side in told.sides)]))
    parts = [
        f'<header><p class="kicker">{kicker}</p><h1>{html.text(headline(told))}</h1>'
        f"<p>{html.text(_explained(told))}</p></header>",
        _overall(told, folder),
        _cell_by_cell(told, folder),
        _robots(told, folder),
        _disagreements(told),
        _what_differs(told),
        _footer(told),
    ]
    return "".join(parts)


def _explained(told: Rivalry) -> str:
    text = f"Everybody is held against {told.reference.label} of {told.reference.run}, on teachers that both judged. "
    alone = sum(each.match.alone for each in told.overall)
    if alone:
        text += f"{alone} verdicts have no counterpart and are left out. "
    damaged = [str(damage) for side in told.sides for damage in side.damaged]
    if damaged:
        text += f"Left out: {'; '.join(damaged[:3])}{'; ...' if len(damaged) > 3 else ''}. "
    return text + (
        "Differences have 95% intervals, bootstrapped over trials; p-values exchange the two students trial by trial, "
        "exactly for right verdicts (with one teacher a trial: McNemar's test), and are Holm's over a table."
    )


def _overall(told: Rivalry, folder: Path) -> str:
    reference = told.reference.label
    rows = [{**row, "student": reference} for row in told.overall[0].match.first]
    for each in told.overall:
        rows += [{**row, "student": each.rival.label} for row in each.match.second]
    labels = [reference, *(each.rival.label for each in told.overall)]
    return html.section(
        f"Against {reference}",
        _table(told.overall, reference),
        _picture(
            difference_figure(told.overall, reference), folder, "differences",
            f"Differences from {reference}",
            f"Differences from {html.text(reference)} with 95% intervals; in colour where Holm's p-value is below .05. "
            f"The band is {SAME:.2f} to either side.",
        ),
        _picture(
            roc_figure(rows, labels), folder, "roc", "ROC curves of all students",
            "For every threshold: how many of those that are like the student it would take for such, and how many of "
            "the others. The second panel is the first one's upper left corner.",
        ),
    )  # fmt: skip


def _table(contests: Sequence[Contest], reference: str) -> str:
    celled = any(each.cell is not None for each in contests)
    titles = [
        "student",
        *(["cell"] * celled),
        "teachers",
        f"right verdicts: {reference}",
        "this one",
        "difference",
        "",
    ]
    titles += [f"AUC: {reference}", "this one", "difference", ""]
    body = []
    for each in contests:
        line = [html.text(each.rival.label), *([html.text(each.cell)] * celled)]
        line.append(f"{each.accuracy.n}<br><small>in {each.accuracy.trials} trials</small>")
        line += _compared(each.accuracy, each.adjusted[0], percent=True)
        line += _compared(each.auc, each.adjusted[1], percent=False)
        body.append(line)
    return html.table([html.text(title) for title in titles], body, css="figures")


def _compared(paired: Paired | None, p_value: float | None, *, percent: bool) -> list[str]:
    if paired is None or p_value is None:
        return [html.number(None)] * 3 + ["cannot tell"]
    form = ".1%" if percent else ".3f"
    interval = "too few for an interval"
    if paired.interval is not None:
        interval = " to ".join(_minus(f"{end:+{form}}") for end in paired.interval)
    shown = f'<data value="{paired.difference!r}">{_minus(f"{paired.difference:+{form}}")}</data>'
    outcome = verdict_on(paired, p_value)
    css = {"better": "right", "worse": "wrong"}.get(outcome, "none")
    chance = "p < 0.001" if p_value < 0.001 else f"p = {p_value:.3f}"
    return [
        f"{paired.first:{form}}",
        f"{paired.second:{form}}",
        f"{shown}<br><small>{interval}</small>",
        f'<span class="{css}">{_unbroken(outcome)}</span><br><small>{_unbroken(chance)}</small>',
    ]


def _cell_by_cell(told: Rivalry, folder: Path) -> str:
    if not told.by_cell:
        return ""
    table = _table(told.by_cell, told.reference.label)
    return html.section(
        "Cell by cell",
        _picture(
            difference_figure(told.by_cell, told.reference.label), folder, "cells",
            "Differences cell by cell",
            "The same, cell by cell" + (f"; the first {MOST_LINES}." if len(told.by_cell) > MOST_LINES else "."),
        ),
        table if len(told.by_cell) <= _MOST_LISTED else html.details(f"All {len(told.by_cell)} lines", table),
    )  # fmt: skip


def _robots(told: Rivalry, folder: Path) -> str:
    reference = told.reference.label
    pictures = [
        _picture(
            robot_figure(each, reference), folder, f"robots-{number}",
            f"Right verdicts of {each.rival.label} and {reference}, robot by robot",
            f"{html.text(each.rival.label)} (filled; blue: appropriate, orange: not), {html.text(reference)} (open). "
            "In brackets: how many teachers.",
        )
        for number, each in enumerate(told.overall)
    ]  # fmt: skip
    return html.section("Robot by robot", *pictures) if any(pictures) else ""


def _disagreements(told: Rivalry) -> str:
    reference, parts = told.reference.label, []
    for each in told.overall:
        both, first, second, neither = each.agreement
        rival = each.rival.label
        parts.append(f"<h3>{html.text(rival)}</h3>" if len(told.overall) > 1 else "")
        parts.append(
            f"<p>Of {each.accuracy.n} teachers both were right about {both}, only {html.text(reference)} about "
            f"{first}, only {html.text(rival)} about {second}, neither about {neither}.</p>"
        )
        pairs = zip(each.match.first, each.match.second, strict=True)
        split = [(ours, theirs) for ours, theirs in pairs if ours["verdict"] != theirs["verdict"]]
        body = []
        for ours, theirs in split[:_MOST_LISTED]:
            line = [html.text(ours[name]) for name in ("cell", "trial", "teacher", "robot")]
            line += [truth_mark(str(ours["truth"])), *(_said(row) for row in (ours, theirs))]
            body.append(line)
        if body:
            titles = ["cell", "trial", "teacher", "robot", "truth", reference, rival]
            more = f", the first {len(body)} of {len(split)}" if len(split) > len(body) else ""
            table = html.table([html.text(title) for title in titles], body)
            parts.append(html.details(f"Where they disagree{more}", table))
    return html.section("Agreement", *parts)


def _said(row: dict[str, object]) -> str:
    right = row["verdict"] == row["truth"]
    return f'<span class="{"right" if right else "wrong"}">{html.text(row["verdict"])}</span>'


def _what_differs(told: Rivalry) -> str:
    if len(told.sides) == 1 or not told.differences:
        lead = "Nothing but the runs themselves: their scenarios say the same."
        return html.section("What differs between the runs", lead=lead)
    titles = ["place", *(side.name for side in told.sides)]
    rest = [each for each in told.differences if not each[0].startswith(_NOT_THE_WORLD)]
    inner = [each for each in told.differences if each[0].startswith(_NOT_THE_WORLD)]
    tables = [
        html.table(
            [html.text(title) for title in titles], [[html.text(cell) for cell in (p, *v)] for p, v in each]
        )
        for each in (rest, inner)
    ]
    return html.section(
        "What differs between the runs",
        tables[0] if rest else "",
        html.details(f"{len(inner)} differences in students' parameters and in who judges beside", tables[1])
        if inner
        else "",
        lead="Besides the students themselves, whatever stands here may be why they differ.",
    )


def _footer(told: Rivalry) -> str:
    listed = []
    for side in told.sides:
        source = side.directory.provenance.get("source") or "unknown source"
        about = (
            f"{side.scenario.name}, content hash {side.directory.hash8}, seed {side.scenario.seed}, {source}"
        )
        listed.append(f"<dt>{html.text(side.name)}</dt><dd>{html.text(about)}</dd>")
    return f"<footer><h2>Where this comes from</h2><dl>{''.join(listed)}</dl></footer>"


def _picture(drawing: Figure | None, folder: Path, name: str, label: str, caption: str) -> str:
    if drawing is None:
        return ""
    text = svg(drawing, name)
    write_text(folder / f"{name}.svg", text)
    return html.figure(inline(text, label), caption)


def _outcome(paired: Paired, p_value: float | None) -> str:
    outcome = verdict_on(paired, p_value)
    if paired.interval is None:
        return "one trial tells nothing"
    low, high = paired.interval
    spread = _minus(f"{100 * low:+.0f} to {100 * high:+.0f} points")
    return f"{outcome} ({spread})" if outcome in ("better", "worse") else f"{outcome}: {spread}"


def _unbroken(text: str) -> str:
    return html.text(text).replace(" ", "\N{NO-BREAK SPACE}")


def _minus(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}")
