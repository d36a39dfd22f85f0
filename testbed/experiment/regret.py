"""What a choice among candidates was worth: regret against somebody who knows the truth.

To imitate an appropriate teacher is worth 1, to imitate nobody 0, and to imitate an inappropriate one -1, for the
student then learns what its body cannot do. Regret is what was missed of the best that this world offered: 0 for the
right choice, 1 for nobody where somebody was there or for the wrong one where nobody was, 2 for the wrong one beside
the right one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any

Row = Mapping[str, Any]


def worth(chosen: Row | None) -> int:
    """What imitating this teacher is worth; None: nobody."""
    if chosen is None:
        return 0
    return 1 if chosen["truth"] == "appropriate" else -1


def choice(world: Sequence[Row]) -> Row | None:
    """Whom a mind would imitate in one world, by its verdicts: of those it finds like itself the one with most score.

    It is what the leader did, unless its body was damaged meanwhile.
    """
    like_me = [row for row in world if row["verdict"] == "appropriate" and row["score"] is not None]
    return max(like_me, key=lambda row: float(row["score"]), default=None)


def regret(world: Sequence[Row]) -> int:
    """Regret of a mind's choice among the teachers (rows of verdicts) of one world."""
    best = max((worth(row) for row in world), default=0)
    return max(best, 0) - worth(choice(world))


def regrets(rows: Iterable[Row]) -> dict[str, list[int]]:
    """By student, the regret in each world (cell and trial) in order."""
    found: dict[str, list[int]] = {}
    key = _world_of
    for (student, *_), world in groupby(sorted(rows, key=key), key=key):
        found.setdefault(student, []).append(regret(list(world)))
    return found


def _world_of(row: Row) -> tuple[str, str, int]:
    return str(row["student"]), str(row["cell"]), int(row["trial"])
