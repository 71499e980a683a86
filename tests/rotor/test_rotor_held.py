"""Pinned and clamped links: closed forms of beams, the limit of stiff springs, reactions."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rotor_machine
from helpers import difference

from jaxcomp import BadInput
from jaxcomp.rotor import (
    Clamped,
    Link,
    ModalDamping,
    Pinned,
    RotorModel,
    ShaftElements,
    campbell,
    critical_speeds,
    damped_modes,
    diagonal,
    harmonic_response,
    node_index,
    respond,
    transmitted_forces,
    undamped_modes,
)
from jaxcomp.scene import loads

LENGTH, DIAMETER, YOUNG, DENSITY, PARTS = 1.0, 0.02, 2.1e11, 7850.0, 10
AREA, SECOND = np.pi / 4 * DIAMETER**2, np.pi / 64 * DIAMETER**4
LAST = PARTS


def beam(*links, length=LENGTH, **options):
    nodes = tuple(range(PARTS + 1))
    shaft = ShaftElements(nodes, length / PARTS, DIAMETER, YOUNG, DENSITY, 0.3, **options)
    return RotorModel((shaft,), links=tuple(Link((node, None), law) for node, law in links))


# Roots of the frequency equations of the slender beam: sin, cos cosh = -1 and 1, tan = tanh.
ROOTS = {
    "pinned-pinned": (((0, Pinned()), (LAST, Pinned())), (np.pi, 2 * np.pi)),
    "clamped-free": (((0, Clamped()),), (1.8751040687119611, 4.694091132974175)),
    "clamped-clamped": (
        ((0, Clamped()), (LAST, Clamped())),
        (4.730040744862704, 7.853204624095838),
    ),
    "clamped-pinned": (((0, Clamped()), (LAST, Pinned())), (3.9266023120479185, 7.068582745628732)),
}


@pytest.mark.parametrize("held", ROOTS)
def test_slender_beams_have_the_frequencies_of_the_closed_forms(held):
    links, roots = ROOTS[held]
    found = undamped_modes(beam(*links, theory="euler-bernoulli"), 4).frequency
    exact = np.square(roots) / LENGTH**2 * np.sqrt(YOUNG * SECOND / (DENSITY * AREA))
    # The cubic element is high by (root/parts)^4/720 or so in its square.
    np.testing.assert_allclose(found[::2] / exact - 1, 0, atol=3e-4)
    np.testing.assert_allclose(found[::2], found[1::2], rtol=1e-9)
    assert found[0] / exact[0] - 1 < 5e-5


def test_a_thick_pinned_beam_has_the_frequencies_of_timoshenko():
    found = undamped_modes(beam((0, Pinned()), (LAST, Pinned()), length=0.1), 4).frequency[::2]
    shear = YOUNG / 2.6 * 6 * 1.3 / (7 + 6 * 0.3)  # Cowper's coefficient times G
    for number, frequency in enumerate(found, 1):
        k = number * np.pi / 0.1
        inertia = DENSITY * (AREA + SECOND * k**2 * (1 + YOUNG / shear))
        square = np.roots([DENSITY**2 * SECOND / shear, -inertia, YOUNG * SECOND * k**4])
        # shear and rotary inertia lower the two by 4.5 and 14 %; the mesh leaves 3e-4 and 3.4e-3
        np.testing.assert_allclose(frequency, np.sqrt(min(square)), rtol=(5e-4, 4e-3)[number - 1])


def test_reactions_of_a_cantilever_are_those_of_statics():
    model = beam((0, Clamped()), (3, Pinned()), theory="euler-bernoulli")
    free = dataclasses.replace(model, links=model.links[:1])
    tip = jnp.zeros((PARTS + 1, 4)).at[LAST, 0].set(10.0).at[0, 1].set(3.0)
    still = harmonic_response(free, tip, 0.0, 0.0)
    np.testing.assert_allclose(
        still.displacement[LAST, 0], 10.0 * LENGTH**3 / (3 * YOUNG * SECOND), rtol=1e-9
    )
    # ux, uy (a load on the clamp itself), thx, thy
    force = transmitted_forces(free, still)
    np.testing.assert_allclose(force[0], [10.0, 3.0, 0.0, 10.0 * LENGTH], atol=1e-7)
    # The pin makes the bending moment at the clamp minus half of that at the pin.
    held = harmonic_response(model, tip, 0.0, 0.0)
    at_pin, pin = 10.0 * 0.7 * LENGTH, 10.0 * (1 + 1.5 * 0.7 / 0.3)
    force = transmitted_forces(model, held)
    np.testing.assert_allclose(force[1], [pin, 0.0, 0.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(force[0], [10.0 - pin, 3.0, 0.0, -at_pin / 2], atol=1e-7)
    assert held.displacement[3, 0] == 0


HELD = (
    Link((4, "h2"), Pinned()),
    Link((6, "h2"), Pinned()),
    Link((2, 4), Pinned(), ("ux",)),
    Link(("h3", "s2"), Clamped()),
    Link((9, "m2"), Pinned(), ("uy", "thx")),
    Link(("head", None), Pinned(), ("uy", "uz")),
)


def stiff(link, value):
    """The same link as a spring; rotations by the square of a length of 0.1 m."""
    if not link.held:
        return link
    k = [value * (1.0 if axis[0] == "u" else 0.01) for axis in link.axes]
    return Link(link.nodes, diagonal(k, np.zeros(len(k))), link.axes)


@pytest.mark.slow
@pytest.mark.parametrize("dof", [4, 6])
def test_held_links_are_the_limit_of_stiff_springs(dof):
    """Chains of pins, and bodies that are held: motions, reactions and modes."""
    model = rotor_machine.machine(dof)
    model = dataclasses.replace(model, links=model.links + HELD)
    speeds, cases = jnp.array([100.0, 310.0]), rotor_machine.loads()
    held, dense = (respond(model, cases, speeds, (1, 2), solver=s) for s in ("structured", "dense"))
    size, rows = jnp.max(jnp.abs(held.displacement)), transmitted_forces(model, held)
    np.testing.assert_allclose(held.displacement, dense.displacement, atol=1e-12 * size)
    assert np.all(held.ok)
    far = []
    for value in (1e12, 1e13):
        other = dataclasses.replace(model, links=tuple(stiff(link, value) for link in model.links))
        motion = respond(other, cases, speeds, (1, 2))
        force = transmitted_forces(other, motion)
        far.append([
            jnp.max(jnp.abs(motion.displacement - held.displacement)) / size,
            jnp.max(jnp.abs(force - rows)) / jnp.max(jnp.abs(rows)),
        ])  # fmt: skip
        modes = [damped_modes(m, 310.0, 4).eigenvalue for m in (model, other)]
        far[-1].append(jnp.max(jnp.abs(modes[0] / modes[1] - 1)))
    # springs ten times as stiff leave a tenth of the difference
    np.testing.assert_allclose(np.array(far[0]) / np.array(far[1]), 10.0, rtol=0.02)
    assert np.max(far[1]) < 1e-3
    a, b = (node_index(model, node) for node in ("h3", "s2"))
    np.testing.assert_allclose(
        held.displacement[..., a, :], held.displacement[..., b, :], atol=1e-20
    )


@pytest.mark.slow
def test_critical_speeds_and_campbell_of_a_pinned_rotor():
    rotor = beam((0, Pinned()), (LAST, Pinned()))
    springs = dataclasses.replace(rotor, links=tuple(stiff(link, 1e12) for link in rotor.links))
    for verb in (
        lambda m: critical_speeds(m, 4).speed,
        lambda m: campbell(m, jnp.array([50.0, 500.0]), 4).frequency,
    ):
        # the springs are 1e7 times as stiff as the beam
        np.testing.assert_allclose(verb(rotor), verb(springs), rtol=1e-6)


@pytest.mark.parametrize("damping", [None, ModalDamping([0.01, 0.01])])
def test_free_modes_know_no_pins(damping):
    rotor = dataclasses.replace(beam((0, Pinned()), (LAST, Clamped())), damping=damping)
    # at rest and without damping the modes of either verb, of which one lists no rigid motions
    alone = undamped_modes(beam(), 10, free=True).frequency
    found = undamped_modes(rotor, 6, free=True).frequency
    np.testing.assert_allclose(found, alone[:6], rtol=1e-6)
    found = damped_modes(rotor, 0.0, 6, free=True).frequency
    np.testing.assert_allclose(found, alone[4:], rtol=1e-6)


@pytest.mark.slow
def test_gradients_pass_through_what_is_held():
    model = rotor_machine.machine()
    model = dataclasses.replace(model, links=model.links + HELD)
    tables, clamp = rotor_machine.loads(), model.links.index(HELD[3])

    def measure(factor):
        arms = dataclasses.replace(model.bodies[0], arm=factor * model.bodies[0].arm)
        here = dataclasses.replace(model, bodies=(arms,))
        motion = respond(here, tables, jnp.array([310.0]))
        force = transmitted_forces(here, motion)
        return jnp.stack(
            [1e6 * jnp.abs(motion.displacement[0, 0, 2, 0]), jnp.abs(force[0, 0, clamp, 0])]
        )

    one = jnp.asarray(1.0)
    slope = difference(jax.jit(measure), one, 1e-4)
    # the difference of fourth order has some 1e-9 of rounding
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jax.jit(mode(measure))(one), slope, rtol=1e-7)
    assert np.all(np.abs(slope) > 1e-3)


@pytest.mark.parametrize(
    "links",
    [
        (Link((4, None), Pinned()), Link((4, None), Clamped())),
        (Link((4, "h2"), Pinned()), Link(("h2", 4), Pinned())),
        (Link(("s2", "s4"), Pinned()),),
        (Link(("s2", None), Pinned()), Link(("s4", None), Pinned())),
    ],
)
def test_what_is_held_twice_is_refused(links):
    model = rotor_machine.machine()
    with pytest.raises(BadInput, match="nothing else holds"):
        dataclasses.replace(model, links=model.links + links)


def test_a_clamp_holds_all_axes():
    assert Link((1, None), Clamped()).axes == rotor_machine.SPACE
    with pytest.raises(BadInput, match="pin single ones"):
        Link((1, None), Clamped(), ("ux", "thx"))
    shaft = ShaftElements((1, 2), 0.2, 0.02, 2.06e11, 7850.0, 0.3)
    with pytest.raises(BadInput, match="no degree of freedom"):
        RotorModel((shaft,), links=tuple(Link((n, None), Clamped()) for n in (1, 2)))


def test_machine_files_name_pinned_and_clamped_links():
    text = """
    [[rotor.shafts]]
    nodes = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10]
    length = "0.1 m"
    outer_diameter = "20 mm"
    young_modulus = "210 GPa"
    density = "7850 kg/m^3"
    poisson = 0.3

    [[rotor.links]]
    nodes = [0, "ground"]
    law = { type = "pinned" }

    [[rotor.links]]
    nodes = [10, "ground"]
    law = { type = "clamped" }
    """
    read = loads(text).parts["rotor"]
    assert [type(link.law) for link in read.links] == [Pinned, Clamped]
    wanted = undamped_modes(beam((0, Pinned()), (LAST, Clamped())), 4)
    np.testing.assert_allclose(undamped_modes(read, 4).frequency, wanted.frequency, rtol=1e-12)
