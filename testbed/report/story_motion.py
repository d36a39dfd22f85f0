"""What happened, phase by phase, to a mind that follows whole motions: an extension of the paper's figures."""

from __future__ import annotations

from testbed.report import html
from testbed.report.desk import Desk
from testbed.report.explained import explanation_picture, explanations
from testbed.report.moving import rolls_over_time
from testbed.report.reading import Row, Trial
from testbed.report.story import heading


def teacher_modelling(desk: Desk, sample: Trial) -> str:
    """What it saw, and its best explanations."""
    parts = []
    embodied = any(len(explanations(sample, str(row["teacher"]))) > 1 for row in sample.rows)
    for row in sample.rows:
        teacher = str(row["teacher"])
        parts.append(heading(row))
        drawing = explanation_picture(sample, teacher, desk.rig(sample)) if row["found"] else None
        if drawing is None:
            why = "No pictures of it were kept." if row["found"] else "The student did not find this teacher."
            parts.append(f"<p>{why}</p>")
            continue
        parts.append(
            desk.picture(
                drawing,
                f"explained_{teacher}",
                f"What the student saw of {teacher} under the outlines of the bodies that explain it",
                f"The left image at a few moments, under the outlines of what the student takes it for"
                f"{', and how much of what it saw that explains' if embodied else ''}. {_explained(row)}",
            )
        )
    lead = (
        "The student lays its own body into everything that it saw of a candidate, and then other bodies that it could "
        "have had. What is like it, its own body explains best."
        if embodied
        else "The student fits free parts of unchanging sizes to everything that it saw of a candidate at once."
    )
    return html.section(desk.titled("2. What is that over there?"), *parts, lead=lead)


def imitation(desk: Desk, sample: Trial) -> str:
    """Rolls as it saw them, as it rehearsed them and as it performed them."""
    parts = []
    for row in sample.rows:
        teacher = str(row["teacher"])
        drawing = rolls_over_time(sample, teacher, desk.student(sample)) if row["found"] else None
        if drawing is None:
            continue
        performed = " Right: what its real body did while it imitated." if row["chosen"] else ""
        parts.append(heading(row))
        parts.append(
            desk.picture(
                drawing,
                f"rolls_over_time_{teacher}",
                f"Rolls of {teacher} as seen, rehearsed and performed",
                "Roll of each part of the self-model in the mind (colour), and of the corresponding part of the "
                f"candidate as the student saw it (thin line).{performed} {_controlled(row)}",
            )
        )
    lead = (
        "In its mind the student lets its self-model move, driven by a small network that sees how the candidate "
        "turned. What its own body cannot do, it cannot learn from."
    )
    return html.section(desk.titled("3. Can I move like that?"), *parts, lead=lead) if parts else ""


def _explained(row: Row) -> str:
    """How far the fitted parts are from the true ones, in words."""
    median, worst = row.get("motion_roll_error_median_deg"), row.get("motion_roll_error_worst_deg")
    if median is None or worst is None:
        return "It has other parts than the student, so their rolls cannot be compared."
    return f"Rolls are off by {median:.1f}° (median) and {worst:.1f}° (worst) from the true ones."


def _controlled(row: Row) -> str:
    verdict, score = row.get("controller_verdict"), row.get("controller_score")
    if verdict is None or score is None:
        return ""
    return f"By the controller alone it is {html.text(verdict)} (score {html.number(score)})."
