"""Other people's solvers of differential equations on the same cases, set up as their own users would.

SciPy's solvers call a right-hand side that Numba compiled; numbalsoda's are called from compiled code themselves.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import islice
from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from rbfmu.formulas.graph import KNOWN, Number, numbers_of
from rbfmu.formulas.source import function_of
from rbfmu.scene.scene import Scene
from rbfmu.studies.chart.cases import ALL, PATH, PLACES, RATES, ROTATION, Case, FormulaCase, kind_of_case
from rbfmu.studies.chart.methods import Method, NotFeasibleError, Run, module, timer, tolerances
from rbfmu.studies.one_step import F
from rbfmu.types import Array
from rbfmu_kernels.body.memory import body_of, loads_of, motion_of
from rbfmu_kernels.mechanics.equations_of_motion import Body, Loads, State, state_rates

_fast: Callable[[F], F] = njit(error_model="numpy")
PutRates = Callable[[float, Array, Array, Array], None]
"""A compiled function of the time, of where the rates are put, of the numbers, and of the model's buffer."""
MAX_STEPS = 10**6
"""The largest number of steps between two outputs; the solvers' default limits are much lower."""


@_fast
def put_rates(t: float, f: Array, y: Array, z: Array) -> None:
    """Put d/dt of the numbers y into f, for the body of a model's buffer z, from where the rest of the state is taken.

    The numbers are those of `cases.RATES`, `PATH`, `ROTATION` or `ALL`.
    """
    n = len(y)
    r, v, q, omega = motion_of(z)
    if n == RATES:
        omega = (y[0], y[1], y[2])
    if n >= ROTATION:
        q, omega = (y[0], y[1], y[2], y[3]), (y[4], y[5], y[6])
    if n in (PATH, ALL):
        v = (y[n - 3], y[n - 2], y[n - 1])
    dr, dv, dq, dw = state_rates(State(r, v, q, omega), body_of(z), loads_of(z))
    if n == RATES:
        f[0], f[1], f[2] = dw
    if n >= ROTATION:
        f[0], f[1], f[2], f[3] = dq
        f[4], f[5], f[6] = dw
    if n in (PATH, ALL):
        f[n - 6], f[n - 5], f[n - 4] = dr
        f[n - 3], f[n - 2], f[n - 1] = dv


@cache
def _put_rates_of(case: Case) -> PutRates:
    """Return what puts the rates of the case's numbers: that above, or one that is made from its formulas."""
    if not isinstance(case, FormulaCase):
        return put_rates
    begin, names = case.scene.run.start, dict[str, Any]()
    leaves = _leaves(case, [f"y[{i}]" for i in range(case.numbers)], f"(t + {begin!r})" if begin else "t")
    exec(function_of("put_rates", case.formulas.motion.graph, _rates_in_graph(case), leaves), names)  # our own text
    put: PutRates = names["put_rates"]
    return _fast(put)


def _rates_in_graph(case: FormulaCase) -> list[Number]:
    """Return the rates of the numbers that are integrated, as symbols of the graph of the formulas."""
    return [case.formulas.rates[name] for name in case.names_of_states]


def _leaves(case: FormulaCase, states: Sequence[Any], time: Any) -> dict[str, Any]:
    """Return what stands for states and time in the graph, and the values of all that stays as it is at the start."""
    known = {str(row.value) for row in case.formulas.motion.graph.operations if row.kind in ("place", "input")}
    values = {name: float(case.buffer[case.formulas.place(name)]) for name in known}
    return {**values, **dict(zip(case.names_of_states, states, strict=True)), "t": time}


@cache
def _rates(put: PutRates) -> Callable[[float, Array, Array], Array]:
    """Return the same rates as a new array."""

    @_fast
    def rates(t: float, y: Array, z: Array) -> Array:
        f = np.empty(len(y))
        put(t, f, y, z)
        return f

    return rates


def rates_in_numpy(body: Body, loads: Loads, q: Any, w: Any) -> tuple[Any, Any, Any]:
    """Return d/dt of q_ab, omega_b and v_c, of arrays as users write them; of numbers, or of expressions of others."""
    (e, x, y, z), u = q, q[1:]
    R = np.array((
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - e * z), 2.0 * (x * z + e * y)),
        (2.0 * (x * y + e * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - e * x)),
        (2.0 * (x * z - e * y), 2.0 * (y * z + e * x), 1.0 - 2.0 * (x * x + y * y)),
    ))  # fmt: skip
    torque = loads.torque_b + R.T @ loads.torque_a + np.cross(body.arm_b, loads.force_b + R.T @ loads.force_a)
    turning = torque - np.cross(w, np.array(body.inertia) @ w) - np.array(body.damping_b) * w
    dq = [-0.5 * (u @ w), *(0.5 * (e * w + np.cross(u, w)))]
    dv = body.is_free * np.array(loads.gravity_a) + body.inverse_mass * (loads.force_a + R @ loads.force_b)
    return dq, np.array(body.inertia_inverse) @ turning, dv


def _numpy_rates(case: Case) -> Callable[[float, Array], list[float]]:
    body, loads = Body._make(map(np.array, case.body)), Loads._make(map(np.array, case.loads))

    def rates(t: float, y: Array) -> list[float]:
        dq, dw, dv = rates_in_numpy(body, loads, y[:4], y[4:7])
        return [*dq, *dw] if len(y) == ROTATION else [*dq, *dw, *y[10:], *dv]

    return rates


Prepared = tuple[Array, float, Callable[[int], object]]
"""Rows of the numbers integrated, at the start and at all outputs; evaluations; and what solves k times."""


def solver(name: str, prepare: Callable[[Case, float], Prepared], unfit: Callable[[Case], str] | None = None) -> Method:
    """Return a solver whose tolerance is varied, of any equations: also of those that formulas give.

    prepare: solves once at a tolerance; what compiles or looks up is done before.
    """

    def run(case: Case, value: float) -> Run:
        rows, evaluations, repeat = prepare(case, value)
        return Run(case.motion_of(rows), timer(repeat), evaluations)

    def why_not(case: Case) -> str:
        if isinstance(case, FormulaCase) and not case.numbers:
            return "nothing is to be integrated"
        return unfit(case) if unfit else ""

    return Method(name, "peer", "rtol = atol", _tolerances, run, why_not, takes_formulas=True)


def _tolerances(case: Case, quick: bool) -> Iterator[float]:
    return tolerances(-2, -13, quick)


def _compiled_rates(case: Case) -> Callable[[float, Array], Array]:
    rates, z = _rates(_put_rates_of(case)), case.buffer
    return lambda t, y: rates(t, y, z)


def _solve_ivp(
    method: str, rates_of: Callable[[Case], Callable[[float, Array], object]], case: Case, value: float
) -> Prepared:
    """Prepare `scipy.integrate.solve_ivp` with right-hand sides that are compiled with Numba, or written in NumPy."""
    solve, rates, y, times = module("scipy.integrate").solve_ivp, rates_of(case), case.integrated, case.times

    def once() -> Any:
        return solve(rates, (0.0, times[-1]), y, method, times, rtol=value, atol=value)

    first = once()
    if not first.success:
        raise NotFeasibleError(first.message)
    return first.y.T, float(first.nfev), lambda k: [once() for _ in range(k)]


def _not_in_numpy(case: Case) -> str:
    if isinstance(case, FormulaCase):
        return "formulas are compiled"
    return "written for attitude and rates" if case.numbers < ROTATION else ""


def _odeint(case: Case, value: float) -> Prepared:
    """Prepare `scipy.integrate.odeint`: LSODA, called once for all outputs, its right-hand side compiled with Numba."""
    odeint = module("scipy.integrate").odeint
    y, times, more, rates = case.integrated, case.times, (case.buffer,), _rates(_put_rates_of(case))

    def once(full: bool = False) -> Any:
        limits = {"rtol": value, "atol": value, "mxstep": MAX_STEPS}
        return odeint(rates, y, times, more, full_output=full, tfirst=True, **limits)

    rows, told = once(True)
    if told["message"] != "Integration successful.":
        raise NotFeasibleError(told["message"])
    return rows, float(told["nfe"][-1]), lambda k: [once() for _ in range(k)]


@cache
def _callback(put: PutRates, n: int, size: int) -> Any:
    """Return numbalsoda's right-hand side for n states and a buffer of a size."""

    @cfunc(module("numbalsoda").lsoda_sig)  # type: ignore[untyped-decorator]
    def rates(t: float, y: Any, f: Any, z: Any) -> None:
        put(t, carray(f, (n,)), carray(y, (n,)), carray(z, (size,)))

    return rates


@cache
def _solved(method: str) -> Callable[[int, Array, Array, Array, float, int], tuple[Array, bool]]:
    """Return a compiled function that solves k times by a method of numbalsoda and returns the last solution."""
    solve = getattr(module("numbalsoda"), method)

    @_fast
    def solved(address: int, y: Array, times: Array, z: Array, tolerance: float, k: int) -> tuple[Array, bool]:
        for _ in range(k):
            rows, success = solve(address, y, times, z, tolerance, tolerance, MAX_STEPS)
        return rows, success

    return solved


def _numbalsoda(method: str, case: Case, value: float) -> Prepared:
    """Prepare numbalsoda's LSODA or DOP853, called from a compiled loop."""
    y, times, z = case.integrated, case.times, case.buffer
    solved, address = _solved(method), _callback(_put_rates_of(case), len(y), len(z)).address
    rows, success = solved(address, y, times, z, value, 1)
    if not success:
        raise NotFeasibleError("numbalsoda gave up")
    return rows, math.nan, lambda k: solved(address, y, times, z, value, k)


# heyoka.py: Taylor series that LLVM compiles, with dense output, for the equations of one body


def _heyoka(case: Case, value: float) -> Prepared:
    """Prepare `taylor_adaptive`, compiled once for a motion and tolerance; its series are evaluated at outputs."""
    y, grid = case.integrated, case.times
    series = _integrator(case.scene, case.numbers, value)
    success = module("heyoka").taylor_outcome.time_limit

    def once() -> Any:
        series.time = 0.0
        series.state[:] = y
        return series.propagate_grid(grid)

    outcome, *_, rows = once()
    if outcome != success:
        raise NotFeasibleError(str(outcome))
    return rows, math.nan, lambda k: [once() for _ in range(k)]


def _no_corners(case: Case) -> str:
    corners = isinstance(case, FormulaCase) and case.has_corners
    return "formulas have corners or tables, over which its series would go on" if corners else ""


@cache
def _integrator(scene: Scene, numbers: int, tolerance: float) -> Any:
    """Return an integrator, whose state is still to be set."""
    system = equations(kind_of_case(scene)(scene), numbers)
    return module("heyoka").taylor_adaptive(system, [0.0] * numbers, tol=tolerance)


def equations(case: Case, numbers: int) -> list[tuple[Any, Any]]:
    """Return (variable, rate) of the numbers that are integrated: see `cases.RATES`, `PATH`, `ROTATION`, `ALL`.

    Zeros cost nothing: heyoka.py drops terms and factors that are zero before it compiles.
    """
    if isinstance(case, FormulaCase):
        return _equations_of_formulas(case, module("heyoka"))
    sizes = {"q": 4, "w": 3, "r": 3, "v": 3}
    q, w, r, v = (np.array(module("heyoka").make_vars(*(f"{x}{i}" for i in range(n)))) for x, n in sizes.items())
    turned = q if numbers >= ROTATION else np.array(case.start.q_ab)
    dq, dw, dv = rates_in_numpy(case.body, case.loads, turned, w)
    rates = (*dq, *dw, *v, *(dv + 0.0 * v))  # no number alone is a right-hand side
    return list(zip((*q, *w, *r, *v), rates, strict=True))[PLACES[numbers]]


def _equations_of_formulas(case: FormulaCase, heyoka: Any) -> list[tuple[Any, Any]]:
    variables = [heyoka.make_vars(f"y{i}") for i in range(case.numbers)]
    leaves = _leaves(case, variables, heyoka.time + case.scene.run.start)
    rates = numbers_of(case.formulas.motion.graph, _rates_in_graph(case), leaves, heyoka_functions(heyoka))
    return list(zip(variables, map(heyoka.expression, rates), strict=True))


def heyoka_functions(heyoka: Any) -> dict[str, Callable[..., Any]]:
    """Return the operations on expressions of heyoka.py; of numbers alone they are known."""
    theirs = {name: getattr(heyoka, name) for name in ("sqrt", "sin", "cos", "exp", "log")}
    theirs |= {"atan2": lambda y, x, _: heyoka.atan2(y, x), "power": lambda x, exponent: x**exponent}

    def chosen(kind: str) -> Callable[..., Any]:
        def operation(*of: Any) -> Any:
            return KNOWN[kind](*of) if all(isinstance(x, float) for x in of) else theirs[kind](*of)

        return operation

    return {**KNOWN, **{kind: chosen(kind) for kind in theirs}}


# The solvers


SCIPY = (
    *(solver(f"SciPy {m}", partial(_solve_ivp, m, _compiled_rates)) for m in ("DOP853", "RK45", "LSODA")),
    solver("SciPy LSODA, NumPy", partial(_solve_ivp, "LSODA", _numpy_rates), _not_in_numpy),
    solver("SciPy odeint", _odeint),
)
NUMBALSODA = tuple(solver(f"numbalsoda {m.upper()}", partial(_numbalsoda, m)) for m in ("lsoda", "dop853"))
HEYOKA = replace(
    solver("heyoka.py", _heyoka, _no_corners),
    setting="tol",
    settings=lambda case, quick: islice(tolerances(-2, -15, False), 0, None, 6 if quick else 2),
)
"""At powers of ten, each of which takes seconds to compile, since it determines the order."""
