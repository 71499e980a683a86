"""Generate the data of mixtures in `jaxcomp/fluid/data/mixtures` from published coefficients.

Run `python tests/tools/mixture_data.py` after `fluid_data.py`; it reads `mixture_sources`, whose README
says where each file comes from, and CoolProp for the registry numbers of the fluids. Terms of all models
are written in the families that `jaxcomp.fluid._helmholtz.residual_terms` sums.
"""

import json
import shutil
from pathlib import Path

import numpy as np
from fluid_data import DATA, FLUIDS, compact

from jaxcomp.fluid._blends import COEFFICIENT_UNIT, SLOPE_UNIT, usable_blends
from jaxcomp.fluid._blends import blends as blends_of_library
from jaxcomp.fluid._helmholtz import fluid_data
from jaxcomp.fluid._multi_fluid import REFERENCE
from jaxcomp.fluid._saturation_lines import solve_lines

SOURCES = Path(__file__).parent / "mixture_sources"
MIXTURES = DATA / "mixtures"
# GERG-2008's components in the order of its tables.
GERG_COMPONENTS = (
    *("methane", "nitrogen", "R744", "R170", "R290", "R600a", "R600", "R601a", "R601"),
    *("hexane", "heptane", "octane", "nonane", "decane", "hydrogen", "oxygen"),
    *("carbon_monoxide", "water", "hydrogen_sulfide", "helium", "argon"),
)
# Names of the sources that are those of a fluid here.
_SPELT = {"R227ea": "R227ea", "R50": "methane", "R702": "hydrogen"}
_PSEUDO_PURE = ("R410A", "R407C", "air")


def source(name: str):
    """A file of published coefficients."""
    return json.loads((SOURCES / f"{name}.json").read_text())


def registry_numbers() -> dict[str, str]:
    """Fluids by their CAS number."""
    from CoolProp.CoolProp import get_fluid_param_string

    pure = (name for name in FLUIDS if name not in _PSEUDO_PURE)
    return {get_fluid_param_string(FLUIDS[name][0], "CAS"): name for name in pure}


# ------------------------------------------------------------------- pairs
def reducing(pair: dict, first: str, second: str) -> dict[str, float]:
    """Parameters of a pair: beta and gamma of T (of sqrt(T T)) and of v (of the cubic mean)."""
    if "betaT" in pair:
        keys = {"beta_T": "betaT", "gamma_T": "gammaT", "beta_v": "betaV", "gamma_v": "gammaV"}
        return {key: pair[name] for key, name in keys.items()}
    # Lemmon's excess of the reducing temperature [K] and volume [m^3/mol]
    T = [fluid_data(name)["T_r"] for name in (first, second)]
    v = [fluid_data(name)["molar_mass"] / fluid_data(name)["rho_r"] for name in (first, second)]
    cubic = (v[0] ** (1 / 3) + v[1] ** (1 / 3)) ** 3
    gamma_T = (T[0] + T[1] + pair["xi"]) / (2 * np.sqrt(T[0] * T[1]))
    gamma_v = 4 * (v[0] + v[1] + pair["zeta"]) / cubic
    return {"beta_T": 1.0, "gamma_T": float(gamma_T), "beta_v": 1.0, "gamma_v": float(gamma_v)}


def quality(pair: dict, function: str) -> str:
    """How far a pair is known: by a departure function, by fits to vapour pressures, or by estimate."""
    if function:
        return "generalised departure" if function.startswith("Generalized") else "departure"
    never_fitted = pair.get("betaT") == pair.get("betaV") == 1
    return "estimated" if never_fitted and pair["BibTeX"].startswith("Kunz") else "fit"


def pairs() -> dict[str, dict]:
    """Parameters of every pair of fluids, by names with a plus between, in the order that counts."""
    known, rows = registry_numbers(), {}
    for pair in source("mixture_binary_pairs"):
        names = [known.get(pair[key]) for key in ("CAS1", "CAS2")]
        if None in names:
            continue
        function = pair.get("function", "") if pair["F"] else ""
        row = reducing(pair, *names)
        row |= {"F": pair["F"], "function": function, "quality": quality(pair, function)}
        rows["+".join(names)] = row | {"source": pair["BibTeX"]}
    return dict(sorted(rows.items()))


# ------------------------------------------------------------------- departure functions
def folded(n, t, d, eta, epsilon, beta, gamma) -> tuple[str, list[float]]:
    """The family and row of a term of GERG-2008, n exp(-eta (delta - eps)^2 - beta (delta - gamma)).

    Its exponent is linear in delta beside the square: both are one square about another centre.
    """
    if eta == 0:
        if beta == 0:
            return "power", [n, t, d, 0]
        return "exponential", [n * np.exp(beta * gamma), t, d, 1, beta, 0]
    centre = epsilon - beta / (2 * eta)
    factor = np.exp(eta * (centre**2 - epsilon**2) + beta * gamma)
    return "gaussian", [n * factor, t, d, eta, centre, 0, 0]


def departure(function: dict) -> dict[str, list]:
    """Rows of a departure function by family."""
    rows: dict[str, list] = {"power": [], "exponential": [], "gaussian": []}
    columns = ("eta", "epsilon", "beta", "gamma")
    for k, (n, t, d) in enumerate(zip(function["n"], function["t"], function["d"], strict=True)):
        if function["type"] == "Exponential":
            rows["power"].append([n, t, d, function["l"][k]])
            continue
        values = [function[key][k] for key in columns]
        if function["type"] == "GERG-2008":
            family, row = folded(n, t, d, *values)
            rows[family].append(row)
        elif k < function["Npower"]:
            rows["power"].append([n, t, d, function["l"][k]])
        else:
            rows["gaussian"].append([n, t, d, *values])
    return {family: table for family, table in rows.items() if table}


def departures(names) -> dict[str, dict]:
    """Departure functions that pairs use, each with its source."""
    return {
        one["Name"]: departure(one) | {"source": one["BibTeX"]}
        for one in source("mixture_departure_functions")
        if one["Name"] in names
    }


# ------------------------------------------------------------------- GERG-2008
def gerg_ideal(n0, th0, T_r: float, rho_r: float) -> dict:
    """The ideal part in tau and delta; hyperbolic functions as logarithms of exponentials.

    n ln sinh z = n (z - ln 2) + n ln(1 - exp(-2 z)); likewise -n ln cosh z, with plus signs.
    """
    lead = [n0[1] + np.log(rho_r / 1e3) - n0[3] * np.log(T_r), n0[2] / T_r]
    planck = []
    for k, sign in ((4, -1.0), (6, -1.0), (5, 1.0), (7, 1.0)):
        if th0[k] == 0:
            continue
        n = -sign * n0[k]
        lead[0] -= n * np.log(2)
        lead[1] += n * th0[k] / T_r
        planck.append([n, 1.0, sign, -2 * th0[k] / T_r])
    # -n0[3] ln T = n0[3] (ln tau - ln T_r)
    return {"lead": lead, "log": n0[3], "power": [], "planck": planck}


def gerg() -> dict:
    """All of GERG-2008: components, pairs and functions."""
    tables = source("gerg2008")
    components = {}
    for name, row in zip(GERG_COMPONENTS, tables["components"], strict=True):
        components[name] = {
            "molar_mass": row["M"],
            "T_r": row["T"],
            "rho_r": row["rho"],
            "ideal": gerg_ideal(row["n0"], row["th0"], row["T"], row["rho"]),
            "residual": {"power": row["rows"]},
        }
    functions = {}
    for key, rows in tables["functions"].items():
        by_family: dict[str, list] = {"power": [], "exponential": [], "gaussian": []}
        for n, t, d, c, e, g, exponential in rows:
            # exp(c delta^2 + e delta + g), as `folded` has it with a centre at zero
            if not exponential:
                family, row = "power", [n, t, d, 0]
            elif c == 0:
                family, row = "exponential", [n * np.exp(g), t, d, 1, -e, 0]
            else:
                family, row = (
                    "gaussian",
                    [n * np.exp(g - e**2 / (4 * c)), t, d, -c, -e / (2 * c), 0, 0],
                )
            by_family[family].append(row)
        functions[key] = {family: table for family, table in by_family.items() if table}
    rows = {}
    for i, j, beta2_T, mean_T, beta2_v, mean_v, F, function in tables["pairs"]:
        names = f"{GERG_COMPONENTS[i]}+{GERG_COMPONENTS[j]}"
        # volumes are in l/mol
        rows[names] = [beta2_T, mean_T, beta2_v, mean_v / 1e3, F, str(function) if F else ""]
    return {
        "source": "Kunz, Wagner (2012), J. Chem. Eng. Data 57, 3032; tables of NIST's AGA8",
        "gas_constant": tables["R"],
        # the extended range; densities are good to 0.1 % between 90 and 450 K and up to 35 MPa
        "T_least": 60.0,
        "T_most": 700.0,
        "p_most": 70e6,
        "components": components,
        "pairs": rows,
        "functions": functions,
    }


# ------------------------------------------------------------------- blends
def blends() -> dict[str, dict]:
    """Blends of ASHRAE 34: composition in per cent of mass, and class by the quality of their pairs."""
    rows = {}
    for name, blend in source("blends").items():
        composition = {_SPELT.get(key, key): value for key, value in blend["mass_percent"].items()}
        rows[name] = {"mass_percent": composition, "class": blend["class"]}
    return rows


# ------------------------------------------------------------------- lines
def digits(values, unit: float) -> list:
    """Numbers of a series as whole multiples of a unit, without the zeros at its end."""
    multiples = np.rint(values / unit).astype(int)
    if multiples.ndim > 1:
        return [digits(row, unit) for row in values]
    last = np.flatnonzero(multiples)
    return multiples[: last[-1] + 1 if last.size else 0].tolist()


def saturation_lines(name: str) -> dict | None:
    """Dew and bubble line of a blend, with the slopes of all components but the last.

    Mass fractions are normalised: the sum of fraction times slope is zero, and gives the last.
    """
    fractions = blends_of_library()[name].mass_fractions
    components = tuple(fractions)
    composition = np.array([*fractions.values()])
    lines = solve_lines(components, composition / composition.sum(), REFERENCE)
    if lines is None:
        return None
    return {
        "ends": np.asarray(lines.ends).tolist(),
        "critical": round(float(lines.critical), 4),
        # A pressure or density to 1e-11. Slopes to 1e-9: with 1e-7 the slope of a compressor's flow, in
        # which those of pressure and density nearly cancel, was off by 5e-6 of itself.
        "coefficients": digits(np.asarray(lines.coefficients), COEFFICIENT_UNIT),
        "slopes": digits(np.asarray(lines.slopes[:-1]), SLOPE_UNIT),
    }


def write(path: Path, tree) -> None:
    """One file, one row of numbers on one line."""
    path.write_text(compact(json.dumps(tree, indent=0)) + "\n")


def main() -> None:
    """Write all files anew."""
    shutil.rmtree(MIXTURES, ignore_errors=True)
    MIXTURES.mkdir()
    rows = pairs()
    write(MIXTURES / "pairs.json", rows)
    write(MIXTURES / "departures.json", departures({row["function"] for row in rows.values()}))
    write(MIXTURES / "gerg2008.json", gerg())
    write(MIXTURES / "blends.json", blends())
    (MIXTURES / "lines").mkdir()
    for blend in usable_blends():
        lines = saturation_lines(blend.name)
        print(
            f"{blend.name}: class {blend.quality}, {'no lines' if lines is None else 'lines'}",
            flush=True,
        )
        if lines is not None:
            write(MIXTURES / "lines" / f"{blend.name}.json", lines)


if __name__ == "__main__":
    main()
