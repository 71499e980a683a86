"""A block with several cylinders on its mounts: forces, response, balance, and the commands on them."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import read_json
from typer.testing import CliRunner

from jaxcomp import Collocation, load, solve_orbit
from jaxcomp.cli import app
from jaxcomp.compressor import first_top
from jaxcomp.rotor import Mount, matrices, node_index, respond
from jaxcomp.rotor._model import node_positions
from jaxcomp.rotor._nodes import node_names
from jaxcomp.scene import dump, loads, with_value
from jaxcomp.scene._change import with_lists
from jaxcomp.vibration import shaking_wrench
from jaxcomp.vibration._coupling import crank_forces

NAME = "refrigeration-twin-block"


def stiff(scene):
    """The rotor of the scene with shaft and bearings that do not give, without damping of its own."""
    model = scene.assembly.rotor
    seats = tuple(
        dataclasses.replace(link, law=Mount(jnp.full(size, 1e12), jnp.zeros(size)))
        for link, size in zip(model.links, (2, 2, 1), strict=False)
    )
    made = dataclasses.replace(model, links=(*seats, *model.links[3:]), damping=None)
    moduli = [1e5 * shaft.young_modulus for shaft in made.shafts]
    return eqx.tree_at(lambda m: [s.young_modulus for s in m.shafts], made, moduli)


@pytest.mark.slow  # ten seconds of compiling
def test_a_stiff_block_moves_as_the_rigid_body_under_the_shaking_forces():
    """Newton and Euler for one body on its mounts, against the rotor model with all forces inside."""
    scene = load(NAME)
    compressor, model, orders = scene.compressor, stiff(scene), (1, 2, 4)
    # the rotor's unbalances turn at the mean speed, so the crank does here: 1e-6 of its fluctuation
    heavy = 1e6 * compressor.crankshaft.inertia
    compressor = eqx.tree_at(lambda c: c.crankshaft.inertia, compressor, heavy)
    orbit = solve_orbit(compressor, Collocation(nodes=6, reversals=0))
    speed, case = orbit.mean_speed, scene.parts["loads"]
    inner = crank_forces(compressor, orbit, case.crank, orders).forces
    found = respond(model, (*case.loads, *inner), speed[None], orders).checked()

    made, names, places = matrices(model, speed), node_names(model), node_positions(model)
    shaft = {name for row in model.shafts for pair in row.pairs for name in pair}
    rigid = np.zeros((len(names), 6, 6))
    for own, name in zip(rigid, names, strict=True):
        x, y, z = places[name] - places[case.crank.pins[0]]
        own[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        own += np.eye(6)
        # the shaft spins by itself; what that takes of the moment is in the wrench
        own[5, 5] = name not in shaft
    moves = np.linalg.lstsq(np.asarray(made.expand), rigid.reshape(-1, 6))[0]
    mass, damping, gyroscopic, stiffness = (moves.T @ np.asarray(m) @ moves for m in made[:4])
    wrench = np.concatenate(shaking_wrench(compressor, orbit.state))
    share = np.asarray(orbit.weight / orbit.state.speed)
    phase = np.asarray(speed * orbit.time + first_top(compressor))
    for place, order in enumerate(orders):
        load_ = 2 * wrench @ (np.exp(-1j * order * phase) * share / share.sum())
        w = float(order * speed)
        dynamic = stiffness - w**2 * mass + 1j * w * (damping + float(speed) * gyroscopic)
        motion = np.linalg.solve(dynamic, load_)
        for node in ("mounts", "discharge-flange"):
            i = node_index(model, node)
            wanted = rigid[i] @ motion
            # the thrust bearing of 20 kN/mm and the massless webs give the rest
            error = np.abs(np.asarray(found.displacement[place, 0, i]) - wanted).max()
            # what is left of the fluctuation of the speed; 1.2e-6 seen
            assert error < 3e-6 * np.abs(wanted).max(), (order, node)


def command(*arguments):
    result = CliRunner().invoke(app, [*arguments, "--json"])
    assert result.exit_code == 0, result.output
    return read_json(result.stdout)


@pytest.mark.slow  # half a minute of compiling
def test_the_crank_shakes_the_block_where_the_scene_gives_no_forces():
    """By default; the unbalances alone on demand. Corrections by the crank's forces leave the least."""
    crank = command("respond", NAME)
    file = command("respond", NAME, "--excitation", "file")
    assert (crank["excitation"], file["excitation"]) == ("crank", "file")
    assert (crank["orders"], file["orders"]) == ([1, 2, 3, 4], [1])
    name = "mounts (mounts)"
    # the counterweights stand against the rods, whose inertia only the crank has
    before, without = (r["nodes"][name]["major_axis"][0][0] for r in (crank, file))
    assert before < without
    # corrections load the main bearings, whose friction moves the crank and the result by up to 4e-4
    sets = ["--set", "crankshaft.main_journal=none"]
    found = command("balance", NAME, *sets)
    assert found["excitation"] == "crank"
    for one in found["planes"]:
        plane, size, angle = one["name"], one["correction"], one["phase"]
        for axis, value in zip("xy", (size * np.cos(angle), size * np.sin(angle)), strict=True):
            sets += ["--set", f"corrections.{plane}.{axis}={value} kg m"]
    after = command("respond", NAME, "--orders", "1", *sets)
    rows = [row for row in found["rows"] if row["target"] == "mounts"]
    for row in rows:
        seen = after["nodes"][name]["amplitude"][row["axis"]][0][0]
        # the same linear equations: 4e-14 seen
        assert seen == pytest.approx(row["after"], rel=1e-11), row["axis"]


def test_a_number_of_one_cylinder_makes_a_list():
    scene = load("mayekawa-4wbhe")
    paths = ("mechanism.bore.2", "friction.*.coefficient.*", "mechanism.offset.0")
    made = with_lists(scene, (*paths, "crankshaft.throws.0.banks.1", "motor.mean_speed.*"))
    one = made.compressor
    assert one.mechanism.bore.shape == one.mechanism.offset.shape == (4,)
    assert one.friction.wall.coefficient.shape == (4,)
    assert one.crankshaft.main_journal.bearings[0].coefficient.shape == ()
    assert made.sources["mechanism.bore"] == scene.sources["mechanism.bore"]
    changed = with_value(scene, "mechanism.bore.2", "131 mm").compressor.mechanism.bore
    np.testing.assert_allclose(changed, (0.130, 0.130, 0.131, 0.130), rtol=1e-15)
    np.testing.assert_array_equal(loads(dump(made)).compressor.mechanism.bore, 0.13)
    assert with_lists(load("mayekawa-wbhe"), paths).compressor.mechanism.bore.shape == ()


@pytest.mark.slow  # two programs for two layouts
def test_layouts_are_swept_on_the_command_line(tmp_path):
    arguments = (
        "sweep", "refrigeration-twin", "--over", "crankshaft.layout=in-line-2,V90",
        "--over", "mechanism.bore.1=50mm:60mm", "--samples", "4", "--sampling", "latin-hypercube",
        "--quantity", "speed_fluctuation", "--accuracy", "coarse",
        "--out", str(tmp_path / "out"),
    )  # fmt: skip
    found = command(*arguments)
    assert len(found["layouts"]["V90"]["speed_fluctuation"]) == 4
    written = {path.name for path in (tmp_path / "out").iterdir()}
    wanted = {"machines-speed_fluctuation.png", "V90-samples-speed_fluctuation.png", "designs.csv"}
    assert wanted <= written
    assert {path.name for path in (tmp_path / "out" / "sweep.zarr").iterdir()} == {
        "in-line-2",
        "V90",
    }
    assert command(*arguments)["layouts"] == found["layouts"]  # read from the stores
    table = (tmp_path / "out" / "designs.csv").read_text().splitlines()
    assert len(table) == 1 + 2 * 4


@pytest.mark.slow  # a machine of its own to compile
def test_run_tells_the_reversal_of_the_rod_loads_and_the_crank_ends(tmp_path):
    found = command("run", "two-stage-crosshead", "--out", str(tmp_path / "out"))
    reversal = found["rod_load_reversal"]
    assert set(reversal) == {"piston_pin_1", "piston_pin_2"}
    for rod in reversal.values():
        assert np.rad2deg(rod["angle"]) > 15
        assert rod["share"] > 0.03
    assert not any("reversed" in remark for remark in found["remarks"])
    curves = np.genfromtxt(
        tmp_path / "out" / "curves.csv", delimiter=",", names=True, deletechars=""
    )
    low, high = (curves[f"crank_end_pressure.{k}_[Pa]"] for k in (1, 2))
    # the pressure between the stages: what one delivers the other one draws
    assert low.max() == pytest.approx(high.min(), rel=1e-9)
    assert low.min() == pytest.approx(1e5, rel=1e-9)
    # slow and without gas on the rod's side, the load presses one way for the whole revolution
    sets = (
        "gas.rod_diameter=none",
        "motor.mean_speed=200rpm",
        "crankshaft.inertia=200 kg m^2",
    )
    slow = command("run", "two-stage-crosshead", *(word for one in sets for word in ("--set", one)))
    assert any("may run dry" in remark for remark in slow["remarks"])
