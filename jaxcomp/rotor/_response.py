r"""Harmonic response at any order and speed, and what is read off it: forces of the links, orbits.

[K(W) - w^2 M + i w (C(W) + W G)] X = F with w = n W at order n; the gyroscopic matrix G counts with
the spin speed W whatever n is. Source: Eq. (1) of Levecque et al. (2011), cited in full in
`machines/hermetic-68cc.toml`.
"""

import dataclasses
from collections.abc import Iterator
from functools import partial
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from .._core.declared import held, reading
from .._core.errors import BadInput
from .._core.exported import kept_jit
from .._core.fields import is_any_traced, is_traced
from .._core.results import Data, Result
from ._conventions import AXES, from_planes, to_planes
from ._layout import layout_of
from ._loads import Loads, check_loads, load_vector
from ._model import RotorModel
from ._nodes import node_index, node_names
from ._operator import link_force, operator_at, reactions
from ._prepare import prepare
from ._shaft import Node
from ._solve import OK, Solver, make_solver, status_words
from ._speed_lists import filled, filled_along, filled_length, without_filling
from ._system import System, bare, collect, follow

# Responses solved side by side: what a batch of them takes fits into a second-level cache of a megabyte.
# hermetic-68cc takes 35 us a speed by 16, 34 by 32, 36 by 64 and 58 by 128; 41 nodes and a line of 24
# beside them take 47, 45, 60 and 84.
_SIDE_BY_SIDE = 32


class SingularResponse(ArithmeticError):
    """A response that has no answer, or none with correct digits."""


class Response(Result, eqx.Module):
    """Complex amplitudes X of x(t) = Re[X e^{i w t}], with the evidence of the solution.

    Attributes:
        displacement: [m], [rad] (*batch, nodes, dof).
        frequency: [rad/s] w, (*batch).
        spin_speed: [rad/s] W, (*batch).
        correction: [-] relative error left before the last sweep of refinement, (*batch).
        amplification: [-] dimensionless response per load, (*batch).
        status: [-] number of a word, see `words`, (*batch).
        held: [N], [N m] force of pinned and clamped links on their second node or the ground, (*batch,
            links, dof), zero for the other links; absent in a model without any.
        nodes: names of the nodes, where they are known; static.
    """

    displacement: Array
    frequency: Array = reading("rad/s", "order", "speed")
    spin_speed: Array = reading("rad/s", "order", "speed")
    correction: Array = reading(
        "", "order", "speed", doc="relative error before the last refinement"
    )
    amplification: Array = reading("", "order", "speed")
    status: Array = held()
    held: Array | None = None
    nodes: tuple[str, ...] = eqx.field(static=True, default=())

    table_dims: ClassVar[tuple[str, ...]] = ("order", "speed", "node")
    flat: ClassVar[bool] = True

    def described(self) -> Iterator[Data]:
        """The quantities of this result in SI units; the order is frequency over speed."""
        *_, nodes, dof = np.shape(self.displacement)
        spin = np.asarray(self.spin_speed)
        frequency = np.asarray(self.frequency)
        # a single response has no axis, one of a list of speeds the second alone
        at = ("order", "speed")[max(2 - spin.ndim, 0) :]
        if spin.ndim == 2:  # of `respond`: the same speeds at every order
            order = np.round(frequency[:, :1] / np.where(spin[:, :1] == 0, np.inf, spin[:, :1]))
            yield Data("order", "", order[:, 0], ("order",))
            for speed in self.data_of(speed="spin_speed", dims=("speed",)):
                yield speed._replace(values=spin[0])
        else:
            yield from self.data_of("spin_speed", dims=at)
        yield from self.data_of("frequency", dims=at)
        yield Data("node", "", np.array(self.nodes or range(nodes)), ("node",))
        for number, axis in enumerate(AXES[dof]):
            unit = "m" if axis.startswith("u") else "rad"
            yield Data(axis, unit, np.asarray(self.displacement)[..., number], (*at, "node"))
        yield Data("reliable", "", np.asarray(self.ok), at)
        yield from self.data_of("correction", dims=at)

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """Where the response can be relied on."""
        return self.status == OK

    @property
    def words(self) -> list | str:
        """The status in words: "ok", "singular", "inaccurate", "not finite", "out of bounds" (a number
        of the model is not inside its bound, which only traced values can be) or "without a periodic
        state" (of the crank that shakes the rotor)."""
        return status_words(self.status)

    @property
    def velocity(self) -> Complex[Array, "*batch nodes dof"]:
        """[m/s], [rad/s] i w X."""
        return 1j * self.frequency[..., None, None] * self.displacement

    @property
    def acceleration(self) -> Complex[Array, "*batch nodes dof"]:
        """[m/s2], [rad/s2] -w^2 X."""
        return -(self.frequency[..., None, None] ** 2) * self.displacement

    def checked(self) -> "Response":
        """The response itself, if all of it can be relied on.

        Raises:
            SingularResponse: naming the frequencies that failed, and why.
        """
        bad = ~np.asarray(self.ok)
        if bad.any():
            where = np.asarray(self.frequency)[bad]
            codes = np.unique(np.asarray(self.status)[bad])
            words = sorted({str(status_words(code)) for code in codes})
            raise SingularResponse(
                f"The response is {', '.join(words)} at {where.size} of {bad.size} frequencies, "
                f"first at {where.reshape(-1)[0]:.6g} rad/s: at an undamped resonance add damping, "
                "at an unsupported coordinate a support; look for a NaN or a value outside its bounds in "
                "the model."
            )
        return self


def harmonic_response(
    model: RotorModel | System,
    force: Complex[Array, "nodes dof"],
    spin_speed: Float[Array, ""],
    frequency: Float[Array, ""],
    *,
    solver: Solver = "structured",
) -> Response:
    r"""Solve [K(W) - w^2 M + i w (C(W) + W G)] X = F for one load.

    The spin speed W and the excitation frequency w are independent. Map it with `jax.vmap` for
    other batches than those of `respond`.

    Args:
        model: the model, or the `System` prepared from it.
        force: [N], [N m] F, with the time factor e^{i w t}.
        spin_speed: [rad/s] W.
        frequency: [rad/s] w.
        solver: "structured" or "dense".

    Raises:
        BadInput: a force of the wrong shape or a speed that is not finite.
    """
    _check(model, force, spin_speed=spin_speed, frequency=frequency)
    # As arrays, because a Python number would be compiled in.
    spin_speed = jnp.asarray(spin_speed, float)
    frequency = jnp.asarray(frequency, float)
    return _harmonic(model, jnp.asarray(force, complex), spin_speed, frequency, solver)


def respond(
    model: RotorModel | System,
    loads: Loads,
    spin_speeds: Float[Array, " speeds"],
    orders: tuple[int, ...] = (1,),
    *,
    nodes: tuple[Node, ...] | None = None,
    solver: Solver = "structured",
    batch_size: int = _SIDE_BY_SIDE,
) -> Response:
    """Response to unbalances and periodic forces at many speeds and orders.

    Speeds go through the solver in batches, so that the memory does not grow with their number;
    its gradient computes each batch again for the same reason. Outside of `jit`, `vmap` and `grad` lists
    of speeds are filled up to a few lengths, so that another number of speeds seldom compiles anew.

    Args:
        model: the model, or the `System` prepared from it.
        loads: unbalances and periodic forces.
        spin_speeds: [rad/s] (speeds,)
        orders: orders n of the spin speed; the frequency is n W.
        nodes: the nodes to keep; absent: all, in the order of `node_names`.
        solver: "structured" or "dense".
        batch_size: speeds times orders solved side by side; more leave the nearest memory of a processor.

    Returns:
        Response with the batch (orders, speeds).

    Raises:
        BadInput: loads that are none, speeds that are not finite or no list, or an unknown node.

    >>> from jaxcomp.rotor import Disks, Link, Mount, RotorModel, ShaftElements, Unbalances
    >>> shaft = ShaftElements((1, 2, 3), 0.2, 0.02, 2.06e11, 7850.0, 0.3)
    >>> bearing = Mount([1e7, 1e7], [100.0, 100.0])
    >>> links = (Link((1, None), bearing), Link((3, None), bearing))
    >>> model = RotorModel((shaft,), (Disks((2,), 5.0, 6e-3, 12e-3),), links=links)
    >>> loads = (Unbalances((2,), 1e-4, 0.0),)  # 100 g mm
    >>> motion = respond(model, loads, [100.0, 300.0]).checked().displacement[0, :, 1, 0]
    >>> print([f"{1e6 * abs(x):.2f} um" for x in motion])
    ['0.92 um', '13.98 um']
    """
    check_loads(loads)
    spin_speeds = jnp.asarray(spin_speeds, float)
    if spin_speeds.ndim != 1 or not spin_speeds.size:
        raise BadInput("spin_speeds", spin_speeds, "a list of speeds")
    if not all(isinstance(n, int) for n in orders) or not orders:
        raise BadInput("orders", str(orders), "whole numbers")
    _check(model, None, spin_speeds=spin_speeds)
    keep = None
    names = node_names(model)
    if nodes is not None:
        keep = tuple(node_index(model, node) for node in nodes)
        names = nodes
    count = spin_speeds.size
    if not is_any_traced(model, loads, spin_speeds):
        spin_speeds = jnp.asarray(filled(spin_speeds, batch_size))
    response = _respond(model, loads, spin_speeds, tuple(orders), keep, solver, batch_size)
    if spin_speeds.size > count:
        response = without_filling(response, count, axis=1)
    return dataclasses.replace(response, nodes=tuple(map(str, names)))


def receptance(
    model: RotorModel | System,
    inputs: Complex[Array, "inputs nodes dof"],
    outputs: Float[Array, "outputs nodes dof"],
    spin_speed: Float[Array, ""],
    frequency: Float[Array, ""],
    *,
    solver: Solver = "structured",
) -> Complex[Array, "outputs inputs"]:
    """[m/N] Responses along `outputs` to the loads `inputs`; the matrix is factorised once.

    Args:
        model: the model.
        inputs: [N] loads, [N m] on rotations, for example from `nodal_load`.
        outputs: [-] directions in which the motion is read, for example from `nodal_load`.
        spin_speed: [rad/s]
        frequency: [rad/s]
        solver: "structured" or "dense".
    """
    spin_speed = jnp.asarray(spin_speed, float)
    frequency = jnp.asarray(frequency, float)
    inputs = jnp.asarray(inputs, complex)
    outputs = jnp.asarray(outputs)
    return _receptance(model, inputs, outputs, spin_speed, frequency, solver)


def transmitted_forces(model: RotorModel, response: Response) -> Complex[Array, "*batch links dof"]:
    """[N], [N m] Force of each link on its second node or the ground, K d + C d' or the reaction.

    The links come first, in the model's order, then the pairs of the magnetic pulls. The response has
    to hold all nodes.

    Args:
        model: the rotor.
        response: of `respond`, at all nodes.
    """
    # Filled up as in `respond`: single responses, and those within `jit` or `grad`, stay as they are.
    if response.frequency.ndim != 2 or is_any_traced(model, response):
        return _transmitted(model, response)
    count = response.frequency.shape[1]
    length = filled_length(count, _SIDE_BY_SIDE)
    if length == count:
        return _transmitted(model, response)
    longer = jax.tree.map(lambda a: jnp.asarray(filled_along(a, length, axis=1)), response)
    return without_filling(_transmitted(model, longer), count, axis=1)


def relative_displacement(
    model: RotorModel | System, response: Response, first: Node, second: Node
) -> Complex[Array, "*batch dof"]:
    """[m], [rad] Motion of the first node as seen from the second, for example in a bearing.

    Args:
        model: the model.
        response: of `respond` or `harmonic_response`.
        first: the node that is looked at.
        second: the node it is seen from.
    """
    x = response.displacement
    return x[..., node_index(model, first), :] - x[..., node_index(model, second), :]


@kept_jit
def _harmonic(model, force, spin_speed, frequency, solver):
    z = operator_at(prepare(model), spin_speed, frequency)
    return _answer(z, make_solver(z, solver), force)


@kept_jit
def _transmitted(model, response):
    system = bare(model)

    def forces_of_links(x, w, spin):
        z = operator_at(system, spin, w)
        push = link_force(system.layout, z.links, to_planes(x, system.dof))
        return from_planes(push.reshape(-1, system.dof // 2, 2), system.dof)

    # one for each axis of the batch: none, speeds, or orders and speeds
    for _ in range(response.frequency.ndim):
        forces_of_links = jax.vmap(forces_of_links)
    push = forces_of_links(response.displacement, response.frequency, response.spin_speed)
    if response.held is None:
        return push
    # a held link has no law, so that its entry is zero until here
    return push.at[..., : len(system.model.links), :].add(response.held)


@kept_jit
def _respond(model, loads, spin_speeds, orders, keep, solver, batch_size):
    system = prepare(model)

    def at_speeds(spins):
        z = operator_at(system, spins, spins)
        forces = [load_vector(system, loads, n, spins) for n in orders]
        # One list of all orders and speeds, along the last axis.
        z = z._replace(
            frequency=jnp.concatenate([n * spins for n in orders]),
            stiffness=_repeated(z.stiffness, len(orders)),
            damping=_repeated(z.damping, len(orders)),
            spin_speed=_repeated(z.spin_speed, len(orders)),
        )
        out = respond_to(z, jnp.concatenate(forces, -1))

        def by_order(a):
            return jnp.moveaxis(a, -1, 0).reshape(len(orders), len(spins), *a.shape[:-1])

        return jax.tree.map(by_order, out)

    def respond_to(z, force):
        out = _answer(z, make_solver(z, solver), force)
        if keep is None:
            return out
        # Dropped within the batch, so that no array holds all nodes at all speeds.
        return eqx.tree_at(lambda r: r.displacement, out, out.displacement[np.array(keep, int)])

    if solver == "dense" or system.modal is not None:
        # full matrices, which a library factorises one by one
        at_speeds = partial(_at_each_speed, system, loads, orders, respond_to)
    count = spin_speeds.shape[0]
    together = max(batch_size // len(orders), 1)
    if count <= together:
        return at_speeds(spin_speeds)
    # Filled up to whole batches, because a remainder would be a second program to compile.
    fill = -count % together
    full = jnp.concatenate([spin_speeds, jnp.full(fill, spin_speeds[-1])])
    recomputed = jax.checkpoint(at_speeds, policy=_keep_motion)
    batches = jax.lax.map(recomputed, full.reshape(-1, together))

    def joined(a):
        # from (batches, orders, speeds of a batch, ...) to (orders, speeds, ...)
        return jnp.swapaxes(a, 0, 1).reshape(len(orders), -1, *a.shape[3:])[:, :count]

    return jax.tree.map(joined, batches)


def _at_each_speed(system, loads, orders, respond_to, spins):
    """Responses (orders, speeds, ...) by a matrix at each, in the place of one list along a last axis."""

    def at_speed(spin):
        # an unbalance and the forces of all orders know one speed of the shaft
        forces = jnp.stack([load_vector(system, loads, n, spin) for n in orders])

        def at_order(frequency, force):
            return respond_to(operator_at(system, spin, frequency), force)

        return jax.vmap(at_order)(np.array(orders) * spin, forces)

    # the orders stay in front, as of lists of speeds
    return jax.vmap(at_speed, out_axes=1)(spins)


def _repeated(a, times):
    """Values along a last axis of speeds, once for each order."""
    return jnp.concatenate([a] * times, -1)


def _keep_motion(primitive, *_, **__):
    # The gradient factorises each batch again, and does not solve it again.
    return primitive.name == "custom_linear_solve"


def _answer(z, solve, force) -> Response:
    dof = z.system.dof
    force = to_planes(force, z.system.dof)
    s = solve(collect(z.system, force))
    x = follow(z.system, s.x)
    held = None
    if z.system.layout.ties.holds:
        # From the load where it acts, not as it is collected: a held node keeps its own part.
        held = reactions(z, x, force)
        held = from_planes(held.reshape(-1, *x.shape[1:]), dof)
    x = from_planes(x, dof)
    return Response(x, z.frequency, z.spin_speed, s.correction, s.amplification, s.status, held)


@kept_jit
def _receptance(model, inputs, outputs, spin_speed, frequency, solver):
    z = operator_at(prepare(model), spin_speed, frequency)
    # outside of `vmap`, so that the factors are computed once for all loads
    solve = make_solver(z, solver)
    columns = jax.vmap(lambda force: _answer(z, solve, force).displacement)(inputs)
    return jnp.einsum("ond,ind->oi", outputs, columns)


def _check(model, force, **speeds):
    shape = (layout_of(model).n, model.dof)
    if force is not None and jnp.shape(force) != shape:
        raise BadInput("force", str(jnp.shape(force)), f"of shape {shape} (nodes, dof)")
    for name, value in speeds.items():
        if not is_traced(value) and not np.all(np.isfinite(value)):
            raise BadInput(name, value, "finite")


class WhirlOrbit(NamedTuple):
    """Ellipse u_x + i u_y = F e^{i w t} + B e^{-i w t}.

    Attributes:
        major: [m] semi-major axis, |F| + |B|.
        minor: [m] semi-minor axis with a sign, |F| - |B|: positive in forward whirl.
        inclination: [rad] of the major axis from x, in (-pi/2, pi/2].
        forward: [m] complex amplitude F.
        backward: [m] complex amplitude B.
    """

    major: Array
    minor: Array
    inclination: Array
    forward: Array
    backward: Array


@eqx.filter_jit  # one program instead of fifteen
def orbit(x: Complex[Array, "*batch"], y: Complex[Array, "*batch"]) -> WhirlOrbit:
    """The orbit of a node.

    Args:
        x: [m] amplitude of u_x, time factor e^{i w t}.
        y: [m] amplitude of u_y.
    """
    # Re[z] = (z + conj z)/2 on both axes: what turns with e^{-i w t} comes from the conjugates.
    forward = (x + 1j * y) / 2
    backward = jnp.conj((x - 1j * y) / 2)
    f, b = magnitude(forward), magnitude(backward)
    # Half the angle of F B is that of the major axis; where one of them is zero the orbit is a
    # circle without one.
    product = forward * backward
    circle = product == 0
    angle = jnp.where(circle, 0.0, jnp.angle(jnp.where(circle, 1.0, product)) / 2)
    return WhirlOrbit(f + b, f - b, angle, forward, backward)


def magnitude(z: Complex[Array, "*batch"]) -> Float[Array, "*batch"]:
    """|z| with a zero derivative at zero, where that of `abs` is not a number."""
    zero = z == 0
    return jnp.where(zero, 0.0, jnp.abs(jnp.where(zero, 1.0, z)))
