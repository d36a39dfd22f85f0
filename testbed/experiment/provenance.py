"""What computed a run: enough to repeat it, nothing about who or where."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any

from testbed.scenario import Scenario

_PACKAGES = (
    "whom-to-imitate",
    "numpy",
    "scipy",
    "pybullet",
    "numba",
    "opencv-python-headless",
    "pettingzoo",
    "gymnasium",
    "trimesh",
    "pydantic",
    "pyarrow",
)

_RENDERERS = {"tinyrenderer": "TinyRenderer", "analytic": "analytic"}


def describe(scenario: Scenario) -> dict[str, Any]:
    """Versions, source revision, machine, seed and physics, as plain data for ``provenance.json``."""
    return {
        "seed": scenario.seed,
        "split": scenario.split,
        "python": platform.python_version(),
        "packages": _versions(),
        "source": source_revision(),
        "machine": {
            "system": f"{platform.system()} {platform.machine()}",
            "processor": _processor(),
            "cores": os.cpu_count(),
        },
        "physics": {
            "engine": "Bullet",
            "renderer": _RENDERERS[scenario.rig.renderer],
            "physics_step": scenario.world.physics_step,
            "control_step": scenario.world.control_step,
            "gravity": scenario.world.gravity,
            "ground_friction": scenario.world.ground_friction,
        },
    }


def source_revision() -> dict[str, Any] | None:
    """Git commit of the package's checkout and whether files differ from it; None outside a checkout."""
    checkout = Path(__file__).resolve().parents[2]
    if not (checkout / ".git").exists():
        return None
    commit = _git(checkout, "rev-parse", "HEAD")
    if commit is None:
        return None
    changes = _git(checkout, "status", "--porcelain", "--untracked-files=no")
    return {"commit": commit, "modified": bool(changes)}


def _git(checkout: Path, *arguments: str) -> str | None:
    command = ("git", "-C", str(checkout), *arguments)
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def _versions() -> dict[str, str | None]:
    return {name: _version(name) for name in _PACKAGES}


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())
