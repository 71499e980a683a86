"""Balancing planes that nearly coincide: condition numbers of 1e12 and beyond, flagged and finite.

That a cut shares the correction between two such planes is asserted in `test_balancing`.
"""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from vibration.test_balancing import system

from jaxcomp.balancing import bounded, least_squares, min_max
from jaxcomp.balancing._influence import Influence

GAPS = (1e-4, 1e-8, 1e-12, 0.0)


def near_twins(gap, rows=6):
    """Two planes whose influence differs by `gap`, with an unbalance in the first of them planted."""
    base, _ = system(rows, 1)
    other = np.random.default_rng(5).normal(size=rows)
    twin = base.matrix[:, 0] * (1 + gap * other)
    matrix = jnp.stack([base.matrix[:, 0], twin], 1)
    return Influence(matrix, base.initial, base.weight, base.rows, ("a", "b"))


def exact_answer(influence):
    """Least squares and what is left, by the normal equations in rational numbers: no rounding."""
    weight = [Fraction(float(w)) for w in influence.weight]

    def fractions(array):
        rows = zip(weight, array, strict=True)
        return [[w * Fraction(float(x)) for x in row] for w, row in rows]

    matrix = np.asarray(influence.matrix)
    real, imaginary = fractions(matrix.real), fractions(matrix.imag)
    initial = np.asarray(influence.initial)[:, None]
    right = [-r[0] for r in (*fractions(initial.real), *fractions(initial.imag))]
    # (Re, -Im; Im, Re) acts on (Re B, Im B)
    rows = [r + [-x for x in i] for r, i in zip(real, imaginary, strict=True)]
    rows += [i + r for r, i in zip(real, imaginary, strict=True)]
    size = len(rows[0])
    normal = [
        [sum(r[i] * r[j] for r in rows) for j in range(size)]
        + [sum(r[i] * v for r, v in zip(rows, right, strict=True))]
        for i in range(size)
    ]
    for i in range(size):  # Gauss-Jordan
        normal[i] = [x / normal[i][i] for x in normal[i]]
        for j in set(range(size)) - {i}:
            normal[j] = [x - normal[j][i] * y for x, y in zip(normal[j], normal[i], strict=True)]
    found = [row[-1] for row in normal]
    rest = [
        sum(a * x for a, x in zip(r, found, strict=True)) - v
        for r, v in zip(rows, right, strict=True)
    ]
    half = size // 2
    correction = [complex(x, y) for x, y in zip(found[:half], found[half:], strict=True)]
    return np.array(correction), float(sum(r * r for r in rest)) ** 0.5


@pytest.mark.parametrize("gap", GAPS)
def test_condition_says_how_close_the_planes_are(gap):
    condition = float(least_squares(near_twins(gap), cut=0.0).condition)
    if gap:
        # 2 over the spread of the difference; at 1e-12 its own digits are gone but for four
        assert 1 / gap < condition < 20 / gap
    else:
        assert condition > 1e15


@pytest.mark.parametrize("gap", [1e-4, 1e-8])
def test_uncut_balance_has_the_digits_that_the_condition_leaves(gap):
    influence = near_twins(gap)
    correction, size = exact_answer(influence)
    balance = least_squares(influence, cut=0.0)
    off = np.linalg.norm(np.asarray(balance.correction) - correction) / np.linalg.norm(correction)
    # the singular value decomposition loses the condition once, not squared
    assert off < 1e-14 * float(balance.condition)
    assert float(balance.objective) == pytest.approx(size, rel=1e-6)


@pytest.mark.parametrize("gap", GAPS)
@pytest.mark.parametrize("options", [{"cut": 1e-6}, {"tikhonov": 1e-4}, {"cut": 0.0}])
def test_balances_of_near_twins_are_finite_and_no_worse_than_one_plane(gap, options):
    """The masses of the cut and the penalised balance stay of the size of one plane's; uncut ones
    need not, and say so by the condition."""
    influence = near_twins(gap)
    one = least_squares(
        Influence(
            influence.matrix[:, :1], influence.initial, influence.weight, influence.rows, ("a",)
        )
    )
    balance = least_squares(influence, **options)
    assert np.all(np.isfinite(np.asarray(balance.correction)))
    # the penalty costs the square of 1e-4; rounding of masses 1e16 times too large is as large as
    # the vibration itself, which only the uncut balance may have
    limit = 2.0 if options == {"cut": 0.0} and gap < 1e-11 else 1 + 1e-6
    assert float(balance.objective) < limit * float(one.objective)
    heavy = float(jnp.linalg.norm(balance.correction) / jnp.linalg.norm(one.correction))
    if options != {"cut": 0.0}:
        # a cut keeps differences of 1e-4, which the planes may use
        assert heavy < (1.0 + 1e-3 if gap < 1e-6 else 1e4)
    elif heavy > 1e6:
        assert float(balance.condition) > 1e6


@pytest.mark.parametrize("gap", GAPS)
def test_slopes_of_cut_and_penalised_balances_are_finite(gap):
    influence = near_twins(gap)

    def largest(shift, **options):
        moved = Influence(
            influence.matrix * (1 + shift),
            influence.initial,
            influence.weight,
            influence.rows,
            influence.planes,
        )
        return jnp.max(jnp.abs(least_squares(moved, **options).correction))

    for options in ({"tikhonov": 1e-4}, {"cut": 1e-6}):
        value, slope = jax.jit(jax.value_and_grad(lambda s, o=options: largest(s, **o)))(0.0)
        # a common factor on the influence divides the corrections by it
        assert float(slope) == pytest.approx(-float(value), rel=1e-6)


@pytest.mark.parametrize("gap", [1e-8, 1e-12, 0.0])
def test_bounded_and_min_max_prove_themselves_on_near_twins(gap):
    influence = near_twins(gap)
    one = float(jnp.abs(least_squares(influence, cut=1e-6).correction[0]))
    for balance in (bounded(influence, 2 * one), min_max(influence, tolerance=1e-4)):
        assert np.all(np.isfinite(np.asarray(balance.correction)))
        # below the optimum by the rounding of the objective at most
        assert float(balance.bound) <= float(balance.objective) * (1 + 1e-12)
        assert float(balance.gap) < 1e-3
