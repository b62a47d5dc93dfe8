from typing import Any, Iterator

from . import wire as wire
from ._armplane import Arm as Arm, Law as Law, LawState as LawState, Posture as Posture, Reference as Reference, Singularity as Singularity
from .exchange import Exchange as Exchange, WireError as WireError
from .process import Controller as Controller, Observer as Observer, Operator as Operator, Plant as Plant, Process as Process
from .results import Run as Run, load as load, run as run

def subscribe(topic: str, run: str | None = None) -> Iterator[Any]: ...
