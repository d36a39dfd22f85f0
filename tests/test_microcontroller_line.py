"""The shipped firmware on a bad line, and the same life again whichever way its time is cut."""

import random
import struct

import pytest
from board_talk import REPLY_WAIT, Talk, armed_with_limits, talking
from simavr_needed import simavr_or_skip

from testbed.hardware.line.protocol import Flags, Identity, Request, Result, encode

simavr_or_skip()


@pytest.fixture
def talk():
    with talking() as talk:
        yield talk


@pytest.fixture
def armed(talk):
    return armed_with_limits(talk)


def test_what_is_wrong_with_a_request_is_said(talk):
    assert talk.ask(0x33).result == Result.UNKNOWN_TYPE
    assert talk.ask(Request.READ, b"x").result == Result.BAD_LENGTH
    assert talk.ask(Request.SET, b"x").result == Result.BAD_LENGTH
    assert talk.send(0x85) == []
    assert talk.read().counters[1] == 1


def test_it_never_repeats_what_it_has_done(armed):
    body = struct.pack("<HH", 3000, 3000)
    first = armed.send(Request.SET, body, seq=77)
    armed.run(0.05)
    assert armed.send(Request.SET, body, seq=77) == first
    disarmed = armed.send(Request.DISARM, seq=78)
    armed.arm()
    armed.set(3000, 3000)
    armed.send(Request.DISARM, seq=78)
    assert not armed.read().flags & Flags.ARMED  # another request in between: it is a new one
    assert armed.read().counters[3] == 1
    assert disarmed


def test_a_retry_that_grew_by_its_closing_zero_is_no_new_request(talk):
    nonce = struct.pack("<H", talk.hello().boot_nonce)
    done = talk.send(Request.ARM, nonce, seq=90)
    talk.board.write(encode(90, Request.ARM, nonce)[:-1] + b"\x01\0")  # its CRC is right, one byte further on
    talk.run(REPLY_WAIT)
    (grown,) = talk.frames()
    assert grown.body[0] == Result.BAD_LENGTH
    assert talk.send(Request.ARM, nonce, seq=90) == done
    assert done[0].body[0] == Result.OK


def test_after_ten_kilobytes_of_garbage_it_answers_and_has_done_nothing(armed):
    noise = random.Random(5)
    armed.board.write(bytes(noise.randrange(256) for _ in range(10_000)))
    armed.run(0.45)
    armed.frames()
    armed.board.write(b"\0")
    state = armed.read()
    assert state.flags & Flags.ARMED
    assert armed.pulses == []
    assert sum(state.counters[:2]) > 20
    assert state.counters[2] == 0


def test_a_frame_cut_in_the_middle_spoils_itself_only(talk):
    whole = encode(9, Request.READ, b"")
    for cut in range(1, len(whole) - 1):
        talk.board.write(whole[:cut] + b"\0" + encode(10 + cut, Request.READ, b""))
        talk.run(REPLY_WAIT)
        assert [frame.seq for frame in talk.frames()] == [10 + cut]


def test_a_flood_of_requests_is_answered_as_far_as_the_line_carries(talk):
    talk.board.write(b"".join(encode(i, Request.READ, b"") for i in range(250)))
    talk.run(1.0)
    answers = talk.frames()
    assert talk.parser.crc == talk.parser.framing == 0
    assert [frame.seq for frame in answers] == sorted({frame.seq for frame in answers})
    assert len(answers) > 50
    talk.board.write(b"\0")
    assert talk.read().counters[2] > 0  # the rest is not lost in silence


def lived(slices, seed=3):
    talk = Talk(seed=seed, noise=0.003)
    heard, pulses, n = [], [], 0
    talk.arm()
    end = talk.board.time
    for step in range(40):
        talk.board.write(encode(step, Request.SET, struct.pack("<HH", 2000 + 37 * step, 4000 - 41 * step)))
        for _ in range(slices):
            n += 1
            talk.board.run_until(end + 0.023 * n / slices)
            heard.append(talk.board.read())
            pulses += talk.board.pulses()
    return b"".join(heard), pulses


def test_the_same_calls_give_the_same_bytes_and_pulses_however_time_is_cut():
    assert lived(1) == lived(1) == lived(7) == lived(46)
    assert lived(1) != lived(1, seed=4)


def test_two_boards_do_not_meet():
    a, b = Talk(name="a"), Talk(name="b", imu=False)
    for _ in range(50):
        a.board.run(0.001)
        b.board.run(0.002)
    a.board.write(encode(1, Request.HELLO, b"\x01"))
    b.board.write(encode(1, Request.HELLO, b"\x01"))
    for _ in range(10):
        a.board.run(0.001)
        b.board.run(0.001)
    names = [Identity.decode(frame.body).board_id for talk in (a, b) for frame in talk.frames()]
    assert names == ["a", "b"]
