"""How a solution ended, in words; carried through `jit` and `vmap` as one integer per sample."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Int

from .precision import single_precision


class Status(eqx.Enumeration):
    """Outcome of a solver."""

    converged = "converged"
    not_converged = (
        "the iteration did not reach its tolerance; allow more iterations or a looser tolerance (of "
        "`run`: --tolerance; of a cycle with valves: --cycle method=march)"
    )
    bad_input = "a value lies outside its bound or a rule between values is broken"
    self_locking = (
        "the friction locks the joints: at some crank angle the balance of forces has no unique "
        "solution; lower the coefficients of friction or the tilt of the connecting rod"
    )
    singular = (
        "the system is singular: its planes do not act independently of each other; leave one out, or "
        "take least squares"
    )
    stalled = (
        "the crank comes to a halt within the revolution; the motor is too weak or the inertia too "
        "small"
    )
    unresolved = (
        "the nodes do not resolve the revolution: its duration is not known to 0.1 %, the stated error "
        "of its losses or of the gas work is above 1 % of the work, its energy does not close to 1e-5, "
        "or its fluctuation of speed is not known to 2 %; take more nodes (--solver collocation:16), or "
        "more inertia or speed where the crank all but halts"
    )
    too_many_events = (
        "the valves make more events in a revolution than the largest size has room for, or than the "
        "panels and steps that were given; leave panels, capacity and max_passes of `--cycle` out, or "
        "take heavier plates, softer springs or more damping"
    )
    no_delivery = (
        "nothing is delivered: either the pressure in the cylinder does not open the discharge valve, or "
        "as much comes back through it as leaves (springs too soft or plates too heavy to shut in time)"
    )
    wet = "the gas is below its dew point: wet compression is not modelled"
    no_periodic_state = (
        "no stable periodic state was found: the net work of a revolution does not fall with speed, or "
        "the valves repeat their motion only after two revolutions (`jaxcomp simulate` follows it)"
    )
    film_collapse = (
        "the film of a journal closes within the revolution; give it more viscosity, width or less "
        "clearance, or a load that does not turn at half the speed of the film"
    )
    thin_film = (
        "the film of a journal is thinner than the roughness of its surfaces, where it carries nothing; "
        "give it more viscosity, width or speed, or less clearance or load, such as with `least_film` as "
        "a constraint of `optimise`, or a `contact`, which carries there"
    )
    near_locking = (
        "the friction is about to lock the joints: their margin is below a twentieth, where losses are "
        "many times the forces that cause them and no number of nodes or iterations resolves them; lower "
        "the coefficients of friction or the tilt of the connecting rod"
    )
    out_of_range = (
        "the gas is hotter or denser than 1.2 times the range of its equation of state, where numbers of "
        "it mean nothing; take a lower pressure ratio, colder suction gas or another fluid"
    )
    large_pulsation = (
        "the cycle converged, and its pulsation is beyond 15 % of the line's pressure at a flange, where "
        "waves are no longer linear: the flow may be off by 0.35 of the square of the pulsation "
        "(`pulsation_linear_error`)"
    )
    fast_flow = (
        "the cycle converged, and the mean flow in a pipe is beyond Mach 0.15, where it carries the "
        "waves along, which the equations leave out"
    )


# A result that cannot be relied on though every solver converged: a response without a solution, or
# numbers that are not finite.
UNNAMED = -1


def status_names() -> list[str]:
    """Names of the outcomes, each at the place of its code."""
    # equinox lists them nowhere else
    return list(Status._name_to_item)  # noqa: SLF001  # pyright: ignore


def names_of_codes(
    codes: Int[np.ndarray, "*batch"], names: list[str] | None = None
) -> Int[np.ndarray, "*batch"]:
    """Names of outcomes by their codes; "failed" for `UNNAMED`.

    Args:
        codes: of `Status`, or `UNNAMED`.
        names: by code, of the version that made the codes; those of this one if absent.
    """
    # the code -1 is the last word
    words = np.asarray([*(names or status_names()), "failed"])
    return words[np.asarray(codes, int)]


def ended_in(status: Status, *outcomes: Status) -> Bool[Array, "*batch"]:
    """Whether a solution ended in one of the outcomes; by NumPy outside of traced programs.

    Args:
        status: of a solution, or of a batch of them.
        outcomes: that are asked for.
    """
    codes = status._value  # equinox compares one outcome at a time, each by a program of its own
    library = jnp
    if not isinstance(codes, Tracer):
        codes = np.asarray(codes)
        library = np
    return library.any(library.stack([codes == outcome._value for outcome in outcomes]), axis=0)


def status_meaning(name: str) -> str:
    """Meaning of an outcome and advice on it, by its name.

    Args:
        name: of a `Status`, or "failed".
    """
    if name not in status_names():
        return "a response without a solution, or numbers that are not finite"
    return Status[getattr(Status, name)]


class SolveFailed(RuntimeError):
    """A solver did not find what was asked for; `status` says why.

    Args:
        status: the outcome, a `Status`.
        details: what else is known, for the message.
        result: what the solver ended with, if it ends with something.
    """

    def __init__(self, status, details: str = "", result=None):
        self.status = status
        self.result = result
        meaning = Status[status]
        if details:
            meaning += f" ({details})"
        # single precision is the likelier cause, and stands in front of what a status advises
        super().__init__("; ".join(filter(None, (single_precision(), f"{meaning}."))))


def raise_at_run_time(status, failed, details: Callable[..., str], *numbers) -> None:
    """Let a traced program end with an error where a solution has failed.

    Nothing of the result passes through the check, so that what nobody asks for is not computed for it.

    Args:
        status: the outcome, a `Status`.
        failed: whether it is none to go on with; traced, and in a batch for each.
        details: what else is known, in words, of the numbers.
        numbers: traced.
    """

    def check(value, failed, *numbers):
        if not failed:
            return
        # one error for a batch: that of the highest code
        worst = np.asarray(np.max(value), np.int32)
        outcome = eqx.tree_at(lambda s: s._value, Status.converged, worst)
        raise SolveFailed(outcome, details(*numbers))

    jax.debug.callback(check, status._value, failed, *numbers)
