"""Minds that think in processes of their own come to the same, and nothing is lost with a process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pondering import Pondering

from testbed.experiment import elsewhere, runner
from testbed.experiment.elsewhere import Elsewhere
from testbed.experiment.trial import run_trial, student_of
from testbed.scenario import Scenario, parse_scenario, with_overrides
from testbed.student.insider import Insider
from testbed.student.senses import silent

HERE = Path(__file__).resolve().parent


@pytest.fixture(autouse=True)
def _children_find_this_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), str(HERE.parent)]))


def test_thoughts_wait_for_a_process(tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    go = tmp_path / "go"
    with Elsewhere(1) as apart:
        first = apart(Pondering(os.getpid(), go), lambda *far: told.append(far))
        second = apart(Pondering(os.getpid()), silent)
        assert [thinking.running for thinking in apart._thinkings] == [True, False]
        go.touch()
        later, sooner = second(), first()
        assert len({os.getpid(), later, sooner}) == 3
        assert first() == sooner
    assert told[-1] == ("pondering", 2, 2)
    assert not any(Path(f"/proc/{there}").exists() for there in (sooner, later))


@pytest.mark.parametrize("fate", ["killed", "raises"])
def test_what_goes_wrong_there_is_thought_again_here(fate: str) -> None:
    with Elsewhere(1) as apart:
        outcome = apart(Pondering(os.getpid(), fate=fate), silent)
        if fate == "raises":
            with pytest.raises(ZeroDivisionError, match="a thought too far"):
                outcome()
        else:
            thinker: Any = outcome()
            assert thinker == os.getpid()


def test_others_hear_how_far_a_thought_is(tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []

    def hear(*far: Any) -> None:
        told.append(far)

    with Elsewhere(1) as apart:
        heeding = apart.heeding(hear)
        apart(Pondering(os.getpid(), tmp_path / "never"), heeding)
        until = time.monotonic() + 20
        while ("pondering", 1, 2) not in told and time.monotonic() < until:
            heeding("performing", 1, 1)
    assert ("pondering", 1, 2) in told


KILLED = """
import os, signal, sys
from multiprocessing import connection
from pathlib import Path
from pondering import Pondering
from testbed.experiment.elsewhere import Elsewhere

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run in the background
    folder = Path(sys.argv[1])
    with Elsewhere(1) as apart:
        apart(Pondering(os.getpid(), folder / "never"), lambda *far: None)
        connection.wait([apart._thinkings[0].pipe])
        print(apart._thinkings[0]._process.pid, flush=True)
        sys.stdin.read()
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_thought_ends_with_the_process_that_wants_it(tmp_path: Path, how: signal.Signals) -> None:
    script = tmp_path / "killed.py"
    script.write_text(KILLED, encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as wanting:
        assert wanting.stdout is not None
        thinker = int(wanting.stdout.readline())
        assert lives(thinker)
        wanting.send_signal(how)
        wanting.wait(timeout=60)
        until = time.monotonic() + 20
        while lives(thinker) and time.monotonic() < until:
            time.sleep(0.02)
        assert not lives(thinker)


def lives(process: int) -> bool:
    try:
        told = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except OSError:
        return False
    return told.rpartition(")")[2].split()[0] != "Z"  # dead, but its new parent has not looked yet


def brief() -> Scenario:
    """One who goes by distance leads, and the paper's mind is beside it; cut down to seconds."""
    scenario = parse_scenario(
        """
        seed: 7
        student: nearest
        beside: [paper]
        rig: {camera_rate: 5, supersample: 1}
        teachers:
          - {robot: crawler, gait: crawl, distance: 1.0, bearing_deg: -30}
          - {robot: splayed, gait: splayed_crawl, distance: 1.0, bearing_deg: 30}
        """,
        Path("brief.yaml"),
    )
    return with_overrides(scenario, smoke=True)


def test_a_trial_comes_to_the_same_wherever_the_others_think(monkeypatch: pytest.MonkeyPatch) -> None:
    thought_here: list[bool] = []
    think_here = elsewhere._Thinking.think_here

    def noted(self: elsewhere._Thinking) -> None:
        thought_here.append(True)
        think_here(self)

    monkeypatch.setattr(elsewhere._Thinking, "think_here", noted)
    alone, helped = run_trial(brief(), 0), run_trial(brief(), 0, idle=1)
    assert not thought_here
    assert helped.rows == alone.rows
    assert list(helped.arrays) == list(alone.arrays)
    for name, array in alone.arrays.items():
        assert array.dtype == helped.arrays[name].dtype
        assert array.tobytes() == helped.arrays[name].tobytes()


@pytest.mark.parametrize(
    ("workers", "trials", "idle"), [(2, 1, 1), (1, 1, 0), (2, 2, 0), (2, 5, -1), (2, 0, 1), (64, 1, 3)]
)
def test_only_idle_cores_help(monkeypatch: pytest.MonkeyPatch, workers: int, trials: int, idle: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(4)))
    assert runner._idle(workers, trials) == idle


@pytest.mark.parametrize(
    ("student", "beside", "apart"),
    [
        ("like_me", "[paper]", ["paper"]),
        ("like_me", "[nearest, {name: wiser, method: like_me, verdict: controller}]", []),
        ("like_me", "[paper, {name: like_it, method: paper, imitation: rehearsed}]", []),
        ("paper", "[like_me, {name: like_it, method: paper}]", ["like_me"]),
    ],
)
def test_who_leads_or_is_told_or_shares_a_thought_thinks_here(
    student: str, beside: str, apart: list[str]
) -> None:
    text = f"{{student: {student}, beside: {beside}, teachers: [{{robot: crawler, gait: crawl}}]}}"
    scenario = parse_scenario(text, Path("who.yaml"))
    insider = Insider(scenario.student.body(), lambda bearing, steps: None)
    seeds = np.random.SeedSequence(1)
    with Elsewhere(1) as elsewhere:
        minds = student_of(scenario, seeds, silent, insider, elsewhere)._minds
    assert [mind.name for mind in minds._apart] == apart
    assert student_of(scenario, seeds, silent, insider)._minds._apart == []
