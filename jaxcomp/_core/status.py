"""How a solution ended, in words; carried through `jit` and `vmap` as one integer per sample."""

import equinox as eqx
import jax


class Status(eqx.Enumeration):
    """Outcome of a solver."""

    converged = "converged"
    not_converged = (
        "the iteration did not reach its tolerance; allow more iterations or a looser tolerance"
    )
    bad_input = "a value lies outside its bound or a rule between values is broken"
    self_locking = (
        "the friction locks the joints: at some crank angle the balance of forces has no unique "
        "solution; lower the coefficients of friction or the tilt of the connecting rod"
    )
    singular = (
        "the system is singular: its planes do not act independently of each other; leave one out, or "
        "take least squares"
    )
    stalled = (
        "the crank comes to a halt within the revolution; the motor is too weak or the inertia too "
        "small"
    )
    unresolved = (
        "the nodes do not resolve the revolution: its duration or its losses are not known to 0.1 % "
        "(of the work), its energy does not close to 1e-5, or its fluctuation of speed is not known to "
        "2 %; take more nodes, or more inertia or speed where the crank all but halts"
    )
    too_many_events = (
        "the valves make more events in a revolution than there are panels; take more panels, or a "
        "restitution of zero"
    )
    no_delivery = (
        "the pressure in the cylinder does not open the discharge valve: nothing is delivered"
    )
    wet = "the gas is below its dew point: wet compression is not modelled"
    no_periodic_state = (
        "no stable periodic state was found: the net work of a revolution does not fall with speed"
    )
    film_collapse = (
        "the film of a journal closes within the revolution; give it more viscosity, width or less "
        "clearance, or a load that does not turn at half the speed of the film"
    )
    thin_film = (
        "the film of a journal is thinner than the roughness of its surfaces, where it carries nothing; "
        "give it more viscosity, width or speed, or less clearance or load, such as with `least_film` as "
        "a constraint of `optimise`, or a `contact`, which carries there"
    )


class SolveFailed(RuntimeError):
    """A solver did not find what was asked for; `status` says why.

    Args:
        status: the outcome, a `Status`.
        details: what else is known, for the message.
        result: what the solver ended with, if it ends with something.
    """

    def __init__(self, status, details: str = "", result=None):
        self.status, self.result = status, result
        if not jax.config.read("jax_enable_x64"):
            details = "; ".join(filter(None, [details, "in single precision: see JAXCOMP_X64"]))
        super().__init__(Status[status] + (f" ({details})" if details else "") + ".")
