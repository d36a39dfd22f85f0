"""A bench as the stage of a trial: everything that its bench file names, opened, checked and ready to be reset."""

from __future__ import annotations

import contextlib
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from testbed.experiment.stage import Opener, Truth
from testbed.hardware.backend import HardwareBackend
from testbed.hardware.bench_file import PAN, RIG
from testbed.hardware.calibration.rig import load_calibration
from testbed.hardware.clock import WallClock
from testbed.hardware.journal import Journal
from testbed.hardware.line.link import deaf
from testbed.hardware.operating.workbench import Workbench, robot_of
from testbed.hardware.rig.backdrop import load_backdrop
from testbed.hardware.rig.rectification import student_rig
from testbed.hardware.rig.stereo_rig import StereoRig
from testbed.scenario import Scenario
from testbed.world.bullet import bodies_of

if TYPE_CHECKING:
    from testbed.hardware.emulation.bench import EmulatedBench

T = TypeVar("T")
_KEEPING = 0.1
"""s between two reminders while the student thinks: a board takes 0.3 of silence for a broken cable."""


class BenchStage:
    """A :class:`~testbed.experiment.stage.Stage` on a bench.

    Args:
        scenario: The trial's own scenario.
        bench: What there is.
        journal: Where all that goes over its wires is written.
        truth: Who knows how everybody really is; nobody on a real bench.

    Raises:
        UserError: If the scenario is not for this bench, or something is missing.
    """

    def __init__(
        self, scenario: Scenario, bench: Workbench, journal: Journal | None = None, truth: Truth | None = None
    ) -> None:
        self.truth, self._clock = truth, bench.clock
        listener = deaf if journal is None else journal.wire
        robots = {
            name: robot_of(bench.spec, name, tuple(body.joints), bench.clock, listener)
            for name, body in bodies_of(scenario).items()
        }
        rig = robot_of(bench.spec, RIG, (PAN,), bench.clock, listener)
        folder = bench.spec.calibration_folder
        calibration, backdrop = load_calibration(folder), load_backdrop(folder)
        with contextlib.ExitStack() as stack:
            cameras = bench.cameras()
            for camera in cameras:
                stack.callback(camera.close)
                camera.lock()
            eyes = StereoRig(*cameras, calibration, backdrop, bench.clock, eyes=student_rig(scenario.rig))
            self.backend = HardwareBackend(scenario, robots, rig, eyes, bench.clock, bench.prompt)
            stack.pop_all()

    @property
    def now(self) -> Callable[[], float]:
        """See :class:`~testbed.experiment.stage.Stage`."""
        return self._clock.now

    def think(self, thought: Callable[[], T]) -> T:
        """See :class:`~testbed.experiment.stage.Stage`.

        On a real bench time goes on: the thought is thought in a thread, and everybody is kept where they are.
        """
        if not isinstance(self._clock, WallClock):
            return thought()
        thinker = _Thinker(thought)
        thinker.start()
        thinker.join(_KEEPING)
        while thinker.is_alive():
            self.backend.keep()
            thinker.join(_KEEPING)
        return thinker.outcome()

    def close(self) -> None:
        """See :class:`~testbed.experiment.stage.Stage`: everybody is limp."""
        self.backend.close()


class _Thinker(threading.Thread, Generic[T]):
    """Thinks one thought; dies with the program."""

    def __init__(self, thought: Callable[[], T]) -> None:
        super().__init__(name="student", daemon=True)
        self._thought = thought
        self._outcome: list[T] = []
        self._error: BaseException | None = None

    def run(self) -> None:
        try:
            self._outcome.append(self._thought())
        except BaseException as error:  # told to whoever waits for the outcome
            self._error = error

    def outcome(self) -> T:
        if self._error is not None:
            raise self._error
        return self._outcome[0]


def on_bench(bench: Workbench, truth: Truth | None = None) -> Opener:
    """Trials on a bench that is there and stays there."""

    def opened(scenario: Scenario, journal: Journal | None) -> BenchStage:
        return BenchStage(scenario, bench, journal, truth)

    return opened


def on_emulated_bench(calibrations: Path, *, seed: int = 0) -> Opener:
    """Trials on an emulated bench in virtual time, each on a bench of its own.

    Args:
        calibrations: The folder of this bench's calibrations.
        seed: Of what came out of the shop; a bench of the same seed has the same boards and cameras.
    """

    def opened(scenario: Scenario, journal: Journal | None) -> BenchStage:
        return _EmulatedStage(scenario, calibrations, seed, journal)

    return opened


class _EmulatedStage(BenchStage):
    def __init__(self, scenario: Scenario, calibrations: Path, seed: int, journal: Journal | None) -> None:
        from testbed.hardware.emulation.bench import EmulatedBench

        self._stack = contextlib.ExitStack()
        with contextlib.ExitStack() as stack:
            ports = stack.enter_context(tempfile.TemporaryDirectory(prefix="bench-"))
            bench = stack.enter_context(EmulatedBench(scenario, seed=seed, ports=Path(ports)))
            super().__init__(scenario, workbench_of(bench, Path(ports), calibrations), journal, bench)
            self._stack = stack.pop_all()

    def close(self) -> None:
        super().close()
        self._stack.close()


def workbench_of(bench: EmulatedBench, ports: Path, calibrations: Path) -> Workbench:
    """An emulated bench as commands and stages take it."""
    from testbed.hardware.emulation.hands import Hands
    from testbed.hardware.emulation.live import spec_of

    spec = spec_of(bench, ports).model_copy(update={"calibrations": str(calibrations.absolute())})
    return Workbench(spec, bench, Hands(bench), lambda: bench.cameras)
