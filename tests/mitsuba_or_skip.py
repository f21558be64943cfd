"""Imports Mitsuba's LLVM variant and other modules. If one is not installed, prints a note and exits with 0."""
import importlib
import os
import sys

for library in ("/usr/lib/x86_64-linux-gnu/libLLVM-19.so", "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1"):
    if "DRJIT_LIBLLVM_PATH" not in os.environ and os.path.exists(library):
        os.environ["DRJIT_LIBLLVM_PATH"] = library


def modules(*names):
    """Returns the module mitsuba, then the modules with the given names in their order."""
    try:
        mi = importlib.import_module("mitsuba")
        mi.set_variant("llvm_ad_rgb")
        return mi, *map(importlib.import_module, names)
    except ImportError as error:
        print(f"skipped: {error}; pip install mitsuba {' '.join(names)}")
        sys.exit(0)
