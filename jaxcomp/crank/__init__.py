"""Crank motion: the equation of motion, the periodic orbit, transients and energy."""
