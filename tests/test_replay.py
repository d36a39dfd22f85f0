"""``testbed replay``: a journal in words, and the same verdicts from it without the world behind it."""

from __future__ import annotations

import functools
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed import cli
from testbed.experiment.jobs import Job
from testbed.experiment.replay import journal_below
from testbed.experiment.runner import live_on, run
from testbed.experiment.stage import simulated
from testbed.hardware.frames_in_words import contents, in_words, told
from testbed.hardware.journal import Journal
from testbed.hardware.line.protocol import Flags, Identity, Request, State, encode, words
from testbed.scenario import Scenario

JOB = Job("default", 0)


@pytest.fixture(scope="module")
def lived(hasty: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one short trial that kept its journal; in simulation, which has no wires."""
    folder = tmp_path_factory.mktemp("lived") / "run"
    run(hasty, out=folder, compute=functools.partial(live_on, simulated, folder, hasty))
    return folder


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str]) -> Any:
    def run(*arguments: str) -> tuple[int, str, str]:
        status = cli._status(cli.app, list(arguments))
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


def test_a_trial_comes_out_again_as_it_was(lived: Path, say: Any) -> None:
    status, out, err = say("replay", str(lived), "0")
    assert (status, err) == (0, "")
    assert out.strip().splitlines()[-1] == "as recorded, to the last digit"
    recorded = {row["teacher"]: row for row in json.loads((lived / "verdicts.json").read_text())["verdicts"]}
    for name, row in recorded.items():
        assert f"of {name}: {row['verdict']}" in out
    status, out, _ = say("replay", str(lived), "0", "--json")
    said = json.loads(out)
    assert (status, said["equal"], said["finished"]) == (0, True, True)
    assert said["steps"] > 100
    assert 0 < said["pairs"] < said["steps"]


def test_a_verdict_that_was_altered_is_told(lived: Path, say: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from testbed.cli import replay as cli_replay

    truly = cli_replay._recorded

    def altered(*arguments: Any) -> Any:
        rows = truly(*arguments)
        assert rows is not None
        return [{**rows[0], "chosen": not rows[0]["chosen"]}, *rows[1:]]

    monkeypatch.setattr(cli_replay, "_recorded", altered)
    status, out, _ = say("replay", str(lived), "0")
    assert status == 1
    assert "NOT as recorded: " in out
    assert "chosen is" in out


def test_a_journal_that_broke_off_says_so(lived: Path, say: Any, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(lived, broken)
    journal = journal_below(broken, JOB)
    journal.write_bytes(journal.read_bytes()[: len(journal.read_bytes()) // 2])
    for path in broken.glob("trials/default/0.*"):
        if path != journal:
            path.unlink()
    status, out, _ = say("replay", str(broken), "0")
    assert status == 0
    assert "ends before the student had decided; run the scenario again" in out
    assert contents(journal).steps > 10


def test_a_journal_with_a_hole_is_told_up_to_it(lived: Path, say: Any, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(lived, broken)
    journal = journal_below(broken, JOB)
    whole = journal.read_bytes()
    hole = whole.index(b'{"number": 30,')
    journal.write_bytes(whole[:hole] + b"?" * 50 + whole[hole + 50 :])
    status, out, _ = say("replay", str(broken), "0")
    assert status == 0
    assert " bytes are damaged: what came after step 29 is lost" in out
    assert "ends before the student had decided; what it said then is recorded" in out
    # Where it is no step that is damaged, nothing is lost of what the student met.
    hole = whole.index(b'P{"at"')
    journal.write_bytes(whole[:hole] + b"?" + whole[hole + 1 :])
    assert " bytes are damaged: no step is lost" in "\n".join(contents(journal).lines())


def test_a_run_without_a_journal_is_one_line(lived: Path, say: Any) -> None:
    status, out, err = say("replay", str(lived), "7")
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    status, _, err = say("replay", str(lived.parent), "0")
    assert status == 2
    assert "no run directory" in err


IDENTITY = Identity(
    1, (1, 2, 3), "student", "00112233445566ff", 65, 4, 0x68, ((2000, 4000),) * 2, 40, 300, 2000
)
STATE = State(
    0, Flags.ARMED | Flags.PULSES | Flags.CLAMPED, 65, 1234, ((3000, 2998), (2500, 0)), (0, -8192, 16384), 3,
    (0, 0, 0, 0),
)  # fmt: skip


def test_every_frame_is_told_in_words(tmp_path: Path, say: Any, lived: Path) -> None:
    path = journal_below(tmp_path, JOB)
    with Journal(path) as journal:
        journal.wire(0.5, "student", "sent", b"\0" + encode(1, Request.HELLO, b"\1"))
        journal.wire(0.503, "student", "received", encode(1, Request.HELLO | 0x80, IDENTITY.encode()))
        journal.wire(0.6, "student", "sent", b"\0" + encode(2, Request.SET, words([3000, 2501])))
        journal.wire(0.603, "student", "received", encode(2, Request.SET | 0x80, STATE.encode()))
        journal.wire(0.7, "rig", "received", b"\x05abcd\0")
        journal.note(0.8, "failed", "BoardRestarted: it did")
    lines = [str(line) for line in told(path)]
    assert lines == [
        "    0.5000  -> student    #1 HELLO: protocol 1",
        "    0.5030  <- student    #1 HELLO reply: 'student' 00112233445566ff, firmware 1.2.3, nonce 65",
        "    0.6000  -> student    #2 SET: 1500 us, 1250.5 us",
        "    0.6030  <- student    #2 SET reply: ok; armed pulses clamped; pulses 1499 us, none; "
        "+0.000 -0.500 +1.000 g",
        "    0.7000  <- rig        wrong CRC: 6 bytes",
        "    0.8000  -- failed BoardRestarted: it did",
    ]
    held = contents(path)
    assert (held.steps, held.frames, held.seconds) == (0, {"student": 4, "rig": 1}, pytest.approx(0.3))
    assert held.notes == ["failed BoardRestarted: it did"]
    status, out, _ = say("replay", str(lived), "0", "--frames")
    assert status == 0
    assert "step 1" in out


@settings(max_examples=200, deadline=None)
@given(data=st.binary(max_size=90))
def test_any_bytes_have_words(data: bytes) -> None:
    assert in_words(data)
    assert "\n" not in in_words(data)


@settings(max_examples=200, deadline=None)
@given(
    seq=st.integers(0, 255),
    kind=st.sampled_from([*Request, 0x33]),
    reply=st.booleans(),
    body=st.binary(max_size=60),
)
def test_any_body_has_words(seq: int, kind: int, reply: bool, body: bytes) -> None:
    said = in_words(encode(seq, kind | (0x80 if reply else 0), body))
    assert said.startswith(f"#{seq} ")
