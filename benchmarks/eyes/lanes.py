"""The hand-vectorised kernel in C, compiled into a temporary folder when it is asked for."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.eyes import MissingError, Rays
from testbed.vision.kernel import PART_LUMINOSITY, WHITE

_LONGEST = 16
_FLOATS = np.ctypeslib.ndpointer(np.float32, flags="C")
LookAtAll = Callable[[NDArray[np.float64]], NDArray[np.uint8]]  # models (n, k, 8) -> (n, K)


def compiler() -> str:
    """The C compiler.

    Raises:
        MissingError: If there is none, or the processor has too short registers.
    """
    found = shutil.which("gcc") or shutil.which("cc")
    if found is None:
        raise MissingError("there is no C compiler")
    if not {"avx2", "fma", "bmi2"} <= flags():
        raise MissingError("the processor has no AVX2")
    return found


def flags() -> set[str]:
    """What the processor says it can do."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return set(next((line.split(":")[1].split() for line in lines if line.startswith("flags")), []))


def registers() -> str:
    """Which of the two the compiled kernel uses."""
    return "AVX-512" if {"avx512f", "avx512bw", "avx512vl"} <= flags() else "AVX2"


def open_eye(rays: Rays, eye: float, *, fused: bool) -> LookAtAll:
    """A function that looks at many models, one after the other, in C.

    Args:
        rays: (K, 2)
        eye: The camera's place (m).
        fused: Whether products and sums are fused: faster, and rounded otherwise than ours.

    Raises:
        MissingError: If it cannot be compiled here.
    """
    options = ["-O3", "-funroll-loops", "-march=native", "-ffp-contract=off", *(["-DFUSED"] if fused else [])]
    if registers() == "AVX2":
        options.append("-mno-avx512f")
    with tempfile.TemporaryDirectory() as folder:
        made, source = Path(folder) / "lanes.so", Path(__file__).with_name("lanes.c")
        command = [compiler(), *options, "-shared", "-fPIC", str(source), "-o", str(made), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise MissingError(f"the C compiler refuses it: {done.stderr.splitlines()[0]}")
        library = ctypes.CDLL(str(made))  # stays loaded when the file is gone
    whole, models_type = ctypes.c_int, np.ctypeslib.ndpointer(np.float64, flags="C")
    library.look.argtypes = [
        models_type,
        whole,
        whole,
        ctypes.c_double,
        _FLOATS,
        _FLOATS,
        whole,
        whole,
        whole,
    ]
    library.look.argtypes += [np.ctypeslib.ndpointer(np.uint8, flags="C")]
    dx, dy = np.pad(
        rays.T.astype(np.float32, order="C"), ((0, 0), (0, _LONGEST))
    )  # a last turn may read beyond the end
    out = np.empty((0, 0), np.uint8)

    def look(models: NDArray[np.float64]) -> NDArray[np.uint8]:
        nonlocal out
        if len(out) != len(models):
            out = np.empty((len(models), len(rays)), np.uint8)
        count, parts = models.shape[:2]
        library.look(models, count, parts, eye, dx, dy, len(rays), PART_LUMINOSITY, WHITE, out)
        return out

    return look
