"""How thick the oil films of the journals are over a revolution."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..compressor import Compressor
from ..film import AbstractCarryingFilm, JournalBearing, minimum_film
from ..friction import film_journals
from ..mechanism import SliderCrank, rod_motion
from ._orbit import Orbit


def journal_rates(compressor: Compressor, orbit: Orbit) -> dict[str, Float[Array, " n"]]:
    """[rad/s] Speed of each journal in its bush over the nodes, by joint.

    Args:
        compressor: the machine.
        orbit: its periodic state, or anything with its `state` and `loads`.
    """
    speed = orbit.state.speed
    rates = dict.fromkeys(orbit.loads.forces, speed)
    if isinstance(compressor.mechanism, SliderCrank):
        tilt = rod_motion(compressor.mechanism, orbit.state.angle).tilt_1
        rates |= {"piston_pin": tilt * speed, "crank_pin": (1 + tilt) * speed}
    return rates


@eqx.filter_jit
def film_thickness(compressor: Compressor, orbit: Orbit) -> dict[str, Float[Array, " n"]]:
    """[m] Smallest thickness of each journal's oil film, by joint; of films that carry a load.

    Each instant is taken for itself, with the film that carries its load steadily: squeeze, which
    keeps a film thicker where the load turns quickly, is left out.

    Args:
        compressor: the machine.
        orbit: its periodic state.
    """
    rates, forces = journal_rates(compressor, orbit), orbit.loads.forces
    return {
        name: minimum_film(law, jnp.hypot(*forces[name]), jnp.abs(rates[name]))
        for name, law in film_journals(compressor.friction).items()
        if name in forces and _carries(law)
    }


def _carries(law: JournalBearing) -> bool:
    return issubclass(law.model, AbstractCarryingFilm)
