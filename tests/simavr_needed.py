"""Tests of the emulated board: left out where its tools are missing, failures where they must not be."""

import os
import sys
from pathlib import Path

import pytest

from testbed.hardware.emulation.building import INSTALL, missing_tools

REQUIRED = "TESTBED_NEEDS_SIMAVR"


def simavr_or_skip():
    """To be called at the top of a module (or in a test) that runs the firmware or its emulator."""
    missing = missing_tools()
    if not missing:
        return
    # Who asks is named: pytest lists tests that were left out at one place for one reason as one.
    who = Path(sys._getframe(1).f_code.co_filename).name
    sentence = f"{who} needs {', '.join(missing)}; {INSTALL}"
    if os.environ.get(REQUIRED, "") not in ("", "0"):
        pytest.fail(f"{REQUIRED} is set, but {sentence}", pytrace=False)
    pytest.skip(sentence, allow_module_level=True)
