"""The section about the verdicts: who judged whom how, and how sure one can be of the judges."""

from __future__ import annotations

from testbed.report import figures, html
from testbed.report.candidates import candidate_table, verdict_table
from testbed.report.comparison import CONTROL, SAME, cell_table, robot_table, student_table
from testbed.report.curves import reliability_figure, roc_figure
from testbed.report.desk import Desk
from testbed.report.failures import failure_gallery
from testbed.report.words import in_the_way

_FEW = 8  # a table of so many rows needs no unfolding


def verdicts(desk: Desk) -> str:
    """The whole section; empty for a run in which nobody was watched."""
    run = desk.run
    if not run.rows:
        return ""
    several = len({row["student"] for row in run.rows}) > 1
    if run.trial_count == 1:
        table = verdict_table(run.rows, many=False)
        if not several and not any(row.get("reason") for row in run.rows):
            return html.section("Verdicts", table, _in_the_way(desk))
        told = candidate_table(run.rows, run.students)
        return html.section("Verdicts", told, _in_the_way(desk), html.details("The numbers", table))
    table = verdict_table(run.rows, many=True)
    return html.section(
        "Verdicts",
        _students(desk, several=several),
        _cells(desk),
        _robots(desk),
        failure_gallery(desk),
        _in_the_way(desk),
        table if len(run.rows) <= _FEW else html.details(f"All {len(run.rows)} verdicts", table),
        lead=_about(desk),
    )


def _in_the_way(desk: Desk) -> str:
    said = in_the_way(desk.rows)
    return f"<p>{html.text(said)}</p>" if said else ""


def _about(desk: Desk) -> str:
    if len(desk.run.cells) == 1:
        return ""
    return f"Pictures and tables are about the cell <em>{html.text(desk.cell)}</em> where they do not say otherwise."


def _students(desk: Desk, *, several: bool) -> str:
    rows = desk.run.verdicts(cell=desk.cell)
    scored = [row for row in desk.rows if row["score"] is not None]
    calibrated = any(row.get("probability") is not None for row in desk.rows)
    leader = html.text(desk.mind)
    return "".join(
        [
            student_table(desk.run, desk.cell) if several or calibrated else "",
            desk.picture(
                figures.score_figure(scored, roc=not several) if scored else None,
                "scores",
                "Scores of the teachers by what they truly are",
                f"Each dot is a teacher in a trial. The further right, the more like itself {leader} thought it.",
            ),
            desk.picture(
                roc_figure(rows, desk.run.students) if several else None,
                "roc",
                "ROC curves of all students",
                "For every threshold: how many of those that are like the student it would take for such, and how many "
                "of the others. The second panel is the first one's upper left corner.",
            ),
            desk.picture(
                reliability_figure(desk.rows),
                "reliability",
                "Whether probabilities mean what they say",
                f"Verdicts of {leader} by the probability it gave that a teacher is like it: their mean, and what "
                "share truly was, with 95% intervals. On the diagonal the numbers mean what they say.",
            ),
        ]
    )


def _cells(desk: Desk) -> str:
    run = desk.run
    if len(run.cells) == 1 or run.scenario.sweep:  # a sweep has a section of its own
        return ""
    parts = ["<h3>Cell by cell</h3>"]
    if CONTROL in run.cells:
        parts.append(
            "<p>Differences are over the trials that a cell shares with the control, which were drawn alike but for "
            f"what the cell changes, with 95% intervals. Areas count as the same where that interval lies within "
            f"{SAME:.2f} of zero.</p>"
        )
    for student in run.students:
        if len({row["cell"] for row in run.verdicts(student=student)}) > 1:
            parts.append(f"<h4>{html.text(student)}</h4>" if student != desk.mind else "")
            parts.append(cell_table(run, student))
    return "".join(parts)


def _robots(desk: Desk) -> str:
    rows = desk.run.verdicts(cell=desk.cell)
    if len({row["robot"] for row in rows}) < 2:
        return ""
    students = [name for name in desk.run.students if any(row["student"] == name for row in rows)]
    return f"<h3>Robot by robot</h3><p>Right verdicts, with Wilson's 95% intervals.</p>{robot_table(rows, students)}"
