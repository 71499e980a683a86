r"""The border of the structured solver: coordinates, links and bodies, and the way to planes."""

import jax
import jax.numpy as jnp
import numpy as np

from ._conventions import plane_numbers
from ._system import link_places
from ._two_by_two import product_t


def close_segments(layout, border, to_left, right, last, end_fill):
    """Add to the border matrix what the segments leave on their two ends."""
    b, (left, far) = len(layout.border), layout.ends
    to_left = tuple(-c for c in to_left)
    to_far = tuple(-c for c in product_t(right, last))
    across = tuple(-c for c in product_t(last, end_fill))  # rows far, columns left
    blocks = border.reshape(b, 2, b, 2, -1).transpose(0, 2, 1, 3, 4)
    shaped = lambda t: jnp.stack(t).reshape(2, 2, *t[0].shape).transpose(2, 0, 1, 3)  # noqa: E731
    blocks = blocks.at[left, left].add(shaped(to_left), mode="drop")
    blocks = blocks.at[far, far].add(shaped(to_far), mode="drop")
    both = (left < b) & (far < b)
    cross = shaped(across)[both]
    blocks = blocks.at[far[both], left[both]].add(cross)
    blocks = blocks.at[left[both], far[both]].add(jnp.swapaxes(cross, 1, 2))
    return blocks.transpose(0, 2, 1, 3, 4).reshape(border.shape)


def add_side_pulls(layout, z, border):
    """Add the side pulls, which are isotropic and so stay within the whirl lanes."""
    count = len(z.system.model.links)
    if not layout.links[count:].size:
        return border
    place = np.full(layout.n + 1, len(layout.border))
    place[layout.border] = np.arange(len(layout.border))
    a, b = 2 * place[layout.links[count:]].T
    k = z.links.stiffness[count:, 0, 0][:, None]
    whirl = border[..., :2].at[a, a].add(k).at[b, b].add(k, mode="drop")
    whirl = whirl.at[a, b].add(-k, mode="drop").at[b, a].add(-k, mode="drop")
    return jnp.concatenate([whirl, border[..., 2:]], -1)


def hold_loose(layout, border):
    """Give the coordinates that nothing acts on a stiffness, so that the matrix has an inverse."""
    lateral = (layout.loose[:, 0] & layout.loose[:, 1]).reshape(-1)
    kinds = [lateral, lateral] + ([layout.loose[:, 2].reshape(-1)] if layout.dof == 6 else [])
    at = np.arange(lateral.size)
    return border.at[at, at].add(np.stack(kinds, -1).astype(float))


def lane_kinds(layout):
    """Numbers of the whirl lanes and of the axial lane."""
    return (np.array([0, 1]),) + ((np.array([2]),) if layout.dof == 6 else ())


def border_choices(layout):
    """Untouched and touched border coordinates (of 2 b), for each kind of lane."""
    lateral = layout.touched[:, 0] | layout.touched[:, 1]
    kinds = [lateral] + ([layout.touched[:, 2]] if layout.dof == 6 else [])
    return [(np.flatnonzero(~t.reshape(-1)), np.flatnonzero(t.reshape(-1))) for t in kinds]


def _touched_numbers(layout):
    """Degree of freedom (in n * dof) and sign of the touched border coordinates.

    Their order: x plane, y plane, then axial and torsion.
    """
    numbers, signs = plane_numbers(layout.dof)
    choices = border_choices(layout)
    out, sign = [], []
    for plane in range(len(numbers)):
        keep = choices[0 if plane < 2 else 1][1]
        out.append(layout.border[keep // 2] * layout.dof + numbers[plane][keep % 2])
        sign.append(signs[plane][keep % 2])
    return np.concatenate(out).astype(int), np.concatenate(sign)


def border_motion(layout, z):
    """Touched border coordinates from the independent ones among them."""
    numbers, sign = _touched_numbers(layout)
    free = layout.active.reshape(-1)[numbers]
    if not layout.slaved.size:
        return jnp.eye(len(numbers))[:, free]
    place = np.full(layout.n * layout.dof, -1)
    place[numbers] = np.arange(len(numbers))
    rows, columns = (
        place[at[:, None] * layout.dof + np.arange(layout.dof)]
        for at in (layout.slaved, layout.centre_of)
    )
    fixed = np.eye(len(numbers))
    fixed[rows.reshape(-1)] = 0.0
    arms = sign[rows][:, :, None] * z.system.structure.arms * sign[columns][:, None, :]
    motion = jnp.asarray(fixed).at[rows[:, :, None], columns[:, None, :]].set(arms)
    return motion[:, free]


def links_and_bodies(layout, z):
    """Stiffness of links and bodies on the touched border coordinates."""
    numbers, sign = _touched_numbers(layout)
    place = np.full((layout.n + 1) * layout.dof, len(numbers))
    place[numbers] = np.arange(len(numbers))
    factor = np.append(sign, 1.0)
    w, count = z.frequency, len(z.system.model.links)
    links = z.links.stiffness[:count] + 1j * w * z.links.damping[:count]
    structure = z.system.structure
    inert = -(w**2) if structure.damping is None else -(w**2) + 1j * w * structure.damping[0]
    bodies = inert * structure.bodies[:, 0] + 1j * w * z.spin_speed * structure.bodies[:, 1]
    rows, columns, signs = link_places(layout, count)
    rows, columns = (np.concatenate([at, layout.centres]) for at in (rows, columns))
    blocks = jnp.concatenate([signs[:, None, None] * jnp.tile(links, (4, 1, 1)), bodies])
    rows, columns = (
        place[at[:, None] * layout.dof + np.arange(layout.dof)] for at in (rows, columns)
    )
    signed = factor[rows][:, :, None] * blocks * factor[columns][:, None, :]
    full = jnp.zeros((len(numbers),) * 2, complex)
    return full.at[rows[:, :, None], columns[:, None, :]].add(signed, mode="drop")


def unlane(kept):
    """From lanes to planes: S_xx = S_yy = (S_p + S_q)/2, S_xy = -S_yx = i (S_p - S_q)/2."""
    p, q = kept[0]
    mean, half = (p + q) / 2, 0.5j * (p - q)
    out = jnp.block([[mean, half], [-half, mean]])
    return out if len(kept) == 1 else jax.scipy.linalg.block_diag(out, kept[1][0])


def unlane_vector(kept):
    (p, q), root = kept[0], np.sqrt(0.5)
    return jnp.concatenate([root * (p + q), -1j * root * (p - q), *(k[0] for k in kept[1:])])


def lane_vector(y, sizes, kind):
    if kind == 1:
        return y[None, 2 * sizes[0] :]
    x, y = y[: sizes[0]], y[sizes[0] : 2 * sizes[0]]
    return np.sqrt(0.5) * jnp.stack([x + 1j * y, x - 1j * y])
