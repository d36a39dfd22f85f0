"""The sections about bodies and ways over many trials: what students know of themselves, and how far they come."""

from __future__ import annotations

from testbed.report import html
from testbed.report.desk import Desk
from testbed.report.knowing import angle_figure, self_table
from testbed.report.mending import damage_figure, damage_table
from testbed.report.travelling import TRAVELS, imitated, travel_figure, travel_table


def bodies_known(desk: Desk) -> str:
    """What students found out about their bodies; empty for a single trial, which is told in pictures."""
    run = desk.run
    if not run.selves or run.trial_count == 1:
        return ""
    figure = desk.picture(
        angle_figure(run, desk.mind, [desk.cell] if run.rows else run.cells),
        "angles",
        "Error of the self-model's angles over the commands",
        f"The largest error of a mounting angle in the best self-model of {html.text(desk.mind)}: median of the "
        "trials, and the middle 90%, bodies whose angles cannot be told among them. Where a limb "
        "hangs on the wrong part, the model is wrong, whatever its angles.",
    )
    mended = desk.picture(
        damage_figure(run),
        "damage",
        "Errors of the self-model after damage, when noticed and after further commands",
        "What is known of a body that broke: grey when the student noticed it, black once it had modelled itself anew. "
        "A limb stuck off the ground feels like one that is lost: such a joint has no angle here.",
    )
    return html.section(
        "What they know of themselves",
        self_table(run),
        figure,
        damage_table(run),
        mended,
        lead="With Wilson's 95% intervals. Angles are compared where the limbs hang as they should.",
    )


def travels_told(desk: Desk) -> str:
    """How far the student came along; empty where it imitated in fewer than two trials."""
    if sum(len(imitated(desk, cell)) for cell in desk.run.cells) < 2:
        return ""
    figure = desk.picture(
        travel_figure(desk),
        "travelled",
        "How fast the student came along against its teacher",
        "A dot a trial: how fast the student came along in the direction that its teacher takes, against the teacher's "
        "speed scaled to the student's size. On the diagonal it comes as far as its teacher.",
    )
    return html.section(
        "How far they come",
        travel_table(desk),
        figure,
        lead=f"Of teachers that come on by {TRAVELS * 100:.0f} cm or more with each stroke. With 95% intervals.",
    )
