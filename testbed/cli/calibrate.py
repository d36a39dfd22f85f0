"""The commands ``testbed hardware calibrate servos | tilt | stereo | all``."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from testbed.cli.results import progress_bar

if TYPE_CHECKING:
    from testbed.scenario.specs import RigSpec

DEFAULT = "bench.yaml"

app = typer.Typer(
    name="calibrate",
    help="Measure servos, tilt sensors and cameras once; what comes out is kept beside the bench file.",
    no_args_is_help=True,
)

BenchFile = Annotated[
    str,
    typer.Option(
        "--bench", metavar="FILE", help="The bench file; or `emulated`: the emulated bench in virtual time."
    ),
]
Agents = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[AGENT]...", help="student, teacher_0, ... or rig; all that can be if none is named."
    ),
]

ForScenario = Annotated[
    str | None,
    typer.Option(
        "--scenario", metavar="FILE", help="What is to be run: how wide it sees; 50 degrees if not given."
    ),
]


@app.command(epilog="Example: testbed hardware calibrate servos student")
def servos(
    agents: Agents = None,
    bench: BenchFile = DEFAULT,
    nudging: Annotated[
        bool, typer.Option("--nudging", help="Bring limbs to marks instead of reading angles off.")
    ] = False,
) -> None:
    """Find each servo's centre, sign and pulse range. It moves the servos: keep fingers away."""
    from testbed.hardware.operating.calibrating_robots import calibrate_robots_servos
    from testbed.hardware.operating.workbench import workbench

    with limp_when_told_to_end(), workbench(bench) as place:
        for agent, text in calibrate_robots_servos(place, agents or (), nudging=nudging):
            typer.echo(f"{agent}: {text}")


@app.command(epilog="Example: testbed hardware calibrate tilt student")
def tilt(agents: Agents = None, bench: BenchFile = DEFAULT) -> None:
    """Find how each tilt sensor sits, by turning the robot to a few orientations. Nothing moves by itself."""
    from testbed.hardware.operating.calibrating_robots import calibrate_robots_tilt
    from testbed.hardware.operating.workbench import workbench

    with limp_when_told_to_end(), workbench(bench) as place:
        for agent, text in calibrate_robots_tilt(place, agents or ()):
            typer.echo(f"{agent}: {text}")


@app.command(epilog="Example: testbed hardware calibrate stereo --pairs 25")
def stereo(
    bench: BenchFile = DEFAULT,
    pairs: Annotated[int, typer.Option(min=15, max=100, help="How many views of the board to take.")] = 25,
    keep: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Keep the images there, with the corners drawn in.")
    ] = None,
    scenario: ForScenario = None,
) -> None:
    """Find lenses and geometry of the cameras with the printed board, and the backdrop; the rig turns at the end."""
    from testbed.hardware.operating.calibrating_cameras import calibrate_cameras
    from testbed.hardware.operating.workbench import workbench

    with (
        limp_when_told_to_end(),
        workbench(bench) as place,
        progress_bar("views of the board", shown_from=1) as progress,
    ):
        text = calibrate_cameras(place, pairs, wanted=_rig_of(scenario), keep=keep, progress=progress)
    typer.echo(f"cameras: {text}")


@app.command("all", epilog="Example: testbed hardware calibrate all --bench emulated")
def everything(bench: BenchFile = DEFAULT, scenario: ForScenario = None) -> None:
    """Servos, tilt sensors and cameras, one after the other."""
    with limp_when_told_to_end():
        for line in calibrated(bench, scenario):
            typer.echo(line)


def calibrated(bench: str, scenario: str | None = None) -> Iterator[str]:
    """Calibrate everything, for a scenario; yields what came of it."""
    from testbed.hardware.operating.calibrating_cameras import calibrate_cameras
    from testbed.hardware.operating.calibrating_robots import calibrate_robots_servos, calibrate_robots_tilt
    from testbed.hardware.operating.workbench import workbench

    with workbench(bench) as place, progress_bar("views of the board", shown_from=1) as progress:
        yield from (f"{agent}: {text}" for agent, text in calibrate_robots_servos(place))
        yield from (f"{agent}: {text}" for agent, text in calibrate_robots_tilt(place))
        yield f"cameras: {calibrate_cameras(place, wanted=_rig_of(scenario), progress=progress)}"


def _rig_of(scenario: str | None) -> RigSpec | None:
    from testbed.scenario import load_scenario

    return None if scenario is None else load_scenario(scenario).rig


@contextlib.contextmanager
def limp_when_told_to_end() -> Iterator[None]:
    """Let a plain ``kill`` end a command the way Ctrl-C does, so that robots are let go."""

    def end(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
