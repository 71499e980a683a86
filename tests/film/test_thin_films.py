"""A film thinner than the roughness is a status; its thickness is above zero and known by name."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import AnalysisOptions, Status, load, problem, solve_orbit
from jaxcomp.crank import Collocation, journal_films
from jaxcomp.crank._films import film_thickness
from jaxcomp.scene import with_value

PIN = {"type": "film", "film": "short", "diameter": "90 mm", "length": "45 mm",
       "radial_clearance": "45 um", "dynamic_viscosity": "10 mPa s"}  # fmt: skip
COARSE = Collocation(8, reversals=0, tolerance=1e-5)  # films of microns need no more


@pytest.fixture(scope="module")
def scene():
    return with_value(load("mayekawa-wbhe"), "friction.crank_pin", PIN)


@pytest.fixture(scope="module")
def solved(scene):
    """Status, least film at the nodes and between them, over viscosity and roughness."""
    machine = scene.compressor

    @jax.jit
    @jax.vmap
    def solve(viscosity, roughness):
        def where(c):
            return c.friction.crank_pin.dynamic_viscosity, c.friction.crank_pin.roughness

        made = eqx.tree_at(where, machine, (viscosity, roughness), is_leaf=lambda x: x is None)
        orbit = solve_orbit(made, COARSE, throw=False)
        nodes, film = film_thickness(made, orbit)["crank_pin"], journal_films(made, orbit)
        return orbit.status, jnp.min(nodes), film["crank_pin"].minimum_film

    # of an oil, of hardly any, and of an oil in a bearing that is rougher than its film
    return solve(jnp.array([1e-2, 1e-9, 1e-2]), jnp.array([1e-8, 1e-8, 1e-4]))


def test_a_film_below_the_roughness_is_a_status(solved):
    status, nodes, _ = solved
    assert (status == Status.converged).tolist() == [True, False, False]
    assert (status == Status.thin_film).tolist() == [False, True, True]
    assert 1e-6 < nodes[0] < 1e-4
    assert nodes[1] < 1e-8


def test_the_least_film_is_above_zero_and_near_that_of_the_nodes(solved):
    _, nodes, between = solved
    assert np.all(between > 0)
    # the least lies between nodes, and a film changes by a fifth from node to node of this mesh
    np.testing.assert_allclose(between, nodes, rtol=0.3)
    assert np.all(between <= nodes * (1 + 1e-12))


def test_studies_know_the_least_film_by_name(scene):
    names = {"least_film", "film_thickness.crank_pin"}
    options = AnalysisOptions(COARSE)
    film = problem(scene, {"mechanism.bore": (0.12, 0.14)}, sorted(names), options)
    # as one program: outside of one the whole orbit and all of its films would be computed
    values = jax.jit(lambda bore: film(bore).values)
    pin, least = values(jnp.array([0.13]))
    assert least == pin > 1e-6
