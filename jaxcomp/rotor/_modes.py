r"""Undamped modes: natural frequencies and deflection shapes without damping and spin."""

from collections.abc import Iterator
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import BadInput
from .._results import Data, Result
from ._conventions import AXES, to_planes
from ._eigen import pencil
from ._layout import layout_of
from ._matrices import matrices
from ._model import RotorModel
from ._system import Operator, System, add_links, bare, elastic_force, marked, operator_at, released


class Modes(Result, eqx.Module):
    """Undamped modes, lowest first.

    Attributes:
        square: [rad2/s2] (m,) eigenvalues w^2; negative where magnetic pull exceeds the stiffness, not a
            number if a number of the model is out of bounds, which only traced values can be.
        shape: [1/sqrt(kg)] (m, nodes, dof) with unit modal mass.
    """

    square: Array
    shape: Array

    table_dims: ClassVar[tuple[str, ...]] = ("mode",)

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units."""
        yield Data("mode", "", jnp.arange(1, self.square.shape[-1] + 1), ("mode",))
        yield Data("natural_frequency", "rad/s", self.frequency, ("mode",))
        yield from shapes(self.shape, "1/kg^0.5")

    @property
    def frequency(self) -> Float[Array, " m"]:
        """[rad/s] (m,) Natural frequencies; not a number where `square` is negative.

        Rounding leaves a rigid motion with a square of either sign, far below the first elastic
        one; it is shown as zero.
        """
        rigid = self.square**2 <= (_RIGID * jnp.max(jnp.abs(self.square))) ** 2
        return jnp.where(rigid, 0.0, jnp.sqrt(jnp.where(rigid, 1.0, self.square)))


def shapes(shape: Array, unit: str) -> Iterator[Data]:
    """The coordinates of mode shapes (modes, nodes, dof), for tables and files."""
    dims = ("mode", "node_number")
    for number, axis in enumerate(AXES[shape.shape[-1]]):
        yield Data(f"shape.{axis}", unit, shape[..., number], dims)


# Rigid motions, computed with their strain energy, stay below 1e-13 of the highest of a handful of
# modes; an elastic mode of a machine would need a period 3e5 times longer to be taken for one.
_RIGID = 1e-11


def undamped_modes(
    model: RotorModel | System,
    count: int = 12,
    *,
    spin_speed: Float[Array, ""] = 0.0,
    free: bool = False,
) -> Modes:
    """The lowest undamped modes: symmetric part of K(W), and M; no gyroscopic terms, no damping.

    Differentiable in both modes, with repeated eigenvalues treated as `_eigen.eigh` says.

    Args:
        model: the model, or the `System` prepared from it.
        count: number of modes.
        spin_speed: [rad/s] at which the links are evaluated.
        free: leave out all links and magnetic pulls (free-free).

    Raises:
        BadInput: more modes than the model has degrees of freedom.
    """
    model = released(model) if free else model
    size = layout_of(model).size
    if not 0 < count <= size:
        raise BadInput("count", count, f"between 1 and the {size} degrees of freedom")
    return _undamped(model, count, jnp.asarray(spin_speed, float), free)


@eqx.filter_jit
def _undamped(model, count, spin_speed, free) -> Modes:
    system = bare(model)
    found = _found(system, count, spin_speed, free)
    return Modes(marked(system, found.square), found.shape)


def _found(system, count, spin_speed, free) -> Modes:
    full = matrices(system, spin_speed, with_links=not free)
    mu, x = pencil((full.stiffness + full.stiffness.T) / 2, full.mass)
    return _modes(system, full, mu[:count], x[:, :count], spin_speed, free)


def _modes(system, full, mu, x, spin_speed, free) -> Modes:
    x = x / jnp.sqrt(mu)
    shape = (full.expand @ x).T.reshape(-1, system.layout.n, system.dof)
    none = jnp.zeros((0, system.dof, system.dof))
    still = jnp.zeros(())
    z = (
        Operator(system, none, none, still, spin_speed)
        if free
        else operator_at(system, spin_speed, still)
    )
    # The strain energy summed over elements has the digits that w^2 = 1/mu - s lost near zero.
    energy = jax.vmap(lambda u: _energy(z, to_planes(u, system.dof)))(shape)
    return Modes(energy / jnp.einsum("im,ij,jm->m", x, full.mass, x), shape)


def _energy(z, u):
    force = elastic_force(z, u, False)
    if len(z.stiffness):
        force = add_links(z.system.layout, force, z.links, u)
    return jnp.sum(u * force.real)


def modal_damping_vectors(system: System) -> Float[Array, "m nodes planes 2"]:
    """M phi sqrt(2 zeta w) of the damped modes on the active degrees of freedom, else zero."""
    layout = system.layout
    ratio = system.model.damping.ratio  # pyright: ignore[reportAttributeAccessIssue, reportOptionalMemberAccess]
    if ratio.shape[0] > layout.size:
        raise BadInput("damping.ratio", ratio, f"at most one value for each of {layout.size} modes")
    modes = _found(system, ratio.shape[0], jnp.zeros(()), False)
    full = matrices(system)
    active = modes.shape.reshape(ratio.shape[0], -1)[:, layout.active.reshape(-1)]
    vectors = jnp.sqrt(2 * ratio * modes.frequency)[:, None] * (active @ full.mass)
    out = jnp.zeros((ratio.shape[0], layout.n * layout.dof))
    out = out.at[:, layout.active.reshape(-1).nonzero()[0]].set(vectors)
    return jax.vmap(lambda v: to_planes(v, layout.dof))(out.reshape(-1, layout.n, layout.dof))
