"""3 x 3 matrices in rational arithmetic, which has no round-off."""

from fractions import Fraction


def exact(A):
    return [[Fraction(x) for x in row] for row in A]


def product(A, B):
    return [[sum(A[i][k] * B[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def transposed(A):
    return [list(column) for column in zip(*A, strict=True)]


def diagonal(d):
    return [[d[i] if i == j else 0 for j in range(3)] for i in range(3)]


def largest_difference(A, B):
    return max(abs(a - b) for row, other in zip(A, B, strict=True) for a, b in zip(row, other, strict=True))


def exact_trace(A):
    return sum(Fraction(A[i][i]) for i in range(3))


def tuples(A):
    return tuple(tuple(map(float, row)) for row in A)


def exact_inverse(M):
    pairs = ((1, 2), (2, 0), (0, 1))
    minors = [[M[j][k] * M[l][m] - M[j][m] * M[l][k] for k, m in pairs] for j, l in pairs]
    det = sum(a * b for a, b in zip(M[0], minors[0], strict=True))
    return [[minors[j][i] / det for j in range(3)] for i in range(3)]
