r"""Response of the rotor by number of speeds and solver.

Block elimination along the shaft and a dense solver of the library, each for many speeds in one call,
beside NumPy on the full matrices, one speed after the other; the reference is that of NumPy with
refinement in extended precision.
"""

from functools import cache, partial

import jax.numpy as jnp
import numpy as np

from ..coupling import loaded_rotor
from ..rotor import load_vector, matrices, respond
from ._measure import Program
from ._report import Reference
from ._study import Call, Question, Setting, Study

_LOWEST = 0.2  # [-] first of the speeds, over the highest of the balancing planes'
_COUNTS = (1, 10, 100, 1000)
_COMPARED = 10  # speeds at which errors are taken, the same of every number of them


def response_study(question: Question, thorough: bool) -> Study:
    """Solvers of the response by number of speeds; the error is that of all displacements."""
    made = question.assembly
    assert made.balancing is not None
    compared = np.linspace(_LOWEST, 1.0, _COMPARED) * float(jnp.max(made.balancing.speeds))
    model, loads = loaded_rotor(made, jnp.asarray(compared)), made.given_loads or made.unbalances

    def by_numpy(refined: bool):
        return np.stack([_direct(model, loads, speed, refined) for speed in compared])

    def solve(solver, model, loads, speeds):
        return respond(model, loads, speeds, solver=solver).displacement[0]

    def prepare(solver, count):
        # the same speeds again and again, so that their number alone is what differs
        speeds = jnp.asarray(np.resize(compared, count))
        program = Program(partial(solve, solver), model, loads, speeds)
        run = program.on(model, loads, speeds)
        return Call(lambda: run()[:_COMPARED] if count > _COMPARED else run(), program)

    def reference(count):
        value, other = exact()[:count], np.asarray(prepare("dense", _COMPARED).run())[:count]
        return Reference(value, other, ("NumPy in extended precision", "the dense solver"))

    exact = cache(lambda: by_numpy(True))
    single, whole = (cache(partial(reference, count)) for count in (1, _COMPARED))
    settings = [
        Setting(solver, f"{count} speeds", partial(prepare, solver, count), share=count,
                reference=single if count == 1 else whole)
        for solver in ("structured", "dense")
        for count in (_COUNTS if thorough else _COUNTS[:3])
        if solver == "structured" or count <= 100
    ]  # fmt: skip
    settings.append(
        Setting("NumPy", f"{_COMPARED} speeds", lambda: Call(partial(by_numpy, False)),
                share=_COMPARED, reference=whole)
    )  # fmt: skip
    note = "response at many speeds in one call, times are of one speed"
    return Study(whole, tuple(settings), note)


def _direct(model, loads, speed: float, refined: bool):
    """[m], [rad] (nodes, dof) displacement at one speed by the full matrices."""
    force = np.asarray(load_vector(model, loads, 1, jnp.asarray(speed)))
    m, c, g, k, expand = (np.asarray(a) for a in matrices(model, speed))
    z = k - speed**2 * m + 1j * speed * (c + speed * g)
    f = expand.T @ force.reshape(-1)
    x = np.linalg.solve(z, f)
    for _ in range(2 * refined):
        rest = f.astype(np.clongdouble) - z.astype(np.clongdouble) @ x.astype(np.clongdouble)
        x = x + np.linalg.solve(z, rest.astype(complex))
    return (expand @ x).reshape(force.shape)
