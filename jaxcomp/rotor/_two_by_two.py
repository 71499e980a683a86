r"""Algebra of 2 x 2 blocks by components.

A general block is (a, b, c, d) for [[a, b], [c, d]], a symmetric one (a, b, d), a vector (u, v).
The components are arrays of one shape (segments, lanes, and speeds by `vmap`), so that every line
below is elementwise: this is what XLA turns into vector instructions, where small matrix products
become one library call each.
"""


def of_block(x):
    """Components of an array (2, 2, ...)."""
    return x[0, 0], x[0, 1], x[1, 0], x[1, 1]


def inverse(s):
    """Inverse of a symmetric block, symmetric."""
    a, b, d = s
    r = 1 / (a * d - b * b)
    return d * r, -b * r, a * r


def product(s, n):
    """S N with S symmetric."""
    (a, b, d), (p, q, r, t) = s, n
    return a * p + b * r, a * q + b * t, b * p + d * r, b * q + d * t


def product_t(m, n):
    """M^T N."""
    (a, b, c, d), (p, q, r, t) = m, n
    return a * p + c * r, a * q + c * t, b * p + d * r, b * q + d * t


def times(m, x):
    """M x."""
    (a, b, c, d), (u, v) = m, x
    return a * u + b * v, c * u + d * v


def times_t(m, x):
    """M^T x."""
    (a, b, c, d), (u, v) = m, x
    return a * u + c * v, b * u + d * v
