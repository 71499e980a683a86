"""How thick the oil films of the journals are over a revolution."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..compressor import Compressor
from ..film import AbstractCarryingFilm, JournalBearing, minimum_film
from ..friction import film_journals, joints_of_cylinder
from ..mechanism import SliderCrank, rod_motion
from ._orbit import Orbit


def journal_rates(compressor: Compressor, orbit: Orbit) -> dict[str, Float[Array, " n"]]:
    """[rad/s] Speed of each journal in its bush over the nodes, by joint.

    Args:
        compressor: the machine.
        orbit: its periodic state, or anything with its `state` and `loads`.
    """
    speed, mechanism, several = orbit.state.speed, compressor.mechanism, compressor.cylinders
    rates = dict.fromkeys(orbit.loads.forces, speed)
    if not isinstance(mechanism, SliderCrank):
        return rates
    angles = orbit.state.angle[None] if several is None else several.own_angle(orbit.state.angle)
    for number, tilt in enumerate(rod_motion(mechanism, angles).tilt_1, 1):
        names = {} if several is None else joints_of_cylinder(number)
        for joint, rate in (("piston_pin", tilt), ("crank_pin", 1 + tilt)):
            rates[names.get(joint, joint)] = rate * speed
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
    count = 0 if compressor.cylinders is None else compressor.cylinders.count
    own = [joints_of_cylinder(number + 1) for number in range(count)]
    return {
        name: minimum_film(law, jnp.hypot(*forces[name]), jnp.abs(rates[name]))
        for joint, law in film_journals(compressor.friction).items()
        for name in (joint, *(names[joint] for names in own if joint in names))
        if name in forces and _carries(law)
    }


def _carries(law: JournalBearing) -> bool:
    return issubclass(law.model, AbstractCarryingFilm)
