"""Frames of the serial line: what goes in comes out, and what was garbled never does."""

from __future__ import annotations

import numpy as np
import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st

from testbed.hardware.emulation.wire import garbage
from testbed.hardware.line.protocol import (
    LARGEST_FRAME,
    LARGEST_PAYLOAD,
    Flags,
    Frame,
    Identity,
    Parser,
    State,
    encode,
)

byte = st.integers(0, 255)
word = st.integers(0, 0xFFFF)
frames = st.builds(Frame, byte, byte, st.binary(max_size=LARGEST_PAYLOAD - 2))


def wired(frame: Frame) -> bytes:
    return encode(frame.seq, frame.type, frame.body)


@given(st.lists(frames, max_size=5), st.data())
def test_frames_come_out_as_they_went_in_however_they_are_cut(sent: list[Frame], data: st.DataObject) -> None:
    line = b"".join(map(wired, sent))
    parser, got, heard = Parser(), [], bytearray()
    parser = Parser(heard.extend)
    while line:
        cut = data.draw(st.integers(1, len(line)))
        got += parser.feed(line[:cut])
        line = line[cut:]
    assert got == sent
    assert (parser.crc, parser.framing) == (0, 0)
    assert bytes(heard) == b"".join(map(wired, sent))


@given(frames)
def test_a_frame_has_one_zero_its_last_byte(frame: Frame) -> None:
    line = wired(frame)
    assert line.index(0) == len(line) - 1
    assert len(line) <= LARGEST_FRAME


@given(frames, st.integers(1, 0xFFFF), st.data())
def test_a_burst_of_errors_up_to_16_bits_is_always_seen(
    frame: Frame, burst: int, data: st.DataObject
) -> None:
    content = cobs.decode(wired(frame)[:-1])
    at = data.draw(st.integers(0, 8 * len(content) - 16))
    spoilt = (int.from_bytes(content, "big") ^ burst << at).to_bytes(len(content), "big")
    parser = Parser()
    assert parser.feed(cobs.encode(spoilt) + b"\0") == []
    assert parser.crc == 1


@given(frames.filter(lambda frame: len(frame.body) < LARGEST_PAYLOAD - 2))
def test_a_delimiter_that_becomes_a_one_adds_a_byte_that_the_crc_does_not_see(frame: Frame) -> None:
    """Why lengths are checked: see what Link does with a reply that does not fit."""
    (got,) = Parser().feed(wired(frame)[:-1] + b"\1\0")
    assert (got.seq, got.type, got.body[:-1]) == (frame.seq, frame.type, frame.body)


def test_a_payload_beyond_the_largest_is_refused() -> None:
    encode(0, 0, bytes(LARGEST_PAYLOAD - 2))
    with pytest.raises(ValueError, match="at most 64"):
        encode(0, 0, bytes(LARGEST_PAYLOAD - 1))


def test_ten_kilobytes_of_garbage_are_no_frame_and_the_next_frame_is() -> None:
    parser, noise = Parser(), garbage(np.random.default_rng(1), 10_000)
    assert parser.feed(noise) == []
    assert parser.framing + parser.crc > 20
    assert parser.feed(b"\0" + encode(3, 5, b"x")) == [Frame(3, 5, b"x")]


def test_garbage_without_a_delimiter_is_not_kept() -> None:
    parser, pieces = Parser(), []
    parser = Parser(pieces.append)
    parser.feed(b"\x11" * 100_000)
    assert max(map(len, pieces)) <= LARGEST_FRAME
    assert parser.feed(b"\0" + encode(3, 5)) == [Frame(3, 5, b"")]
    assert parser.framing == 1


@pytest.mark.parametrize("count", [4_000, pytest.param(300_000, marks=pytest.mark.slow)])
def test_fuzzing_the_parser_finds_no_frame_of_its_length_that_was_not_sent(count: int) -> None:
    """What grew or shrank may have a right CRC (see above, and by chance): whoever asked looks at lengths."""
    rng, accepted, fed = np.random.default_rng(7), 0, 0
    parser = Parser()
    for _ in range(count):
        frame = Frame(int(rng.integers(256)), int(rng.integers(256)), rng.bytes(int(rng.integers(0, 40))))
        line = bytearray(wired(frame))
        for _ in range(rng.integers(0, 4)):
            at = int(rng.integers(len(line)))
            what = rng.integers(3)
            if what == 0:
                line[at] ^= 1 << int(rng.integers(8))
            elif what == 1:
                del line[at]
            else:
                line.insert(at, line[at])
        fed += len(line)
        for got in parser.feed(bytes(line)):
            accepted += 1
            assert got == frame or len(got.body) != len(frame.body)
    assert fed > 20 * count
    assert accepted > count / 5


@given(
    st.builds(
        Identity,
        protocol=st.just(1),
        firmware=st.tuples(byte, byte, byte),
        board_id=st.text("abcXYZ09-_", max_size=16),
        unique_id=st.binary(min_size=8, max_size=8).map(bytes.hex),
        boot_nonce=word,
        reset_cause=byte,
        imu=byte,
        limits=st.lists(st.tuples(word, word), max_size=5).map(tuple),
        slew=word,
        hold_ms=word,
        limp_ms=word,
    )
)
def test_an_identity_is_read_as_it_was_written_and_no_part_of_one_is(identity: Identity) -> None:
    body = identity.encode()
    assert Identity.decode(body) == identity
    for end in range(len(body)):
        with pytest.raises(ValueError):
            Identity.decode(body[:end])


@given(
    st.builds(
        State,
        result=byte,
        flags=word.map(Flags),
        boot_nonce=word,
        uptime_ms=st.integers(0, 2**32 - 1),
        servos=st.lists(st.tuples(word, word), max_size=5).map(tuple),
        acceleration=st.tuples(*[st.integers(-(2**15), 2**15 - 1)] * 3),
        imu_age_ms=byte,
        counters=st.tuples(word, word, word, word),
    )
)
def test_a_state_is_read_as_it_was_written(state: State) -> None:
    body = state.encode()
    assert State.decode(body) == state
    with pytest.raises(ValueError):
        State.decode(body[:-1])
