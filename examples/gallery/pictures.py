"""The gallery's pictures: one function for each scene, named like it, which draws what one should see at a glance."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import rbfmu
from examples.gallery import surroundings as around
from examples.gallery.axes import at_end, name_axes, panels
from examples.gallery.space import draw_top_in_space, in_space
from rbfmu.plot import COLORS

BLUE, VERMILION, GREEN, PURPLE = COLORS
GREY = "#777777"
X, Y, Z = np.eye(3)
SMALL = 10.0
"""Tilts (°) that are seen from above, and not in space."""


def fixed_camera(scene: rbfmu.Scene) -> Figure:
    """Draw the mast, the camera and its field of view from the side, all frames upon each other."""
    result = rbfmu.simulate(scene)
    figure, (axes,) = panels(f"All {len(result.time)} frames are taken from one place, in one direction", 1.0)
    for r, q in zip(result.position[::25], result.quaternion[::25], strict=True):
        for angle, color in ((0.0, BLUE), (-12.0, GREY), (12.0, GREY)):
            ray = rbfmu.rotate(q, rbfmu.rotate(rbfmu.quaternion_from_rotvec(math.radians(angle) * Y), X))
            reach = r[2] / -ray[2]
            axes.plot([r[0], r[0] + reach * ray[0]], [r[2], 0.0], color=color, linewidth=1.0)
    x, _, height = result.position[0]
    axes.plot([x, x], [0.0, height], color="black", linewidth=3.0, solid_capstyle="round")
    axes.plot([x], [height], marker="s", markersize=9, color="black")
    axes.annotate("optical axis, 20° down", (10.2, 1.1), color=BLUE, fontsize=9)
    axes.axhline(0.0, color="black", linewidth=1.0)
    axes.set_xlim(-1.5, 32.0)
    axes.set_ylim(0.0, 5.2)
    name_axes(axes, "distance (m)", "height (m)")
    return figure


def thrown_ball(scene: rbfmu.Scene) -> Figure:
    """Draw the path with a ball each 0.2 s."""
    result = rbfmu.simulate(scene)
    x, z = result.position[:, 0], result.position[:, 2]
    top = int(np.argmax(z))
    figure, (axes,) = panels(f"A parabola: {z[top]:.1f} m high after {result.time[top]:.1f} s", 1.0)
    axes.plot(x, z, color=BLUE, linewidth=1.0)
    axes.plot(x[::10], z[::10], "o", color=BLUE, markersize=5)
    axes.annotate(
        "a ball each 0.2 s", (x[-31], z[-31]), xytext=(10, 4), textcoords="offset points", color=BLUE, fontsize=9
    )
    axes.axhline(0.0, color="black", linewidth=1.0)
    axes.set_xlim(-2.0, 76.0)
    axes.set_ylim(0.0, 11.0)
    name_axes(axes, "distance (m)", "height (m)")
    return figure


def flywheel(scene: rbfmu.Scene) -> Figure:
    """Speed and energy as fractions of their start."""
    result = rbfmu.simulate(scene)
    figure, (axes,) = panels("Drag divides the speed by e every 20 s, the energy every 10 s", 1.0)
    speed = result.omega_b[:, 2]
    (line,) = axes.semilogy(result.time, speed / speed[0], color=BLUE)
    axes.annotate("speed, of 100 rad/s", (62.0, 0.06), color=BLUE, fontsize=9)
    axes.semilogy(result.time, result.kinetic_energy / result.kinetic_energy[0], color=VERMILION)
    axes.annotate("energy, of 2 kJ", (62.0, 2.8e-3), color=VERMILION, fontsize=9)
    for k in range(1, 6):
        axes.plot([20.0 * k], [math.exp(-k)], "o", color=line.get_color(), markersize=4)
    name_axes(axes, "time (s)", "part of the start")
    return figure


def earth(scene: rbfmu.Scene) -> Figure:
    """Draw the angle turned over the day, and what is left out beside the accuracy asked."""
    result = rbfmu.simulate(scene)
    x = rbfmu.rotate(result.quaternion, X)
    angle = np.degrees(np.unwrap(np.arctan2(x[:, 1], x[:, 0])))
    figure, (axes, scale) = panels("A full turn in 23 h 56 min 4 s; the wander of the axis is not modelled", 1.6, 1.0)
    hours = result.time / 3600.0
    axes.plot(hours, angle, color=BLUE)
    sidereal = float(np.interp(360.0, angle, hours))
    axes.plot([sidereal], [360.0], "o", color=BLUE, markersize=5)
    axes.annotate("360°", (sidereal, 360.0), xytext=(-34, -2), textcoords="offset points", color=BLUE, fontsize=9)
    axes.set_xticks(range(0, 25, 4))
    axes.set_yticks(range(0, 361, 90))
    name_axes(axes, "hours", "angle turned (°)")
    moments, q_0, omega_0 = np.diag(scene.body.M_c), result.quaternion[0], np.array(scene.initial.omega_b)
    exact, _ = rbfmu.free_rotation(moments, q_0, omega_0, result.time)
    wander = np.max(rbfmu.angle_between(result.quaternion, exact))
    scale.barh(["wander\nin a day", "accuracy\nasked"], [wander, scene.run.accuracy], color=[GREY, BLUE], height=0.5)
    scale.set_xscale("log")
    scale.set_xlim(1e-9, 3e-5)
    scale.set_xlabel("rad", fontsize=9)
    return figure


def spinning_satellite(scene: rbfmu.Scene) -> Figure:
    """Draw the small rates over time and as a circle."""
    result = rbfmu.simulate(around.with_step(scene, 0.1))
    rates = np.degrees(result.omega_b)
    figure, (axes, circle) = panels(f"A steady spin of {rates[0, 2]:.0f}°/s; the other rates circle", 2.4, 1.0)
    for k, color in ((0, BLUE), (1, VERMILION)):
        (line,) = axes.plot(result.time, rates[:, k], color=color)
        at_end(axes, line, "xy"[k])
    name_axes(axes, "time (s)", "rates across the axis (°/s)")
    circle.plot(rates[:, 0], rates[:, 1], color=GREEN)
    circle.plot(*rates[0, :2], "o", color=GREEN, markersize=4)
    circle.set_aspect("equal")
    circle.margins(0.08)
    name_axes(circle, "x (°/s)", "y (°/s)")
    return figure


def gyro_attitude(scene: rbfmu.Scene) -> Figure:
    """Draw the cone, and the drift that it leaves, with the classical formula."""
    h = scene.run.step
    time, found = around.driven(scene, lambda t, _: {"omega_b": around.mean_rates(t, h)})
    truth = np.array([around.coning_attitude(t) for t in time])
    q = rbfmu.compose_quaternions(around.coning_attitude(0.0), found["quaternion"])
    drift = np.degrees(rbfmu.angle_between(q, truth))
    predicted = np.degrees(around.coning_drift(time, h))
    figure, (path, axes) = panels("Coning: mean rates held over each step leave a drift", 1.0, 2.0)
    z = np.degrees(rbfmu.rotate(truth[:11], Z))
    path.plot(z[:, 0], z[:, 1], "o-", color=GREY, markersize=3, linewidth=1.0)
    path.set_aspect("equal")
    path.margins(0.1)
    path.annotate(f"one cone: {10 * h:g} s,\n10 steps", (0.0, 0.0), ha="center", va="center", color=GREY, fontsize=9)
    name_axes(path, "tilt of the axis to x (°)", "tilt to y (°)")
    axes.plot(time, drift, color=BLUE)
    axes.plot(time[::100], predicted[::100], "o", color=VERMILION, markersize=4)
    axes.annotate("attitude from the rates", (4.6, 0.6 * drift[-1]), color=BLUE, fontsize=9, ha="right")
    formula = "formula: ½ Ω sin²β (1 - sin Ωh / Ωh) t\nrate Ω and half angle β of the cone, step h"
    axes.annotate(formula, (9.9, 0.2 * drift[-1]), color=VERMILION, fontsize=9, ha="right")
    name_axes(axes, "time (s)", "drift of the attitude (°)")
    return figure


def _top(scene: rbfmu.Scene, title: str, reach: float) -> Figure:
    """Draw the way of a top's axis, in space or, where it hardly leaves the vertical, from above; and its tilt."""
    result = rbfmu.simulate(scene)
    z = rbfmu.rotate(result.quaternion, Z)
    tilt = np.degrees(np.arccos(np.clip(z[:, 2], -1.0, 1.0)))
    figure, (left, axes) = panels(title, 1.0, 1.9)
    if reach > SMALL:
        draw_top_in_space(in_space(figure, left), z)
    else:
        _draw_top_from_above(left, z, tilt, reach)
    if reach > 90.0:
        axes.axhline(90.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
        axes.annotate("horizontal", (0.02, 94.0), color=GREY, fontsize=8)
    axes.plot(result.time, tilt, color=BLUE)
    axes.plot([0.0], [tilt[0]], "o", color=VERMILION, markersize=4, clip_on=False)
    axes.set_ylim(0.0, reach)
    name_axes(axes, "time (s)", "tilt (°)")
    return figure


def _draw_top_from_above(axes: Any, z: Any, tilt: Any, reach: float) -> None:
    sideways = np.hypot(z[:, 0], z[:, 1])
    axes.plot(tilt * z[:, 0] / sideways, tilt * z[:, 1] / sideways, color=BLUE, linewidth=1.0)
    axes.plot([tilt[0]], [0.0], "o", color=VERMILION, markersize=4)
    axes.plot([0.0], [0.0], "+", color="black", markersize=7)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    name_axes(axes, "the axis from above (°)", "")


def top_sleeping(scene: rbfmu.Scene) -> Figure:
    """Near the vertical."""
    return _top(scene, "200 rad/s: it stands, and never leans over by more than 2.5°", 3.2)


def top_precessing(scene: rbfmu.Scene) -> Figure:
    """Cusps."""
    return _top(scene, "200 rad/s, let go at 40°: it goes round the vertical, and nods", 55.0)


def top_falling(scene: rbfmu.Scene) -> Figure:
    """Over the horizon and back."""
    return _top(scene, "60 rad/s: too slow to stand; it falls over and climbs back", 135.0)


def t_handle(scene: rbfmu.Scene) -> Figure:
    """Draw the stem's direction over time, and the handle itself above."""
    result = rbfmu.simulate(around.with_step(scene, 0.02))
    stem, bar = rbfmu.rotate(result.quaternion, X), rbfmu.rotate(result.quaternion, Y)
    figure, (axes,) = panels("Spun about the stem, the handle turns over every 1.8 s", 1.0)
    axes.plot(result.time, stem[:, 0], color=BLUE)
    axes.axhline(0.0, color="black", linewidth=0.8)
    for k in range(9, len(result.time), 21):
        _draw_handle(axes, result.time[k], stem[k, :2], bar[k, :2])
    axes.set_ylim(-1.15, 2.7)
    axes.set_yticks([-1.0, 0.0, 1.0])
    name_axes(axes, "time (s)", "stem along the spin")
    return figure


def _draw_handle(axes: Any, t: float, stem: Any, bar: Any) -> None:
    """Draw the handle seen from the side, spin axis upwards, at a time."""
    wide, high = 0.17, 0.42  # s and units of the axes, for equal lengths on paper

    def line(a: Any, b: Any, color: str) -> None:
        points = np.array([a, b])
        axes.plot(t + wide * points[:, 1], 2.0 + high * points[:, 0], color=color, linewidth=3.0)

    foot = -0.4 * stem
    line(foot, foot + stem, BLUE)
    line(foot - bar, foot + bar, VERMILION)


def tumbling_brick(scene: rbfmu.Scene) -> Figure:
    """Draw the rates, and NASA's after 30 s."""
    result = rbfmu.simulate(scene)
    nasa = (12.61839077566776, -17.3974747618308, 31.11958888682995)  # simulation 01
    figure, (axes,) = panels("NASA's brick tumbles: after 30 s the same rates to 1e-9 °/s", 1.0)
    for k, color in enumerate((BLUE, VERMILION, GREEN)):
        (line,) = axes.plot(result.time, np.degrees(result.omega_b[:, k]), color=color)
        axes.plot([30.0], [nasa[k]], "o", color=color, markersize=6, clip_on=False)
        at_end(axes, line, f" {'xyz'[k]}")
    axes.annotate("NASA: dots", (26.3, 20.5), color=GREY, fontsize=9)
    name_axes(axes, "time (s)", "body rates (°/s)")
    return figure


def toutatis(scene: rbfmu.Scene) -> Figure:
    """Draw the rates over forty days, and radar's."""
    result = rbfmu.simulate(around.with_step(scene, 0.1 * around.DAY))
    figure, (axes,) = panels("Toutatis tumbles: body rates, and what radar saw in December 1992 (dots)", 1.0)
    days = [around.days_since_epoch(date) for date, _, _ in around.RADAR]
    names = ("intermediate axis", "short axis", "long axis")
    for k, color in enumerate((BLUE, VERMILION, GREEN)):
        axes.plot(result.time / around.DAY, np.degrees(result.omega_b[:, k]) * around.DAY, color=color, linewidth=1.2)
        axes.plot(days, [rates[k] for _, _, rates in around.RADAR], "o", color=color, markersize=4)
        axes.annotate(names[k], (40.6, (25.0, -5.0, -98.0)[k]), color=color, fontsize=9, annotation_clip=False)
    name_axes(axes, "days since 9 November 1992", "body rates (°/day)")
    return figure


def beam_pendulum(scene: rbfmu.Scene) -> Figure:
    """Draw the swing, with the analytic period's ticks."""
    result = rbfmu.simulate(scene)
    x = rbfmu.rotate(result.quaternion, X)
    period = 2.0 * math.pi * math.sqrt(2.0 / (3.0 * 9.81))
    figure, (axes,) = panels("The beam swings with the period 2π √(2l / 3g) = 1.638 s (dots)", 1.0)
    axes.plot(result.time, np.degrees(np.arctan2(x[:, 0], -x[:, 2])), color=BLUE)
    axes.plot(np.arange(7) * period, [0.1] * 7, "o", color=VERMILION, markersize=5, clip_on=False)
    name_axes(axes, "time (s)", "angle (°)")
    return figure


def controlled_satellite(scene: rbfmu.Scene) -> Figure:
    """Draw the angle to zero attitude under a PD law."""
    torques: list[Any] = []

    def law(t: float, now: dict[str, Any]) -> dict[str, Any]:
        torques.append(around.control(now))
        return {"torque_b": torques[-1]}

    time, found = around.driven(scene, law)
    figure, (axes, right) = panels("A controller brings the satellite home through its torque port", 1.0, 1.0)
    angle = np.degrees(rbfmu.angle_between(found["quaternion"], np.array([1.0, 0.0, 0.0, 0.0])))
    axes.semilogy(time, angle, color=BLUE)
    name_axes(axes, "time (s)", "angle from zero attitude (°)")
    for k, color in enumerate((BLUE, VERMILION, GREEN)):
        right.step(time[:250], np.array(torques)[:250, k], where="post", color=color, linewidth=1.2)
        right.annotate("xyz"[k], (0.9, 0.42 - 0.1 * k), xycoords="axes fraction", color=color, fontsize=9)
    name_axes(right, "time (s)", "torque (N m)")
    return figure


def ship(scene: rbfmu.Scene) -> Figure:
    """Heave and roll in a swell."""
    time, found = around.driven(scene, around.water)
    figure, (heave, roll) = panels("A swell from abeam: the ship goes up and down with it, and rolls", 1.0, 1.0)
    heave.plot(time, around.SWELL * np.sin(around.SWELL_RATE * time), color=GREY, linewidth=1.0, linestyle=(0, (4, 3)))
    heave.plot(time, found["position"][:, 2], color=BLUE)
    heave.set_ylim(-1.6, 1.9)
    heave.annotate("water", (1.0, 1.55), color=GREY, fontsize=9)
    heave.annotate("ship", (10.0, 1.55), color=BLUE, fontsize=9)
    name_axes(heave, "time (s)", "heave (m)")
    roll.plot(time, np.degrees(found["rpy"][:, 0]), color=VERMILION)
    name_axes(roll, "time (s)", "roll (°)")
    return figure


PICTURES: dict[str, Callable[[rbfmu.Scene], Figure]] = {
    picture.__name__: picture
    for picture in (
        *(fixed_camera, thrown_ball, flywheel, earth, spinning_satellite, gyro_attitude, t_handle, tumbling_brick),
        *(toutatis, beam_pendulum, top_sleeping, top_precessing, top_falling, controlled_satellite, ship),
    )
}
"""By scene, from the smallest models to the largest: the gallery's order."""
