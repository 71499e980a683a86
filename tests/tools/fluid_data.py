"""Generate the fluid data files of `jaxcomp/fluid/data` from the equations of state kept by CoolProp.

Run `python tests/tools/fluid_data.py` to write all of them anew; it needs CoolProp (the extra
`coolprop`). CoolProp carries the published coefficients
of each equation under the MIT licence; here its several forms of ideal-gas terms are reduced to one:

    a0 = ln delta + lead[0] + lead[1] tau + log ln tau + sum n tau^t + sum n ln(c + d exp(theta tau)).

Viscosity and conductivity of the gas are fitted by polynomials in temperature and density to
CoolProp's values; the largest misfit is kept with them. Of a fluid for which CoolProp has none they are
those of the dilute gas by Chung, Ajlan, Lee, Starling (1988), Ind. Eng. Chem. Res. 27, 671, Eq. 6, and
by Eucken's modified relation in Poling, Prausnitz, O'Connell (2001), The Properties of Gases and Liquids,
Eq. 10-3.6; the file says that they are estimated.
"""

import json
import re
from functools import cache
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
    "R125": ("R125", "pentafluoroethane", "Lemmon, Jacobsen (2005), JPCRD 34, 69"),
    "R143a": ("R143a", "1,1,1-trifluoroethane", "Lemmon, Jacobsen (2000), JPCRD 29, 521"),
    "R152a": ("R152A", "1,1-difluoroethane", "Outcalt, McLinden (1996), JPCRD 25, 605"),
    "R1234ze(E)": (
        "R1234ze(E)",
        "trans-1,3,3,3-tetrafluoropropene",
        "Thol, Lemmon (2016), Int. J. Thermophys. 37, 28",
    ),
    "R1233zd(E)": (
        "R1233zd(E)",
        "trans-1-chloro-3,3,3-trifluoropropene",
        "Akasaka, Lemmon (2022), JPCRD 51, 023101",
    ),
    "R1243zf": (
        "R1243zf",
        "3,3,3-trifluoropropene",
        "Akasaka (2025), Int. J. Thermophys., as CoolProp's Akasaka-IJT-2025-R1243zf",
    ),
    "R1336mzz(Z)": (
        "R1336mzz(Z)",
        "cis-1,1,1,4,4,4-hexafluoro-2-butene",
        "McLinden, Akasaka (2020), J. Chem. Eng. Data 65, 4201",
    ),
    "R1336mzz(E)": (
        "R1336mzz(E)",
        "trans-1,1,1,4,4,4-hexafluoro-2-butene",
        "Akasaka (2023), Int. J. Thermophys., as CoolProp's Akasaka-IJT-2023",
    ),
    "R1132(E)": (
        "R1132(E)",
        "trans-1,2-difluoroethene",
        "Akasaka (2024), Int. J. Thermophys., as CoolProp's Akasaka-IJT-2024-R1132E",
    ),
    "R227ea": (
        "R227EA",
        "1,1,1,2,3,3,3-heptafluoropropane",
        "Lemmon, Span (2015), J. Chem. Eng. Data 60, 3745",
    ),
    "R236fa": (
        "R236FA",
        "1,1,1,3,3,3-hexafluoropropane",
        "Pan, Rui, Zhao, Qiu (2012), Fluid Phase Equilib. 321, 10",
    ),
    "R245fa": (
        "R245fa",
        "1,1,1,3,3-pentafluoropropane",
        "Akasaka, Zhou, Lemmon (2015), JPCRD 44, 013104",
    ),
    "R23": ("R23", "trifluoromethane", "Penoncello, Lemmon, Jacobsen, Shan (2003), JPCRD 32, 1473"),
    "R116": ("R116", "hexafluoroethane", "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785"),
    "R14": (
        "R14",
        "tetrafluoromethane",
        "Platzer, Polt, Maurer (1990), Thermophysical Properties of Refrigerants, Springer",
    ),
    "R161": ("R161", "fluoroethane", "Wu, Zhou (2012), Int. J. Thermophys. 33, 220"),
    "R13I1": ("R13I1", "trifluoroiodomethane", "Lemmon, Span (2015), J. Chem. Eng. Data 60, 3745"),
    "R124": (
        "R124",
        "1-chloro-1,2,2,2-tetrafluoroethane",
        "de Vries, Tillner-Roth, Baehr (1995), 19th Int. Congress of Refrigeration, The Hague",
    ),
    "R142b": (
        "R142b",
        "1-chloro-1,1-difluoroethane",
        "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785",
    ),
    "R218": ("R218", "octafluoropropane", "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785"),
    "R600": ("n-Butane", "butane", "Buecker, Wagner (2006), JPCRD 35, 929"),
    "R601": (
        "n-Pentane",
        "pentane",
        "Thol, Uhde, Lemmon, Span (2019), Fluid Phase Equilib., Thol-FPE-2019-alkanes-pentane",
    ),
    "R601a": ("Isopentane", "isopentane", "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785"),
    "R170": ("Ethane", "ethane", "Buecker, Wagner (2006), JPCRD 35, 205"),
    "R1150": ("Ethylene", "ethylene", "Smukala, Span, Wagner (2000), JPCRD 29, 1053"),
    "R1270": (
        "Propylene",
        "propylene",
        "Lemmon, Overhoff, McLinden, Wagner (2013), as CoolProp's Lemmon-PROPYLENE-2013",
    ),
    "RE170": ("DimethylEther", "dimethyl ether", "Wu, Zhou, Lemmon (2011), JPCRD 40, 023104"),
    "methane": ("Methane", "methane", "Setzmann, Wagner (1991), JPCRD 20, 1061"),
    "hexane": (
        "n-Hexane",
        "hexane",
        "Thol, Wang, Lemmon, Span (2019), Fluid Phase Equilib., Thol-FPE-2019-alkanes-hexane",
    ),
    "heptane": ("n-Heptane", "heptane", "Span, Wagner (2003), Int. J. Thermophys. 24, 41"),
    "octane": (
        "n-Octane",
        "octane",
        "Beckmueller, Thol, Lemmon, Span (2019), Int. J. Thermophys., Beckmueller-IJT-2019-octane",
    ),
    "nonane": ("n-Nonane", "nonane", "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785"),
    "decane": ("n-Decane", "decane", "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785"),
    "water": ("Water", "water", "Wagner, Pruss (2002), JPCRD 31, 387"),
    "hydrogen": (
        "Hydrogen",
        "normal hydrogen",
        "Leachman, Jacobsen, Penoncello, Lemmon (2009), JPCRD 38, 721",
    ),
    "parahydrogen": (
        "ParaHydrogen",
        "parahydrogen",
        "Leachman, Jacobsen, Penoncello, Lemmon (2009), JPCRD 38, 721",
    ),
    "helium": (
        "Helium",
        "helium",
        "Ortiz Vega et al. (2019), JPCRD, as CoolProp's OrtizVega-JPCRD-2019",
    ),
    "neon": ("Neon", "neon", "Thol et al. (2019), JPCRD, as CoolProp's Thol-JPCRD-2019-Neon"),
    "argon": ("Argon", "argon", "Tegeler, Span, Wagner (1999), JPCRD 28, 779"),
    "krypton": ("Krypton", "krypton", "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785"),
    "xenon": ("Xenon", "xenon", "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785"),
    "oxygen": ("Oxygen", "oxygen", "Schmidt, Wagner (1985), Fluid Phase Equilib. 19, 175"),
    "carbon_monoxide": (
        "CarbonMonoxide",
        "carbon monoxide",
        "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785",
    ),
    "hydrogen_sulfide": (
        "HydrogenSulfide",
        "hydrogen sulfide",
        "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785",
    ),
    "sulfur_dioxide": (
        "SulfurDioxide",
        "sulfur dioxide",
        "Gao, Wu, Zhang, Lemmon (2016), J. Chem. Eng. Data 61, 2859",
    ),
    "nitrous_oxide": (
        "NitrousOxide",
        "nitrous oxide",
        "Lemmon, Span (2006), J. Chem. Eng. Data 51, 785",
    ),
    "sulfur_hexafluoride": (
        "SulfurHexafluoride",
        "sulfur hexafluoride",
        "Guder, Wagner (2009), JPCRD 38, 33",
    ),
    "chlorine": ("Chlorine", "chlorine", "Thol, Herrig, Span, Lemmon (2021), AIChE J. 67, e17326"),
    "hydrogen_chloride": (
        "HydrogenChloride",
        "hydrogen chloride",
        "Thol, Dubberke, Baumhoegger, Span, Vrabec (2018), J. Chem. Eng. Data 63, 2533",
    ),
}
_GAS_CONSTANT = 8.31446261815324  # [J/(mol K)]
# [-] Beyond which a curve of the vapour pressure is fitted anew.
_WORST_CURVE = 0.005
# Curves of the vapour pressure that were fitted by hand, and what the file says of them.
_FITTED_CURVES = {
    "R1234yf": (
        {"n": [-7.41569, 1.74009, -2.24688, -3.18161], "t": [1.0, 1.5, 2.5, 5.0]},
        "; curves of the vapour pressure fitted to the equation of state, 180 K to critical, "
        "within 0.05 %",
    )
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
                if t == 0:
                    lead += c - c * np.log(scale / start), -c * start / scale
                    log += c
                    continue
                power.append([-c * scale**t / (t * (t + 1)), -t])
                lead += c * start**t / t, -c * start ** (t + 1) / (scale * (t + 1))
        elif kind == "CP0AlyLee":
            rows, offset, constant = aly_lee_terms(term)
            planck += rows
            lead += offset
            log += constant
        else:
            raise ValueError(f"unknown ideal-gas term {kind}")
    for term in terms:
        # these have a reducing temperature of their own, which tau must share
        assert abs(term.get("Tc", critical) / critical - 1) < 1e-9, term
    return {"lead": lead.tolist(), "log": log, "power": power, "planck": planck}


def aly_lee_terms(term: dict) -> tuple[list[list[float]], np.ndarray, float]:
    """Rows of logarithms, lead and logarithmic coefficient of a heat capacity by hyperbolic functions.

    n ln sinh z = n (z - ln 2) + n ln(1 - exp(-2 z)), -n ln cosh z the same with the other signs. As in
    CoolProp the linear part n (z - ln 2) is left out, which moves energy and entropy by constants; value
    and slope of the constant part are zero at T0.
    """
    constant, *pairs = term["c"]
    start, rows = term["Tc"] / term["T0"], []
    lead = np.array([constant - constant * np.log(start), -constant / start])
    for (n, temperature), sign in zip((pairs[:2], pairs[2:]), (-1.0, 1.0), strict=True):
        scale = temperature / term["Tc"]
        rows.append([-sign * n, 1.0, sign, -2 * scale])
    return rows, lead, constant


def residual_terms(terms: list[dict]) -> dict:
    """Coefficients by family, one row a term, in the order that `_helmholtz` reads."""
    families = ("power", "exponential", "gaussian", "gao", "non_analytic")
    rows: dict[str, list] = {family: [] for family in families}
    columns = {
        "Power": ("power", ("n", "t", "d", "l")),
        # exp(-g delta^l - tau^m)
        "Exponential": ("exponential", ("n", "t", "d", "l", "g", "m")),
        "Lemmon2005": ("exponential", ("n", "t", "d", "l", "g", "m")),
        "Gaussian": ("gaussian", _GAUSSIAN),
        "GaoB": ("gao", (*_GAUSSIAN, "b")),
        "NonAnalytic": ("non_analytic", ("n", "a", "b", "beta", "A", "B", "C", "D")),
    }
    for term in terms:
        family, names = columns[term["type"].removeprefix("ResidualHelmholtz")]
        count = len(term["n"])
        # what a family of terms lacks: no exp(-tau^m) for m = 0, and g = 1 unless l = 0
        absent = {"m": [0] * count, "g": [float(power > 0) for power in term.get("l", ())]}
        columns_of = [term[n] if n in term else absent[n] for n in names]
        rows[family] += [list(row) for row in zip(*columns_of, strict=True)]
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
        if not np.isfinite(values).any():
            values = np.array([estimated_transport(name, a)[letter] for a, _ in points])
            result["estimated"] = f"{result['estimated']}, {key}" if "estimated" in result else key
        # conductivity diverges at the critical point, which no cylinder visits
        kept = (np.abs(t / reducing[0] - 1) > 0.1) | (rho < 0.1 * reducing[1])
        kept &= np.isfinite(values)  # corresponding states find no solution here and there
        assert kept.sum() > 100, name
        scaled = basis[kept] / values[kept, None]
        fit = np.linalg.lstsq(scaled, np.ones(kept.sum()), rcond=None)[0]
        result[key] = fit.reshape(_TRANSPORT_ORDER).tolist()
        result[f"{key}_misfit"] = float(np.max(np.abs(scaled @ fit - 1)))
    return result


def checked_pressure(name: str, curve: dict, least: float) -> tuple[dict, str]:
    """A curve of the vapour pressure that agrees with the equation of state, and what was done to it.

    CoolProp's equilibria do not start from these curves, and one of them was 16 % off.
    """
    from CoolProp.CoolProp import PropsSI

    critical = curve["T_r"]
    temperatures = np.linspace(max(least, 0.5 * critical), 0.999 * critical, 60)
    pressures = np.array([_or_nan(PropsSI, "P", "T", t, "Q", 1, name) for t in temperatures])
    kept = np.isfinite(pressures)
    temperatures, logs = temperatures[kept], np.log(pressures[kept] / curve["reducing_value"])
    theta = 1 - temperatures / critical

    def misfit(n, t) -> float:
        total = (theta[:, None] ** np.array(t)) @ np.array(n) * critical / temperatures
        return float(np.abs(total - logs).max())

    assert curve["form"] == "exponential of tau", name
    if kept.sum() > 30 and misfit(curve["n"], curve["t"]) < _WORST_CURVE:
        return curve, ""
    powers = [1.0, 1.5, 2.5, 5.0]
    basis = theta[:, None] ** np.array(powers) * (critical / temperatures)[:, None]
    n = np.linalg.lstsq(basis, logs, rcond=None)[0].tolist()
    text = (
        f"; curve of the vapour pressure fitted to the equation of state, {temperatures[0]:.0f} K to "
        f"critical, within {misfit(n, powers):.2%}"
    )
    return curve | {"n": n, "t": powers}, text


@cache
def estimated_transport(name: str, temperature: float) -> dict[str, float]:
    """Viscosity [Pa s] (V) and conductivity [W/(m K)] (L) of a dilute gas at a temperature [K]."""
    from CoolProp.CoolProp import PropsSI

    critical, mass, acentric, density = (
        PropsSI(key, name) for key in ("TCRIT", "M", "ACENTRIC", "RHOMOLAR_CRITICAL")
    )
    reduced = 1.2593 * temperature / critical
    collision = 1.16145 * reduced**-0.14874
    collision += 0.52487 * np.exp(-0.77320 * reduced) + 2.16178 * np.exp(-2.43787 * reduced)
    # in uP of g/mol and cm^3/mol; dipoles and association are left out
    shape = 1 - 0.2756 * acentric
    volume = 1e6 / density
    viscosity = (
        40.785e-7 * shape * np.sqrt(1e3 * mass * temperature) / (volume ** (2 / 3) * collision)
    )
    heat = PropsSI("CP0MOLAR", "T", temperature, "D", 1e-3, name) - _GAS_CONSTANT
    conductivity = viscosity / mass * (1.32 * heat + 1.77 * _GAS_CONSTANT)
    return {"V": viscosity, "L": conductivity}


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

    dew, bubble, words = ancillary(dew), ancillary(bubble), ""
    if name in _FITTED_CURVES:
        fitted, words = _FITTED_CURVES[name]
        dew, bubble = dew | fitted, bubble | fitted
    elif not equation["pseudo_pure"]:
        dew, words = checked_pressure(source, dew, equation["Ttriple"])
        bubble = dew

    def vapour(t):
        return PropsSI("D", "T", t, "Q", 1, source)

    return {
        "name": name,
        "description": what,
        "source": publication,
        "licence": f"coefficients as published; from CoolProp {version('CoolProp')} (MIT licence){words}",
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
        "dew_pressure": dew,
        "bubble_pressure": bubble,
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
        (DATA / f"{name}.json").write_text(compact(text) + "\n")
        fit = data["transport"]
        print(
            f"{name}: viscosity within {fit['viscosity_misfit']:.2%}, "
            f"conductivity {fit['conductivity_misfit']:.2%}"
        )


def compact(text: str) -> str:
    """One row of numbers on one line."""
    number = r"-?[\d.]+(?:e[+-]?\d+)?"
    return re.sub(
        rf"\[\s*({number}(?:,\s*{number})*)\s*\]",
        lambda m: "[" + re.sub(r",\s*", ", ", m.group(1)) + "]",
        text,
    )


if __name__ == "__main__":
    main()
