"""Machine files with mixtures: what follows from them, and what is refused."""

import numpy as np
import pytest
from typer.testing import CliRunner

from jaxcomp import BadInput, load
from jaxcomp.cli._app import app
from jaxcomp.fluid import Mixture
from jaxcomp.scene import SceneError, start, with_values
from jaxcomp.scene.follows import follows
from jaxcomp.study._steady_state import _remarks_on_range, crank_quantities

# Blends of R32, and pure gases that a process compressor moves.
BLEND = "R454C"


def process_machine(**fractions):
    """Between 3 and 8 MPa from 303.15 K, on the reference equations."""
    fluid = {"type": "mixture", "model": "reference equations", "mole_fractions": fractions}
    suction = {"pressure": "3 MPa", "temperature": "303.15 K"}
    discharge = {"pressure": "8 MPa"}
    values = {"gas.fluid": fluid, "gas.suction": suction, "gas.discharge": discharge}
    return with_values(load("r290-6cc"), values)


def test_compressibility_and_head_of_a_process_gas():
    """Hydrogen and methane, of the golden table: density, and work of isentropic compression."""
    found = {name: value for name, value, _ in follows(process_machine(hydrogen=0.2, methane=0.8))}
    # printed there with nine digits
    np.testing.assert_allclose(found["Isentropic head"], 206.979681, rtol=1e-8)
    gas = Mixture(mole_fractions={"hydrogen": 0.2, "methane": 0.8}, model="reference equations")
    expected = 3e6 / (16.1758215 * float(gas.specific_gas_constant) * 303.15)
    np.testing.assert_allclose(found["Compressibility at the suction valve"], expected, rtol=1e-8)
    assert not any("Glide" in name for name in found)


def quantities_of(values) -> set[str]:
    machine = with_values(load("r290-6cc"), values).machine
    return {quantity.name for quantity in crank_quantities(machine)}


def test_gas_that_no_machine_condenses_has_no_capacity():
    """Methane of 30 degC between two pressures is compressed; at -110 degC it may be a refrigerant."""
    lines = {"gas.suction": {"pressure": "2 bar", "temperature": "30 degC"}}
    lines |= {"gas.discharge": {"pressure": "5 bar"}}
    methane = {"gas.fluid": {"type": "real_gas", "name": "methane"}}
    natural_gas = {"type": "mixture", "mole_fractions": {"methane": 0.9, "hydrogen": 0.1}}
    for fluid in (methane, {"gas.fluid": natural_gas}):
        names = quantities_of(fluid | lines)
        assert "mass_flow" in names
        assert not names & {"capacity", "cop"}
    cold = {"gas.suction": {"pressure": "2 bar", "temperature": "-110 degC"}}
    assert {"capacity", "cop"} <= quantities_of(methane | lines | cold)
    assert {"capacity", "cop"} <= quantities_of({"gas.fluid.name": "R454C"})
    carbon_dioxide = {"gas.fluid": {"type": "real_gas", "name": "R744"}}
    pressures = {"gas.suction": {"pressure": "20 bar", "temperature": "40 degC"}}
    pressures |= {"gas.discharge": {"pressure": "60 bar"}}
    assert {"capacity", "cop"} <= quantities_of(carbon_dioxide | pressures)


def test_dew_points_of_a_gas_that_has_none_are_refused():
    fluid = {"type": "mixture", "mole_fractions": {"methane": 0.9, "hydrogen": 0.1}}
    with pytest.raises(SceneError, match=r"suction\.evaporating.*has no dew line; give pressures"):
        with_values(load("r290-6cc"), {"gas.fluid": fluid})


def test_a_name_of_a_blend_is_for_its_composition():
    with pytest.raises(BadInput, match="R448A has another composition"):
        Mixture(name="R448A", mass_fractions={"R125": 0.44, "R143a": 0.52, "R134a": 0.04})
    with pytest.raises(BadInput, match="R448A has another composition"):
        Mixture(name="r448a", mass_fractions={"R32": 0.215, "R1234yf": 0.785})
    with pytest.raises(BadInput, match="R22 is a pure fluid"):
        Mixture(name="R22", mass_fractions={"R32": 0.215, "R1234yf": 0.785})
    # within what a charge may differ by
    assert Mixture(name=BLEND, mass_fractions={"R32": 0.22, "R1234yf": 0.78}).name == BLEND


def test_states_beyond_a_range_name_the_component():
    fluid = Mixture(name=BLEND)
    with pytest.raises(BadInput, match="the range of R1234yf in R454C"):
        fluid.density(600.0, 1e5)
    with pytest.raises(BadInput, match="the dew temperature at that pressure is 270"):
        fluid.density(265.0, 4e5)


def test_condensing_above_the_lines_is_answered_with_their_end():
    with pytest.raises(SceneError, match=r"the end of the dew line of R454C.*give pressures"):
        with_values(
            load("r290-6cc"), {"gas.fluid.name": BLEND, "gas.discharge.condensing": "90 degC"}
        )


def test_gas_beyond_the_range_of_a_component_gets_a_remark():
    class Case:
        cylinder = with_values(load("r290-6cc"), {"gas.fluid.name": BLEND}).machine.compressor.gas

    class Hot:
        case = Case
        temperature = np.array([300.0, 431.0])
        pressure = np.array([1e5, 4e5])

    (remark,) = _remarks_on_range(Hot)
    assert "158 °C, beyond 137 °C" in remark
    assert "R1234yf" in remark
    Hot.temperature = np.array([300.0, 409.0])
    assert not list(_remarks_on_range(Hot))
    Hot.pressure = np.array([1e5, 8e7])
    (remark,) = _remarks_on_range(Hot)
    assert "800 bar, beyond 700 bar" in remark


def test_a_template_with_a_blend_is_valid(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(start("blend", "machine"))
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 0, result.output
    assert "valid; for jaxcomp run" in result.output
    gas = load(str(path)).machine.compressor.gas
    np.testing.assert_allclose(gas.fluid.mass_fractions, [0.215, 0.785], rtol=1e-14)
