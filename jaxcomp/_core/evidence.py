"""Evidence for a result: questions that it answers about itself, each with a bound."""

from typing import NamedTuple

# What is left of an energy balance, of a periodicity or of a linear system: solvers reach 1e-9 and
# better, and a millionth of an efficiency is far below what the laws of friction are known to.
_SMALL = 1e-6


class Check(NamedTuple):
    """One question that a result answers about itself.

    Attributes:
        name: what is asked.
        answer: in words or as a number.
        good: whether it is as it should be.
        bound: what it should be.
    """

    name: str
    answer: str
    good: bool
    bound: str


def ended(name: str, status: str, converged: bool) -> Check:
    """Whether a solution or a search has converged."""
    return Check(name, status, converged, "converged")


def is_small(name: str, value: float, tolerance: float = 0.0) -> Check:
    """Whether a residual [-] is small; one that is not a number is not.

    Args:
        name: of the residual.
        value: its size, with either sign.
        tolerance: that the solver was asked for, of which ten times are allowed.
    """
    bound = max(_SMALL, 10 * tolerance)
    return Check(name, f"{abs(value):.1e}", abs(value) <= bound, f"at most {bound:.0e}")


def all_solved(name: str, failed: int, count: int) -> Check:
    """Whether none of so many designs or machines has failed."""
    return Check(f"{name} without a result", f"{failed:,} of {count:,}", failed == 0, "none")
