"""A lock that is handed over in the order in which it was asked for.

An ordinary one goes to whoever is awake when it is let go: a thread that takes it again at once keeps it for seconds.
"""

from __future__ import annotations

import threading
from collections import deque


class Turns:
    """Like ``threading.Lock``, but fair."""

    def __init__(self) -> None:
        self._guard = threading.Lock()
        self._taken = False
        self._waiting: deque[threading.Lock] = deque()

    def acquire(self) -> None:
        """Wait for one's turn."""
        with self._guard:
            if not self._taken:
                self._taken = True
                return
            turn = threading.Lock()
            turn.acquire()
            self._waiting.append(turn)
        turn.acquire()  # let go by whoever hands over

    def release(self) -> None:
        """Hand over to who has waited longest, if anybody has."""
        with self._guard:
            if self._waiting:
                self._waiting.popleft().release()
            else:
                self._taken = False

    def __enter__(self) -> None:
        self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()
