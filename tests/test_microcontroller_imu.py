"""The tilt sensor as the shipped firmware reads it: what it feels, and when it is not to be believed."""

import numpy as np
import pytest
from board_talk import Talk
from simavr_needed import simavr_or_skip

from testbed.hardware.emulation.microcontroller import SENSOR_NOISE
from testbed.hardware.line.protocol import NO_IMU_AGE, Flags

simavr_or_skip()

ONE_G = 16384
WRONG = Flags.IMU_MISSING | Flags.IMU_STUCK


@pytest.mark.parametrize("felt", [(0, 0, 1), (1, 0, 0), (0, -1, 0), (-0.5, 0.25, 0.8), (1.99, -1.99, 0)])
def test_it_reads_what_is_felt(felt):
    talk = Talk(noise=0.0)
    talk.board.set_acceleration(*felt)
    talk.run(0.1)
    state = talk.read()
    np.testing.assert_allclose(np.array(state.acceleration) / ONE_G, felt, atol=1 / ONE_G)
    assert not state.flags & Flags.IMU_MISSING
    assert state.imu_age_ms <= 6


def test_what_is_beyond_its_range_saturates():
    talk = Talk(noise=0.0)
    talk.board.set_acceleration(5, -5, 0)
    talk.run(0.1)
    assert talk.read().acceleration == (32767, -32768, 0)


def test_the_mean_halves_the_noise():
    talk = Talk(noise=SENSOR_NOISE)
    readings = []
    for _ in range(400):
        talk.run(0.021)
        readings.append(talk.read().acceleration)
    spread = np.std(np.array(readings) / ONE_G, axis=0)
    np.testing.assert_allclose(spread, SENSOR_NOISE / 2, rtol=0.15)
    assert abs(np.mean(readings, axis=0) / ONE_G - (0, 0, 1)).max() < 5 * SENSOR_NOISE / 2 / 20


def test_a_turn_is_felt_within_some_readings():
    talk = Talk(noise=0.0005)
    talk.board.set_acceleration(1, 0, 0)
    talk.run(0.03)
    assert talk.read().acceleration[0] > 0.99 * ONE_G


@pytest.mark.parametrize("how", ["unplugged", "bus dead"])
def test_a_lost_sensor_is_said_to_be_and_comes_back(how):
    talk = Talk()
    assert not talk.read().flags & WRONG
    talk.board.set_imu(how)
    talk.run(0.15)
    state = talk.read()
    assert state.flags & Flags.IMU_MISSING
    assert (state.acceleration, state.imu_age_ms) == ((0, 0, 0), NO_IMU_AGE)
    assert talk.hello().imu == 0x68
    talk.board.set_imu("fine")
    talk.run(0.1)
    state = talk.read()
    assert not state.flags & WRONG
    assert state.acceleration[2] == pytest.approx(ONE_G, rel=0.01)


def test_a_sensor_that_holds_the_bus_is_clocked_free():
    talk = Talk()
    talk.board.set_imu("bus held")
    talk.run(0.1)
    state = talk.read()
    assert not state.flags & WRONG
    assert state.imu_age_ms < 10


def test_a_stuck_sensor_is_said_to_be():
    talk = Talk()
    talk.board.set_imu("stuck")
    talk.board.set_acceleration(1, 0, 0)
    talk.run(0.2)
    assert not talk.read().flags & Flags.IMU_STUCK
    talk.run(0.1)
    state = talk.read()
    assert state.flags & Flags.IMU_STUCK
    assert not state.flags & Flags.IMU_MISSING
    talk.board.set_imu("fine")
    talk.run(0.05)
    assert not talk.read().flags & Flags.IMU_STUCK


def test_a_live_sensor_is_never_called_stuck():
    talk = Talk(noise=SENSOR_NOISE)
    for _ in range(100):
        talk.run(0.1)
        assert not talk.read().flags & WRONG


def test_a_sensor_that_fell_asleep_is_woken_and_never_averaged_with_its_sleep():
    talk = Talk()
    talk.board.restart_imu()
    talk.run(0.1)
    states = []
    for _ in range(60):
        talk.run(0.001)
        states.append(talk.read())
    stuck = [bool(state.flags & Flags.IMU_STUCK) for state in states]
    assert 0 < stuck.index(True) < 40
    woken = stuck.index(False, stuck.index(True))
    assert not any(stuck[woken:])
    assert all(state.acceleration[2] == pytest.approx(ONE_G, rel=0.01) for state in states[woken:])


def test_a_sensor_that_comes_late_is_found():
    talk = Talk(imu=False)
    talk.run(0.2)
    assert talk.hello().imu == 0
    talk.board.set_imu("fine")
    talk.run(0.1)
    assert talk.hello().imu == 0x68
    assert not talk.read().flags & WRONG


def test_the_servos_do_not_care_for_the_sensor():
    pulses = []
    for state in ("fine", "unplugged", "stuck", "bus dead"):
        talk = Talk(noise=0.0)
        talk.board.set_imu(state)
        talk.arm()
        for half_us in (2500, 3500, 3000):
            talk.set(half_us, 6000 - half_us)
            talk.run(0.2)
        pulses.append(talk.pulses)
    assert pulses[0]
    assert pulses[1:] == [pulses[0]] * 3
