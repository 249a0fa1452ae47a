"""Faults of 1e-5 or of a plausible slip, planted one by one in a copy of the sources: `rbfmu stability` must find each.

`python -m tests.support.planted_faults` prints the table fault -> finding that failed; `... NAME` plants one.
"""

import re
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from tests.support.sources import copy_sources, run_copy

FAILED = re.compile(r"does not hold: (.*): predicted")
ERROR = re.compile(r"^(Error: .*)$", re.MULTILINE)


class Fault(NamedTuple):
    """A text of a kernel's source and what stands in its place."""

    module: str
    right: str
    wrong: str

    @property
    def path(self) -> Path:
        """Return where the source is, from the project's folder on."""
        return Path(self.module if self.module in (DOP853, TABLEAU) else f"kernels/rbfmu_kernels/{self.module}.py")


DOP853, TABLEAU = "rbfmu/studies/dop853.py", "rbfmu/studies/dop853.csv"


FAULTS = {
    "Taylor sum 1e-5 too large": Fault("integrators/taylor",
        "    return numbers(add_lanes(add_lanes(even, odd), lanes_at(s, u)))[:3]",
        "    x, y, z, _ = numbers(add_lanes(add_lanes(even, odd), lanes_at(s, u)))\n    return (1.00001 * x, y, z)"),
    "Taylor coefficient of the gyroscopic term": Fault("integrators/taylor_coefficients",
        "x, y, v = p * (b - c), q * (c - a), r * (a - b)",
        "x, y, v = p * (b - c), q * (c - a) * 1.00001, r * (a - b)"),
    "weight of the two-point formula": Fault("integrators/taylor", "_WEIGHT[m, k] * power",
        "(_WEIGHT[m, k] if k < 3 else 1.00001 * _WEIGHT[m, k]) * power"),
    "DOP853 tableau, stage 9": Fault(TABLEAU, "21.230051448181193", "21.230263748695675"),
    "DOP853 tableau, two digits swapped": Fault(TABLEAU, "0.054293734116568765, 0, 0, 0, 0, 4.450312892752409",
        "0.054293734116568765, 0, 0, 0, 0, 4.450312892725409"),
    "DOP853 error estimate": Fault(TABLEAU, "1.6643771824549864", "1.6643938262268109"),
    "DOP853 chooses steps by the 4th root": Fault(DOP853,
        "growth = 6.0 if error < 2.6e-7 else 0.9 / math.sqrt(math.sqrt(math.sqrt(error)))",
        "growth = 6.0 if error < 2.6e-7 else 0.9 / math.sqrt(math.sqrt(error))"),
    "normalisation 1e-5 too long": Fault("mechanics/equations_of_motion", "s = 1.0 / math.sqrt(q[0] * q[0]",
        "s = 1.00001 / math.sqrt(q[0] * q[0]"),
    "sign in the composition of quaternions": Fault("rotations/quaternion", "a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1",
        "a0 * b2 + a1 * b3 + a2 * b0 - a3 * b1"),
    "phase of the free rotation": Fault("exact/free_rotation_setup", "    lam = dd.multiply(rate_s,",
        "    lam = dd.multiply(dd.scale(1.00001, rate_s),"),
    "precession of a symmetric body": Fault("exact/uniform_rotation",
        "dd.divide(momentum, i_t)", "dd.divide(momentum, dd.scale(1.00001, i_t))"),
    "coefficient of the splitting of order 4": Fault("integrators/splitting", "0.604872665711080", "0.604878714437737"),
    "splitting of order 6 in another order": Fault("integrators/splitting", "(*_D6, _D6_MIDDLE, *_D6[::-1])",
        "(*_D6[:2], _D6[3], _D6[2], _D6[4], _D6_MIDDLE, *_D6[::-1])"),
    "Strang's first kick whole": Fault("integrators/splitting", "loads, (0.5, 0.5), (1.0,))",
        "loads, (1.0, 0.5), (1.0,))"),
    "damping": Fault("mechanics/newton_euler", "-damping_b[2] * omega_b[2])", "-damping_b[2] * omega_b[2] * 1.00001)"),
    "gyroscopic torque": Fault("mechanics/newton_euler", "return cross(omega, transform(rest, omega))",
        "return cross(omega, transform(rest, (omega[0], omega[1] * 1.00001, omega[2])))"),
    "exponential map at small angles": Fault("rotations/rotation_vector", "if angle > 0.0 else 0.5, u)",
        "if angle > 1e-4 else 0.500005, u)"),
    "pendulum's phase": Fault("exact/pendulum", "rate = dd.scale(0.5, dd.multiply(dd.multiply(fastest, agm)",
        "rate = dd.scale(0.500005, dd.multiply(dd.multiply(fastest, agm)"),
    "series of one angle": Fault("models/one_axis", "d_cosine -= z[_RATE_SERIES + j]",
        "d_cosine -= 1.00001 * z[_RATE_SERIES + j]"),
    "relaxation at weak damping": Fault("numerics/elementary", "second = even - x * odd",
        "second = even - 1.00001 * x * odd"),
    "prescribed rates that change": Fault("models/prescribed_rates",
        "add_scaled_quaternion(after, 1.0, compose_quaternions(before,",
        "add_scaled_quaternion(after, 0.99999, compose_quaternions(before,"),
    "weight of Gauss's rule": Fault("models/free", "float(1 / ((1 - x * x)", "1.00001 * float(1 / ((1 - x * x)"),
    "angular momentum under a torque": Fault("models/unturned", "add_scaled(omega, since + low, alpha)",
        "add_scaled(omega, 1.00001 * (since + low), alpha)"),
    "inertia about the pivot": Fault("mechanics/inertia",
        "return ((yy + zz, xy, xz), (xy, xx + zz, yz), (xz, yz, xx + yy))",
        "return ((yy + zz * 1.00001, xy, xz), (xy, xx + zz, yz), (xz, yz, xx + yy))"),
}  # fmt: skip
"""By what is wrong."""


def planted(fault: Fault | None, folder: Path) -> None:
    """Copy the sources, and plant the fault in the copy."""
    copy_sources(folder)
    if fault:
        path = folder / fault.path
        text = path.read_text()
        assert text.count(fault.right) == 1, f"{fault.module}: {text.count(fault.right)} times {fault.right!r}"
        path.write_text(text.replace(fault.right, fault.wrong))


def stability(fault: Fault | None, *options: str) -> tuple[int, list[str]]:
    """Exit status of `rbfmu stability` on a copy with the fault, and what it finds: failed findings, or its one error.

    A fault may be so gross that a scene is refused, which ends the command with a message.
    """
    with tempfile.TemporaryDirectory(prefix="rbfmu-fault-") as name:
        folder = Path(name)
        planted(fault, folder)
        run = run_copy(folder, "import rbfmu.cli; rbfmu.cli.main()", "stability", "-o", folder / "out", *options)
    if run.returncode not in (0, 1, 2):
        raise RuntimeError(run.stderr)
    return run.returncode, FAILED.findall(run.stdout) + ERROR.findall(run.stderr)


def main() -> None:
    for name in sys.argv[1:] or FAULTS:
        status, failed = stability(FAULTS.get(name), "--quick")
        print(f"{name:45} exit {status}, {len(failed):3} fail, first: {failed[0] if failed else '-'}", flush=True)


if __name__ == "__main__":
    main()
