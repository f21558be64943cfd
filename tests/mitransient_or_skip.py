"""Imports mitransient. If it is not installed, prints a note and exits with 0."""
from mitsuba_or_skip import modules

mi, np, mitransient = modules("numpy", "mitransient")
