"""The bodies that the student could have had: its own, and those that are one edit away from it.

An edit moves a limb to another place, stiffens a joint or all of them, takes a limb away, adds one, flattens the main
body, or puts one plain thing in place of the whole. Each comes with words that say what it would mean.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from testbed.bodies.morphology import CappedCylinder, Cuboid, Morphology, Part, Sphere
from testbed.student.seeing.articulated import Limb

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")


@dataclass(frozen=True)
class Alternative:
    """A body that a candidate could have.

    Attributes:
        name: Short and unique, such as ``limb_2_on_main_180``.
        words: What is different from the own body, as half a sentence about "it".
        limbs: The body plan.
        kept: For each of its parts the part of the own body that it was, or None.
        kind: The edit: own, moved, frozen, removed, added, thin or single.
    """

    name: str
    words: str
    limbs: tuple[Limb, ...]
    kept: tuple[int | None, ...]
    kind: str


def own_limbs(body: Morphology) -> tuple[tuple[Limb, ...], tuple[int, ...]]:
    """The own body as a plan, each part after its parent, and for each the place of that part in ``body.parts``."""
    names, at = [body.root], {body.root: 0}
    limbs = [Limb(body.parts[body.root], None, long=False)]
    pending = list(body.joints.values())
    while pending:
        joint = pending.pop(0)
        if joint.parent not in at:
            pending.append(joint)
            continue
        mount = body.mount(joint)
        x, y, z = (float(value) for value in mount[:3, 3])
        angle = math.atan2(mount[1, 0], mount[0, 0])
        at[joint.child] = len(names)
        names.append(joint.child)
        limbs.append(Limb(body.parts[joint.child], at[joint.parent], (x, y, z), angle))
    order = list(body.parts)
    return tuple(limbs), tuple(order.index(name) for name in names)


def limb_name(limb: int) -> str:
    """What to call a part in words: 0 is the main body."""
    if limb == 0:
        return "main body"
    return f"{ORDINALS[limb - 1]} limb" if limb <= len(ORDINALS) else f"limb {limb}"


def alternatives(limbs: tuple[Limb, ...]) -> tuple[Alternative, ...]:
    """The own body, then all that are one edit away and look different from the side."""
    count = len(limbs)
    same = tuple(range(count))
    found = [Alternative("own", "it has a body like mine", limbs, same, "own")]
    seen = {_signature(limbs)}
    for option in (*_moved(limbs), *_frozen(limbs), *_removed(limbs), *_added(limbs), *_others(limbs)):
        signature = _signature(option.limbs)
        if signature not in seen:
            seen.add(signature)
            found.append(option)
    return tuple(found)


def _end(limbs: tuple[Limb, ...], parent: int, mount: float) -> tuple[float, float, float]:
    """The hinge's place at the far end of a limb, or at one end of the main body."""
    part = limbs[parent].part
    reach = part.radius if isinstance(part, Sphere) else part.length_along_x / 2
    return reach * math.cos(mount), 0.0, 0.0


def _below(limbs: tuple[Limb, ...], top: int) -> set[int]:
    below = {top}
    for i, limb in enumerate(limbs):
        if limb.parent in below:
            below.add(i)
    return below


def _ordered(limbs: list[Limb], kept: list[int | None]) -> tuple[tuple[Limb, ...], tuple[int | None, ...]]:
    """The same body with each part after its parent."""
    order: list[int] = []
    while len(order) < len(limbs):
        order += [
            i
            for i, limb in enumerate(limbs)
            if i not in order and (limb.parent is None or limb.parent in order)
        ]
    place = {old: new for new, old in enumerate(order)}
    return (
        tuple(
            replace(limbs[i], parent=None if limbs[i].parent is None else place[limbs[i].parent or 0])
            for i in order
        ),
        tuple(kept[i] for i in order),
    )


def _spots(limbs: tuple[Limb, ...]) -> Iterator[tuple[int, float, str]]:
    """Where a limb can hang: parent, mounting angle, words."""
    yield 0, 0.0, "the front of the main body"
    yield 0, math.pi, "the other side of the main body"
    for i in range(1, len(limbs)):
        yield i, 0.0, f"the end of the {limb_name(i)}"


def _moved(limbs: tuple[Limb, ...]) -> Iterator[Alternative]:
    for i in range(1, len(limbs)):
        below = _below(limbs, i)
        for parent, mount, words in _spots(limbs):
            there = parent == limbs[i].parent and math.cos(mount - limbs[i].mount) > 0
            if parent in below or there:  # seen from the side it hangs there already
                continue
            changed = list(limbs)
            changed[i] = replace(limbs[i], parent=parent, mount=mount, place=_end(limbs, parent, mount))
            plan, kept = _ordered(changed, list(range(len(limbs))))
            where = "main_180" if mount else ("main" if parent == 0 else f"limb_{parent}")
            yield Alternative(
                f"limb_{i}_on_{where}", f"its {limb_name(i)} hangs on {words}", plan, kept, "moved"
            )


def _frozen(limbs: tuple[Limb, ...]) -> Iterator[Alternative]:
    same = tuple(range(len(limbs)))
    hinges = range(1, len(limbs))
    for i in hinges:
        plan = tuple(replace(limb, frozen=limb.frozen or j == i) for j, limb in enumerate(limbs))
        yield Alternative(
            f"joint_{i}_frozen", f"the joint of its {limb_name(i)} does not move", plan, same, "frozen"
        )
    plan = tuple(replace(limb, frozen=j > 0) for j, limb in enumerate(limbs))
    yield Alternative("all_frozen", "none of its joints moves", plan, same, "frozen")


def _removed(limbs: tuple[Limb, ...]) -> Iterator[Alternative]:
    for i in range(1, len(limbs)):
        below = _below(limbs, i)
        if len(below) > 1:
            continue
        rest = [j for j in range(len(limbs)) if j != i]
        place = {old: new for new, old in enumerate(rest)}
        plan = tuple(
            replace(limbs[j], parent=None if limbs[j].parent is None else place[limbs[j].parent or 0])
            for j in rest
        )
        yield Alternative(f"without_limb_{i}", f"it has no {limb_name(i)}", plan, tuple(rest), "removed")


def _added(limbs: tuple[Limb, ...]) -> Iterator[Alternative]:
    if len(limbs) < 2:
        return
    same: tuple[int | None, ...] = (*range(len(limbs)), None)
    used = {(limb.parent, round(math.cos(limb.mount))) for limb in limbs}
    for parent, mount, words in _spots(limbs):
        if parent == 0 and (0, round(math.cos(mount))) in used:
            continue
        limb = Limb(limbs[-1].part, parent, _end(limbs, parent, mount), mount)
        where = "main_180" if mount else ("main" if parent == 0 else f"limb_{parent}")
        yield Alternative(
            f"another_on_{where}", f"it has one more limb at {words}", (*limbs, limb), same, "added"
        )


def thinned(option: Alternative) -> Alternative | None:
    """The same body with a main body that is less high, or None if that makes no sense."""
    main = option.limbs[0].part
    if not isinstance(main, Cuboid) or len(option.limbs) < 2:
        return None
    length, width, height = main.size
    thin: Part = main.model_copy(update={"size": (length, width, 0.4 * height)})
    words = "its main body is thinner than mine"
    if option.kind == "own":
        name, kind = "thin_main", "thin"
    else:
        name, kind, words = f"{option.name}_thin", option.kind, f"{option.words}, and {words}"
    return replace(
        option,
        name=name,
        kind=kind,
        words=words,
        limbs=(replace(option.limbs[0], part=thin, thick=True), *option.limbs[1:]),
    )


def _others(limbs: tuple[Limb, ...]) -> Iterator[Alternative]:
    main = limbs[0].part
    own = Alternative("own", "", limbs, tuple(range(len(limbs))), "own")
    thin = thinned(own)
    if thin is not None:
        yield thin
    size = main.radius if isinstance(main, Sphere | CappedCylinder) else main.size[2]
    ball = Limb(Sphere(radius=size), None, frozen=True, long=False)
    yield Alternative("ball", "it is a ball", (ball,), (None,), "single")
    box = Limb(Cuboid(size=(2 * size, 2 * size, size)), None, long=True)
    yield Alternative("box", "it is a plain box", (box,), (None,), "single")


def _signature(limbs: tuple[Limb, ...]) -> object:
    """Equal for bodies that look alike from the side, whichever way they face."""

    def branch(i: int, turned: bool) -> object:
        limb = limbs[i]
        angle = round(math.degrees(limb.mount + (math.pi if turned and limb.parent == 0 else 0.0))) % 360
        parts = sorted(str(branch(j, turned)) for j in range(len(limbs)) if limbs[j].parent == i)
        look = limb.part.model_dump_json(include={"shape", "size", "radius", "length"})
        return look, angle, limb.frozen, limb.thick, limb.long, tuple(parts)

    return min(str(branch(0, False)), str(branch(0, True)))
