r"""Pipes: plane waves with the losses of their walls, a given attenuation or turbulent friction.

Mass flow and pressure at the ends of a pipe, both as factors of $e^{st}$:

$$p_a = \cosh\Gamma L\,p_b + Z_c\sinh\Gamma L\,\dot m_b,\quad
\dot m_a = \sinh\Gamma L/Z_c\,p_b + \cosh\Gamma L\,\dot m_b .$$

Viscosity and heat conduction at the wall (Zwikker and Kosten 1949, Sound Absorbing Materials, chapter 2):

$$\Gamma = \frac{s}{c}\sqrt{\frac{1 + (\gamma-1)F(q\sqrt{Pr})}{1 - F(q)}},\quad
Z_c = \frac{c/A}{\sqrt{(1 - F(q))(1 + (\gamma-1)F(q\sqrt{Pr}))}},\quad
q = R\sqrt{s\rho/\mu},\quad F(q) = \frac{2 I_1(q)}{q I_0(q)} .$$
"""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Complex, Float

from .._core.errors import BadInput
from .._core.extremes import clip, maximum
from .._core.fields import NONNEGATIVE, Bound, Part, quantity, spread_columns
from ._gas import PipeGas
from ._network_nodes import check_nodes

# [-] Shear number up to which the continued fraction holds with so many terms: 2e-24 at 12.
_SERIES = 14.0
_TERMS = 30
# Beyond, an expansion in 1/q: 4e-8 at 14, 3e-9 at 20.
_ASYMPTOTIC = (1.0, -1 / 2, -1 / 8, -1 / 8, -25 / 128, -13 / 32, -1073 / 1024)


class Pipes(Part):
    """Straight pipes from node to node, one between each node of a list and the next.

    A choke tube is a pipe as well.

    Args:
        nodes: names of the places that the pipes join; "line" has the given pressure, "flange" is on
            the side of the valves.
        length: [m] of each pipe.
        diameter: [m] inside.
        roughness: [m] of the wall, for the turbulent friction of the mean flow; smooth if absent.
        attenuation: [1/m] of waves, instead of the losses of the walls and of friction.

    Raises:
        BadInput: fewer than two nodes, a node twice in a row, lengths that are not one for each gap
            between nodes, or both attenuation and roughness.
    """

    kind: ClassVar[str] = "pipes"

    nodes: tuple[str, ...] = eqx.field(static=True)
    length: Float[Array, " p"] = quantity(
        "m", Bound(0.0, 1e3, low_open=True), shape=(None,), spread=True, usual=(0.02, 100.0)
    )
    diameter: Float[Array, " p"] = quantity(
        "m", Bound(1e-3, 5.0), shape=(None,), spread=True, doc="inside", usual=(2e-3, 1.0)
    )
    roughness: Float[Array, " p"] | None = quantity(
        "m",
        NONNEGATIVE,
        shape=(None,),
        spread=True,
        default=None,
        doc="of the wall; smooth if absent",
    )
    attenuation: Float[Array, " p"] | None = quantity(
        "1/m",
        NONNEGATIVE,
        shape=(None,),
        spread=True,
        default=None,
        doc="of waves, instead of the losses of walls and friction",
    )

    def __post_init__(self):
        check_nodes(self.nodes, may_return=True)
        spread_columns(self, len(self.nodes) - 1, "gaps between nodes")

    def __check_init__(self):
        if self.attenuation is not None and self.roughness is not None:
            bound = "absent beside `attenuation`, which stands for all losses: give one of them"
            raise BadInput("roughness", self.roughness, bound)


class WaveLine(NamedTuple):
    """Line constants of pipes.

    Attributes:
        series: [1/(m^2 s)] pressure drop over length and mass flow.
        shunt: [s] mass flow that is stored, over length and pressure.
    """

    series: Complex[Array, "*p"]
    shunt: Complex[Array, "*p"]


def wall_function(q: Complex[Array, "*n"]) -> Complex[Array, "*n"]:
    """F(q) = 2 I_1(q)/(q I_0(q)), of a complex shear number with a positive real part."""
    small = jnp.abs(q) < _SERIES
    # Double where: each expansion overflows or diverges in the domain of the other.
    square = jnp.where(small, q, 1.0) ** 2

    # the continued fraction of I_0 over I_1, from its last term to the first
    def deeper(i, fraction):
        return 2.0 * (_TERMS - i) + square / fraction

    begin = jnp.full_like(square, 2.0 * (_TERMS + 1))
    fraction: Any = lax.fori_loop(0, _TERMS, deeper, begin)
    inverse = 1 / jnp.where(small, _SERIES, q)
    series = jnp.zeros_like(inverse)
    for coefficient in reversed(_ASYMPTOTIC):
        series = coefficient + series * inverse
    return jnp.asarray(jnp.where(small, 2 / fraction, 2 * inverse * series))


def walled_line(gas: PipeGas, diameter: Float[Array, " p"], s: Complex[Array, ""]) -> WaveLine:
    """Line constants of pipes whose walls take momentum and heat."""
    area = np.pi / 4 * diameter**2
    # The wall holds momentum back in a layer of the thickness R/q, and heat in one thinner by the root of
    # Prandtl's number: gas near it is compressed isothermally, and stores more.
    shear_number = diameter / 2 * jnp.sqrt(s * gas.density / gas.viscosity)
    # of both layers at once, as the function is the larger part of a program of pipes
    layers = jnp.stack([shear_number, shear_number * jnp.sqrt(gas.prandtl)])
    of_momentum, of_heat = wall_function(layers)
    momentum = 1 - of_momentum
    heat = 1 + (gas.heat_capacity_ratio - 1) * of_heat
    return WaveLine(s / (area * momentum), s * area / gas.sound_speed**2 * heat)


def attenuated_line(
    gas: PipeGas,
    diameter: Float[Array, " p"],
    attenuation: Float[Array, " p"],
    s: Complex[Array, ""],
) -> WaveLine:
    """Line constants of pipes with a given attenuation, in which waves keep their shape."""
    area = np.pi / 4 * diameter**2
    propagation = s / gas.sound_speed + attenuation
    impedance = gas.sound_speed / area
    return WaveLine(propagation * impedance, propagation / impedance)


class FourPole(NamedTuple):
    """Transfer through pipes: p_a = forward p_b + impedance m_b, m_a = admittance p_b + forward m_b."""

    forward: Complex[Array, " p"]
    impedance: Complex[Array, " p"]
    admittance: Complex[Array, " p"]


def four_pole(line: WaveLine, length: Float[Array, " p"]) -> FourPole:
    """Transfer through lengths of pipe."""
    # the root of the product would lie on the cut of the complex root without losses
    series, shunt = jnp.sqrt(jnp.stack([line.series, line.shunt]))
    angle = series * shunt * length
    return FourPole(
        jnp.cosh(angle), series / shunt * jnp.sinh(angle), shunt / series * jnp.sinh(angle)
    )


def friction_factor(
    reynolds: Float[Array, " p"], relative_roughness: Float[Array, " p"]
) -> Float[Array, " p"]:
    """Darcy's friction factor, laminar below and by Haaland (1983) above the transition.

    Between Re 2000 and 4000 the two are blended, so that derivatives stay finite.
    """
    reynolds = maximum(reynolds, 1.0)
    laminar = 64 / reynolds
    rough = (relative_roughness / 3.7) ** 1.11
    turbulent = (-1.8 * jnp.log10(rough + 6.9 / maximum(reynolds, 2e3))) ** -2
    return laminar + turbulent_share(reynolds) * (turbulent - laminar)


def turbulent_share(reynolds: Float[Array, " p"]) -> Float[Array, " p"]:
    """Share [-] of turbulent friction: none below Re 2000, all above 4000."""
    share = clip((reynolds - 2e3) / 2e3, 0.0, 1.0)
    return share**2 * (3 - 2 * share)
