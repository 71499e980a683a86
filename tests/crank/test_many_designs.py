"""Every one of many ordinary designs converges: none hops between two sides of a kink."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxcomp import load, problem
from jaxcomp._core.status import names_of_codes

RPM = np.pi / 30
# Ranges well within those of such machines, so that nothing stalls or locks.
RANGES = {
    "bore_at_displacement": (0.10, 0.16),
    "motor.mean_speed": (500 * RPM, 1500 * RPM),
    "gas.suction_pressure": (0.06e6, 0.2e6),
    "gas.discharge_pressure": (0.6e6, 1.4e6),
    "friction.wall.coefficient": (0.03, 0.1),
    "friction.crank_pin.coefficient": (0.005, 0.02),
    "friction.piston_pin.coefficient": (0.005, 0.02),
}
# The load of the wall reverses a few ten-thousandths of a radian before the end of the re-expansion,
# where its slope is twenty times that behind it: two at the file's values, the others from samples.
BEFORE_A_KINK = [
    (0.1100502512563, 644.2211055276 * RPM, 98e3, 980e3,
     0.083, 0.013, 0.013),
    (0.121608040201, 1174.874371859 * RPM, 98e3, 980e3,
     0.083, 0.013, 0.013),
    (0.1560829962511, 55.80109063883, 108665.99339060485, 1146522.1170336008,
     0.05291148884688, 0.008412919815164, 0.01830060798908),
    (0.121230750503, 125.1274002489, 99826.88426040113, 947785.5104953051,
     0.05726930049714, 0.01390527005075, 0.01710354201728),
    (0.1511709346715, 152.6516694576, 180752.23536230624, 1027102.9274910688,
     0.0972824077541, 0.01560706986813, 0.00535039170878),
    (0.1441991525982, 120.8907500901, 151670.45704089105, 882495.3075498343,
     0.04184882378671, 0.01656063973671, 0.01799102064921),
    (0.1256891207863, 107.7317724162, 115620.52153982222, 1152405.8628827333,
     0.04175669324119, 0.01725121280877, 0.005214151625987),
    (0.1441969128978, 131.4446117199, 139318.7762517482, 1397691.3031190634,
     0.0514722664142, 0.005970283306669, 0.009442937907297),
    # the load of a pin, which friction turns round at the dead centre: its reversal ran into the jump
    (0.10931268750689924, 156.03422893308462, 67223.39610569179, 674434.2852383852,
     0.07804189761634917, 0.014688118111807851, 0.017329733010847122),
    # no kink: a slope of half the true one was taken from the first two iterations
    (0.14899610276333988, 81.09985719591273, 198190.27085788548, 1243909.4360917807,
     0.07282294700387865, 0.006467751872260123, 0.00552351692924276),
]  # fmt: skip
SAMPLES = 2000


def test_designs_whose_load_reverses_beside_a_kink_converge_as_all_others_do():
    rng = np.random.default_rng(1)
    low, high = np.array([*RANGES.values()]).T
    drawn = rng.uniform(low, high, (SAMPLES, low.size))
    beside = np.array(BEFORE_A_KINK)
    # the neighbours of each, a thousandth to both sides in the speed
    step = np.where(np.array([*RANGES]) == "motor.mean_speed", 1e-3, 0.0)
    rows = np.concatenate([beside, beside * (1 - step), beside * (1 + step), drawn])
    asked = problem(load("mayekawa-wbhe"), [*RANGES], ["mechanical_efficiency"])
    answers = jax.jit(lambda rows: jax.lax.map(asked, rows, batch_size=70))(jnp.asarray(rows))
    ended = names_of_codes(np.asarray(answers.status))
    assert [*ended[: 3 * len(beside)]] == ["converged"] * (3 * len(beside))
    assert {*ended} == {"converged"}
    # A line through the neighbours: the efficiency bends by 3e-8 over a thousandth of the speed. A
    # reversal that is at a kink in one of the three and beside it in the others leaves 5e-7.
    here, before, after = np.asarray(answers.values)[: 3 * len(beside), 0].reshape(3, -1)
    np.testing.assert_allclose(here, (before + after) / 2, atol=1e-6)
