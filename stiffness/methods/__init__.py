"""Methods that learn how an arm deflects from a recording; each is one file."""

from stiffness.methods.method import Method, Rigid
from stiffness.methods.vjm import Vjm

METHODS: tuple[type[Method], ...] = (Rigid, Vjm)
"""Every method; each is built from a nominal arm."""
