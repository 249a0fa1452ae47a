"""What each law says, and where its prediction comes from."""

from typing import NamedTuple


class Law(NamedTuple):
    """A law in words, and the source of the predicted numbers."""

    says: str
    source: str


_POLYNOMIAL = "the method's stability polynomial R(z)"
LAWS = {
    1: Law("Explicit Euler on q: |q| grows by sqrt(1 + (h omega)^2 / 4) a step.",
           f"{_POLYNOMIAL}, |1 + i h omega / 2|"),
    2: Law("RK4 on q shrinks it and lags; each method, such as DOP853 of order 8, has a largest stable step.",
           f"{_POLYNOMIAL} on the imaginary axis: 1 - x^6 / 9216, x^5 / 1920"),
    3: Law("RK4 on R leaves the rotations 64 times as fast as |q|^2 leaves 1.",
           f"{_POLYNOMIAL}: n x^6 / 72, stable to x = 2 sqrt 2"),
    4: Law("Euler angles lose accuracy near the vertical, quaternions do not.",
           "yaw rate omega / delta, passing at delta rad; RK4: order 4, lag t h^4 / 1920; else recorded"),
    5: Law("An explicit gyroscopic term adds energy.",
           "sqrt(1 + (h W)^2), W = w3 (1 - I3 / I1); gains of h^2 alpha . M alpha / 2"),
    6: Law("Damping that a step cannot follow becomes growth.", f"{_POLYNOMIAL} on the real axis"),
    7: Law("Moser-Veselov has no solution beyond h omega = 1.",
           "asin(h omega) of a sphere; preprocessed (McLachlan & Zanna 2005): pi / 2"),
    8: Law("RK4 loses energy in proportion to time, exact methods only round-off.",
           "order 4: h^5 over a given time; round-off: 2 eps sqrt(n), 4 eps; else recorded"),
    9: Law("Formulas with cancellation lose small angles, those of rbfmu keep them.",
           "their expansions at 0 and 2 pi; eps"),
    10: Law("A spin about the middle axis flips again and again.",
            "Euler's equations: w2 sqrt((I2 - I1) (I3 - I2) / (I1 I3)), ln(16 / mc)"),
    11: Law("An upright top sleeps only above its critical spin.",
            "linear theory: (I3 w3)^2 = 4 I1 m g l, moments about the pivot"),
    12: Law("Splitting resonates with the free precession of a top.",
            "2 pi I1 / (I3 w3); below it the order of the splitting; else recorded"),
    13: Law("Each of rbfmu's models follows its motion.",
            "references of 40 digits, computed once by mpmath; bound: round-off, some 10 times what is reached"),
    14: Law("Errors and substeps of rbfmu's methods follow their orders.",
            "2^-order a halving; error per step h^(order + 1); else recorded"),
    15: Law("On each tile of the maps rbfmu is right.", "the accuracy asked; truth: 40-digit references"),
}  # fmt: skip
"""The laws by number; "recorded" means measured earlier, without a theory."""
