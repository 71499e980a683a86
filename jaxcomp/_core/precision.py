"""How JAX is set up with the first module of the package that is imported.

Double precision, since the balances lose too many digits in single precision, and programs that XLA
compiles in half the time. Both can be switched off before the import: `JAXCOMP_X64=0` leaves the
precision, `JAXCOMP_XLA_FLAGS=0` the flags of XLA as they are.
"""

import os

import jax
from jaxlib.version import __version_info__

# Measured with jaxlib 0.9.2 on the orbit of Tsuji et al., in seconds of the processor: 10.1 to compile
# without them, 6.6 without XLA's newer emitters of fused code, 5.9 (and a third less by the clock) with
# the second flag, a fifth less again (value and gradient alike) with the third, in programs that run
# as fast, single and in batches. Later versions know no such choice, and XLA ends a process that names a
# flag it does not know.
_QUICK = {
    "--xla_cpu_use_fusion_emitters": "false",
    "--xla_llvm_disable_expensive_passes": "true",
    "--xla_backend_optimization_level": "1",
}
# One kernel of every loop that touches less memory than this: the march of a cylinder's cycle runs seven
# times as fast, what else was measured as fast as before. Known to 0.9; a process that names an option
# which its XLA does not know ends.
_ONE_KERNEL = {
    "--xla_backend_extra_options": "xla_cpu_small_while_loop_byte_threshold=1000000",
}


_told: dict[str, str] = {}


def tell_xla(flag: str, value: str) -> None:
    """Set a flag of XLA that the user has not set; without effect once JAX has run anything."""
    given = os.environ.get("XLA_FLAGS", "")
    if flag in _told:  # told before, by this function
        given = given.replace(f"{flag}={_told[flag]}", "").strip()
    if flag not in given:
        os.environ["XLA_FLAGS"] = f"{given} {flag}={value}".strip()
        _told[flag] = value


if os.environ.get("JAXCOMP_X64", "1") != "0":
    jax.config.update("jax_enable_x64", True)
if os.environ.get("JAXCOMP_XLA_FLAGS", "1") != "0" and __version_info__ < (0, 10):
    _flags = _QUICK | (_ONE_KERNEL if __version_info__ >= (0, 9) else {})
    for _flag, _value in _flags.items():
        tell_xla(_flag, _value)
