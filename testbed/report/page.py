"""The report: one page that holds a run's verdicts, figures and video, and needs nothing else."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image

from testbed.experiment.atomic import write_text
from testbed.garbage import rarely_collected
from testbed.report import html, story, story_motion
from testbed.report.claims import FEWEST, FLAT, claims
from testbed.report.comparison import summaries_of
from testbed.report.desk import Desk
from testbed.report.knowing import self_headline
from testbed.report.life_section import bodies_known, travels_told
from testbed.report.reading import Trial, read_run
from testbed.report.sweeps import sweeps
from testbed.report.verdict_section import verdicts
from testbed.report.words import explanation, headline, summary_facts

if TYPE_CHECKING:
    from testbed.report.filming import Written


def write_report(run_directory: Path) -> Path:
    """Write ``report.html``, ``figures/*.svg`` and ``video/*.mp4`` of a run; returns the page's path.

    The same run directory gives the same page.

    Raises:
        UserError: If this is no run directory, a trial's file is damaged, or the disk is full.
    """
    desk = Desk.of(read_run(run_directory))
    path = run_directory / "report.html"
    with _filming(desk) as film, rarely_collected():
        write_text(path, html.page(f"{desk.run.name}: whom to imitate", _body(desk, film)))
    return path


def _filming(desk: Desk) -> AbstractContextManager[Callable[[], Written]]:
    """Begins the video, which is made while all else is."""
    sample = desk.acted if desk.rows else None
    if sample is None:
        return contextlib.nullcontext(lambda: None)
    from testbed.report.filming import filming  # only where there is something to show

    path = desk.run.directory / "video" / f"{sample.cell}-{sample.number}.mp4"
    return filming(sample, desk.bodies(sample), path)


def _body(desk: Desk, film: Callable[[], Written]) -> str:
    told = "".join(_chapter(each) for each in storytellers(desk))
    many = len(desk.trials) > 1
    note = ""
    if many and desk.sample is not None:
        note = (
            f'<p class="note">Pictures below tell trial {desk.sample.number}, the first, whatever came of it; '
            f"error curves are about all {len(desk.trials)} trials.</p>"
        )
    parts = [sweeps(desk), verdicts(desk), bodies_known(desk), travels_told(desk)]
    parts += [_claims(desk), note, told] if many else [told, _claims(desk)]
    return "".join([_header(desk, film), *parts, _footer(desk)])  # the film last: it takes longest


def storytellers(desk: Desk) -> list[Desk]:
    """Whose stories are told in pictures: the leader's, and that of the first who follows the paper beside it."""
    beside = [Desk(desk.run, name) for name in desk.run.students if name != desk.mind]
    to_the_letter = [] if desk.by_the_paper else [each for each in beside if each.by_the_paper]
    return [desk, *to_the_letter[:1]]


def _chapter(desk: Desk) -> str:
    sample = desk.sample
    if sample is None:
        return ""
    told = [story.self_discovery(desk, sample)]
    if sample.rows:
        how = story if desk.by_the_paper else story_motion
        told += [how.teacher_modelling(desk, sample), how.imitation(desk, sample)]
    return "".join([*told, story.performing(desk)])


def _header(desk: Desk, film: Callable[[], Written]) -> str:
    run = desk.run
    kicker = html.text(f"{run.name} · {run.scenario.description or 'a run of the testbed'}")
    cell = desk.cell if len(run.cells) > 1 else None
    if not desk.rows:
        title = html.text(self_headline(desk.selves, cell))
        return f'<header><p class="kicker">{kicker}</p><h1>{title}</h1></header>'
    facts = ""
    if run.trial_count > 1:
        facts = "".join(
            f"<div><dt>{html.text(name)}</dt><dd>{html.text(value)}<small>{html.text(interval)}</small></dd></div>"
            for name, value, interval in summary_facts(summaries_of(run, desk.cell)[desk.mind])
        )
        facts = f'<dl class="facts">{facts}</dl>'
    video = "" if desk.acted is None else _video(desk, desk.acted, film())
    others = [row for row in run.verdicts(cell=desk.cell) if row["student"] != desk.mind]
    return (
        f'<header><p class="kicker">{kicker}</p><h1>{html.text(headline(desk.rows, cell))}</h1>'
        f"<p>{html.text(explanation(desk.rows, others))}</p>{facts}{video}</header>"
    )


def _video(desk: Desk, sample: Trial, written: Written) -> str:
    if written is None:
        return ""
    poster = io.BytesIO()
    Image.fromarray(written[1]).save(poster, format="PNG", optimize=True)
    height, width = written[1].shape[:2]
    film = (
        f'<video controls autoplay loop muted playsinline width="{width}" height="{height}" '
        f'poster="{html.data_uri(poster.getvalue(), "image/png")}" '
        f'src="{html.data_uri(written[0].read_bytes(), "video/mp4")}"></video>'
    )
    from testbed.report.video import panes  # loaded already, as there is a video

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


def _claims(desk: Desk) -> str:
    """What the paper claims, for the mind that does as the paper says; empty where there is none."""
    teller = next((each for each in storytellers(desk) if each.by_the_paper and each.rows), None)
    if teller is None:
        return ""
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
        for claim in claims(teller.rows)
    ]
    return html.section(
        teller.titled("What was reproduced and what was not"),
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
    trials = f" --trials {run.trial_count}" if len(run.cells) == 1 else ""
    command = f"testbed run scenario.resolved.yaml --seed {run.scenario.seed}{trials} --out again"
    return (
        f"<footer><h2>Where this comes from</h2><dl>{listed}</dl>"
        f"<p>To repeat it, in this page's folder:</p><pre>{html.text(command)}</pre></footer>"
    )


def _flat(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_flat(item)}" for key, item in value.items() if item is not None)
    return f"{value:.6g}" if isinstance(value, float) else str(value)
