"""What is left out costs nothing: operations of the compiled programs, from the barest scene up."""

import dataclasses
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.scenes import lean_program, lean_scenes

from jaxcomp import Collocation, load
from jaxcomp.study import AnalysisOptions
from jaxcomp.study.accuracy._study import Program

_ABSCISSAE, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def by_hand(m):
    """Mean force on the main journal of an in-line machine without friction at constant speed.

    Written down in a straight line, on the same panels: what a user would write who needs this
    number alone.
    """
    r, l, b = m.mechanism.crank_radius, m.mechanism.conrod_length, m.mechanism.conrod_centre
    gas, mass, square = m.gas, m.mechanism.conrod_mass, m.motor.mean_speed**2
    area = jnp.pi * m.mechanism.bore**2 / 4
    clearance = gas.clearance_ratio * 2 * r * area
    largest = 2 * r * area + clearance
    opening = (gas.discharge_pressure / gas.suction_pressure) ** (1 / gas.exponent)

    def angle_of(volume):
        x = l + r - (volume - clearance) / area
        return jnp.arccos((x**2 + r**2 - l**2) / (2 * r * x))

    whole = jnp.asarray(2 * jnp.pi)
    opens, closes = whole - angle_of(largest / opening), angle_of(clearance * opening)
    edges = jnp.stack([jnp.zeros(()), closes, whole / 2, opens, whole])
    angle = (edges[:-1, None] + jnp.diff(edges)[:, None] * (_ABSCISSAE + 1) / 2).ravel()
    s, c = jnp.sin(angle), jnp.cos(angle)
    sin_rod = -r * s / l
    cos_rod = jnp.sqrt(1 - sin_rod**2)
    turn = -r * c / (l * cos_rod)
    turn_2 = (r * s / l + sin_rod * turn**2) / cos_rod
    x, x_2 = r * c + l * cos_rod, -r * c - l * (turn_2 * sin_rod + turn**2 * cos_rod)
    volume = clearance + area * (r + l - x)
    inward = gas.suction_pressure * (largest / volume) ** gas.exponent
    outward = gas.discharge_pressure * (clearance / volume) ** gas.exponent
    inward = jnp.minimum(inward, gas.discharge_pressure)
    pressure = jnp.where(s < 0, inward, jnp.maximum(outward, gas.suction_pressure))
    centre_x = (-r * c - b * (turn_2 * sin_rod + turn**2 * cos_rod)) * square
    centre_y = (-r * s + b * (turn_2 * cos_rod - turn**2 * sin_rod)) * square
    small_x = -(pressure - gas.back_pressure) * area - m.mechanism.piston_mass * x_2 * square
    big_x = mass * centre_x - small_x
    moment = m.mechanism.conrod_inertia * turn_2 * square + (l - b) * sin_rod * small_x
    moment = moment + b * (cos_rod * mass * centre_y - sin_rod * big_x)
    small_y = moment / (l * cos_rod)
    big_y = mass * centre_y - small_y
    swing = m.crankshaft.unbalance * square
    weight = (jnp.diff(edges)[:, None] * _WEIGHTS / 2).ravel()
    return weight @ jnp.hypot(big_x - swing * c, big_y - swing * s) / whole


def named(scene):
    return {one.name: one for one in lean_scenes(scene)}


@pytest.fixture(scope="module")
def crank():
    """The scenes of the single-cylinder machine, which ends at the crank."""
    return named(load("mayekawa-wbhe"))


BARE, HELD = "crank: given speed, no friction", "crank: given speed"
LOOSE, WHOLE = "crank: fluctuating speed, no friction", "crank: fluctuating speed"


@pytest.fixture(scope="module")
def bare(crank):
    return lean_program(crank[BARE])


@pytest.fixture(scope="module")
def hand(crank):
    return Program(by_hand, crank[BARE].design.compressor)


def test_barest_scene_has_no_inner_solve_and_no_elements(bare):
    assert " while(" not in bare.text
    assert "lapack" not in bare.text


def test_barest_scene_is_right(bare, hand, crank):
    design = crank[BARE].design
    value, ok = bare(design)
    assert bool(ok)
    # the same sums in another order
    assert float(value) == pytest.approx(float(hand(design.compressor)), rel=1e-12)


def test_barest_scene_costs_little_more_than_what_is_written_by_hand(bare, hand):
    # 3.7 times: residual of the joints, energy account and resolution, which no result skips
    # 4.02 measured: banks and throws are turned for one cylinder as for sixteen
    assert bare.flops < 4.1 * hand.flops


def test_friction_and_fluctuation_cost_only_where_they_are(bare, crank):
    loose, held = lean_program(crank[LOOSE]), lean_program(crank[HELD])
    # measured 4 and 100 times: the iterations of the orbit and twice the nodes, which tell its error; the
    # joint loop and the places of its reversals
    assert 1.3 * bare.flops < loose.flops < 6 * bare.flops
    assert 10 * bare.flops < held.flops
    assert loose.text.count(" while(") == 1  # the iterations and nothing else
    assert bare.memory < loose.memory < held.memory


def test_a_law_that_is_left_out_is_not_traced(crank):
    """Each joint of the friction costs operations of its own."""
    machine = crank[HELD].design.compressor
    assert machine.friction is not None
    costs = []
    for left_out in (("piston_pin", "crank_pin"), ("piston_pin",), ()):
        friction = dataclasses.replace(machine.friction, **dict.fromkeys(left_out))
        changed = dataclasses.replace(machine, friction=friction)
        design = dataclasses.replace(crank[HELD].design, compressor=changed)
        # without panel edges at load reversals: the joint loop alone, in seconds
        options = AnalysisOptions(Collocation(nodes=8, reversals=0))
        costs.append(lean_program(crank[HELD]._replace(design=design, options=options)).flops)
    assert costs[0] < costs[1] < costs[2]


@pytest.mark.slow
def test_every_part_of_the_fullest_scene_costs_and_every_part_left_out_saves():
    scenes = named(load("hermetic-68cc"))
    costs = {name: lean_program(one) for name, one in scenes.items()}
    flops = {name: cost.flops for name, cost in costs.items()}
    crank = [BARE, LOOSE, WHOLE, "crank: fluctuating speed, film journals"]
    rotor = [name for name in flops if name.startswith("rotor: ")]
    fullest = [name for name in flops if name.startswith("all: ")]
    assert len(rotor) == 4
    assert len(fullest) == 1
    # the forces on the rotor are those of a crank at a given speed
    for ladder in (crank, [BARE, HELD, WHOLE], rotor, [HELD, *fullest], rotor[-1:] + fullest):
        costs_of_ladder = [flops[name] for name in ladder]
        assert all(a < b for a, b in pairwise(costs_of_ladder))
    # measured 324 times
    assert flops[fullest[0]] > 200 * flops[BARE]
    # a scene without a crank has nothing of it: no loop but those of the elimination
    assert "lapack" in costs[rotor[0]].text
    assert all("lapack" not in costs[name].text for name in crank)
