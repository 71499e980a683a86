"""Three and more main bearings under a shaft that bends, on films of a given stiffness."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput, SceneError, load, loads
from jaxcomp.crankshaft import MainBearings
from jaxcomp.film import JournalBearing, NamedBearing
from jaxcomp.friction import CoulombJournal
from jaxcomp.rotor import Link, LoadedFilm, RotorModel, ShaftElements
from jaxcomp.rotor._crankshaft_of_rotor import shaft_bearings

JOURNAL = CoulombJournal(0.013, 0.092)
POSITION = jnp.array([-0.25, 0.05, 0.3])
PLACES = jnp.array([-0.2, -0.1, 0.0, 0.1, 0.2])
STIFFNESS = jnp.array([2e8, 5e8, 1e8])
BENDING = 210e9 * np.pi / 64 * 0.03**4


def beam(stiffness=STIFFNESS, bending=BENDING):
    given = {} if stiffness is None else {"stiffness": stiffness, "bending_stiffness": bending}
    return MainBearings((JOURNAL,) * 3, POSITION, shaft="beam", **given)


def test_forces_and_moments_of_a_beam_on_films_balance():
    found = beam().influence(PLACES)
    np.testing.assert_allclose(jnp.sum(found, axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(POSITION @ found, PLACES, atol=1e-13)


def test_stiff_films_are_rigid_bearings():
    """The error falls with the stiffness."""
    wanted = beam(None).influence(PLACES)
    errors = [
        float(jnp.abs(beam(scale * STIFFNESS).influence(PLACES) - wanted).max())
        for scale in (1e2, 1e3, 1e4)
    ]
    assert errors[0] > 9 * errors[1] > 81 * errors[2] > 0
    assert errors[2] < 1e-3


def test_a_stiff_shaft_on_soft_films_is_rigid():
    """Weights are then the stiffnesses, which are here those of the projected areas."""
    lengths = 0.05 * STIFFNESS / STIFFNESS[0]
    films = tuple(JournalBearing(0.09, length, 4.5e-5, 0.01, film="short") for length in lengths)
    rigid = MainBearings(films, POSITION)
    wanted = rigid.influence(PLACES)
    errors = [
        float(jnp.abs(beam(STIFFNESS, scale * BENDING).influence(PLACES) - wanted).max())
        for scale in (1e4, 1e5)
    ]
    assert errors[0] > 9 * errors[1] > 0
    assert errors[1] < 1e-3
    # what each takes of a force and of a moment at the origin
    soft = beam(STIFFNESS, 1e9 * BENDING).line()
    np.testing.assert_allclose(soft, rigid.line(), rtol=1e-5)


def rotor():
    """A shaft from -0.3 to 0.35 m; the bearings stand on nodes of it."""
    edges = np.arange(0, 27) * 0.025 - 0.3
    count = edges.size
    named = {"a": -0.25, "b": 0.05, "c": 0.3}
    film = {name: LoadedFilm(NamedBearing(name)) for name in named}
    shaft = ShaftElements(
        tuple((i, i + 1) for i in range(count - 1)),
        np.diff(edges),
        0.03,
        210e9,
        7800.0,
        poisson=0.3,
        theory="euler-bernoulli",
    )
    links = tuple(
        Link((int(np.argmin(np.abs(edges - z))), None), film[name]) for name, z in named.items()
    )
    pin = int(np.argmin(np.abs(edges)))
    return RotorModel((shaft,), dof=4, links=links), pin


def on_rotor():
    model, pin = rotor()
    support = MainBearings(
        (JOURNAL,) * 3, POSITION, names=("a", "b", "c"), shaft="rotor", stiffness=STIFFNESS
    )
    return shaft_bearings(model, support, pin)


def test_the_elements_of_a_rotor_give_the_beam():
    found, wanted = on_rotor(), beam()
    # at nodes and between them, beyond the last bearing as well
    places = jnp.concatenate([PLACES, jnp.array([-0.29, 0.0137, 0.31])])
    read = eqx.filter_jit(lambda support: (support.influence(places), support.line()))
    (influence, line), (influence_of_beam, line_of_beam) = read(found), read(wanted)
    np.testing.assert_allclose(influence, influence_of_beam, atol=1e-8)
    np.testing.assert_allclose(line, line_of_beam, atol=1e-7)


TEXT = '[crankshaft.main_journal]\nsource = "assumed"\ntype = "main_bearings"\n'


def test_a_machine_with_a_rotor_bends_its_own_shaft():
    """Of the three bearings the one beside the crank takes less from a shaft that gives way."""
    text = load("hermetic-68cc").text
    flexible = TEXT + 'shaft = "rotor"\nstiffness = ["1e8 N/m", "2e8 N/m", "2e8 N/m"]\n'
    assert text.count(TEXT) == 1
    rigid = loads(text).as_compressor().crankshaft.main_journal
    made = loads(text.replace(TEXT, flexible)).as_compressor().crankshaft.main_journal
    np.testing.assert_allclose(made.position, rigid.position, atol=1e-15)
    place = jnp.zeros(1)
    shares, wanted = made.influence(place)[:, 0], rigid.influence(place)[:, 0]
    assert float(jnp.sum(shares)) == pytest.approx(1.0, abs=1e-8)
    assert float(made.position @ shares) == pytest.approx(0.0, abs=1e-9)
    # force and moment leave one number open
    assert float(jnp.abs(shares - wanted).max()) > 0.01

    model, pin = rotor()

    @jax.jit
    @jax.value_and_grad
    def share_of(log_stiffness):
        stiffness = jnp.array([1e8, 2e8, 2e8]) * jnp.exp(log_stiffness)
        support = MainBearings(
            (JOURNAL,) * 3, POSITION, names=("a", "b", "c"), shaft="rotor", stiffness=stiffness
        )
        return shaft_bearings(model, support, pin).influence(PLACES)[0, 2]

    step = 1e-4
    (fall, _), (_, slope), (rise, _) = (share_of(change) for change in (-step, 0.0, step))
    difference = (rise - fall) / (2 * step)
    # central differences: 1e-8 of the third derivative
    assert float(slope) == pytest.approx(float(difference), rel=1e-6)
    assert abs(float(slope)) > 1e-4


def test_what_a_shaft_on_films_needs_is_named():
    given = (JOURNAL,) * 3, POSITION
    with pytest.raises(BadInput, match=r"stiffness.*of a beam or rotor"):
        MainBearings(*given, stiffness=STIFFNESS)
    with pytest.raises(BadInput, match=r"stiffness.*one for each of 3 bearings"):
        MainBearings(*given, shaft="beam", stiffness=STIFFNESS[:2], bending_stiffness=BENDING)
    with pytest.raises(BadInput, match="bending_stiffness"):
        MainBearings(*given, shaft="beam", stiffness=STIFFNESS)
    with pytest.raises(BadInput, match=r'stiffness.*beside shaft = "rotor"'):
        MainBearings(*given, shaft="rotor")
    with pytest.raises(BadInput, match=r"shaft.*of a machine with a rotor"):
        MainBearings(*given, shaft="rotor", stiffness=STIFFNESS).influence(PLACES)
    text = load("hermetic-68cc").text
    with pytest.raises(SceneError, match=r"stiffness"):
        loads(text.replace(TEXT, TEXT + 'shaft = "rotor"\nstiffness = ["1e8 N/m"]\n'))
