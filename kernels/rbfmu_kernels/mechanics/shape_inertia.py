"""Inertia matrices of simple homogeneous shapes."""

import math

from ..compile.decorator import kernel
from ..types import Matrix, Vec3
from .inertia import diagonal

__all__ = ["beam_inertia", "box_inertia", "cylinder_inertia", "ellipsoid_inertia", "sphere_inertia"]


@kernel
def is_negative(mass: float, size: float) -> bool:
    """Return whether the mass or the size of a shape is negative, which their product and square would hide."""
    return mass < 0.0 or size < 0.0


@kernel
def one_is_negative(mass: float, sizes: Vec3) -> bool:
    """Return whether the mass or one of three sizes is negative."""
    return mass < 0.0 or sizes[0] < 0.0 or sizes[1] < 0.0 or sizes[2] < 0.0


@kernel
def cylinder_is_negative(mass: float, radius: float, length: float) -> bool:
    """Return whether the mass or a size is negative."""
    return mass < 0.0 or radius < 0.0 or length < 0.0


@kernel
def beam_inertia(mass: float, length: float) -> Matrix:
    """Return M of a slender beam about its centre, diag(0, m l^2/12, m l^2/12).

    Units: mass in kg, length in m; M in kg m^2.  Frames: the beam lies along x.
    Error <= 1.2 eps.  Singular: a negative mass or size gives NaN.  Source: E&G 7.2; lecture, "Example: Slender beam".
    """
    mass = math.nan if is_negative(mass, length) else mass
    m = mass * length * length / 12.0
    return diagonal((0.0, m, m))


@kernel
def box_inertia(mass: float, sides: Vec3) -> Matrix:
    """Return M of a homogeneous box about its centre.

    Units: mass in kg, sides in m; M in kg m^2.  Frames: axes along the sides.
    Error <= 1.6 eps.  Singular: a negative mass or size gives NaN.  Source: the integral of lecture, "Inertia dyadic".
    """
    x, y, z = sides[0] * sides[0], sides[1] * sides[1], sides[2] * sides[2]
    m = math.nan if one_is_negative(mass, sides) else mass / 12.0
    return diagonal((m * (y + z), m * (z + x), m * (x + y)))


@kernel
def cylinder_inertia(mass: float, radius: float, length: float) -> Matrix:
    """Return M of a homogeneous cylinder about its centre.

    Units: mass in kg, radius and length in m; M in kg m^2.  Frames: the cylinder's axis along z.
    Error <= 1.7 eps.  Singular: a negative mass or size gives NaN.  Source: the integral of lecture, "Inertia dyadic".
    """
    mass = math.nan if cylinder_is_negative(mass, radius, length) else mass
    r2 = radius * radius
    side = mass * (3.0 * r2 + length * length) / 12.0
    return diagonal((side, side, 0.5 * mass * r2))


@kernel
def sphere_inertia(mass: float, radius: float) -> Matrix:
    """Return M of a homogeneous ball about its centre, 2/5 m r^2 in any axes.

    Units: mass in kg, radius in m; M in kg m^2.  Frames: any.
    Error <= 1.4 eps.  Singular: a negative mass or size gives NaN.  Source: the integral of lecture, "Inertia dyadic".
    """
    mass = math.nan if is_negative(mass, radius) else mass
    m = 0.4 * mass * radius * radius
    return diagonal((m, m, m))


@kernel
def ellipsoid_inertia(mass: float, semiaxes: Vec3) -> Matrix:
    """Return M of a homogeneous ellipsoid about its centre.

    Units: mass in kg, semiaxes in m; M in kg m^2.  Frames: axes along the semiaxes.
    Error <= 1.6 eps.  Singular: a negative mass or size gives NaN.  Source: the integral of lecture, "Inertia dyadic".
    """
    x, y, z = semiaxes[0] * semiaxes[0], semiaxes[1] * semiaxes[1], semiaxes[2] * semiaxes[2]
    m = math.nan if one_is_negative(mass, semiaxes) else mass / 5.0
    return diagonal((m * (y + z), m * (z + x), m * (x + y)))
