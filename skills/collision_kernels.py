"""Whether a robot's parts stay clear of each other and of all around, along a straight edge in joint space; compiled
by numba. Kept in one file because numba's cache knows a function by the file that it stands in, and by no other.

How far apart two convex hulls are tells the algorithm of Gilbert, Johnson and Keerthi (1988): it walks over their
Minkowski difference towards the origin. Every step gives a lower bound of the distance (the plane through the newest
support point) and, from the second on, an upper one (the nearest point so far), so that it stops as soon as the
question is answered. Closest points of simplices are found by Voronoi regions, as in Ericson, Real-Time Collision
Detection (2005), 5.1.

Along an edge every pair of hulls is followed on its own. Where the two are some distance apart, and no point of the one
can move farther towards the other than so much from one configuration to the next, they are clear at as many
configurations before and after as that distance allows; only what lies beyond is looked at again (conservative
advancement, as in Schwarzer, Saha and Latombe, 2005, here on a grid). Most pairs are settled once, by a ball around the
one and a box around the other.
"""

from __future__ import annotations

import math
import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import event

from executive.types import FloatArray

IntArray = np.ndarray[Any, np.dtype[np.int64]]
BoolArray = np.ndarray[Any, np.dtype[np.bool_]]


def _can_keep() -> bool:
    """Whether numba can keep what it compiles: where it does so by itself (beside this file, or in the user's cache),
    or else in a folder among the temporary ones that nobody else may write to."""
    try:
        numba.njit(cache=True)(_can_keep)
        return True
    except RuntimeError:  # it has found no folder that can be written to
        folder = Path(tempfile.gettempdir()) / f"executive-compiled-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        about = folder.lstat()
    except OSError:
        return False
    if not stat.S_ISDIR(about.st_mode) or about.st_uid != os.getuid() or about.st_mode & 0o077:
        return False  # what is in there would be run
    numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    return True


KEPT = _can_keep()
"""Whether what is compiled here is there in the next process, too."""

_EXACT = 1e-6
"""m between the bounds at which the distance counts as found."""

_MOST_STEPS = 64


_SIMPLEX, _FACE = 6, 10
"""Rows to work in: four for the corners of the simplex, three for those of one of its faces."""


@numba.njit(cache=KEPT, error_model="numpy")
def clear(
    points: FloatArray,
    spans: IntArray,
    bounds: FloatArray,
    reach: FloatArray,
    groups: IntArray,
    pairs: IntArray,
    chain: FloatArray,
    quiet: BoolArray,
    clearance: float,
    start: FloatArray,
    goal: FloatArray,
    spacing: float,
) -> bool:
    """Whether every pair is farther apart than `clearance` (m) at configurations at most `spacing` (rad) apart, spread
    evenly from `start` to `goal`, both (J,) and included.

    Args:
        points: (3, N) the corners of all hulls, each in the frame of its link, m.
        spans: (G, 3) each hull's link, first point, and number of points; after all hulls, a row for each link: a
            box around all that hangs on it.
        bounds: (G, 10) the middle and radius of a ball around each hull, the least and the greatest corner of a box.
        reach: (G, J) as `Chain.reach` tells.
        groups: (K, 5) runs of `pairs`: the first hull of them all, the row for the link of all second ones, the first
            pair, and the one after the last; and a row of `quiet`, or -1.
        pairs: (P, 2) the hulls that may not touch, the one of the lower link first.
        chain: (J, 18) as `Chain.packed` tells.
        quiet: (R, C) in which of C parts of the second joint's turn a run's pairs are clear, wherever the first is.
    """
    joints = chain.shape[0]
    length: float = 0.0
    for joint in range(joints):
        length += (goal[joint] - start[joint]) ** 2
    steps = math.ceil(math.sqrt(length) / spacing)
    frames = np.empty((steps + 1, joints + 1, 12))
    known = np.zeros(steps + 1, dtype=np.bool_)
    room, stack = np.empty((14, 3)), np.empty((64, 2), dtype=np.int64)
    travels = _travels(reach, spans, start, goal, steps)
    middle = steps // 2
    half = steps - middle
    arrange(chain, start, goal, steps, middle, frames)
    known[middle] = True
    for group in range(groups.shape[0]):
        # First all of a link at once: mostly it is far from the hull in question all along the way.
        a, all_of_it = groups[group, 0], groups[group, 1]
        if groups[group, 4] >= 0 and _all_quiet(quiet, groups[group, 4], start[1], goal[1]):
            continue
        low = spans[a, 0]
        away = _away(frames, bounds, middle, low, spans[all_of_it, 0], a, all_of_it)
        if away > clearance + travels[all_of_it, low] * half or (
            groups[group, 3] - groups[group, 2] > 1
            and _stay_clear(
                points, spans, bounds, chain, clearance, start, goal, steps, a, all_of_it, travels[all_of_it, low],
                frames, known, room, stack,
            )
        ):  # fmt: skip
            continue
        for pair in range(groups[group, 2], groups[group, 3]):
            b = pairs[pair, 1]
            away = _away(frames, bounds, middle, low, spans[b, 0], a, b)
            if away <= clearance + travels[b, low] * half and not _stay_clear(
                points, spans, bounds, chain, clearance, start, goal, steps, a, b, travels[b, low],
                frames, known, room, stack,
            ):  # fmt: skip
                return False
    return True


@numba.njit(cache=KEPT, error_model="numpy")
def all_clear(
    points: FloatArray,
    spans: IntArray,
    bounds: FloatArray,
    reach: FloatArray,
    groups: IntArray,
    pairs: IntArray,
    chain: FloatArray,
    quiet: BoolArray,
    clearance: float,
    configurations: FloatArray,
) -> BoolArray:
    """`clear` at each of the configurations (N, J) by itself: (N,) of bool."""
    result = np.empty(len(configurations), dtype=np.bool_)
    for index in range(len(configurations)):
        q = configurations[index]
        result[index] = clear(points, spans, bounds, reach, groups, pairs, chain, quiet, clearance, q, q, 1.0)
    return result


class _Compiling(event.Listener):
    """Says so when the first of all is compiled; what is kept from before is not."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell, self._told = tell, False

    def on_start(self, event: event.Event) -> None:
        if not self._told:
            self._told = True
            self._tell(f"the check for collisions{', once on this machine' if KEPT else ''}")

    def on_end(self, event: event.Event) -> None:
        pass


def ready(tell: Callable[[str], None] = lambda what: None) -> None:
    """Have everything here compiled and kept, so that no action waits for it: once, after an installation.

    Args:
        tell: receives what is waited for, where there is something to compile.
    """
    with event.install_listener("numba:compile", _Compiling(tell)):
        _call_everything()


def are_kept() -> bool:
    """Whether everything here is compiled, so that `ready` has nothing to say."""

    def refuse(what: str) -> None:
        raise _NotKeptError

    try:
        ready(refuse)
    except _NotKeptError:
        return False
    return True


class _NotKeptError(Exception):
    """Ends what would be compiled."""


def _call_everything() -> None:
    points, spans, bounds = np.zeros((3, 8)), np.array([[0, 0, 4], [0, 4, 4]]), np.zeros((2, 10))
    reach, groups, pairs = np.zeros((2, 1)), np.zeros((0, 5), dtype=np.int64), np.zeros((0, 2), dtype=np.int64)
    chain, quiet, q = np.zeros((1, 18)), np.zeros((0, 1), dtype=np.bool_), np.zeros((1, 1))
    clear(points, spans, bounds, reach, groups, pairs, chain, quiet, 0.0, q[0], q[0], 1.0)
    all_clear(points, spans, bounds, reach, groups, pairs, chain, quiet, 0.0, q)
    points[0, 4:], room = 1.0, np.zeros((14, 3))
    room[:3], room[4, 0] = np.eye(3), 1.0
    separation(points, spans, 0, 1, 0.0, np.inf, 1.0, room)
    distances(np.ones((1, 3)), np.zeros((4, 3)), np.empty(1))
    arrange(chain, q[0], q[0], 0, 0, np.zeros((1, 2, 12)))


@numba.njit(cache=KEPT, error_model="numpy")
def _stay_clear(
    points: FloatArray,
    spans: IntArray,
    bounds: FloatArray,
    chain: FloatArray,
    clearance: float,
    start: FloatArray,
    goal: FloatArray,
    steps: int,
    a: int,
    b: int,
    travel: float,
    frames: FloatArray,
    known: BoolArray,
    room: FloatArray,
    stack: IntArray,
) -> bool:
    """Whether hull b stays clear of hull a, towards which it moves by no more than `travel` (m) in one step."""
    low, high, depth, warm = spans[a, 0], spans[b, 0], 1, False
    stack[0, 0], stack[0, 1] = 0, steps
    while depth > 0:
        depth -= 1
        begin, end = stack[depth, 0], stack[depth, 1]
        at = (begin + end) // 2
        if not known[at]:
            arrange(chain, start, goal, steps, at, frames)
            known[at] = True
        apart = _away(frames, bounds, at, low, high, a, b)
        enough = clearance + travel * (end - at)
        if apart <= enough and not warm:
            # The other way round: a ball around the first and a box around the second one.
            back = _away(frames, bounds, at, high, low, b, a)
            if back > enough:
                apart = back
            else:
                _way(frames, bounds, at, low, high, a, b, back > apart, room)
                warm = True  # from then on, the way at another configuration is the one to begin with
        if apart <= enough:
            _relative(frames, at, low, high, room)
            apart = max(apart, separation(points, spans, a, b, clearance, enough, travel, room))
            if apart <= clearance:
                return False
        ahead = int((apart - clearance) / travel)
        if at + ahead < end:
            stack[depth, 0], stack[depth, 1] = at + ahead + 1, end
            depth += 1
        if at - ahead > begin:
            stack[depth, 0], stack[depth, 1] = begin, at - ahead - 1
            depth += 1
    return True


@numba.njit(cache=KEPT, error_model="numpy")
def _all_quiet(quiet: BoolArray, row: int, start: float, goal: float) -> bool:
    """Whether a row says so of all parts of a turn, in rad, that are gone through."""
    parts = quiet.shape[1]
    scale = parts / (2.0 * math.pi)
    first, last = math.floor((min(start, goal) + math.pi) * scale), math.floor((max(start, goal) + math.pi) * scale)
    for part in range(first, last + 1):  # noqa: SIM110 (numba compiles no generators)
        if not quiet[row, part % parts]:
            return False
    return True


@numba.njit(cache=KEPT, error_model="numpy")
def _travels(reach: FloatArray, spans: IntArray, start: FloatArray, goal: FloatArray, steps: int) -> FloatArray:
    """How far, in m, any point of each hull moves in one step at most, seen from each link below its own, (G, J + 1);
    a little above zero where it does not, so that it can be divided by."""
    joints = len(start)
    travels = np.full((spans.shape[0], joints + 1), 1e-12)
    if steps > 0:
        for hull in range(spans.shape[0]):
            for link in range(spans[hull, 0] - 1, -1, -1):
                turn = abs(goal[link] - start[link]) / steps
                travels[hull, link] = travels[hull, link + 1] + turn * reach[hull, link]
    return travels


@numba.njit(cache=KEPT, error_model="numpy")
def arrange(chain: FloatArray, start: FloatArray, goal: FloatArray, steps: int, at: int, frames: FloatArray) -> None:
    """Where the links are in the world after `at` steps, into row `at` of `frames`."""
    share = at / max(1, steps)
    for i in range(12):
        frames[at, 0, i] = 1.0 if i in (0, 4, 8) else 0.0
    for j in range(chain.shape[0]):
        angle = start[j] + (goal[j] - start[j]) * share
        cos, sin = math.cos(angle), math.sin(angle)
        x, y, z = chain[j, 12], chain[j, 13], chain[j, 14]
        rest = 1.0 - cos
        r0, r1, r2 = cos + x * x * rest, x * y * rest - z * sin, x * z * rest + y * sin
        r3, r4, r5 = x * y * rest + z * sin, cos + y * y * rest, y * z * rest - x * sin
        r6, r7, r8 = x * z * rest - y * sin, y * z * rest + x * sin, cos + z * z * rest
        u, v, w = chain[j, 15], chain[j, 16], chain[j, 17]
        px, py, pz = u - (r0 * u + r1 * v + r2 * w), v - (r3 * u + r4 * v + r5 * w), w - (r6 * u + r7 * v + r8 * w)
        for i in range(3):
            k, n, m = frames[at, j, 3 * i], frames[at, j, 3 * i + 1], frames[at, j, 3 * i + 2]
            a = k * chain[j, 0] + n * chain[j, 3] + m * chain[j, 6]
            b = k * chain[j, 1] + n * chain[j, 4] + m * chain[j, 7]
            c = k * chain[j, 2] + n * chain[j, 5] + m * chain[j, 8]
            d = k * chain[j, 9] + n * chain[j, 10] + m * chain[j, 11]
            frames[at, j + 1, 3 * i] = a * r0 + b * r3 + c * r6
            frames[at, j + 1, 3 * i + 1] = a * r1 + b * r4 + c * r7
            frames[at, j + 1, 3 * i + 2] = a * r2 + b * r5 + c * r8
            frames[at, j + 1, 9 + i] = a * px + b * py + c * pz + d + frames[at, j, 9 + i]


@numba.njit(cache=KEPT, error_model="numpy", inline="always")
def _away(frames: FloatArray, bounds: FloatArray, at: int, link: int, other: int, a: int, b: int) -> float:
    """How far the ball around hull b, on link `other`, is at least from the box around hull a, on `link`."""
    x, y, z = bounds[b, 0], bounds[b, 1], bounds[b, 2]
    u = frames[at, other, 0] * x + frames[at, other, 1] * y + frames[at, other, 2] * z + frames[at, other, 9]
    v = frames[at, other, 3] * x + frames[at, other, 4] * y + frames[at, other, 5] * z + frames[at, other, 10]
    w = frames[at, other, 6] * x + frames[at, other, 7] * y + frames[at, other, 8] * z + frames[at, other, 11]
    x, y, z = u - frames[at, link, 9], v - frames[at, link, 10], w - frames[at, link, 11]
    u = frames[at, link, 0] * x + frames[at, link, 3] * y + frames[at, link, 6] * z
    v = frames[at, link, 1] * x + frames[at, link, 4] * y + frames[at, link, 7] * z
    w = frames[at, link, 2] * x + frames[at, link, 5] * y + frames[at, link, 8] * z
    u -= min(max(u, bounds[a, 4]), bounds[a, 7])
    v -= min(max(v, bounds[a, 5]), bounds[a, 8])
    w -= min(max(w, bounds[a, 6]), bounds[a, 9])
    return math.sqrt(u * u + v * v + w * w) - float(bounds[b, 3])


@numba.njit(cache=KEPT, error_model="numpy")
def _way(
    frames: FloatArray, bounds: FloatArray, at: int, low: int, high: int, a: int, b: int, turned: bool, room: FloatArray
) -> None:
    """About the way from hull a to hull b in the frame of link `low`, into row 4 of `room`: from the box around a to
    the middle of b or, `turned`, from the middle of a to the box around b; where that is inside, from middle to
    middle."""
    link, one, there, other, sign = (high, b, low, a, -1.0) if turned else (low, a, high, b, 1.0)
    x, y, z = bounds[other, 0], bounds[other, 1], bounds[other, 2]
    u = frames[at, there, 0] * x + frames[at, there, 1] * y + frames[at, there, 2] * z + frames[at, there, 9]
    v = frames[at, there, 3] * x + frames[at, there, 4] * y + frames[at, there, 5] * z + frames[at, there, 10]
    w = frames[at, there, 6] * x + frames[at, there, 7] * y + frames[at, there, 8] * z + frames[at, there, 11]
    x, y, z = u - frames[at, link, 9], v - frames[at, link, 10], w - frames[at, link, 11]
    inside, p, q, r = True, 0.0, 0.0, 0.0
    for i in range(3):
        across = frames[at, link, i] * x + frames[at, link, 3 + i] * y + frames[at, link, 6 + i] * z
        gap = across - min(max(across, bounds[one, 4 + i]), bounds[one, 7 + i])
        inside = inside and abs(gap) < 1e-6
        room[5, i] = gap
    for i in range(3):
        across = frames[at, link, i] * x + frames[at, link, 3 + i] * y + frames[at, link, 6 + i] * z
        step = sign * (across - bounds[one, i] + 1e-9 if inside else room[5, i])
        p += frames[at, link, i] * step
        q += frames[at, link, 3 + i] * step
        r += frames[at, link, 6 + i] * step
    for i in range(3):
        room[4, i] = frames[at, low, i] * p + frames[at, low, 3 + i] * q + frames[at, low, 6 + i] * r


@numba.njit(cache=KEPT, error_model="numpy", inline="always")
def _relative(frames: FloatArray, at: int, low: int, high: int, room: FloatArray) -> None:
    """The frame of link `high` as link `low` sees it, into rows 0 to 3 of `room`: rotation and position."""
    x = frames[at, high, 9] - frames[at, low, 9]
    y = frames[at, high, 10] - frames[at, low, 10]
    z = frames[at, high, 11] - frames[at, low, 11]
    for i in range(3):
        u, v, w = frames[at, low, i], frames[at, low, 3 + i], frames[at, low, 6 + i]
        for k in range(3):
            room[i, k] = u * frames[at, high, k] + v * frames[at, high, 3 + k] + w * frames[at, high, 6 + k]
        room[3, i] = u * x + v * y + w * z


@numba.njit(cache=KEPT, error_model="numpy")
def distances(points: FloatArray, corners: FloatArray, found: FloatArray) -> None:
    """How far each of the points (N, 3) is from the hull of `corners` (M, 3), M a multiple of four, in m: into `found`
    (N,)."""
    count = len(corners)
    both = np.empty((3, count + 4))
    spans = np.array([[0, 0, count], [0, count, 4]], dtype=np.int64)
    room = np.zeros((_FACE + 4, 3))
    for corner in range(count):
        for k in range(3):
            both[k, corner] = corners[corner, k]
    for point in range(len(points)):
        for k in range(3):
            for copy in range(4):
                both[k, count + copy] = points[point, k]
            for column in range(3):
                room[k, column] = 1.0 if k == column else 0.0
            room[3, k] = 0.0
            room[4, k] = points[point, k] - corners[0, k]
        room[4, 0] += 1e-9
        found[point] = separation(both, spans, 0, 1, 0.0, np.inf, 1e-9, room)


@numba.njit(cache=KEPT, error_model="numpy")
def separation(
    points: FloatArray,
    spans: IntArray,
    first: int,
    second: int,
    near: float,
    far: float,
    step: float,
    room: FloatArray,
) -> float:
    """A lower bound of the distance in m between two hulls: the distance itself within 1e-6 m, unless an earlier bound
    has told enough.

    Args:
        points, spans: as for `clear`; the number of a hull's points is a multiple of four.
        near: once they are known to be no farther apart than this, 0 is returned at once.
        far: once they are known to be farther apart than this, that bound is returned at once;
        step: and so it is once no better one would be more of these beyond `near`.
        room: (14, 3) the second hull's frame in that of the first, rotation and position, in rows 0 to 3; in row 4
            about the way from the first to the second, in the first one's frame, which is not 0, and afterwards a
            better one; the rest to work in.
    """
    x, y, z = room[4, 0], room[4, 1], room[4, 2]
    px, py, pz = room[3, 0], room[3, 1], room[3, 2]
    best: float = 0.0
    count = 0
    for _ in range(_MOST_STEPS):
        # The point of the first hull farthest along the way to the second, and the other way round.
        a = _farthest(points, spans[first, 1], spans[first, 2], x, y, z)
        u = room[0, 0] * x + room[1, 0] * y + room[2, 0] * z
        v = room[0, 1] * x + room[1, 1] * y + room[2, 1] * z
        w = room[0, 2] * x + room[1, 2] * y + room[2, 2] * z
        b = _farthest(points, spans[second, 1], spans[second, 2], -u, -v, -w)
        top = points[0, a] * x + points[1, a] * y + points[2, a] * z
        low = points[0, b] * u + points[1, b] * v + points[2, b] * w
        size = math.sqrt(x * x + y * y + z * z)
        best = max(best, (low + x * px + y * py + z * pz - top) / size)
        if best > far or (
            count and (size - best < _EXACT or (best > near and int((best - near) / step) == int((size - near) / step)))
        ):
            room[4, 0], room[4, 1], room[4, 2] = x, y, z
            return best
        p, q, r = points[0, b], points[1, b], points[2, b]
        row = _SIMPLEX + count
        room[row, 0] = room[0, 0] * p + room[0, 1] * q + room[0, 2] * r + px - points[0, a]
        room[row, 1] = room[1, 0] * p + room[1, 1] * q + room[1, 2] * r + py - points[1, a]
        room[row, 2] = room[2, 0] * p + room[2, 1] * q + room[2, 2] * r + pz - points[2, a]
        count, x, y, z = _nearest(room, count + 1)
        if count == 4 or x * x + y * y + z * z <= near * near:
            return 0.0
    return best


@numba.njit(cache=KEPT, error_model="numpy", inline="always")
def _farthest(points: FloatArray, first: int, count: int, x: float, y: float, z: float) -> int:
    """The corner of a hull that is farthest in a direction. Four runners, so that no comparison waits for the last."""
    top, a = -1e30, first
    top1, b, top2, c, top3, d = top, first, top, first, top, first
    for i in range(first, first + count, 4):
        along = points[0, i] * x + points[1, i] * y + points[2, i] * z
        along1 = points[0, i + 1] * x + points[1, i + 1] * y + points[2, i + 1] * z
        along2 = points[0, i + 2] * x + points[1, i + 2] * y + points[2, i + 2] * z
        along3 = points[0, i + 3] * x + points[1, i + 3] * y + points[2, i + 3] * z
        if along > top:
            top, a = along, i
        if along1 > top1:
            top1, b = along1, i + 1
        if along2 > top2:
            top2, c = along2, i + 2
        if along3 > top3:
            top3, d = along3, i + 3
    if top1 > top:
        top, a = top1, b
    if top2 > top:
        top, a = top2, c
    if top3 > top:
        a = d
    return a


@numba.njit(cache=KEPT, error_model="numpy")
def _nearest(s: FloatArray, count: int) -> tuple[int, float, float, float]:
    """The point of the simplex, `count` rows from `_SIMPLEX` on, that is nearest to the origin. It is cut down to the
    corners that the point lies between; four corners are left only where the origin is inside."""
    if count == 1:
        return 1, s[_SIMPLEX, 0], s[_SIMPLEX, 1], s[_SIMPLEX, 2]
    if count == 2:
        return _on_segment(s, _SIMPLEX)
    if count == 3:
        return _on_triangle(s, _SIMPLEX)
    return _in_tetrahedron(s)


@numba.njit(cache=KEPT, error_model="numpy")
def _move(s: FloatArray, start: int, end: int) -> None:
    s[end, 0], s[end, 1], s[end, 2] = s[start, 0], s[start, 1], s[start, 2]


@numba.njit(cache=KEPT, error_model="numpy")
def _on_segment(s: FloatArray, o: int) -> tuple[int, float, float, float]:
    x, y, z = s[o + 1, 0] - s[o, 0], s[o + 1, 1] - s[o, 1], s[o + 1, 2] - s[o, 2]
    along = -(s[o, 0] * x + s[o, 1] * y + s[o, 2] * z)
    length = x * x + y * y + z * z
    if along <= 0.0 or length < 1e-24:
        return 1, s[o, 0], s[o, 1], s[o, 2]
    if along >= length:
        _move(s, o + 1, o)
        return 1, s[o, 0], s[o, 1], s[o, 2]
    share = along / length
    return 2, s[o, 0] + share * x, s[o, 1] + share * y, s[o, 2] + share * z


@numba.njit(cache=KEPT, error_model="numpy")
def _on_triangle(s: FloatArray, o: int) -> tuple[int, float, float, float]:
    abx, aby, abz = s[o + 1, 0] - s[o, 0], s[o + 1, 1] - s[o, 1], s[o + 1, 2] - s[o, 2]
    acx, acy, acz = s[o + 2, 0] - s[o, 0], s[o + 2, 1] - s[o, 1], s[o + 2, 2] - s[o, 2]
    d1 = -(abx * s[o, 0] + aby * s[o, 1] + abz * s[o, 2])
    d2 = -(acx * s[o, 0] + acy * s[o, 1] + acz * s[o, 2])
    if d1 <= 0.0 and d2 <= 0.0:
        return 1, s[o, 0], s[o, 1], s[o, 2]
    d3 = -(abx * s[o + 1, 0] + aby * s[o + 1, 1] + abz * s[o + 1, 2])
    d4 = -(acx * s[o + 1, 0] + acy * s[o + 1, 1] + acz * s[o + 1, 2])
    if d3 >= 0.0 and d4 <= d3:
        _move(s, o + 1, o)
        return 1, s[o, 0], s[o, 1], s[o, 2]
    d5 = -(abx * s[o + 2, 0] + aby * s[o + 2, 1] + abz * s[o + 2, 2])
    d6 = -(acx * s[o + 2, 0] + acy * s[o + 2, 1] + acz * s[o + 2, 2])
    if d6 >= 0.0 and d5 <= d6:
        _move(s, o + 2, o)
        return 1, s[o, 0], s[o, 1], s[o, 2]
    vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return _on_segment(s, o)
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        _move(s, o + 2, o + 1)
        return _on_segment(s, o)
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        _move(s, o + 2, o)
        return _on_segment(s, o)
    whole = va + vb + vc
    if whole < 1e-30:  # three points in a line
        return _on_segment(s, o)
    v, w = vb / whole, vc / whole
    return 3, s[o, 0] + v * abx + w * acx, s[o, 1] + v * aby + w * acy, s[o, 2] + v * abz + w * acz


_FACES: IntArray = np.array([[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2], [1, 3, 2, 0]])
"""The corners of each face of a tetrahedron, and the one opposite."""


@numba.njit(cache=KEPT, error_model="numpy")
def _in_tetrahedron(s: FloatArray) -> tuple[int, float, float, float]:
    best, count, kept, x, y, z = 1e30, 4, 0, 0.0, 0.0, 0.0
    for row in range(4):
        a, b, c, d = (
            _SIMPLEX + _FACES[row, 0],
            _SIMPLEX + _FACES[row, 1],
            _SIMPLEX + _FACES[row, 2],
            _SIMPLEX + _FACES[row, 3],
        )
        ax, ay, az = s[a, 0], s[a, 1], s[a, 2]
        ux, uy, uz = s[b, 0] - ax, s[b, 1] - ay, s[b, 2] - az
        vx, vy, vz = s[c, 0] - ax, s[c, 1] - ay, s[c, 2] - az
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        inner = nx * (s[d, 0] - ax) + ny * (s[d, 1] - ay) + nz * (s[d, 2] - az)
        outer = -(nx * ax + ny * ay + nz * az)
        flat = inner * inner <= 1e-20 * (nx * nx + ny * ny + nz * nz)
        if not flat and inner * outer >= 0.0:
            continue  # the origin is on this face's inner side
        _copy(s, row)
        corners, px, py, pz = _on_triangle(s, _FACE)
        away = px * px + py * py + pz * pz
        if away < best:
            best, count, kept, x, y, z = away, corners, row, px, py, pz
    if count < 4:
        # Once more, as only the corners of the nearest face are to be kept.
        _copy(s, kept)
        count, x, y, z = _on_triangle(s, _FACE)
        for corner in range(3):
            _move(s, _FACE + corner, _SIMPLEX + corner)
    return count, x, y, z


@numba.njit(cache=KEPT, error_model="numpy")
def _copy(s: FloatArray, face: int) -> None:
    for corner in range(3):
        _move(s, _SIMPLEX + _FACES[face, corner], _FACE + corner)
