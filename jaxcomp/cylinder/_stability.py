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

from ._cycle_collocation import assemble, factorise, linearise
from ._cylinder import Case
from ._cylinder_system import Cylinders
from ._event_panels import Mesh, Unknowns, at_points
from ._waves import Waves


def largest_multiplier(case: Case, mesh: Mesh, z: Unknowns, waves: Waves | None = None) -> float:
    """The Floquet multiplier of the largest magnitude, of one cylinder [-].

    Args:
        case: cylinder, lines and speed.
        mesh: panels and events of a cycle by collocation.
        z: its unknowns.
        waves: at the flanges of pipes, which a disturbance is taken to leave as they are.

    Returns:
        With its sign where it is real, else its magnitude.
    """
    # by NumPy: values alone, of a matrix that is not symmetric
    multipliers = np.linalg.eigvals(np.asarray(_revolution_matrix(case, mesh, z, waves)))
    largest = multipliers[np.argmax(np.abs(multipliers))]
    # rounding may leave a real one with a trace of an imaginary part
    if abs(largest.imag) < 1e-9 * abs(largest):
        return float(largest.real)
    return float(abs(largest))


@eqx.filter_jit
def _revolution_matrix(case: Case, mesh: Mesh, z: Unknowns, waves: Waves | None):
    """From the states at the beginning of the revolution to those at its end (n, n)."""
    system = Cylinders(case, jnp.zeros(1))
    if waves is None:
        _, blocks, _ = linearise(system, mesh, z)
    else:
        system = system.with_waves(waves)
        parts = at_points(system.jacobian_at_flanges, mesh, z)
        _, blocks, _ = assemble(system, mesh, z, *parts.panels)
    maps = factorise(blocks).maps
    size = maps.shape[-1]

    def pass_panel(before, panel_map):
        return panel_map @ before, None

    revolution, _ = lax.scan(pass_panel, jnp.eye(size), maps)
    # the last entry is the angle at which the revolution begins, which does not move
    return revolution[:-1, :-1]
