"""Pipes behind the flanges as the rounds of march and Newton's method meet them."""

from functools import partial

import jax
import jax.numpy as jnp

from ._border import BorderEquations, Both, fixed_responses, limited
from ._cycle_collocation import newton
from ._cycle_options import COARSE
from ._event_panels import resolution
from ._quadrature import is_too_wide
from ._rounds import AbstractLines
from ._waves import waves_at_rest

# From nothing six pipes up to 17 % of pulsation took up to 3 rounds, others up to 37 % took 5.
_ROUNDS = 6


class PipedLines(AbstractLines):
    """Lines that are networks of pipes.

    Where Newton's method leaves the sequence of the valves, so much of its first step of the waves is
    followed as is safe, and the next march meets them.
    """

    def rounds(self, options):
        return max(options.max_rounds, _ROUNDS)

    def waves_at_rest(self, system):
        return waves_at_rest(system.cases.cylinder)

    def marched(self, system, waves):
        return system.with_waves(waves).with_samples()

    def solve(self, system, mesh, z, waves, options):
        equations = BorderEquations(system, mesh, fixed_responses(system, waves))
        start = Both(z, waves)
        new, report = newton(equations, start, options.tolerance, options.max_newton)
        return new.panels, new.waves, report

    def is_coarse(self, system, z):
        wide = is_too_wide(system.first, z.edges, system.orders)
        return wide | (resolution(z) > COARSE)

    def next_waves(self, goes_on, waves, new, report):
        followed = limited(waves, report.first)
        return jax.tree.map(partial(jnp.where, goes_on), new, followed)
