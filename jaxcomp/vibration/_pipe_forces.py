r"""The forces of waves on runs of pipe and vessels, as harmonics of time on the rest of the machine.

The waves count their time $\tau$ at the mean speed by an angle of their own, see `Pulsation.phase`, and
orbits theirs from the top dead centre of the first cylinder: $\tau = \Omega t + \tau_{top}$.
"""

import jax.numpy as jnp
from jaxtyping import Array, Complex

from ..compressor import Compressor, check_runs, first_top, run_directions
from ..crank import Orbit
from ..cylinder._quadrature import machine_time
from ..rotor import PeriodicForce, PipeNode


def run_forces(compressor: Compressor, orbit: Orbit) -> dict[str, Complex[Array, "3 n_plus_1"]]:
    r"""[N] Mean and complex amplitudes of the force on every run and vessel.

    For $\mathrm{Re}\,F_n e^{i n\Omega t}$ with the time of the orbit, which begins at the top dead centre
    of the first cylinder; the force in the frame of the machine.

    Args:
        compressor: whose gas may be a `Cylinder` with pipes.
        orbit: its periodic state.
    """
    pulsation = None
    if orbit.cycle is not None:
        pulsation = orbit.cycle.pulsation
    if pulsation is None:
        return {}
    directions = run_directions(compressor)
    own_angle = first_top(compressor) + compressor.crankshaft.phase[0]
    at_top, _ = machine_time(pulsation.case, pulsation.phase, own_angle)
    forces = {}
    for name, series in pulsation.shaking_series().items():
        count = series.size // 2
        # a series has its mean, all cosines, all sines: a cos + b sin is Re (a - ib) e^{in tau}
        amplitudes = series[1 : 1 + count] - 1j * series[1 + count :]
        amplitudes = amplitudes * jnp.exp(1j * jnp.arange(1, count + 1) * at_top)
        of_time = jnp.concatenate([series[:1].astype(complex), amplitudes])
        forces[name] = directions[name][:, None] * of_time
    return forces


def pipe_loads(
    compressor: Compressor, orbit: Orbit, nodes: tuple[PipeNode, ...], orders: tuple[int, ...]
) -> tuple[PeriodicForce, ...]:
    """Forces of runs and vessels on nodes of the rotor.

    With the crank at angle zero at W t = 0 on the mean, as those of the crank.

    Args:
        compressor: with its pipes; one without gas has no such forces.
        orbit: its periodic state.
        nodes: where they act.
        orders: harmonics to keep, 0 for the mean; those beyond the waves' are none.
    """
    of_runs = run_forces(compressor, orbit)
    if not of_runs:
        return ()
    check_runs(compressor, nodes, "loads.pipes")
    loads = []
    for at in nodes:
        amplitudes = of_runs[at.run]
        rows = []
        for order in orders:
            row = jnp.zeros(3, complex)
            if order < amplitudes.shape[1]:
                # from time since the top dead centre to the phase since angle zero, as in
                # `crank_forces`
                row = amplitudes[:, order] * jnp.exp(-1j * order * first_top(compressor))
            rows.append(row)
        table = jnp.stack(rows)
        # Re F e^{inWt} = Re F cos - Im F sin
        loads.append(PeriodicForce(at.node, None, orders, table.real, -table.imag))
    return tuple(loads)
