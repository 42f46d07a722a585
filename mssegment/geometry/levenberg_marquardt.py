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
"""Arrays [B, ...] that describe the B current solutions."""
Linearize = Callable[[State, Integers], tuple[Floats, Floats]]
"""Residuals [b, n] and their Jacobian [b, n, p] at the solutions of the problems ``rows`` [b]."""
Retract = Callable[[State, Floats], State]
"""The solutions after steps [b, p] in their tangent spaces."""

FIRST_DAMPING, DECREASE, INCREASE = 1e-3, 0.1, 10.0
"""Marquardt's damping and its factors after a step that was taken, or not."""
TINY = 1e-300


def damped_step(
    jacobian: Floats, residuals: Floats, damping: Floats, weights: Floats | None = None
) -> Floats:
    """The step [B, p] of Levenberg and Marquardt.

    Solves (J'WJ + damping diag(J'WJ)) step = -J'W r for the Jacobian J [B, n, p], the residuals r
    [B, n] and the weights W [B, n] (one by default); ``damping`` is [B].
    """
    transposed = np.swapaxes(jacobian if weights is None else jacobian * weights[..., None], 1, 2)
    normal = transposed @ jacobian
    side = transposed @ residuals[..., None]
    # a parameter that no residual depends on must not make the system singular
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
    state
        The starts.
    linearize, retract
        The problem; see ``Linearize`` and ``Retract``.
    rounds
        Bound on the number of steps.
    weights
        Of the residuals, [B, n]; one by default.
    tolerance
        A problem rests when its cost changes by no more than this share of it.

    Returns
    -------
    state
        The solutions. A step that would raise a cost is never taken.
    """
    state = tuple(np.array(part) for part in state)
    moving = np.arange(len(state[0]))
    damping = np.full(len(moving), FIRST_DAMPING)
    residuals, jacobian = linearize(state, moving)
    for _ in range(rounds):
        if not len(moving):
            break
        own = None if weights is None else weights[moving]
        step = damped_step(jacobian, residuals, damping, own)
        proposed = retract(tuple(part[moving] for part in state), step)
        new_residuals, new_jacobian = linearize(proposed, moving)
        cost, new_cost = _cost(residuals, own), _cost(new_residuals, own)
        better = new_cost < cost
        for part, new in zip(state, proposed, strict=True):
            part[moving[better]] = new[better]
        damping *= np.where(better, DECREASE, INCREASE)
        going = np.abs(new_cost - cost) > tolerance * cost
        residuals = np.where(better[:, None], new_residuals, residuals)[going]
        jacobian = np.where(better[:, None, None], new_jacobian, jacobian)[going]
        moving, damping = moving[going], damping[going]
    return state


def _cost(residuals: Floats, weights: Floats | None) -> Floats:
    squared = residuals**2
    return np.asarray((squared if weights is None else weights * squared).sum(axis=1))
