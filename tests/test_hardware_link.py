"""The link: every exchange succeeds or fails by name, whatever the line does."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from one_board import Peer, Table

from testbed.hardware.clock import WallClock
from testbed.hardware.emulation.wire import Wire, WireFaults, garbage
from testbed.hardware.failures import LinkLost, NoAnswer
from testbed.hardware.line.link import Link, LinkSpec
from testbed.hardware.line.ports import open_port
from testbed.hardware.line.protocol import REPLY, Frame, Parser, Request, encode


@pytest.fixture
def wire(tmp_path: Path) -> Iterator[Wire]:
    wire = Wire(tmp_path / "port", seed=3)
    yield wire
    wire.close()


def linked(wire: Wire, peer: Peer, **kwargs: object) -> tuple[Link, Table]:
    table = Table((peer, wire))
    return Link(open_port(wire.path), table, name="peer", **kwargs), table  # type: ignore[arg-type]


def answered(frame: Frame, delay: float = 0.002) -> tuple[float, bytes]:
    return delay, encode(frame.seq, frame.type | REPLY, frame.body)


def test_a_request_is_answered_and_heard(wire: Wire) -> None:
    heard: list[tuple[float, str, str, bytes]] = []
    link, _ = linked(wire, Peer(lambda frame: [answered(frame)]), listener=lambda *what: heard.append(what))
    assert link.request(Request.READ, b"hello").body == b"hello"
    (_, _, _, sent), (at, board, _, received) = heard
    assert [what[2] for what in heard] == ["sent", "received"]
    assert Parser().feed(sent) == [Frame(1, Request.READ, b"hello")]
    assert Parser().feed(received) == [Frame(1, Request.READ | REPLY, b"hello")]
    assert board == "peer"
    assert 0.002 <= at <= 0.003
    assert link.statistics.times[0] == pytest.approx(at)


def test_a_retry_has_the_number_of_the_request_and_the_next_request_another(wire: Wire) -> None:
    peer = Peer()
    peer._answer = lambda frame: [answered(frame)] if len(peer.frames) in (3, 4) else []
    link, table = linked(wire, peer)
    link.request(Request.SET, b"ab")
    assert [frame.seq for frame in peer.frames] == [1, 1, 1]
    assert table.now() == pytest.approx(2 * link.spec.timeout + 0.002, abs=0.001)
    link.request(Request.SET, b"ab")
    assert [frame.seq for frame in peer.frames] == [1, 1, 1, 2]
    assert (link.statistics.retries, link.statistics.sent, link.statistics.received) == (2, 4, 2)


def test_numbers_wrap_around(wire: Wire) -> None:
    link, _ = linked(wire, Peer(lambda frame: [answered(frame)]))
    for k in range(600):
        body = k.to_bytes(2, "big")
        assert link.request(Request.READ, body).body == body
    assert link.statistics.late == 0


def test_silence_is_no_answer_and_later_silence_a_lost_link_in_less_than_a_board_holds(wire: Wire) -> None:
    peer = Peer(lambda frame: [])
    link, table = linked(wire, peer)
    with pytest.raises(NoAnswer, match=r"peer does not answer on .*port.*; check power"):
        link.request(Request.READ)
    assert table.now() < 0.3
    peer._answer = lambda frame: [answered(frame)]
    link.request(Request.READ)
    peer._answer = lambda frame: []
    with pytest.raises(LinkLost, match="does not answer any more"):
        link.request(Request.READ)
    assert link.statistics.lost == 2


def test_late_and_duplicate_replies_are_thrown_away_and_counted(wire: Wire) -> None:
    peer = Peer()

    def answer(frame: Frame) -> list[tuple[float, bytes]]:
        if frame.body == b"late":  # each of its sendings is answered 50 ms later, after the first retry
            return [answered(frame, 0.05)]
        return [answered(frame, 0.002), answered(frame, 0.003), answered(frame, 0.003)]

    peer._answer = answer
    link, table = linked(wire, peer)
    assert link.request(Request.READ, b"late").body == b"late"
    for k in range(20):
        assert link.request(Request.READ, bytes((k,))).body == bytes((k,))
        table.sleep(0.01)
    link.request(Request.READ, b"end")
    assert link.statistics.late == 1 + 2 * 20
    assert link.statistics.retries == 1


def test_a_reply_to_another_kind_of_request_with_the_same_number_is_not_taken(wire: Wire) -> None:
    link, _ = linked(
        wire, Peer(lambda frame: [(0.001, encode(frame.seq, Request.ARM | REPLY)), answered(frame)])
    )
    assert link.request(Request.READ, b"x").type == Request.READ | REPLY
    assert link.statistics.late == 1


def test_garbage_before_a_reply_costs_nothing(wire: Wire) -> None:
    noise = garbage(np.random.default_rng(5), 10_000)
    link, _ = linked(wire, Peer(lambda frame: [(0.001, noise + b"\0"), answered(frame)]))
    tracemalloc.start()
    for k in range(10):
        assert link.request(Request.READ, bytes((k,))).body == bytes((k,))
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()
    assert link.statistics.framing + link.statistics.crc > 200
    assert link.statistics.retries == 0


def test_a_request_after_one_that_was_cut_in_the_middle_arrives(wire: Wire) -> None:
    peer = Peer(lambda frame: [answered(frame)])
    link, _ = linked(wire, peer)
    link.port.write(encode(9, Request.SET, b"never whole")[:-4])
    assert link.request(Request.READ, b"x").body == b"x"
    assert link.statistics.retries == 0
    assert [frame.type for frame in peer.frames] == [Request.READ]


def test_a_reply_cut_in_the_middle_is_asked_for_again(wire: Wire) -> None:
    peer = Peer()

    def answer(frame: Frame) -> list[tuple[float, bytes]]:
        delay, reply = answered(frame)
        return [(delay, reply[:-3])] if len(peer.frames) == 1 else [(delay, b"\0" + reply)]

    peer._answer = answer
    link, _ = linked(wire, peer)
    assert link.request(Request.READ, b"whole").body == b"whole"
    assert link.statistics.retries == 1


def test_an_unplugged_cable_is_a_lost_link_at_once(wire: Wire) -> None:
    link, table = linked(wire, Peer(lambda frame: [answered(frame)]))
    link.request(Request.READ)
    table.at(table.now() + 0.001, wire.unplug)  # while the reply is awaited
    with pytest.raises(LinkLost, match=r"the port of peer .* is gone"):
        link.request(Request.READ)
    with pytest.raises(LinkLost, match="is gone"):
        link.request(Request.READ)
    assert table.now() < 0.01
    link.close()
    link.close()


def test_a_closed_link_is_lost_by_name(wire: Wire) -> None:
    link, _ = linked(wire, Peer())
    link.close()
    with pytest.raises(LinkLost):
        link.request(Request.READ)


def test_a_host_that_does_not_read_loses_bytes_and_no_more(wire: Wire) -> None:
    flood = garbage(np.random.default_rng(5), 300_000)
    peer = Peer()
    peer._answer = lambda frame: [(0.001, flood)] if len(peer.frames) == 1 else [answered(frame)]
    link, table = linked(wire, peer)
    link.port.write(b"\0" + encode(200, Request.READ))
    table.sleep(0.1)
    assert wire.lost > 100_000
    assert link.request(Request.READ, b"x", retries=20).body == b"x"


def test_a_reply_that_does_not_fit_is_asked_for_again(wire: Wire) -> None:
    peer = Peer()

    def answer(frame: Frame) -> list[tuple[float, bytes]]:
        delay, reply = answered(frame)
        garbled = reply[:-1] + b"\1\0"  # the delimiter with one bit flipped, and the next one
        return [(delay, garbled if len(peer.frames) < 3 else reply)]

    peer._answer = answer
    link, _ = linked(wire, peer)
    assert link.request(Request.READ, b"abc", judge=lambda frame: len(frame.body) == 3).body == b"abc"
    assert (link.statistics.misfits, link.statistics.retries) == (2, 2)


@pytest.mark.parametrize(("rate", "least"), [(0.001, 1.0), (0.01, 0.99), (0.03, 0.5), (0.1, 0.0)])
def test_a_bad_line_gives_the_right_reply_or_a_lost_link(wire: Wire, rate: float, least: float) -> None:
    """Bytes dropped, flipped or doubled with this probability, both ways."""
    link, _ = linked(wire, Peer(lambda frame: [answered(frame)]), spec=LinkSpec(timeout=0.01))
    wire.faults = WireFaults(drop=rate / 3, flip=rate / 3, double=rate / 3)
    rng, arrived = np.random.default_rng(7), 0
    for _ in range(100):
        body = rng.bytes(8)
        try:
            assert link.request(Request.SET, body, judge=lambda frame: len(frame.body) == 8).body == body
            arrived += 1
        except (LinkLost, NoAnswer):
            pass
    assert arrived / 100 >= least
    assert link.statistics.lost == 100 - arrived
    assert rate < 0.01 or link.statistics.retries > 0


def test_the_same_exchange_takes_the_same_virtual_time_and_bytes_each_time(tmp_path: Path) -> None:
    def run(number: int) -> list[object]:
        wire = Wire(tmp_path / f"port{number}", faults=WireFaults(0.003, 0.003, 0.003, 0.003), seed=9)
        heard: list[object] = []
        link, table = linked(
            wire, Peer(lambda frame: [answered(frame)]), listener=lambda *what: heard.append(what)
        )
        for k in range(50):
            link.request(Request.READ, bytes((k,)))
        wire.close()
        return [*heard, table.now()]

    assert run(1) == run(2)


def test_the_real_clock_waits_for_a_real_port(wire: Wire) -> None:
    clock = WallClock()
    port = open_port(wire.path)
    began = clock.now()
    assert not clock.wait(port, began + 0.03)
    assert 0.03 <= clock.now() - began < 1
    wire.to_host(b"x", 0.0)
    assert clock.wait(port, clock.now() + 10)
    clock.sleep(-1)
    wire.unplug()
    assert clock.wait(port, clock.now() + 10)  # reading tells what is wrong
    port.close()
