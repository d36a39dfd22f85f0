"""What the terminal shows: progress with and without a terminal, and the table of verdicts."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console
from trial_builder import trial_result

from testbed.console import Bars, Lines, display_on, summary_lines, verdict_table
from testbed.experiment import verdicts
from testbed.experiment.jobs import Job


def screen(*, terminal: bool) -> tuple[Console, io.StringIO]:
    sink = io.StringIO()
    return Console(file=sink, force_terminal=terminal, width=110, color_system=None), sink


def play(console: Console, total: int) -> None:
    with display_on(console) as display:
        display.started(Path("runs/x-1a2b3c4d"), total, 0)
        for trial in range(total):
            job = Job("default", trial)
            for phase in ("self-discovery", "imitation 0"):
                for done in (0, 5, 10):
                    display.progressed(job, phase, done, 10)
            display.progressed(job, "performing", 0, 0)
            if trial == 1:
                display.failed(job, "RuntimeError: [servo] on fire", Path("1.error.txt"))
            else:
                display.finished(job)


def test_a_terminal_gets_bars_and_a_log_gets_lines() -> None:
    assert isinstance(display_on(screen(terminal=True)[0]), Bars)
    assert isinstance(display_on(screen(terminal=False)[0]), Lines)


def test_a_single_trial_has_a_bar_a_phase_with_the_time_left() -> None:
    console, sink = screen(terminal=True)
    play(console, 1)
    last = sink.getvalue().split("\x1b")[-2:]
    shown = sink.getvalue()
    assert last
    for phase in ("self-discovery", "imitation 0", "performing"):
        assert phase in shown
    assert "10/10" in shown
    assert "left" in shown


def test_many_trials_have_a_bar_over_them_all() -> None:
    console, sink = screen(terminal=True)
    play(console, 3)
    assert "trials" in sink.getvalue()
    assert "3/3" in sink.getvalue()
    assert "trial 1 failed: RuntimeError: [servo] on fire; see 1.error.txt" in sink.getvalue()


def test_lines_of_a_single_trial_tell_its_phases() -> None:
    console, sink = screen(terminal=False)
    play(console, 1)
    lines = sink.getvalue().splitlines()
    assert lines[0] == "runs/x-1a2b3c4d: 0 of 1 trials are finished"
    assert [line.partition(":")[0] for line in lines[1:4]] == ["self-discovery", "imitation 0", "performing"]
    assert "\x1b" not in sink.getvalue()


def test_lines_of_many_trials_count_them_and_tell_the_time_left() -> None:
    console, sink = screen(terminal=False)
    play(console, 3)
    lines = sink.getvalue().splitlines()[1:]
    assert len(lines) == 3
    assert lines[0].startswith("trial 0 finished (1 of 3, about ")
    assert lines[1].startswith("trial 1 failed: RuntimeError: [servo] on fire; see 1.error.txt (2 of 3")


@pytest.mark.parametrize(("trials", "column"), [(1, "score"), (30, "judged appropriate")])
def test_the_table_tells_each_verdict_or_sums_many_up(trials: int, column: str) -> None:
    rows = [row for trial in range(trials) for row in trial_result(trial).rows]
    contents = verdicts.document("name", "1a2b3c4d", rows, 5)
    console, sink = screen(terminal=False)
    console.print(verdict_table(contents))
    assert column in sink.getvalue()
    for word in ("crawler", "splayed", "inappropriate"):
        assert word in sink.getvalue()
    (line,) = summary_lines(contents)
    right = sum(row["truth"] == row["verdict"] for row in rows)
    assert line.startswith(f"student paper: {right} of {len(rows)} verdicts are right (95% interval ")
    assert ("AUC" in line) == (trials > 1)


@pytest.mark.parametrize("trials", [3, 30])
def test_the_table_fits_a_narrow_terminal(trials: int) -> None:
    rows = [row for trial in range(trials) for row in trial_result(trial).rows]
    sink = io.StringIO()
    Console(file=sink, width=80).print(verdict_table(verdicts.document("name", "1a2b3c4d", rows, 5)))
    assert "\N{HORIZONTAL ELLIPSIS}" not in sink.getvalue()
    assert "inappropriate" in sink.getvalue()


def test_a_missing_score_is_no_number() -> None:
    rows = [{**trial_result(0).rows[0], "score": None}]
    console, sink = screen(terminal=False)
    console.print(verdict_table(verdicts.document("name", "1a2b3c4d", rows, 5)))
    assert "none" in sink.getvalue()
