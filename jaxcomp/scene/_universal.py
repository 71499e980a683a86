r"""Modal tests in universal files: normal modes (data set 55), or frequency responses (data set 58).

Of responses every peak of their sum of squares is a mode. Near it all of them share the poles of one,

$$H_k(\omega)\,(d_0 + d_1 s + s^2) = n_{0k} + n_{1k}s, \qquad s = i\omega,$$

with real d and complex n, which is linear in both: $\sqrt{d_0}$ is the natural frequency, and the residue
at the pole, turned to be real, the shape. The slope of the right side stands for all other modes, and for
velocities or accelerations in the place of displacements. Modes whose peaks touch are none of its kind.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks, peak_prominences

from ..study import ModalTest
from ._text import SceneError

_AXES = {1: "ux", 2: "uy", 3: "uz"}
_RESPONSE = 4  # function type of data set 58
# A peak stands above its surroundings by this share of itself, above this share of the highest, and above
# so many times the noise, which is what the second differences of the responses show.
_STANDS_OUT, _HEIGHT, _NOISE = 0.5, 1e-3, 8.0
# Points of a peak are those above this share of its amplitude; so many are needed.
_NEAR, _LEAST = 0.5, 4


def read_universal(path, name: str) -> ModalTest:
    """The modal test of a universal file, of a rotor that hangs free.

    Args:
        path: of the file.
        name: of the source.

    Raises:
        SceneError: no pyuff, or a file that it cannot read, without modes and responses, or with
            responses that do not belong together.
    """
    try:
        import pyuff
    except ImportError:
        raise SceneError("", 'needs pyuff: pip install "jaxcomp[modal]"') from None
    try:
        sets = pyuff.UFF(str(path)).read_sets()
    except Exception as error:  # pyuff has no class of its own for what it cannot read
        raise SceneError("", f"cannot be read as a universal file ({error})") from None
    sets = sets if isinstance(sets, list) else [sets]
    modes = [one for one in sets if one["type"] == 55 and one["analysis_type"] == 2]
    if modes:
        return _of_modes(modes, name)
    functions = [one for one in sets if one["type"] == 58]
    if functions:
        return _of_responses(functions, name)
    found = ", ".join(str(one) for one in sorted({one["type"] for one in sets})) or "nothing"
    bound = "has no normal modes (data set 55 of analysis type 2) and no responses (58), but"
    raise SceneError("", f"{bound} {found}")


def _of_modes(modes, name: str) -> ModalTest:
    modes = sorted(modes, key=lambda one: one["freq"])
    nodes = sorted({int(node) for one in modes for node in one["node_nums"]})
    pairs = [(node, axis) for node in nodes for axis in _AXES.values()]
    shape = np.full((len(modes), len(pairs)), np.nan)
    for row, one in enumerate(modes):
        for n, node in enumerate(one["node_nums"]):
            for k, axis in _AXES.items():
                values = one.get(f"r{k}")
                if values is not None:
                    shape[row, pairs.index((int(node), axis))] = np.real(values[n])
    return _test(name, np.array([one["freq"] for one in modes]), pairs, shape)


def _test(name: str, hertz: NDArray, pairs, shape: NDArray) -> ModalTest:
    if not (hertz > 0).all():
        raise SceneError("frequency", "must be above 0", float(hertz.min()))
    moving = np.nan_to_num(np.abs(shape)).max(axis=0) > 0
    kept = [pair for pair, moves in zip(pairs, moving, strict=True) if moves]
    nodes, axes = zip(*kept, strict=True) if kept else ((), ())
    numbers = tuple(range(1, hertz.size + 1))
    return ModalTest(name, 2 * np.pi * hertz, numbers, True, nodes, axes, shape[:, moving])


def _of_responses(functions, name: str) -> ModalTest:
    kinds = sorted({int(one["func_type"]) for one in functions})
    if kinds != [_RESPONSE]:
        found = ", ".join(map(str, kinds))
        raise SceneError("", f"has functions of type {found}, where 4, a response, is read alone")
    where = {
        key: [(int(one[f"{key}_node"]), int(one[f"{key}_dir"])) for one in functions]
        for key in ("rsp", "ref")
    }
    # a hammer that roves, or sensors that do: by reciprocity the same
    roving = "rsp" if len(set(where["ref"])) == 1 else "ref"
    if len(set(where["rsp"])) > 1 and len(set(where["ref"])) > 1:
        bound = "must have the same response or the same reference in all functions"
        raise SceneError("", bound)
    places = where[roving]
    if twice := next((one for one in places if places.count(one) > 1), None):
        raise SceneError("", f"has node {twice[0]}, direction {twice[1]} twice; give means")
    if wrong := next((k for _, k in places if abs(k) not in _AXES), None):
        raise SceneError("", f"has direction {wrong}, where 1, 2 and 3 are read")
    hertz = np.asarray(functions[0]["x"], float)
    for one in functions:
        if np.shape(one["x"]) != hertz.shape or not np.allclose(one["x"], hertz, rtol=1e-9):
            raise SceneError("", "must have the same frequencies in all functions")
    # against the axis counts as negative along it
    signs = np.array([np.sign(k) for _, k in places])
    responses = np.stack([np.asarray(one["data"], complex) for one in functions]) * signs[:, None]
    if not np.isfinite(responses).all():
        raise SceneError("", "has responses that are not finite")
    found, shapes = modes_of_responses(hertz, responses)
    return _test(name, found, [(node, _AXES[abs(k)]) for node, k in places], shapes)


def modes_of_responses(hertz: NDArray, responses: NDArray) -> tuple[NDArray, NDArray]:
    """Natural frequencies and shapes of lightly damped modes apart from each other.

    Args:
        hertz: [Hz] (n,) ascending.
        responses: (k, n) complex, of k places to one force.

    Returns:
        [Hz] (m,) and (m, k).

    Raises:
        SceneError: no peak, or too few points on one.
    """
    size = np.sqrt(np.sum(np.abs(responses) ** 2, axis=0))
    bends = np.sqrt(np.sum(np.abs(np.diff(responses, 2, axis=1)) ** 2, axis=0))
    noise = float(np.median(bends)) / np.sqrt(6)
    peaks, _ = find_peaks(size, height=max(_HEIGHT * size.max(), _NOISE * noise))
    stands = peak_prominences(size, peaks)[0] > _STANDS_OUT * size[peaks]
    peaks = peaks[stands]
    if not peaks.size:
        raise SceneError("", "has responses without a peak")
    out, shapes = [], []
    for peak in peaks:
        first = last = peak
        while first > 0 and _NEAR * size[peak] < size[first - 1]:
            first -= 1
        while last < hertz.size - 1 and _NEAR * size[peak] < size[last + 1]:
            last += 1
        if last - first + 1 < _LEAST:
            first, last = max(peak - 2, 0), min(peak + 2, hertz.size - 1)
        if last - first + 1 < _LEAST:
            bound = f"has {last - first + 1} points on the peak at {hertz[peak]:.4g} Hz, where"
            raise SceneError("", f"{bound} {_LEAST} are the least")
        frequency, shape = _one_mode(hertz[first : last + 1], responses[:, first : last + 1])
        out.append(frequency)
        shapes.append(shape)
    return np.array(out), np.stack(shapes)


def _one_mode(hertz: NDArray, responses: NDArray) -> tuple[float, NDArray]:
    """Frequency [Hz] and shape (k,) that the responses near a peak share."""
    count, scale = responses.shape[0], hertz.mean()
    s = 1j * hertz / scale
    rows, right = [], []
    for k, one in enumerate(responses / np.abs(responses).max()):
        block = np.zeros((hertz.size, 2 + 2 * count), complex)
        block[:, 0], block[:, 1] = one, s * one
        block[:, 2 + 2 * k], block[:, 3 + 2 * k] = -1.0, -s
        rows.append(block)
        right.append(-(s**2) * one)
    matrix, wanted = np.concatenate(rows), np.concatenate(right)
    # the first two real, the others complex
    whole = np.concatenate([matrix[:, :2], matrix[:, 2:], 1j * matrix[:, 2:]], axis=1)
    both = np.concatenate([np.real(whole), np.imag(whole)])
    found, *_ = np.linalg.lstsq(
        both, np.concatenate([np.real(wanted), np.imag(wanted)]), rcond=None
    )
    d0, d1 = found[:2]
    if not d0 > d1**2 / 4:
        raise SceneError("", f"has a peak at {scale:.4g} Hz that is no mode with little damping")
    pole = -d1 / 2 + 1j * np.sqrt(d0 - d1**2 / 4)
    n = found[2 : 2 + 2 * count] + 1j * found[2 + 2 * count :]
    residue = n[::2] + n[1::2] * pole
    largest = residue[np.argmax(np.abs(residue))]
    return float(scale * np.sqrt(d0)), np.real(residue / largest)
