"""How JAX is set up with the first module of the package that is imported.

Double precision, since the balances lose too many digits in single precision, and programs that XLA
compiles in half the time. Both can be switched off before the import: `JAXCOMP_X64=0` leaves the
precision, `JAXCOMP_XLA_FLAGS=0` the flags of XLA as they are.

Without XLA's optimisations a program compiles sooner still, and runs slower. So are compiled whole
solutions at first (`jaxcomp._core.exported`), all programs of a command that solves a machine once, and
all programs with `JAXCOMP_XLA_FLAGS=quick`; none with `JAXCOMP_XLA_FLAGS=optimised`.
"""

import os

import jax
from jaxlib.version import __version_info__

from .environment import xla_setting

_ONE_KERNEL = "xla_cpu_small_while_loop_byte_threshold=1000000"
# Flags of XLA with the versions of jaxlib, from and below, that take them: XLA ends a process that names
# a flag it does not know. Measured on the orbit of Tsuji et al., in seconds of the processor; programs
# run as fast with them, single and in batches.
# jaxlib 0.9.2: 10.1 to compile without any, 6.6 without XLA's newer emitters of fused code, 5.9 (and a
# third less by the clock) without expensive passes, a fifth less at the first level of optimisation.
# jaxlib 0.12.0: 8.5 to trace and compile without any, 8.3 and 7.8 with these two; `r600a-8cc` 35.8, 33.9.
# The last makes one kernel of every loop that touches less memory than it says: on 0.9 the march of a
# cylinder's cycle runs seven times as fast.
_FLAGS = [
    ((0, 0), (0, 10), "--xla_cpu_use_fusion_emitters", "false"),
    ((0, 0), (0, 13), "--xla_llvm_disable_expensive_passes", "true"),
    ((0, 0), (0, 13), "--xla_backend_optimization_level", "1"),
    ((0, 9), (0, 10), "--xla_backend_extra_options", _ONE_KERNEL),
]

# Passes over loops within loops, which XLA repeats until nothing changes. Programs with valves have 28
# loops: without these passes `run r600a-8cc` takes 0.83 of the time, programs without valves no less.
_PASSES_OVER_LOOPS = (
    "while-loop-constant-sinking",
    "while-loop-invariant-code-motion",
    "simplify-while-loops",
)

# With these a program is compiled sooner, for few calls. Its code is one part instead of 32 that
# processors share, which takes a tenth of the time of all of them.
_QUICK = {
    "xla_backend_optimization_level": "0",
    "xla_disable_hlo_passes": ",".join(_PASSES_OVER_LOOPS),
    "xla_cpu_parallel_codegen_split_count": "1",
}

_told: dict[str, str] = {}


def tell_xla(flag: str, value: str) -> None:
    """Set a flag of XLA that the user has not set; without effect once JAX has run anything."""
    flags = os.environ.get("XLA_FLAGS", "")
    if flag in _told:  # told before, by this function
        flags = flags.replace(f"{flag}={_told[flag]}", "").strip()
    if flag not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {flag}={value}".strip()
        _told[flag] = value


def unoptimised_compiles() -> None:
    """Compile without XLA's optimisations, for programs that run once; call before JAX runs anything."""
    for name, value in _QUICK.items():
        tell_xla(f"--{name}", value)


def quick_options() -> dict[str, str]:
    """Options of XLA with which a single program is compiled sooner than all others.

    There are none where all programs are compiled so already, where the user wants XLA's optimisations at
    once or has set their level, and where programs do not run on the processor.
    """
    level = "xla_backend_optimization_level"
    # not told at all where the user has, or where a later jaxlib may not know it
    optimises = _told.get(f"--{level}") not in (None, _QUICK[level])
    if xla_setting() != "1" or not optimises or jax.default_backend() != "cpu":
        return {}
    return _QUICK


def flags_with(options: dict[str, str]) -> str:
    """The flags of XLA with which a program is compiled that has options of its own, in order."""
    flags = {}
    for flag in os.environ.get("XLA_FLAGS", "").split():
        name, _, value = flag.partition("=")
        flags[name.removeprefix("--")] = value
    flags |= options
    return " ".join(f"{name}={flags[name]}" for name in sorted(flags))


if os.environ.get("JAXCOMP_X64", "1") != "0":
    jax.config.update("jax_enable_x64", True)
if xla_setting() != "0":
    for _since, _below, _flag, _value in _FLAGS:
        if _since <= __version_info__ < _below:
            tell_xla(_flag, _value)
if xla_setting() == "quick":
    unoptimised_compiles()


def single_precision() -> str:
    """Words on single precision, in which solvers may not reach their tolerances; "" in double."""
    if jax.config.read("jax_enable_x64"):
        return ""
    if os.environ.get("JAXCOMP_X64", "1") == "0":
        return "in single precision: see JAXCOMP_X64"
    return (
        "in single precision, which was switched on after jaxcomp was imported: "
        '`jax.config.update("jax_enable_x64", True)` before a machine is loaded'
    )
