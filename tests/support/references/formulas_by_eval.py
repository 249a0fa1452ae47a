"""Motions under texts as loads, in 120 bits or in doubles, by extrapolation between corners: nothing of this package.

Python's own `eval` reads the texts. What has a corner keeps its side over a step; a step over which one changes is cut
where it does (Gragg, Bulirsch and Stoer; Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.9).
"""

import ast
import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

MOST_CORNERS, MOST_STEPS = 400, 1000
FUNCTIONS = ("sin", "cos", "tan", "asin", "atan2", "exp", "log", "sqrt")


class Arithmetic(NamedTuple):
    """Functions and numbers; a step's error; s by which corners are missed, and after which sides are looked at."""

    functions: Any
    number: Callable
    exact: float
    beside: float


def in_120_bits():
    """Numbers of gmpy2, or of mpmath, which are some ten times slower."""
    try:
        import gmpy2
    except ImportError:
        from mpmath.ctx_mp import MPContext

        context = MPContext()
        context.prec = 120
        return Arithmetic(context, context.mpf, 1e-18, 1e-14)
    gmpy2.get_context().precision = 120
    return Arithmetic(gmpy2, gmpy2.mpfr, 1e-18, 1e-14)


DOUBLES, BITS_120 = Arithmetic(math, float, 1e-13, 1e-10), in_120_bits()


class NoTruthError(ArithmeticError):
    """A motion that comes from corner to corner without end, or turns too fast to be followed."""


class V(tuple):
    """A vector, or a matrix of rows, whose indices count from 1."""

    def __getitem__(self, index):
        if isinstance(index, tuple):
            return self[index[0]][index[1]]
        return tuple.__getitem__(self, index - 1)

    def __add__(self, other):
        return V(map(lambda x, y: x + y, self, other))

    def __sub__(self, other):
        return V(map(lambda x, y: x - y, self, other))

    def __mul__(self, factor):
        return V(x * factor for x in self)

    __rmul__ = __mul__

    def __truediv__(self, other):
        return V(x / other for x in self)

    def __neg__(self):
        return V(-x for x in self)

    def __matmul__(self, other):
        return V(dot(row, other) for row in self)


def dot(a, b):
    return sum(map(lambda x, y: x * y, a, b))


def cross(a, b):
    (x, y, z), (u, v, w) = a, b
    return V((y * w - z * v, z * u - x * w, x * v - y * u))


def transposed(matrix):
    return V(map(V, zip(*matrix, strict=True)))


def inverse(matrix):
    a, b, c = matrix
    return transposed(V((cross(b, c), cross(c, a), cross(a, b))) / dot(a, cross(b, c)))


def turned(q):
    """R_ab of a quaternion."""
    w, x, y, z = V(q) / dot(q, q) ** 0.5
    return V((V((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w))),
              V((2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w))),
              V((2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)))))  # fmt: skip


class Read(ast.NodeTransformer):
    """Lists as vectors, comparisons as a function."""

    def visit_List(self, node):
        self.generic_visit(node)
        return ast.Call(ast.Name("V", ast.Load()), [node], [])

    def visit_Compare(self, node):
        self.generic_visit(node)
        (above,) = [isinstance(one, ast.Gt) for one in node.ops]
        assert above, "the grammar draws no other comparison"
        return ast.Call(ast.Name("above", ast.Load()), [node.left, *node.comparators], [])

    @classmethod
    def text(cls, text):
        return compile(ast.fix_missing_locations(cls().visit(ast.parse(text, mode="eval"))), text, "eval")


class Corners:
    """What has a corner, in the order in which it is evaluated: where it is, and its side over a step."""

    def __init__(self, least):
        """least: what counts as zero, as numbers that are zero but for round-off would change sides all the time."""
        self.least, self.free, self.found, self.sides, self.ways = least, True, [], [], []

    def side(self, x):
        """1 or -1 for x, kept over a step."""
        k = len(self.found)
        self.found.append(0 if abs(x) < self.least else x)
        return (1 if x >= 0 else -1) if self.free else self.sides[k]

    def norm(self, v):
        """The length, which is negative behind a corner at zero: there v points against the way that it did."""
        k, length = len(self.found), dot(v, v) ** 0.5
        self.ways = self.ways if k < len(self.ways) else [*self.ways, *[None] * (k + 1 - len(self.ways))]
        if self.free:
            self.ways[k] = v
        ahead = dot(v, self.ways[k])
        self.found.append(0 if length < self.least else ahead)
        return length if ahead >= 0 else -length

    def abs(self, x):
        return x if self.side(x) > 0 else -x

    def min(self, a, b):
        return a if self.side(b - a) > 0 else b

    def max(self, a, b):
        return a if self.side(a - b) > 0 else b

    def table(self, rows, x):
        knots, values, bends = rows
        after = [self.side(x - knot) > 0 for knot in knots].count(True)
        if after in (0, len(knots)):
            return values[after and -1]
        a, b, h = x - knots[after - 1], knots[after] - x, knots[after] - knots[after - 1]
        line = (b * values[after - 1] + a * values[after]) / h
        return line + (b * (b * b / h - h) * bends[after - 1] + a * (a * a / h - h) * bends[after]) / 6

    @property
    def names(self):
        return {"abs": self.abs, "min": self.min, "max": self.max, "norm": self.norm, "table": self.table,
                "clip": lambda x, low, high: self.min(self.max(x, low), high),
                "above": lambda x, y: self.side(x - y) > 0, "where": lambda c, a, b: a if c else b}  # fmt: skip


def rows_of(table, number):
    """Knots, values and second derivatives: zero of straight lines, of a natural spline through three points."""
    x, y = (list(map(number, table[key])) for key in ("x", "y"))
    if "method" not in table:
        return x, y, [0] * len(x)
    (h, k), (a, b, c) = (x[1] - x[0], x[2] - x[1]), y
    return x, y, [0, 3 * ((c - b) / k - (b - a) / h) / (h + k), 0]


class Motion:
    """The motion of a drawn scene's tables."""

    def __init__(self, tables, arithmetic=BITS_120):
        self.functions, self.number, self.error, self.beside = arithmetic
        body, number = tables["body"], self.number
        self.pivot, self.m, self.arm = body.get("pivot", False), number(body["mass"]), self.exact(body["r_oc_b"])
        self.M_c = V(map(self.exact, body["inertia"]))
        r, m = self.arm, self.m if self.pivot else number(0)
        far = lambda i, j: m * ((dot(r, r) if i == j else 0) - r[i] * r[j])  # noqa: E731
        self.M = V(V(self.M_c[i, j] + far(i, j) for j in (1, 2, 3)) for i in (1, 2, 3))
        self.M_inverse = inverse(self.M)
        self.gravity = self.exact(tables["loads"]["gravity_a"])
        self.damping = self.exact(tables["loads"]["damping_b"])
        self.loads = {name: Read.text(text) for name, text in tables["loads"].items() if isinstance(text, str)}
        own = tables.get("states", {})
        self.own = [Read.text(row["rate"]) for row in own.values()]
        self.corners, self.at_corners = Corners(0.01 * self.error), []
        self.names = {name: getattr(self.functions, name) for name in FUNCTIONS}
        self.names |= {"V": V, "dot": dot, "cross": cross, "M_c": self.M_c, **self.corners.names}
        self.names |= {name: number(value) for name, value in tables["constants"].items()}
        self.names |= {name: rows_of(table, number) for name, table in tables["tables"].items()}
        self.y = self.start(tables["initial"], [row["start"] for row in own.values()])

    def exact(self, values):
        return V(map(self.number, values))

    def start(self, initial, own):
        q, w = self.exact(initial["attitude"]["quaternion"]), self.exact(initial["omega_b"])
        q, zero = q / dot(q, q) ** 0.5, [0.0] * 3
        R = turned(q)
        r_c = self.exact(initial.get("position", zero)) + R @ self.arm
        v_c = self.exact(initial.get("velocity", zero)) + R @ cross(w, self.arm)
        more = [self.number(x) for start in own for x in (start if isinstance(start, list) else [start])]
        return [*q, *w, *r_c, *v_c, *more]

    def place(self, y):
        """Position and velocity of o, and R_ab."""
        R, zero = turned(y[:4]), self.exact([0.0] * 3)
        if self.pivot:
            return zero, zero, R
        return V(y[7:10]) - R @ self.arm, V(y[10:13]) - R @ cross(V(y[4:7]), self.arm), R

    def rates(self, t, y):
        """The derivatives of the states; what has corners is noted in `corners`."""
        q, w, own, (p, v, R) = V(y[:4]), V(y[4:7]), y[13:], self.place(y)
        Rt, zero = transposed(R), self.exact([0.0] * 3)
        q = q / dot(q, q) ** 0.5
        self.corners.found = []
        names = self.names | {"t": t, "omega_b": w, "omega_a": R @ w, "position": p, "velocity": v, "R_ab": R,
                              "q_ab": q, "to_a": lambda x: R @ x, "to_b": lambda x: Rt @ x}  # fmt: skip
        names |= {"u": own[0], "w": V(own[1:4])} if own else {}
        acting = {name: eval(code, names) for name, code in self.loads.items()}
        more = [eval(code, names) for code in self.own]
        more = [*more[:1], *(x for vector in more[1:] for x in vector)]  # u, w
        force = acting.get("force_b", zero) + Rt @ acting.get("force_a", zero)
        torque = acting.get("torque_b", zero) + Rt @ acting.get("torque_a", zero)
        torque = torque - V(map(lambda d, x: d * x, self.damping, w))
        torque += cross(self.arm, Rt @ (self.m * self.gravity)) if self.pivot else -cross(self.arm, force)
        path = [*zero, *zero] if self.pivot else [*y[10:13], *(self.gravity + R @ force / self.m)]
        a, x, y, z = q
        turn = [-x * w[1] - y * w[2] - z * w[3], a * w[1] + y * w[3] - z * w[2],
                a * w[2] + z * w[1] - x * w[3], a * w[3] + x * w[2] - y * w[1]]  # fmt: skip
        return [*(0.5 * x for x in turn), *(self.M_inverse @ (torque - cross(w, self.M @ w))), *path, *more]

    def settle(self, t, y):
        """Take the sides that the motion leads to."""
        corners = self.corners
        for _ in range(2):
            corners.free = True
            self.rates(t, y)
            corners.sides, corners.free = [1 if x >= 0 else -1 for x in corners.found], False
            beside = _ahead(y, self.beside, self.rates(t, y))
            corners.free = True
            self.rates(t + self.beside, beside)
            corners.sides, corners.free = [1 if x >= 0 else -1 for x in corners.found], False

    def crossed(self):
        """What is not on its side."""
        return [k for k, side in enumerate(self.corners.sides) if self.corners.found[k] * side < 0]

    def step(self, t, y, h):
        """The states after h, and when something was first seen on its other side, or None; None: not exact."""
        table, f = [], self.rates(t, y)
        for n in range(2, 24, 2):
            d, before, now, first = h / n, y, _ahead(y, h / n, f), None
            for k in range(1, n):
                rates = self.rates(t + k * d, now)
                first = k * d if first is None and self.crossed() else first
                before, now = now, _ahead(before, 2 * d, rates)
            row = [now]
            for k, last in enumerate(table[-1] if table else [], 1):
                part = (self.number(n) / (n - 2 * k)) ** 2 - 1
                row.append([x + (x - z) / part for x, z in zip(row[-1], last, strict=True)])
            table.append(row)
            if n > 2 and max(abs(x - z) / (1 + abs(x)) for x, z in zip(row[-1], row[-2], strict=True)) < self.error:
                self.rates(t + h, row[-1])
                return row[-1], h if first is None and self.crossed() else first
        return None

    def corner(self, t, y, h):
        """How long until something has just gone to its other side, as it has after h."""
        while True:
            low, h = self.root(t, y, h, self.crossed()[0])
            self.step(t, y, low)  # whether something else has gone before
            if low == 0 or not self.crossed():
                return h
            h = low

    def root(self, t, y, h, one):
        """Two times side by side between which one goes to its other side: by turns the middle, and along a line."""
        value = lambda: self.corners.found[one] * self.corners.sides[one]  # noqa: E731
        low, high, below = self.number(0), h, value()
        self.rates(t, y)
        above, kept = max(value(), self.number(1e-40)), 0
        for k in itertools.count():
            if high - low < self.error:
                return low, high
            at = (low + high) / 2 if k % 2 else low + (high - low) * above / (above - below)
            at = min(max(at, low + self.error / 3), high - self.error / 3)
            self.step(t, y, at)
            if value() < 0:
                high, below, above, kept = at, value(), above / 2 if kept < 0 else above, -1
            else:
                low, above, below, kept = at, value(), below / 2 if kept > 0 else below, 1
        raise AssertionError

    def states_at(self, start, times):
        """Yield the states at increasing times after the start."""
        t, y, start, steps = self.number(0), self.y, self.number(start), 0
        self.settle(start, y)
        for end in times:
            h = end - t
            while t < end:
                steps += 1
                if steps > MOST_STEPS or len(self.at_corners) > MOST_CORNERS:
                    raise NoTruthError
                h = min(h, end - t)
                found = self.step(start + t, y, h)
                if found is None or (found[1] is not None and 1e-9 < found[1] < h):
                    h = h / 2 if found is None else found[1]
                    continue
                if found[1] is not None and self.crossed():
                    h = self.corner(start + t, y, h)
                    found = self.step(start + t, y, h)
                    self.at_corners.append(t + h)
                t, y = t + h, found[0]
                self.settle(start + t, y)
                h = 2 * h
            yield y

    def rows(self, start, times):
        """Quaternion, omega_b and position at increasing times after the start, as arrays."""
        found = [[y[:4], y[4:7], self.place(y)[0]] for y in self.states_at(start, times)]
        columns = (np.array([[float(x) for x in one] for one in column]) for column in zip(*found, strict=True))
        return dict(zip(("quaternion", "omega_b", "position"), columns, strict=True))


def _ahead(y, h, rates):
    return [x + h * f for x, f in zip(y, rates, strict=True)]
