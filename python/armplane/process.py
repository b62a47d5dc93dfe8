"""Base classes for processes of a run. A subclass defines one tick; `run()` does the rest."""

import functools
import inspect
import os
import re
import sys
import threading
import traceback

from .joined import Joined, ProcessError


def _ending(hook):
    """A hook for an error that Python prints and ignores, in a thread, in `__del__` or at its end: it ends the program, for a traceback is no success."""

    def ends(error):
        hook(error)
        if error.exc_type is not SystemExit:
            sys.stderr.flush()
            os._exit(1)

    return ends


def _required(method):
    """A method that the subclass has to define."""

    @functools.wraps(method)
    def lacks(self, *_, **__):
        raise NotImplementedError(f"{type(self).__name__} lacks the method {method.__name__}{inspect.signature(method)}")

    return lacks


def _place(error):
    """Where in the user's own files it came from."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not frame.filename.startswith((sys.prefix, sys.base_prefix, os.path.dirname(__file__), "<"))]
    return f" ({os.path.basename(own[-1].filename)}, line {own[-1].lineno})" if own else ""


def _remedy(error, dof):
    """The hint that ctypes lacks where an array of a message is given a wrong number of values."""
    return f": fill arrays as in `torque.tau[:self.dof] = tau`, self.dof is {dof}" if re.search("_Array_|of same size", str(error)) else ""


class Process:
    """A process of a run.

    `topics`: its messages by topic. `now.tick`: the tick in hand. `job`: scenario, robot and graph. `dof`: number of joints. `dt`: length of a tick, s.
    `incarnation`: number of starts of this process in this run.
    """

    _GIVEN = ("joined", "now", "job", "dof", "dt", "lockstep", "incarnation", "topics")

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        for name, value in vars(cls).items():
            cls._check_name(name, value)
        if (cls.state is Process.state) != (cls.restore is Process.restore):
            raise TypeError(f"{cls.__name__} has only one of state and restore: armplane calls both, to go on after a death")

    @classmethod
    def _check_name(cls, name, value):
        """A name of ours means what we take it for: `end = 2.5` would hide the method `end`."""
        ours = next((base for base in cls.__mro__ if base.__module__ == __name__ and name in vars(base)), None)
        is_method = ours and not name.startswith("_") and not (callable(value) or isinstance(value, (classmethod, staticmethod)))
        if name in cls._GIVEN or is_method:
            raise TypeError(f"{cls.__name__} sets {name}, which hides armplane.{(ours or Process).__name__}.{name}: choose another name")

    def __init__(self, joined):
        self.joined, self.now, self.job = joined, joined.now, joined.job
        self.dof, self.dt = joined.now.dof, 1 / joined.now.rate_hz
        self.lockstep, self.incarnation = joined.now.lockstep != 0, joined.now.incarnation
        self.topics = {**joined.inputs, **joined.outputs}
        self._given = {name: getattr(self, name) for name in self._GIVEN}

    def setup(self):
        """Called once before the first tick: load models, read `self.job`."""

    @_required
    def tick(self, tick):
        """Called at each tick, with the messages in `self.topics`. The process that makes the ticks returns true to end the run."""

    def is_fresh(self, topic):
        """Whether the message of a topic belongs to this tick. If not, it is an earlier one."""
        return self.joined.is_fresh(topic)

    def view(self, topic):
        """The message of a topic that is read, in shared memory: without a copy, and valid in this tick only. `None` if none has come."""
        return self.joined.view(topic)

    def mjcf(self):
        """The arm of the run in MJCF, for `armplane.mujoco.Arm`."""
        return self.joined.mjcf()

    def state(self):
        """The bytes, at most 1 MiB, that `restore` needs to go on after this tick. Called where they are kept: every 1,000th tick, in real time each tick."""
        return None

    def restore(self, state):
        """Continues from the bytes of `state`. Without this pair, a process that is started again is given all its ticks anew, and must answer them as before;
        in real time, it begins anew."""

    @classmethod
    def run(cls):
        """Joins the run that started this program, and returns at its end."""
        # A line printed is a line in the log of the run, at once.
        sys.stdout.reconfigure(line_buffering=True)
        threading.excepthook, sys.unraisablehook = _ending(threading.excepthook), _ending(sys.unraisablehook)
        try:
            joined = Joined()
        except (ProcessError, OSError) as error:
            sys.exit(f"armplane: {error}")
        try:
            cls(joined)._take_part()
        except ProcessError:
            # The library has the sentence.
            pass
        except (Exception, SystemExit) as error:
            # Also an orderly exit: the run goes on without this process.
            traceback.print_exc()
            joined.fail(f"{type(error).__name__}: {error}{_place(error)}{_remedy(error, joined.now.dof)}")
        sys.stdout.flush()
        if code := joined.leave():
            sys.exit(code)

    def _begin(self):
        if not hasattr(self, "_given"):
            raise TypeError(f"{type(self).__name__}.__init__ does not call super().__init__(joined): do that first, or define setup(self) instead")
        self.setup()
        for name, value in vars(self).items():
            if value is not self._given.get(name, self):
                self._check_name(name, value)

    def _take_part(self):
        self._begin()
        joined, now, tick = self.joined, self.now, self.tick
        if (left := joined.previous) is not None:
            self.restore(left)
        wait, send = joined.wait, joined.send
        while wait():
            over = tick(now.tick)
            if now.keeps and (state := self.state()) is not None:
                joined.keep(state)
            send(over)
        self.end()

    def end(self):
        """Called at the end of the run."""


class Plant(Process):
    """Makes the ticks: moves the arm and reads its sensors. The graph gives it `feedback = ["torque"]`, `writes = ["sensor", "plant_state"]`."""

    @_required
    def step(self, torque):
        """Moves the arm by one tick. `torque` is the command (`wire.TorqueCommand`), or `None` if none arrived for this tick."""

    @_required
    def sample(self, tick, sensor, truth):
        """Fills in the sensors' readings (`wire.SensorSample`) and the truth (`wire.PlantState`), which only the judge and the pictures see."""

    def tick(self, tick):
        if tick > 0:
            self.step(self.topics["torque"] if self.is_fresh("torque") else None)
        self.sample(tick, self.topics["sensor"], self.topics["plant_state"])


class Controller(Process):
    """Computes the torque. The graph gives it `reads = ["estimate", "singularity"]` or the first alone, and `writes = ["control_state", "torque"]`."""

    @_required
    def control(self, tick, estimate, singularity, state, torque):
        """Fills in `torque` (`wire.TorqueCommand`) and `state` (`wire.ControlState`). From `state`, the judge takes only `path_time_s`, the time reached on the
        scenario's path. It may pause, but must not jump or go back, and must reach the end before the phase is `PHASE_DONE`. `singularity` is `None` where the
        graph does not read it."""

    def tick(self, tick):
        topics = self.topics
        self.control(tick, topics["estimate"], topics.get("singularity"), topics["control_state"], topics["torque"])


class Operator(Process):
    """Steers the arm. The graph (`extends = "servo"`) gives it `reads = ["sensor"]`, `writes = ["target"]`, or other topics to read."""

    @_required
    def steer(self, tick, target, **messages):
        """Fills in `target` (`wire.TargetContent`): kind, frame, validity, values. It still holds the target of the previous tick."""

    def tick(self, tick):
        target = self.joined.outputs["target"].target
        target.given_tick = tick
        self.steer(tick, target, **self.joined.inputs)


class Observer(Process):
    """Sees every tick. In real time, no process waits for it. The graph gives it `reads = [...]`, any topics."""

    @_required
    def see(self, tick, **messages):
        """Called at each tick, with the message of each topic that has a new one."""

    def tick(self, tick):
        self.see(tick, **{name: message for name, message in self.joined.inputs.items() if self.is_fresh(name)})
