"""`python -m jaxcomp` is the program `jaxcomp`."""

import sys


def main() -> None:
    """Entry point of the program; an interrupt ends it without a traceback."""
    try:
        from .cli import main as program  # an interrupt may come while modules are imported

        program()
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
