# Types; `help(armplane.Law)` has the words, with shapes and units.
from os import PathLike
from typing import Any, Mapping, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Doubles = NDArray[np.float64]

@final
class Arm:
    name: str
    dof: int
    tip: str
    joints: list[str]
    lower: _Doubles
    upper: _Doubles
    effort: _Doubles
    velocity: _Doubles
    torque_rate: _Doubles
    task: list[bool]
    postures: dict[str, list[float]]
    notes: list[str]
    frames: dict[str, tuple[int | None, _Doubles]]
    @staticmethod
    def from_mujoco(model: object, site: str | None = None, description: str | PathLike[str] | None = None) -> Arm: ...
    @staticmethod
    def from_urdf(path: str | PathLike[str], tip: str | None = None, description: str | PathLike[str] | None = None) -> Arm: ...
    @staticmethod
    def builtin(name: str, tip: str | None = None) -> Arm: ...
    @staticmethod
    def names() -> list[str]: ...
    def at(self, q: ArrayLike, qdot: ArrayLike | None = None) -> Posture: ...
    def singularities(self, q: ArrayLike) -> list[Singularity]: ...
    def step_many(self, q: ArrayLike, far: bool = False) -> NDArray[np.void]: ...

@final
class Posture:
    pose: _Doubles
    links: _Doubles
    J: _Doubles
    A: _Doubles
    bias: _Doubles
    gravity: _Doubles

@final
class Reference:
    duration_s: float
    time_s: float
    leg: int
    done: bool
    pose: _Doubles
    twist: _Doubles
    acceleration: _Doubles
    force: dict[str, Any] | None
    def __new__(cls, job: str) -> Reference: ...
    def advance(self, by_s: float, rate: float, q: ArrayLike, qdot: ArrayLike, report: bytes) -> None: ...

@final
class Singularity:
    name: str
    type: str
    measure: float
    direction: _Doubles
    inside: bool
    entry: float
    exit: float

@final
class Law:
    state: LawState
    refused: NDArray[np.bool_]
    def __new__(cls, arm: Arm, dt: float = 0.001, q: ArrayLike | None = None, settings: Mapping[str, object] | None = None) -> Law: ...
    def step(
        self,
        q: ArrayLike,
        qdot: ArrayLike,
        pose: ArrayLike | None = None,
        twist: ArrayLike | None = None,
        tau_disturbance: ArrayLike | None = None,
        out: _Doubles | None = None,
    ) -> _Doubles: ...
    def step_many(
        self,
        q: ArrayLike,
        qdot: ArrayLike,
        pose: ArrayLike | None = None,
        twist: ArrayLike | None = None,
        tau_disturbance: ArrayLike | None = None,
    ) -> _Doubles: ...
    def reset(self, rows: ArrayLike | None = None) -> None: ...
    def state_of(self, row: int) -> LawState: ...

@final
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
