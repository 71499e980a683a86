"""Machines of odd size: dimensional analysis at work.

Multiply every quantity of the unit m^a kg^b s^c by L^a M^b T^c. All dimensionless groups stay as they
are, so efficiency and fluctuation must not change, forces grow by M L/T^2, torques by M L^2/T^2 and
speeds by 1/T. The units are those that the fields of the parts declare, so a wrong one shows here too.
"""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pint
import pytest
from crank import test_slider_link_orbit
from helpers import machine, pick, solve_many, stack, status_of
from rotor.test_extreme_rotors import line

from jaxcomp import Collocation, JournalBearing, solve_orbit
from jaxcomp._core.fields import POSITIVE, quantities, replaced, subparts
from jaxcomp.film._bearing import friction_moment
from jaxcomp.film._running import stiffness_damping
from jaxcomp.rotor import Unbalances, respond

# (L, M, T): a crank of 1 mm and one of 1 m at the same pressures, densities and piston speeds; units
# that nobody would mix; powers of two, which no rounding touches
SIZES = {
    "1 mm": (0.02, 0.02**3, 0.02),
    "1 m": (20.0, 20.0**3, 20.0),
    "odd": (1e-3, 1e5, 1e2),
    "binary": (2.0**-10, 2.0**20, 2.0**-6),
}


@cache
def registry() -> pint.UnitRegistry:
    """One for all units: a tenth of a second goes into its definitions."""
    return pint.UnitRegistry()


@cache
def exponents(unit: str) -> tuple[float, ...]:
    """Of length, mass and time in a unit."""
    found = registry().Unit(unit).dimensionality if unit else {}
    return tuple(float(found.get(f"[{name}]", 0)) for name in ("length", "mass", "time"))


def factor(unit, size):
    return float(np.prod([s**e for s, e in zip(size, exponents(unit), strict=True)]))


def rescaled(part, size):
    """A part, and all parts in it, in another size."""
    for path, inner in subparts(part):
        changes = {
            name: getattr(inner, name) * factor(field.metadata["unit"], size)
            for name, field in quantities(inner)
            if getattr(inner, name) is not None
        }
        if not path:
            part = replaced(part, **changes)
            continue
        steps = path.split(".")

        def at(tree, steps=steps):
            for step in steps:
                tree = tree[int(step)] if step.isdigit() else getattr(tree, step)
            return tree

        part = eqx.tree_at(at, part, replaced(inner, **changes))
    return part


def check(orbit, base, size):
    assert status_of(orbit) == status_of(base) == "converged"
    for name in ("mechanical_efficiency", "speed_fluctuation"):
        # rounding of the factors: 1e-16 on each of 30 parameters; passes stop at 1e-13
        assert float(getattr(orbit, name)) == pytest.approx(float(getattr(base, name)), rel=1e-9)
    power = factor("W", size)
    assert float(orbit.motor_power) == pytest.approx(power * float(base.motor_power), rel=1e-9)
    for name, force in base.peak_forces.items():
        assert float(orbit.peak_forces[name]) == pytest.approx(
            factor("N", size) * float(force), rel=1e-8
        ), name
    for name, loss in base.energy.losses.items():
        assert float(orbit.energy.losses[name]) == pytest.approx(
            factor("J", size) * float(loss), rel=1e-8
        ), name
    np.testing.assert_allclose(orbit.time, factor("s", size) * base.time, rtol=1e-8, atol=0)


@pytest.fixture(scope="module")
def slider_crank():
    base = machine(offset=0.01, gravity=(-9.0, 3.0))
    machines = [base, *(rescaled(base, size) for size in SIZES.values())]
    return solve_many(machines, Collocation())


@pytest.mark.parametrize("size", list(SIZES))
def test_slider_crank_of_any_size_is_the_same_machine(slider_crank, size):
    check(slider_crank[1 + list(SIZES).index(size)], slider_crank[0], SIZES[size])


@pytest.mark.slow
def test_slider_link_with_films_of_any_size_is_the_same_machine():
    """Films too; the weight on the thrust bearing goes with g, so L/T^2 is one here."""
    base = test_slider_link_orbit.household()
    sizes = [(25.0, 1e-3, 5.0), (0.04, 7.0, 0.2)]
    machines = stack([base, *(rescaled(base, size) for size in sizes)])
    program = jax.jit(
        jax.vmap(lambda c: solve_orbit(c, test_slider_link_orbit.SOLVER, throw=False))
    )
    first, *others = (pick(program(machines), i) for i in range(3))
    for orbit, size in zip(others, sizes, strict=True):
        check(orbit, first, size)


# One program for every size: outside of one every operation is compiled by itself.
@jax.jit
def film_numbers(bearing, load, speed):
    """Moment, stiffness and damping of a film under a load at a speed."""
    still = 1e-9  # [rad/s] the speed at which a film rests has no size; it must not matter
    moment = friction_moment(bearing, load, speed, rest_speed=still)
    along = load * jnp.array([0.6, -0.8])
    return moment, *stiffness_damping(bearing, along, speed, rest_speed=still)


@pytest.mark.parametrize("size", list(SIZES))
def test_film_bearing_of_any_size_is_the_same_bearing(size):
    base, load, speed = JournalBearing(0.04, 0.02, 2e-5, 0.01), 500.0, 300.0
    units = SIZES[size]
    other = rescaled(base, units)
    args = load * factor("N", units), speed * factor("1/s", units)
    found, expected = film_numbers(other, *args), film_numbers(base, load, speed)
    for a, b, unit in zip(found, expected, ("N m", "N/m", "N s/m"), strict=True):
        np.testing.assert_allclose(a, factor(unit, units) * b, rtol=1e-9)


@pytest.mark.parametrize("size", list(SIZES))
def test_rotor_of_any_size_is_the_same_rotor(size):
    units, speeds = SIZES[size], jnp.array([100.0, 400.0])
    base = line(4)
    load = lambda scale: (Unbalances((2,), [1e-4 * scale], [0.3]),)  # noqa: E731
    expected = respond(base, load(1.0), speeds)
    found = respond(
        rescaled(base, units), load(factor("kg m", units)), speeds * factor("1/s", units)
    )
    assert np.all(np.asarray(found.ok))
    # displacements, and rotations that have no unit
    scale = np.array([units[0], units[0], 1.0, 1.0])
    np.testing.assert_allclose(
        found.displacement, expected.displacement * scale, rtol=1e-9, atol=1e-13 * scale[0]
    )


@pytest.mark.parametrize("value", [1e-300, 1e-9, 1e-6, 1e25])
def test_an_admissible_value_is_never_moved(value):
    """A micrometre or a nanometre is small in SI and large in a bearing."""
    assert float(POSITIVE.clip(jnp.asarray(value))) == value
    assert float(jax.grad(POSITIVE.clip)(value)) == 1.0
    for bad in (0.0, -value, np.nan, np.inf, 1e30, 1e250):
        assert float(POSITIVE.clip(jnp.asarray(bad))) > 0
        assert float(jax.grad(POSITIVE.clip)(bad)) == 0.0
