"""The command ``testbed``: reads arguments, calls the library, prints.

Heavy modules are imported where they are used, so that ``testbed --help`` answers at once.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.exceptions import Abort, Exit, TyperException

from testbed.cli import calibrate as cli_calibrate
from testbed.cli import hardware as cli_hardware
from testbed.cli import replay as cli_replay
from testbed.cli import results as cli_results
from testbed.errors import UserError, one_line, shown_path

_STOPPED = 130  # 128 + SIGINT, as shells have it

app = typer.Typer(
    name="testbed",
    help="A robot that finds out whom to imitate: run scenarios, look at what came of them.",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

ScenarioFile = Annotated[
    str, typer.Argument(metavar="FILE", help="A scenario file, or the name of a shipped one.")
]
RunFolders = Annotated[
    list[Path],
    typer.Argument(metavar="RUN...", help="A run directory, as `testbed run` printed it, or several."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs, and nothing else.")]


@app.command(epilog="Example: testbed run scenarios/whom_to_imitate.yaml --seed 3")
def run(
    file: ScenarioFile,
    out: Annotated[
        Path | None, typer.Option(help="The run directory; runs/<scenario>-<hash> by default.")
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(help="One of the scenario's splits, such as held_out; as it stands by default."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Another seed than the file's.")] = None,
    trials: Annotated[
        int | None, typer.Option(help="The total number of trials; finished ones are not computed again.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="How many trials are computed at a time; one a core by default.")
    ] = None,
    executor: Annotated[
        str, typer.Option(help="Who computes: processes on this machine, or a ray cluster.")
    ] = "processes",
    address: Annotated[
        str | None, typer.Option(help="Of a running Ray cluster; one on this machine is started by default.")
    ] = None,
    backend: Annotated[
        str, typer.Option(help="Where trials take place: simulation, or hardware, which is a bench.")
    ] = "simulation",
    bench: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="With --backend hardware: its file, bench.yaml by default, or `emulated`."
        ),
    ] = None,
    smoke: Annotated[bool, typer.Option("--smoke", help="The same scenario cut down to seconds.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run a scenario, or continue it; at the end come the verdicts and a report."""
    from testbed.console import display_on, summary_lines, verdict_table
    from testbed.experiment import runner
    from testbed.experiment.backends import bench_path
    from testbed.experiment.jobs import jobs_of
    from testbed.experiment.run_directory import default_path
    from testbed.scenario import check, load_scenario, with_overrides

    scenario = with_overrides(load_scenario(file), split=split, seed=seed, trials=trials, smoke=smoke)
    here = executor == "processes" and address is None
    computing = None if here else runner.executor_for(workers, executor, address)
    check(scenario)
    stage = cli_hardware.on_bench(backend, bench)
    if stage is not None and (not here or (workers or 1) > 1):
        raise UserError("a bench has one trial at a time", "leave out --workers, --executor and --address")
    path = out or (default_path(scenario) if stage is None else bench_path(scenario))
    screen = _console(stderr=as_json)
    ending = cli_calibrate.limp_when_told_to_end() if stage is not None else contextlib.nullcontext()
    with _traceback_kept_in(path), ending, display_on(screen) as display:
        outcome = runner.run(
            scenario, out=path, workers=workers or _cores(), executor=computing, display=display, bench=stage
        )
        report = _report_of(path) if _anything(outcome.verdicts) else None
    if as_json:
        _print_json({"run": str(path), "report": report and str(report), **outcome.verdicts})
    else:
        if outcome.verdicts["verdicts"]:
            screen.print(verdict_table(outcome.verdicts))
        for line in summary_lines(outcome.verdicts):
            screen.print(line, highlight=False, soft_wrap=True)
    if report and not as_json:
        screen.print(f"report: {shown_path(report)}", markup=False, highlight=False, soft_wrap=True)
    if outcome.left_out and not as_json:
        cells = list(dict.fromkeys(job.cell for job in outcome.left_out))
        screen.print(
            f"left out, as they cannot be: {_listed(cells)}", markup=False, highlight=False, soft_wrap=True
        )
    if outcome.failed:
        total = len(jobs_of(scenario))
        names = _listed([str(job) for job in outcome.failed])
        _complain(f"{len(outcome.failed)} of {total} trials failed ({names}); run it again to retry them")
        raise Exit(1)


@app.command(epilog="Example: testbed check my_scenario.yaml")
def check(file: ScenarioFile, as_json: AsJson = False) -> None:
    """Look a scenario over without running it: says what is wrong, where, and how to mend it."""
    from testbed.experiment.jobs import jobs_of
    from testbed.scenario import cell_names, content_hash, in_split, load_scenario
    from testbed.scenario import check as check_scenario

    scenario = load_scenario(file)
    for variant in (scenario, *(in_split(scenario, split) for split in scenario.splits)):
        check_scenario(variant)
    facts = {
        "scenario": scenario.name,
        "hash": content_hash(scenario),
        "teachers": len(scenario.teachers),
        "cells": len(cell_names(scenario)),
        "trials": len(jobs_of(scenario)),
    }
    if as_json:
        _print_json(facts)
    else:
        typer.echo(
            f"{scenario.name} is fine: {_count(len(scenario.teachers), 'teacher')}, "
            + (f"{facts['cells']} cells, " if facts["cells"] != 1 else "")
            + f"{_count(len(jobs_of(scenario)), 'trial')}, hash {facts['hash']}"
        )


@app.command("list", epilog="Example: testbed list")
def list_names(as_json: AsJson = False) -> None:
    """List the scenarios, robots, gaits and students that can be named."""
    from testbed.resources import robot_names, scenario_names
    from testbed.scenario.specs import STUDENT_METHODS
    from testbed.world.gaits import preset_names

    names = {
        "scenarios": scenario_names(),
        "robots": robot_names(),
        "gaits": preset_names(),
        "students": tuple(STUDENT_METHODS),
    }
    if as_json:
        _print_json(names)
        return
    for kind, known in names.items():
        typer.echo(f"{kind + ':':<11}{', '.join(known) or 'none'}")


@app.command(epilog="Example: testbed show crawler")
def show(
    robot: Annotated[str, typer.Argument(metavar="ROBOT", help="A shipped robot's name, or a file.")],
    out: Annotated[
        Path | None, typer.Option(help="The picture, .png or .svg; <robot>.png by default.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Draw a robot and tell its parts, masses and joints."""
    from testbed.bodies.morphology import load_robot
    from testbed.bodies.robot_table import joint_table, part_table, plain_facts
    from testbed.experiment.atomic import refused_writes_explained

    body = load_robot(robot)
    picture = out or Path(f"{body.name}.png")
    if picture.suffix not in (".png", ".svg"):
        raise UserError(f"{picture.name} is no picture's name", "end it in .png or .svg")
    from testbed.report.pictures import robot_picture  # slow to load: after mistakes are told

    with refused_writes_explained(picture):
        robot_picture(body, picture)
    if as_json:
        _print_json({"picture": str(picture), **plain_facts(body)})
        return
    screen = _console()
    screen.print(part_table(body))
    if body.joints:
        screen.print(joint_table(body))
    screen.print(f"picture: {shown_path(picture)}", markup=False, highlight=False, soft_wrap=True)


@app.command(epilog="Example: testbed report runs/whom_to_imitate-1a2b3c4d")
def report(
    folders: RunFolders,
    out: Annotated[
        Path | None,
        typer.Option(help="Of several runs: the page's folder; runs/comparison-<hash> by default."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a run's report again; of several runs one page that holds their students against each other."""
    if len(folders) > 1:
        cli_results.compare(folders, out, as_json=as_json)
        return
    if out is not None:
        raise UserError("the report of one run stands in its folder", "leave out --out, or give several runs")
    (folder,) = folders
    from testbed.experiment import verdicts
    from testbed.experiment.run_directory import RunDirectory
    from testbed.experiment.runner import summed_up

    contents = summed_up(RunDirectory.open(folder))
    if not _anything(contents):
        raise UserError(f"{shown_path(folder)} has no finished trial yet", "run its scenario first")
    with _traceback_kept_in(folder):
        verdicts.write(folder, contents)
        page = _report_of(folder)
    if as_json:
        _print_json({"report": str(page)})
    else:
        typer.echo(f"report: {shown_path(page)}")


app.command(epilog='Example: testbed query runs/verdict-1a2b3c4d "FROM verdicts WHERE verdict != truth"')(
    cli_results.query
)


app.command(epilog="Example: testbed export runs/verdict-1a2b3c4d --out ~/.minari/datasets")(
    cli_results.export
)


app.command(epilog="Example: testbed replay runs/bench-1a2b3c4d-bench 0")(cli_replay.replay)


app.add_typer(cli_hardware.app)


def main() -> None:
    """The console entry: status 0 done, 1 failed, 2 a mistake of the user's, 130 stopped by Ctrl-C."""
    sys.exit(_status(app, sys.argv[1:] or ["--help"]))


def _status(command: Callable[..., Any], arguments: list[str]) -> int:
    try:
        result = command(args=arguments, prog_name="testbed", standalone_mode=False)
        sys.stdout.flush()
        status = result if isinstance(result, int) else 0
    except UserError as error:
        _complain(str(error))
        return 2
    except TyperException as error:
        _complain(f"{one_line(error.format_message())}; see testbed --help")
        return 2
    except (KeyboardInterrupt, Abort):
        status = _STOPPED
    except BrokenPipeError:
        # Whoever read our output has gone; nothing more can be said there, nor flushed at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        return _internal(error)
    if status == _STOPPED:  # Typer makes this status of a Ctrl-C by itself
        _complain(f"stopped; what is finished is kept, continue with: {_again(arguments)}")
    return status


def _internal(error: Exception) -> int:
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        _complain("the disk is full; free some space and give the same command again")
        return 2
    kept = getattr(error, "testbed_traceback", None)
    where = f"the traceback is in {kept}" if kept else "the traceback follows"
    _complain(f"internal error ({type(error).__name__}: {one_line(str(error))}); {where}; please report it")
    if not kept:
        traceback.print_exception(error)
    return 1


@contextlib.contextmanager
def _traceback_kept_in(folder: Path) -> Any:
    try:
        yield
    except (UserError, TyperException, Exit):
        raise
    except Exception as error:
        with contextlib.suppress(OSError):
            file = folder / "error.txt"
            file.write_text(traceback.format_exc(), encoding="utf-8")
            error.testbed_traceback = shown_path(file)  # type: ignore[attr-defined]
        raise


def _anything(contents: dict[str, Any]) -> bool:
    """Whether a trial is finished: where there are no teachers, the student still knows something of itself."""
    return bool(contents["verdicts"] or contents["selves"])


def _report_of(folder: Path) -> Path:
    from testbed.report.page import write_report

    return write_report(folder)


def _console(*, stderr: bool = False) -> Any:
    from rich.console import Console

    return Console(stderr=stderr)


def _complain(text: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        typer.echo(f"testbed: {text}", err=True)


def _print_json(value: Any) -> None:
    typer.echo(json.dumps(value, indent=2))


def _again(arguments: list[str]) -> str:
    import shlex

    return shlex.join(["testbed", *arguments])


def _listed(names: list[str]) -> str:
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _cores() -> int:
    return len(os.sched_getaffinity(0))
