"""Models of one scene's formulas: templates of `formulas` bound to generated kernels and to places of a buffer."""

from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any

from ..body.shell import Lanes, Model, bind, initialize, step
from ..compile.simd import eight_wide, four_wide
from . import formula_events, formula_lanes, formula_variations, formulas

Layout = tuple[dict[str, slice], int]
Kernels = Mapping[str, Callable[..., Any]]
_HOME = formulas.__name__
"""The module of all that is bound."""
_TEMPLATES = {one.__name__ for one in (formula_events, formula_lanes, formula_variations, formulas)}
"""The modules whose functions are templates."""


def _bound(template: Callable[..., Any], constant: str, own: dict[str, Any]) -> Any:
    """Return a template's kernel, with own as its globals; the templates that it calls are bound before, and put there.

    constant: a name that no other scene's kernels have.
    """
    assert isinstance(template, FunctionType)
    for name in template.__code__.co_names:
        called = template.__globals__.get(name)
        if isinstance(called, FunctionType) and called.__module__ in _TEMPLATES and name not in own:
            own[name] = _bound(called, constant, own)
    return bind(template, _HOME, constant, **own)


def make_formulas(constant: str, layout: Layout, generated: Kernels, places: Mapping[str, Any]) -> Model:
    """Return the model of one scene's formulas.

    constant: a name that no other scene's formulas have; generated: its kernels, by name; places: what the templates'
    globals are.
    """
    own = {**places, **generated}
    advance = _bound(formulas.advance_formulas, constant, own)
    set_up = _bound(formulas.set_up_formulas, constant, own)
    return Model(
        f"formulas.{constant}",
        *layout,
        initialize=bind(initialize, _HOME, constant, set_up=set_up),
        step=bind(step, _HOME, constant, advance=advance),
        outputs=_bound(formulas.outputs_now, constant, own),
        feedthrough=generated["feedthrough"],
        ORDERS=formulas.ORDERS,
    )


def make_over(constant: str, base: Model, layout: Layout, generated: Kernels, places: Mapping[str, Any]) -> Model:
    """Return the model of own outputs over a closed form, whose blocks the layout begins with; else as above."""
    own = {**places, **generated, "begin": base.initialize, "advance": base.step, "refresh": base.outputs}
    return Model(
        f"formulas.{constant}",
        *layout,
        initialize=_bound(formulas.initialize_over, constant, own),
        step=_bound(formulas.step_over, constant, own),
        outputs=_bound(formulas.outputs_over, constant, own),
        output_rates=base.output_rates,
        feedthrough=generated["feedthrough"],
    )


def make_lanes(model: Model, own: Mapping[str, Any], constant: str, wide: Mapping[str, Any]) -> Lanes:
    """Return what runs many bodies of a model at once.

    own: the kernels and places that `make_formulas` was given; constant: a name that no others have; wide: the kernels
    of series over numbers of several bodies, by name, and WIDE_ROW, the length of a row there.
    """
    found = {**own}
    _bound(formulas.advance_formulas, model.name.partition(".")[2], found)  # what steps call, which lanes call too
    found |= {**wide, "initialize": model.initialize}
    in_four, in_eight = (
        _bound(formula_lanes.run_in_lanes, f"{constant}_{width}", found | {"wide": numbers})
        for width, numbers in ((4, four_wide), (8, eight_wide))
    )
    scratch = own["ROWS"] + wide["WIDE_ROW"] * (max(formulas.ORDERS) + 1)
    return Lanes(in_four, in_eight, 8 * scratch, IN_STEP=False)
