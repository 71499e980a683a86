"""Machines of several cylinders against a Newton-Euler program of their own."""

import dataclasses

import numpy as np
import pytest
from crank.test_several_cylinders import TWO, several
from reference_cylinders import Cylinders

from jaxcomp import solve_orbit
from jaxcomp.crank import Collocation

# Machines as (throws, lists of the mechanism): angle, place, banks [deg] and unbalance of every throw.
CASES = {
    "V with unequal bores": ([(0.0, 0.05, [-40.0, 35.0], -0.5)], {"bore": [0.13, 0.11]}),
    "W60x2": (
        [(0.0, -0.1, [-60.0, 0.0, 60.0], -0.6), (180.0, 0.1, [-60.0, 0.0, 60.0], -0.6)],
        {},
    ),
    "boxer with unequal throws": (
        [(0.0, -0.06, [0.0], -0.2), (175.0, 0.09, [180.0], -0.5)],
        {"piston_mass": [2.0, 3.0]},
    ),
    "radial five with offset": (
        [(20.0, 0.0, [0, 72.0, 144.0, 216.0, 288.0], -1.0)],
        {"offset": 0.01},
    ),
}
ORDINARY = ("V with unequal bores", "radial five with offset")


def twin_of(made) -> Cylinders:
    """The numbers of a machine of the package, for the other program."""
    m, shaft, count = made.mechanism, made.crankshaft, made.crankshaft.count
    column = lambda x: np.broadcast_to(np.asarray(x, float), (count,))[:, None]  # noqa: E731
    names = ("bore", "crank_radius", "conrod_length", "conrod_centre", "conrod_inertia", "conrod_mass",
             "piston_mass", "offset")  # fmt: skip
    throws = [(float(t.angle), float(t.position), float(t.unbalance)) for t in shaft.throws]
    return Cylinders(
        **{name: column(getattr(m, name)) for name in names},
        bank=column(shaft.bank_angle),
        throw=column(shaft.throw_angle),
        place=column(shaft.position),
        inertia=float(shaft.inertia),
        unbalances=throws,
        bearings=tuple(map(float, TWO.position)),
        mean_speed=float(made.motor.mean_speed),
    )


@pytest.mark.parametrize(
    "name",
    [
        # one machine of equal and one of unequal cylinders run always
        name if name in ORDINARY else pytest.param(name, marks=pytest.mark.slow)
        for name in CASES
    ],
)
def test_losses_and_speed_are_those_of_newton_and_euler(name):
    throws, lists = CASES[name]
    made = several(throws)
    made = dataclasses.replace(made, mechanism=dataclasses.replace(made.mechanism, **lists))
    orbit = solve_orbit(made, Collocation(nodes=10, reversals=made.load_reversals))
    efficiency, fluctuation, losses = twin_of(made).solved()
    # of the other program, by twice its points: 4e-9 of the efficiency, 5e-8 of the fluctuation
    assert float(orbit.mechanical_efficiency) == pytest.approx(efficiency, abs=1e-8)
    assert float(orbit.speed_fluctuation) == pytest.approx(fluctuation, rel=2e-7)
    for joint, loss in losses.items():
        found = sum(float(v) for key, v in orbit.energy.losses.items() if key.startswith(joint))
        assert found == pytest.approx(loss, rel=1e-6), joint
