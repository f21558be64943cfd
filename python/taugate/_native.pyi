"""The native part. It is not part of the API."""

from collections.abc import Callable
from typing import Any, Optional

import numpy as np

VERSION: str

Words = list[tuple[str, list[str]]]
Step = Callable[[float, int, float], Any]

def flags() -> dict[str, tuple[str, str, str]]: ...
def scan(
    scene: NativeScene, flags: Words, path: str, progress: Optional[Step] = None
) -> tuple[int, list[str], Optional[BaseException]]: ...

class View:
    name: str
    kind: str
    world_from_camera: list[list[float]]
    extent: float
    principal_point: list[float]
    resolution: list[int]
    crop: list[int]

class NativeScene:
    @staticmethod
    def load(path: str, flags: Words, moves: list[str]) -> NativeScene: ...
    @staticmethod
    def from_arrays(
        materials: str, textures: list[np.ndarray], meshes: list[dict[str, Any]], flags: Words
    ) -> NativeScene: ...
    def place(self, objects: dict[str, Any]) -> None: ...
    def set_transform(self, name: str, matrix: list[list[float]]) -> None: ...
    def transform(self, name: str) -> list[list[float]]: ...
    def info(self, flags: Words, arrival: bool) -> dict[str, Any]: ...
    def settings(self, flags: Words) -> str: ...
    def view(self, flags: Words) -> View: ...
    def render(
        self, flags: Words, single: bool, progress: Optional[Step] = None
    ) -> tuple[NativeImage, Optional[BaseException]]: ...

class NativeImage:
    gates: list[tuple[str, float, float]]
    uniform: Optional[tuple[float, float, int]]
    support: str
    samples: int
    iterations: int
    dropped: int
    seconds: float
    settings: str
    view: View
    notes: list[str]
    warnings: list[str]
    mean: tuple[float, Optional[float]]
    def pixels(self) -> np.ndarray: ...
    def variance(self) -> np.ndarray: ...
    def bins(self) -> np.ndarray: ...
    def bin_variance(self) -> Optional[np.ndarray]: ...
    def layers(self) -> dict[str, np.ndarray]: ...
    def objects(self) -> dict[int, str]: ...
    def save(self, path: Any, exposure: Optional[float] = None) -> None: ...
    def picture(self, exposure: Optional[float] = None) -> np.ndarray: ...
