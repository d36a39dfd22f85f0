"""The cache of compiled code never runs yesterday's source."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from testbed.vision import _jit

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
