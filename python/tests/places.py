"""Where the repository has its scenes and its program."""

import os
import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENES = ROOT / "scenes"
PROGRAM = pathlib.Path(os.environ.get("TAUGATE_PROGRAM", ROOT / "target/release/taugate")).absolute()
