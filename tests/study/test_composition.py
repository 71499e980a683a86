"""The composition of a mixture in studies."""

import pytest

from jaxcomp import load
from jaxcomp._core.errors import BadInput
from jaxcomp.scene import with_values
from jaxcomp.study._variables import variable, variable_names


def test_studies_do_not_move_a_composition_whose_lines_are_solved():
    """Beside the composition that was solved lines are of first order: a move would be silently wrong."""
    design = with_values(load("r290-6cc"), {"gas.fluid.name": "R454C"}).machine
    assert not [name for name in variable_names(design) if "fractions" in name]
    assert "gas.clearance_ratio" in variable_names(design)
    for name in ("gas.fluid.mass_fractions.0", "gas.fluid.mass_fractions"):
        with pytest.raises(BadInput, match="a composition is one of the machine"):
            variable(design, name, 0.1, 0.3)
