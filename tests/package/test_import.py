"""Importing the package starts, prints and replaces nothing, in a process of its own."""

import os
import subprocess
import sys


def test_import_is_quiet():
    code = """
import sys, threading
import jaxcomp
assert not {"jax", "numpy", "matplotlib"} & {*sys.modules}, "JAX starts with the import"
from jax._src import compiler, monitoring, xla_bridge
def listeners():
    lists = {name: value for name, value in vars(monitoring).items() if name.endswith("_listeners")}
    return {name: len(value) for name, value in lists.items() if isinstance(value, list)}
before = listeners()
assert len(before) >= 2, "JAX has other names for its listeners"
for module in (jaxcomp, jaxcomp.study, jaxcomp.vibration, jaxcomp.crank):
    for name in module.__all__:
        getattr(module, name)
assert "typer" not in sys.modules
import jaxcomp.plot
assert "matplotlib.figure" in sys.modules, "pictures are drawn by something else"
assert "matplotlib.pyplot" not in sys.modules, "pictures need pyplot, which has a state of its own"
compile_one = compiler.compile_or_get_cached
assert type(compile_one) is type(listeners), "a function of JAX is replaced"
assert compile_one.__module__ == "jax._src.compiler", "a function of JAX is replaced"
assert listeners() == before, "somebody listens to JAX"
assert not xla_bridge.backends_are_initialized(), "JAX has run something"
assert threading.active_count() == 1
from jaxcomp._core import progress
assert not progress._Compiles.announced, "compiling is told unasked"
"""
    environment = {key: value for key, value in os.environ.items() if key != "JAXCOMP_WAITS"}
    done = subprocess.run([sys.executable, "-c", code], env=environment,
                          capture_output=True, text=True, timeout=120)  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_machine_without_rotor_imports_none():
    """What is marched, searched or turns in films is imported by who asks for it."""
    code = """
import sys
from jaxcomp import solve_orbit
from jaxcomp.cli._arguments import changed_scene
from jaxcomp.cli._options import solver_of
scene = changed_scene("mayekawa-wbhe")
solver_of("collocation", scene.as_compressor())
unused = {"diffrax", "optimistix", "scipy", "matplotlib", "xarray", "pandas", "jaxcomp.rotor"}
unused |= {"jaxcomp.vibration", "jaxcomp.balancing", "jaxcomp.study", "jaxcomp.plot"}
print(*sorted(unused & {*sys.modules}))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "\n", "")
