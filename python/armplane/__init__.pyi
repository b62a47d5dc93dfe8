from typing import Any, Iterator

from . import wire as wire
from ._armplane import Arm as Arm, Law as Law, LawState as LawState, Posture as Posture, Reference as Reference, Singularity as Singularity
from .joined import Joined as Joined, ProcessError as ProcessError
from .process import Controller as Controller, Observer as Observer, Operator as Operator, Plant as Plant, Process as Process
from .results import Run as Run, load as load, run as run
from .trials import laws as laws, lines as lines, trace as trace, trial as trial

def subscribe(topic: str, run: str | None = None) -> Iterator[Any]: ...
