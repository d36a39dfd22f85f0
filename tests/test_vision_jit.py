"""The cache of compiled code never runs yesterday's source, and nothing is compiled twice."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from numba.core import event

from testbed.vision import _jit
from testbed.vision._jit import compiled

CALLEE = """
from testbed.vision._jit import compiled

@compiled
def answer():
    return {}
"""
CALLER = """
from testbed.vision._jit import compiled
from testbed.vision.callee import answer

@compiled
def ask():
    return answer()

print(ask(), sum(ask.stats.cache_hits.values()))
"""


def test_a_change_in_a_called_file_is_noticed(tmp_path: Path) -> None:
    vision, student = tmp_path / "testbed" / "vision", tmp_path / "testbed" / "student"
    vision.mkdir(parents=True)
    student.mkdir()
    for package in (tmp_path / "testbed", vision, student):
        (package / "__init__.py").touch()
    shutil.copy(_jit.__file__, vision / "_jit.py")
    (student / "_caller.py").write_text(CALLER)

    def run(value: int) -> str:
        (vision / "callee.py").write_text(CALLEE.format(value))
        command = [sys.executable, "-B", "-m", "testbed.student._caller"]
        return subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout.strip()

    assert run(1) == "1 0"
    assert run(1) == "1 1"
    assert run(2) == "2 0"  # numba alone would load the caller's cached code, and answer 1


@compiled
def _inner(x: float, doubled: bool) -> float:
    return 2.0 * x if doubled else x


@compiled
def _outer(x: float) -> float:
    return _inner(x, True) + _inner(x, False)


def test_constants_are_not_compiled_for_apart_and_both_can_be_called_from_python() -> None:
    with event.install_recorder("numba:compile") as recorder:
        assert _outer(1.0) == 3.0
    names = [each.data["dispatcher"].py_func.__name__ for _, each in recorder.buffer if each.is_start]
    assert names.count("_inner") <= 1  # none at all if the cache knows the outer one
    assert not _inner.signatures  # type: ignore[attr-defined]
    assert _inner(3.0, True) == 6.0
