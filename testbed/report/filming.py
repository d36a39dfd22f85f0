"""The video is painted in a process of its own while the figures are drawn: on two cores the page comes sooner."""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from testbed.bodies.morphology import Morphology
from testbed.report.film import Frame
from testbed.report.reading import Trial
from testbed.report.video import frame_count, panes, stride_of, write_video

Written = tuple[Path, Frame] | None

_LONG = 60  # frames; the process takes about a second to start, in which so many are painted


@contextlib.contextmanager
def filming(trial: Trial, bodies: Mapping[str, Morphology], path: Path) -> Iterator[Callable[[], Written]]:
    """Begin the video; what is yielded waits for it and returns what :func:`testbed.report.video.write_video` does."""
    shown = panes(trial)
    if len(os.sched_getaffinity(0)) < 2 or not shown or frame_count(shown, stride_of(trial)) < _LONG:
        yield lambda: write_video(trial, bodies, path)
        return
    # Not by multiprocessing: a child of it would run the caller's script again if that has no __main__ guard.
    process = subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )

    def finished() -> Written:
        told, _ = process.communicate()
        if process.returncode == 0:
            written: Written = pickle.loads(told)
            return written
        return write_video(trial, bodies, path)  # and what went wrong there goes wrong here, where it is told

    try:
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError), process.stdin as pipe:
            pickle.dump((trial, dict(bodies), path), pipe)
        process.stdin = None
        yield finished
    finally:
        process.kill()
        process.wait()


def _film_for_another_process() -> None:
    with os.fdopen(os.dup(1), "wb") as answer:
        os.dup2(2, 1)  # what libraries print is no answer
        answer.write(pickle.dumps(write_video(*pickle.load(sys.stdin.buffer))))


if __name__ == "__main__":
    _film_for_another_process()
