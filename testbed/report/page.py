"""The report: one page that holds a run's verdicts, figures and video, and needs nothing else."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from testbed.experiment.atomic import write_text
from testbed.report import html, story
from testbed.report.claims import FEWEST, FLAT, claims
from testbed.report.desk import Desk
from testbed.report.reading import Row, Trial, read_run
from testbed.report.series import right_verdicts
from testbed.report.words import explanation, headline, summary_facts

_FEW = 8  # a table of so many rows needs no unfolding


def write_report(run_directory: Path) -> Path:
    """Write ``report.html``, ``figures/*.svg`` and ``video/*.mp4`` of a run; returns the page's path.

    The same run directory gives the same page.

    Raises:
        UserError: If this is no run directory, a trial's file is damaged, or the disk is full.
    """
    desk = Desk(read_run(run_directory))
    path = run_directory / "report.html"
    write_text(path, html.page(f"{desk.run.name}: whom to imitate", _body(desk)))
    return path


def _body(desk: Desk) -> str:
    sample = desk.sample
    told = []
    if sample is not None:
        told = [
            phase(desk, sample) for phase in (story.self_discovery, story.teacher_modelling, story.imitation)
        ]
        told.append(story.performing(desk))
    if len(desk.trials) > 1 and sample is not None:
        note = (
            f'<p class="note">Pictures below tell trial {sample.number}, the first, whatever came of it; '
            f"error curves are about all {len(desk.trials)} trials.</p>"
        )
        return "".join([_header(desk), _verdicts(desk), _claims(desk), note, *told, _footer(desk)])
    return "".join([_header(desk), _verdicts(desk), *told, _claims(desk), _footer(desk)])


def _header(desk: Desk) -> str:
    run = desk.run
    kicker = html.text(f"{run.name} · {run.scenario.get('description') or 'a run of the testbed'}")
    facts = ""
    if len({(row["cell"], row["trial"]) for row in run.rows}) > 1:
        facts = "".join(
            f"<div><dt>{html.text(name if len(run.summary) == 1 else f'{student}: {name}')}</dt>"
            f"<dd>{html.text(value)}<small>{html.text(interval)}</small></dd></div>"
            for student, summary in run.summary.items()
            for name, value, interval in summary_facts(summary)
        )
        facts = f'<dl class="facts">{facts}</dl>'
    video = "" if desk.acted is None else _video(desk, desk.acted)
    return (
        f'<header><p class="kicker">{kicker}</p><h1>{html.text(headline(run.rows))}</h1>'
        f"<p>{html.text(explanation(run.rows))}</p>{facts}{video}</header>"
    )


def _video(desk: Desk, sample: Trial) -> str:
    from testbed.report.video import (
        panes,
        write_video,
    )  # needs a simulation: only where there is something to show

    path = desk.run.directory / "video" / f"{sample.cell}-{sample.number}.mp4"
    written = write_video(sample, desk.bodies, path)
    if written is None:
        return ""
    poster = io.BytesIO()
    Image.fromarray(written[1]).save(poster, format="PNG", optimize=True)
    height, width = written[1].shape[:2]
    film = (
        f'<video controls autoplay loop muted playsinline width="{width}" height="{height}" '
        f'poster="{html.data_uri(poster.getvalue(), "image/png")}" '
        f'src="{html.data_uri(path.read_bytes(), "video/mp4")}"></video>'
    )
    imitated = any(pane.agent == "student" for pane in panes(sample))
    caption = (
        "The teacher while the student watched it, and the student while it imitated; both from where they began."
        if imitated
        else "The candidates while the student watched them. It imitated nobody."
    )
    if len(desk.trials) > 1:
        which = "the first with an imitation" if imitated else "the first"
        caption = f"Trial {sample.number}, {which}. {caption}"
    return html.figure(film, caption)


def _verdicts(desk: Desk) -> str:
    rows = desk.run.rows
    many = len({(row["cell"], row["trial"]) for row in rows}) > 1
    table = _verdict_table(rows, many=many)
    shown = table if len(rows) <= _FEW else html.details(f"All {len(rows)} verdicts", table)
    cells = _cell_table(desk) if len(desk.run.cells) > 1 else ""
    return html.section("Verdicts", cells, story.verdict_scores(desk), shown)


def _verdict_table(rows: Sequence[Row], *, many: bool) -> str:
    header = ["teacher", "robot", "truth", "verdict", "score", "error at start (Eq. 5)", "at end", ""]
    if many:
        header = ["cell", "trial", *header] if len({row["cell"] for row in rows}) > 1 else ["trial", *header]
    body = []
    for row in rows:
        cells = [
            html.text(row["teacher"]),
            html.text(row["robot"]),
            f'<span class="{html.text(row["truth"])}">{html.text(row["truth"])}</span>',
            _verdict(row),
            html.number(row["score"]),
            html.number(row.get("initial_error")),
            html.number(row.get("final_error")),
            "imitated" if row["chosen"] else "" if row["found"] else "not found",
        ]
        if many:
            cells = [html.text(row[name]) for name in header if name in ("cell", "trial")] + cells
        body.append(cells)
    return html.table(header, body, css="verdicts")


def _verdict(row: Row) -> str:
    right = row["truth"] == row["verdict"]
    mark, name = ("✓", "right") if right else ("✗", "wrong")
    return f'{html.text(row["verdict"])} <span class="{name}" title="{name}">{mark}</span>'


def _cell_table(desk: Desk) -> str:
    body = []
    for cell in desk.run.cells:
        rows = [row for row in desk.run.rows if row["cell"] == cell]
        right, (low, high) = right_verdicts(rows)
        body.append([html.text(cell), str(len(rows)), f"{right / len(rows):.0%}", f"{low:.0%} to {high:.0%}"])
    note = f"<p>Figures and claims below are about the cell <em>{html.text(desk.cell)}</em>.</p>"
    return html.table(["cell", "verdicts", "right", "95% interval"], body) + note


def _claims(desk: Desk) -> str:
    lead = (
        f"Each claim of the paper against this run. Errors are objective: held against the truth. An error falls where "
        f"the signed-rank test over trials (5% level, at least {FEWEST} trials) and the 95% interval of its mean "
        f"change both say so; it is flat where that interval stays within {FLAT:.0%} of its start."
    )
    body = [
        [
            html.text(claim.claim),
            f'<span class="outcome {claim.outcome.split()[0]}">{html.text(claim.outcome)}</span>',
            html.prose(claim.finding),
        ]
        for claim in claims(desk.rows)
    ]
    return html.section(
        "What was reproduced and what was not",
        html.table(["the paper", "here", "numbers"], body, css="claims"),
        lead=lead,
    )


def _footer(desk: Desk) -> str:
    run = desk.run
    entries: list[tuple[str, str]] = [("scenario", f"{run.name}, content hash {run.content_hash}")]
    entries += [
        (name, _flat(value))
        for name, value in run.provenance.items()
        if value is not None and name not in ("scenario", "hash")
    ]
    listed = "".join(f"<dt>{html.text(name)}</dt><dd>{html.text(value)}</dd>" for name, value in entries)
    trials = len({(row["cell"], row["trial"]) for row in run.rows})
    seed = run.scenario.get("seed", 0)
    command = f"testbed run scenario.resolved.yaml --seed {seed} --trials {trials} --out again"
    return (
        f"<footer><h2>Where this comes from</h2><dl>{listed}</dl>"
        f"<p>To repeat it, in this page's folder:</p><pre>{html.text(command)}</pre></footer>"
    )


def _flat(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_flat(item)}" for key, item in value.items() if item is not None)
    return f"{value:.6g}" if isinstance(value, float) else str(value)
