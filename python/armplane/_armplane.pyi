# Types; `help(armplane.Law)` has the words, with shapes and units.
from os import PathLike
from typing import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

Doubles = NDArray[np.float64]

class Arm:
    name: str
    dof: int
    tip: str
    joints: list[str]
    lower: Doubles
    upper: Doubles
    effort: Doubles
    velocity: Doubles
    torque_rate: Doubles
    postures: dict[str, list[float]]
    @staticmethod
    def from_urdf(path: str | PathLike[str], tip: str | None = None, description: str | PathLike[str] | None = None) -> Arm: ...
    @staticmethod
    def builtin(name: str, tip: str | None = None) -> Arm: ...
    @staticmethod
    def names() -> list[str]: ...
    def at(self, q: ArrayLike, qdot: ArrayLike | None = None) -> Posture: ...
    def singularities(self, q: ArrayLike) -> list[Singularity]: ...
    def step_many(self, q: ArrayLike) -> NDArray[np.void]: ...

class Posture:
    pose: Doubles
    J: Doubles
    A: Doubles
    bias: Doubles
    gravity: Doubles

class Singularity:
    name: str
    type: str
    measure: float
    direction: Doubles
    inside: bool
    entry: float
    exit: float

class Law:
    state: LawState
    refused: NDArray[np.bool_]
    def __init__(self, arm: Arm, dt: float = 0.001, q: ArrayLike | None = None, settings: Mapping[str, object] | None = None) -> None: ...
    def step(
        self,
        q: ArrayLike,
        qdot: ArrayLike,
        pose: ArrayLike | None = None,
        twist: ArrayLike | None = None,
        tau_disturbance: ArrayLike | None = None,
        out: Doubles | None = None,
    ) -> Doubles: ...
    def step_many(
        self,
        q: ArrayLike,
        qdot: ArrayLike,
        pose: ArrayLike | None = None,
        twist: ArrayLike | None = None,
        tau_disturbance: ArrayLike | None = None,
    ) -> Doubles: ...
    def reset(self, rows: ArrayLike | None = None) -> None: ...
    def state_of(self, row: int) -> LawState: ...

class LawState:
    tick: int
    phase: str
    reason: str
    refusal: str
    mode: dict[str, str]
    beta: dict[str, float]
    speed_scale: float
    targets_refused: int
    target_refusal: str
