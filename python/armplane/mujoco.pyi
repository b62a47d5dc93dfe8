# Types; the docstrings are in the module.
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Doubles = NDArray[np.float64]

class Arm:
    model: Any
    data: Any
    n: int
    names: list[str]
    turns: NDArray[np.bool_]
    effort: _Doubles
    velocity: _Doubles
    start: _Doubles
    def __init__(self, text: str) -> None: ...
    def move_to(self, q: ArrayLike, qdot: ArrayLike | None = None) -> None: ...
    @property
    def position(self) -> _Doubles: ...
    @property
    def rotation(self) -> _Doubles: ...
    def jacobian(self) -> _Doubles: ...
    def mass_matrix(self) -> _Doubles: ...
    def bias(self) -> _Doubles: ...
