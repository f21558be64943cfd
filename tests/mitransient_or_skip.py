"""Imports mitransient with the LLVM it needs; says so and exits with 0 where Python lacks it."""
import os
import sys

for library in ("/usr/lib/x86_64-linux-gnu/libLLVM-19.so", "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1"):
    if "DRJIT_LIBLLVM_PATH" not in os.environ and os.path.exists(library):
        os.environ["DRJIT_LIBLLVM_PATH"] = library
try:
    import mitsuba as mi
    import numpy as np
    mi.set_variant("llvm_ad_rgb")
    import mitransient
except ImportError as error:
    print(f"skipped: {error}; pip install mitransient mitsuba numpy")
    sys.exit(0)
