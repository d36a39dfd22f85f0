"""Compiled: how a posture comes to rest on the ground (Section 3.2.2, quasi-static instead of simulated).

A posture is a rigid body, its lower hull that of spheres: the corners of cuboids (radius 0), the caps of capped
cylinders, balls. Let u be the world's up direction in the root's frame, c the centre of mass, p and r a sphere's
centre and radius. The lowest point touches the ground, so the centre of mass is max_i (r_i + u . (c - p_i)) high, and
the body rolls down this landscape: over one sphere, then over an edge of two, until the centre of mass lies inside
the polygon of what touches. Each roll turns u about a fixed axis, so where it ends has a closed form.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.body._postures import Indices, place_parts, sphere_count
from testbed.vision._jit import compiled

_TOUCH = 1e-8  # m: spheres this near to the ground touch it
_REST = 1e-7  # m: a centre of mass this near to the polygon lies in it
_EVENTS = 60  # rolls after which a posture is taken as it is; a handful is usual


@compiled
def _pivot(near: Vector, touching: Indices, count: int) -> tuple[int, int]:
    """Over which of the touching spheres the body rolls: (a, -1) over one, (a, b) over an edge, (-1, -1) at rest.

    ``near`` (s, 2): the spheres seen from above, the centre of mass at the origin. Steepest descent: the body rolls
    over the point of the support polygon that is nearest to the centre of mass.
    """
    best, first, second, bx, by = np.inf, -1, -1, 0.0, 0.0
    for i in range(count):
        a = touching[i]
        ax, ay = near[a, 0], near[a, 1]
        square = ax * ax + ay * ay
        if square < best:
            best, first, second, bx, by = square, a, -1, ax, ay
        for j in range(i):
            b = touching[j]
            dx, dy = near[b, 0] - ax, near[b, 1] - ay
            length = dx * dx + dy * dy
            if length < _TOUCH * _TOUCH:
                continue
            share = -(ax * dx + ay * dy) / length
            if 1e-9 < share < 1 - 1e-9:
                x, y = ax + share * dx, ay + share * dy
                square = x * x + y * y
                if square < best:
                    best, first, second, bx, by = square, a, b, x, y
    if best < _REST * _REST:
        return -1, -1
    for i in range(
        count
    ):  # something on the other side of the nearest point: the polygon holds the centre of mass
        k = touching[i]
        if near[k, 0] * bx + near[k, 1] * by < best - _REST * math.sqrt(best):
            return -1, -1
    return first, second


@compiled
def come_to_rest(
    spheres: Vector, centre: Vector, pose: Vector, scratch: Vector, near: Vector, touching: Indices
) -> bool:
    """Roll until the centre of mass is supported; changes ``pose`` and says whether it came to rest.

    Args:
        spheres: (s, 4) centres and radii in the root's frame, m.
        centre: (3,) centre of mass, m.
        pose: (9,) in and out: the world's up in the root's frame, the world's x likewise, the root's position (m).
        scratch: (s, 4) working space: centre of mass minus sphere, and the height that this sphere asks for.
        near: (s, 2) working space.
        touching: (s,) integers, working space.
    """
    count = len(spheres)
    for i in range(count):
        for k in range(3):
            scratch[i, k] = centre[k] - spheres[i, k]
    rested = False
    for _ in range(_EVENTS):
        u0, u1, u2 = pose[0], pose[1], pose[2]
        norm = 1 / math.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
        u0, u1, u2 = u0 * norm, u1 * norm, u2 * norm
        if abs(u2) < 0.9:  # two directions along the ground
            norm = 1 / math.hypot(u0, u1)
            e0, e1, e2 = -u1 * norm, u0 * norm, 0.0
        else:
            norm = 1 / math.hypot(u0, u2)
            e0, e1, e2 = u2 * norm, 0.0, -u0 * norm
        g0, g1, g2 = u1 * e2 - u2 * e1, u2 * e0 - u0 * e2, u0 * e1 - u1 * e0
        highest = -np.inf
        for i in range(count):
            q = scratch[i]
            q[3] = spheres[i, 3] + u0 * q[0] + u1 * q[1] + u2 * q[2]
            highest = max(highest, q[3])
        held = 0
        for i in range(count):
            q = scratch[i]
            if q[3] > highest - _TOUCH:
                touching[held] = i
                held += 1
                near[i, 0] = -(q[0] * e0 + q[1] * e1 + q[2] * e2)
                near[i, 1] = -(q[0] * g0 + q[1] * g1 + q[2] * g2)
        a, b = _pivot(near, touching, held)
        if a < 0:
            rested = True
            break
        # The roll: u(t) = fixed + cos(t) v + sin(t) w about the axis k.
        qa = scratch[a]
        if b < 0:
            f0, f1, f2, v0, v1, v2 = 0.0, 0.0, 0.0, u0, u1, u2
            along = u0 * qa[0] + u1 * qa[1] + u2 * qa[2]
            w0, w1, w2 = along * u0 - qa[0], along * u1 - qa[1], along * u2 - qa[2]
            norm = 1 / math.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
            w0, w1, w2 = w0 * norm, w1 * norm, w2 * norm
            k0, k1, k2 = v1 * w2 - v2 * w1, v2 * w0 - v0 * w2, v0 * w1 - v1 * w0
        else:
            k0, k1, k2 = qa[0] - scratch[b, 0], qa[1] - scratch[b, 1], qa[2] - scratch[b, 2]
            norm = 1 / math.sqrt(k0 * k0 + k1 * k1 + k2 * k2)
            k0, k1, k2 = k0 * norm, k1 * norm, k2 * norm
            along = u0 * k0 + u1 * k1 + u2 * k2
            f0, f1, f2 = along * k0, along * k1, along * k2
            v0, v1, v2 = u0 - f0, u1 - f1, u2 - f2
            w0, w1, w2 = k1 * v2 - k2 * v1, k2 * v0 - k0 * v2, k0 * v1 - k1 * v0
            if w0 * qa[0] + w1 * qa[1] + w2 * qa[2] > 0:  # downhill
                w0, w1, w2, k0, k1, k2 = -w0, -w1, -w2, -k0, -k1, -k2
        va = v0 * qa[0] + v1 * qa[1] + v2 * qa[2]
        wa = w0 * qa[0] + w1 * qa[1] + w2 * qa[2]
        turn = math.atan2(-wa, -va)  # where the centre of mass would be lowest
        if turn <= 0:
            turn += 2 * math.pi
        for j in range(count):
            if j in (a, b):
                continue
            q = scratch[j]
            d0, d1, d2 = q[0] - qa[0], q[1] - qa[1], q[2] - qa[2]
            cosine = v0 * d0 + v1 * d1 + v2 * d2
            sine = w0 * d0 + w1 * d1 + w2 * d2
            constant = spheres[j, 3] - spheres[a, 3] + f0 * d0 + f1 * d1 + f2 * d2
            reach = math.hypot(cosine, sine)
            if reach <= abs(constant):
                continue
            if q[3] > highest - _TOUCH and sine <= 1e-9:
                continue  # touches now and lifts off
            meets = math.atan2(sine, cosine) - math.acos(-constant / reach)
            if meets < -1e-6:
                meets += 2 * math.pi
            turn = min(turn, max(meets, 0.0))
        c, s = math.cos(turn), math.sin(turn)
        pose[0] = f0 + c * v0 + s * w0
        pose[1] = f1 + c * v1 + s * w1
        pose[2] = f2 + c * v2 + s * w2
        _turn_heading(pose, spheres[a], k0, k1, k2, c, s, u0, u1, u2)
    lowest = -np.inf
    for i in range(count):
        low = spheres[i, 3] - pose[0] * spheres[i, 0] - pose[1] * spheres[i, 1] - pose[2] * spheres[i, 2]
        lowest = max(lowest, low)
    pose[8] = lowest
    return rested


@compiled
def _turn_heading(
    pose: Vector,
    pivot: Vector,
    k0: float,
    k1: float,
    k2: float,
    c: float,
    s: float,
    u0: float,
    u1: float,
    u2: float,
) -> None:
    """Turn the world's x axis in ``pose`` with the roll, and keep the pivot above the same spot of the ground."""
    x0, x1, x2 = pose[3], pose[4], pose[5]
    y0, y1, y2 = u1 * x2 - u2 * x1, u2 * x0 - u0 * x2, u0 * x1 - u1 * x0
    px = x0 * pivot[0] + x1 * pivot[1] + x2 * pivot[2]
    py = y0 * pivot[0] + y1 * pivot[1] + y2 * pivot[2]
    along = (k0 * x0 + k1 * x1 + k2 * x2) * (1 - c)
    n0 = x0 * c + (k1 * x2 - k2 * x1) * s + k0 * along
    n1 = x1 * c + (k2 * x0 - k0 * x2) * s + k1 * along
    n2 = x2 * c + (k0 * x1 - k1 * x0) * s + k2 * along
    # Square to the new up again, against rounding.
    u0, u1, u2 = pose[0], pose[1], pose[2]
    off = n0 * u0 + n1 * u1 + n2 * u2
    n0, n1, n2 = n0 - off * u0, n1 - off * u1, n2 - off * u2
    norm = 1 / math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    n0, n1, n2 = n0 * norm, n1 * norm, n2 * norm
    m0, m1, m2 = u1 * n2 - u2 * n1, u2 * n0 - u0 * n2, u0 * n1 - u1 * n0
    pose[3], pose[4], pose[5] = n0, n1, n2
    pose[6] += px - (n0 * pivot[0] + n1 * pivot[1] + n2 * pivot[2])
    pose[7] += py - (m0 * pivot[0] + m1 * pivot[1] + m2 * pivot[2])


@compiled
def _stand(pose: Vector, up: Vector) -> None:
    """Begin with this up direction (3,), in the middle of the ground; the world's x is any direction square to it."""
    for k in range(9):
        pose[k] = 0.0
    u0, u1, u2 = up
    if abs(u0) < 0.9:
        norm = 1 / math.hypot(u1, u2)
        x0, x1, x2 = (u1 * u1 + u2 * u2) * norm, -u0 * u1 * norm, -u0 * u2 * norm
    else:
        norm = 1 / math.hypot(u0, u1)
        x0, x1, x2 = -u1 * norm, u0 * norm, 0.0
    pose[0], pose[1], pose[2] = u0, u1, u2
    pose[3], pose[4], pose[5] = x0, x1, x2


@compiled
def settle_commands(
    parents: Indices,
    order: Indices,
    mounts: Vector,
    shapes: Vector,
    masses: Vector,
    speeds: Vector,
    targets: Vector,
    increment: float,
    starts: Vector,
    there: bool,
    poses: Vector,
) -> int:
    """Move to each of the ``targets`` and come to rest; returns how many did not.

    Args:
        parents: As :func:`place_parts` takes it.
        order: Likewise.
        mounts: Likewise.
        shapes: Likewise.
        masses: Likewise.
        speeds: (n,) of the motors relative to each other; on the way all move at once, each until it has arrived.
        targets: (steps, n) rad.
        increment: The fastest motor turns this far (rad) between two rests.
        starts: (steps, 3) the world's up in the root's frame from which each step starts; (0, 3) if only the first
            starts level, and each other one from where the one before came to rest.
        there: Whether the joints are at their targets at each start already, or flat.
        poses: (steps, 10) out: as in :func:`come_to_rest`, and the greatest roll per turn of the fastest motor on
            the way: far above one where the body toppled.
    """
    limbs, parts = len(parents), len(shapes)
    frames, centre = np.empty((parts, 12)), np.empty(3)
    spheres = np.empty((sphere_count(shapes), 4))
    scratch, near = np.empty((len(spheres), 4)), np.empty((len(spheres), 2))
    touching = np.empty(len(spheres), np.int64)
    now, pose = np.zeros(limbs), np.zeros(9)
    pose[2] = pose[3] = 1.0
    restless = 0
    for step in range(len(targets)):
        if step < len(starts):
            _stand(pose, starts[step])
            for limb in range(limbs):
                now[limb] = targets[step, limb] if there else 0.0
        longest = 0.0
        for limb in range(limbs):
            longest = max(longest, abs(targets[step, limb] - now[limb]) / speeds[limb])
        pieces = max(1, math.ceil(longest / increment))
        rested, haste = True, 0.0
        for piece in range(pieces):
            share = longest / (pieces - piece)
            longest -= share
            for limb in range(limbs):
                way = targets[step, limb] - now[limb]
                now[limb] += max(-share * speeds[limb], min(share * speeds[limb], way))
            place_parts(parents, order, mounts, shapes, masses, now, frames, spheres, centre)
            u0, u1, u2 = pose[0], pose[1], pose[2]
            rested = come_to_rest(spheres, centre, pose, scratch, near, touching)
            rolled = math.acos(max(-1.0, min(1.0, u0 * pose[0] + u1 * pose[1] + u2 * pose[2])))
            haste = max(haste, rolled / max(share, 1e-3))
        restless += 0 if rested else 1
        for k in range(9):
            poses[step, k] = pose[k]
        poses[step, 9] = haste
    return restless
