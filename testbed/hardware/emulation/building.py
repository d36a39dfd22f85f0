"""The firmware and its emulator, built from their sources when they are not there or older than these."""

from __future__ import annotations

import fcntl
import functools
import shutil
import subprocess
from pathlib import Path

from testbed.errors import UserError

_PACKAGES = "simavr libsimavr-dev gcc-avr avr-libc binutils-avr make gcc"
INSTALL = f"apt-get install {_PACKAGES}"
"""What brings everything that the emulated bench needs, on Debian and Ubuntu."""

_SIMAVR_HEADER = Path("/usr/include/simavr/sim_avr.h")
_LONGEST_BUILD = 120.0  # seconds; it takes one or two


def sources() -> Path:
    """The folder ``hardware/`` of the checkout.

    Raises:
        UserError: If this is an installed wheel, which does not bring it along.
    """
    folder = Path(__file__).resolve().parents[3] / "hardware"
    if not (folder / "firmware" / "Makefile").is_file():
        raise UserError(
            "the firmware's sources are not here: hardware/ is not part of the installed package",
            "run from a checkout of the project, or from its source archive",
        )
    return folder


def missing_tools() -> list[str]:
    """Which of the tools that build the firmware and its emulator are not on this machine."""
    missing = [
        tool for tool in ("avr-gcc", "avr-objcopy", "avr-size", "make", "cc") if shutil.which(tool) is None
    ]
    return missing if _SIMAVR_HEADER.is_file() else [*missing, "libsimavr"]


@functools.cache
def firmware_file() -> Path:
    """The shipped firmware as Intel hex, built if need be.

    Raises:
        UserError: If it cannot be built; the mend names Debian's packages.
    """
    return _built(sources() / "firmware", "firmware.hex")


@functools.cache
def emulator_library() -> Path:
    """The shared library of the emulated board, built if need be.

    Raises:
        UserError: If it cannot be built; the mend names Debian's packages.
    """
    return _built(sources() / "emulator", "libboard.so")


def _built(folder: Path, product: str) -> Path:
    if missing := missing_tools():
        raise UserError(f"the emulated board needs {', '.join(missing)}", INSTALL)
    build = folder / "build"
    try:
        build.mkdir(exist_ok=True)
        lock = (build / ".lock").open("w")
    except OSError as error:
        raise UserError(
            f"{build} cannot be written ({error.strerror})", "use a checkout of your own"
        ) from error
    with lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # tests of several processes build at the same time
        made = subprocess.run(
            ["make", "-s", "-C", str(folder), f"build/{product}"],
            capture_output=True,
            text=True,
            timeout=_LONGEST_BUILD,
            check=False,
        )
    if made.returncode:
        raise UserError(
            f"make -C {folder} failed: {_first_error(made.stderr)}", f"if a tool is missing: {INSTALL}"
        )
    return build / product


def _first_error(output: str) -> str:
    lines = [line for line in output.splitlines() if "rror" in line] or output.splitlines()
    return lines[0] if lines else "no message"
