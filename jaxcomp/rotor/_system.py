r"""A rotor model prepared for its solvers.

Everything of a model that does not depend on the speed is collected once in a `System`, which all
verbs take in place of the model. Products go element by element (`_operator`), which keeps more digits
than an assembled matrix; the full matrices of `matrices` serve the modes.

In here motions and forces are in the order of the planes of `_conventions`, (n, planes, 2), and the
numbers of a node in that order are its *coordinates*. Shafts, disks and masses act in whirl *components*,
forward (p), backward (q) and, with 6 degrees of freedom, axial-torsional. There the dynamic
stiffness is a combination of `TERMS` with coefficients that depend on speed and frequency.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._core.fields import admissible, replaced
from ._blocks import times_each
from ._bodies import ProportionalDamping, body_matrices, inertia_matrices
from ._conventions import add, axis_numbers, coordinates, take, trailing
from ._layout import Layout, layout_of
from ._links import Link, diagonal, magnetic_pull_stiffness
from ._model import RotorModel
from ._places import Places
from ._shaft import Node, element_matrices
from ._ties import body_arms, tie_matrices

# Lateral stiffness, inertia and polar inertia, axial and torsional stiffness and inertia.
TERMS = ("stiffness", "mass", "polar", "axial_stiffness", "axial_mass")


class System(eqx.Module):
    """A rotor model with everything computed that does not depend on the speed.

    It stands for its model in every verb of `jaxcomp.rotor`, so that several of them share the
    preparation. Derivatives go through it to the numbers of the model. The arrays have q terms, 3 or
    with 6 degrees of freedom 5, see `TERMS`, and l components, 2 or 3.

    Attributes:
        model: the rotor model.
        layout: which node is connected to which; static.
        strain: (e, l, 4, 2) forces on an element by its deformation, J^T S.
        half: [m] (e, l) half the length of an element, zero in the axial component.
        elements: (e, 4, 4, q) matrices of the elements.
        inertia: (n, 2, 2, q) those of disks and masses.
        arms: (t, dof, dof) motion of nodes that follow others, in coordinates, see `Layout.ties`.
        bodies: (bodies, 2, dof, dof) inertia and gyroscopic matrix of the rigid bodies.
        damping: (alpha, beta) of the proportional damping, or None.
        places: elements and inertia in the places of the structured solver.
        modal: (m, n, planes, 2) M phi sqrt(2 zeta w) of modal damping, or None.
        admissible: whether the numbers of the model are inside their bounds.
    """

    model: RotorModel
    layout: Layout = eqx.field(static=True)
    strain: Array
    half: Array
    elements: Array
    inertia: Array
    arms: Array
    bodies: Array
    damping: tuple[Array, Array] | None
    places: Places | None = None
    modal: Array | None = None
    admissible: Bool[Array, ""] | None = None

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The nodes in the order of every array over nodes."""
        return self.layout.names

    @property
    def dof(self) -> int:
        """Degrees of freedom of a node."""
        return self.layout.dof


def bare(model: RotorModel | System) -> System:
    """The prepared model without modal damping, which the undamped modes define."""
    if isinstance(model, System):
        return replaced(model, modal=None)
    layout = layout_of(model)
    dof = model.dof
    strain, half, elements = _elements(model, layout)
    number = {name: i for i, name in enumerate(layout.names)}
    inertia = jnp.zeros((layout.n, 2, 2, elements.shape[-1]))
    for table in (*model.disks, *model.masses):
        mass, polar, axial = inertia_matrices(table)
        none = jnp.zeros_like(mass)
        # as `TERMS`, of which a model without torsion has the first three; inertia has no stiffness
        terms = jnp.stack([none, mass, polar, none, axial][: elements.shape[-1]], -1)
        inertia = add(inertia, np.array([number[node] for node in table.nodes], int), terms)
    arms = tie_matrices(layout.ties, layout.slaved, body_arms(model.bodies, dof))
    bodies = [body_matrices(body, dof)[None] for body in model.bodies]
    bodies = jnp.concatenate([jnp.zeros((0, 2, dof, dof)), *bodies])
    damping = None
    if isinstance(model.damping, ProportionalDamping):
        damping = (model.damping.mass_factor, model.damping.stiffness_factor)
    return System(model, layout, strain, half, elements, inertia, arms, bodies, damping)


def marked(system: System, values: Array) -> Array:
    """Values of a system, not a number for one with a number of the model out of its bound."""
    good = system.admissible
    if good is None:
        good = admissible(system.model)
    none = np.nan
    if jnp.iscomplexobj(values):
        none = complex(np.nan, np.nan)
    return jnp.where(good, values, none)


def released(model: RotorModel | System) -> RotorModel | System:
    """The model without what pinned and clamped links hold."""
    rotor = model.model if isinstance(model, System) else model
    if not any(link.held for link in rotor.links):
        return model
    links = []
    for link in rotor.links:
        # As links without stiffness, so that their nodes and the numbers of the others stay.
        if link.held:
            law = diagonal(*jnp.zeros((2, len(link.axes))))
            link = Link(link.nodes, law, link.axes)
        links.append(link)
    return dataclasses.replace(rotor, links=tuple(links))


def undamped(system: System) -> System:
    """A system without the damping of its structure; that of the links belongs to the operator."""
    return replaced(system, damping=None, modal=None)


def _elements(model, layout):
    """`strain`, `half` and `elements` of a `System`."""
    components, terms = (2, 3) if layout.dof == 4 else (3, 5)
    if not model.shafts:
        return (
            jnp.zeros((0, components, 4, 2)),
            jnp.zeros((0, components)),
            jnp.zeros((0, 4, 4, terms)),
        )
    el = element_matrices(model.shafts)
    strain = jnp.einsum("eki,ekl->eil", el.shape, el.lateral)
    half = el.length / 2
    bend = jnp.einsum("eik,ekj->eij", strain, el.shape)
    if components == 2:
        full = jnp.stack([bend, el.mass, el.polar], -1)
        return jnp.stack([strain] * 2, 1), jnp.stack([half] * 2, 1), full
    # `_BAR` in the place of J, so that products go through lateral and axial components alike
    bars = el.axial[:, ::-1, None] * _BAR  # torsion first, as the rotation among the deformations
    stretch = jnp.einsum("eki,kj->eij", bars, _BAR)
    full = jnp.stack([bend, el.mass, el.polar, stretch, el.axial_mass], -1)
    strain = jnp.stack([strain, strain, jnp.swapaxes(bars, 1, 2)], 1)
    return strain, jnp.stack([half, half, jnp.zeros_like(half)], 1), full


_BAR = np.array([[0.0, -1.0, 0.0, 1.0], [-1.0, 0.0, 1.0, 0.0]])


def link_matrices(
    system: System, spin_speed: Float[Array, ""]
) -> tuple[Float[Array, "l dof dof"], Float[Array, "l dof dof"]]:
    """Stiffness and damping of all links, then of the magnetic pulls, at a spin speed [rad/s]."""
    dof = system.dof
    values = []
    places = []
    used = 0
    order, signs = coordinates(dof)
    for link, (k, c) in zip(system.model.links, _laws(system.model.links, spin_speed), strict=True):
        in_law, in_node = axis_numbers(dof, link.axes)
        place = np.full((dof, dof), -1)
        size = len(link.axes)
        entries = used + np.arange(size**2).reshape(size, size)
        # a law may have axes that nodes of 4 degrees of freedom lack
        place[np.ix_(in_node, in_node)] = entries[np.ix_(in_law, in_law)]
        values.append(jnp.stack([k, c]).reshape(2, -1))
        places.append(place[order[:, None], order])
        used += size**2
    # One gather for all links, whose last value is the zero of the places that no law fills.
    table = jnp.concatenate([*values, jnp.zeros((2, 1))], 1)
    at = np.array(places, int).reshape(-1, dof, dof)
    coefficients = take(table.T, np.where(at < 0, used, at))
    # Laws speak of th_x, nodes of -th_x: what couples it with other axes changes its sign.
    coefficients = coefficients * (signs[:, None] * signs)[..., None]
    lateral = np.zeros((dof, dof, 2))
    # u_x and u_y are the coordinates 0 and 2; a pull has no damping.
    lateral[[0, 2], [0, 2], 0] = 1.0
    pulls = []
    for pull in system.model.magnetic_pulls:
        pulls.append(magnetic_pull_stiffness(pull)[:, None, None, None] * lateral)
    coefficients = jnp.concatenate([coefficients, *pulls])
    return coefficients[..., 0], coefficients[..., 1]


def _laws(links, spin_speed):
    """Coefficients of every link; laws of one construction go through together."""
    kinds: dict = {}
    coefficients: list = []
    for number, link in enumerate(links):
        none = np.zeros((len(link.axes),) * 2)
        coefficients.append((none, none))
        if link.held:
            continue
        arrays, static = eqx.partition(link.law, eqx.is_array)
        shapes = tuple(a.shape for a in jax.tree.leaves(arrays))
        kinds.setdefault((jax.tree.structure(arrays), shapes), []).append((number, arrays, static))
    for alike in kinds.values():
        numbers, arrays, statics = zip(*alike, strict=True)
        # What is neither array nor static may differ from law to law, and cannot be stacked.
        differs = any(map(jax.tree.leaves, statics))
        if len(alike) == 1 or not jax.tree.leaves(arrays[0]) or differs:
            for number in numbers:
                coefficients[number] = links[number].law.coefficients(spin_speed)
            continue
        stacked = jax.tree.map(lambda *a: jnp.stack(a), *arrays)
        law = lambda a, static=statics[0]: eqx.combine(a, static).coefficients(spin_speed)  # noqa: E731
        for number, k, c in zip(numbers, *jax.vmap(law)(stacked), strict=True):
            coefficients[number] = k, c
    return coefficients


def follow(system: System, x: Array) -> Array:
    """Motion with the slaved nodes put where their bodies take them."""
    layout = system.layout
    shape = x.shape[1:]
    if layout.free.all():
        return x
    node, master = layout.ties.nodes
    leading = take(x, master).reshape(-1, layout.dof, *x.shape[3:])
    moved = times_each(system.arms, leading).reshape(-1, *shape)
    # cleared before it is added to: the vector may hold anything on coordinates that follow
    return add(x * trailing(layout.free, x.ndim - 3), node, moved)


def collect(system: System, f: Array) -> Array:
    """Forces with those on following coordinates moved to what they follow (transpose of `follow`)."""
    if system.layout.free.all():
        return f
    return collected(f, system.layout.free, *system.layout.ties.nodes, system.arms)


def collected(f, free, node, master, arms):
    at = take(f, node).reshape(len(node), arms.shape[-1], *f.shape[3:])
    moved = times_each(jnp.swapaxes(arms, 1, 2), at).reshape(-1, *f.shape[1:])
    return add(f * trailing(free, f.ndim - 3), master, moved)
