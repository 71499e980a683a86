r"""Concentrated inertia on a node: rigid disks with an axial offset, and point masses."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import NONNEGATIVE, Part, quantity, spread_columns
from ._shaft import Node


class Disks(Part):
    """A table of rigid axisymmetric disks.

    Args:
        nodes: node name of each disk.
        mass: [kg] (n,)
        transverse_inertia: [kg m2] (n,), about a diameter through the disk's own centre.
        polar_inertia: [kg m2] (n,)
        offset: [m] (n,), z of the centre minus z of the node; absent: on the node.
        spins: whether the disks turn with the shaft.

    Raises:
        BadInput: a negative value, a polar inertia above twice the transverse one, which no body
            has, or a table whose columns differ in length.
    """

    nodes: tuple[Node, ...] = eqx.field(static=True)
    mass: Array = quantity("kg", NONNEGATIVE, shape=(None,), spread=True)
    transverse_inertia: Array = quantity("kg m^2", NONNEGATIVE, shape=(None,), spread=True)
    polar_inertia: Array = quantity("kg m^2", NONNEGATIVE, shape=(None,), spread=True)
    offset: Array | None = quantity("m", shape=(None,), spread=True, default=None)
    spins: bool = eqx.field(static=True, default=True)

    def __post_init__(self):
        spread_columns(self, len(self.nodes), "disks")

    def conditions(self):
        # I_zz <= I_xx + I_yy for any distribution of mass; tables are rounded to some three digits.
        flat = self.polar_inertia <= 2.01 * self.transverse_inertia
        return {"a table with polar inertias of at most twice the transverse ones": flat.all()}


class PointMasses(Part):
    """A table of masses without extent.

    Args:
        nodes: node name of each mass.
        mass: [kg] (n,)
    """

    nodes: tuple[Node, ...] = eqx.field(static=True)
    mass: Array = quantity("kg", NONNEGATIVE, shape=(None,), spread=True)

    def __post_init__(self):
        spread_columns(self, len(self.nodes), "masses")


def solid_disk(
    node: Node, outer_diameter, inner_diameter, width, density, *, spins: bool = True
) -> Disks:
    """One disk of rectangular section, from its dimensions and density.

    Args:
        node: where it sits.
        outer_diameter: [m]
        inner_diameter: [m] 0 without a hole.
        width: [m]
        density: [kg/m3]
        spins: whether it turns with the shaft (gyroscopic terms).
    """
    do, di = jnp.asarray(outer_diameter, float), jnp.asarray(inner_diameter, float)
    mass = density * jnp.pi / 4 * (do**2 - di**2) * width
    polar = mass * (do**2 + di**2) / 8
    transverse = mass * (3 * (do**2 + di**2) / 4 + width**2) / 12
    return Disks((node,), mass[None], transverse[None], polar[None], spins=spins)


def disk_matrices(
    disks: Disks,
) -> tuple[Float[Array, "n 2 2"], Float[Array, "n 2 2"], Float[Array, "n 2 2"]]:
    """Lateral inertia, polar inertia on (u, phi), and inertia on (u_z, th_z), at the nodes."""
    m, b = disks.mass, jnp.zeros_like(disks.mass) if disks.offset is None else disks.offset
    zero = jnp.zeros_like(m)
    spin = disks.polar_inertia if disks.spins else zero
    lateral = _two_by_two(m, m * b, disks.transverse_inertia + m * b**2)
    return lateral, _two_by_two(zero, zero, spin), _two_by_two(m, zero, disks.polar_inertia)


def point_matrices(masses: PointMasses) -> Float[Array, "n 2 2"]:
    """Inertia on (u, phi), which is also that on (u_z, th_z)."""
    zero = jnp.zeros_like(masses.mass)
    return _two_by_two(masses.mass, zero, zero)


def _two_by_two(a, b, c):
    return jnp.stack([jnp.stack([a, b], -1), jnp.stack([b, c], -1)], -2)
