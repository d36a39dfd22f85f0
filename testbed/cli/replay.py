"""The command ``testbed replay``: a trial on a bench, studied later without the robot."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.exceptions import Exit

if TYPE_CHECKING:
    from testbed.experiment.jobs import Job
    from testbed.experiment.run_directory import RunDirectory

_COMPARED = ("verdict", "score", "chosen")


def replay(
    folder: Annotated[
        Path,
        typer.Argument(metavar="RUN", help="The directory of a run on a bench, as `testbed run` printed it."),
    ],
    trial: Annotated[int, typer.Argument(metavar="TRIAL", min=0, help="The number of the trial.")],
    cell: Annotated[str, typer.Option(help="The trial's cell, if the scenario has several.")] = "default",
    frames: Annotated[
        bool,
        typer.Option("--frames", help="List all that went over the wires, in words, and think of nothing."),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON for programs, and nothing else.")
    ] = False,
) -> None:
    """Feed a bench's journal to the student once more, and say whether it comes to the same verdicts."""
    from testbed.experiment.jobs import Job
    from testbed.experiment.run_directory import RunDirectory

    run, job = RunDirectory.open(folder), Job(cell, trial)
    if frames:
        _list_frames(run, job, as_json=as_json)
    else:
        _think_again(run, job, as_json=as_json)


def _list_frames(run: RunDirectory, job: Job, *, as_json: bool) -> None:
    from testbed.experiment.replay import journal_of
    from testbed.hardware.frames_in_words import told

    for line in told(journal_of(run, job)):
        typer.echo(json.dumps(line._asdict()) if as_json else str(line))


def _think_again(run: RunDirectory, job: Job, *, as_json: bool) -> None:
    from rich.console import Console

    from testbed.console import display_on
    from testbed.experiment.replay import journal_of
    from testbed.experiment.replay import replay as live_again
    from testbed.hardware.frames_in_words import contents

    held = contents(journal_of(run, job))
    screen = Console(stderr=as_json)
    if not as_json:
        for line in held.lines():
            screen.print(line, markup=False, highlight=False, soft_wrap=True)
    with display_on(screen) as display:
        came = live_again(run, job, lambda phase, done, total: display.progressed(job, phase, done, total))
    recorded = _recorded(run, job)
    rows = [row for row in came.rows if row.get("kind", "verdict") == "verdict"]
    differing = _differing(rows, recorded)
    if as_json:
        typer.echo(
            json.dumps(
                {
                    **held._asdict(),
                    "finished": came.life is not None,
                    "verdicts": [_plain(row) for row in rows],
                    "equal": None if recorded is None else not differing,
                },
                indent=2,
            )
        )
    else:
        _print_verdicts(rows, recorded, differing, came.life is not None)
    if differing:
        raise Exit(1)


def _print_verdicts(
    rows: Sequence[Mapping[str, Any]],
    recorded: Sequence[Mapping[str, Any]] | None,
    differing: Sequence[str],
    finished: bool,
) -> None:
    for row in rows:
        score = "" if row["score"] is None else f", score {row['score']:.3f}"
        chosen = ", chosen" if row["chosen"] else ""
        typer.echo(f"{row['student']} of {row['teacher']}: {row['verdict']}{score}{chosen}")
    if not finished:
        then = "run the scenario again to go on" if recorded is None else "what it said then is recorded"
        typer.echo(f"the journal ends before the student had decided; {then}")
    elif recorded is None:
        typer.echo("there are no recorded verdicts to hold these against")
    elif differing:
        typer.echo(f"NOT as recorded: {'; '.join(differing)}")
    else:
        typer.echo("as recorded, to the last digit")


def _recorded(run: RunDirectory, job: Job) -> list[dict[str, Any]] | None:
    if not run.is_finished(job):
        return None
    return [row for row in run.read_rows(job) if row.get("kind", "verdict") == "verdict"]


def _differing(rows: Sequence[Mapping[str, Any]], recorded: Sequence[Mapping[str, Any]] | None) -> list[str]:
    """What is not as it was, in words."""
    if recorded is None or not rows:
        return []
    before = {(row["student"], row["teacher"]): row for row in recorded}
    found = []
    for row in rows:
        then = before.get((row["student"], row["teacher"]))
        if then is None:
            found.append(f"{row['student']} said nothing of {row['teacher']}")
            continue
        found += [
            f"{row['student']} of {row['teacher']}: {name} is {row[name]}, was {then[name]}"
            for name in _COMPARED
            if row[name] != then[name]
        ]
    return found


def _plain(row: Mapping[str, Any]) -> dict[str, Any]:
    return {name: row[name] for name in ("student", "teacher", *_COMPARED)}
