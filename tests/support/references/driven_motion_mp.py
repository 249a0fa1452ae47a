"""A body's motion under inputs that change in pieces, to some 20 digits, by a form that the kernels do not use."""

import mpmath as mp
from scipy.spatial.transform import Rotation


def true_motion(body, initial, pieces):
    """Quaternion, body rate, position and velocity of o after each piece, by 30-digit extrapolation of another form.

    pieces: (length, inputs), of which each is (value, first, second derivative) at the piece's begin, by its port.
    Gravity is (0, 0, -1).
    """
    with mp.workdps(30):
        M = mp.matrix(body["inertia"])
        r_oc, mass = mp.matrix(body["r_oc_b"]), mp.mpf(body["mass"])
        q0 = Rotation.from_rotvec(initial["attitude"]["rotvec"]).as_quat(scalar_first=True)
        M_inverse = M**-1

        def cross(a, b):
            return mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])

        def matrix(q):
            e, x, y, z = q
            return mp.matrix([
                [e * e + x * x - y * y - z * z, 2 * (x * y - e * z), 2 * (x * z + e * y)],
                [2 * (x * y + e * z), e * e - x * x + y * y - z * z, 2 * (y * z - e * x)],
                [2 * (x * z - e * y), 2 * (y * z + e * x), e * e - x * x - y * y + z * z],
            ])  # fmt: skip

        inputs = {}

        def load(name, t):
            if name not in inputs:
                return mp.matrix([0, 0, 0])
            u, u1, u2 = (mp.matrix(x) for x in inputs[name])
            return u + t * u1 + t * t / 2 * u2

        def rates(t, y):
            q, w, v = y[0:4], mp.matrix(y[4:7]), y[10:13]
            R = matrix(q)
            force_b = load("force_b", t) + R.T * load("force_a", t)
            torque_b = load("torque_b", t) + R.T * load("torque_a", t) - cross(r_oc, force_b)
            a = R * force_b / mass + mp.matrix([0, 0, -1])
            alpha = M_inverse * (torque_b - cross(w, M * w))
            e, x, y_, z = q
            dq = [-(x * w[0] + y_ * w[1] + z * w[2]) / 2, (e * w[0] + y_ * w[2] - z * w[1]) / 2,
                  (e * w[1] + z * w[0] - x * w[2]) / 2, (e * w[2] + x * w[1] - y_ * w[0]) / 2]  # fmt: skip
            return [*dq, *alpha, *v, *a]

        q = [mp.mpf(float(x)) for x in q0]
        size = mp.sqrt(sum(x * x for x in q))
        q = [x / size for x in q]
        w = mp.matrix(initial["omega_b"])
        r = mp.matrix(initial["position"]) + matrix(q) * r_oc
        v = mp.matrix(initial["velocity"]) + matrix(q) * cross(w, r_oc)
        y, found = [*q, *w, *r, *v], []
        for h, now in pieces:
            inputs = now
            y = gragg(rates, y, mp.mpf(h))
            R, w = matrix(y[0:4]), mp.matrix(y[4:7])
            position = mp.matrix(y[7:10]) - R * r_oc
            velocity = mp.matrix(y[10:13]) - R * cross(w, r_oc)
            found.append([[float(x) for x in part] for part in (y[0:4], w, position, velocity)])
        return found


def gragg(f, y, h):
    """Extrapolated midpoint rule, error some 1e-20: columns of T_jk with n = 2, 4, ... 32 substeps, in 4 steps."""
    t, H = mp.mpf(0), h / 4
    for _ in range(4):
        table = []
        for n in range(2, 34, 2):
            s = H / n
            k = f(t, y)
            a, b = y, [u + s * du for u, du in zip(y, k, strict=True)]
            for i in range(1, n):
                k = f(t + i * s, b)
                a, b = b, [u + 2 * s * du for u, du in zip(a, k, strict=True)]
            k = f(t + H, b)
            row = [[(u + w + s * du) / 2 for u, w, du in zip(a, b, k, strict=True)]]
            for j, previous in enumerate(table[-1] if table else [], 1):
                ratio = (mp.mpf(n) / (n - 2 * j)) ** 2
                row.append([p + (p - o) / (ratio - 1) for p, o in zip(row[-1], previous, strict=True)])
            table.append(row)
        t, y = t + H, table[-1][-1]
    return y
