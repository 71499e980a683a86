"""Joints from no friction to far beyond locking, at given instants of both mechanisms.

That the margin is positive exactly where the balance has one solution, and that this solution is right,
stands in `test_friction_slider_crank` and `test_slider_link`; here all numbers and slopes stay finite on
the whole way, and the margin falls along it.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import coulomb, every_leaf_finite, mechanism, regularised
from mechanism import test_slider_link

from jaxcomp.friction._joint_loads import joint_loads
from jaxcomp.mechanism import CrankState

SHARES = np.concatenate([[0.0], np.logspace(-6, 4, 21)])


def link_friction(share):
    return test_slider_link.coulomb_friction(0.1 * share, 0.1 * share, 0.01 * share)


def rubbing(share):
    return coulomb(share).friction


JOINTS = {
    "slider-crank": (mechanism(offset=0.01), rubbing, 3e4, 1e2),
    "steep slider-crank": (mechanism(conrod_length=0.05 / 0.95), rubbing, 3e4, 1e2),
    "regularised": (mechanism(), lambda share: regularised(1e-8, share).friction, 3e4, 1e2),
    "slider-link": (test_slider_link.machine(offset=-2e-3), link_friction, 7e2, 3e2),
    "balanced slider-link": (
        test_slider_link.machine(),
        lambda share: test_slider_link.coulomb_friction(
            0.1 * share, 0.1 * share, 0.01 * share, slider_moment="balanced"
        ),
        7e2,
        3e2,
    ),
}
CHEAP = ("steep slider-crank", "slider-link")


@pytest.mark.parametrize(
    "case", [c if c in CHEAP else pytest.param(c, marks=pytest.mark.slow) for c in JOINTS]
)
def test_friction_across_locking_is_finite_and_flagged(case):
    parts, law, gas, speed = JOINTS[case]
    angle = jnp.concatenate([jnp.linspace(0.0, 2 * np.pi, 41), jnp.asarray([0.5, 1.5]) * jnp.pi])
    state = CrankState(angle, jnp.full(43, speed), jnp.full(43, -10 * speed))

    def loads(share):
        found = joint_loads(parts, law(share), state, jnp.full(43, gas))
        return found.total_loss_torque, found

    program = jax.jit(jax.vmap(jax.jacfwd(loads, has_aux=True)))
    slopes, found = program(jnp.asarray(SHARES))
    assert every_leaf_finite((slopes, found))
    margin = np.min(found.margin, axis=1)
    # 1 without friction, falling, and through zero in a place where the status changes
    assert margin[0] == 1.0
    assert np.all(np.diff(margin) <= 0)
    assert margin[-1] < 0
    # what is called unique closes its loop, but for the last digits close to locking
    sound = margin > 0.3
    assert np.sum(sound) > 10
    assert np.max(found.residual[sound]) < 1e-11
