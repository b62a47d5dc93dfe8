"""Processes of a run: base classes. A subclass says what happens at a tick; `run()` does the rest."""

import sys
import traceback

from . import wire
from .exchange import Exchange, WireError


class Process:
    """A program's part in a run.

    `topics` has the messages of the process by topic, `job` scenario, robot and graph, `dof` the arm's joints, `dt` the length of a tick in s,
    `incarnation` how often the process has been started in this run.
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
        """Called once, before the program says that it is ready: loads models, reads `self.job`."""

    def tick(self, tick):
        """One tick; the messages are in `self.topics`. Returns true to end the run (only the process that makes the ticks can)."""
        raise NotImplementedError

    def is_fresh(self, topic):
        """Whether the message of a topic belongs to this tick; where not, the bytes are those of an earlier one."""
        return self.exchange.topics[topic].fresh

    def save(self):
        """The state that a replacement needs, as bytes (at most 4096); `None`: nothing. Called after each tick."""
        return None

    def restore(self, state):
        """Takes up what a predecessor's `save` returned."""

    @classmethod
    def run(cls):
        """Takes part in the run that started this program, to its end."""
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
                exchange.refuse(f"{type(error).__name__}: {error}")
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
        """Moves the arm by one tick. `torque` is the command (`wire.TorqueCommand`), `None` where none has come in this tick."""
        raise NotImplementedError

    def sample(self, tick, sensor, truth):
        """Fills the sensors' readings (`wire.SensorSample`) and the truth (`wire.PlantState`), which only judges and pictures see."""
        raise NotImplementedError

    def tick(self, tick):
        if tick > 0:
            self.step(self.topics["torque"] if self.is_fresh("torque") else None)
        self.sample(tick, self.topics["sensor"], self.topics["plant_state"])


class Controller(Process):
    """Computes the torque. The graph gives it `reads = ["estimate", "singularity"]`, `writes = ["control_state", "torque"]`."""

    def control(self, tick, estimate, singularity, state, torque):
        """Fills `torque` (`wire.TorqueCommand`) and `state` (`wire.ControlState`). Of `state` the judge takes `path_time_s` alone, the time come to on the
        scenario's path: it may wait, but neither jump nor go back, and must reach the end before the phase is `PHASE_DONE`."""
        raise NotImplementedError

    def tick(self, tick):
        self.control(tick, *(self.topics[name] for name in ("estimate", "singularity", "control_state", "torque")))


class Operator(Process):
    """Steers the arm. The graph (`extends = "servo"`) gives it `reads = ["sensor"]`, `writes = ["target"]`, or other topics to read."""

    def steer(self, tick, target, **messages):
        """Fills `target` (`wire.TargetContent`): kind, frame, validity, values. It holds what was asked for at the tick before."""
        raise NotImplementedError

    def tick(self, tick):
        messages = {name: message for name, message in self.topics.items() if name != "target"}
        target = self.topics["target"].target
        target.given_tick = tick
        self.steer(tick, target, **messages)


class Observer(Process):
    """Sees every tick; nobody waits for it in real time. The graph gives it `reads = [...]`, any topics."""

    def see(self, tick, **messages):
        """One tick: the message of each topic that has one."""
        raise NotImplementedError

    def tick(self, tick):
        self.see(tick, **{topic.name: topic.message for topic in self._topics if topic.fresh})
