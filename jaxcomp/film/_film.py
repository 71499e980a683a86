r"""What every film model offers, and what follows from it.

Notation, after Butenschoen (1976), DIN 31652 and ISO 7902: eta dynamic viscosity, omega speed,
R, D = 2 R, L radius, diameter and length, c radial clearance, psi = c/R, q = L/D, W load,
eps = e/c eccentricity ratio. The load number is

    Phi_p = W psi^2/(eta omega L D)     omega in rad/s; the German So, 1/(2 pi) of 1/S.

Axes of the film: e_r from the bearing's centre towards the journal's centre (towards the minimum
film), e_t = e_r turned by 90 degrees with rotation. Axes of the load: x along the load on the
journal, y = x turned by 90 degrees with rotation. The attitude angle phi leads from x to e_r.
Film forces on the journal F_r < 0 and F_t > 0 are over eta omega L D/psi^2.

Positions are carried as the film ratio x = e/h_min = eps/(1 - eps) (our own choice), in which
neither the light load (x -> 0) nor the minimum film, h_min/c = 1/(1 + x), loses digits.
All functions take scalars; use `jax.vmap` for many.
"""

import abc
import math
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._core.errors import BadInput
from .._core.fields import is_traced
from .._core.roots import AbstractRoot, root

# [rad/s] Below this speed the load number is held, so that the moment passes through zero with a
# finite slope instead of like sqrt(|omega|).
REST_SPEED = 1e-3

Scalar = Float[Array, ""]
Pair = Float[Array, "2 *n"]


def as_float(value) -> Float[Array, "..."]:
    """The value as an array of floats in the default precision."""
    return jnp.asarray(value, dtype=jnp.result_type(float))


class AbstractFilm(eqx.Module):
    """A film model for one ratio of length to diameter: friction under a load."""

    length_ratio: Scalar = eqx.field(converter=as_float)
    length_ratio_range: ClassVar[tuple[float, float]] = (0.0, math.inf)
    limits: ClassVar[str]  # where the model stops being right, for who reads its results

    @abc.abstractmethod
    def friction_number(self, load_number: Scalar) -> Scalar:
        """[-] Phi_T = M psi/(eta omega L D R), M the moment on the journal; pi at zero load."""


class AbstractCarryingFilm(AbstractFilm):
    """A film model that also says how far the load moves the journal."""

    @abc.abstractmethod
    def load_gain(self, film_ratio: Scalar) -> Scalar:
        """[-] Phi_p/x, load number over film ratio: finite and positive at zero load."""

    def log_compliance(self, load_number: Scalar) -> Scalar:
        """[-] ln(x/Phi_p) under a load number."""
        return root(_LogCompliance(self, load_number))


class AbstractSolvedFilm(AbstractCarryingFilm):
    """A film model that also gives the direction of the film force and its damping."""

    @abc.abstractmethod
    def attitude_angle(self, film_ratio: Scalar) -> Scalar:
        """[rad] Angle phi from the load to the line of centres, positive with rotation."""

    @abc.abstractmethod
    def damping(self, film_ratio: Scalar) -> tuple[Scalar, Scalar]:
        """[-] C_rr and C_tr = -dF_t/dv_r, over eta L D/(psi^2 c)."""

    def radial_stiffness(self, film_ratio: Scalar) -> tuple[Scalar, Scalar]:
        """[-] K_rr and K_tr, minus the slopes of F_r and F_t over eps."""
        return slope_stiffness(self, film_ratio)

    def film_chords(self, film_ratio: Scalar) -> tuple[Scalar, Scalar]:
        """[-] -F_r and F_t of the film over eps."""
        phi = self.attitude_angle(film_ratio)
        size = (1 + film_ratio) * self.load_gain(film_ratio)
        return size * jnp.cos(phi), size * jnp.sin(phi)

    def rubbing(self, film_ratio: Scalar) -> Scalar | None:
        """[-] Part of Phi_T that a contact of the surfaces adds; `None` without one."""
        return None

    def friction_number(self, load_number: Scalar) -> Scalar:
        """[-] Phi_T, see `friction_at`."""
        return self.friction_number_at(film_ratio(self, load_number), load_number)

    def friction_number_at(self, film_ratio: Scalar, load_number: Scalar) -> Scalar:
        """[-] Phi_T under a load whose position is known, and not sought again."""
        del load_number
        return friction_at(self, film_ratio)


class FilmState(NamedTuple):
    """Steady running position.

    Attributes:
        eccentricity_ratio: [-] eps = e/c.
        minimum_film_ratio: [-] h_min/c = 1 - eps, free of cancellation.
        attitude_angle: [rad] phi.
        friction_number: [-] Phi_T.
    """

    eccentricity_ratio: Scalar
    minimum_film_ratio: Scalar
    attitude_angle: Scalar
    friction_number: Scalar


class DynamicCoefficients(NamedTuple):
    """Stiffness K_ij = -dF_i/dx_j and damping C_ij = -dF_i/dv_j; rows and columns (x, y).

    Attributes:
        stiffness: [N/m] (2, 2) K of a bearing; [-] of a film, see `dynamic_coefficients`.
        damping: [N s/m] (2, 2) C likewise.
    """

    stiffness: Float[Array, "2 2"]
    damping: Float[Array, "2 2"]


def load_number_at(film: AbstractCarryingFilm, eccentricity_ratio: Scalar) -> Scalar:
    """[-] Load number Phi_p that holds the journal at an eccentricity ratio in [0, 1)."""
    x = film_ratio_of(eccentricity_ratio)
    return x * film.load_gain(x)


def film_ratio(film: AbstractCarryingFilm, load_number: Scalar) -> Scalar:
    """Position under a load, as film ratio x = e/h_min.

    The root of Phi_p(x) by Newton's method in ln x; derivatives of every order come from the
    implicit function theorem. Finite, with finite derivatives, from zero load to any load.

    Args:
        film: Film model.
        load_number: [-] Phi_p >= 0.

    Returns:
        [-] e/h_min; eps = x/(1 + x), h_min = c/(1 + x).
    """
    # Rules of derivatives of one's own fail in JAX 0.9 on arrays of NumPy that `vmap` maps within `jit`;
    # the sum makes them arrays of JAX.
    held = jax.tree.map(lambda leaf: leaf + 0 if is_traced(leaf) else leaf, (film, load_number))
    film, number = held
    # The solved unknown is x/Phi_p, which is finite without a load, where ln x is not.
    return load_number * jnp.exp(film.log_compliance(number))


def film_ratio_of(eccentricity_ratio: Scalar) -> Scalar:
    """[-] Film ratio e/h_min of an eccentricity ratio."""
    eps = as_float(eccentricity_ratio)
    return eps / (1 - eps)


def film_state(film: AbstractSolvedFilm, load_number: Scalar) -> FilmState:
    """Steady running position under a load number Phi_p [-], not negative."""
    return film_state_at(film, film_ratio(film, load_number))


def film_state_at(film: AbstractSolvedFilm, x: Scalar) -> FilmState:
    """Steady running position at a film ratio [-]."""
    return FilmState(x / (1 + x), 1 / (1 + x), film.attitude_angle(x), friction_at(film, x))


def friction_at(film: AbstractSolvedFilm, film_ratio: Scalar) -> Scalar:
    r"""Friction number of the journal at a position.

    $\Phi_T = \pi/\sqrt{1-\varepsilon^2} + \varepsilon F_t/2$ (Raimondi and Boyd 1958; VDI 2204).
    Couette shear is taken over the whole ring, cavity included; streamers in the cavity would take
    14-21 % off at eps >= 0.5. The moment on the bush is smaller by eps F_t.

    Args:
        film: Film model.
        film_ratio: [-] e/h_min.

    Returns:
        [-] Phi_T; pi (Petroff) when concentric.
    """
    x = film_ratio
    couette = jnp.pi * (1 + x) / jnp.sqrt(1 + 2 * x)  # pi/sqrt(1 - eps^2)
    # F_t is that of the oil alone also beside a contact, which pushes along e_r.
    smooth = couette + 0.5 * x / (1 + x) * _forces(film, x)[1]
    rubbing = film.rubbing(x)
    return smooth if rubbing is None else smooth + rubbing


def dynamic_coefficients(film: AbstractSolvedFilm, load_number: Scalar) -> DynamicCoefficients:
    r"""Stiffness and damping in the axes of the load, finite down to zero load.

    The film depends only on the position relative to the line of centres, so that turning the line
    of centres turns the force, and a tangential velocity v changes omega to omega - 2 v/e. In the
    axes of the film, with A_ij over eta omega L D/psi^2 (Lund 1966, for the definition):

        K_rr = -dF_r/deps   K_rt = F_t/eps        C_rr   C_rt = 2 F_r/eps
        K_tr = -dF_t/deps   K_tt = -F_r/eps       C_tr   C_tt = 2 F_t/eps

    Args:
        film: Film model.
        load_number: [-] Phi_p >= 0.

    Returns:
        [-] K c psi^2/(eta omega L D) and C c psi^2/(eta L D), x along the load, y 90 degrees ahead
        with rotation. They are Phi_p times c K/W and c omega C/W.
    """
    return dynamic_coefficients_at(film, film_ratio(film, load_number))


def dynamic_coefficients_at(film: AbstractSolvedFilm, x: Scalar) -> DynamicCoefficients:
    """Those of `dynamic_coefficients` at a film ratio [-]."""
    phi = film.attitude_angle(x)
    # Phi_p/eps, as x = eps (1 + x).
    load_per_eps = (1 + x) * film.load_gain(x)
    # -F_r, F_t over eps
    chord_r = load_per_eps * jnp.cos(phi)
    chord_t = load_per_eps * jnp.sin(phi)
    # The whole force, a contact's too, turns with the line of centres (K_rt, K_tt); only the oil's
    # goes with the speed (C_rt, C_tt).
    film_r, film_t = film.film_chords(x)
    k_rr, k_tr = film.radial_stiffness(x)
    c_rr, c_tr = film.damping(x)
    stiffness = jnp.array([[k_rr, chord_t], [k_tr, chord_r]])
    damping = jnp.array([[c_rr, -2 * film_r], [c_tr, 2 * film_t]])
    # From (e_r, e_t) to (x, y): e_r stands at phi ahead of the load.
    turn = jnp.array([[jnp.cos(phi), -jnp.sin(phi)], [jnp.sin(phi), jnp.cos(phi)]])
    return DynamicCoefficients(turn @ stiffness @ turn.T, turn @ damping @ turn.T)


def coefficients_per_load(film: AbstractSolvedFilm, load_number: Scalar) -> DynamicCoefficients:
    """c K/W and c omega C/W as tabulated by Lund, Someya and others.

    They grow like 1/eps at light load; `dynamic_coefficients` does not.

    Args:
        film: Film model.
        load_number: [-] Phi_p > 0.

    Returns:
        [-] In the axes of `dynamic_coefficients`.
    """
    stiffness, damping = dynamic_coefficients(film, load_number)
    return DynamicCoefficients(stiffness / load_number, damping / load_number)


class StabilityThreshold(NamedTuple):
    """Where a rigid rotor in the film begins to whirl by itself.

    Attributes:
        critical_mass: [-] m c omega^2/W of the mass m that one bearing carries; infinite if the
            film is stable whatever the mass.
        whirl_ratio: [-] whirl frequency over speed at the threshold; zero if there is none.
    """

    critical_mass: Scalar
    whirl_ratio: Scalar


def stability_threshold(film: AbstractSolvedFilm, load_number: Scalar) -> StabilityThreshold:
    r"""Largest mass of a rigid rotor that the film carries without self-excited whirl (Lund 1966).

    At the threshold the film acts like a spring k = kappa and takes no energy from a whirl at
    gamma omega: with the coefficients over W/c and W/(c omega),

        kappa = (K_xx C_yy + K_yy C_xx - K_xy C_yx - K_yx C_xy)/(C_xx + C_yy)
        gamma^2 = ((K_xx - kappa)(K_yy - kappa) - K_xy K_yx)/(C_xx C_yy - C_xy C_yx)

    and m c omega^2/W = kappa/gamma^2.

    Args:
        film: Film model.
        load_number: [-] Phi_p > 0.

    Returns:
        `StabilityThreshold`; a rotor of less mass is stable.
    """
    return threshold_of(coefficients_per_load(film, load_number))


def threshold_of(per_load: DynamicCoefficients) -> StabilityThreshold:
    """The threshold by coefficients over W/c and W/(c omega), see `stability_threshold`."""
    k, c = per_load
    cross = k[0, 0] * c[1, 1] + k[1, 1] * c[0, 0] - k[0, 1] * c[1, 0] - k[1, 0] * c[0, 1]
    kappa = cross / (c[0, 0] + c[1, 1])
    shifted = k - kappa * jnp.eye(2)
    square = (shifted[0, 0] * shifted[1, 1] - k[0, 1] * k[1, 0]) / (
        c[0, 0] * c[1, 1] - c[0, 1] * c[1, 0]
    )
    whirls = (square > 0) & (kappa > 0)
    safe = jnp.where(whirls, square, 1.0)  # double where: the slope of sqrt at zero is infinite
    return StabilityThreshold(
        jnp.where(whirls, kappa / safe, jnp.inf), jnp.where(whirls, jnp.sqrt(safe), 0.0)
    )


LOAD_NUMBERS = ("load_number", "sommerfeld_number", "modified_sommerfeld_number")


def convert_load_number(value: Scalar, source: str, target: str, length_ratio: Scalar) -> Scalar:
    """Turn one of the usual load numbers into another.

    | name | definition | user |
    |---|---|---|
    | `load_number` | Phi_p = W psi^2/(eta omega L D), omega in rad/s | DIN 31652 (So), VDI 2204 |
    | `sommerfeld_number` | S = (eta n/p)(R/c)^2, n in rev/s | Raimondi and Boyd, Someya |
    | `modified_sommerfeld_number` | D omega eta L^3/(8 W c^2) = pi S q^2 | Ocvirk, Friswell |

    The first is proportional to the load, the others to its inverse.

    Args:
        value: [-] Number to convert, positive.
        source: Name of what is given.
        target: Name of what is wanted.
        length_ratio: [-] q = L/D; only the modified number depends on it.

    Returns:
        [-] The number called `target`.

    Raises:
        BadInput: if a name is none of the three.
    """
    for role, name in (("source", source), ("target", target)):
        if name not in LOAD_NUMBERS:
            raise BadInput(role, name, "one of " + ", ".join(LOAD_NUMBERS))
    if source == target:
        return value
    # Every inverse number is factor/Phi_p.
    factor = {
        "sommerfeld_number": 1 / (2 * jnp.pi),
        "modified_sommerfeld_number": length_ratio**2 / 2,
    }
    load_number = value
    if source != "load_number":
        load_number = factor[source] / value
    if target == "load_number":
        return load_number
    return factor[target] / load_number


def _forces(film: AbstractSolvedFilm, x: Scalar) -> tuple[Scalar, Scalar]:
    load = x * film.load_gain(x)
    phi = film.attitude_angle(x)
    return -load * jnp.cos(phi), load * jnp.sin(phi)


def slope_stiffness(film: AbstractSolvedFilm, x: Scalar) -> tuple[Scalar, Scalar]:
    """-dF_r/deps and -dF_t/deps along the film's load line, by automatic differentiation."""
    _, (slope_r, slope_t) = jax.jvp(lambda x: _forces(film, x), (x,), (jnp.ones_like(x),))
    stretch = (1 + x) ** 2  # dx/deps
    return -stretch * slope_r, -stretch * slope_t


def smooth_speed(speed: Scalar, rest_speed: float = REST_SPEED) -> Scalar:
    """[rad/s] Size of a speed, smooth through rest."""
    return jnp.sqrt(speed**2 + rest_speed**2)


def sense(speed: Scalar) -> Scalar:
    """[-] Sign of a speed [rad/s], smooth through rest."""
    return speed / smooth_speed(speed)


def split(vector: Pair) -> tuple[Float[Array, "*n"], Pair]:
    """Length and direction, along x with finite derivatives where the length vanishes."""
    square = vector[0] * vector[0] + vector[1] * vector[1]
    some = square > 0
    # Double where: the slope of sqrt at zero is infinite.
    size = jnp.where(some, jnp.sqrt(jnp.where(some, square, 1.0)), 0.0)
    along_x = jnp.stack([jnp.ones_like(size), jnp.zeros_like(size)])
    return size, jnp.where(some, vector / jnp.where(some, size, 1.0), along_x)


class _LogCompliance(AbstractRoot):
    """z = ln(x/Phi_p), the root of ln(load gain(Phi_p e^z)) + z: regular at zero load."""

    film: AbstractCarryingFilm
    load_number: Scalar

    @eqx.filter_jit
    def solve(self):
        film = self.film
        load_number = self.load_number
        light = film.load_gain(jnp.zeros_like(load_number))
        # Start: Phi_p ~ light x + q^2 x^2/2 (short bearing), or Phi_p ~ 1.2 x (thin zone), whichever
        # gives the thinner film: the sum of both x is at most twice the larger. The slope
        # d ln Phi_p/d ln x lies between 0.7 and 2, so that Newton's method in ln x needs neither
        # damping nor a bracket: the sixth step is below rounding.
        # The root of that parabola over Phi_p is rationalised, and so finite without a load.
        short = 2 / (light + jnp.sqrt(light**2 + 2 * film.length_ratio**2 * load_number))

        def step(_, z):
            residual, slope = jax.jvp(self.residual, (z,), (jnp.ones_like(z),))
            return z - residual / slope

        return jax.lax.fori_loop(0, 6, step, jnp.log(short + 1 / 1.2))

    def residual(self, unknowns):
        # its slope over z is d ln Phi_p/d ln x, see `solve`: never zero
        return jnp.log(self.film.load_gain(self.load_number * jnp.exp(unknowns))) + unknowns
