"""Batched Levenberg-Marquardt: many small nonlinear least-squares problems at a time.

References
----------
Marquardt, An algorithm for least-squares estimation of nonlinear parameters, 1963.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mssegment.records import Floats, Integers

State = tuple[Floats, ...]
"""The B current solutions, as arrays [B, ...]."""
Linearize = Callable[[State, Integers], tuple[Floats, Floats]]
"""Maps solutions of the problems with indices [b] to residuals [b, n] and Jacobian [b, n, p]."""
Retract = Callable[[State, Floats], State]
"""Maps solutions and steps [b, p] in their tangent spaces to new solutions."""

FIRST_DAMPING, DECREASE, INCREASE = 1e-3, 0.1, 10.0
"""Initial damping, and its factors after an accepted and after a rejected step."""
TINY = 1e-300


def damped_step(
    jacobian: Floats, residuals: Floats, damping: Floats, weights: Floats | None = None
) -> Floats:
    """Compute the Levenberg-Marquardt step.

    Solves (J'WJ + damping diag(J'WJ)) step = -J'W r.

    Parameters
    ----------
    jacobian : ndarray [B, n, p]
        J.
    residuals : ndarray [B, n]
        r.
    damping : ndarray [B]
        The damping factors.
    weights : ndarray [B, n], optional
        W; one by default.

    Returns
    -------
    ndarray [B, p]
        The steps; zero in a parameter on which no residual depends.
    """
    transposed = np.swapaxes(jacobian if weights is None else jacobian * weights[..., None], 1, 2)
    normal = transposed @ jacobian
    side = transposed @ residuals[..., None]
    # a parameter on which no residual depends must not make the system singular
    diagonal = np.diagonal(normal, axis1=1, axis2=2)
    ridge = damping[:, None] * diagonal + 1e-15 * diagonal.sum(axis=1, keepdims=True) + TINY
    normal = normal + np.eye(normal.shape[-1]) * ridge[:, None, :]
    return np.asarray(-np.linalg.solve(normal, side)[..., 0])


def minimize(
    state: State,
    linearize: Linearize,
    retract: Retract,
    *,
    rounds: int,
    weights: Floats | None = None,
    tolerance: float = 0.0,
) -> State:
    """Minimize the weighted sums of squared residuals of B problems.

    Parameters
    ----------
    state : tuple of ndarray [B, ...]
        Initial solutions.
    linearize, retract : callable
        The problem; see ``Linearize`` and ``Retract``.
    rounds : int
        Maximum number of steps.
    weights : ndarray [B, n], optional
        Weights of the residuals; one by default.
    tolerance : float
        A problem has converged when the relative change of its cost is not larger.

    Returns
    -------
    tuple of ndarray [B, ...]
        The solutions. A step that would increase the cost is never taken.

    Examples
    --------
    Square roots, as least squares of x^2 - a:

    >>> import numpy as np
    >>> a = np.array([[2.0], [9.0]])
    >>> def linearize(state, rows):
    ...     return state[0] ** 2 - a[rows], 2 * state[0][..., None]
    >>> def retract(state, steps):
    ...     return (state[0] + steps,)
    >>> (x,) = minimize((np.ones((2, 1)),), linearize, retract, rounds=20)
    >>> x.round(6).ravel().tolist()
    [1.414214, 3.0]
    """
    state = tuple(np.array(part) for part in state)
    active = np.arange(len(state[0]))
    damping = np.full(len(active), FIRST_DAMPING)
    residuals, jacobian = linearize(state, active)
    for _ in range(rounds):
        if not len(active):
            break
        selected = None if weights is None else weights[active]
        step = damped_step(jacobian, residuals, damping, selected)
        proposed = retract(tuple(part[active] for part in state), step)
        new_residuals, new_jacobian = linearize(proposed, active)
        cost, new_cost = _cost(residuals, selected), _cost(new_residuals, selected)
        better = new_cost < cost
        for part, new in zip(state, proposed, strict=True):
            part[active[better]] = new[better]
        damping *= np.where(better, DECREASE, INCREASE)
        unfinished = np.abs(new_cost - cost) > tolerance * cost
        residuals = np.where(better[:, None], new_residuals, residuals)[unfinished]
        jacobian = np.where(better[:, None, None], new_jacobian, jacobian)[unfinished]
        active, damping = active[unfinished], damping[unfinished]
    return state


def _cost(residuals: Floats, weights: Floats | None) -> Floats:
    """Weighted sums of squared residuals [B]."""
    squared = residuals**2
    return np.asarray((squared if weights is None else weights * squared).sum(axis=1))
