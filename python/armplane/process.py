"""Base classes for processes of a run. A subclass defines one tick; `run()` does the rest."""

import sys
import traceback

from . import wire
from .exchange import Exchange, WireError


class Process:
    """A process of a run.

    `topics`: its messages by topic. `job`: scenario, robot and graph. `dof`: number of joints. `dt`: length of a tick, s. `incarnation`: number of
    starts of this process in this run.
    """

    def __init__(self, exchange):
        self.exchange = exchange
        self.job = exchange.job()
        self.dof = exchange.head.dof
        self.dt = 1.0 / exchange.head.rate_hz
        self.lockstep = exchange.head.lockstep != 0
        self.incarnation = exchange.head.incarnation
        self.topics = {name: topic.message for name, topic in exchange.topics.items()}
        self._topics = list(exchange.topics.values())

    def setup(self):
        """Called once before the first tick: load models, read `self.job`."""

    def tick(self, tick):
        """Called at each tick, with the messages in `self.topics`. The process that makes the ticks returns true to end the run."""
        raise NotImplementedError

    def is_fresh(self, topic):
        """Whether the message of a topic belongs to this tick. If not, it is an earlier one."""
        return self.exchange.topics[topic].fresh

    def save(self):
        """Called after each tick. Returns the state that a replacement needs, at most 4096 bytes, or `None`."""
        return None

    def restore(self, state):
        """Continues from the bytes that a predecessor's `save` returned."""

    @classmethod
    def run(cls):
        """Joins the run that started this program, and returns at its end."""
        # A line printed is a line in the log of the run, at once.
        sys.stdout.reconfigure(line_buffering=True)
        try:
            exchange = Exchange()
        except (WireError, OSError) as error:
            sys.exit(f"{cls.__name__}: {error}")
        try:
            process = cls(exchange)
            process.setup()
        except Exception as error:
            traceback.print_exc()
            try:
                exchange.refuse(f"setup failed: {type(error).__name__}: {error}; the log has the traceback")
            except WireError:
                sys.exit(1)
        exchange.ready()
        while True:
            request = exchange.next()
            try:
                if request == wire.REQUEST_TICK:
                    over = process.tick(exchange.head.tick)
                    state = process.save()
                    if state is not None:
                        exchange.state = state
                    exchange.answer(wire.ANSWER_OVER if over else wire.ANSWER_DONE)
                elif request == wire.REQUEST_START:
                    state = exchange.state
                    if state is not None:
                        process.restore(state)
                    exchange.answer()
                else:
                    process.end()
                    if exchange.reason:
                        print(exchange.reason, file=sys.stderr)
                    return
            except Exception as error:
                traceback.print_exc()
                exchange.fail(f"{type(error).__name__}: {error}")
                sys.exit(1)

    def end(self):
        """Called at the end of the run."""


class Plant(Process):
    """Makes the ticks: moves the arm and reads its sensors. The graph gives it `feedback = ["torque"]`, `writes = ["sensor", "plant_state"]`."""

    def step(self, torque):
        """Moves the arm by one tick. `torque` is the command (`wire.TorqueCommand`), or `None` if none arrived for this tick."""
        raise NotImplementedError

    def sample(self, tick, sensor, truth):
        """Fills in the sensors' readings (`wire.SensorSample`) and the truth (`wire.PlantState`), which only the judge and the pictures see."""
        raise NotImplementedError

    def tick(self, tick):
        if tick > 0:
            self.step(self.topics["torque"] if self.is_fresh("torque") else None)
        self.sample(tick, self.topics["sensor"], self.topics["plant_state"])


class Controller(Process):
    """Computes the torque. The graph gives it `reads = ["estimate", "singularity"]`, `writes = ["control_state", "torque"]`."""

    def control(self, tick, estimate, singularity, state, torque):
        """Fills in `torque` (`wire.TorqueCommand`) and `state` (`wire.ControlState`). From `state`, the judge takes only `path_time_s`, the time reached on the
        scenario's path. It may pause, but must not jump or go back, and must reach the end before the phase is `PHASE_DONE`."""
        raise NotImplementedError

    def tick(self, tick):
        self.control(tick, *(self.topics[name] for name in ("estimate", "singularity", "control_state", "torque")))


class Operator(Process):
    """Steers the arm. The graph (`extends = "servo"`) gives it `reads = ["sensor"]`, `writes = ["target"]`, or other topics to read."""

    def steer(self, tick, target, **messages):
        """Fills in `target` (`wire.TargetContent`): kind, frame, validity, values. It still holds the target of the previous tick."""
        raise NotImplementedError

    def tick(self, tick):
        messages = {name: message for name, message in self.topics.items() if name != "target"}
        target = self.topics["target"].target
        target.given_tick = tick
        self.steer(tick, target, **messages)


class Observer(Process):
    """Sees every tick. In real time, no process waits for it. The graph gives it `reads = [...]`, any topics."""

    def see(self, tick, **messages):
        """Called at each tick, with the message of each topic that has a new one."""
        raise NotImplementedError

    def tick(self, tick):
        self.see(tick, **{topic.name: topic.message for topic in self._topics if topic.fresh})
