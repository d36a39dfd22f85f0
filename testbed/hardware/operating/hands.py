"""Hands in another process: questions to an emulated bench go over a socket, and it does what a person would do.

One line of JSON each way: ``{"kind", "about", "text", "details"}`` and ``{"answer"}`` or ``{"error", "mend"}``.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from testbed.errors import UserError, shown_path
from testbed.hardware.prompt import Prompt, Question, nothing

_PATIENCE = 0.05  # s between two calls of ``meanwhile``
_LONGEST = 1 << 16


class DistantHands:
    """The :class:`~testbed.hardware.prompt.Prompt` of an emulated bench that runs as a process of its own.

    Args:
        path: Its socket, as its bench file names it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def __call__(self, question: Question, meanwhile: Callable[[], None] = nothing) -> str:
        """See :class:`Prompt`.

        Raises:
            UserError: If the emulated bench is gone, or does not know how to do it.
        """
        asked = {**vars(question), "details": dict(question.details)}
        with contextlib.closing(socket.socket(socket.AF_UNIX)) as line:
            try:
                line.connect(str(self._path))
                line.sendall(json.dumps(asked).encode() + b"\n")
                said = self._heard(line, meanwhile)
            except OSError as error:
                raise UserError(
                    f"the emulated bench is not there ({os.strerror(error.errno or 0).lower()})",
                    "start it: testbed hardware emulate",
                ) from None
        if "answer" not in said:
            raise UserError(
                str(said.get("error", "the emulated bench said nothing")), str(said.get("mend", ""))
            )
        return str(said["answer"])

    def _heard(self, line: socket.socket, meanwhile: Callable[[], None]) -> dict[str, Any]:
        heard = b""
        while not heard.endswith(b"\n"):
            if not select.select([line], [], [], _PATIENCE)[0]:
                meanwhile()
                continue
            more = line.recv(_LONGEST)
            if not more:
                break
            heard += more
        said = json.loads(heard or b"{}")
        return said if isinstance(said, dict) else {}


class HandsServer:
    """Lets other processes ask a bench's hands. Close it in the end.

    Args:
        path: Where the socket is to be.
        hands: What does as it is asked; one question at a time.

    Raises:
        UserError: If the socket cannot be made.
    """

    def __init__(self, path: Path, hands: Prompt) -> None:
        self._hands, self._path = hands, path
        self._socket = socket.socket(socket.AF_UNIX)
        path.unlink(missing_ok=True)
        try:
            self._socket.bind(str(path))
        except OSError as error:  # a path of more than about 100 letters is no address
            self._socket.close()
            raise UserError(
                f"{shown_path(path)} cannot be a socket ({error})", "use a folder with a shorter name"
            ) from None
        self._socket.listen()
        self._thread = threading.Thread(target=self._serve, name="hands", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening; harmless when repeated."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def _serve(self) -> None:
        while True:
            try:
                line, _ = self._socket.accept()
            except OSError:
                return
            with line, contextlib.suppress(OSError, ValueError):
                line.settimeout(5.0)
                asked = line.makefile("rb").readline(_LONGEST)
                line.sendall(json.dumps(self._answer(json.loads(asked))).encode() + b"\n")

    def _answer(self, asked: dict[str, Any]) -> dict[str, str]:
        try:
            return {"answer": self._hands(Question(**asked))}
        except UserError as error:
            return {"error": error.what, "mend": error.mend}
        except Exception as error:  # told to whoever asked, who would otherwise wait for ever
            return {"error": f"the hands failed ({type(error).__name__}: {error})"}
