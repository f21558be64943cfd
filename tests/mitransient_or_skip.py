"""Imports mitransient with the LLVM it needs; says so and exits with 0 where Python lacks it."""
from mitsuba_or_skip import modules

mi, np, mitransient = modules("numpy", "mitransient")
