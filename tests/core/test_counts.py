"""A single number takes no memory or time without bound: counts, layouts, grids, samples."""

import equinox as eqx
import jax.numpy as jnp
import pytest

from jaxcomp import (
    BadInput,
    TimeIntegration,
    load,
    optimise,
    pareto,
    problem,
    sweep,
    tolerance,
    within,
)
from jaxcomp._core.fields import admissible, clipped
from jaxcomp.cli._map import axis
from jaxcomp.cli._start import CommandError
from jaxcomp.crankshaft import Crankshaft
from jaxcomp.gas import PolytropicCycle, StagedCycle
from jaxcomp.gas._gas_law import EachGas
from jaxcomp.study.sweep import grid, log_grid, uniform

MANY = 10**10
SIZES = ("bore", "crank_radius")
GAS = PolytropicCycle(1e5, 4e5, 1.2)


def volume():
    return problem(load("mayekawa-wbhe"), {"mechanism.bore": (0.12, 0.14)}, ["swept_volume"])


def swept(over, samples=None, **options):
    return sweep(
        load("mayekawa-wbhe"), over, ["swept_volume"], samples=samples, progress=False, **options
    )


@pytest.mark.parametrize(
    "make",
    [
        lambda: StagedCycle((1, MANY), 1e5, 4e5, 1.2),
        lambda: EachGas((GAS, GAS), (1, MANY)),
        lambda: Crankshaft(layout=f"radial-{MANY}"),
        lambda: Crankshaft(layout=f"in-line-{MANY}"),
        lambda: Crankshaft(layout=f"V90x{MANY}"),
        lambda: grid(0.0, 1.0, MANY),
        lambda: log_grid(1.0, 2.0, MANY),
        lambda: swept({"mechanism.bore": uniform(0.12, 0.14)}, MANY),
        lambda: swept({"mechanism.bore": uniform(0.12, 0.14)}, 2**29),  # in memory
        lambda: swept({"mechanism.bore": uniform(0.12, 0.14)}, 2**29, sampling="latin_hypercube"),
        lambda: swept({f"mechanism.{name}": grid(0.1, 0.2, 10**6) for name in SIZES}),
        lambda: tolerance(volume(), {"mechanism.bore": within(1e-4)}, samples=MANY, progress=False),
        lambda: optimise(volume(), "swept_volume", samples=MANY),
        lambda: optimise(volume(), "swept_volume", starts=MANY),
        lambda: pareto(volume(), ("swept_volume", "swept_volume"), points=MANY),
        lambda: TimeIntegration(samples=MANY),
        lambda: TimeIntegration(max_steps=MANY),
    ],
)  # fmt: skip
def test_a_huge_count_is_refused_at_once(make):
    with pytest.raises(BadInput):
        make()


def test_a_map_has_a_bounded_number_of_points():
    for count, word in ((101, "at most 100"), (MANY, "<= 10000000")):
        with pytest.raises(CommandError, match=word):
            axis(f"-30:-10:{count}", "evaporating")
    assert len(axis("-30:-10:5", "evaporating")) == 5


@pytest.mark.parametrize("layout", ["radial-0", "V360", "W180", "VV120"])
def test_a_layout_without_rods_or_with_two_in_one_place_is_refused(layout):
    with pytest.raises(BadInput, match="layout"):
        Crankshaft(layout=layout)


def test_stages_need_no_order():
    assert StagedCycle((2, 1, 2), 1e5, 4e5, 1.2).stages == (2, 1, 2)
    with pytest.raises(BadInput, match="without a gap"):
        StagedCycle((1, 3), 1e5, 4e5, 1.2)


@pytest.mark.parametrize("bore", [1e30, 1e250, 1e308])
def test_a_number_no_machine_has_is_named_and_moved_in_a_batch(bore):
    machine = load("mayekawa-wbhe").compressor
    with pytest.raises(BadInput, match="at most 1e25"):
        PolytropicCycle(1e5, bore, 1.2)
    far = eqx.tree_at(lambda c: c.mechanism.bore, machine, jnp.asarray(bore))
    assert not bool(admissible(far))
    assert float(clipped(far).mechanism.bore) == 1.0
