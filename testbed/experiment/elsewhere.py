"""Minds beside the leader think in processes of their own, where cores would be idle.

Such a thought is all that it needs: no world, no other mind, its chance settled beforehand. So it comes to the same
wherever it is thought, and whatever becomes of its process (killed, out of memory, a mind that raises), it is thought
once more in this one, where it succeeds or fails as it would have done alone.
"""

from __future__ import annotations

import functools
import os
import pickle
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from multiprocessing import connection
from multiprocessing.connection import Connection, Pipe
from types import TracebackType
from typing import TYPE_CHECKING, Self

from testbed.experiment.process_executor import Reporter

if TYPE_CHECKING:  # a process loads of the student what its thought needs
    from testbed.student.mind import Judgement, Thought
    from testbed.student.minds import Outcome
    from testbed.student.senses import Progress


class Elsewhere:
    """An :data:`~testbed.student.minds.Elsewhere` for one trial; a context manager that leaves no process behind.

    Args:
        processes: How many think at a time, at least 1; who waits for them needs no core.
    """

    def __init__(self, processes: int) -> None:
        self._processes = processes
        self._thinkings: list[_Thinking] = []

    def __call__(self, thought: Thought, progress: Progress) -> Outcome:
        """Begin a thought as soon as there is a process for it."""
        thinking = _Thinking(thought, progress)
        self._thinkings.append(thinking)
        self._attend()
        return functools.partial(self._outcome, thinking)

    def heeding(self, progress: Progress) -> Progress:
        """The same progress, which now also tells how far the thoughts in other processes are."""

        def told(phase: str, done: int, total: int) -> None:
            self._attend()
            progress(phase, done, total)

        return told

    def _attend(self) -> None:
        """Hear what processes have to say, and give the next thoughts to those that are free."""
        for thinking in self._thinkings:
            thinking.listen()
        free = self._processes - sum(thinking.running for thinking in self._thinkings)
        for thinking in [thinking for thinking in self._thinkings if thinking.fresh][:free]:
            thinking.begin()

    def _outcome(self, wanted: _Thinking) -> Judgement:
        self._attend()
        while wanted.fresh or wanted.running:
            connection.wait([thinking.pipe for thinking in self._thinkings if thinking.pipe is not None])
            self._attend()
        if wanted.judgement is None:
            wanted.think_here()
        assert wanted.judgement is not None
        return wanted.judgement

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for thinking in self._thinkings:
            thinking.end()


class _Thinking:
    """A thought, and the process that thinks it if there is one.

    Attributes:
        judgement: What came of it; None as long as it is not known.
        fresh: Whether no process has begun it.
        pipe: To the process that has it, as long as its end has not been heard of.
    """

    def __init__(self, thought: Thought, progress: Progress) -> None:
        self._thought, self._progress = thought, progress
        self.judgement: Judgement | None = None
        self.fresh = True
        self.pipe: Connection | None = None
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def running(self) -> bool:
        """Whether a process has it."""
        return self.pipe is not None

    def begin(self) -> None:
        """Give it to a process; returns before that one has read it."""
        self.fresh = False
        self.pipe, theirs = Pipe()
        # Not by multiprocessing: a child of it would run the caller's script again if that has no __main__ guard.
        with theirs, os.fdopen(os.memfd_create("thought"), "w+b") as file:
            pickle.dump(self._thought, file)
            file.seek(0)
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(theirs.fileno())],
                stdin=file,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )

    def listen(self) -> None:
        """Pass on what its process has said since."""
        latest: dict[str, tuple[int, int]] = {}
        while self.pipe is not None and self.pipe.poll():
            try:
                what, *told = self.pipe.recv()
            except (EOFError, OSError):
                self.end()
                break
            if what == "progressed":
                phase, done, total = told
                latest[phase] = done, total
            else:
                (self.judgement,) = told
                self.end()
        for phase, far in latest.items():
            self._progress(phase, *far)

    def think_here(self) -> None:
        """Think it in this process."""
        self.judgement = self._thought(self._progress)

    def end(self) -> None:
        """No process thinks it any more; harmless when repeated."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        if self.pipe is not None:
            self.pipe.close()
        self._process = self.pipe = None


def _think_for_another_process(pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who stops us closes the pipe
    threading.Thread(target=_end_with_the_other, args=(pipe,), daemon=True).start()
    thought: Thought = pickle.load(sys.stdin.buffer)
    pipe.send(("finished", thought(Reporter(pipe))))


def _end_with_the_other(pipe: Connection) -> None:
    with suppress(EOFError, OSError):
        pipe.recv()
    os._exit(1)


if __name__ == "__main__":
    _think_for_another_process(Connection(int(sys.argv[1])))
