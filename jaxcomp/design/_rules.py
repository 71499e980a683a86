r"""Design variables: rules that turn one number into a whole consistent machine.

A rule is a pure function of a compressor and a value, differentiable in both. It rebuilds the
compressor unchecked, as everything that may run inside `jit` does; a solver reports a design that
left its bounds.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import ANY, POSITIVE, BadInput, Bound, is_traced, replaced
from ..compressor import Compressor
from ..mechanism import SliderCrank, SliderLink


class DesignRule(NamedTuple):
    """A design variable.

    Attributes:
        apply: (compressor, value) -> compressor with that value.
        current: compressor -> the value it has now.
        unit: SI unit of the value.
        bound: admissible values.
        doc: one line for tables and help.
    """

    apply: Callable[[Compressor, Float[Array, ""]], Compressor]
    current: Callable[[Compressor], Float[Array, ""]]
    unit: str
    bound: Bound
    doc: str


def with_bore(compressor: Compressor, bore: Float[Array, ""]) -> Compressor:
    r"""The compressor with another bore at the same displacement and crank ratio.

    Tsuji et al. (2012) Eq. (6), relative to the compressor that is given. With
    $\sigma = (d_0/d)^2$ the crank radius and the rod length become $\sigma$ times as long, so that
    $V_s = \tfrac{\pi}{2} d^2 r$ and $r/l$ stay, and

    $$m_p = (d/d_0)^2\, m_{p0}, \quad m_c = (l/l_0)\, m_{c0}, \quad I_c = (l/l_0)^2\, I_{c0} .$$

    The paper leaves open what follows here: the mass centre keeps its share b/l of the rod, the
    offset of the cylinder its share e/r (which keeps the displacement exact), and the unbalance of
    the crank its share of the rotating moment $m_c r a/l$ of the rod, as a counterweight that is
    designed along. Inertia and mass of the crankshaft and the diameters of pins and journals do not
    change, nor do gas, motor and coefficients of friction.

    A slider-link machine follows the same rule for R and $m_p$. The engaged length of its piston at
    the bottom dead centre grows with the bore, the crank keeps its share of the half balance
    $(m_s + m_p/2)R$, and slider, link, eccentricity and the planes of the shaft stay.

    Args:
        compressor: the machine to start from.
        bore: [m] piston diameter.

    Raises:
        BadInput: a mechanism without such a rule, or a concrete bore that is not positive.

    >>> from jaxcomp import load, with_bore
    >>> machine = load("mayekawa-wbhe").machine
    >>> narrow = with_bore(machine, 0.120)
    >>> for one in (machine, narrow):
    ...     print(f"{one.mechanism.stroke:.4f} m, {1e6 * one.mechanism.swept_volume:.0f} cm3")
    0.1000 m, 1327 cm3
    0.1173 m, 1327 cm3
    """
    mechanism = _ruled(compressor)
    bore = _checked("bore", bore, POSITIVE)
    scale = (mechanism.bore / bore) ** 2
    if isinstance(mechanism, SliderLink):
        return replaced(compressor, mechanism=_link_with_bore(mechanism, bore, scale))
    scaled = replaced(
        mechanism,
        bore=bore,
        crank_radius=mechanism.crank_radius * scale,
        conrod_length=mechanism.conrod_length * scale,
        conrod_centre=mechanism.conrod_centre * scale,
        offset=mechanism.offset * scale,
        piston_mass=mechanism.piston_mass / scale,
        conrod_mass=mechanism.conrod_mass * scale,
        conrod_inertia=mechanism.conrod_inertia * scale**2,
        crank_unbalance=mechanism.crank_unbalance * scale**2,
    )
    return replaced(compressor, mechanism=scaled)


def with_stroke_bore_ratio(compressor: Compressor, ratio: Float[Array, ""]) -> Compressor:
    r"""The compressor with another ratio of crank circle to bore, $2R/D$, by `with_bore`.

    Args:
        compressor: the machine to start from.
        ratio: [-] $2R/D$, the stroke over the bore.

    Raises:
        BadInput: as `with_bore`.
    """
    ratio = _checked("stroke_bore_ratio", ratio, POSITIVE)
    return with_bore(compressor, _ruled(compressor).bore * jnp.cbrt(_ratio(compressor) / ratio))


def with_cylinder_eccentricity(compressor: Compressor, value: Float[Array, ""]) -> Compressor:
    """The slider-link machine with another distance e [m] from the crank to the cylinder's axis.

    Raises:
        BadInput: the mechanism is no slider-link.
    """
    mechanism = _slider_link(compressor)
    value = _checked("cylinder_eccentricity", value, ANY)
    return replaced(compressor, mechanism=replaced(mechanism, eccentricity=value))


def with_piston_clearance(compressor: Compressor, clearance: Float[Array, ""]) -> Compressor:
    """The compressor with another radial clearance [m] of the piston.

    It acts on the drag of the oil film alone: leakage past the piston is not modelled, so the gain
    of a wider clearance has no price here.

    Raises:
        BadInput: there is no film between piston and cylinder, or a clearance that is not positive.
    """
    clearance = _checked("piston_clearance", clearance, POSITIVE)
    name, film = _film(compressor)
    friction = replaced(compressor.friction, **{name: replaced(film, clearance=clearance)})
    return replaced(compressor, friction=friction)


design_rules: dict[str, DesignRule] = {
    "bore": DesignRule(
        with_bore,
        lambda compressor: _ruled(compressor).bore,
        "m",
        POSITIVE,
        "piston diameter at fixed displacement and crank ratio (Tsuji et al. 2012, Eq. 6)",
    ),
    "stroke_bore_ratio": DesignRule(
        with_stroke_bore_ratio,
        lambda compressor: _ratio(compressor),
        "",
        POSITIVE,
        "twice the crank radius over the bore, at fixed displacement",
    ),
    "cylinder_eccentricity": DesignRule(
        with_cylinder_eccentricity,
        lambda compressor: _slider_link(compressor).eccentricity,
        "m",
        ANY,
        "cylinder axis beside the crank axis, of a slider-link",
    ),
    "piston_clearance": DesignRule(
        with_piston_clearance,
        lambda compressor: _film(compressor)[1].clearance,
        "m",
        POSITIVE,
        "radial, of the piston's oil film (no leakage)",
    ),
}


def _link_with_bore(mechanism: SliderLink, bore, scale) -> SliderLink:
    radius, piston_mass = mechanism.crank_radius * scale, mechanism.piston_mass / scale
    engaged = (mechanism.cylinder_length - 2 * mechanism.crank_radius) * bore / mechanism.bore
    length = engaged + 2 * radius
    half = (mechanism.slider_mass + mechanism.piston_mass / 2) * mechanism.crank_radius
    share = (mechanism.slider_mass + piston_mass / 2) * radius / half
    return replaced(
        mechanism,
        bore=bore,
        crank_radius=radius,
        cylinder_length=length,
        crown_to_link=mechanism.crown_to_link - mechanism.cylinder_length + length,
        piston_mass=piston_mass,
        crank_eccentricity=mechanism.crank_eccentricity * share,
        crank_product=mechanism.crank_product * share,
    )


def _ratio(compressor: Compressor):
    mechanism = _ruled(compressor)
    return 2 * mechanism.crank_radius / mechanism.bore


def _ruled(compressor: Compressor) -> SliderCrank | SliderLink:
    """The mechanism, if it is one that the rules know."""
    if not isinstance(compressor.mechanism, SliderCrank | SliderLink):
        raise _unruled(compressor, "a slider_crank or a slider_link")
    return compressor.mechanism


def _slider_link(compressor: Compressor) -> SliderLink:
    if not isinstance(compressor.mechanism, SliderLink):
        raise _unruled(compressor, "a slider_link")
    return compressor.mechanism


def _unruled(compressor, wanted):
    given = getattr(compressor.mechanism, "kind", type(compressor.mechanism).__name__)
    return BadInput("mechanism", given, f"{wanted}, for which this rule is made")


def _film(compressor: Compressor):
    """Name and law of the film between piston and cylinder."""
    for name in ("piston_film", "wall_film"):
        film = getattr(compressor.friction, name, None)
        if film is not None:
            return name, film
    raise BadInput("friction", "without", "one with a film between piston and cylinder")


def _checked(name: str, value, bound: Bound) -> Float[Array, ""]:
    value = jnp.asarray(value, dtype=jnp.result_type(float))
    if not is_traced(value) and not bool(bound.holds(value)):
        raise BadInput(name, value, str(bound))
    return value
