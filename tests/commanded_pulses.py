"""Never a pulse that was not commanded: what left the pins of an emulated bench, held against a journal."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from testbed.experiment.diary import UNFINISHED
from testbed.hardware.bench_file import RIG
from testbed.hardware.calibration.records import load_servos
from testbed.hardware.emulation.bench import EmulatedBench
from testbed.hardware.journal import Note, Step, Wire, read_journal
from testbed.hardware.line.protocol import Parser, Request

ROUNDING = 0.6  # us
LONGEST_SLEW = 0.7  # s from one end of a servo's travel to the other
IN_FLIGHT = 0.025  # s until a pulse that was allowed has ended
PATIENCE = 2.1  # s of silence until a board is limp


def sent(records: list[Any], board: str) -> list[tuple[float, int, bytes]]:
    """What a board was asked: when, what, and with which body."""
    asked = []
    for record in records:
        if isinstance(record, Wire) and record.board == board and record.direction == "sent":
            asked += [(record.at, frame.type, frame.body) for frame in Parser().feed(record.data)]
    return asked


def check_pulses(bench: EmulatedBench, calibrations: Path, journal: Path, *, since: float = 0.0) -> int:
    """Every pulse since then was commanded by a step of the journal; returns how many there were."""
    records, count = read_journal(journal), 0
    for name, board in bench.boards.items():
        asked = sent(records, name)
        commanded = [(at, np.frombuffer(body, "<u2") / 2) for at, kind, body in asked if kind == Request.SET]
        disarmed = [at for at, kind, _ in asked if kind in (Request.DISARM, Request.STOP)]
        allowed = widths(bench, calibrations, name, steps_in(records))
        for _, pulses in commanded:
            assert (np.abs(pulses[: allowed.shape[1]] - allowed) <= ROUNDING).all(axis=1).any(), name
        for pulse in (pulse for pulse in board.pulses if pulse.at >= since):
            before = [(at, pulses) for at, pulses in commanded if at <= pulse.at]
            assert before, f"{name} pulses before anything was commanded"
            last = before[-1][0]
            assert pulse.at - last < PATIENCE
            assert not [at for at in disarmed if last < at < pulse.at - IN_FLIGHT], f"{name} pulses disarmed"
            recent = [pulses for at, pulses in before if at > pulse.at - LONGEST_SLEW]
            recent += [pulses for at, pulses in before if at <= pulse.at - LONGEST_SLEW][-1:]
            channel = [float(pulses[pulse.channel]) for pulses in recent]
            assert min(channel) - ROUNDING <= pulse.width_us <= max(channel) + ROUNDING, name
            count += 1
    return count


def steps_in(records: list[Any]) -> list[Step]:
    """All steps of a journal, those too that were begun and not finished."""
    steps: list[Step] = []
    for record in records:
        if isinstance(record, Step):
            steps.append(record)
        elif isinstance(record, Note) and record.kind == UNFINISHED:
            told = json.loads(record.text)
            told["commands"] = {name: np.array(angles) for name, angles in told["commands"].items()}
            steps.append(replace(steps[-1], **told))
    return steps


def widths(bench: EmulatedBench, calibrations: Path, name: str, steps: list[Step]) -> np.ndarray:
    """The pulses (n, servos) us that the journal's steps ask of a board: those of rest, and one for each step."""
    calibration = load_servos(calibrations, bench.boards[name].unique_id)
    if name != RIG:
        angles = [np.zeros(2), *(step.commands[name] for step in steps if name in step.commands)]
        return np.array([calibration.pulses(angle) for angle in angles])
    # Nothing turns the rig faster than the scenario says, or farther than somebody asked for.
    spec = bench.scenario
    most, aims = math.radians(spec.rig.pan_speed_deg) * spec.world.control_step, [0.0]
    for step in steps:
        if step.number == 0:
            aims.append(0.0)
        aims.append(aims[-1] + float(np.clip(step.pan_command - aims[-1], -most, most)))
    # Back in place a rig goes at once to where it was when the trial broke off, from straight ahead.
    for there in {round(step.pan_command, 9) for step in steps}:
        aims += [math.copysign(min(most * k, abs(there)), there) for k in range(50)]
    return np.array([calibration.pulses(np.array([aim])) for aim in aims])
