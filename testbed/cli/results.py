"""The commands that ask finished runs: ``testbed query``, ``export``, and what ``report`` does with several runs."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from testbed.errors import UserError, shown_path

if TYPE_CHECKING:
    from testbed.experiment.run_directory import RunDirectory

_SHOWN_FROM = 100  # reading so few trials needs no progress bar


def query(
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[RUN]... [SQL]",
            help="Run directories, then one query that reads; without a query: all tables and columns.",
            show_default=False,
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON for programs, and nothing else.")
    ] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print CSV, and nothing else.")] = False,
) -> None:
    """Ask runs in SQL (DuckDB): tables verdicts, selves, trials and cells; a column `run` tells several runs apart."""
    from rich.console import Console

    if as_json and as_csv:
        raise UserError("an answer is either JSON or CSV", "leave out --json or --csv")
    folders, sql = _told_apart(arguments or [])
    if sql is None:
        _list_columns(as_json=as_json, as_csv=as_csv)
        return
    from testbed.answer_sheet import print_answer
    from testbed.experiment.query import ask

    with progress_bar("reading trials") as progress:
        answer = ask(folders, sql, progress)
    for damage in answer.damaged:
        typer.echo(f"testbed: {damage} and left out; run its scenario again to compute it anew", err=True)
    if as_json:
        typer.echo(answer.as_json())
    elif as_csv:
        typer.echo(answer.as_csv(), nl=False)
    else:
        print_answer(Console(), answer.names, answer.rows)


def export(
    folder: Annotated[
        Path, typer.Argument(metavar="RUN", help="A run directory, as `testbed run` printed it.")
    ],
    out: Annotated[
        Path | None, typer.Option(help="Minari's folder of data sets; RUN/minari by default.")
    ] = None,
    cell: Annotated[str | None, typer.Option(help="Only this cell of the scenario.")] = None,
    images: Annotated[bool, typer.Option(help="With the student's images, 15 kB a step.")] = True,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON for programs, and nothing else.")
    ] = False,
) -> None:
    """Hand a run's episodes to offline learners: Minari data sets of what the student saw, did and gained."""
    from testbed.experiment import minari_export

    place = out or folder / "minari"
    with progress_bar("reliving trials", shown_from=1) as progress:
        written = minari_export.export(folder, place, cell=cell, images=images, progress=progress)
    if as_json:
        listed = [{**each._asdict(), "folder": str(each.folder)} for each in written]
        typer.echo(json.dumps({"out": str(place), "data_sets": listed}, indent=2))
        return
    for each in written:
        typer.echo(f"{each.name}: {each.episodes} episodes, {each.steps} steps")
    typer.echo(f"load them: MINARI_DATASETS_PATH={shown_path(place)} python -c 'import minari; ...'")


def compare(folders: list[Path], out: Path | None, *, as_json: bool) -> None:
    """Hold the students of several runs, or simulation and bench, against each other: a page, and where it is."""
    from testbed.experiment.backends import sim_and_bench

    if (runs := sim_and_bench(folders)) is not None:
        _compare_bench(*runs, out, as_json=as_json)
        return
    from testbed.experiment.matching import read_sides
    from testbed.experiment.rivals import document, rivalry
    from testbed.report.rivals import headline, write_comparison

    with progress_bar("reading trials") as progress:
        told = rivalry(read_sides(folders, progress))
    page = write_comparison(told, out or Path("runs") / f"comparison-{told.identity}")
    if as_json:
        typer.echo(json.dumps({"report": str(page), **document(told)}, indent=2))
    else:
        typer.echo(headline(told))
        typer.echo(f"report: {shown_path(page)}")


def _compare_bench(simulation: RunDirectory, bench: RunDirectory, out: Path | None, *, as_json: bool) -> None:
    """The page of one scenario in simulation and on the bench."""
    from testbed.experiment.bench_measures import document
    from testbed.experiment.sim_and_bench import compared
    from testbed.report.bench_comparison import headline, write_bench_comparison

    with progress_bar("living through the bench's commands in simulation", shown_from=1) as progress:
        told = compared(simulation, bench, progress)
    name = f"{bench.scenario.name}-{bench.hash8}-bench-and-simulation"
    page = write_bench_comparison(told, out or Path("runs") / name)
    if as_json:
        typer.echo(json.dumps({"report": str(page), **document(told)}, indent=2))
    else:
        typer.echo(headline(told))
        typer.echo(f"report: {shown_path(page)}")


def _told_apart(arguments: list[str]) -> tuple[list[Path], str | None]:
    """Run directories, and the query if there is one: it comes last and has a space in it."""
    if not arguments or Path(arguments[-1]).is_dir():
        return [Path(argument) for argument in arguments], None
    *folders, sql = arguments
    if sql and not any(letter.isspace() for letter in sql):
        raise UserError(
            f"'{sql}' is no run directory and no query", "give run directories, then a query in quotes"
        )
    if not folders:
        raise UserError(
            "the query has no run to ask", 'give it one: testbed query runs/verdict-1a2b3c4d "SELECT ..."'
        )
    return [Path(folder) for folder in folders], sql


def _list_columns(*, as_json: bool, as_csv: bool) -> None:
    from rich.console import Console

    from testbed.answer_sheet import print_columns
    from testbed.experiment.columns import listed

    columns = list(listed())
    if as_json or as_csv:
        from testbed.experiment.query import Answer

        answer = Answer(tuple(columns[0]), tuple(tuple(each.values()) for each in columns))
        typer.echo(answer.as_json() if as_json else answer.as_csv(), nl=as_json)
    else:
        print_columns(Console(), columns)


@contextlib.contextmanager
def progress_bar(title: str, *, shown_from: int = _SHOWN_FROM) -> Iterator[Callable[[int, int], None]]:
    """A bar on the error stream of a terminal, from when there is enough to wait for."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with contextlib.ExitStack() as shown:
        progress = Progress(console=console, transient=True)
        task = progress.add_task(title, total=None)

        def move(done: int, total: int) -> None:
            if total >= shown_from and console.is_terminal:
                if not progress.live.is_started:
                    shown.enter_context(progress)
                progress.update(task, completed=done, total=total)

        yield move
