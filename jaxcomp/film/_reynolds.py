r"""Reynolds (Swift-Stieber) film of the full journal bearing, from a table of solutions.

The film starts with p = 0 on the line of maximum film and ends where p = dp/dn = 0: the film of
Raimondi and Boyd (1958), Butenschoen (1976), VDI 2204, DIN 31652 and ISO 7902. The start travels
with the line of centres.

The Reynolds equation was solved offline (`_generate`). The table holds three smooth functions of
s = sqrt(1 - eps) and ln q as tensor Chebyshev series: ln(Phi_p (1-eps)/(eps q^2)), the attitude
angle, and ln(C_rr (1-eps)^1.5/q^2). They have expansions in eps at one end and in s at the other.
A fourth series gives Phi_T of Phi_p at once, without a position in between.
"""

import functools
import json
from importlib import resources
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from ._chebyshev import SeriesToLimit, chebyshev_sum, collapsed
from ._film import AbstractSolvedFilm, Scalar

# Limits for eps -> 1 at any L/D: the thin zone theta - pi = sqrt(2 (1-eps)) t looks infinitely
# long, h = (1-eps)(1 + t^2), and the Reynolds equation integrates in closed form. (Our derivation;
# the film ends at t = 0.47513.)
LOAD_LIMIT = 1.2237421234783  # Phi_p (1 - eps)
ATTITUDE_LIMIT = 1.8799209353354  # phi/sqrt(1 - eps)
DAMPING_LIMIT = 3.2741379095279  # C_rr (1 - eps)^1.5


class Reynolds(AbstractSolvedFilm):
    """Film with the Reynolds (Swift-Stieber) boundary condition; the default.

    Args:
        length_ratio: [-] q = L/D. The table covers 0.1 to 2 and eps up to 0.995. Beyond that
            eccentricity the functions go over to their limits for a closing film with continuous
            slope; beyond that L/D they go on along the tangent in ln q, which is a guess.
    """

    length_ratio: Scalar
    load: SeriesToLimit
    attitude: SeriesToLimit
    damping_series: SeriesToLimit
    friction: Scalar
    friction_scale: Scalar
    length_ratio_range: ClassVar[tuple[float, float]] = (0.1, 2.0)

    def __init__(self, length_ratio, *, table=None):
        table = _table() if table is None else table
        q = jnp.asarray(length_ratio, dtype=jnp.result_type(float))
        edge, ln_q = float(table["s_range"][0]), jnp.log(q)

        def series(name, limit, limit_slope=None):
            coefficients = collapsed(table[name], table["ln_q_range"], ln_q)
            return SeriesToLimit(coefficients, edge, jnp.asarray(limit, q.dtype), limit_slope)

        self.length_ratio = q
        self.load = series("load", jnp.log(LOAD_LIMIT) - 2 * ln_q)
        self.attitude = series("attitude", 0.0, ATTITUDE_LIMIT)
        self.damping_series = series("damping", jnp.log(DAMPING_LIMIT) - 2 * ln_q)
        self.friction = collapsed(table["friction"], table["ln_q_range"], ln_q)
        self.friction_scale = self.load_gain(jnp.ones_like(q))  # Phi_p at eps = 1/2

    def load_gain(self, film_ratio):
        return self.length_ratio**2 * jnp.exp(self.load(_closeness(film_ratio)))

    def attitude_angle(self, film_ratio):
        return self.attitude(_closeness(film_ratio))

    def damping(self, film_ratio):
        x = film_ratio
        c_rr = self.length_ratio**2 * jnp.exp(self.damping_series(_closeness(x))) * (1 + x) ** 1.5
        # Maxwell's reciprocity of the linearised film: C_tr = C_rt = 2 F_r/eps
        chord = (1 + x) * self.load_gain(x) * jnp.cos(self.attitude_angle(x))
        return c_rr, -2 * chord

    def friction_number(self, load_number):
        # u ~ s for a short bearing and u^2 ~ s for a long one, so that P is smooth up to u = 0.
        # ln(Phi_T/pi) = -2 ln u - 2 (1 - u) + (1 - u)^2 P(u): Petroff's value with zero slope at no
        # load, and Phi_T ~ sqrt(Phi_p) at high load, whatever the polynomial P.
        root = jnp.sqrt(1 + load_number / self.friction_scale)
        u = 1 / jnp.sqrt(root)
        polynomial = chebyshev_sum(self.friction, 2 * u - 1)
        return jnp.pi * root * jnp.exp((1 - u) * ((1 - u) * polynomial - 2))


def _closeness(film_ratio: Scalar) -> Scalar:
    """s = sqrt(1 - eps)"""
    return 1 / jnp.sqrt(1 + film_ratio)


@functools.cache
def _table() -> dict:
    text = resources.files(__package__).joinpath("reynolds_table.json").read_text()
    return {k: np.asarray(v, float) for k, v in json.loads(text).items()}
