"""Viscosity and thermal conductivity of gas mixtures by mixing rules.

Of the dilute gas by Wilke (1950), J. Chem. Phys. 18, 517, Eqs. (13), (14), and by Wassiljewa's equation
with the same coefficients (Mason and Saxena (1958), Phys. Fluids 1, 361). What density adds is the mole
average of what it adds to the components at the same reduced density.
"""

from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .._core.extremes import clip
from ._helmholtz import fluid_data


class TransportFits(NamedTuple):
    """Polynomials of n components as in their data files.

    Attributes:
        molar_mass: [kg/mol] (n,)
        T_r: [K] (n,) by which temperatures are divided.
        T: [K] (n, 2) ends of the fits.
        density_most: (n,) highest density of the fits over the reducing one.
        viscosity, conductivity: (n, 6, 5) coefficients.
    """

    molar_mass: np.ndarray
    T_r: np.ndarray
    T: np.ndarray
    density_most: np.ndarray
    viscosity: np.ndarray
    conductivity: np.ndarray


@cache
def transport_fits(components: tuple[str, ...]) -> TransportFits:
    """Polynomials of components."""
    rows = []
    for name in components:
        fluid = fluid_data(name)
        fit = fluid["transport"]
        row = TransportFits(
            molar_mass=fluid["molar_mass"],
            T_r=fluid["T_r"],
            T=fit["T"],
            density_most=fit["rho_most"] / fluid["rho_r"],
            viscosity=fit["viscosity"],
            conductivity=fit["conductivity"],
        )
        rows.append(row)
    return TransportFits(*(np.array(column) for column in zip(*rows, strict=True)))


def mixed_transport(components: tuple[str, ...], x, T, reduced_density):
    """Viscosity [Pa s] and conductivity [W/(m K)] of a gas mixture.

    Args:
        components: n names.
        x: (n,) mole fractions.
        T: [K] of any shape.
        reduced_density: of the same shape.
    """
    fits = transport_fits(components)
    T, reduced_density = jnp.broadcast_arrays(jnp.asarray(T), jnp.asarray(reduced_density))
    # components along a new first axis
    column = (-1,) + (1,) * T.ndim
    at = clip(T, fits.T[:, 0].reshape(column), fits.T[:, 1].reshape(column))
    at = at / fits.T_r.reshape(column)
    dense = clip(reduced_density, 0.0, fits.density_most.reshape(column))

    def values(table, y):
        """(n, *T) by Horner's rule in both variables."""
        total = jnp.zeros(at.shape)
        for row in np.moveaxis(table, 1, 0)[::-1]:
            along = jnp.zeros(at.shape)
            for coefficient in row.T[::-1]:
                along = along * y + coefficient.reshape(column)
            total = total * at + along
        return total

    viscosity = values(fits.viscosity, 0.0)
    conductivity = values(fits.conductivity, 0.0)
    # Wilke's rule: each component is hindered by all others, by their viscosities and masses
    mass = fits.molar_mass
    ratio = viscosity[:, None] / viscosity[None, :]
    masses = (mass[:, None] / mass[None, :]).reshape((mass.size, mass.size) + (1,) * T.ndim)
    interaction = (1 + jnp.sqrt(ratio) * masses**-0.25) ** 2 / jnp.sqrt(8 * (1 + masses))
    shares = x.reshape(column)
    hindrance = jnp.sum(x.reshape((1, *column)) * interaction, axis=1)

    def mixed(dilute, table):
        added = jnp.sum(shares * (values(table, dense) - dilute), axis=0)
        return jnp.sum(shares * dilute / hindrance, axis=0) + added

    return mixed(viscosity, fits.viscosity), mixed(conductivity, fits.conductivity)
