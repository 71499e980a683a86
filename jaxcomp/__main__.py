"""`python -m jaxcomp` is the program `jaxcomp`."""

from ._core.interrupts import ends_when_interrupted


def main() -> None:
    """Entry point of the program; an interrupt ends it soon and without a traceback."""
    with ends_when_interrupted():
        from .cli import main as program  # an interrupt may come while modules are imported

        program()


if __name__ == "__main__":
    main()
