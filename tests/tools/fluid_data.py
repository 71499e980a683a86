"""Generate the fluid data files of `jaxcomp/fluid/data` from the equations of state kept by CoolProp.

Run `python tests/tools/fluid_data.py` to write all of them anew; it needs CoolProp (the extra
`coolprop`). CoolProp carries the published coefficients
of each equation under the MIT licence; here its several forms of ideal-gas terms are reduced to one:

    a0 = ln delta + lead[0] + lead[1] tau + log ln tau + sum n tau^t + sum n ln(c + d exp(theta tau)).

Viscosity and conductivity of the gas are fitted by polynomials in temperature and density to
CoolProp's values; the largest misfit is kept with them.
"""

import json
import re
from importlib.metadata import version
from pathlib import Path

import numpy as np

from jaxcomp import fluid

DATA = Path(fluid.__file__).parent / "data"
# name: (CoolProp's name, what it is, publication of the equation of state)
FLUIDS = {
    "R134a": ("R134a", "1,1,1,2-tetrafluoroethane", "Tillner-Roth, Baehr (1994), JPCRD 23, 657"),
    "R600a": ("R600a", "isobutane", "Buecker, Wagner (2006), JPCRD 35, 929"),
    "R290": ("R290", "propane", "Lemmon, McLinden, Wagner (2009), J. Chem. Eng. Data 54, 3141"),
    "R744": ("R744", "carbon dioxide", "Span, Wagner (1996), JPCRD 25, 1509"),
    "R22": (
        "R22",
        "chlorodifluoromethane",
        "Kamei, Beyerlein, Jacobsen (1995), Int. J. Thermophys. 16, 1155",
    ),
    "R717": ("R717", "ammonia", "Gao, Wu, Bell, Harvey, Lemmon (2023), JPCRD 52, 013102"),
    "R32": ("R32", "difluoromethane", "Tillner-Roth, Yokozeki (1997), JPCRD 26, 1273"),
    "R1234yf": (
        "R1234yf",
        "2,3,3,3-tetrafluoropropene",
        "Lemmon, Akasaka (2022), Int. J. Thermophys. 43, 119",
    ),
    "R410A": (
        "R410A",
        "50 % R32, 50 % R125 by mass, as a pseudo-pure fluid",
        "Lemmon (2003), Int. J. Thermophys. 24, 991",
    ),
    "R407C": (
        "R407C",
        "23 % R32, 25 % R125, 52 % R134a by mass, as a pseudo-pure fluid",
        "Lemmon (2003), Int. J. Thermophys. 24, 991",
    ),
    "air": (
        "Air",
        "dry air, as a pseudo-pure fluid",
        "Lemmon, Jacobsen, Penoncello, Friend (2000), JPCRD 29, 331",
    ),
    "nitrogen": (
        "Nitrogen",
        "nitrogen",
        "Span, Lemmon, Jacobsen, Wagner, Yokozeki (2000), JPCRD 29, 1361",
    ),
}
_TRANSPORT_ORDER = (6, 5)  # terms in T and in rho
_GAUSSIAN = ("n", "t", "d", "eta", "epsilon", "beta", "gamma")


def ideal_terms(terms: list[dict], critical: float) -> dict:
    """The one form of the ideal-gas part, from CoolProp's."""
    lead, log = np.zeros(2), 0.0
    power: list[list[float]] = []
    planck: list[list[float]] = []
    for term in terms:
        kind = term["type"].removeprefix("IdealGasHelmholtz")
        if kind in ("Lead", "EnthalpyEntropyOffset"):
            lead += term["a1"], term["a2"]
        elif kind == "LogTau":
            log += term["a"]
        elif kind == "Power":
            power += map(list, zip(term["n"], term["t"], strict=True))
        elif kind == "PlanckEinstein":
            planck += [[n, 1.0, -1.0, -t] for n, t in zip(term["n"], term["t"], strict=True)]
        elif kind == "PlanckEinsteinFunctionT":
            scale = term["Tcrit"]
            planck += [
                [n, 1.0, -1.0, -v / scale] for n, v in zip(term["n"], term["v"], strict=True)
            ]
        elif kind == "PlanckEinsteinGeneralized":
            planck += map(list, zip(term["n"], term["c"], term["d"], term["t"], strict=True))
        elif kind == "CP0Constant":
            c, tau_0 = term["cp_over_R"], term["Tc"] / term["T0"]
            lead += c - c * np.log(tau_0), -c / tau_0
            log += c
        elif kind == "CP0PolyT":
            scale, start = term["Tc"], term["T0"]
            for c, t in zip(term["c"], term["t"], strict=True):
                power.append([-c * scale**t / (t * (t + 1)), -t])
                lead += c * start**t / t, -c * start ** (t + 1) / (scale * (t + 1))
        else:
            raise ValueError(f"unknown ideal-gas term {kind}")
    assert critical > 0
    return {"lead": lead.tolist(), "log": log, "power": power, "planck": planck}


def residual_terms(terms: list[dict]) -> dict:
    """Coefficients by family, one row a term, in the order that `_helmholtz` reads."""
    rows: dict[str, list] = {"power": [], "gaussian": [], "gao": [], "non_analytic": []}
    columns = {
        "Power": ("power", ("n", "t", "d", "l")),
        "Gaussian": ("gaussian", _GAUSSIAN),
        "GaoB": ("gao", (*_GAUSSIAN, "b")),
        "NonAnalytic": ("non_analytic", ("n", "a", "b", "beta", "A", "B", "C", "D")),
    }
    for term in terms:
        family, names = columns[term["type"].removeprefix("ResidualHelmholtz")]
        rows[family] += [list(row) for row in zip(*(term[n] for n in names), strict=True)]
    return {family: values for family, values in rows.items() if values}


def ancillary(curve: dict) -> dict:
    """A saturation curve, y = y_r exp((T_r/T) sum n theta^t) or y_r (1 + sum n theta^t)."""
    if curve["type"] == "rhoLnoexp":
        form = "sum"
    else:
        form = "exponential of tau" if curve["using_tau_r"] else "exponential"
    keys = ("T_r", "reducing_value", "n", "t")
    return {"form": form, **{key: curve[key] for key in keys}}


def transport(name: str, reducing: tuple[float, float], curve, limits: tuple[float, float]) -> dict:
    """Polynomials of viscosity and conductivity in T/T_r and rho/rho_r, of the gas."""
    from CoolProp.CoolProp import PropsSI

    low, high = max(limits[0], 220.0), min(limits[1], 500.0)
    temperatures = np.linspace(low, high, 40)
    points = []
    for t in temperatures:
        most = 0.35 * reducing[1] if t > 0.99 * reducing[0] else min(0.35 * reducing[1], curve(t))
        points += [(t, most * x) for x in np.linspace(0.002, 1.0, 14)]
    t, rho = np.array(points).T
    result: dict = {"T": [low, high], "rho_most": 0.35 * reducing[1]}
    x, y = t / reducing[0], rho / reducing[1]
    basis = np.stack(
        [x**i * y**j for i in range(_TRANSPORT_ORDER[0]) for j in range(_TRANSPORT_ORDER[1])], 1
    )
    for key, letter in (("viscosity", "V"), ("conductivity", "L")):
        values = np.array([_or_nan(PropsSI, letter, "T", a, "D", b, name) for a, b in points])
        # conductivity diverges at the critical point, which no cylinder visits
        kept = (np.abs(t / reducing[0] - 1) > 0.1) | (rho < 0.1 * reducing[1])
        kept &= np.isfinite(values)  # corresponding states find no solution here and there
        assert kept.sum() > 100, name
        scaled = basis[kept] / values[kept, None]
        fit = np.linalg.lstsq(scaled, np.ones(kept.sum()), rcond=None)[0]
        result[key] = fit.reshape(_TRANSPORT_ORDER).tolist()
        result[f"{key}_misfit"] = float(np.max(np.abs(scaled @ fit - 1)))
    return result


def _or_nan(function, *arguments) -> float:
    try:
        return function(*arguments)
    except ValueError:
        return np.nan


def fluid_data(name: str) -> dict:
    """Everything the library needs to know of a fluid."""
    from CoolProp.CoolProp import PropsSI, get_fluid_param_string

    source, what, publication = FLUIDS[name]
    raw = json.loads(get_fluid_param_string(source, "JSON"))[0]
    equation, curves = raw["EOS"][0], raw["ANCILLARIES"]
    mass = equation["molar_mass"]
    reducing = equation["STATES"]["reducing"]
    at = reducing["T"], reducing["rhomolar"] * mass
    dew = curves["pV" if equation["pseudo_pure"] else "pS"]
    bubble = curves.get("pL", dew)
    for curve in (curves["rhoL"], curves["rhoV"]):
        curve["reducing_value"] *= mass

    def vapour(t):
        return PropsSI("D", "T", t, "Q", 1, source)

    return {
        "name": name,
        "description": what,
        "source": publication,
        "licence": f"coefficients as published; from CoolProp {version('CoolProp')} (MIT licence)",
        "pseudo_pure": equation["pseudo_pure"],
        "gas_constant": equation["gas_constant"] / mass,
        "molar_mass": mass,
        "T_r": at[0],
        "rho_r": at[1],
        "T_critical": dew["T_r"],
        "T_least": equation["Ttriple"],
        "T_most": equation["T_max"],
        "p_most": equation["p_max"],
        "ideal": ideal_terms(equation["alpha0"], at[0]),
        "residual": residual_terms(equation["alphar"]),
        "dew_pressure": ancillary(dew),
        "bubble_pressure": ancillary(bubble),
        "liquid_density": ancillary(curves["rhoL"]),
        "vapour_density": ancillary(curves["rhoV"]),
        "transport": transport(source, at, vapour, (equation["Ttriple"] + 5, equation["T_max"])),
    }


def main() -> None:
    """Write one file for each fluid."""
    DATA.mkdir(exist_ok=True)
    for name in FLUIDS:
        data = fluid_data(name)
        text = json.dumps(data, indent=1)
        (DATA / f"{name}.json").write_text(_compact(text) + "\n")
        fit = data["transport"]
        print(
            f"{name}: viscosity within {fit['viscosity_misfit']:.2%}, "
            f"conductivity {fit['conductivity_misfit']:.2%}"
        )


def _compact(text: str) -> str:
    """One row of numbers on one line."""
    number = r"-?[\d.]+(?:e[+-]?\d+)?"
    return re.sub(
        rf"\[\s*({number}(?:,\s*{number})*)\s*\]",
        lambda m: "[" + re.sub(r",\s*", ", ", m.group(1)) + "]",
        text,
    )


if __name__ == "__main__":
    main()
