"""What happened, phase by phase: a sample trial in pictures, then the same errors over all trials."""

from __future__ import annotations

import numpy as np

from testbed.report import figures, html
from testbed.report.bodies import self_discovery_picture, tilt_picture
from testbed.report.candidates import sentence
from testbed.report.claims import change
from testbed.report.desk import Desk
from testbed.report.motion import pose_picture, roll_picture
from testbed.report.performance import chosen, path_figure
from testbed.report.reading import Row, Trial
from testbed.report.seen import teacher_model_picture
from testbed.report.series import present_truths, start_end


def self_discovery(desk: Desk, sample: Trial) -> str:
    """Section 3.2 of the paper: Figs. 3 and 6."""
    lead = (
        "The student knows its parts and motors, not how they are joined. It moves them at random, feels how its "
        "body tilts, and looks for the body that would have tilted so."
    )
    if sample.array("self/believed_tilt") is None:
        lead = (
            "The student knows its parts and motors, not how they are joined. Of the movements that it could make it "
            "chooses those about whose outcome the bodies it holds possible differ most, feels how its body tilts, and "
            "keeps the bodies that would have tilted so."
        )
    two = len(desk.student(sample).joints) == 2
    colours = " Green: limb a; violet: limb b." if two else " Each limb has its colour."
    searched = f"{_tested(desk, 'self_error_initial', 'self_error_final', None, 'm')}"
    return html.section(
        desk.titled("1. Who am I?"),
        desk.picture(
            self_discovery_picture(sample, desk.student(sample)),
            "self_discovery",
            "The true body and three self-models after three motor commands",
            "How the body stood after three of its motor commands, and how its self-model would have stood at the "
            f"start, the middle and the end of the search.{colours}",
        ),
        desk.picture(
            tilt_picture(sample, desk.student(sample)),
            "tilt",
            "Believed against observed tilt of the main body",
            "The same for every command: observed tilt against the tilt that the self-model predicts. On the "
            "diagonal both agree. Dots: forward and backward; squares: left and right.",
        ),
        desk.picture(
            figures.figure_6(desk.trials, desk.student(sample)),
            "figure_6",
            "Objective error of self-models over the iterations",
            f"Objective error of the self-models: how far their parts lie from where they truly are. {searched}",
        ),
        _known(sample),
        lead=lead,
    )


def _known(sample: Trial) -> str:
    """What the mind says that it knows of its body and what not, and what became of it since, in its own words."""
    told = [sample.array(f"self/{name}") for name in ("words", "words_since")]
    lines = [str(line) for words in told if words is not None for line in np.atleast_1d(words) if str(line)]
    return "".join(f"<p>{html.text(sentence(line))}</p>" for line in lines)


def teacher_modelling(desk: Desk, sample: Trial) -> str:
    """Section 3.3 of the paper: Figs. 4 and 7."""
    lead = _modelling_lead(sample)
    parts = []
    for row in sample.rows:
        drawing = teacher_model_picture(sample, row["teacher"], desk.rig(sample)) if row["found"] else None
        parts.append(heading(row))
        if drawing is None:
            parts.append(
                "<p>The student did not find this teacher, so there is nothing that it could model.</p>"
            )
            continue
        parts.append(
            desk.picture(
                drawing,
                f"model_{row['teacher']}",
                f"What the student saw and imagined of {row['teacher']}",
                "Above: the left image of each pair, with the pixels that the student asked for. Below: its "
                "best model at the start and after each pair, as its left eye would see it, under the outlines of "
                "the true parts.",
            )
        )
    for letter, truth in zip("ab", present_truths(desk.rows), strict=False):
        shown = next((row for row in sample.rows if row["truth"] == truth and row["found"]), None)
        pictured = None if shown is None else (sample, str(shown["teacher"]))
        columns = ("model_position_error_initial", "model_position_error_final")
        parts.append(
            desk.picture(
                figures.figure_7(desk.trials, truth, pictured, desk.rig(sample)),
                f"figure_7{letter}",
                f"Objective error of models of the {truth} teacher over the passes",
                f'Objective error of the models of the <span class="{truth}">{truth}</span> teacher. Left: mean '
                f"distance of its parts from the true ones. {_tested(desk, *columns, truth, 'm')} Right: what share of "
                "what the model or the true body shows is shown by both.",
                on_page=figures.figure_7(desk.trials, truth),
            )
        )
    return html.section(desk.titled("2. What is that over there?"), *parts, lead=lead)


def imitation(desk: Desk, sample: Trial) -> str:
    """Section 3.4 of the paper: Figs. 5 and 8."""
    lead = (
        "In its mind the student lets its self-model move, driven by a small network that sees how the imagined "
        "teacher turned. If it learns to turn likewise, the teacher is like it."
    )
    parts = []
    for row in [row for row in sample.rows if row["found"]]:
        teacher = str(row["teacher"])
        parts.append(heading(row))
        parts.append(
            desk.picture(
                roll_picture(sample, teacher),
                f"rolls_{teacher}",
                f"Rolls of the self-model against those of {teacher}",
                "Roll of each part of the self-model (colour) and of the corresponding part of the imagined teacher "
                "(thin line). The area between them is the error.",
            )
        )
        parts.append(
            desk.picture(
                pose_picture(sample, teacher, desk.student(sample)),
                f"poses_{teacher}",
                f"Poses of the imagined {teacher} and of the self-model",
                "The same as poses at five moments: the teacher as the student imagines it, and the self-model under "
                "the first, the middle and the last controller. Corresponding parts have one colour.",
            )
        )
    tests = " ".join(
        f'<span class="{truth}">{truth.capitalize()}</span>: '
        + _tested(desk, "objective_initial_error", "objective_final_error", truth, "rad")
        for truth in present_truths(desk.rows)
    )
    parts.append(
        desk.picture(
            figures.figure_8(desk.trials),
            "figure_8",
            "Errors of the controllers over the iterations",
            f"Errors of the controllers: against what the teachers truly did, and as the student judges them. "
            f"Objective error. {tests}",
        )
    )
    return html.section(desk.titled("3. Can I move like that?"), *parts, lead=lead)


def performing(desk: Desk) -> str:
    """Section 3.4 of the paper: Fig. 9; empty where nobody was imitated."""
    trial = desk.acted
    row = None if trial is None else chosen(trial)
    if trial is None or row is None:
        return ""
    which = "" if len(desk.trials) == 1 else f" in trial {trial.number}"
    moved = "".join(
        f" {text} {html.number(row[name] * 100)} cm."
        for name, text in (
            ("path_forward", "Forward, along its own axis, the student came"),
            ("teacher_forward", "Between the first look and the last the teacher came"),
        )
        if row.get(name) is not None
    )
    return html.section(
        desk.titled("4. Doing it"),
        desk.picture(
            path_figure(trial),
            "path",
            "Distance that the student and its teacher covered",
            f"Distance of the main body from where it began.{moved}",
        ),
        lead=f"The student lets the last controller for {html.text(row['teacher'])} move its real body{which}.",
    )


def _modelling_lead(sample: Trial) -> str:
    """What the student does with a candidate, with the numbers of this trial where it found one."""
    times, parts = "", "parts"
    for row in sample.rows:
        looks = sample.array(f"{row['teacher']}/look_steps")
        history = sample.array(f"{row['teacher']}/model_history")
        if looks is not None and history is not None:
            times = " once" if len(looks) == 1 else f" {_word(len(looks))} times"
            parts = f"{_word(history.shape[1])} part{'' if history.shape[1] == 1 else 's'}"
            break
    return (
        f"The student looks at each candidate{times} and imagines bodies of {parts}, until it finds one that would "
        "darken the pixels it has asked for."
    )


def _word(number: int) -> str:
    words = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
    return words[number] if number < len(words) else str(number)


def heading(row: Row) -> str:
    """The name of a teacher above its pictures."""
    return (
        f"<h3>{html.text(row['teacher'])} ({html.text(row['robot'])}), "
        f'<span class="{html.text(row["truth"])}">{html.text(row["truth"])}</span></h3>'
    )


def _tested(desk: Desk, start: str, end: str, truth: str | None, unit: str) -> str:
    test = start_end(desk.rows, start, end, truth)
    if test is None:
        return ""
    return html.prose(f"{change(test, unit)}.")
