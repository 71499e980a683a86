"""Shapes that the annotations promise, held while other tests run."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
QUICK = "laws/test_motor.py::test_slip_line_vanishes_at_the_synchronous_speed"
FILES = (
    "laws/test_gas.py", "laws/test_motor.py", "crank/test_orbit.py", "mechanism/test_slider_crank.py",
    "film/test_film.py", "rotor/test_rotor_response.py", "vibration/test_shaking.py",
)  # fmt: skip
# These give lists, tuples or whole numbers where the annotations say arrays, or wrong shapes on purpose.
LENIENT = (
    "refuse", "bad_calls", "mineral_oils", "needs_a_model", "softly_hung", "another_point",
    "do_not_depend_on_the_mass_centre", "rebuild_the_wrench", "falls_with_the_square",
    "gradient_of_the_vibration",
)  # fmt: skip


# a file of tests, with a check at every call; all seven take three minutes
@pytest.mark.parametrize(
    "file", [QUICK, *(pytest.param(one, marks=pytest.mark.slow) for one in FILES)]
)
def test_calls_keep_the_shapes_of_their_annotations(file):
    """Every call of the library in its tests, against its annotations."""
    pytest.importorskip("beartype")
    left_out = " and ".join(f"not {word}" for word in LENIENT)
    run = [sys.executable, "-m", "pytest", "-q", "-p", "shape_checks", "-k", left_out]
    paths = [str(TESTS), str(TESTS.parent), os.environ.get("PYTHONPATH", "")]
    # plugins that are installed beside pytest take two seconds to import, and none is needed
    more = {"PYTHONPATH": os.pathsep.join(paths), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(
        [*run, str(TESTS / file)],
        env=os.environ | more,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:]
