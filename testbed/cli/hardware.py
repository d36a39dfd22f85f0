"""The commands of the bench: ``testbed hardware find | name | doctor | calibrate | emulate | run | stop``."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.exceptions import Exit

from testbed.cli import calibrate as cli_calibrate
from testbed.cli.calibrate import DEFAULT, BenchFile, calibrated, limp_when_told_to_end
from testbed.cli.results import progress_bar
from testbed.errors import UserError, shown_path

if TYPE_CHECKING:
    from testbed.experiment.runner import OnBench

app = typer.Typer(
    name="hardware",
    help="The physical bench: find, check and calibrate it, run trials on it; or try all that on an emulated one.",
    no_args_is_help=True,
)
app.add_typer(cli_calibrate.app)

_READS_BEFORE_A_RUN = 100  # the doctor has judged the lines by more
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs, and nothing else.")]


@app.command(epilog="Example: testbed hardware find --out bench.yaml")
def find(
    bench: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="A bench file: its ports and cameras are looked at too, such as an emulated bench's.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Begin a bench file with what was found.")
    ] = None,
    pictures: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where thumbnails of what the cameras see go.")
    ] = Path("cameras"),
    as_json: AsJson = False,
) -> None:
    """List serial ports with the boards that answer there, and cameras with a thumbnail each. Nothing moves."""
    from rich.console import Console

    from testbed.hardware.bench_file import load_bench, save_bench
    from testbed.hardware.operating import find as finding
    from testbed.hardware.operating.tables import camera_table, port_table
    from testbed.hardware.operating.workbench import clock_of

    if out is not None and out.exists():
        raise UserError(f"{shown_path(out)} is there already", "give another name, or remove it first")
    spec = None if bench is None else load_bench(bench)
    clock = clock_of(spec)
    globs = () if spec is None else spec.port_globs
    eyes = () if spec is None or spec.cameras is None else (spec.cameras.left, spec.cameras.right)
    with progress_bar("asking who is there", shown_from=1) as progress:
        ports = finding.look_for_boards(globs, clock, progress)
    with progress_bar("looking through the cameras", shown_from=1) as progress:
        cameras = finding.look_for_cameras(eyes, pictures, clock, progress)
    if out is not None:
        save_bench(finding.begun(ports, cameras, globs), out)
    if as_json:
        shown = [
            {"camera": each.id, "size": each.size, "thumbnail": each.thumbnail and str(each.thumbnail),
             "failure": each.failure and each.failure.outcome}
            for each in cameras
        ]  # fmt: skip
        _print_json({"ports": list(finding.as_rows(ports)), "cameras": shown, "bench": out and str(out)})
        return
    console = Console()
    console.print(port_table(ports) if ports else "no serial ports")
    console.print(camera_table(cameras) if cameras else "no cameras")
    for port in ports:
        if port.failure is not None:
            _say(f"{port.info.path}: {port.failure}")
    if out is not None:
        _say(f"bench file: {shown_path(out)}; check in the thumbnails which camera is the left one")


@app.command(epilog="Example: testbed hardware name /dev/ttyUSB0 student")
def name(
    port: Annotated[str, typer.Argument(metavar="PORT", help="Where the board is, as `find` lists it.")],
    agent: Annotated[
        str,
        typer.Argument(metavar="NAME", help="student, teacher_0, teacher_1, ... or rig; the board keeps it."),
    ],
) -> None:
    """Give a board its name. What was calibrated under another one is measured anew."""
    from testbed.hardware.bench_file import is_agent
    from testbed.hardware.clock import WallClock
    from testbed.hardware.robots.board import Address, Board

    if not is_agent(agent):
        raise UserError(f"nobody is called '{agent}'", "boards are student, teacher_0, teacher_1, ... or rig")
    with Board(Address(name=agent, port=port), 1, WallClock()) as board:
        before = board.connect()
        board.rename(agent)
    _say(f"{before.unique_id} on {port} was '{before.board_id}' and is '{agent}' now")


@app.command(epilog="Example: testbed hardware doctor --bench bench.yaml --board")
def doctor(
    bench: BenchFile = DEFAULT,
    reads: Annotated[int, typer.Option(min=1, help="How many exchanges each line is judged by.")] = 300,
    board: Annotated[
        bool,
        typer.Option(
            "--board", help="Also ask for the printed board, to see whether the cameras have moved."
        ),
    ] = False,
    scenario: Annotated[
        str | None, typer.Option(metavar="FILE", help="Also hold the cameras against this scenario's rig.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check everything that can be checked without moving anything; each failure says how to mend it."""
    from rich.console import Console

    from testbed.hardware.doctor.checks import all_well
    from testbed.hardware.doctor.examination import examine
    from testbed.hardware.operating.tables import check_table
    from testbed.hardware.operating.workbench import workbench
    from testbed.hardware.rig.rectification import student_rig
    from testbed.scenario import load_scenario

    with workbench(bench) as place, progress_bar("checking", shown_from=1) as progress:
        eyes = None if scenario is None else student_rig(load_scenario(scenario).rig)
        checks = examine(place, reads=reads, show_board=board, eyes=eyes, progress=progress)
    if as_json:
        _print_json(
            {"bench": bench, "well": all_well(checks), "checks": [check.as_row() for check in checks]}
        )
    else:
        Console().print(check_table(checks))
    if not all_well(checks):
        raise Exit(1)


@app.command(epilog="Example: testbed hardware emulate --folder emulated-bench")
def emulate(
    scenario: Annotated[
        str, typer.Argument(metavar="[SCENARIO]", help="Who is on the bench; a file or a shipped scenario.")
    ] = "bench",
    folder: Annotated[
        Path, typer.Option(metavar="FOLDER", help="Where its ports and its bench file are.")
    ] = Path("emulated-bench"),
    seed: Annotated[
        int, typer.Option(min=0, help="Of what came out of the shop: another one, other servos and lenses.")
    ] = 0,
    http: Annotated[
        int,
        typer.Option(
            "--http", min=0, max=65535, help="TCP port of the camera streams, their name; any if 0."
        ),
    ] = 8642,
) -> None:
    """Start an emulated bench in real time: serial ports and camera streams to try hardware mode with."""
    from testbed.hardware.emulation.live import started

    with started(scenario, folder, seed=seed, port=http) as live:
        for agent, board in live.spec.boards.items():
            _say(f"{agent + ':':<11}{shown_path(live.port_of(agent))}  {board.unique_id}")
        assert live.spec.cameras is not None
        _say(f"cameras:   {live.spec.cameras.left}  {live.spec.cameras.right}")
        _say(f"bench file: {shown_path(folder / 'bench.yaml')}; Ctrl-C ends the bench")
        with contextlib.suppress(KeyboardInterrupt), limp_when_told_to_end():
            live.run(_say)
    _say("the emulated bench is gone; its calibrations stay")


@app.command(epilog="Example: testbed hardware run scenarios/bench.yaml --dry-run")
def run(
    file: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="A scenario file, or the name of a shipped one.")
    ],
    bench: BenchFile = DEFAULT,
    out: Annotated[
        Path | None, typer.Option(help="The run directory; runs/<scenario>-<hash>-bench by default.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Another seed than the file's.")] = None,
    trials: Annotated[
        int | None, typer.Option(help="The total number of trials; finished ones are not done again.")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check everything, say who stands where, and move nothing.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run a scenario on the bench: `testbed run --backend hardware`. What breaks off goes on where it stopped."""
    from testbed import cli

    if dry_run:
        _dry_run(file, bench, seed, trials, as_json=as_json)
        return
    cli.run(file, out=out, seed=seed, trials=trials, backend="hardware", bench=bench, as_json=as_json)


@app.command(epilog="Example: testbed hardware stop")
def stop(
    bench: Annotated[
        str | None, typer.Option(metavar="FILE", help="A bench file, for ports that are not on USB.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Emergency stop: every board that can be reached lets its servos go at once and stays so until it is reset.

    A port that another program has cannot be reached: end that program, or cut the servos' power by the switch.
    """
    from testbed.hardware.bench_file import load_bench
    from testbed.hardware.operating.stopping import POWER_CUT, stop_everything

    spec = load_bench(bench if bench is not None else DEFAULT) if bench or Path(DEFAULT).exists() else None
    done = stop_everything(spec)
    if as_json:
        _print_json({"stopped": [vars(each) for each in done]})
    for each in done:
        if not as_json:
            where = f"{each.port} ({each.board})" if each.board else each.port
            _say(f"{where}: {'stopped' if each.stopped else f'NOT stopped: {each.why}; {POWER_CUT}'}")
    if not all(each.stopped for each in done):
        raise Exit(1)


def on_bench(backend: str, bench: str | None) -> OnBench | None:
    """Where ``testbed run`` is to run: None in simulation.

    Raises:
        UserError: If there is no such backend, or the bench cannot be read.
    """
    from testbed.errors import did_you_mean
    from testbed.experiment.backends import BACKENDS, SIMULATION

    if backend not in BACKENDS:
        raise UserError(f"there is no backend '{backend}'", did_you_mean(backend, BACKENDS, kind="backends"))
    if backend == SIMULATION:
        if bench is not None:
            raise UserError(
                "a simulated run needs no bench", "add '--backend hardware', or leave out --bench"
            )
        return None
    from testbed.hardware.calibration.rig import FILE
    from testbed.hardware.operating.workbench import EMULATED, EMULATED_CALIBRATIONS, stage_of

    if bench == EMULATED and not (EMULATED_CALIBRATIONS / FILE).exists():
        typer.echo("calibrating the emulated bench, this once:", err=True)
        for line in calibrated(bench):
            typer.echo(line, err=True)
    return stage_of(bench or DEFAULT)


def _dry_run(file: str, bench: str, seed: int | None, trials: int | None, *, as_json: bool) -> None:
    from rich.console import Console

    from testbed.experiment.jobs import jobs_of
    from testbed.hardware.doctor.checks import all_well
    from testbed.hardware.doctor.examination import examine
    from testbed.hardware.operating.setup_sheet import misfits, setup_rows
    from testbed.hardware.operating.tables import check_table, sheet_table
    from testbed.hardware.operating.workbench import workbench
    from testbed.hardware.rig.rectification import student_rig
    from testbed.scenario import check, load_scenario, with_overrides

    scenario = with_overrides(load_scenario(file), seed=seed, trials=trials)
    check(scenario)
    with workbench(bench) as place, progress_bar("checking", shown_from=1) as progress:
        wrong = misfits(scenario, place.spec)
        eyes = student_rig(scenario.rig)
        checks = examine(place, reads=_READS_BEFORE_A_RUN, eyes=eyes, progress=progress)
        job = jobs_of(scenario)[0]
        rows = setup_rows(scenario, job.trial, job.cell, place.spec)
    well = all_well(checks) and not wrong
    if as_json:
        _print_json(
            {"ready": well, "misfits": wrong, "checks": [each.as_row() for each in checks], "places": rows}
        )
    else:
        console = Console()
        console.print(check_table(checks))
        console.print(sheet_table(rows))
        _say(
            "places: from the rig's post; turned: counter-clockwise from above, 0 is its x axis to the right"
        )
        for text in wrong:
            _say(f"does not fit: {text}")
        _say("ready; nothing has moved" if well else "not ready; nothing has moved")
    if not well:
        raise Exit(1)


def _say(text: str) -> None:
    typer.echo(text)


def _print_json(value: Any) -> None:
    typer.echo(json.dumps(value, indent=2))
