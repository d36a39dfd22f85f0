"""The firmware's logic compiled for this machine with sanitizers, its size, and what its document says about it."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from board_talk import Talk
from simavr_needed import simavr_or_skip

from testbed.errors import UserError
from testbed.hardware.emulation import building
from testbed.hardware.emulation.microcontroller import Microcontroller
from testbed.hardware.line.protocol import Identity, Parser, Result, State, encode

HARDWARE = Path(__file__).resolve().parents[1] / "hardware"
FIRMWARE = HARDWARE / "firmware"
LARGEST = 16_384
INPUTS = 300_000


def made(folder, *arguments):
    return subprocess.run(
        ["make", "-C", str(folder), *arguments], capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """The sources somewhere else: nothing built, free to be broken."""
    folder = tmp_path_factory.mktemp("firmware")
    shutil.copytree(FIRMWARE, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("build"))
    return folder


def test_it_builds_without_a_warning_and_is_small(copy):
    simavr_or_skip()
    done = made(copy, "all")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    size = int(re.search(r"(\d+) of 16384 bytes", done.stdout)[1])
    assert 2000 < size < LARGEST
    assert (copy / "build" / "firmware.hex").read_text().startswith(":")


def test_a_warning_and_a_fat_firmware_are_errors(copy, tmp_path):
    simavr_or_skip()
    broken = tmp_path / "broken"
    shutil.copytree(copy, broken, ignore=shutil.ignore_patterns("build"))
    crc = (broken / "crc.c").read_text()
    (broken / "crc.c").write_text(crc.replace("uint16_t crc = 0xFFFF;", "int unused; uint16_t crc = 0xFFFF;"))
    done = made(broken)
    assert done.returncode != 0
    assert "unused" in done.stderr
    (broken / "crc.c").write_text(crc)
    assert made(broken, "LARGEST=3000").returncode != 0


def test_the_logic_survives_inputs_under_the_sanitizers(copy):
    done = made(copy, "fuzz", f"COUNT={INPUTS}", "SEED=7")
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{INPUTS} inputs" in done.stdout
    assert "nothing found" in done.stdout


def test_a_board_takes_its_identity_over_from_the_flash(copy):
    simavr_or_skip()
    unique = "00ff10abcdef0008"
    done = made(copy, "board", f"UNIQUE={unique}", "NAME=teacher_1", "SERVOS=1")
    assert done.returncode == 0, done.stderr
    with Microcontroller(copy / "build" / "board.hex", servos=None) as fresh:
        identity = Talk(board=fresh).hello()
        assert (identity.unique_id, identity.board_id, len(identity.limits)) == (unique, "teacher_1", 1)
        kept = fresh.read_eeprom(0, 27)
    assert kept[:24] + kept[26:] == (copy / "build" / "identity.bin").read_bytes()[:24] + b"\x01"
    with Microcontroller(copy / "build" / "board.hex", unique_id=b"another!", name="mine") as old:
        assert Talk(board=old).hello().board_id == "mine"
    assert made(copy, "board", "UNIQUE=12").returncode != 0


BREAKS = {
    "no limits": ("commands.c", "wanted > servo->high ? servo->high : wanted", "wanted"),
    "retries are done again": ("board.c", "if (again) {", "if (again && 0) {"),
    "a byte too many": ("frames.c", "parser->length < sizeof", "parser->length <= sizeof"),
}


@pytest.mark.parametrize("what", BREAKS)
def test_the_inputs_find_what_is_broken(copy, tmp_path, what):
    name, sound, broken = BREAKS[what]
    shutil.copytree(copy, tmp_path / "f", ignore=shutil.ignore_patterns("build"))
    source = tmp_path / "f" / name
    assert sound in source.read_text()
    source.write_text(source.read_text().replace(sound, broken))
    done = made(tmp_path / "f", "fuzz", f"COUNT={INPUTS}", "SEED=7")
    assert done.returncode != 0
    assert "not so" in done.stderr or "runtime error" in done.stderr or "AddressSanitizer" in done.stderr


def test_no_logic_knows_the_processor():
    logic = re.search(r"^LOGIC := (.*)$", (FIRMWARE / "Makefile").read_text(), re.M)[1].split()
    for name in [*logic, *(Path(name).with_suffix(".h").name for name in logic)]:
        if (FIRMWARE / name).is_file():
            assert "<avr/" not in (FIRMWARE / name).read_text()


def examples():
    """The frames that the document shows: (caption, bytes)."""
    text = (HARDWARE / "PROTOCOL.md").read_text()
    return re.findall(r"^\| `(\w[^`]*)` \| `((?:[0-9a-f]{2} ?)+)` \|", text, re.M)


def test_the_examples_of_the_document_are_true():
    found = dict(examples())
    assert len(found) >= 9
    for caption, shown in found.items():
        data = bytes.fromhex(shown)
        (frame,) = Parser().feed(data)
        assert encode(frame.seq, frame.type, frame.body) == data
        if frame.type & 0x80:
            body = (Identity if frame.type == 0x81 else State).decode(frame.body)
            assert body.encode() == frame.body
        else:
            assert caption.split()[0] in (
                "HELLO",
                "ARM",
                "DISARM",
                "SET",
                "READ",
                "STOP",
                "CONFIGURE",
                "NAME",
                "CLEAR",
            )


def test_the_board_says_what_the_document_shows():
    simavr_or_skip()
    talk = Talk(name="", noise=0.002)
    talk.run(0.4)
    told = examples()
    for (request, asked), (_, answer) in zip(told[::2], told[1::2], strict=True):
        talk.board.write(bytes.fromhex(asked))
        talk.run(0.1)
        said, shown = talk.frames()[0], Parser().feed(bytes.fromhex(answer))[0]
        assert (said.seq, said.type) == (shown.seq, shown.type)
        if request == "HELLO":
            assert said.body == shown.body
        else:  # the sensor's noise and the milliseconds may differ
            ours, theirs = State.decode(said.body), State.decode(shown.body)
            assert (ours.result, ours.flags, ours.servos) == (Result.OK, theirs.flags, theirs.servos)
            assert ours.boot_nonce == theirs.boot_nonce


def test_what_is_missing_is_named_with_its_packages(monkeypatch):
    monkeypatch.setattr(
        building.shutil, "which", lambda tool: None if tool == "avr-gcc" else f"/usr/bin/{tool}"
    )
    building.firmware_file.cache_clear()
    with pytest.raises(UserError, match=r"avr-gcc.*apt-get install .*libsimavr-dev gcc-avr avr-libc"):
        building.firmware_file()


def test_an_installed_package_says_that_it_has_no_firmware(monkeypatch, tmp_path):
    monkeypatch.setattr(building, "__file__", str(tmp_path / "a" / "b" / "c" / "d.py"))
    with pytest.raises(UserError, match="run from a checkout"):
        building.sources()
