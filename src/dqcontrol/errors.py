"""Every error that dqcontrol raises for a user's mistake, and the helpers that word them."""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_NEAR, _NEAR_FILE = 0.5, 0.65  # of `difflib`: one letter of two, or of a file's three, which no list follows


class Error(Exception):
    """Base class of all errors that dqcontrol raises on purpose."""


class ShapeError(Error, ValueError):
    """An array has the wrong shape or type."""


class ValueRangeError(Error, ValueError):
    """A value lies outside what is allowed, or is not finite."""


class UnknownNameError(Error, KeyError):
    """A name (robot, link, law, key, …) does not exist."""

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError would print the repr


class FileFormatError(Error, ValueError):
    """A file cannot be read as what it claims to be."""


class ReachError(Error, ValueError):
    """A desired pose lies outside what the robot can reach."""


class UnreachableGoalError(ReachError, ValueRangeError):
    """A goal lies where no configuration within the limits has the hand.

    Attributes
    ----------
    nearest
        How near the hand comes, and which limits hold it back; see `dqcontrol.robots.NearestPose`.
    """

    def __init__(self, message: str, nearest: object = None) -> None:
        super().__init__(message)
        self.nearest = nearest


class PlanError(Error, ValueError):
    """There is no plan, or none was found.

    Attributes
    ----------
    reason
        ``start``, ``goal`` (nobody may be there), ``unreachable`` (nobody can), ``effort`` (no way was found), or
        ``path`` (from no posture the hand can go all of its path).
    pair
        What is in the way, as ``table: panda_link5``, or the joint beyond its limit; empty if unknown.
    nearest
        The nearest configuration, shape (n,), or pose that was found; None if unknown.
    sample
        Of a path the first that is not reached; None of other plans.
    """

    def __init__(
        self,
        message: str,
        reason: str = "",
        *,
        pair: str = "",
        nearest: object = None,
        sample: int | None = None,
    ) -> None:
        super().__init__(message)
        self.reason = reason
        self.pair = pair
        self.nearest = nearest
        self.sample = sample


class ExistsError(Error, FileExistsError):
    """An output would overwrite something."""


class MissingExtraError(Error, ImportError):
    """An optional dependency is not installed."""


class DivergedError(Error, ArithmeticError):
    """A run produced NaN or infinity."""


class FallenError(Error, RuntimeError):
    """A simulated robot has fallen over, or lost its grip on the floor."""


class CacheWarning(UserWarning):
    """Compiled code cannot be cached and is compiled anew in each process."""


class LimitWarning(UserWarning):
    """A reference or a law asks for more than the robot's joint limits allow."""


class TaskWarning(UserWarning):
    """A run did not do what was asked, or a robot cannot."""


class CollisionWarning(UserWarning):
    """A hand passes through the floor, or through the base that carries it."""


class SafetyWarning(UserWarning):
    """A simulated robot's safety has switched its motors off."""


class RealTimeWarning(UserWarning):
    """Real-time scheduling was refused."""


class StabilityWarning(UserWarning):
    """A loop is expected to be unstable."""


class InterpretedWarning(UserWarning):
    """A user's own function does not compile and is interpreted."""


class NoteWarning(UserWarning):
    """Something was chosen or completed for the user, who may want to know; nothing is wrong."""


def from_extra(module: str, extra: str, what: str) -> Any:
    """Return a module of a package that only an extra installs; ``what``, in the plural, needs it.

    Raises
    ------
    MissingExtraError
        If it cannot be imported.

    Examples
    --------
    >>> from_extra("no_such", "plan", "plans")
    Traceback (most recent call last):
    ...
    dqcontrol.errors.MissingExtraError: no_such: plans need it and it cannot be imported (No module named 'no_such'); \
pip install 'dqcontrol[plan]'
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"{module.partition('.')[0]}: {what} need it and it cannot be imported ({error}); "
            f"pip install 'dqcontrol[{extra}]'"
        ) from None


@contextmanager
def writing(target: object) -> Iterator[None]:
    """Say that a target cannot be written if the system does not let something inside be written."""
    try:
        yield
    except Error:  # some are OSError as well
        raise
    except OSError as error:
        raise Error(f"{target}: cannot be written: {error.strerror or error}") from None


@contextmanager
def error_prefix(place: str) -> Iterator[None]:
    """Put a place before the message of any of our errors raised inside, unless the message names a file already."""
    try:
        yield
    except FileFormatError:
        raise
    except Error as error:
        raise type(error)(f"{place}: {error}") from None


def suggest(name: str, allowed: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for the nearest allowed name, or an empty string."""
    return _nearest(name, {each: each for each in allowed}, _NEAR)


def suggest_file(path: str | os.PathLike[str]) -> str:
    """Return the same for what is beside a file that is missing; suffixes, which many have, make no two alike."""
    file = Path(path)
    beside = sorted(file.parent.glob("*"), key=lambda each: each.suffix == file.suffix)
    return _nearest(file.stem, {each.stem: each.name for each in beside}, _NEAR_FILE)


def unreadable(path: str | os.PathLike[str], error: OSError) -> FileFormatError:
    """Return the error for a file that cannot be opened or read, with what may have been meant."""
    if isinstance(error, FileNotFoundError):
        return FileFormatError(f"{path}: no such file{suggest_file(path)}")
    if isinstance(error, IsADirectoryError):
        inside = sorted(Path(path).glob("*.yaml"))
        which = f"; did you mean '{inside[0]}'?" if inside else ""
        return FileFormatError(f"{path}: is a folder{which}")
    return FileFormatError(f"{path}: cannot be read: {error.strerror or error}")


def _nearest(name: str, allowed: dict[str, str], cutoff: float) -> str:
    known = {each.casefold(): said for each, said in allowed.items()}
    near = difflib.get_close_matches(name.casefold(), list(known), n=1, cutoff=cutoff)
    return f"; did you mean '{known[near[0]]}'?" if near else ""


def unknown_name(field: str, name: str, allowed: Iterable[str]) -> UnknownNameError:
    """Return the error for a name that is not among the allowed ones."""
    allowed = sorted(allowed)
    return UnknownNameError(
        f"{field}: unknown name '{name}'{suggest(name, allowed)} (allowed: {', '.join(allowed) or 'none'})"
    )


def as_array(
    field: str, value: ArrayLike, shape: tuple[int | None, ...] | None = None
) -> NDArray[np.float64]:
    """Return a finite float64 array, checked against a trailing shape.

    Parameters
    ----------
    field
        Name for the error message.
    value
        Anything that NumPy makes an array of real numbers of.
    shape
        Trailing dimensions; ``None`` stands for any length. Leading axes are batches. ``()`` asks for a scalar.

    Raises
    ------
    ShapeError
        If the value is not numeric or its shape does not end with ``shape``.
    ValueRangeError
        If an element is NaN or infinite.
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "iuf":
            raise TypeError
        array = array.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        raise ShapeError(f"{field}: expected real numbers, got {value!r:.80}") from None
    if shape is not None:
        tail = array.shape[array.ndim - len(shape) :] if array.ndim >= len(shape) else None
        wrong = tail is None or any(want not in (None, got) for want, got in zip(shape, tail, strict=True))
        if wrong or (shape == () and array.ndim):
            wanted = ", ".join("any" if want is None else str(want) for want in shape)
            text = f"shape (…, {wanted})" if shape else "a single number"
            raise ShapeError(f"{field}: expected {text}, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise ValueRangeError(f"{field}: must be finite, got {np.array2string(array, threshold=8)}")
    return array


def as_each(field: str, value: ArrayLike, size: int) -> NDArray[np.float64]:
    """Return so many finite numbers, given one for all of them or one each, as a new array (size,)."""
    array = as_array(field, value)
    if array.shape not in ((), (size,)):
        raise ShapeError(f"{field}: expected one number or {size}, got shape {array.shape}")
    return np.full(size, array)


def as_positive(field: str, value: float, *, zero_allowed: bool = False) -> float:
    """Return a finite number above zero (or not below it)."""
    # searches check thousands
    if type(value) is float and (0.0 < value < math.inf or (zero_allowed and value == 0.0)):
        return value
    number = float(as_array(field, value, ()))
    if number < 0 or (number == 0 and not zero_allowed):
        raise ValueRangeError(f"{field}: must be {'≥' if zero_allowed else '>'} 0, got {number:g}")
    return number


def as_count(field: str, value: int) -> int:
    """Return an integer of at least 0."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
        raise ValueRangeError(f"{field}: expected an integer ≥ 0, got {value!r:.80}")
    return int(value)
