"""`python -m jaxcomp` is the program `jaxcomp`."""

from .cli import main

if __name__ == "__main__":
    main()
