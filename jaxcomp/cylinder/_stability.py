r"""Stability of a periodic cycle.

A small disturbance of the state at the beginning of a revolution is multiplied by the matrix $M$ of the
revolution, the product of the maps of all panels and events. Its eigenvalues are the Floquet multipliers:
the cycle is stable while none is larger than one in magnitude. Past -1 a machine repeats only after two
revolutions.

Source: Leine, Nijmeijer (2004), Dynamics and Bifurcations of Non-Smooth Mechanical Systems, ch. 7.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax

from ._collocation import factorise, linearise
from ._cylinder import Case
from ._panels import Mesh, Unknowns
from ._system import Cylinders


def largest_multiplier(case: Case, mesh: Mesh, z: Unknowns) -> float:
    """The Floquet multiplier of the largest magnitude, of one cylinder [-].

    Args:
        case: cylinder, lines and speed.
        mesh: panels and events of a cycle by collocation.
        z: its unknowns.

    Returns:
        With its sign where it is real, else its magnitude.
    """
    multipliers = np.linalg.eigvals(np.asarray(_revolution_matrix(case, mesh, z)))
    largest = multipliers[np.argmax(np.abs(multipliers))]
    if abs(largest.imag) < 1e-9 * abs(largest):
        return float(largest.real)
    return float(abs(largest))


@eqx.filter_jit
def _revolution_matrix(case: Case, mesh: Mesh, z: Unknowns):
    """From the states at the beginning of the revolution to those at its end (n, n)."""
    system = Cylinders(case, jnp.zeros(1))
    _, blocks, _ = linearise(system, mesh, z)
    maps = factorise(blocks).maps
    size = maps.shape[-1]

    def pass_panel(before, panel_map):
        return panel_map @ before, None

    whole, _ = lax.scan(pass_panel, jnp.eye(size), maps)
    # the last entry is the angle at which the revolution begins, which does not move
    return whole[:-1, :-1]
