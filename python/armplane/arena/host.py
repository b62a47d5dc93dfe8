"""Runs an opponent's file as the controller of a run: `python -m armplane.arena.host FILE.py`; without a run it loads the file, and says what is missing.
With the number of a pipe and a limit in seconds behind the file, it controls the trials that the standard input asks for, a line of JSON each.

    ARMPLANE_ARENA         JSON object of attributes laid over the class's own: {"k_p": 400}
    ARMPLANE_ARENA_COST    file to which a line is added at the end: microseconds that the law took for a tick
"""

import importlib.util
import json
import os
import sys
import time
import traceback

# One thread for each law: the same bits, and no fight for the cores.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np

import armplane
from armplane import wire

from ..drive import mask
from ..process import _place
from ..results import INSTALL
from .arm import Arm
from .laws import Law, Reference
from .pressing import Pressing


def load(path):
    """The class of the opponent in a file, with the attributes of the environment. Raises ValueError where there is not exactly one."""
    spec = importlib.util.spec_from_file_location("opponent", path)
    module = importlib.util.module_from_spec(spec)
    sys.path.append(os.path.dirname(os.path.abspath(path)))
    spec.loader.exec_module(module)
    found = [one for one in vars(module).values() if isinstance(one, type) and issubclass(one, Law) and one.__module__ == "opponent"]
    if len(found) != 1:
        raise ValueError(f"{path} defines {len(found)} opponents: define one class derived from Velocity, Torque or Position")
    for name, value in json.loads(os.environ.get("ARMPLANE_ARENA") or "{}").items():
        if not hasattr(found[0], name):
            raise ValueError(f"{path}: {found[0].__name__} has no attribute {name!r} to set")
        setattr(found[0], name, value)
    return found[0]


# Times the path's own duration, after which a law whose clock stands still is stopped: the judge then finds the path not done.
PATIENCE = 10
# β of a law that knows no neighbourhoods.
_UNBLENDED = (1.0,) * 4


class Host(armplane.Controller):
    """The process: reference, clock and limits around the law of a file."""

    # The clock's, and the tick in which the path ended.
    rate, ended = 1.0, None

    def begin(self, scenario):
        """Loads the law for the arm and as much of the scenario."""
        self.law, self.times, self.settle = load(sys.argv[1])(), [], scenario["settle_s"]
        self.law.begin(Arm(self.mjcf()), self.dt, scenario)
        # In place, as arrays: a tick is short.
        array, topics, n = np.ctypeslib.as_array, self.topics, self.dof
        self.q, self.qdot, self.tau = (array(values)[:n] for values in (topics["estimate"].q, topics["estimate"].qdot, topics["torque"].tau))
        self.R_d, self.p_d, self.V_d = (array(getattr(topics["control_state"], name)) for name in ("R_BE_d", "p_BE_d", "V_BE_d"))

    def setup(self):
        # What may be varied is not for the law to know.
        known = {key: value for key, value in self.job["scenario"].items() if key not in ("plant", "estimator", "fault", "seed")}
        self.begin(known)
        self.path = armplane.Reference(json.dumps(self.job))
        self.pressing, self.wrist, name = Pressing(self.dt), self.topics.get("wrist_force"), type(self.law).__name__
        if any(segment.get("force") for segment in known["segment"]):
            if not self.law.presses:
                raise ValueError(f"{name} controls no force: leave out `force`, or take a law that follows `ref.force` and says so with `presses = True`")
            if self.wrist is None:
                raise ValueError(f"{name} needs a sensor at the wrist: set plant.wrist_sensor = true, or extend the graph \"force\"")

    def control(self, tick, estimate, singularity, state, torque):
        q, qdot = self.q.copy(), self.qdot.copy()
        left = self.path.duration_s - self.path.time_s
        by = self.rate * self.dt if tick else 0
        # The last tick of the path ends on it.
        self.path.advance(max(left, 0) if left < by + 1e-9 else by, self.rate, q, qdot, bytes(singularity))
        if self.ended is None and (self.path.done or tick * self.dt > PATIENCE * self.path.duration_s):
            self.ended = tick
        pose = self.path.pose
        ref = Reference(pose[:3, :3], pose[:3, 3], self.path.twist, self.path.acceleration, self.path.leg, self.path.done)
        if self.wrist is not None:
            self.pressing.take(ref, self.path.force, *self.law.arm.pose(q), np.array(self.wrist.force_n))
        began = time.perf_counter_ns()
        tau = np.asarray(self.law.torque(q, qdot, ref), float).squeeze()
        self.times.append(time.perf_counter_ns() - began)
        if tau.shape != (self.dof,):
            raise ValueError(f"{type(self.law).__name__} gives torques of shape {tau.shape} at tick {tick}, not ({self.dof},)")
        if not np.isfinite(tau).all():
            raise ValueError(f"{type(self.law).__name__} gives a torque that is no number at tick {tick}")
        self.rate = 0.0 if self.pressing.waits else min(max(float(self.law.rate), 0.0), 1.0)
        state.path_time_s, state.segment = min(self.path.time_s, self.path.duration_s), ref.leg
        self._answer(tick, tau, ref, state, torque)

    def _answer(self, tick, tau, ref, state, torque):
        effort = self.law.arm.effort
        self.tau[:], beyond = tau.clip(-effort, effort), abs(tau) > effort
        torque.saturation_mask = mask(beyond) if beyond.any() else 0
        settled = 0 if self.ended is None else (tick - self.ended) * self.dt
        torque.phase = wire.PHASE_RUNNING if self.ended is None else wire.PHASE_SETTLING if settled < self.settle else wire.PHASE_DONE
        self.p_d[:], self.R_d[:], self.V_d[:] = ref.p, ref.R.T.ravel(), ref.V
        state.time_scale, state.null_scale, state.task_scale, state.beta[:] = self.rate, 1.0, 1.0, _UNBLENDED

    def end(self):
        file = os.environ.get("ARMPLANE_ARENA_COST")
        if file and self.times:
            # The first tick may compile.
            median, late = np.quantile(np.array(self.times[1:] or self.times) / 1e3, [0.5, 0.99]).tolist()
            with open(file, "a") as out:
                print(json.dumps({"median_us": median, "p99_us": late, "first_ms": self.times[0] / 1e6}), file=out)


class Guest(Host):
    """The same in a trial of this process. It keeps what it sends: the arena judges that, in a process of its own."""

    # The file for the messages, and the pipe on which it gives signs of life, with the longest time between two of them, s.
    file, answers, pause = "", -1, 0.0

    def setup(self):
        super().setup()
        self.sent, self.next_sign = bytearray(), 0.0

    def control(self, tick, estimate, singularity, state, torque):
        if (now := time.monotonic()) > self.next_sign:
            os.write(self.answers, b".")
            self.next_sign = now + self.pause
        super().control(tick, estimate, singularity, state, torque)
        self.sent += bytes(state)
        self.sent += bytes(torque)

    def end(self):
        super().end()
        with open(self.file, "wb") as out:
            out.write(self.sent)


def _words(error):
    """An error on one line."""
    return " ".join("".join(traceback.format_exception_only(type(error), error)).split())


def _serve(answers, limit):
    Guest.answers, Guest.pause = answers, limit / 10
    for line in sys.stdin:
        given = json.loads(line)
        os.environ.update(given["environment"])
        Guest.file = given["file"]
        try:
            armplane.trial(given["scenario"], given["settings"], controller=Guest)
        except BaseException as error:
            print(f"armplane: {_words(error)}{_place(error)}", file=sys.__stderr__, flush=True)
            os._exit(1)
        os.write(answers, b"\n")
    os._exit(0)


def main():
    if sys.argv[2:]:
        _serve(int(sys.argv[2]), float(sys.argv[3]))
    if "ARMPLANE_PROCESS" in os.environ:
        Host.run()
        # Python would take apart what large packages leave for longer than a process of a run has to stop.
        os._exit(0)
    try:
        law = load(sys.argv[1])
        print(json.dumps({"trials": law.trials, "has_clock": hasattr(law, "own_clock")}))
    except ImportError as error:
        sys.exit(f"{error}: {INSTALL.format('arena')}, for the Python {sys.executable}")
    except Exception as error:
        sys.exit(_words(error))


if __name__ == "__main__":
    main()
