"""A process in single precision: settings come in on standard input, numbers go out as JSON."""

import json
import pickle
import sys

import jax
import jax.numpy as jnp

from ._single import measured


def main() -> None:
    """Measure one setting; only ever started by `_single` of the same installation."""
    question, setting = pickle.load(sys.stdin.buffer)
    design = jax.tree.map(jnp.asarray, question.design)
    print(json.dumps(measured(question._replace(design=design), setting)))


if __name__ == "__main__":
    main()
