"""A design variable over a range, all values solved at once."""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._status import Status
from ..compressor import Compressor, compressor_of
from ..crank import Collocation, solve_orbit
from ..machine import Machine, machine_of
from ._rules import design_rules


class Figures(NamedTuple):
    """What a design is judged by; with a leading axis for several designs.

    Attributes:
        mechanical_efficiency: [-].
        motor_power: [W] at the shaft.
        gas_power: [W] indicated.
        loss_power: [W] by pair.
        mean_speed: [rad/s].
        margin: [-] against self-locking.
        status: how the solver ended.
    """

    mechanical_efficiency: Float[Array, "*n"]
    motor_power: Float[Array, "*n"]
    gas_power: Float[Array, "*n"]
    loss_power: dict[str, Float[Array, "*n"]]
    mean_speed: Float[Array, "*n"]
    margin: Float[Array, "*n"]
    status: Status


def figures_of(machine: Any, solver: Collocation | None = None) -> Figures:
    """The figures of one design, differentiable.

    Args:
        machine: a compressor, a machine or a scene.
        solver: of the periodic state, as `solve_orbit` takes it.
    """
    orbit = solve_orbit(compressor_of(machine), solver, throw=False)
    return Figures(
        orbit.mechanical_efficiency,
        orbit.motor_power,
        orbit.gas_power,
        orbit.loss_power,
        orbit.mean_speed,
        orbit.margin,
        orbit.status,
    )


def design_study(
    machine: Any,
    variable: str,
    values: Float[Array, " n"],
    solver: Collocation | None = None,
) -> Figures:
    """The figures of a machine over a range of one design variable.

    A value that locks, stalls or breaks a bound has its status and spoils no other.

    Args:
        machine: to start from: a compressor, a machine or a scene.
        variable: name of a rule in `design_rules`.
        values: [SI] (n,) in the unit of the rule.
        solver: as in `figures_of`.

    Raises:
        KeyError: no such rule.
        BadInput: a mechanism for which the rule is not made.
    """
    rule = design_rules[variable]
    # The designs are laid out before anything is compiled, so that studies of other variables with
    # as many values run the same program.
    start = machine if isinstance(machine, Compressor) else machine_of(machine)
    designs = jax.vmap(partial(rule.apply, start))(jnp.asarray(values, float))
    return _all(designs, solver)


@eqx.filter_jit
def _all(designs: Compressor | Machine, solver: Collocation | None) -> Figures:
    return jax.vmap(lambda design: figures_of(design, solver))(designs)
