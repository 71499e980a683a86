"""The table of pressures in pipes of `jaxcomp run`, from numbers as the command has them."""

import io

from rich.console import Console


def test_pressures_of_nodes_with_the_drop_of_flanges():
    from jaxcomp.cli import _run_tables

    names = ["peak_to_peak", "mean", *(f"order_{order}" for order in range(1, 9))]
    pulsation = {}
    for node, size in (("flange", 5000.0), ("tee", 700.0)):
        pulsation |= {f"{node}.{name}": size / (1 + i) for i, name in enumerate(names)}
    result = {"pulsation": pulsation, "pressure_drop": {"flange": 12.5}, "pulsation_margin": 1.25}
    shown = io.StringIO()
    Console(file=shown, width=160).print(_run_tables._pipes(result))
    text = shown.getvalue()
    assert "flange" in text
    assert "5000" in text
    assert "12.5" in text
    assert "1.25" in text
