"""What scikit-learn asks of an estimator: parameters, input, tags, without importing it."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np

from mssegment.errors import ConfigurationError, DataError
from mssegment.records import Floats

MAX_SHOWN = 60
"""Characters of a value in a message."""
LARGEST = 1e150
"""The largest number: its square is finite. The smallest is the reciprocal."""


class InvalidPoints(DataError, ValueError):
    """The points cannot be clustered; a ValueError, as scikit-learn expects."""


class Parameters:
    """``get_params``, ``set_params``, representation and tags, from the constructor's signature."""

    estimator_type: ClassVar[str] = "clusterer"

    @classmethod
    def _names(cls) -> list[str]:
        import inspect  # slow to load

        return list(inspect.signature(cls).parameters)

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The parameters by name; ``deep`` makes no difference, no parameter is an estimator."""
        del deep
        return {name: getattr(self, name) for name in self._names()}

    def set_params(self, **params: Any) -> Self:
        """Set parameters by name.

        Raises
        ------
        ConfigurationError
            For an unknown name; also a ValueError.
        """
        known = self._names()
        for name in params:
            if name not in known:
                raise InvalidParameter(
                    f"Invalid parameter {name!r} for estimator {type(self).__name__}. "
                    f"Valid parameters are: {known!r}."
                )
        for name, value in params.items():
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        import inspect  # slow to load

        defaults = inspect.signature(type(self)).parameters
        changed = [
            f"{name}={value!r}"
            for name, value in self.get_params().items()
            if not _same(value, defaults[name].default)
        ]
        return f"{type(self).__name__}({', '.join(changed)})"

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "_fitted")

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import InputTags, Tags, TargetTags  # only scikit-learn calls this

        return Tags(
            estimator_type=self.estimator_type,
            target_tags=TargetTags(required=False),
            input_tags=InputTags(three_d_array=True),
        )


class InvalidParameter(ConfigurationError, ValueError):
    """There is no such parameter; a ValueError, as scikit-learn expects."""


def not_fitted(estimator: object) -> Exception:
    """scikit-learn's NotFittedError where that is installed, else a like error."""
    message = f"This {type(estimator).__name__} is not fitted yet: call 'fit' first"
    try:
        from sklearn.exceptions import NotFittedError
    except ImportError:
        return NotFitted(message)
    return NotFittedError(message)  # type: ignore[no-any-return]


class NotFitted(ValueError, AttributeError):
    """The estimator has not been fitted."""


class InvalidKind(InvalidPoints, TypeError):
    """The points are no numbers at all; a TypeError, as scikit-learn expects."""


def numbers(x: Any) -> Floats:
    """``x`` as an array of finite numbers with two axes or more.

    Raises
    ------
    InvalidPoints
        For sparse and masked arrays, what is no number, one axis, no entries, NaN and infinity, and
        numbers of which squares overflow.
    """
    if hasattr(x, "toarray"):
        raise InvalidPoints("Sparse data was passed, but dense data is required: use .toarray()")
    mask = getattr(x, "mask", None)  # a method of data frames
    if isinstance(mask, (np.ndarray, np.bool_)) and np.any(mask):
        raise InvalidPoints("masked values are not supported: leave out their points")
    array = real_numbers(x)
    if array.ndim < 2:
        raise InvalidPoints(
            f"Expected 2D array, got {array.ndim}D array instead. Reshape your data using "
            "X.reshape(-1, 1) if it has one feature, or X.reshape(1, -1) if it is one sample"
        )
    if len(array) and not int(np.prod(array.shape[1:])):
        raise InvalidPoints(
            f"Found array with 0 feature(s) (shape={array.shape}) while a minimum of 1 is required."
        )
    if not np.isfinite(array).all():
        bad = int(np.argmin(np.isfinite(array).reshape(len(array), -1).all(axis=1)))
        raise InvalidPoints(f"point {bad} contains NaN or infinity: it is not finite")
    largest = float(np.abs(array).max(initial=0.0))
    if largest > LARGEST or 0.0 < largest < 1.0 / LARGEST:
        raise InvalidPoints(
            f"the largest number is {largest:.3g}, and must be between {1.0 / LARGEST:g} and "
            f"{LARGEST:g}, as squares are computed: choose another unit"
        )
    return array


def real_numbers(x: Any, what: str = "X") -> Floats:
    """``x``, called ``what`` in messages, as an array of real numbers."""
    try:
        array = np.asarray(x)
        if np.iscomplexobj(array):
            raise InvalidPoints("Complex data not supported")
        if array.dtype.kind not in "biufO":
            raise InvalidPoints(f"{what} must be numbers, found the type {array.dtype}")
        return np.asarray(array, dtype=np.float64)
    except InvalidPoints:
        raise
    except TypeError as error:
        raise InvalidKind(f"{what} must be an array of numbers: {error}") from None
    except ValueError as error:
        raise InvalidPoints(f"{what} must be an array of numbers: {error}") from None


def feature_names(x: Any, known: Any = None, owner: str = "") -> Any:
    """The names of the columns of a data frame, None for other input.

    With ``known`` they are compared with those of ``fit``.
    """
    columns = getattr(x, "columns", None)
    names = None
    if columns is not None and all(isinstance(name, str) for name in columns):
        names = np.asarray(columns, dtype=object)
    if known is None:
        return names
    if names is None:
        import warnings

        warnings.warn(
            f"X does not have valid feature names, but {owner} was fitted with feature names",
            stacklevel=3,
        )
    elif list(names) != list(known):
        raise InvalidPoints(_difference(list(names), list(known)))
    return names


def _difference(found: list[str], known: list[str]) -> str:
    """scikit-learn's words for columns that differ from those of ``fit``."""
    lines = ["The feature names should match those that were passed during fit."]
    for title, names in (
        ("Feature names unseen at fit time:", sorted(set(found) - set(known))),
        ("Feature names seen at fit time, yet now missing:", sorted(set(known) - set(found))),
    ):
        if names:
            lines += [title, *(f"- {name}" for name in names)]
    if len(lines) == 1:
        lines.append("Feature names must be in the same order as they were in fit.")
    return "\n".join(lines) + "\n"


def generator(random_state: Any) -> np.random.Generator:
    """A generator from a seed, a generator, a RandomState or None (seed 0)."""
    if isinstance(random_state, np.random.Generator):
        return random_state
    if isinstance(random_state, np.random.RandomState):
        return np.random.default_rng(random_state.randint(2**31))
    seed = 0 if random_state is None else random_state
    if isinstance(seed, (int, np.integer)) and seed >= 0:
        return np.random.default_rng(int(seed))
    raise ConfigurationError(
        "random_state must be None, an integer of at least 0, a numpy.random.Generator or "
        "RandomState, found "
        f"{shown(random_state)}"
    )


def shown(value: Any) -> str:
    """``value`` in one short line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= MAX_SHOWN else text[:MAX_SHOWN] + " ..."


def positive_number(value: Any) -> bool:
    """Whether ``value`` is a positive number of which the square is one too."""
    known = isinstance(value, (int, float, np.integer, np.floating, np.ndarray))
    if not known or isinstance(value, bool) or np.ndim(value):
        return False
    return bool(1.0 / LARGEST <= value <= LARGEST)


def thread_count(n_jobs: Any) -> int:
    """The number of threads that ``n_jobs`` asks for: None is 1, -1 all, -2 all but one."""
    if n_jobs is None:
        return 1
    if isinstance(n_jobs, bool) or not isinstance(n_jobs, (int, np.integer)) or n_jobs == 0:
        raise ConfigurationError(
            f"n_jobs must be None or an integer other than 0, found {n_jobs!r}"
        )
    if n_jobs > 0:
        return int(n_jobs)
    from multiprocessing import cpu_count  # slow to load

    return max(1, (cpu_count() or 1) + 1 + int(n_jobs))


def _same(value: Any, default: Any) -> bool:
    return value is default or (type(value) is type(default) and bool(np.all(value == default)))


def numbers_like_fitted(estimator: Any, x: Any) -> Floats:
    """The points as an array, of as many features as a fitted estimator was fitted to.

    Raises
    ------
    NotFittedError
        Before ``fit``.
    InvalidPoints
        If the names or the number of the features differ, or values are not finite numbers.
    """
    if not hasattr(estimator, "_fitted"):
        raise not_fitted(estimator)
    name = type(estimator).__name__
    feature_names(x, getattr(estimator, "feature_names_in_", None), name)
    raw = numbers(x)
    features = int(np.prod(raw.shape[1:]))
    if features != estimator.n_features_in_:
        raise InvalidPoints(
            f"X has {features} features, but {name} is expecting "
            f"{estimator.n_features_in_} features as input"
        )
    return raw
