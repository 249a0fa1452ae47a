"""Pictures of laws 13 and 14: the errors of the product's models, and how they fall with the step."""

from matplotlib.figure import Figure

from rbfmu.studies.stability.charts.figures import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    titled_axes,
)
from rbfmu.studies.stability.findings import Study


def product_models(study: Study) -> Figure:
    """Draw law 13."""
    axes = titled_axes(
        "Each of rbfmu's models follows its motion to round-off, Strang's splitting to 1e-8:\n"
        "dots: largest error of the attitude (rad) and of all else (relative); bars: the bound",
        "largest error", "", left=0.41, right=0.95,
    )  # fmt: skip
    columns = study.columns
    models = list(dict.fromkeys(columns["model"]))
    axes.figure.set_size_inches(8.4, 6.0)
    axes.set(xscale="log", xlim=(1e-17, 1e-7), ylim=(len(models) - 0.4, -0.6))
    axes.set_yticks(range(len(models)), models, fontsize=9)
    for model, error, bound in zip(columns["model"], columns["error"], columns["bound"], strict=True):
        y = models.index(model)
        axes.plot([bound, bound], [y - 0.3, y + 0.3], color=BLACK, linewidth=1.5)
        axes.plot([min(max(error, 1e-17), 1e-7)], [y], "o", color=BLUE if error <= bound else VERMILION, markersize=4)
    axes.axvline(2.0**-52, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.text(2.0**-52, -0.45, " eps", color=GREY, fontsize=9, va="center")
    return axes.figure  # type: ignore[no-any-return]


def orders_and_error_control(study: Study) -> Figure:
    """Draw law 14."""
    axes = titled_axes(
        "Halving the step divides the error by 2 to the method's order, until round-off is reached\n"
        "(lines: that slope from the first dot on)",
        "halvings of the step", "largest error",
    )  # fmt: skip
    names = list(study.columns)[1:]
    orders = {f.what.removesuffix(": order"): f.predicted for f in study.findings}
    halvings = study.columns["halvings of the step"]
    axes.set(yscale="log", xlim=(-0.1, halvings[-1] + 0.1), ylim=(1e-16, 1e2))
    axes.set_xticks(halvings)
    for name, color in zip(names, (ORANGE, GREEN, BLUE, VERMILION, PURPLE, SKY, BLACK, GREY), strict=True):
        errors = study.columns[name]
        axes.plot(halvings, [errors[0] * 2.0 ** (-orders[name] * k) for k in halvings], color=color, linewidth=0.9)
        axes.plot(halvings, errors, "o", color=color, markersize=5, label=f"{name}: {orders[name]:g}")
    axes.legend(title="order", frameon=False, loc="upper right", fontsize=9, alignment="left", ncols=2)
    return axes.figure  # type: ignore[no-any-return]
