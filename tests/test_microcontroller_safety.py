"""What the shipped firmware does when the host is silent, a button is pressed, it hangs, or its supply fails."""

import struct

import pytest
from board_talk import armed_with_limits, talking
from simavr_needed import simavr_or_skip

from testbed.hardware.line.protocol import Flags, Request, Result, encode

simavr_or_skip()

FRAME = 0.02
POWER_ON, RESET_PIN, BROWN_OUT, WATCHDOG_RESET = 1, 2, 4, 8


@pytest.fixture
def talk():
    with talking() as talk:
        yield talk


@pytest.fixture
def armed(talk):
    return armed_with_limits(talk)


def test_silence_holds_and_then_lets_go(talk):
    talk.arm()
    talk.set(2000, 2000)
    talk.run(0.1)
    fed = talk.board.time
    talk.set(4000, 4000)  # some 50 frames away
    talk.run(fed + 0.296 - talk.board.time)
    assert not talk.read().flags & (Flags.HOLDING | Flags.LATCHED_HELD)
    talk.run(fed + 0.302 - talk.board.time)
    state = talk.read()
    assert state.flags & Flags.HOLDING
    assert state.flags & Flags.LATCHED_HELD
    assert not state.flags & Flags.SLEWING
    assert 2500 < state.servos[0][0] == state.servos[0][1] < 3000
    held = talk.board.time + FRAME
    talk.run(1.65)
    assert set(talk.since(held)) == {state.servos[0][1] / 2}
    assert talk.read().flags & Flags.ARMED
    talk.run(0.1)
    assert fed + 1.975 < talk.pulses[-1].at < fed + 2.002
    state = talk.read()
    assert state.flags & Flags.LATCHED_LIMP
    assert not state.flags & (Flags.ARMED | Flags.PULSES | Flags.HOLDING)
    assert state.servos[0] == (0, 0)
    assert talk.set(3000, 3000).result == Result.NOT_ARMED
    assert not talk.ask(Request.CLEAR).flags & (Flags.LATCHED_HELD | Flags.LATCHED_LIMP)


def test_only_set_feeds_the_watchdog(armed):
    armed.set(3000, 3000)
    fed = armed.board.time
    while armed.board.time < fed + 2.1:
        for kind in (Request.READ, Request.CLEAR, Request.HELLO, Request.CONFIGURE):
            armed.send(kind)
        armed.arm(nonce=0xDEAD)
    state = armed.read()
    assert not state.flags & (Flags.ARMED | Flags.PULSES)
    armed.arm()
    armed.set(3000, 3000)
    fed, last = armed.board.time, encode(armed.seq, Request.SET, struct.pack("<HH", 3000, 3000))
    while armed.board.time < fed + 2.1:  # the same frame over and over is a retry, not a new command
        armed.board.write(last)
        armed.run(0.05)
    armed.frames()
    assert not armed.read().flags & Flags.ARMED


def test_a_set_ends_the_holding(armed):
    armed.set(2000, 2000)
    armed.run(0.5)
    assert armed.read().flags & Flags.HOLDING
    state = armed.set(2100, 2100)
    assert not state.flags & Flags.HOLDING
    assert state.flags & Flags.LATCHED_HELD


def test_commands_need_arming_with_this_boots_number(talk):
    assert talk.set(3000, 3000).result == Result.NOT_ARMED
    nonce = talk.hello().boot_nonce
    assert talk.arm(nonce ^ 1).result == Result.BAD_NONCE
    assert talk.arm(nonce).result == Result.OK
    assert talk.arm(nonce).result == Result.ALREADY_ARMED
    talk.run(0.1)
    assert talk.pulses == []


def test_disarming_ends_the_pulses_at_once_and_cuts_none(armed):
    for offset in range(40):  # at all moments of a frame
        armed.set(4000, 5000)
        armed.run(0.06 + offset * 0.0005)
        executed = armed.board.time + 0.0005  # its 6 bytes take 0.24 ms
        armed.ask(Request.DISARM)
        armed.run(0.06)
        assert not [pulse for pulse in armed.pulses if pulse.at > executed]
        assert armed.board.cut_pulses() == []
        armed.arm()
    assert set(armed.since(0)) == {2000.0}
    assert set(armed.since(0, channel=1)) == {2500.0}


@pytest.mark.parametrize("way", ["request", "button"])
def test_a_stop_lasts_until_the_next_boot(armed, way):
    armed.set(3000, 3000)
    armed.run(0.1)
    if way == "request":
        assert armed.ask(Request.STOP).result == Result.OK
    else:
        armed.board.press_stop()
        armed.run(0.01)
        armed.board.press_stop(False)
    at = armed.board.time
    armed.run(0.1)
    for kind in (Request.CLEAR, Request.DISARM):
        assert armed.ask(kind).flags & Flags.STOPPED
    assert armed.arm().result == Result.STOPPED
    assert armed.set(3000, 3000).result == Result.STOPPED
    assert armed.since(at) == []
    armed.board.power_cycle()
    armed.run(0.05)
    assert armed.arm().result == Result.OK


def test_a_button_that_bounces_for_a_moment_stops_nothing(armed):
    for _ in range(20):
        armed.board.press_stop()
        armed.run(0.0005)
        armed.board.press_stop(False)
        armed.run(0.002)
    assert not armed.read().flags & Flags.STOPPED


@pytest.mark.parametrize("interrupts", [True, False])
def test_a_hang_ends_the_pulses_and_resets(armed, interrupts):
    nonce = armed.hello().boot_nonce
    armed.set(3000, 3000)
    armed.run(0.1)
    armed.board.hang(interrupts=interrupts)
    at = armed.board.time
    armed.run(0.14)
    assert armed.since(at + 0.132) == []
    if interrupts:
        assert armed.since(at + 0.055) == []
        assert armed.board.cut_pulses() == []
    assert set(armed.since(at)) == {1500.0}
    identity = armed.hello()
    assert identity.reset_cause == WATCHDOG_RESET
    assert identity.boot_nonce != nonce
    assert identity.limits == ((2000, 4000), (2000, 4000))
    assert armed.set(3000, 3000).result == Result.NOT_ARMED
    assert armed.arm(nonce).result == Result.BAD_NONCE
    armed.run(3.0)
    assert armed.since(at + 0.132) == []


def test_every_boot_has_its_own_number(talk):
    nonces = [talk.hello().boot_nonce]
    for boot, cause in [("brown_out", BROWN_OUT), ("reset", RESET_PIN), ("power_cycle", POWER_ON)] * 30:
        getattr(talk.board, boot)()
        talk.run(0.03)
        identity = talk.hello()
        assert identity.reset_cause == cause
        nonces.append(identity.boot_nonce)
    assert len(set(nonces)) == len(nonces)


def test_resets_without_a_power_cut_hardly_wear_the_eeprom(talk):
    boots = talk.board.read_eeprom(24, 2)
    nonces = set()
    for _ in range(130):
        talk.board.reset()
        talk.run(0.005)
        nonces.add(talk.hello().boot_nonce)
    assert len(nonces) == 130
    written = int.from_bytes(talk.board.read_eeprom(24, 2), "little") - int.from_bytes(boots, "little")
    assert written == 2


def test_a_brown_out_leaves_a_board_that_waits(armed):
    armed.set(3000, 3000)
    armed.run(0.1)
    armed.board.brown_out()
    at = armed.board.time
    armed.run(0.5)
    armed.frames()
    state = armed.read()
    assert not state.flags & (Flags.ARMED | Flags.PULSES)
    assert state.uptime_ms < 600
    assert armed.since(at) == []
