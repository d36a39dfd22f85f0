"""How a measurement is taken: ours and a peer's turns alternate, and the ratio carries an interval."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Row = dict[str, Any]


def against(
    name: str,
    peer_name: str,
    target: float,
    ours: Callable[[], object],
    peer: Callable[[], object],
    *,
    turns: int,
    repeats: int = 30,
) -> Row:
    """Alternating turns: ``turns`` calls of the peer, twenty times as many of ours; processor time, not the clock's."""
    ours()
    peer()
    times = np.empty((2, repeats))
    for repeat in range(repeats):
        for i, (call, count) in enumerate(((peer, turns), (ours, 20 * turns))):
            begin = time.process_time()
            for _ in range(count):
                call()
            times[i, repeat] = (time.process_time() - begin) / count
    return row(name, peer_name, target, *times)


def row(
    name: str,
    peer: str,
    target: float,
    theirs: NDArray[np.float64],
    ours: NDArray[np.float64],
    *,
    note: str = "",
) -> Row:
    """The ratio of median times with a 95 % bootstrap interval over the turns, and what else is worth knowing."""
    pick = np.random.default_rng(0).integers(0, len(ours), (2000, len(ours)))
    ratios = np.median(theirs[pick], axis=1) / np.median(ours[pick], axis=1)
    low, high = np.quantile(ratios, (0.025, 0.975))
    ratio = float(np.median(theirs) / np.median(ours))
    return {
        "name": name,
        "peer": peer,
        "ratio": ratio,
        "ratio_low": float(low),
        "ratio_high": float(high),
        "target": target,
        "met": bool(low >= target),
        "note": note,
    }
