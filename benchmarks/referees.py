"""Logarithms and exact gradients against referees: ``python -m benchmarks.referees``.

The truth of a logarithm is mpmath's with 60 digits, of the matrix as it is stored; beside our error
stands that of SciPy's ``logm`` on the same matrix, and, where they are installed, those of
geomstats and pymanopt on SO(3). The truth of a gradient is a difference quotient of 60 digits.
Errors are relative to the norm of the truth. Needs ``pip install .[referees]``.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator

import numpy as np
import scipy.linalg
from scipy.spatial.transform import Rotation

from mssegment.manifolds import MatrixGroup, from_name
from mssegment.records import Floats

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
Case = tuple[str, str, Floats, Floats]
"""Name, manifold, matrix, and its logarithm."""


def mpmath_log(matrix: Floats, determinant_one: bool = False) -> Floats:
    """The logarithm by the eigenvalues, in 60 digits."""
    import mpmath

    mpmath.mp.dps = 60
    exact = mpmath.matrix(matrix.tolist())
    if determinant_one:
        exact = exact / mpmath.cbrt(mpmath.det(exact))
    values, vectors = mpmath.eig(exact)
    logs = mpmath.diag([mpmath.log(value) for value in values])
    found = vectors * logs * vectors**-1
    rows = range(len(matrix))
    return np.array([[float(mpmath.re(found[i, j])) for j in rows] for i in rows])


def turns() -> Iterator[Case]:
    """Rotations by pi - 10^-k: the logarithm is known."""
    for k in [*range(17), 99]:
        angle = np.pi - 10.0**-k
        vector = angle * AXIS
        log = np.cross(np.eye(3), vector)
        yield f"SO(3), pi - 1e-{k}", "so3", Rotation.from_rotvec(vector).as_matrix(), log
    tiny = 1e-14 * AXIS
    yield "SO(3), 1e-14", "so3", np.eye(3) + np.cross(np.eye(3), tiny), np.cross(np.eye(3), tiny)


def ratios(rng: np.random.Generator, count: int = 6) -> Iterator[tuple[str, list[Case]]]:
    """Matrices whose eigenvalues have ratios up to 1e10."""
    for exponent in (2, 4, 6, 8, 10):
        for name, size in (("affine(2)", 2), ("special_linear(3)", 3)):
            cases: list[Case] = []
            for _ in range(count):
                basis = np.eye(size) + 0.3 * rng.standard_normal((size, size))
                values = 10.0 ** np.linspace(0.5 * exponent, -0.5 * exponent, size)
                linear = basis @ np.diag(values) @ np.linalg.inv(basis)
                matrix = np.eye(3)
                matrix[:size, :size] = linear
                if size == 2:
                    matrix[:2, 2] = rng.standard_normal(2)
                else:
                    matrix /= np.cbrt(np.linalg.det(matrix))
                cases.append((name, name, matrix, mpmath_log(matrix, size == 3)))
            yield f"{name}, eigenvalue ratio 1e{exponent}", cases


def error(found: Floats, truth: Floats) -> float:
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def scipy_log(matrix: Floats) -> Floats:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(np.real(scipy.linalg.logm(matrix)))


def peers() -> dict[str, Callable[[Floats], Floats]]:
    """Logarithms of rotations by other packages."""
    found: dict[str, Callable[[Floats], Floats]] = {"scipy logm": scipy_log}
    try:
        from geomstats.geometry.special_orthogonal import SpecialOrthogonal

        space = SpecialOrthogonal(n=3, equip=False)
        found["geomstats"] = lambda m: np.asarray(
            space.skew_matrix_from_vector(space.rotation_vector_from_matrix(m))
        )
    except ImportError as reason:  # also where it does not know this NumPy
        print(f"without geomstats: {reason}")
    try:
        from pymanopt.manifolds import SpecialOrthogonalGroup

        group = SpecialOrthogonalGroup(3)
        found["pymanopt"] = lambda m: np.asarray(group.log(np.eye(3), m))
    except ImportError as reason:
        print(f"without pymanopt: {reason}")
    return found


def gradients(rng: np.random.Generator) -> Iterator[tuple[str, float]]:
    """The largest error of the exact gradient, at every distance where the logarithm is unique."""
    for name in ("affine(2,exact)", "special_linear(3,exact)", "se3(exact)", "sim2(exact)"):
        group = from_name(name)
        assert isinstance(group, MatrixGroup)
        for length in (1e-3, 0.1, 1.0, 3.0, 6.0, 12.0):
            e = np.broadcast_to(np.eye(group.size), (40, group.size, group.size))
            y = group.exp(e, length * group.random_tangent(e, rng))
            log = group.log(e, y)
            angles = np.abs(np.angle(np.linalg.eigvals(y)))
            unique = np.abs(group.norm(e, log) - length) < 1e-6 * length
            unique &= (angles < 3.1).all(axis=1)
            if not unique.any():
                continue
            x, y = e[unique][:8], y[unique][:8]
            u = group.random_tangent(x, rng)
            slopes = [_slope(a, b) for a, b in zip(u, y, strict=True)]
            found = group.inner(x, group.neg_half_grad_sq_dist(x, y), u)
            yield f"{name}, |log| {length:g}", float(np.abs(found - slopes).max() / length)


def _slope(u: Floats, y: Floats) -> float:
    """-1/2 d |log exp(-t u) y|^2 / dt at t = 0, as a central difference with 60 digits."""
    import mpmath

    mpmath.mp.dps = 60
    step = mpmath.mpf(10) ** -15
    target, tangent = mpmath.matrix(y.tolist()), mpmath.matrix(u.tolist())

    def square(t: object) -> object:
        values, vectors = mpmath.eig(mpmath.expm(-t * tangent) * target)
        log = vectors * mpmath.diag([mpmath.log(value) for value in values]) * vectors**-1
        return sum(mpmath.re(entry) ** 2 for entry in log)

    return float(-(square(step) - square(-step)) / (4 * step))


def main() -> None:
    """Print all errors."""
    others = peers()
    print(f"{'logarithm':<40} {'ours':>9}  " + "  ".join(f"{name:>10}" for name in others))
    for name, manifold, matrix, truth in turns():
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = [from_name(manifold).log(np.eye(3), matrix)]
            found += [log(matrix) for log in others.values()]
        # within rounding of half a turn the logarithm and its negative are both right
        signs = (1, -1) if np.linalg.norm(truth) > np.sqrt(2) * (np.pi - 1e-15) else (1,)
        own, *theirs = [min(error(sign * log, truth) for sign in signs) for log in found]
        print(f"{name:<40} {own:9.1e}  " + "  ".join(f"{each:10.1e}" for each in theirs))
    rng = np.random.default_rng(0)
    for name, cases in ratios(rng):
        own = max(error(from_name(m).log(np.eye(3), a), truth) for _, m, a, truth in cases)
        theirs = [max(error(scipy_log(a), truth) for _, _, a, truth in cases)]
        print(f"{name:<40} {own:9.1e}  " + "  ".join(f"{each:10.1e}" for each in theirs))
    print(f"\n{'exact gradient':<40} {'ours':>9}")
    for name, own in gradients(rng):
        print(f"{name:<40} {own:9.1e}", flush=True)


if __name__ == "__main__":
    main()
