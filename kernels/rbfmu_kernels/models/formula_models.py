"""Models of one scene's formulas: templates of `formulas` bound to generated kernels and to places of a buffer."""

from collections.abc import Callable, Mapping
from typing import Any

from ..body.shell import Lanes, Model, bind, initialize, step
from . import formula_lanes, formulas

_HOME = formulas.__name__
"""The module of all that is bound."""


def make_formulas(
    constant: str,
    layout: tuple[dict[str, slice], int],
    generated: Mapping[str, Callable[..., Any]],
    places: Mapping[str, Any],
) -> Model:
    """Return the model of one scene's formulas.

    constant: a name that no other scene's formulas have; generated: its kernels, by name; places: what the templates'
    globals are.
    """
    own = _bound(constant, {**places, **generated})
    own_set_up = bind(formulas.set_up_formulas, _HOME, constant, **own)
    own_advance = bind(formulas.advance_formulas, _HOME, constant, **own)
    return Model(
        f"formulas.{constant}",
        *layout,
        initialize=bind(initialize, _HOME, constant, set_up=own_set_up),
        step=bind(step, _HOME, constant, advance=own_advance),
        outputs=bind(formulas.outputs_now, _HOME, constant, **own),
        feedthrough=generated["feedthrough"],
        ORDERS=formulas.ORDERS,
    )


def _bound(constant: str, own: dict[str, Any], templates: Mapping[str, Callable[..., Any]] = formulas.TEMPLATES) -> Any:
    for name, template in templates.items():
        own[name] = bind(template, _HOME, constant, **own)
    return own


def make_over(
    constant: str,
    base: Model,
    layout: tuple[dict[str, slice], int],
    generated: Mapping[str, Callable[..., Any]],
    places: Mapping[str, Any],
) -> Model:
    """Return the model of own outputs over a closed form, whose blocks the layout begins with; else as above."""
    own = {**places, **generated, "begin": base.initialize, "advance": base.step, "refresh": base.outputs}
    return Model(
        f"formulas.{constant}",
        *layout,
        initialize=bind(formulas.initialize_over, _HOME, constant, **own),
        step=bind(formulas.step_over, _HOME, constant, **own),
        outputs=bind(formulas.outputs_over, _HOME, constant, **own),
        output_rates=base.output_rates,
        feedthrough=generated["feedthrough"],
    )


def make_lanes(model: Model, own: Mapping[str, Any], constant: str, wide: Mapping[str, Any]) -> Lanes:
    """Return what runs many bodies of a model at once.

    own: the kernels and places that `make_formulas` was given; constant: a name that no others have; wide: the kernels
    of series over numbers of several bodies, by name, and WIDE_ROW, the length of a row there.
    """
    found = _bound(model.name.partition(".")[2], {**own}) | wide | {"initialize": model.initialize}
    found = _bound(constant, found, formula_lanes.TEMPLATES)
    scratch = own["ROWS"] + wide["WIDE_ROW"] * (max(formulas.ORDERS) + 1)
    return Lanes(found["run_in_four"], found["run_in_eight"], 8 * scratch, IN_STEP=False)
