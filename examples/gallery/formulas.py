"""Pictures of the scenes with formulas: one function for each scene, named like it."""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

import rbfmu
from examples.gallery.axes import at_end, name_axes, panels
from examples.gallery.surroundings import with_step
from rbfmu.plot import COLORS

BLUE, VERMILION, GREEN, PURPLE = COLORS
TARGET = (0.0, 0.0, 10.0)
"""Where the drone is to stay, m."""


def gravity_gradient(scene: rbfmu.Scene) -> Figure:
    """Draw the angle to the zenith, and what the wheels take up."""
    result = rbfmu.simulate(scene)
    minutes, off = result.time / 60.0, np.degrees(result.off)
    figure, (axes, wheels) = panels(
        f"It points within {off[-1]:.1f}° after an orbit; wheels keep what that took", 1.0, 1.2
    )
    axes.plot(minutes, off, color=BLUE)
    name_axes(axes, "time (min)", "angle to the zenith (°)")
    axes.set_ylim(0.0)
    for k, color in enumerate((BLUE, VERMILION, GREEN)):
        (line,) = wheels.plot(minutes, 1e3 * result.momentum[:, k], color=color)
        at_end(wheels, line, "xyz"[k])
    name_axes(wheels, "time (min)", "wheels (mN m s)")
    return figure


def magnetic_dipole(scene: rbfmu.Scene) -> Figure:
    """Draw the angle to the field, and how it is followed through two turns."""
    result = rbfmu.simulate(scene)
    minutes, off = result.time / 60.0, np.degrees(result.off)
    z = rbfmu.rotate(result.quaternion, np.array([0.0, 0.0, 1.0]))
    turned = np.degrees(np.unwrap(np.arctan2(z[:, 0], z[:, 2])))
    late = off[len(off) // 2 :].max()
    figure, (axes, way) = panels(f"The magnet follows the field within {late:.0f}°, twice around an orbit", 1.0, 1.0)
    axes.plot(minutes, off, color=BLUE)
    axes.set_ylim(0.0)
    name_axes(axes, "time (min)", "angle to the field (°)")
    way.plot(minutes, turned, color=VERMILION)
    way.set_yticks(np.arange(0, 721, 180) * np.sign(turned[-1]))
    name_axes(way, "time (min)", "turned about y (°)")
    return figure


def moored_hull(scene: rbfmu.Scene) -> Figure:
    """Draw the way back to the berth, and heave and roll over time."""
    result = rbfmu.simulate(scene)
    figure, (plan, axes) = panels("A moored hull heaves, rolls and swings about its berth", 1.0, 2.0)
    x, y, heave = result.position.T
    plan.plot(x, y, color=BLUE)
    plan.plot([x[0], 0.0], [y[0], 0.0], "o", color=BLUE, markersize=4)
    plan.annotate("berth", (0.0, 0.0), xytext=(2, -11), textcoords="offset points", fontsize=9)
    plan.margins(0.12)
    plan.set_aspect("equal", adjustable="datalim")
    name_axes(plan, "forward (m)", "to port (m)")
    for values, color, text in (
        (10.0 * heave, GREEN, "heave (dm)"),
        (np.degrees(result.rpy[:, 0]), VERMILION, "roll (°)"),
    ):
        axes.plot(result.time, values, color=color, label=text)
    axes.legend(fontsize=8, frameon=False, loc="upper right")
    name_axes(axes, "time (s)", "heave (dm), roll (°)")
    return figure


def spring_pendulum(scene: rbfmu.Scene) -> Figure:
    """Draw the path of the centre, and how the total energy stays."""
    result = rbfmu.simulate(scene)
    drift = np.abs(result.total_energy - result.total_energy[0])
    figure, (path, axes) = panels("It swings and bounces; its total energy stays to the accuracy asked", 1.0, 1.6)
    x, _, z = result.position.T
    path.plot(x, z, color=BLUE, linewidth=0.9)
    path.plot([0.0], [0.0], "k^", markersize=6)
    path.plot([0.0, x[-1]], [0.0, z[-1]], color="#999999", linewidth=0.9)
    path.plot([x[-1]], [z[-1]], "o", color=BLUE, markersize=6)
    path.margins(0.1)
    path.set_aspect("equal", adjustable="datalim")
    name_axes(path, "x (m)", "z (m)")
    axes.semilogy(result.time[1:], np.maximum(drift[1:], 1e-16), ".", color=VERMILION, markersize=2.5)
    size = np.abs(result.total_energy[0])
    axes.axhline(scene.run.accuracy * size, color="black", linewidth=1.0)
    axes.annotate("accuracy asked", (0.1, 1.35 * scene.run.accuracy * size), fontsize=9)
    axes.set_ylim(1e-14, 1e-6)
    name_axes(axes, "time (s)", "change of total energy (J)")
    return figure


def drone(scene: rbfmu.Scene) -> Figure:
    """Draw position and tilt, and one rotor's thrust."""
    result = rbfmu.simulate(scene)
    z = rbfmu.rotate(result.quaternion, np.array([0.0, 0.0, 1.0]))
    tilt = np.degrees(np.arccos(np.clip(z[:, 2], -1.0, 1.0)))
    figure, (axes, level, rotor) = panels("Thrown tilted, it levels and comes back to its place", 1.2, 1.0, 1.0)
    for k, color in enumerate((BLUE, VERMILION, GREEN)):
        axes.plot(result.time, result.position[:, k] - TARGET[k], color=color, label="xyz"[k])
    axes.legend(fontsize=8, frameon=False)
    name_axes(axes, "time (s)", "from its place (m)")
    level.plot(result.time, tilt, color=BLUE)
    level.set_ylim(0.0)
    name_axes(level, "time (s)", "tilt (°)")
    first = result.time <= 2.0
    rotor.plot(result.time[first], result.first[first], color=PURPLE)
    rotor.set_ylim(0.0, 8.4)
    name_axes(rotor, "time (s)", "first rotor's thrust (N)")
    return figure


def projectile(scene: rbfmu.Scene) -> Figure:
    """Draw the path, and how the axis goes around it."""
    result = rbfmu.simulate(with_step(scene, 0.001))
    v = result.velocity / np.linalg.norm(result.velocity, axis=1, keepdims=True)
    x = rbfmu.rotate(result.quaternion, np.array([1.0, 0.0, 0.0]))
    side = np.cross([0.0, 0.0, 1.0], v)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(v, side)
    right, above = (-np.degrees(np.arcsin(np.sum(x * side, axis=1))), np.degrees(np.arcsin(np.sum(x * up, axis=1))))
    figure, (path, nose) = panels("Spin keeps it from turning over: its nose goes around its path", 2.0, 1.0)
    path.plot(result.position[:, 0], result.position[:, 2], color=BLUE)
    name_axes(path, "distance (m)", "height (m)")
    path.set_ylim(0.0)
    nose.plot(right, above, color=VERMILION, linewidth=0.9)
    nose.plot(right[:1], above[:1], "o", color=VERMILION, markersize=4)
    nose.plot([0.0], [0.0], "k+", markersize=8)
    nose.margins(0.1)
    nose.set_aspect("equal", adjustable="datalim")
    name_axes(nose, "nose to the right (°)", "nose above (°)")
    return figure


PICTURES: dict[str, Callable[[rbfmu.Scene], Figure]] = {
    one.__name__: one for one in (gravity_gradient, magnetic_dipole, moored_hull, spring_pendulum, drone, projectile)
}
