"""Files that are written whole or not at all.

A file is written under a temporary name in its own folder, flushed to the disk and renamed; then the folder
is flushed. Whoever reads sees the old file, the new one, or none, also after ``kill -9`` or a power cut.
"""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

from testbed.errors import UserError, shown_path

_SUFFIX = ".tmp"
_DISK_IS_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def write_whole(path: Path, write: Callable[[IO[bytes]], None]) -> None:
    """Create or replace a file in one step.

    Args:
        path: The file; its folder is made where it is missing.
        write: Writes the contents to a binary file object.

    Raises:
        UserError: If the disk is full or the place cannot be written; no partial file is left behind.
    """
    with refused_writes_explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=_SUFFIX, dir=path.parent)
        temporary = Path(name)
        try:
            with os.fdopen(descriptor, "wb") as file:
                write(file)
                file.flush()
                os.fchmod(file.fileno(), 0o666 & ~_umask())
                os.fsync(file.fileno())
            temporary.replace(path)
        except BaseException:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise
        _flush_folder(path.parent)


def write_text(path: Path, text: str) -> None:
    """Create or replace a UTF-8 text file in one step; raises like :func:`write_whole`."""
    write_whole(path, lambda file: _write_all(file, text.encode()))


def sweep(folder: Path) -> int:
    """Remove the temporary files that a killed process left anywhere below ``folder``; returns how many."""
    stale = [path for path in folder.rglob(f".*{_SUFFIX}") if path.is_file()]
    for path in stale:
        with contextlib.suppress(OSError):
            path.unlink()
    return len(stale)


@contextlib.contextmanager
def refused_writes_explained(path: Path) -> Iterator[None]:
    """Turn the operating system's refusals to write ``path`` into a :class:`UserError`."""
    try:
        yield
    except OSError as error:
        raise write_refused(path, error) from error


def write_refused(path: Path, error: OSError) -> UserError:
    """What to tell the user about a refused write."""
    if error.errno in _DISK_IS_FULL:
        return UserError(
            f"the disk is full: {shown_path(path)} could not be written",
            "free some space and give the same command again; every finished trial is kept",
        )
    return UserError(
        f"{shown_path(path)} could not be written ({os.strerror(error.errno or 0).lower()})",
        "give a folder that you may write with --out DIR",
    )


def _write_all(file: IO[bytes], contents: bytes) -> None:
    file.write(contents)


def _umask() -> int:
    # The process's umask can be read only by setting it; a temporary file is made private (0600) regardless.
    mask = os.umask(0o022)
    os.umask(mask)
    return mask


def _flush_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
