"""Rotations at which implementations lose digits, with random ones beside them. All are tuples of floats."""

import math
from functools import cache
from itertools import product

import numpy as np
from hypothesis import settings, strategies as st

from tests.support.references import exact
from tests.support.references.exact import mp

Tuple = tuple[float, ...]
SMALL = [1e-160, 1e-80, 1e-20, 1e-9, 1e-8, 1e-4]
AXES: list[Tuple] = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (0.6, 0.0, 0.8), (-0.6, 0.48, 0.64)]
# Angles of one rotation: small, around half a turn and beyond.
ANGLES = [0.0, *SMALL, 0.3, math.pi / 2, 3.0, *(math.pi - d for d in (1e-3, 1e-8, 1e-15)), math.pi]
BESIDE_POLE = [0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3]


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def of_all_sizes(
    r: np.random.Generator, low: float, high: float, shape: int | tuple[int, ...], base: float = 10.0
) -> np.ndarray:
    """Numbers from base^low to base^high, as many of each size, the same on every machine.

    Those of `base ** r.uniform(low, high)` are not: some of NumPy's powers have another last bit where the processor
    has AVX-512.
    """
    exponents = r.integers(round(low * math.log2(base)), round(high * math.log2(base)), shape)
    return np.ldexp(r.uniform(1.0, 2.0, shape), exponents)


def random_vectors(n: int, seed: int = 1) -> list[Tuple]:
    """Directions at random, lengths from 1e-3 to 1e3."""
    r = rng(seed)
    lengths = of_all_sizes(r, -3, 3, (n, 1))
    return [tuple(v) for v in (lengths * r.standard_normal((n, 3))).tolist()]


def random_quaternions(n: int, seed: int = 2) -> list[Tuple]:
    """Uniform over all rotations, unit to round-off."""
    q = rng(seed).standard_normal((n, 4))
    return [tuple(row) for row in (q / np.linalg.norm(q, axis=1, keepdims=True)).tolist()]


@cache
def rotation_vectors() -> list[Tuple]:
    """Every hard angle about every axis, rounded from exact ones."""
    return [
        exact.rounded(exact.scaled(mp.mpf(angle), exact.unit(exact.exact(axis))))
        for angle, axis in product(ANGLES, AXES)
    ]


@cache
def quaternions() -> list[Tuple]:
    """Those of `rotation_vectors` (both signs), half turns exactly, and both poles of all Euler sequences."""
    turns = [exact.rounded(exact.quaternion_from_rotvec(exact.exact(u))) for u in rotation_vectors()]
    half_turns = [(0.0, *axis) for axis in AXES]
    quarter = math.sqrt(0.5)
    poles = [(quarter, quarter, 0.0, 0.0), (quarter, 0.0, quarter, 0.0), (quarter, 0.0, 0.0, -quarter)]
    poles += [(0.5, 0.5, 0.5, 0.5), (0.5, -0.5, 0.5, 0.5), (0.5, 0.5, -0.5, 0.5), (0.5, 0.5, 0.5, -0.5)]
    return turns + [tuple(-x for x in q) for q in turns[::3]] + half_turns + poles


def rotation_matrices(qs: list[Tuple]) -> list[tuple[Tuple, ...]]:
    """The matrices of quaternions, rounded from exact ones."""
    return [exact.rounded(exact.matrix_from_quaternion(exact.exact(q))) for q in qs]


def euler_angles(name: str, n: int = 20, seed: int = 3) -> list[Tuple]:
    """Angles of a sequence: at random, at both poles and beside them, and small."""
    r = rng(seed)
    proper = name[0] == name[2]
    poles = (0.0, math.pi) if proper else (-math.pi / 2, math.pi / 2)
    middles = [pole + side * d for pole, side in zip(poles, (1.0, -1.0), strict=True) for d in BESIDE_POLE]
    cases = [(*r.uniform(-3.1, 3.1, 1), middle, *r.uniform(-3.1, 3.1, 1)) for middle in middles]
    cases += [tuple(r.uniform((-3.1, poles[0], -3.1), (3.1, poles[1], 3.1))) for _ in range(n)]
    small = [tuple(1e-9 * r.uniform(0.1, 1.0, 3) * r.choice([-1.0, 1.0], 3)) for _ in range(4)]
    cases += [] if proper else small
    return [tuple(map(float, case)) for case in cases]


# Hypothesis: the same examples in every run; the first call compiles, which is no fault of the example.
settings.register_profile("rbfmu", settings.get_profile("unhurried"), derandomize=True, max_examples=200)
settings.load_profile("rbfmu")

numbers = st.floats(-1e3, 1e3, allow_subnormal=False)
angles = st.floats(-7.0, 7.0, allow_subnormal=False)
any_vector = st.tuples(numbers, numbers, numbers)
any_angles = st.tuples(angles, angles, angles)


def _normalized(q: Tuple) -> Tuple:
    length = math.hypot(*q)
    return tuple(x / length for x in q)


_components = st.floats(-1.0, 1.0, allow_subnormal=False)
any_quaternion = (
    st.tuples(_components, _components, _components, _components)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(_normalized)
)
