r"""Design variables: rules that turn one number into a whole consistent machine.

A rule is a pure function of a compressor and a value, differentiable in both. It rebuilds the
compressor unchecked, as everything that may run inside `jit` does; a solver reports a design that
left its bounds.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._fields import POSITIVE, BadInput, Bound, is_traced, replaced
from ..compressor import Compressor
from ..mechanism import SliderCrank


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

    Args:
        compressor: the machine to start from, with a slider-crank.
        bore: [m] piston diameter.

    Raises:
        BadInput: the mechanism is no slider-crank, or a concrete bore is not positive.
    """
    mechanism = _slider_crank(compressor)
    bore = _checked("bore", bore, POSITIVE)
    scale = (mechanism.bore / bore) ** 2
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


design_rules: dict[str, DesignRule] = {
    "bore": DesignRule(
        with_bore,
        lambda compressor: _slider_crank(compressor).bore,
        "m",
        POSITIVE,
        "piston diameter at fixed displacement and crank ratio (Tsuji et al. 2012, Eq. 6)",
    )
}


def _slider_crank(compressor: Compressor) -> SliderCrank:
    if not isinstance(compressor.mechanism, SliderCrank):
        given = getattr(compressor.mechanism, "kind", type(compressor.mechanism).__name__)
        raise BadInput("mechanism", given, "a slider_crank, for which this rule is made")
    return compressor.mechanism


def _checked(name: str, value, bound: Bound) -> Float[Array, ""]:
    value = jnp.asarray(value, dtype=jnp.result_type(float))
    if not is_traced(value) and not bool(bound.holds(value)):
        raise BadInput(name, value, str(bound))
    return value
