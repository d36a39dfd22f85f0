"""The journal keeps what it was told, whatever becomes of the process and the disk."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.errors import UserError
from testbed.hardware.journal import (
    MAGIC,
    Journal,
    Lost,
    Note,
    Record,
    Step,
    Wire,
    read_journal,
    steps_of,
    whole_steps,
)

number = st.floats(allow_nan=False, width=64)


def step(count: int, *, images: bool = False) -> Step:
    rng = np.random.default_rng(count)
    return Step(
        number=count,
        at=count / 30 + 1e-13,
        commands={"student": rng.standard_normal(2), "teacher_0": rng.standard_normal(3)},
        pan_command=float(rng.standard_normal()),
        pan=0.1 + 0.2,
        tilts={"student": np.array([-0.0, 5e-324]), "teacher_0": np.array([np.nan, np.inf])},
        movement=1 / 3,
        exposed=max(0, count - 1),
        images=rng.integers(0, 256, (2, 75, 100)).astype(np.uint8) if images else None,
    )


def same(one: Step, other: Step) -> None:
    assert (one.number, one.at, one.pan_command, one.pan) == (
        other.number,
        other.at,
        other.pan_command,
        other.pan,
    )
    assert (one.movement, one.exposed) == (other.movement, other.exposed)
    for mine, yours in ((one.commands, other.commands), (one.tilts, other.tilts)):
        assert list(mine) == list(yours)
        for name in mine:
            assert mine[name].tobytes() == yours[name].tobytes()
    assert (one.images is None) == (other.images is None)
    if one.images is not None and other.images is not None:
        np.testing.assert_array_equal(one.images, other.images)


def test_what_is_written_is_read_to_the_bit_and_in_its_order(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "0.journal"
    with Journal(path) as journal:
        journal.wire(0.1, "student", "sent", b"\0\x02\x01\0")
        journal.step(step(0, images=True))
        journal.note(0.2, "failed", "BoardRestarted: ü")
        journal.wire(0.3, "rig", "received", bytes(range(256)))
        journal.step(step(1))
    records = read_journal(path)
    assert [type(record) for record in records] == [Wire, Step, Note, Wire, Step]
    assert records[0] == Wire(0.1, "student", "sent", b"\0\x02\x01\0")
    assert records[2] == Note(0.2, "failed", "BoardRestarted: ü")
    assert records[3] == Wire(0.3, "rig", "received", bytes(range(256)))
    same(steps_of(records)[0], step(0, images=True))
    same(steps_of(records)[1], step(1))


@settings(max_examples=30)
@given(
    st.lists(number, min_size=1, max_size=8), st.lists(st.tuples(number, st.binary(max_size=80)), max_size=5)
)
def test_numbers_and_bytes_of_any_kind_are_kept(
    tmp_path_factory: pytest.TempPathFactory, angles: list[float], frames: list[tuple[float, bytes]]
) -> None:
    path = tmp_path_factory.mktemp("journal") / "j"
    told = Step(0, angles[0], {"a": np.array(angles)}, angles[-1], 0.0, {}, 0.0, 0)
    with Journal(path) as journal:
        for at, data in frames:
            journal.wire(at, "a", "received", data)
        journal.step(told)
    *wires, read = read_journal(path)
    assert wires == [Wire(at, "a", "received", data) for at, data in frames]
    assert isinstance(read, Step)
    same(read, told)


def test_a_journal_is_gone_on_with_and_a_step_made_again_counts_for_the_older(tmp_path: Path) -> None:
    path = tmp_path / "j"
    with Journal(path) as journal:
        for count in range(5):
            journal.step(step(count))
    with Journal(path) as journal:
        journal.note(1.0, "resumed", "from step 3")
        for count in (3, 4, 5):
            journal.step(step(count, images=True))
    steps = steps_of(read_journal(path))
    assert [one.number for one in steps] == [0, 1, 2, 3, 4, 5]
    assert [one.images is not None for one in steps] == [False] * 3 + [True] * 3


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, list[Record]]:
    path = tmp_path_factory.mktemp("journal") / "j"
    with Journal(path) as journal:
        for count in range(3):
            journal.note(count, "told", "x" * count)
            journal.wire(count, "student", "sent", bytes(count))
    return path.read_bytes(), read_journal(path)


def test_wherever_it_is_cut_off_the_whole_records_before_stay_and_it_can_be_gone_on_with(
    whole: tuple[bytes, list[Record]], tmp_path: Path
) -> None:
    contents, records = whole
    path, before = tmp_path / "j", -1
    for end in range(len(contents) + 1):
        path.write_bytes(contents[:end])
        kept = read_journal(path)
        assert kept == records[: len(kept)]
        assert len(kept) >= before
        before = len(kept)
        with Journal(path) as journal:
            journal.note(9.0, "after", "")
        assert read_journal(path) == [*kept, Note(9.0, "after", "")]
    assert before == len(records)


@pytest.mark.parametrize("tail", [bytes(4096), b"\xff" * 100, b"\1\0\0\0\0\0\0\0x"])
def test_what_a_power_cut_leaves_at_the_end_is_left_out(
    whole: tuple[bytes, list[Record]], tmp_path: Path, tail: bytes
) -> None:
    contents, records = whole
    (tmp_path / "j").write_bytes(contents + tail)
    assert read_journal(tmp_path / "j") == records
    Journal(tmp_path / "j").close()
    assert (tmp_path / "j").read_bytes() == contents


def test_a_changed_byte_costs_its_record_and_is_never_read_as_something_else(
    whole: tuple[bytes, list[Record]], tmp_path: Path
) -> None:
    contents, records = whole
    path = tmp_path / "j"
    for at in range(len(MAGIC), len(contents)):
        spoilt = bytearray(contents)
        spoilt[at] ^= 0x10
        path.write_bytes(spoilt)
        kept = read_journal(path)
        whole_ones = [record for record in kept if not isinstance(record, Lost)]
        assert len(whole_ones) == len(records) - 1
        assert all(record in records for record in whole_ones)
        holes = [record.count for record in kept if isinstance(record, Lost)]
        if whole_ones == records[:-1]:  # the last one: a torn end
            assert holes == []
            continue
        assert len(kept) == len(records)
        assert holes[0] > 8
        Journal(path).close()  # going on takes nothing away
        assert path.read_bytes() == spoilt


@pytest.mark.parametrize("hole", [b"\xff" * 3, bytes(5000), b"W" * 2000])
def test_what_is_put_between_is_counted(
    whole: tuple[bytes, list[Record]], tmp_path: Path, hole: bytes
) -> None:
    contents, records = whole
    (tmp_path / "j").write_bytes(contents + hole + contents[len(MAGIC) :])
    at = records[-1].at
    assert read_journal(tmp_path / "j") == [*records, Lost(at, len(hole)), *records]


def test_steps_end_where_one_is_lost_until_it_is_made_again() -> None:
    def numbers(*made: int) -> tuple[list[int], bool]:
        steps, whole = whole_steps([step(count) for count in made])
        return [one.number for one in steps], whole

    assert numbers(0, 1, 2) == ([0, 1, 2], True)
    assert numbers(0, 1, 3, 4) == ([0, 1], False)
    assert numbers(0, 1, 3, 4, 1, 2) == ([0, 1, 2], True)
    assert numbers(1, 2) == ([], False)
    assert numbers() == ([], True)


def test_a_killed_process_leaves_all_but_its_last_second(tmp_path: Path) -> None:
    code = """
import sys, time
from pathlib import Path
from testbed.hardware.journal import Journal
journal = Journal(Path(sys.argv[1]))
for count in range(10**9):
    journal.note(count, "tick", "x" * 100)
    if count == 300:
        print("go", flush=True)
    time.sleep(0.005)
"""
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "j")], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(0.3)
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    records = read_journal(tmp_path / "j")
    assert len(records) > 100
    assert [record.at for record in records] == list(range(len(records)))


def test_a_full_disk_is_told_once_and_what_was_written_stays(tmp_path: Path) -> None:
    path = tmp_path / "j"
    journal = Journal(path)
    journal.note(0.0, "first", "")
    journal.flush()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises(UserError, match="disk is full"):
            _fill(journal)
        with pytest.raises(UserError, match="is closed; the first error says why"):
            journal.note(1.0, "x", "")
        journal.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    records = read_journal(path)
    assert records[0] == Note(0.0, "first", "")
    assert records[1:] == [Wire(at, "student", "sent", bytes(1000)) for at in range(len(records) - 1)]
    with Journal(path) as journal:
        journal.note(2.0, "freed", "")
    assert read_journal(path) == [*records, Note(2.0, "freed", "")]


def _fill(journal: Journal) -> None:
    for count in range(1000):
        journal.wire(count, "student", "sent", bytes(1000))


def test_no_journal_is_said_to_be_none_and_is_not_touched(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("something else entirely")
    for attempt in (lambda: read_journal(tmp_path / "text"), lambda: Journal(tmp_path / "text")):
        with pytest.raises(UserError, match="no journal"):
            attempt()
    assert (tmp_path / "text").read_text() == "something else entirely"
    with pytest.raises(UserError, match="cannot be read"):
        read_journal(tmp_path / "none")
    (tmp_path / "folder").mkdir()
    with pytest.raises(UserError):
        Journal(tmp_path / "folder")
    with pytest.raises(UserError):
        Journal(tmp_path / "text" / "below")


def test_closing_twice_is_harmless_and_leaves_no_open_file(tmp_path: Path) -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    journal = Journal(tmp_path / "j")
    journal.close()
    journal.close()
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    assert read_journal(tmp_path / "j") == []


def test_a_step_costs_less_than_a_millisecond(tmp_path: Path) -> None:
    plain = Step(0, 0.0, {"student": np.zeros(2)}, 0.0, 0.0, {}, 0.0, 0, np.full((2, 75, 100), 255, np.uint8))
    with Journal(tmp_path / "j") as journal:
        began = time.process_time()
        for _ in range(300):
            journal.step(plain)
            for _ in range(8):
                journal.wire(0.0, "student", "sent", bytes(40))
        assert (time.process_time() - began) / 300 < 0.001
    assert (tmp_path / "j").stat().st_size < 300 * 2000
