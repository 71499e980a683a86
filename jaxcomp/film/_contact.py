r"""Mixed friction: the rough surfaces of journal and bush touch where the film is thin.

Two rough surfaces whose mean planes are h apart press on each other, where their asperities touch,
with (Greenwood and Tripp 1970)

$$p_c = K E^* F_{5/2}(h/\sigma), \quad F_n(u) = \frac{1}{\sqrt{2\pi}} \int_u^\infty (s-u)^n e^{-s^2/2} ds,
  \quad K = \frac{16\sqrt2\,\pi}{15} (\eta_s\beta\sigma)^2 \sqrt{\sigma/\beta} ,$$

and rub with the shear $\mu_b p_c$. Round a ring $h = c(1 - \epsilon\cos\theta)$; with
$s^2 = a(1 - \cos\theta)$, $a = \epsilon c/\sigma$ and $g = (1 - \epsilon) c/\sigma$ the integrals over
the angle become those of $F_{5/2}(g + s^2)$, which are $F_3$ and $F_4$ (our derivation): closed forms.

The contact pushes along the line of centres, so that it has a potential: over a period it takes no work
but by rubbing. Its friction, which would turn the force by $\arctan\mu_b$, is left out of the balance of
forces (0.5 % of the load at 0.1).
"""

import math
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erfc
from jaxtyping import Array, Float

from .._core.extremes import clip, maximum
from .._core.fields import NONNEGATIVE, POSITIVE, Part, quantity
from .._core.roots import AbstractRoot, root
from ._film import AbstractSolvedFilm, Pair, Scalar, sense
from ._squeeze import AbstractSqueeze, slopes_along

# [-] Of thickness over roughness: surfaces that are further apart do not touch (F_3 is 1e-18 there).
APART = 8.0
# [-] Least clearance over roughness: a ring is then out of touch wherever eps is below 0.3.
LEAST_CLEARANCE = 12.0
_LEAST_ECCENTRICITY = 0.3
# Steps of Newton's method for the position in film and contact, to rounding; and for its start.
_STEPS = 8
_STARTING = 4


def mean_excess(u: Float[Array, "*n"]) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """F_3 and F_4 of Greenwood and Tripp [-], closed: F_{n+1} = n F_{n-1} - u F_n."""
    tail = 0.5 * erfc(u / np.sqrt(2))
    density = jnp.exp(-0.5 * u * u) / np.sqrt(2 * np.pi)
    # F_0 is the tail of the normal distribution and F_1 = density - u F_0: the recurrence starts there.
    first = density - u * tail
    second = tail - u * first
    third = 2 * first - u * second
    return third, 3 * second - u * third


def mean_excess_halves(u: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """F_{5/2} of Greenwood and Tripp [-].

    The trapezoidal rule in the root of s - u, which converges faster than any power: 1e-12 of the value
    at contact.
    """
    # 2 r^6 exp(-(u + r^2)^2/2) is even in r and below 1e-16 of its largest value at 2.9
    step = 0.1
    r = step * np.arange(1, 31)
    weight = 2 * step * r**6 / np.sqrt(2 * np.pi)
    return jnp.sum(weight * jnp.exp(-0.5 * (u[..., None] + r**2) ** 2), axis=-1)


class AsperityContact(Part):
    r"""Contact of two rough surfaces by Greenwood and Tripp, with dry or boundary friction.

    Args:
        roughness: [m] sigma, of both surfaces together: the root of the sum of the squares of their
            r.m.s. heights.
        coefficient: [-] mu_b, of boundary friction: shear over the pressure of the contact.
        modulus: [Pa] E*, 1/E* the sum of (1 - nu^2)/E of both surfaces; absent: steel on steel.
        elastic_factor: [-] K of the head of the module; absent: 0.003, of asperities whose density times
            radius times roughness is 0.05 and whose roughness over radius is 0.064. See `elastic_factor`.
    """

    kind: ClassVar[str] = "greenwood_tripp"

    roughness: Scalar = quantity(
        "m", POSITIVE, doc="of both surfaces together, r.m.s.", usual=(2e-8, 5e-6)
    )
    coefficient: Scalar = quantity("", NONNEGATIVE, doc="of boundary friction", usual=(5e-3, 0.3))
    modulus: Scalar = quantity(
        "Pa",
        POSITIVE,
        default=115e9,
        doc="1/E* is the sum of (1 - nu^2)/E of both surfaces; steel on steel if absent",
        usual=(1e9, 4e11),
    )
    elastic_factor: Scalar = quantity(
        "",
        POSITIVE,
        default=3e-3,
        doc="of the shape and number of the asperities",
        usual=(1e-5, 1e-1),
    )

    def pressure(self, thickness: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[Pa] Of the contact over its nominal area, at distances [m] of the mean planes."""
        u = jnp.asarray(thickness / self.roughness)
        return self.elastic_factor * self.modulus * mean_excess_halves(u)


class RingContact(eqx.Module):
    """The contact of a journal with the ring about it.

    Attributes:
        ratio: [-] clearance over roughness.
        unit: [N] R L K E*.
        coefficient: [-] of boundary friction.
        radius: [m] of the journal.
    """

    ratio: Scalar
    unit: Scalar
    coefficient: Scalar
    radius: Scalar

    def forces(self, eps: Float[Array, "*n"]) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
        """[N] Force along the line of centres, and sum of the normal forces, at eccentricity ratios.

        The series in roughness over clearance of the ring is cut after its first two terms: 1e-4 off at a
        clearance of 50 times the roughness.
        """
        gap = self.ratio * (1 - eps)
        touches = gap < APART
        third, fourth = mean_excess(jnp.where(touches, gap, APART))
        # Below it nothing touches (LEAST_CLEARANCE), and the root would be infinite at the centre.
        # By `where` and not by `maximum`, for the reason that stands in `MixedFilm.load_gain`.
        bend = self.ratio * jnp.where(eps > _LEAST_ECCENTRICITY, eps, _LEAST_ECCENTRICITY)
        size = self.unit * jnp.sqrt(2 / bend)
        line = 5 * np.pi / 16 * third
        further = 5 * np.pi / 128 * fourth / bend
        # Next to leading order d theta has the factor 1 + s^2/(4 a), and cos(theta) is 1 - s^2/a.
        along = size * (line - 0.75 * further)
        normal = size * (line + 0.25 * further)
        return jnp.where(touches, along, 0.0), jnp.where(touches, normal, 0.0)

    def push(self, position: Pair) -> Pair:
        """[N] Force of the journal on the bush at a position over the clearance."""
        square = position[0] ** 2 + position[1] ** 2
        # Double where: at the centre the eccentricity ratio has no slope.
        eps = jnp.sqrt(jnp.where(square > 0, square, 1.0))
        return jnp.where(square > 0, self.forces(eps)[0] / eps, 0.0) * position

    def torque(self, position: Pair, rate: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """[N m] Of the contact's friction, along the rate [rad/s] of the journal in its bush."""
        square = position[0] ** 2 + position[1] ** 2
        eps = jnp.sqrt(jnp.where(square > 0, square, 1.0))
        normal = jnp.where(square > 0, self.forces(eps)[1], 0.0)
        return self.coefficient * self.radius * normal * sense(rate)


class MixedFilm(AbstractSolvedFilm):
    """A film and a contact that carry a load together, at one speed.

    Attributes:
        film: alone.
        contact: alone.
        pace: [N] unit of the film's forces, eta omega L D/psi^2, at the speed that builds the pressure.
        sliding: [N] the same at the speed of the journal in its bush.
        clearance_ratio: [-] psi.
    """

    film: AbstractSolvedFilm
    contact: RingContact
    pace: Scalar
    sliding: Scalar
    clearance_ratio: Scalar

    def contact_number(self, film_ratio):
        """[-] What the contact adds to the load number, along the line of centres."""
        return self.contact.forces(film_ratio / (1 + film_ratio))[0] / self.pace

    def _chords(self, film_ratio):
        """[-] Load along and across the line of centres, over the film ratio."""
        gain = self.film.load_gain(film_ratio)
        phi = self.film.attitude_angle(film_ratio)
        along = self.contact_number(film_ratio)
        # no contact without eccentricity
        along = along / jnp.where(along > 0, film_ratio, 1.0)
        return gain * jnp.cos(phi) + along, gain * jnp.sin(phi)

    def load_gain(self, film_ratio):
        radial, tangential = self._chords(film_ratio)
        # not `jnp.hypot`, whose derivative asks which of the two equals the larger one: where it is
        # computed again with other rounding, neither does
        return jnp.sqrt(radial * radial + tangential * tangential)

    def attitude_angle(self, film_ratio):
        radial, tangential = self._chords(film_ratio)
        return jnp.arctan2(tangential, radial)

    def damping(self, film_ratio):
        # the contact is elastic: it makes the film stiffer and takes no work along the line of centres
        return self.film.damping(film_ratio)

    def film_chords(self, film_ratio):
        return self.film.film_chords(film_ratio)

    def rubbing(self, film_ratio):
        _, normal = self.contact.forces(film_ratio / (1 + film_ratio))
        # M = mu_b N R over eta omega L D R/psi, with the speed of sliding.
        return self.contact.coefficient * normal / (self.sliding * self.clearance_ratio)

    def film_number(self, film_ratio, load_number):
        """[-] What the film carries of a load number: all of it to the last bit where nothing touches."""
        touches = self.contact_number(film_ratio) > 0
        return jnp.where(touches, film_ratio * self.film.load_gain(film_ratio), load_number)

    def friction_number_at(self, film_ratio, load_number):
        # Film and contact have one position: that of the film alone under its share is the same.
        carried = self.film_number(film_ratio, load_number)
        return self.film.friction_number_at(film_ratio, carried) + self.rubbing(film_ratio)

    def log_compliance(self, load_number):
        return root(_MixedCompliance(self, load_number))


class _MixedCompliance(AbstractRoot):
    """z = ln(x/Phi_p) of a film in contact; see `_film._LogCompliance`."""

    film: MixedFilm
    load_number: Scalar

    @eqx.filter_jit
    def solve(self):
        mixed = self.film
        number = self.load_number
        alone = mixed.film.log_compliance(number)
        x = number * jnp.exp(alone)
        touches = mixed.contact_number(x) > 0
        # Film and contact grow as the journal comes nearer, both convex: from a thickness that is too
        # small Newton's method comes to that of both without leaving it behind. Each of the two by itself
        # would let the journal come nearer.
        ratio = mixed.contact.ratio
        unit = mixed.contact.unit
        excess = number * mixed.pace / (unit * jnp.sqrt(2 / ratio) * 5 * np.pi / 16)
        gap = jnp.full_like(x, 1.0)
        for _ in range(_STARTING):
            third, slope = jax.jvp(lambda u: mean_excess(u)[0], (gap,), (jnp.ones_like(gap),))
            # In the logarithm, because F_3 falls like exp(-u^2/2).
            gap = gap - jnp.log(third / jnp.where(touches, excess, 1.0)) * third / slope
            gap = clip(gap, 0.0, APART)
        # 0.95, because the gap is by the first term of its series only.
        start = maximum(1 / (1 + x), 0.95 * gap / ratio)
        start = jnp.where(touches, start, 0.5)

        def step(_, thickness):
            def carried(y):
                return (1 / y - 1) * mixed.load_gain(1 / y - 1)

            load, slope = jax.jvp(carried, (thickness,), (jnp.ones_like(thickness),))
            new = thickness - (load - number) / slope
            # Below one, so that the film ratio stays positive.
            return clip(new, 0.5 * thickness, 1 - 1e-6)

        thickness = jax.lax.fori_loop(0, _STEPS, step, start)
        in_contact = jnp.log((1 / thickness - 1) / jnp.where(touches, number, 1.0))
        return jnp.where(touches, in_contact, alone)

    def residual(self, unknowns):
        return jnp.log(self.film.load_gain(self.load_number * jnp.exp(unknowns))) + unknowns


class MixedSqueeze(eqx.Module):
    """The film of a moving journal with a contact beside it.

    Attributes:
        film: alone.
        contact: alone.
        unit: [N s] U of the film.
    """

    film: AbstractSqueeze
    contact: RingContact
    unit: Scalar

    def film_force(self, position: Pair, force: Pair, over) -> Pair:
        """[-] What the contact leaves the film of a load, both over U and a speed [1/s]."""
        return force - self.contact.push(position) / (self.unit * over)

    def velocity(self, position: Pair, force: Pair, over) -> Pair:
        """[-] Mobility of the journal, over that speed."""
        return self.film.mobility(position, self.film_force(position, force, over))

    def velocity_slopes(self, position: Pair, force: Pair, over):
        """Velocity of the squeeze, and its slopes along the position, constants to derivatives."""
        fixed, load, speed = jax.lax.stop_gradient((self, force, over))
        held = jax.lax.stop_gradient(position)
        _, slopes = slopes_along(lambda e: fixed.velocity(e, load, speed), held)
        return self.velocity(position, force, over), slopes


def elastic_factor(density: float, radius: float, roughness: float) -> float:
    r"""K of Greenwood and Tripp [-].

    Args:
        density: [1/m^2] of the asperities.
        radius: [m] of their tips.
        roughness: [m] sigma.
    """
    size = density * radius * roughness
    return 16 * math.sqrt(2) * math.pi / 15 * size**2 * math.sqrt(roughness / radius)
