"""The bore rule of Tsuji et al. (2012), Eq. (6)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcomp import BadInput, problem, sweep, tolerance
from jaxcomp.crankshaft import Crankshaft, counterweights
from jaxcomp.mechanism import CrankState
from jaxcomp.scene import SceneError, load, with_value, with_values
from jaxcomp.study import design_rules, design_study, with_bore
from jaxcomp.study.tolerance import within
from jaxcomp.vibration import shaking_wrench


@pytest.fixture(scope="module")
def machine():
    changes = {"mechanism.offset": "12 mm", "mechanism.conrod_inertia": "0.08 kg m^2"}
    return with_values(load("mayekawa-wbhe"), changes).compressor


def test_same_bore_changes_nothing(machine):
    assert eqx.tree_equal(with_bore(machine, 0.13), machine, rtol=1e-15)


def test_displacement_and_crank_ratio_stay(machine):
    new = with_bore(machine, 0.1).mechanism
    old = machine.mechanism
    np.testing.assert_allclose(new.swept_volume, old.swept_volume, rtol=1e-14)
    np.testing.assert_allclose(new.conrod_ratio, old.conrod_ratio, rtol=1e-14)
    assert new.bore == 0.1


def test_masses_follow_the_paper(machine):
    """m_p ~ d^2, m_c ~ l, I_c ~ l^2; I_0, pins, gas and motor stay."""
    new, old = with_bore(machine, 0.1), machine
    d, l = 0.1 / 0.13, (0.13 / 0.1) ** 2
    ratios = {
        "conrod_length": l,
        "piston_mass": d**2,
        "conrod_mass": l,
        "conrod_inertia": l**2,
        "conrod_centre": l,
        "offset": l,
    }
    for name, ratio in ratios.items():
        got = getattr(new.mechanism, name) / getattr(old.mechanism, name)
        np.testing.assert_allclose(got, ratio, rtol=1e-14, err_msg=name)
    assert eqx.tree_equal((new.friction, new.gas, new.motor), (old.friction, old.gas, old.motor))
    assert new.crankshaft.inertia == old.crankshaft.inertia
    assert eqx.tree_equal(new.crankshaft.main_journal, old.crankshaft.main_journal)


def test_counterweight_keeps_its_share_of_the_rod(machine):
    def share(compressor):
        mechanism = compressor.mechanism
        a = mechanism.conrod_length - mechanism.conrod_centre
        moment = mechanism.conrod_mass * a / mechanism.conrod_length * mechanism.crank_radius
        return compressor.crankshaft.unbalance / moment

    for bore in (0.1, 0.16):
        np.testing.assert_allclose(share(with_bore(machine, bore)), share(machine), rtol=1e-14)


def test_rules_chain(machine):
    twice = with_bore(with_bore(machine, 0.1), 0.15)
    assert eqx.tree_equal(twice, with_bore(machine, 0.15), rtol=1e-14, atol=1e-18)


def test_registry_finds_the_rule(machine):
    rule = design_rules["bore_at_displacement"]
    assert (rule.unit, str(rule.bound)) == ("m", "> 0")
    assert rule.current(rule.apply(machine, 0.12)) == 0.12


def test_derivative_equals_finite_differences(machine):
    def mass_and_moment(bore):
        new = with_bore(machine, bore)
        m, angle = new.mechanism, jnp.asarray(0.7)
        return jnp.stack([m.piston_mass, new.crankshaft.unbalance, m.inertia(angle)[0]])

    step = 1e-5
    slope = jax.jit(jax.jacfwd(mass_and_moment))(0.12)
    finite = (mass_and_moment(0.12 + step) - mass_and_moment(0.12 - step)) / (2 * step)
    np.testing.assert_allclose(slope, finite, rtol=1e-7)


@pytest.mark.parametrize("bore", [0.0, -0.1, float("nan")])
def test_bad_bore_is_refused(machine, bore):
    with pytest.raises(BadInput, match="`bore_at_displacement` must be > 0"):
        with_bore(machine, bore)


def test_another_mechanism_is_refused(machine):
    class Other(eqx.Module):
        bore: float = 0.1

    other = eqx.tree_at(lambda c: c.mechanism, machine, Other())
    with pytest.raises(BadInput, match="`mechanism` must be a slider_crank"):
        with_bore(other, 0.1)


LAYOUTS = {
    "V2": {"layout": "V90"},
    "four": {"layout": "V90x2", "throw_pitch": 0.2, "rod_pitch": 0.04},
    "eight": {"layout": "VV45x2", "throw_pitch": 0.2, "rod_pitch": 0.04},
    "radial": {"layout": "radial-5"},
    "boxer": {"layout": "boxer-2", "throw_pitch": 0.1},
}
CASES = [(kind, name) for kind in ("slider_crank", "slider_link") for name in LAYOUTS]


@pytest.mark.parametrize(
    ("kind", "layout"),
    # of one slider-crank the counterweight keeps its share of the rod, as the paper has it
    [*CASES, ("slider_link", "one")],
)
def test_counterweights_of_throws_follow_the_bore(machine, kind, layout):
    """Typed counterweights are after the rule what their formula asks of the new machine."""
    one = machine if kind == "slider_crank" else load("slider-link-8cc").as_compressor()
    shaft = Crankshaft(inertia=one.crankshaft.inertia, **LAYOUTS.get(layout, {}))
    typed = counterweights(one.mechanism, shaft)
    several = eqx.tree_at(lambda c: c.crankshaft, one, typed)
    new = with_bore(several, 0.9 * one.mechanism.bore)
    wanted = counterweights(new.mechanism, new.crankshaft)
    for found, rule in zip(new.crankshaft.throws, wanted.throws, strict=True):
        np.testing.assert_allclose(found.unbalance, rule.unbalance, rtol=1e-13)


@pytest.mark.parametrize("name", ["mayekawa-4wbhe", "mayekawa-8wbhe"])
def test_bundled_machines_keep_no_first_order_at_another_bore(name):
    """At constant speed, in units of the first order of one cylinder; 1e-12 is rounding."""
    narrow = with_bore(load(name).as_compressor(), 0.120)
    angle = jnp.linspace(0, 2 * jnp.pi, 64, endpoint=False)
    speed = jnp.full_like(angle, 100.0)
    force = shaking_wrench(narrow, CrankState(angle, speed, jnp.zeros_like(speed))).force
    first = np.abs(np.fft.rfft(np.asarray(force), axis=-1)[:, 1]) / 32
    one = narrow.mechanism.half_balance * 100.0**2
    assert first.max() < 1e-12 * one


@pytest.mark.parametrize(
    "use",
    [
        lambda machine: problem(machine, {"bore": (0.1, 0.16)}, ["swept_volume"]),
        lambda machine: sweep(machine, {"bore": [0.12, 0.13]}, ["swept_volume"]),
        lambda machine: tolerance(machine, {"bore": within(1e-5)}),
        lambda machine: with_value(machine, "bore", "120 mm"),
        lambda machine: design_study(machine, "bore", np.array([0.12])),
    ],
    ids=["problem", "sweep", "tolerance", "value", "study"],
)
@pytest.mark.parametrize("name", ["mayekawa-wbhe", "two-stage-crosshead"])
def test_a_bore_is_never_taken_for_one_of_its_two_meanings(name, use):
    """With the displacement, or without: whoever says neither is told both names."""
    with pytest.raises((BadInput, SceneError)) as refused:
        use(load(name))
    assert '"bore_at_displacement", with the stroke that keeps' in str(refused.value)
