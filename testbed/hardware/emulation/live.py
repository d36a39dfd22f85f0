"""The emulated bench in real time: serial ports and camera streams that any program of this machine can use.

What hardware mode does with a real bench it does with this one: it opens ports and streams, and knows no better. The
bench is a process of its own; if the machine is too slow its time goes slower than ours, and it says so.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Self

from testbed.errors import UserError, shown_path
from testbed.experiment.atomic import refused_writes_explained
from testbed.hardware.bench_file import RIG, BenchSpec, BoardSpec, CamerasSpec, save_bench
from testbed.hardware.bench_time import Shown
from testbed.hardware.calibration.charuco import CharucoSpec
from testbed.hardware.emulation.bench import EmulatedBench
from testbed.hardware.emulation.hands import Hands
from testbed.hardware.emulation.poses import held
from testbed.hardware.emulation.scenes import BoardScene
from testbed.hardware.emulation.streams import Streams
from testbed.hardware.emulation.turns import Turns
from testbed.hardware.operating.hands import HandsServer
from testbed.hardware.prompt import Prompt, Question, nothing
from testbed.scenario import Scenario, check, drawn, load_scenario

SIDES = ("left", "right")
FRAME_RATE = 20.0
"""Pairs a second at best; the student looks 15 times a second."""
_PAUSE = 0.1  # s between two frames of cameras that are slow already
_YIELD = 2e-4  # s in which other threads get on
_SLICE = 0.001  # s: within this time a board hears what was said to it
_MOST_BEHIND = 0.1  # s; what is more is given up, or the bench would race to catch up
_WORST = 0.9  # of real time: slower than this it is told


class SharedBench(EmulatedBench):
    """An emulated bench in whose time several threads live; who touches it holds its ``lock``.

    Whoever sleeps in it, with the lock in hand, only waits until the others have let so much time pass.
    """

    def __init__(self, scenario: Scenario, *, seed: int = 0, ports: Path | None = None) -> None:
        self.lock = Turns()
        super().__init__(scenario, seed=seed, ports=ports)

    def sleep(self, seconds: float) -> None:
        """See :class:`EmulatedBench`."""
        until, deadline = self.now() + seconds, time.monotonic() + 20 * seconds + 5
        while self.now() < until and time.monotonic() < deadline:
            self.lock.release()
            time.sleep(_SLICE)
            self.lock.acquire()


class LiveBench:
    """An emulated bench whose time is ours. As a context manager it is taken down at the end.

    Args:
        bench: The bench; it is no longer to be used by anybody else, and closed in the end.
        folder: Where its ports (``tty-*``), its bench file and its socket are.
        hands: Do what a person at the bench is asked to.
        port: Of the camera streams; any free one if 0.

    Attributes:
        spec: The bench file, as written to ``folder``.
    """

    def __init__(self, bench: SharedBench, folder: Path, hands: Prompt, *, port: int = 0) -> None:
        self._bench, self._lock = bench, bench.lock
        self._over = threading.Event()
        self._slipped = 0.0
        self._began = time.monotonic()
        self._hands = hands
        self._warm_up()
        self._streams = Streams(SIDES, port)
        self._clock = Shown(folder / "clock")
        self._server = HandsServer(folder / "hands", self._do)
        self._camera_man = threading.Thread(target=self._film, name="cameras", daemon=True)
        self.spec = save_bench(
            spec_of(
                bench,
                folder,
                CamerasSpec(
                    left=self._streams.address("left"),
                    right=self._streams.address("right"),
                    measured_baseline=measured_baseline(bench),
                ),
                hands=str(folder.absolute() / "hands"),
                clock=str(folder.absolute() / "clock"),
            ),
            folder / "bench.yaml",
        )

    def run(self, tell: Callable[[str], None] = lambda text: None) -> None:
        """Let time pass as it does, until :meth:`stop`; tells when it cannot keep up."""
        self._camera_man.start()
        begun, told = time.monotonic(), time.monotonic()
        anchor = begun - self._bench.now()
        while not self._over.is_set():
            behind = time.monotonic() - anchor - self._bench.now()
            if behind > _MOST_BEHIND:
                self._slipped += behind - _MOST_BEHIND
                anchor += behind - _MOST_BEHIND
            with self._lock:
                self._bench.advance(min(max(behind, 0.0), _SLICE))
                self._clock.tell(self._bench.now())
            time.sleep(_SLICE / 2 if behind < _SLICE / 2 else _YIELD)
            now = time.monotonic()
            if now - told > 10:
                share = 1 - self._slipped / (now - told)
                if share < _WORST:
                    tell(f"this machine is busy: the bench's time goes at {share:.0%} of ours")
                told, self._slipped = now, 0.0

    def port_of(self, agent: str) -> str:
        """The serial port of an agent's board."""
        return self._bench.boards[agent].wire.path

    def stop(self) -> None:
        """End :meth:`run`; may be called from anywhere."""
        self._over.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Take everything down; harmless when repeated."""
        self.stop()
        self._server.close()
        self._streams.close()
        if self._camera_man.is_alive():
            self._camera_man.join(5.0)
        with self._lock:
            self._bench.close()

    def _do(self, question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        with self._lock:
            return self._hands(question, meanwhile)

    def _warm_up(self) -> None:
        """Draw everything once: what is compiled or loaded at first use would stop the cameras for seconds."""
        rig, board = self._bench.rig, CharucoSpec()
        BoardScene(board, held(board, u=0, v=0, distance=0.5)).snapshot()(rig.lenses[0], rig.mounts[0])
        with self._lock:
            self._bench.advance(0.1)
            for camera in self._bench.cameras:
                if (frame := camera.newest()) is not None:
                    _ = frame.image

    def _film(self) -> None:
        """The thread: a pair of images again and again."""
        due = 0.0
        while not self._over.wait(max(0.0, due - time.monotonic())):
            began = time.monotonic()
            with self._lock:
                frames = [camera.newest() for camera in self._bench.cameras]
            # Images are computed from what the shutter saw, while the bench goes on.
            self._streams.show(
                {side: frame.image for side, frame in zip(SIDES, frames, strict=True) if frame is not None}
            )
            took = time.monotonic() - began
            # Of a slow machine the cameras take about half; the boards must be heard.
            due = began + max(1 / FRAME_RATE, took + min(took, _PAUSE))


@contextlib.contextmanager
def started(scenario: str, folder: Path, *, seed: int = 0, port: int = 0) -> Iterator[LiveBench]:
    """A live bench for a scenario's first trial, in a folder of its own.

    Args:
        scenario: A file, or the name of a shipped one.
        folder: Made where it is missing; calibrations that are there from last time stay.
        seed: Of what came out of the shop.
        port: Of the camera streams; any free one if 0.

    Raises:
        UserError: If the scenario cannot be on a bench, the folder cannot be written or is in use, the TCP port is
            taken, or simavr is missing.
    """
    here = load_scenario(scenario)
    check(here)
    with refused_writes_explained(folder):
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / ".lock").open("w")
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            what = f"another emulated bench is in {shown_path(folder)}"
            raise UserError(what, "end it, or give another --folder") from None
        bench = SharedBench(drawn(here, 0), seed=seed, ports=folder.absolute())
        try:
            live = LiveBench(bench, folder, Hands(bench), port=port)
        except OSError as error:
            bench.close()
            what = f"TCP port {port} cannot be had ({os.strerror(error.errno or 0).lower()})"
            raise UserError(what, "give another one with --http, or 0 for any") from None
        with live:
            yield live


def spec_of(
    bench: EmulatedBench,
    folder: Path,
    cameras: CamerasSpec | None = None,
    *,
    hands: str | None = None,
    clock: str | None = None,
) -> BenchSpec:
    """The bench file of an emulated bench whose ports are in a folder; its own cameras if none are given."""
    boards = {
        name: BoardSpec(
            unique_id=board.unique_id, robot="crawler" if name == RIG else bench.bodies[name].name
        )
        for name, board in bench.boards.items()
    }
    return BenchSpec(
        name="emulated",
        boards=boards,
        cameras=cameras or _own_cameras(bench),
        port_globs=(str(folder.absolute() / "tty-*"),),
        hands=hands,
        clock=clock,
    )


def _own_cameras(bench: EmulatedBench) -> CamerasSpec:
    left, right = bench.cameras
    return CamerasSpec(left=left.id, right=right.id, measured_baseline=measured_baseline(bench))


def measured_baseline(bench: EmulatedBench) -> float:
    """What a tape measure says about the distance of the lenses, m: right to half a millimetre."""
    return round(2000 * bench.rig.baseline) / 2000
