"""What befalls a bench in the middle of a trial: named, saved, gone on with; never a pulse that was not commanded."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_builder import SEED, calibrated, short_life
from commanded_pulses import PATIENCE, check_pulses
from simavr_needed import simavr_or_skip

from testbed.experiment.diary import Diary, Told
from testbed.experiment.trial import live
from testbed.experiment.witness import Witness
from testbed.hardware.bench_file import RIG
from testbed.hardware.failures import HardwareFailure
from testbed.scenario import Scenario, drawn
from testbed.world.env import World
from testbed.world.placement import STUDENT

simavr_or_skip()  # type: ignore[no-untyped-call]

from testbed.hardware.emulation.bench import EmulatedBench  # noqa: E402
from testbed.hardware.emulation.cameras import CameraFaults, swap  # noqa: E402
from testbed.hardware.emulation.mounting import Mounting  # noqa: E402
from testbed.hardware.emulation.wire import WireFaults  # noqa: E402
from testbed.hardware.operating.stage import BenchStage, workbench_of  # noqa: E402

STEPS = 30
BREAKS = 0.35  # s after the first step


class Waver:
    """Waves and looks at the first teacher, for some steps; does the same again if it senses the same again."""

    looking = True

    def __init__(self, pause: Callable[[int], None] = lambda step: None) -> None:
        self._step, self._pause = 0, pause

    @property
    def done(self) -> bool:
        return self._step >= STEPS

    def act(self, observation: dict[str, Any]) -> np.ndarray:
        self._step += 1
        self._pause(self._step)
        joints = [-0.6 * math.sin(self._step / 6), -0.4 * math.sin(self._step / 4)]
        leaning = 1e-3 * float(observation["tilt"][1])
        return np.array([joints[0] + leaning, joints[1], math.radians(-30)], dtype=np.float32)


@dataclass
class Stand:
    """A bench, and trials on it."""

    bench: EmulatedBench
    ports: Path
    calibrations: Path
    here: Scenario
    mountings: dict[str, Mounting | None]

    def check_pulses(self, journal: Path, *, since: float) -> int:
        return check_pulses(self.bench, self.calibrations, journal, since=since)

    def mend(self) -> None:
        """What a person does who reads the failures' mends."""
        for name, board in self.bench.boards.items():
            if not board.wire.plugged:
                board.wire.replug()
            board.wire.faults = WireFaults()
            board.mounting = self.mountings[name]
            if board.mounting is not None:
                board.chip.set_imu("fine")
            board.chip.press_stop(False)
            board.chip.power_cycle()
        for eye, mount in zip(self.bench.cameras, self.bench.rig.mounts, strict=True):
            eye.faults, eye.mount = CameraFaults(), mount
        self.bench.advance(0.6)

    def lead(
        self,
        journal: Path,
        breaks: Callable[[EmulatedBench], None] | None = None,
        student: Waver | None = None,
    ) -> None:
        """A short trial with a simple student; something may break in its middle."""
        student = student or Waver()
        with contextlib.ExitStack() as stack:
            diary = stack.enter_context(Diary(journal))
            bench = workbench_of(self.bench, self.ports, self.calibrations)
            stage = stack.enter_context(
                contextlib.closing(BenchStage(self.here, bench, diary.journal, self.bench))
            )
            lived = diary.lived(self.here, stage)
            world = World(self.here, backend=lived)
            reset = stage.backend.reset

            def broken_reset(seeds: np.random.SeedSequence) -> None:
                reset(seeds)
                if breaks is not None:
                    self.bench.later(BREAKS, lambda: breaks(self.bench))

            stage.backend.reset = broken_reset  # type: ignore[method-assign]
            live(world, lived, student, 5, Witness(self.here, lived, lived))  # type: ignore[arg-type]
            diary.finish()


@pytest.fixture(scope="module")
def here() -> Scenario:
    return drawn(short_life(), 0)


@contextlib.contextmanager
def stand_at(folder: Path, here: Scenario) -> Iterator[Stand]:
    with EmulatedBench(here, seed=SEED, ports=folder / "ports") as bench:
        mountings = {name: board.mounting for name, board in bench.boards.items()}
        yield Stand(bench, folder / "ports", calibrated(bench, folder), here, mountings)


@pytest.fixture(scope="module")
def shared(here: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    with stand_at(tmp_path_factory.mktemp("stand"), here) as stand:
        yield stand


@pytest.fixture
def stand(shared: Stand) -> Iterator[Stand]:
    """One bench for all tests, mended after each."""
    yield shared
    shared.mend()


# Faults, and how they end.


def camera(**faults: Any) -> Callable[[EmulatedBench], None]:
    def breaks(bench: EmulatedBench) -> None:
        bench.cameras[0].faults = replace(CameraFaults(), **faults)

    return breaks


def both_stall(bench: EmulatedBench) -> None:
    for eye in bench.cameras:
        eye.faults = CameraFaults(stalled=True)


def chip(does: str, *arguments: Any, of: str = STUDENT) -> Callable[[EmulatedBench], None]:
    return lambda bench: getattr(bench.boards[of].chip, does)(*arguments)


def unplug(of: str) -> Callable[[EmulatedBench], None]:
    return lambda bench: bench.boards[of].wire.unplug()


def unplug_for_a_moment(bench: EmulatedBench) -> None:
    bench.boards[STUDENT].wire.unplug()
    bench.later(0.2, bench.boards[STUDENT].wire.replug)


def noisy_line(rate: float, of: str = STUDENT) -> Callable[[EmulatedBench], None]:
    """Of the bytes both ways so many are dropped, as many flipped, and as many doubled."""

    def breaks(bench: EmulatedBench) -> None:
        bench.boards[of].wire.faults = WireFaults(drop=rate, flip=rate, double=rate)

    return breaks


def go_wild(bench: EmulatedBench) -> None:
    board = bench.boards[STUDENT]
    assert board.mounting is not None
    board.mounting = replace(board.mounting, bias=np.array([1.9, -1.2, 1.5]))


FAULTS: dict[str, tuple[Callable[[EmulatedBench], None], str]] = {
    "brown-out": (chip("brown_out"), "BoardRestarted"),
    "brown-out of a teacher": (chip("brown_out", of="teacher_1"), "BoardRestarted"),
    "firmware hangs": (chip("hang"), "BoardRestarted"),
    "cable pulled": (unplug(STUDENT), "LinkLost"),
    "cable pulled and back": (unplug_for_a_moment, "LinkLost"),
    "cable of the rig": (unplug(RIG), "LinkLost"),
    "a line that loses a third of its bytes": (noisy_line(0.1), "LinkLost"),
    "stop button": (chip("press_stop"), "Stopped"),
    "tilt sensor unplugged": (chip("set_imu", "unplugged"), "ImuMissing"),
    "tilt sensor stuck": (chip("set_imu", "stuck"), "ImuStuck"),
    "tilt sensor wild": (go_wild, "TiltImplausible"),
    "a camera stalls": (camera(stalled=True), "CameraStalled"),
    "both cameras stall": (both_stall, "CameraStalled"),
    "a camera freezes": (camera(frozen=True), "CameraFrozen"),
    "a camera is covered": (camera(black=True), "CameraBlack"),
    "a camera is pulled": (camera(gone=True), "CameraMissing"),
    "cameras swapped": (lambda bench: swap(*bench.cameras), "CamerasSwapped"),
    "exposure steps": (camera(gain=2.2), "ExposureChanged"),
    "a camera is late": (camera(late=0.8), "CamerasApart"),
    "a camera is knocked": (camera(turned=(0.02, 0.0, 0.0)), "RigMoved"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_and_nobody_moves_any_more(stand: Stand, fault: str, tmp_path: Path) -> None:
    broken_off(stand, fault, tmp_path / "0.journal")
    unreachable = any(not board.wire.plugged for board in stand.bench.boards.values())
    # Whoever cannot be told lets go by itself.
    stand.bench.advance(PATIENCE + 0.1 if unreachable else 0.1)
    assert all(board.limp for board in stand.bench.boards.values())
    quiet = {name: len(board.pulses) for name, board in stand.bench.boards.items()}
    stand.bench.advance(0.2)
    assert quiet == {name: len(board.pulses) for name, board in stand.bench.boards.items()}


@pytest.mark.parametrize("fault", ["brown-out", "cable pulled", "stop button", "both cameras stall"])
def test_what_broke_off_goes_on_when_it_is_mended(stand: Stand, fault: str, tmp_path: Path) -> None:
    journal, begun = tmp_path / "0.journal", stand.bench.now()
    told = broken_off(stand, fault, journal)
    stand.mend()
    stand.lead(journal)
    again = Told(journal)
    assert [note.kind for note in again.notes] == ["unfinished", "failed", "resumed", "finished"]
    assert [step.number for step in again.steps] == list(range(STEPS + 1))
    # What was watched when it broke off is watched from the beginning again; all before stays as it was lived.
    kept = int(again.notes[2].text.split()[-1])
    assert 0 < kept < len(told.steps)
    for before, after in zip(told.steps[: kept + 1], again.steps, strict=False):
        assert before.tilts[STUDENT].tobytes() == after.tilts[STUDENT].tobytes()
    assert stand.check_pulses(journal, since=begun) > 100


def broken_off(stand: Stand, fault: str, journal: Path) -> Told:
    """What the journal holds of a trial in whose middle something broke."""
    breaks, outcome = FAULTS[fault]
    begun = stand.bench.now()
    with pytest.raises(HardwareFailure) as failure:
        stand.lead(journal, breaks)
    assert failure.value.outcome == outcome
    assert failure.value.mend
    told = Told(journal)
    assert [note.kind for note in told.notes] == ["unfinished", "failed"]
    assert told.notes[1].text.startswith(f"{outcome}: ")
    assert 5 < len(told.steps) < STEPS
    assert stand.check_pulses(journal, since=begun) > 30
    return told


def test_the_same_trial_with_the_same_fault_has_the_same_bytes(here: Scenario, tmp_path: Path) -> None:
    """Every frame, step and moment of two benches in virtual time."""
    journals = []
    for name in ("one", "other"):
        with stand_at(tmp_path / name, here) as stand, contextlib.suppress(HardwareFailure):
            stand.lead(tmp_path / name / "0.journal", noisy_line(0.003))
        journals.append((tmp_path / name / "0.journal").read_bytes())
    assert journals[0] == journals[1]
    assert len(journals[0]) > 20_000


@pytest.mark.parametrize("rate", [0.001, 0.003])
def test_noise_on_a_line_is_borne_and_moves_nobody(stand: Stand, rate: float, tmp_path: Path) -> None:
    begun = stand.bench.now()
    stand.lead(tmp_path / "0.journal", noisy_line(rate))
    assert Told(tmp_path / "0.journal").finished
    assert stand.check_pulses(tmp_path / "0.journal", since=begun) > 100


@pytest.mark.parametrize("faults", [{"dropping": 0.3}, {"gain": 1.12}, {"late": 0.01}], ids=str)
def test_what_can_be_borne_is_borne(stand: Stand, faults: dict[str, float], tmp_path: Path) -> None:
    stand.lead(tmp_path / "0.journal", camera(**faults))
    assert Told(tmp_path / "0.journal").finished


def test_who_is_forgotten_for_too_long_goes_limp(stand: Stand, tmp_path: Path) -> None:
    """A student that stops the world while it thinks: the watchdog lets go, and nobody is armed behind its back."""

    def pause(step: int) -> None:
        if step == 20:
            stand.bench.advance(2.5)

    with pytest.raises(HardwareFailure) as failure:
        stand.lead(tmp_path / "0.journal", student=Waver(pause))
    assert failure.value.outcome == "WentLimp"
