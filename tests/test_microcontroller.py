"""The shipped firmware on the emulated processor: who it says it is, and the pulses that it makes."""

from itertools import pairwise

import pytest
from board_talk import UNIQUE, Talk, armed_with_limits, talking
from hypothesis import given, settings
from hypothesis import strategies as st
from simavr_needed import simavr_or_skip

from testbed.errors import UserError
from testbed.hardware.emulation.microcontroller import Microcontroller
from testbed.hardware.line.protocol import Flags, Identity, Request, Result

simavr_or_skip()

FRAME = 0.02
POWER_ON = 1
WORD = st.integers(0, 65535)


@pytest.fixture
def talk():
    with talking() as talk:
        yield talk


@pytest.fixture
def armed(talk):
    return armed_with_limits(talk)


def keep_setting(talk, seconds, *half_us):
    end = talk.board.time + seconds
    while talk.board.time < end:
        state = talk.set(*half_us, wait=0.05)
    return state


def test_it_boots_without_a_pulse_or_a_word(talk):
    talk.run(1.0)
    assert talk.pulses == []
    assert talk.frames() == []


def test_it_says_who_it_is(talk):
    identity = talk.hello()
    assert identity == Identity(
        protocol=1,
        firmware=(1, 0, 0),
        board_id="student",
        unique_id=UNIQUE.hex(),
        boot_nonce=identity.boot_nonce,
        reset_cause=POWER_ON,
        imu=0x68,
        limits=((2000, 4000), (2000, 4000)),
        slew=40,
        hold_ms=300,
        limp_ms=2000,
    )


@pytest.mark.parametrize("body", [b"", b"\x02", b"\x07and more"])
def test_it_answers_the_greeting_of_any_version(talk, body):
    assert talk.ask(Request.HELLO, body).protocol == 1


def test_pulses_start_with_the_first_set_and_are_exact(armed):
    armed.run(0.2)
    assert armed.pulses == []
    state = armed.set(2601, 3333)
    assert state.flags & Flags.PULSES
    assert state.servos == ((2601, 2601), (3333, 3333))
    armed.run(0.2)
    assert set(armed.since(0)) == {1300.5}
    assert set(armed.since(0, channel=1)) == {1666.5}
    starts = [pulse.at for pulse in armed.pulses if pulse.channel == 0]
    assert len(starts) in (10, 11)
    assert [round(b - a, 9) for a, b in pairwise(starts)] == [FRAME] * (len(starts) - 1)


@pytest.mark.parametrize("width", [1000, 1023, 1024, 1025, 2816, 3072, 4999, 5000])
def test_any_width_follows_any_other_to_half_a_microsecond(armed, width):
    armed.set(3072, 2816)
    armed.run(0.05)
    keep_setting(armed, 0.5, width, 3072)
    after = armed.board.time - 2 * FRAME
    armed.run(0.01)
    assert set(armed.since(after)) == {width / 2}
    assert set(armed.since(after, channel=1)) == {1536.0}


def test_what_is_out_of_range_is_clamped_and_said_to_be(talk):
    talk.arm()
    state = talk.set(1, 65535)
    assert (state.result, state.servos) == (Result.OK, ((2000, 2000), (4000, 4000)))
    assert state.flags & Flags.CLAMPED
    assert not talk.read().flags & Flags.CLAMPED
    talk.run(0.1)
    assert set(talk.since(0)) == {1000.0}
    assert set(talk.since(0, channel=1)) == {2000.0}


def test_a_step_is_slewed(armed):
    armed.set(2000, 2000)
    armed.run(0.1)
    at = armed.board.time
    assert armed.set(3000, 2050, wait=0.02).flags & Flags.SLEWING
    armed.run(0.15)
    steps = [width for width in armed.since(at) if width != 1000]  # one more of those may come first
    assert steps[:6] == [1100, 1200, 1300, 1400, 1500, 1500]
    assert not armed.read().flags & Flags.SLEWING
    assert max(armed.since(at, channel=1)) == 1025


def test_the_limits_are_refused_beyond_the_servos_and_while_armed(talk):
    for wrong in [(999, 3000), (2000, 5001), (3000, 2000)]:
        assert talk.configure(2000, 3000, *wrong, 9).result == Result.BAD_VALUE
    assert talk.configure(2000, 3000, 2000, 3000, 0).result == Result.BAD_VALUE
    assert talk.hello().limits == ((2000, 4000), (2000, 4000))
    talk.arm()
    assert talk.configure(1000, 5000, 1000, 5000, 9).result == Result.ONLY_DISARMED


def test_the_name_is_kept(talk):
    assert talk.ask(Request.NAME, b"teacher_1".ljust(16, b"\0")).result == Result.OK
    for wrong in (b"a b".ljust(16, b"\0"), b"\0a".ljust(16, b"\0"), b"\xe9".ljust(16, b"\0")):
        assert talk.ask(Request.NAME, wrong).result == Result.BAD_VALUE
    talk.run(0.1)
    talk.board.power_cycle()
    talk.run(0.05)
    assert talk.hello().board_id == "teacher_1"
    talk.arm()
    assert talk.ask(Request.NAME, bytes(16)).result == Result.ONLY_DISARMED


@pytest.mark.parametrize("servos", [1, 2])
def test_it_has_as_many_servos_as_its_eeprom_says(servos):
    talk = Talk(servos=servos, imu=False)
    identity = talk.hello()
    assert (len(identity.limits), identity.imu) == (servos, 0)
    talk.arm()
    assert talk.set(*[3000] * (3 - servos)).result == Result.BAD_LENGTH
    assert len(talk.set(*[3000] * servos).servos) == servos
    talk.run(0.1)
    assert {pulse.channel for pulse in talk.pulses} == set(range(servos))


@settings(max_examples=12, deadline=None)
@given(
    commands=st.lists(
        st.tuples(st.integers(0, 65535), st.integers(0, 65535), st.floats(0.001, 0.06)),
        min_size=1,
        max_size=12,
    ),
    low=st.integers(1000, 2900),
    high=st.integers(3100, 5000),
    slew=st.integers(1, 5000),
)
def test_pulses_stay_between_what_was_commanded(commands, low, high, slew):
    talk = Talk()
    with talk.board:
        assert talk.configure(low, high, low, high, slew).result == Result.OK
        talk.arm()
        asked = []
        for first, second, wait in commands:
            state = talk.set(first, second)
            asked.append(tuple(min(max(value, low), high) for value in (first, second)))
            assert tuple(target for target, _ in state.servos) == asked[-1]
            talk.run(wait)
        talk.ask(Request.DISARM)
        talk.run(0.1)
        for channel in (0, 1):
            widths = [2 * width for width in talk.since(0, channel)]
            goals = [pair[channel] for pair in asked]
            assert all(min(goals) <= width <= max(goals) for width in widths)
            assert all(abs(b - a) <= slew for a, b in pairwise(widths))
        assert talk.board.cut_pulses() == []


def test_what_is_no_firmware_is_refused(tmp_path):
    for name, content in [("missing.hex", None), ("text.hex", "hello\n"), ("empty.hex", "")]:
        if content is not None:
            (tmp_path / name).write_text(content)
        with pytest.raises(UserError, match="no firmware in Intel hex format"):
            Microcontroller(tmp_path / name)


@pytest.mark.parametrize("wrong", [{"servos": 3}, {"servos": 0}, {"name": "a" * 17}, {"unique_id": b"short"}])
def test_what_cannot_be_in_the_eeprom_is_refused(wrong):
    with pytest.raises(ValueError, match="1 or 2 servos"):
        Microcontroller(**wrong)


def test_closing_is_harmless_when_repeated():
    board = Microcontroller()
    board.close()
    board.close()
    with pytest.raises(ValueError, match="closed"):
        board.run(1)
