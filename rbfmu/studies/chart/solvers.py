"""Solvers of differential equations by others, measured on the same cases, each set up as its users would do it.

All get the equations of motion from the case's graph. SciPy's solvers call a right-hand side that Numba compiled;
numbalsoda's are called from compiled code as well; heyoka.py gets the equations as its own expressions. One variant
of SciPy's LSODA calls a right-hand side written in NumPy.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from numba import carray, cfunc, njit

from rbfmu.formulas.graph import KNOWN, numbers_of
from rbfmu.formulas.source import function_of
from rbfmu.scene.scene import Scene
from rbfmu.studies.chart.cases import WHOLE, Case
from rbfmu.studies.chart.methods import Method, NotFeasibleError, Run, module, timer, tolerances
from rbfmu.studies.one_step import F
from rbfmu.types import Array

_fast: Callable[[F], F] = njit(error_model="numpy")
PutRates = Callable[[float, Array, Array], None]
"""A compiled function (t, f, y) that writes dy/dt into f."""
MAX_STEPS = 10**6
"""The largest number of steps between two outputs; the solvers' default limits are much lower."""


def _leaves(case: Case, states: Sequence[Any], time: Any) -> dict[str, Any]:
    """Return the graph's leaves by name: the expressions given for states and time, and the constants' values."""
    known = {str(row.value) for row in case.equations.motion.graph.operations if row.kind in ("place", "input")}
    there = [name for name in known if name.partition("[")[0] in case.general.kernels.BLOCKS]  # not unread constants
    values = {name: float(case.buffer[case.place(name)]) for name in there}
    return {**values, **dict(zip(case.states, states, strict=True)), "t": time}


def _put_rates_of(case: Case) -> PutRates:
    """Return the compiled function that writes the rates of the case's states."""
    begin, equations = case.scene.run.start, case.equations
    leaves = _leaves(case, [f"y[{i}]" for i in range(len(case.states))], f"(t + {begin!r})" if begin else "t")
    rates = [equations.rates[name] for name in case.states]
    return _put_rates_by(function_of("put_rates", equations.motion.graph, rates, leaves))


@cache
def _put_rates_by(text: str) -> PutRates:
    names = dict[str, Any]()
    exec(text, names)  # text that we generated, with nothing but numbers
    put: PutRates = names["put_rates"]
    return _fast(put)


@cache
def _rates(put: PutRates) -> Callable[[float, Array], Array]:
    """Return a compiled function of (t, y) that returns the same rates as a new array."""

    @_fast
    def rates(t: float, y: Array) -> Array:
        f = np.empty(len(y))
        put(t, f, y)
        return f

    return rates


def _compiled_rates(case: Case) -> Callable[[float, Array], Array]:
    return _rates(_put_rates_of(case))


def _numpy_rates(case: Case) -> Callable[[float, Array], list[float]]:
    """Return the right-hand side written in NumPy, as a user may write it."""
    (inverse_mass, M, M_inverse, arm, damping, is_free), loads = map(np.array, case.body), case.loads
    gravity_a, force_a, force_b, torque_a, torque_b = map(np.array, loads)

    def rates(t: float, state: Array) -> list[float]:
        (e, x, y, z), u, w = state[:4], state[1:4], state[4:7]
        R = np.array((
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - e * z), 2.0 * (x * z + e * y)),
            (2.0 * (x * y + e * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - e * x)),
            (2.0 * (x * z - e * y), 2.0 * (y * z + e * x), 1.0 - 2.0 * (x * x + y * y)),
        ))  # fmt: skip
        torque = torque_b + R.T @ torque_a + np.cross(arm, force_b + R.T @ force_a)
        alpha = M_inverse @ (torque - np.cross(w, M @ w) - damping * w)
        turned = [-0.5 * (u @ w), *(0.5 * (e * w + np.cross(u, w))), *alpha]
        if len(state) == 7:
            return turned
        return [*turned, *state[10:], *(is_free * gravity_a + inverse_mass * (force_a + R @ force_b))]

    return rates


Prepared = tuple[Array, float, Callable[[int], object]]
"""(Rows of the states at the start and at all outputs, evaluations of the right-hand side or NaN, a function that
solves k times)."""


def solver(
    name: str, prepare: Callable[[Case, float], Prepared], unfit: Callable[[Case], str] = lambda case: ""
) -> Method:
    """Return the method of a solver whose tolerance is varied; its equations may contain formulas.

    prepare: solves once at a tolerance, so that compiling is not timed; unfit: returns why a case does not suit, if so.
    """

    def run(case: Case, value: float) -> Run:
        rows, evaluations, repeat = prepare(case, value)
        return Run(case.motion_of(rows), timer(repeat), evaluations)

    return Method(
        name, "peer", "rtol = atol", lambda case, quick: tolerances(-2, -13, quick), run,
        lambda case: unfit(case) if case.states else "nothing is to be integrated", takes_formulas=True,
    )  # fmt: skip


def _solve_ivp(
    method: str, rates_of: Callable[[Case], Callable[[float, Array], object]], case: Case, value: float
) -> Prepared:
    """Prepare `scipy.integrate.solve_ivp` with a right-hand side that Numba compiled, or one written in NumPy."""
    solve, rates, y, times = module("scipy.integrate").solve_ivp, rates_of(case), case.integrated, case.times

    def once() -> Any:
        return solve(rates, (0.0, times[-1]), y, method, times, rtol=value, atol=value)

    first = once()
    if not first.success:
        raise NotFeasibleError(first.message)
    return first.y.T, float(first.nfev), lambda k: [once() for _ in range(k)]


def _not_in_numpy(case: Case) -> str:
    if case.scene.has_formulas:
        return "formulas are compiled"
    return "" if case.states in (WHOLE[:7], WHOLE) else "written for attitude and rates"


def _odeint(case: Case, value: float) -> Prepared:
    """Prepare `scipy.integrate.odeint`: LSODA, called once for all outputs, with a compiled right-hand side."""
    odeint = module("scipy.integrate").odeint
    y, times, rates = case.integrated, case.times, _compiled_rates(case)

    def once(full: bool = False) -> Any:
        limits = {"rtol": value, "atol": value, "mxstep": MAX_STEPS}
        return odeint(rates, y, times, full_output=full, tfirst=True, **limits)

    rows, told = once(True)
    if told["message"] != "Integration successful.":
        raise NotFeasibleError(told["message"])
    return rows, float(told["nfe"][-1]), lambda k: [once() for _ in range(k)]


@cache
def _callback(put: PutRates, n: int) -> Any:
    """Return numbalsoda's right-hand side for n states."""

    @cfunc(module("numbalsoda").lsoda_sig)  # type: ignore[untyped-decorator]
    def rates(t: float, y: Any, f: Any, data: Any) -> None:
        put(t, carray(f, (n,)), carray(y, (n,)))

    return rates


@cache
def _solver_of(method: str) -> Callable[[int, Array, Array, float, int], tuple[Array, bool]]:
    """Return a compiled function that solves k times by a method of numbalsoda and returns the last solution."""
    solve = getattr(module("numbalsoda"), method)

    @_fast
    def solved(address: int, y: Array, times: Array, tolerance: float, k: int) -> tuple[Array, bool]:
        for _ in range(k):
            rows, success = solve(address, y, times, np.zeros(1), tolerance, tolerance, MAX_STEPS)
        return rows, success

    return solved


def _numbalsoda(method: str, case: Case, value: float) -> Prepared:
    """Prepare numbalsoda's LSODA or DOP853, called from a compiled loop."""
    y, times = case.integrated, case.times
    solved, address = _solver_of(method), _callback(_put_rates_of(case), len(y)).address
    rows, success = solved(address, y, times, value, 1)
    if not success:
        raise NotFeasibleError("numbalsoda gave up")
    return rows, math.nan, lambda k: solved(address, y, times, value, k)


# heyoka.py: Taylor series with dense output, compiled by LLVM for the equations of one body


def _heyoka(case: Case, value: float) -> Prepared:
    """Prepare `taylor_adaptive`, compiled once per motion and tolerance; its series are evaluated at the outputs."""
    y, grid = case.integrated, case.times
    series = _integrator(case.scene, value)
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
    """Return why heyoka.py cannot be used, if formulas have corners or tables; else nothing."""
    graph = case.equations.motion.graph
    corners = any(graph.operations[i].kind == "side" for i in graph.reached(case.equations.rates.values()))
    return "formulas have corners or tables, over which its series would go on" if corners else ""


@cache
def _integrator(scene: Scene, tolerance: float) -> Any:
    """Return a compiled integrator; its state must still be set."""
    system = equations(Case(scene))
    return module("heyoka").taylor_adaptive(system, [0.0] * len(system), tol=tolerance)


def equations(case: Case, known: Mapping[str, Any] = {}) -> list[tuple[Any, Any]]:
    """Return heyoka.py's (variable, rate) of each state; known: expressions for numbers of the scene, by name."""
    heyoka = module("heyoka")
    variables = [heyoka.make_vars(f"y{i}") for i in range(len(case.states))]
    leaves = _leaves(case, variables, heyoka.time + case.scene.run.start) | dict(known)
    ends = [case.equations.rates[name] for name in case.states]
    rates = numbers_of(case.equations.motion.graph, ends, leaves, heyoka_functions(heyoka))
    return list(zip(variables, map(heyoka.expression, rates), strict=True))


def heyoka_functions(heyoka: Any) -> dict[str, Callable[..., Any]]:
    """Return the graph's operations for expressions of heyoka.py; if all arguments are numbers, they are evaluated."""
    theirs = {name: getattr(heyoka, name) for name in ("sqrt", "sin", "cos", "exp", "log")}
    theirs |= {"atan2": lambda y, x, _: heyoka.atan2(y, x), "power": lambda x, exponent: x**exponent}
    theirs |= {"logistic": lambda x, _: heyoka.sigmoid(x)}

    def choose(kind: str) -> Callable[..., Any]:
        def operation(*of: Any) -> Any:
            return KNOWN[kind](*of) if all(isinstance(x, float) for x in of) else theirs[kind](*of)

        return operation

    return {**KNOWN, **{kind: choose(kind) for kind in theirs}}


# The solvers


SCIPY = (
    *(solver(f"SciPy {m}", partial(_solve_ivp, m, _compiled_rates)) for m in ("DOP853", "RK45", "LSODA")),
    solver("SciPy LSODA, NumPy", partial(_solve_ivp, "LSODA", _numpy_rates), _not_in_numpy),
    solver("SciPy odeint", _odeint),
)
NUMBALSODA = tuple(solver(f"numbalsoda {m.upper()}", partial(_numbalsoda, m)) for m in ("lsoda", "dop853"))
HEYOKA = solver("heyoka.py", _heyoka, _no_corners)
HEYOKA.setting = "tol"
HEYOKA.settings = lambda case, quick: iter([*tolerances(-2, -15, False)][:: 6 if quick else 2])
"""Powers of ten alone: each tolerance takes seconds to compile, as it determines the order of the series."""
