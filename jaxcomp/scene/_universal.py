r"""Modal tests in universal files: normal modes (data set 55), or frequency responses (data set 58).

Of responses every peak of their sum of squares is a mode. Near it all of them share the poles of one,

$$H_k(\omega)\,(d_0 + d_1 s + s^2) = n_{0k} + n_{1k}s, \qquad s = i\omega,$$

with real d and complex n, which is linear in both: $\sqrt{d_0}$ is the natural frequency, and the residue
at the pole, turned to be real, the shape. The slope of the right side stands for all other modes, and for
velocities or accelerations in the place of displacements. Modes whose peaks touch are none of its kind.
"""

import contextlib
import io
import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks, peak_prominences

from .._core.files import regular
from ..study import ModalTest
from ._text import SceneError

_AXES = {1: "ux", 2: "uy", 3: "uz"}
# data sets
_SHAPES = 55
_FUNCTIONS = 58
# Kinds of analysis in data set 55: normal modes have a frequency, complex ones an eigenvalue.
_NORMAL = (2,)
_COMPLEX = (3, 7)
_RESPONSE = 4  # function type of data set 58
# Other functions that analysers write beside responses, for notes.
_FUNCTION_NAMES = {
    0: "of unknown kind", 1: "time signals", 2: "auto spectra", 3: "cross spectra",
    6: "coherences", 9: "power spectra", 10: "energy spectra", 12: "spectra",
}  # fmt: skip
# Kinds of data (data set 58): motions by how often they are differentiated, and forces; all others say
# nothing of the motion. Peaks of a response are modes where motion is over force; over motion, or of
# force, they are none of the whole machine.
_MOTIONS = {8: 0, 11: 1, 12: 2}
_FORCES = (9, 13)
# [Hz] Of abscissae by their label, where that is no blank.
_HERTZ = {"hz": 1.0, "1/s": 1.0, "cps": 1.0, "khz": 1e3, "rad/s": 1 / (2 * np.pi), "rpm": 1 / 60,
          "1/min": 1 / 60, "cpm": 1 / 60}  # fmt: skip
_DELIMITER = re.compile(rb"^ {4}-1\s*$", re.MULTILINE)
_LARGEST = 200_000_000  # bytes
# A peak stands above its surroundings by this share of itself, above this share of the highest, and above
# so many times the noise, which is what the second differences of the responses show.
_STANDS_OUT = 0.5
_HEIGHT = 1e-3
_NOISE = 8.0
# Points of a peak are those above this share of its amplitude; so many are needed.
_NEAR = 0.5
_LEAST = 4

DataSet = Mapping[str, Any]


def read_universal(path, name: str) -> ModalTest:
    """The modal test of a universal file, of a rotor that hangs free.

    Args:
        path: of the file.
        name: of the source.

    Raises:
        SceneError: no pyuff, or a file that it cannot read, that is cut, without modes and responses, of
            several runs, or with responses that do not belong together.
    """
    sets, other_types = _data_sets(path)
    modes = [data for data in sets if _is_mode(data)]
    functions = [data for data in sets if data["type"] == _FUNCTIONS]
    if modes:
        return _test_of_modes(modes, name, _beside_modes(sets, len(functions), name))
    if functions:
        return _test_of_responses(functions, name)
    numbers = sorted({int(data["type"]) for data in sets} | other_types)
    listed = ", ".join(map(str, numbers)) or "nothing"
    bound = (
        "has no normal modes (data set 55 of analysis type 2, 3 or 7) and no responses (58), but"
    )
    raise SceneError("", f"{bound} {listed}")


def _data_sets(path) -> tuple[list[DataSet], set[int]]:
    """Data sets of shapes and functions, and the numbers of the other ones, which are not read.

    Groups, meshes and headers of other programs are left to these: pyuff prints while it reads some.
    """
    try:
        import pyuff
    except ImportError:
        raise SceneError("", 'needs pyuff: pip install "jaxcomp[modal]"') from None
    with open(regular(path), "rb") as file:
        content = file.read(_LARGEST + 1)
    if len(content) > _LARGEST:
        raise SceneError("", f"is larger than {_LARGEST / 1e6:.0f} MB")
    if len(_DELIMITER.findall(content)) % 2:
        raise SceneError("", "ends within a data set: the file is cut; copy it as a whole")
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            file = pyuff.UFF(str(path))
            types = np.asarray(file.get_set_types(), int)
            places = np.flatnonzero(np.isin(types, (_SHAPES, _FUNCTIONS))).tolist()
            sets = []
            if places:
                sets = file.read_sets(places)
    except Exception as error:  # pyuff has no class of its own for what it cannot read
        raise SceneError("", f"cannot be read as a universal file ({error})") from None
    if not isinstance(sets, list):  # pyuff gives a single one as it is
        sets = [sets]
    for number, data in zip(places, sets, strict=True):
        _check_complete(data, number + 1)
    return sets, set(types.tolist()) - {_SHAPES, _FUNCTIONS}


def _beside_modes(sets: Sequence[DataSet], functions: int, name: str) -> list[str]:
    """Notes on what stands beside modes and is not read."""
    notes = []
    if functions:
        notes.append(f"{name}: {functions} functions (data set 58) beside modes are not read")
    analysis_types = []
    for data in sets:
        if data["type"] == _SHAPES and not _is_mode(data):
            analysis_types.append(int(data["analysis_type"]))
    if analysis_types:
        listed = ", ".join(map(str, sorted(set(analysis_types))))
        count = len(analysis_types)
        notes.append(f"{name}: {count} shapes of analysis type {listed} are not read")
    return notes


def _check_complete(data: DataSet, number: int) -> None:
    """Refuse a data set with less, or other, numbers than it announces.

    Raises:
        SceneError: it has.
    """
    where = f"data set {number}"
    if data["type"] == _SHAPES:
        values = []
        for k in _AXES:
            if f"r{k}" in data:
                values.append(data[f"r{k}"])
        count = np.size(data["node_nums"])
        if not count or not _have_size(values, count):
            raise SceneError(where, "must have three or six values for each of its nodes")
    else:
        values = [data["x"], data["data"]]
        count = data["num_pts"]
        if not _have_size(values, count):
            raise SceneError(
                where, f"must have {count} points, as its head says", np.size(values[1])
            )
    for column in values:
        if not np.isfinite(column).all():
            raise SceneError(where, "has numbers that are not finite")


def _have_size(columns: Sequence[NDArray], size: int) -> bool:
    return all(np.size(column) == size for column in columns)


def _is_mode(data: DataSet) -> bool:
    return data["type"] == _SHAPES and data["analysis_type"] in (*_NORMAL, *_COMPLEX)


def _hertz(mode: DataSet) -> float:
    """[Hz] Natural frequency, of a complex mode that without damping."""
    if mode["analysis_type"] in _NORMAL:
        return float(mode["freq"])
    return float(np.abs(mode["eig"]) / (2 * np.pi))


def _refuse_several_runs(modes: Sequence[DataSet]) -> None:
    """Refuse modes of more than one run, which would count as modes of their own.

    A run numbers its modes, unless its program leaves one number to all of them; then runs are told apart
    by their load cases alone.

    Raises:
        SceneError: a number is there twice.
    """
    numbers = []
    cases = set()
    for mode in modes:
        numbers.append(int(mode.get("mode_n", 0)))
        cases.add(int(mode.get("load_case", 0)))
    if len(set(numbers)) == 1 and len(cases) == 1:
        return
    number, count = Counter(numbers).most_common(1)[0]
    if count > 1:
        hertz = []
        for mode_number, mode in zip(numbers, modes, strict=True):
            if mode_number == number:
                hertz.append(f"{_hertz(mode):.6g}")
        problem = (
            f"has mode {number} {count} times, at {', '.join(hertz)} Hz: it holds several runs;"
        )
        raise SceneError("", f"{problem} keep those of one run, or give each a file of its own")


def _test_of_modes(modes: Sequence[DataSet], name: str, skipped: Sequence[str] = ()) -> ModalTest:
    _refuse_several_runs(modes)
    modes = sorted(modes, key=_hertz)
    numbers = np.concatenate([mode["node_nums"] for mode in modes])
    nodes = np.unique(numbers.astype(int)).tolist()
    pairs = list(itertools.product(nodes, _AXES.values()))
    places = {pair: n for n, pair in enumerate(pairs)}
    shape = np.full((len(modes), len(pairs)), np.nan, complex)
    for row, mode in enumerate(modes):
        for k, axis in _AXES.items():
            for node, value in zip(mode["node_nums"], mode.get(f"r{k}", ()), strict=False):
                shape[row, places[int(node), axis]] = value
    # Files have three values for each node. An axis with zeros alone is one that nobody measured.
    size = np.nan_to_num(np.abs(shape)).max(axis=0)
    moves = (size.reshape(-1, len(_AXES)) > 0).any(axis=0)
    measured = np.tile(moves, len(nodes))
    pairs = list(itertools.compress(pairs, measured))
    hertz = np.array([_hertz(mode) for mode in modes])
    return _test(name, hertz, pairs, _real_shapes(shape[:, measured]), skipped)


def _real_shapes(shapes: NDArray) -> NDArray:
    """Shapes turned so that their largest component is real, of which the real part is taken."""
    if not shapes.size:
        return np.real(shapes)
    rows = np.arange(len(shapes))
    largest = shapes[rows, np.nan_to_num(np.abs(shapes)).argmax(axis=1)]
    turn = np.where(np.abs(largest) > 0, np.abs(largest) / np.where(largest == 0, 1, largest), 1)
    # signs of real shapes stay as they are
    turn = np.where(np.imag(largest) == 0, 1, turn)
    return np.real(shapes * turn[:, None])


def _test(name: str, hertz: NDArray, pairs, shape: NDArray, skipped: Sequence[str] = ()):
    if not (hertz > 0).all():
        raise SceneError("frequency", "must be above 0", float(hertz.min()))
    nodes = []
    axes = []
    for node, axis in pairs:
        nodes.append(node)
        axes.append(axis)
    return ModalTest(
        source=name,
        frequency=2 * np.pi * hertz,
        modes=tuple(range(1, hertz.size + 1)),
        free=True,
        nodes=tuple(nodes),
        axes=tuple(axes),
        shape=shape,
        skipped=tuple(skipped),
    )


def _test_of_responses(functions: Sequence[DataSet], name: str) -> ModalTest:
    responses = []
    other_kinds = Counter()
    for data in functions:
        if data["func_type"] == _RESPONSE:
            responses.append(data)
        else:
            other_kinds[int(data["func_type"])] += 1
    if not responses:
        listed = ", ".join(map(str, sorted(other_kinds)))
        raise SceneError("", f"has functions of type {listed}, where 4, a response, is read alone")
    places = _roving_places(responses)
    hertz = _common_frequencies(responses)
    signs = []
    pairs = []
    for node, direction in places:
        # against the axis counts as negative along it
        signs.append(np.sign(direction))
        pairs.append((node, _AXES[abs(direction)]))
    values = np.stack([np.asarray(data["data"], complex) for data in responses])
    values = values * np.array(signs)[:, None]
    values = values / (2j * np.pi * hertz) ** _differentiations(responses)[:, None]
    frequencies, shapes = modes_of_responses(hertz, values)
    skipped = []
    for kind, count in sorted(other_kinds.items()):
        kind_name = _FUNCTION_NAMES.get(kind, "functions")
        skipped.append(f"{name}: {count} {kind_name} (type {kind}) are not read")
    return _test(name, frequencies, pairs, shapes, skipped)


def _differentiations(responses: Sequence[DataSet]) -> NDArray:
    """(k, 1) How often the motion of each response is differentiated, less those of the first.

    All alike, as is usual, they are left as they are, for the slope of the fit takes them.

    Raises:
        SceneError: a response that is not of motion over force.
    """
    stated = []
    for data in responses:
        over = int(data.get("ordinate_spec_data_type", 0))
        under = int(data.get("orddenom_spec_data_type", 0))
        node = int(data["rsp_node"])
        if over in _FORCES or under in _MOTIONS:
            kinds = f"of data type {over} over {under} at node {node}"
            problem = (
                f"has a response {kinds}; modes are those of motion (8, 11, 12) over force (13)"
            )
            raise SceneError("", problem)
        if over in _MOTIONS:
            stated.append(_MOTIONS[over])
    if len(set(stated)) < 2:
        return np.zeros(len(responses))
    if len(stated) < len(responses):
        raise SceneError(
            "", "has responses of several kinds of motion, and such that do not say theirs"
        )
    return np.array(stated, float)


def _roving_places(responses: Sequence[DataSet]) -> list[tuple[int, int]]:
    """Node and direction of every response: of a hammer that roves, or of sensors that do.

    Raises:
        SceneError: both rove, a place that is there twice, or a direction other than along an axis.
    """
    sensors = []
    hammers = []
    for data in responses:
        sensors.append((int(data["rsp_node"]), int(data["rsp_dir"])))
        hammers.append((int(data["ref_node"]), int(data["ref_dir"])))
    sensors_rove = len(set(sensors)) > 1
    hammer_roves = len(set(hammers)) > 1
    if sensors_rove and hammer_roves:
        bound = "must have the same response or the same reference in all functions"
        raise SceneError("", bound)
    # a response from a to b is that from b to a, by reciprocity
    places = hammers if hammer_roves else sensors
    for (node, direction), count in Counter(places).items():
        if count > 1:
            problem = f"has node {node}, direction {direction} twice: it holds several runs;"
            raise SceneError("", f"{problem} keep those of one run, or the means of all runs")
    for _, direction in places:
        if abs(direction) not in _AXES:
            raise SceneError("", f"has direction {direction}, where 1, 2 and 3 are read")
    return places


def _common_frequencies(responses: Sequence[DataSet]) -> NDArray:
    """[Hz] (n,) that all responses have.

    Raises:
        SceneError: they have others, or such that do not rise.
    """
    hertz = np.asarray(responses[0]["x"], float)
    labels = {_abscissa_label(data) for data in responses}
    if len(labels) > 1:
        raise SceneError(
            "", f"must have frequencies of one unit, not of {', '.join(sorted(labels))}"
        )
    if hertz.size < _LEAST or not (np.diff(hertz) > 0).all():
        raise SceneError("", f"must have {_LEAST} rising frequencies at least")
    for data in responses:
        if np.shape(data["x"]) != hertz.shape or not np.allclose(data["x"], hertz, rtol=1e-9):
            raise SceneError("", "must have the same frequencies in all functions")
    return hertz * _HERTZ[labels.pop()]


def _abscissa_label(data: DataSet) -> str:
    """Unit of the frequencies of a function, Hz where it says none.

    Raises:
        SceneError: it is no unit of a frequency.
    """
    label = str(data.get("abscissa_axis_units_lab") or "").strip()
    unit = label.lower()
    if unit in ("", "none"):
        return "hz"
    if unit not in _HERTZ:
        readable = "Hz, kHz, rad/s or rpm"
        raise SceneError("", f'has frequencies in "{label}", where {readable} are read')
    return unit


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
    # the second difference of white noise has 1 + 4 + 1 times its variance; the median passes over peaks
    noise = float(np.median(bends)) / np.sqrt(6)
    peaks, _ = find_peaks(size, height=max(_HEIGHT * size.max(), _NOISE * noise))
    # a maximum on the flank of a peak, of noise or of a mode close by, does not stand out
    stands = peak_prominences(size, peaks)[0] > _STANDS_OUT * size[peaks]
    peaks = peaks[stands]
    if not peaks.size:
        raise SceneError("", "has responses without a peak")
    out = []
    shapes = []
    for peak in peaks:
        lower = peak
        upper = peak  # the last point, not the one behind it
        while lower > 0 and _NEAR * size[peak] < size[lower - 1]:
            lower -= 1
        while upper < hertz.size - 1 and _NEAR * size[peak] < size[upper + 1]:
            upper += 1
        if upper - lower + 1 < _LEAST:
            lower = max(peak - 2, 0)
            upper = min(peak + 2, hertz.size - 1)
        if upper - lower + 1 < _LEAST:
            bound = f"has {upper - lower + 1} points on the peak at {hertz[peak]:.4g} Hz, where"
            raise SceneError("", f"{bound} {_LEAST} are the least")
        frequency, shape = _fitted_mode(hertz[lower : upper + 1], responses[:, lower : upper + 1])
        out.append(frequency)
        shapes.append(shape)
    return np.array(out), np.stack(shapes)


def _fitted_mode(hertz: NDArray, responses: NDArray) -> tuple[float, NDArray]:
    """Frequency [Hz] and shape (k,) that the responses near a peak share."""
    count = responses.shape[0]
    # s near i and responses near 1: in hertz and as measured the columns would differ by powers of ten
    scale = hertz.mean()
    s = 1j * hertz / scale
    rows = []
    right = []
    for k, response in enumerate(responses / np.abs(responses).max()):
        block = np.zeros((hertz.size, 2 + 2 * count), complex)
        block[:, 0] = response
        block[:, 1] = s * response
        block[:, 2 + 2 * k] = -1.0
        block[:, 3 + 2 * k] = -s
        rows.append(block)
        right.append(-(s**2) * response)
    matrix = np.concatenate(rows)
    right_side = np.concatenate(right)
    # the first two unknowns are real, so that real and imaginary parts are equations of their own
    unknowns = np.concatenate([matrix[:, :2], matrix[:, 2:], 1j * matrix[:, 2:]], axis=1)
    real_system = np.concatenate([np.real(unknowns), np.imag(unknowns)])
    coefficients, *_ = np.linalg.lstsq(
        real_system, np.concatenate([np.real(right_side), np.imag(right_side)]), rcond=None
    )
    d0, d1 = coefficients[:2]
    if not d0 > d1**2 / 4:
        raise SceneError("", f"has a peak at {scale:.4g} Hz that is no mode with little damping")
    # the one of two conjugate poles above the real axis, near s = i
    pole = -d1 / 2 + 1j * np.sqrt(d0 - d1**2 / 4)
    n = coefficients[2 : 2 + 2 * count] + 1j * coefficients[2 + 2 * count :]
    residue = n[::2] + n[1::2] * pole
    # a shape has any factor: this one makes its largest component 1, and the others nearly real
    largest = residue[np.argmax(np.abs(residue))]
    return float(scale * np.sqrt(d0)), np.real(residue / largest)
