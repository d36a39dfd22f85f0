"""The one error that a user sees."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path

_LONGEST_VALUE = 60


class UserError(Exception):
    """A mistake that the user can mend; its text is one line: file, line, what, mend.

    Args:
        what: What is wrong, with the place inside the file where there is one.
        mend: What to do about it; may be empty where ``what`` says it all.
        file: The file with the mistake.
        line: The line of the mistake, counted from 1.
    """

    def __init__(
        self, what: str, mend: str = "", *, file: Path | str | None = None, line: int | None = None
    ) -> None:
        super().__init__(what)
        self.what = what
        self.mend = mend
        self.file = file
        self.line = line

    def __str__(self) -> str:
        place = "" if self.file is None else shown_path(self.file)
        if place and self.line is not None:
            place += f":{self.line}"
        text = "; ".join(part for part in (self.what, self.mend) if part)
        return one_line(f"{place}: {text}" if place else text)

    def __reduce__(self) -> tuple[object, ...]:
        # Exceptions pickle by their positional arguments; worker processes must hand this one over whole.
        return _rebuilt, (self.what, self.mend, self.file, self.line)


def _rebuilt(what: str, mend: str, file: Path | str | None, line: int | None) -> UserError:
    return UserError(what, mend, file=file, line=line)


def is_interrupt(error: BaseException) -> bool:
    """Whether it is Ctrl-C: compiled code that is called just then passes it on as the cause of a SystemError."""
    return isinstance(error, KeyboardInterrupt) or (
        isinstance(error, SystemError) and isinstance(error.__cause__, KeyboardInterrupt)
    )


def did_you_mean(word: str, known: Iterable[str], *, kind: str = "names") -> str:
    """A mend for an unknown word: the nearest known one, or the list of them all."""
    words = list(known)
    folded = {candidate.casefold(): candidate for candidate in reversed(words)}
    near = difflib.get_close_matches(word.casefold(), folded, n=1, cutoff=0.6)
    if near:
        return f"did you mean '{folded[near[0]]}'?"
    return f"the known {kind} are {', '.join(words)}" if words else f"there are no known {kind}"


def shown_path(path: Path | str) -> str:
    """The path as a reader wants it: relative where it lies below the working directory."""
    try:
        return str(Path(path).relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


def shown_value(value: object) -> str:
    """A value of a file in words, short enough for one line."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        text = value if len(value) <= _LONGEST_VALUE else value[:_LONGEST_VALUE] + "..."
        return f"the text '{text}'"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    return str(value)


def one_line(text: str) -> str:
    """The text without line breaks and control characters."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
