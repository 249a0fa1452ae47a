"""Writes the 40-digit references of `rbfmu chart` (rbfmu/studies/chart/reference_motions.json).

Taylor series in fixed-point integers, of the quaternion, the body rates, and position and velocity of the centre of
mass; nothing of it is shared with the library's kernels. A million turns of a free body are one period of its body
rates, followed by as many turns about its angular momentum as there are periods.
"""

import json
import operator
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from rbfmu.extras import needed_of
from rbfmu.scene.scene import Scene
from rbfmu.studies.chart.cases import CASES, CHECKPOINTS, REFERENCES

with needed_of("bench"):
    import mpmath as mp

DIGITS = 40
Series = list[int]


class Settings(NamedTuple):
    """Bits after the point, order of the series, digits to which each series' last term must have vanished."""

    bits: int = 200
    order: int = 40
    vanished: int = 50


USUAL = Settings()


class Motion:
    """The scene's motion; state: q (4), omega (3), r_c (3), v_c (3) times 2^bits."""

    def __init__(self, scene: Scene, settings: Settings) -> None:
        self.bits, self.order, vanished = settings
        self.smallest = 1 << max(0, self.bits - int(vanished * 3.3219))
        body, loads, initial = scene.body, scene.loads, scene.initial
        assert body is not None
        m, r, g = Fraction(body.mass), [Fraction(x) for x in body.r_oc_b], [Fraction(x) for x in loads.gravity_a]
        M = [Fraction(body.inertia[k][k]) for k in range(3)]
        torque, force = ([Fraction(x) for x in v] for v in (loads.torque_b, loads.force_b))
        assert not any((*loads.torque_a, *loads.force_a))
        if body.pivot:
            square = sum(x * x for x in r)
            M = [M[k] + m * (square - r[k] * r[k]) for k in range(3)]
            weight, gravity, push = [m * x for x in g], [Fraction(0)] * 3, [Fraction(0)] * 3
        else:
            torque = [t - x for t, x in zip(torque, _cross(r, force), strict=True)]
            weight, gravity, push = [Fraction(0)] * 3, g, [f / m for f in force]
        assert not any(weight[:2])
        self.factor = [self.fixed((M[k - 2] - M[k - 1]) / M[k]) for k in range(3)]
        self.torque = [self.fixed(torque[k] / M[k]) for k in range(3)]
        self.damping = [self.fixed(Fraction(loads.damping_b[k]) / M[k]) for k in range(3)]
        # alpha += (r x R^T weight) / M, R^T weight = weight_z times the last row of R
        lever = [[Fraction(0), -r[2], r[1]], [r[2], Fraction(0), -r[0]], [-r[1], r[0], Fraction(0)]]
        self.lever = [[self.fixed(x * weight[2] / M[k]) for x in lever[k]] for k in range(3)]
        self.heavy = any(any(row) for row in self.lever)
        self.gravity, self.push = [self.fixed(x) for x in gravity], [self.fixed(x) for x in push]
        with mp.workdps(int(self.bits * 0.302) + 5):
            q = [mp.mpf(x) for x in initial.quaternion]
            length = mp.sqrt(sum(x * x for x in q))
            self.q = [int(mp.nint(x / length * 2**self.bits)) for x in q]
        omega = [Fraction(x) for x in initial.omega_b]
        at = [x + Fraction(p) for x, p in zip(self.turn(self.q, r), initial.position, strict=True)]
        velocity = [x + Fraction(v) for x, v in zip(self.turn(self.q, _cross(omega, r)), initial.velocity, strict=True)]
        self.start = self.q + [self.fixed(x) for x in (*omega, *at, *([0, 0, 0] if body.pivot else velocity))]

    def fixed(self, x: Fraction | int) -> int:
        """Return the number times 2^bits."""
        return round(x * (1 << self.bits))

    def turn(self, q: Sequence[int], v: Sequence[Fraction]) -> list[Fraction]:
        """R(q) v."""
        one = 1 << self.bits
        e, *x = (Fraction(a, one) for a in q)
        t = [2 * a for a in _cross(x, v)]
        return [a + e * b + c for a, b, c in zip(v, t, _cross(x, t), strict=True)]

    def series(self, state: Sequence[int], h: int) -> list[Series]:
        """Taylor coefficients of the state times powers of h."""
        bits = self.bits
        s = [[x] for x in state]
        e, x, y, z, a, b, c = s[:7]

        def product(u: Series, v: Series) -> int:
            return sum(map(operator.mul, u, reversed(v))) >> bits

        for k in range(self.order):
            rates = [
                (-product(x, a) - product(y, b) - product(z, c)) >> 1,
                (product(e, a) + product(y, c) - product(z, b)) >> 1,
                (product(e, b) - product(x, c) + product(z, a)) >> 1,
                (product(e, c) + product(x, b) - product(y, a)) >> 1,
            ]
            gyro = product(b, c), product(c, a), product(a, b)
            alpha = [self.factor[i] * gyro[i] - self.damping[i] * s[4 + i][k] >> bits for i in range(3)]
            if k == 0:
                alpha = [p + t for p, t in zip(alpha, self.torque, strict=True)]
            if self.heavy or any(self.push):
                ee, xx, yy, zz = (product(u, u) for u in (e, x, y, z))
                xz, ey, yz, ex = product(x, z), product(e, y), product(y, z), product(e, x)
                bottom = 2 * (xz - ey), 2 * (yz + ex), ee - xx - yy + zz
            if self.heavy:
                alpha = [p + (_dot(row, bottom) >> bits) for p, row in zip(alpha, self.lever, strict=True)]
            push = [0, 0, 0]
            if any(self.push):
                xy, ez = product(x, y), product(e, z)
                rows = (
                    (ee + xx - yy - zz, 2 * (xy - ez), 2 * (xz + ey)),
                    (2 * (xy + ez), ee - xx + yy - zz, 2 * (yz - ex)),
                )
                push = [_dot(row, self.push) >> bits for row in (*rows, bottom)]
            if k == 0:
                push = [p + g for p, g in zip(push, self.gravity, strict=True)]
            rates += [*alpha, *(s[10 + i][k] for i in range(3)), *push]
            for terms, rate in zip(s, rates, strict=True):
                terms.append((rate * h >> bits) // (k + 1))
        return s

    def at(self, series: list[Series], part: Fraction) -> list[int]:
        """Return the state at a part of the step."""
        p = self.fixed(part)
        values = [0] * len(series)
        for k in range(self.order, -1, -1):
            values = [(v * p >> self.bits) + terms[k] for v, terms in zip(values, series, strict=True)]
        return values

    def states(self, times: Sequence[Fraction]) -> list[list[int]]:
        """Return the states at ascending times."""
        state, now, found = self.start, Fraction(0), []
        step = Fraction(1, 4)
        while len(found) < len(times):
            series = self.series(state, self.fixed(step))
            if max(abs(terms[-1]) for terms in series) > self.smallest:
                step *= Fraction(4, 5)
                continue
            while len(found) < len(times) and times[len(found)] <= now + step:
                found.append(self.at(series, (times[len(found)] - now) / step))
            state, now = self.at(series, Fraction(1)), now + step
            if max(abs(terms[-1]) for terms in series) < self.smallest >> 16:
                step *= Fraction(5, 4)
        return found

    def numbers(self, state: Sequence[int]) -> list[Any]:
        """Return the state in numbers of mpmath."""
        return [mp.mpf(x) / (1 << self.bits) for x in state]


def _dot(a: Sequence[int], b: Sequence[int]) -> int:
    return sum(map(operator.mul, a, b))


def _cross(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _compose(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    e = a[0] * b[0] - sum(map(operator.mul, a[1:], b[1:]))
    return [e, *(a[0] * y + b[0] * x + c for x, y, c in zip(a[1:], b[1:], _cross(a[1:], b[1:]), strict=True))]


def _period(motion: Motion) -> Fraction:
    """Return the period of the body rates: where they come near their start again, then Newton's method."""
    grid = [Fraction(k, 20) for k in range(1, 800)]
    rates = [motion.numbers(state)[4:7] for state in motion.states(grid)]
    start = motion.numbers(motion.start)[4:7]
    apart = [float(mp.norm([x - y for x, y in zip(row, start, strict=True)])) for row in rates]
    near = next(k for k in range(1, len(apart) - 1) if apart[k] < 0.1 and apart[k - 1] > apart[k] < apart[k + 1])
    at, h = grid[near], Fraction(1, 1 << 40)
    slope = [x[1] for x in motion.series(motion.start, motion.fixed(h))[4:7]]
    direction = [mp.mpf(x) / (1 << motion.bits) / mp.mpf(h.numerator) * mp.mpf(h.denominator) for x in slope]
    for _ in range(9):
        now = motion.numbers(motion.states([at])[0])[4:7]
        ahead = sum((x - y) * d for x, y, d in zip(now, start, direction, strict=True)) / sum(d * d for d in direction)
        at -= Fraction(int(mp.nint(ahead * (1 << motion.bits))), 1 << motion.bits)
    return at


def _after_many_periods(motion: Motion, times: Sequence[Fraction]) -> list[list[Any]]:
    """States of a free body, without position, at times of many periods of its rates."""
    period = _period(motion)
    turn = _compose(motion.numbers(motion.states([period])[0])[:4], _conjugate(motion.numbers(motion.start)[:4]))
    half_angle, axis = mp.atan2(mp.norm(turn[1:]), turn[0]), [x / mp.norm(turn[1:]) for x in turn[1:]]
    found = []
    for time in times:
        periods = time // period
        state = motion.numbers(motion.states([time - periods * period])[0])
        angle = periods * half_angle
        turned = _compose([mp.cos(angle), *(mp.sin(angle) * x for x in axis)], state[:4])
        found.append([*turned, *state[4:7], mp.mpf(0), mp.mpf(0), mp.mpf(0)])
    return found


def _conjugate(q: Sequence[Any]) -> list[Any]:
    return [q[0], -q[1], -q[2], -q[3]]


def reference_motion(key: str, settings: Settings = USUAL) -> dict[str, list[list[str]]]:
    """Return the case's motion at its checkpoints, as texts of 40 digits."""
    scene = CASES[key].scene
    with mp.workdps(int(settings.bits * 0.302)):
        motion = Motion(scene, settings)
        times = [Fraction(scene.run.stop) * k / CHECKPOINTS for k in range(1, CHECKPOINTS + 1)]
        if key == "g":
            states = _after_many_periods(motion, times)
        else:
            states = [motion.numbers(state) for state in motion.states(times)]
        texts = [[mp.nstr(x, DIGITS, strip_zeros=False) for x in state] for state in states]
    parts = {"quaternion": slice(0, 4), "omega_b": slice(4, 7), "r_c": slice(7, 10)}
    return {name: [row[part] for row in texts] for name, part in parts.items()}


def main() -> None:
    """Write the file."""
    motions = {}
    for key, case in CASES.items():
        motions[key] = {"scene": case.scene.to_dict(), **reference_motion(key)}
        print(f"{key}: {case.scene.name}")
    text = json.dumps(
        {"written by": "examples/references/reference_motions.py", "motions": motions}, indent=1, ensure_ascii=False
    )
    REFERENCES.write_text(text + "\n")


if __name__ == "__main__":
    main()
