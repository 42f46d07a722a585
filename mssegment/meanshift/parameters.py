"""The parameters of ``MeanShift``, checked where it is fitted."""

from __future__ import annotations

from typing import Any

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.meanshift.kernels import Kernel
from mssegment.meanshift.large import SAMPLE_SIZE
from mssegment.meanshift.validation import positive_number, shown


def check_parameters(estimator: Any) -> None:
    """Raise a ConfigurationError for the first parameter that is no such thing."""
    for name, smallest in (("min_count", 1), ("max_iter", 1), ("sample_above", SAMPLE_SIZE)):
        value = getattr(estimator, name)
        if value is None and name == "sample_above":
            continue
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
            raise ConfigurationError(f"{name} must be an integer, found {shown(value)}")
        if value < smallest:
            raise ConfigurationError(f"{name} must be at least {smallest}, found {value}")
    if not _is_bandwidth(estimator.bandwidth):
        raise ConfigurationError(
            "the bandwidth must be 'auto', 'knn', a positive number or one for each point, "
            f"found {shown(estimator.bandwidth)}"
        )
    if not isinstance(estimator.kernel, (str, Kernel)):
        raise ConfigurationError(
            f"kernel must be a name or a Kernel, found {shown(estimator.kernel)}"
        )
    if not isinstance(estimator.cluster_all, (bool, np.bool_)):
        raise ConfigurationError(
            f"cluster_all must be True or False, found {shown(estimator.cluster_all)}"
        )
    if estimator.callback is not None and not callable(estimator.callback):
        raise ConfigurationError(
            f"callback must be None or a function, found {shown(estimator.callback)}"
        )


def _is_bandwidth(value: Any) -> bool:
    if isinstance(value, str):
        return value in ("auto", "knn")
    if np.ndim(value) == 1:
        return all(map(positive_number, list(value)))
    return positive_number(value)
