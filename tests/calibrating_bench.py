"""A board that is to be calibrated: its processor, the host's side of it, and their time."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

from one_board import UNIQUE, Table, address
from simavr_needed import simavr_or_skip

from testbed.hardware.emulation.microcontroller import Microcontroller
from testbed.hardware.emulation.wire import Wire
from testbed.hardware.robots.board import Board

Chip: TypeAlias = tuple[Microcontroller, Board, Table]


@contextlib.contextmanager
def calibrating_bench(tmp_path: Path) -> Iterator[Chip]:
    simavr_or_skip()
    chip = Microcontroller(name="hob", unique_id=UNIQUE, seed=2)
    wire = Wire(tmp_path / "port")
    table = Table((chip, wire))
    board = Board(address(wire), 2, table)
    board.connect()
    yield chip, board, table
    board.disconnect()
    wire.close()
    chip.close()
