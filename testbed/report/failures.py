"""The wrong verdicts as pictures: what the student saw, how it explained it, and what it said."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from testbed.report import html
from testbed.report.candidates import chance, sentence, truth_mark
from testbed.report.desk import Desk
from testbed.report.explained import Explained, draw_explained, explanations, window
from testbed.report.reading import Row, Trial
from testbed.report.seen import LEFT
from testbed.report.style import styled
from testbed.vision import StereoRig

MOST = 8


def failure_gallery(desk: Desk) -> str:
    """The first wrong verdicts of the desk's mind, those of its first cell before others; empty if there are none."""
    wrong = [
        (trial.of(desk.mind), row)
        for cell in desk.run.cells
        for trial in desk.run.of_cell(cell)
        for row in trial.of(desk.mind).rows
        if row["verdict"] != row["truth"]
    ]
    if not wrong:
        return ""
    shown = [_failure(desk, number, *entry) for number, entry in enumerate(wrong[:MOST], 1)]
    told = "" if len(wrong) <= MOST else f" The first {MOST} are shown."
    count = f"{len(wrong)} wrong verdict{'' if len(wrong) == 1 else 's'}"
    return (
        f"<h3>Where it was wrong</h3><p>{count} of {html.text(desk.mind)}.{told} Left: what it saw under its own body; "
        "right: under the body that explains it best among others.</p>"
        f'<div class="failures">{"".join(shown)}</div>'
    )


def _failure(desk: Desk, number: int, trial: Trial, row: Row) -> str:
    where = f"trial {trial.number}" if len(desk.run.cells) == 1 else f"{trial.cell}, trial {trial.number}"
    caption = (
        f"<strong>{html.text(where)}: {html.text(row['robot'])}</strong>, {truth_mark(str(row['truth']))}, "
        f"taken for {html.text(row['verdict'])}"
    )
    if not row["found"]:
        return html.figure("", f"{caption}: it was not found.")
    if row.get("probability") is not None:
        caption += f" (like it: {chance(row['probability'])})"
    caption += f". {html.text(sentence(row.get('reason')))}"
    picture = failure_picture(trial, str(row["teacher"]), desk.rig(trial))
    label = f"What the student saw of {row['robot']} in {where}"
    return desk.picture(picture, f"failure_{number}", label, caption) or html.figure("", caption)


@styled
def failure_picture(trial: Trial, teacher: str, rig: StereoRig) -> Figure | None:
    """One left image, from the middle, once for each explanation; as it is where one is missing."""
    images, rows = trial.array(f"{teacher}/images"), explanations(trial, teacher)
    if images is None:
        return None
    figure = Figure(figsize=(3.6, 1.42), layout="constrained")
    look = len(images) // 2
    panels, image = figure.subplots(1, 2), images[look, LEFT]
    nothing = Explained("", np.empty((len(images), 0, 8)))
    for axes, row in zip(panels, [*rows, nothing, nothing], strict=False):
        draw_explained(axes, image, row.parts[look], rig, window(image[None]))
    return figure
