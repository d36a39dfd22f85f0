"""A thought for tests, which other processes load without loading a student."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from testbed.student.senses import Progress


@dataclass(frozen=True)
class Pondering:
    """Says which process had it, after it waited for a file; or it is killed in another one, or raises anywhere."""

    home: int
    until: Path | None = None
    fate: str = ""

    def __call__(self, progress: Progress) -> Any:
        progress("pondering", 1, 2)
        while self.until is not None and not self.until.exists():
            time.sleep(0.01)
        if self.fate == "killed" and os.getpid() != self.home:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.fate == "raises":
            raise ZeroDivisionError("a thought too far")
        progress("pondering", 2, 2)
        return os.getpid()
