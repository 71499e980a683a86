"""Where a journal runs under a steady load, and how stiff and damped its film is there."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ._bearing import Bearing, JournalBearing, film_at, film_unit, load_number, prepare
from ._film import (
    REST_SPEED,
    AbstractCarryingFilm,
    AbstractSolvedFilm,
    DynamicCoefficients,
    FilmState,
    Scalar,
    as_float,
    dynamic_coefficients,
    film_ratio,
    film_state,
    smooth_speed,
    split,
)


def bush_moment(bearing: Bearing, load: Scalar, speed: Scalar, *, rest_speed=REST_SPEED) -> Scalar:
    """Friction moment on the bush, M - W e sin(phi): the offset forces make the difference.

    Args:
        bearing: Bearing whose film model gives an attitude angle.
        load: [N] W.
        speed: [rad/s] Journal relative to bush.
        rest_speed: [rad/s] Speed below which the load number is held.

    Returns:
        [N m] Along the speed; smaller in magnitude than the moment on the journal.
    """
    state = running_state(bearing, load, speed, rest_speed=rest_speed)
    return bush_moment_at(prepare(bearing).bearing, state, load, speed, rest_speed)


def bush_moment_at(
    bearing: JournalBearing, state: FilmState, load: Scalar, speed: Scalar, rest_speed: float
) -> Scalar:
    """The moment of `bush_moment` at a known position."""
    offset = bearing.radial_clearance * state.eccentricity_ratio * jnp.sin(state.attitude_angle)
    # The attitude angle counts with the rotation, so that the couple W e sin(phi) has its sign.
    turn = speed / smooth_speed(speed, rest_speed)
    unit = film_unit(bearing) * bearing.radius * bearing.clearance_ratio
    return unit * speed * state.friction_number - turn * jnp.abs(load) * offset


def eccentricity_ratio(
    bearing: Bearing, load: Scalar, speed: Scalar, *, rest_speed=REST_SPEED
) -> Scalar:
    """[-] Eccentricity ratio eps = e/c under a load.

    Args:
        bearing: Bearing, prepared or not.
        load: [N] W.
        speed: [rad/s] Speed that builds the pressure, see `entrainment_speed`.
        rest_speed: [rad/s] Speed below which the load number is held.
    """
    x = _position(bearing, load, speed, rest_speed)
    return x / (1 + x)


def minimum_film(bearing: Bearing, load: Scalar, speed: Scalar, *, rest_speed=REST_SPEED) -> Scalar:
    """[m] Minimum film thickness h_min = c (1 - eps) under a load.

    Once it is of the order of the roughness the film is mixed: none of this holds without a contact.

    Args:
        bearing: Bearing, prepared or not.
        load: [N] W.
        speed: [rad/s] Speed that builds the pressure, see `entrainment_speed`.
        rest_speed: [rad/s] Speed below which the load number is held.
    """
    bearing = prepare(bearing)
    return bearing.bearing.radial_clearance / (1 + _position(bearing, load, speed, rest_speed))


def running_state(
    bearing: Bearing, load: Scalar, speed: Scalar, *, rest_speed=REST_SPEED
) -> FilmState:
    """Position and friction number under a load.

    Args:
        bearing: Bearing, prepared or not.
        load: [N] W.
        speed: [rad/s] Speed that builds the pressure, see `entrainment_speed`.
        rest_speed: [rad/s] Speed below which the load number is held.
    """
    bearing, film = _solved(bearing, speed, rest_speed)
    return film_state(film, load_number(bearing, load, speed, rest_speed=rest_speed))


def stiffness_damping(
    bearing: Bearing,
    load_vector: Float[Array, " 2"],
    speed: Scalar,
    *,
    rest_speed=REST_SPEED,
) -> DynamicCoefficients:
    """Stiffness and damping of the film about its static position, in the axes of the load vector.

    The reaction of the film to a small motion (u, u') of the journal is -K u - C u'. K is not
    symmetric: do not symmetrise it. At no load the line of maximum film has no direction; the
    stiffness does not need one, and the damping is given as if the load pointed along X.

    Args:
        bearing: Bearing whose film model gives an attitude angle.
        load_vector: [N] Static load on the journal along the fixed axes (X, Y).
        speed: [rad/s] Journal speed, positive from X to Y.
        rest_speed: [rad/s] Speed below which the load number is held.

    Returns:
        `stiffness` [N/m] and `damping` [N s/m], both (2, 2) over (X, Y).

    Raises:
        ValueError: if the load is not a vector of two, or the film model has no attitude angle.
    """
    load_vector = as_float(load_vector)
    if load_vector.shape != (2,):
        raise ValueError(f"`load_vector` must have shape (2,), but has shape {load_vector.shape}.")
    bearing, film = _solved(bearing, speed, rest_speed)
    load, along = split(load_vector)
    coefficients = dynamic_coefficients(
        film, load_number(bearing, load, speed, rest_speed=rest_speed)
    )
    return in_fixed_axes(bearing, coefficients, along, speed, rest_speed)


def in_fixed_axes(
    bearing: JournalBearing,
    coefficients: DynamicCoefficients,
    along: Float[Array, " 2"],
    speed: Scalar,
    rest_speed: float,
) -> DynamicCoefficients:
    """Stiffness [N/m] and damping [N s/m] over fixed axes (X, Y).

    Args:
        bearing: Bearing.
        coefficients: [-] in the axes of the load, see `dynamic_coefficients`.
        along: [-] direction of the load.
        speed: [rad/s] Journal speed, positive from X to Y.
        rest_speed: [rad/s] Speed below which the load number is held.
    """
    stiffness, damping = coefficients
    # Running the other way is the mirror image: y is 90 degrees ahead with rotation, so that the
    # entries that couple x and y change sign.
    pace = smooth_speed(speed, rest_speed)
    mirror = jnp.eye(2) + (1 - jnp.eye(2)) * speed / pace
    axes = jnp.array([[along[0], -along[1]], [along[1], along[0]]])
    unit = film_unit(bearing) / bearing.radial_clearance
    # In a given place the force grows with the speed, and so its stiffness; its damping does not.
    return DynamicCoefficients(
        unit * pace * (axes @ (mirror * stiffness) @ axes.T),
        unit * (axes @ (mirror * damping) @ axes.T),
    )


def _position(bearing, load, speed, rest_speed) -> Scalar:
    film = film_at(bearing, speed, rest_speed)
    bearing, _ = prepare(bearing)
    if not isinstance(film, AbstractCarryingFilm):
        raise ValueError(
            f"The film model {type(film).__name__} gives no position of the journal; take "
            "`Reynolds`, `GroovedReynolds`, `Guembel`, `Ocvirk` or `ExplicitFit`."
        )
    return film_ratio(film, load_number(bearing, load, speed, rest_speed=rest_speed))


def _solved(bearing, speed, rest_speed) -> tuple[JournalBearing, AbstractSolvedFilm]:
    film = film_at(bearing, speed, rest_speed)
    if not isinstance(film, AbstractSolvedFilm):
        raise ValueError(
            f"The film model {type(film).__name__} gives no attitude angle and no dynamic "
            "coefficients; take `Reynolds`, `GroovedReynolds`, `Guembel` or `Ocvirk`."
        )
    return prepare(bearing).bearing, film
