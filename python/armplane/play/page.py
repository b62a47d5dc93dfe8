"""The page: one loop that takes in what people ask for, steers the run, and shows it."""

import collections
import contextlib
import io
import json
import pathlib
import queue
import shutil
import tempfile
import threading
import time

import numpy as np
import viser
from viser.transforms import SO3

from .. import Arm, wire
from ..results import _next_folder
from . import door, panel
from .scene import Scene, quaternion
from .session import Session, clean

RATE_HZ = 40
# So long nobody touches the page before the arm goes on tour, s.
PATIENCE_S = 4.0
# A session longer than this ends at the next moment without a hand on it, s: its recording grows by 2 MB a second.
FULL_S = 120
LAWS = ("blended", "chang-khatib", "damped-least-squares", "truncated-svd", "operational-space", "hold-and-blend", "joint-pd")
FAULTS = {
    "kill controller": ("controller", "kill"),
    "noise": ("plant", "sensor", "--as", "noise", "--joint", "2", "--amount", "0.001", "--for", "1s"),
    "delay": ("controller", "delay", "--delay", "3", "--for", "0.5s"),
}
NOBODY = "none"


class Server(viser.ViserServer):
    """Without viser's tunnel, which would show the page to the world."""

    def request_share_url(self, *_, **__):
        return None


class Page:
    """Everything here happens on the thread that calls `run`; callbacks of the browser only put actions into a queue."""

    def __init__(self, subject, folder, host, port, token):
        self.folder, self.actions = folder, queue.Queue()
        self.story = collections.deque(["Drag the yellow ball."], maxlen=4)
        self.driver, self.touched, self.dragging, self.failures = None, time.monotonic(), False, 0
        self.session, self.ghost, self.scene, self.ending, self.settings, self.arrivals = None, None, None, [], [], 0
        self.law, self.rival, self.clients, self.updates = LAWS[0], None, 0, collections.deque(maxlen=RATE_HZ)
        # viser prints a box with addresses, without the token.
        with door.guarded(token), contextlib.redirect_stdout(io.StringIO()):
            self.server = Server(host=host, port=port, verbose=False, label="armplane play")
        self.server.gui.configure_theme(dark_mode=True, control_width="large", show_logo=False, show_share_button=False, brand_color=(214, 51, 164))
        self.server.on_client_connect(lambda client: client.camera.on_update(lambda _: self.actions.put(lambda: self._look(client.client_id))))
        self.server.on_client_disconnect(lambda client: self.actions.put(lambda: self._leave(client.client_id)))
        self.html = self.server.gui.add_html("")
        self._add_controls()
        self.subject, self.home = subject, None
        self._begin(None)

    # The controls.

    def _add_controls(self):
        gui = self.server.gui
        self.places = gui.add_folder("Go to")
        with self.places:
            self.speed = gui.add_slider("speed, m/s", 0.05, 0.5, 0.05, 0.3)
            self.tours = gui.add_checkbox("tour when idle", True)
        with gui.add_folder("Arm and law"):
            names = [name for name in Arm.names() if not name.startswith("planar")]
            self.arms = gui.add_dropdown("arm", names)
            self.laws = gui.add_dropdown("law", LAWS)
            self.rivals = gui.add_dropdown("race against", [NOBODY, *LAWS[1:]])
        with gui.add_folder("Faults and recording"):
            faults = gui.add_button_group("inject", tuple(FAULTS), hint="kill the controller; noise on encoder 2 for 1 s; delay its messages by 3 ms for 0.5 s")
            save = gui.add_button("Save this run", icon="device-floppy")
        with gui.add_folder("Joints and more", expand_by_default=False) as self.more:
            take = gui.add_button("Take the hand from the other page")
        self.sliders, self.buttons = [], None
        self._on(self.arms.on_update, lambda event: self._change_arm(event.target.value))
        self._on(self.laws.on_update, lambda event: self._change_law(event.target.value))
        self._on(self.rivals.on_update, lambda event: self._change_rival(event.target.value))
        self._on(faults.on_click, lambda event: self._inject(event.target.value))
        self._on(save.on_click, lambda _: self._save())
        for control in (self.speed, self.tours):
            self._on(control.on_update, lambda _: None)
        take.on_click(lambda event: self.actions.put(lambda: self._take(event.client_id)))

    def _on(self, attach, action):
        """Queues what the person who steers does; tells everybody else that somebody steers."""

        def call(event):
            if event.client_id is not None:
                self.actions.put(lambda: self._may(event) and action(event))

        attach(call)

    def _may(self, event):
        if self.driver is None:
            self.driver = event.client_id
        if self.driver != event.client_id:
            event.client.add_notification("Somebody else steers", "You watch. Under “Joints and more” you can take the hand.", auto_close_seconds=4.0)
            return False
        self._touch()
        return True

    def _touch(self):
        """Ends the tour, and puts the next one off."""
        self.touched = time.monotonic()
        if self.mode == "tour":
            self._hold()

    def _take(self, client):
        self.driver, self.touched, self.dragging = client, time.monotonic(), False

    def _look(self, client):
        """Whoever turns the camera wants to look for himself: no tour meanwhile."""
        if self.driver in (None, client):
            self._touch()

    def _leave(self, client):
        if self.driver == client:
            self.driver, self.dragging = None, False

    def _add_places(self):
        """Buttons for the postures of this arm, as soon as they have been found."""
        robot, home = self.scene.robot, self.home

        def search():
            found = {"start": home}
            for place, name in enumerate(robot.singular_names):
                if (q := robot.near(place, home)) is not None:
                    found[name] = q
            self.actions.put(lambda: self._show_places(robot, found))

        threading.Thread(target=search, daemon=True).start()

    def _show_places(self, robot, found):
        if robot is not self.scene.robot:
            return
        self.postures = found
        with self.places:
            self.buttons = self.server.gui.add_button_group("near", tuple(found), order=0.0)
        self._on(self.buttons.on_click, lambda event: self._go(found[event.target.value]))
        with self.more:
            for i in range(robot.dof):
                low, high = float(np.floor(np.degrees(robot.lower[i]))), float(np.ceil(np.degrees(robot.upper[i])))
                self.sliders.append(self.server.gui.add_slider(f"joint {i + 1}, °", low, high, 1.0, low))
                self._on(self.sliders[i].on_update, lambda event, i=i: self._turn(i, np.radians(event.target.value)))

    # Runs.

    def _new(self, law, start):
        return Session(self.subject, self.folder, start, law, self.settings)

    def _begin(self, start):
        """A new run of this arm, in the posture in which it is, or in its own start posture."""
        self.mode, self.posture, self.goal, self.sent = "hold", None, None, None
        if self.session:
            self.session.end()
            self.ending.append(self.session)
        self.session = self._new(None if self.law == LAWS[0] else self.law, start)
        if self.ghost:
            self._change_rival(self.rival, start)

    def _posture(self):
        robot = self.scene.robot
        return np.clip(self.session.q, robot.lower + 1e-6, robot.upper - 1e-6)

    def _change_arm(self, name):
        if name not in Arm.names():
            return
        self.rivals.value = NOBODY
        self._change_rival(NOBODY)
        self.subject, self.home, self.settings = name, None, []
        self._begin(None)

    def _change_law(self, law):
        self.law = law
        self._tell(f"The arm goes on under {law}.")
        self._begin(self._posture())

    def _change_rival(self, law, start=None):
        if self.ghost:
            self.ghost.end()
            self.ending.append(self.ghost)
        self.ghost, self.rival = None, None if law == NOBODY else law
        if self.scene:
            self.scene.set_ghost(None)
        if self.rival:
            self.ghost = self._new(law, self._posture() if start is None else start)

    def _save(self):
        if self.session.seen:
            kept = _next_folder(f"play-{self.scene.robot.name}")
            try:
                kept.parent.mkdir(exist_ok=True)
                tempfile.TemporaryFile(dir=kept.parent).close()
            except OSError as error:
                return self._tell(f"The run cannot be saved in {kept.parent.absolute()}: {error.strerror}. Start armplane play in a folder in which you may write.")
            self.session.kept = kept
            self._tell("The run is being saved; the arm goes on in a new one.")
            self._begin(self._posture())

    def _inject(self, name):
        session = self.session
        work = lambda: self._tell(session.fault(*FAULTS[name]).splitlines()[-1])
        threading.Thread(target=work, daemon=True).start()

    def _tell(self, sentence):
        self.story.append(sentence)

    def _look_after_runs(self):
        for session in [one for one in self.ending if one.ended()]:
            self.ending.remove(session)
            if kept := getattr(session, "kept", None):
                try:
                    self._keep(session, kept)
                except OSError as error:
                    self._tell(f"The run could not be saved as {kept}: {error.strerror}.")
            shutil.rmtree(session.folder, ignore_errors=True)
        has_ended = self.session.process.poll() is not None
        if has_ended:
            self.session.listener.join(1.0)
        while self.session.lines:
            self._tell(self.session.lines.popleft())
        if self.ghost and self.ghost.process.poll() is not None:
            self._tell(f"The ghost's run has ended. {' '.join(self.ghost.lines)}")
            self.rivals.value = NOBODY
            self._change_rival(NOBODY)
        if has_ended:
            self._recover()

    def _keep(self, session, kept):
        shutil.move(session.folder / "run", kept)
        # Without the page, which has only watched: the run repeats itself in the graph of every steered run.
        scenario = kept / "scenario.toml"
        text = scenario.read_text().splitlines(keepends=True)
        scenario.write_text("".join(line for line in text if not line.startswith(("graph =", "checksums ="))))
        (kept / "graph.toml").unlink()
        self._tell(f"Saved. Look: armplane view {kept}. The same bytes again: armplane run {kept}/scenario.toml")

    def _recover(self):
        """The run has ended by itself: begins another one, in the posture in which the arm was left."""
        self.failures = self.failures + 1 if time.monotonic() - self.session.began < 10 else 1
        if self.session.seen is None and self.home is None or self.failures > 3:
            raise SystemExit(f"armplane play: {self.story[-1].removeprefix('armplane: ')}")
        if self.session.process.returncode < 0:
            clean()
        self._tell("The run has ended; another one begins.")
        self._begin(self._posture() if self.session.seen and self.scene else self.home)

    # Steering.

    def _hold(self):
        """The target is where the hand is."""
        R, p = self.scene.robot.frames(self.session.q)[-1]
        self.mode, self.posture, self.goal, self.sent = "hold", None, (p, quaternion(R)), (p, SO3.from_matrix(R))

    def _go(self, q):
        self._hold()
        R, p = self.scene.robot.frames(q)[-1]
        self.mode, self.posture, self.goal = "posture", np.clip(q, self.scene.robot.lower, self.scene.robot.upper), (p, quaternion(R))

    def _turn(self, joint, angle):
        q = self._posture()
        q[joint] = angle
        self._go(q)

    def _drag(self, position, wxyz, phase):
        if self.mode != "hand":
            self._hold()
        self.mode, self.dragging = "hand", phase != "end"
        self.goal = (np.array(position), np.array(wxyz))
        # The time to the arm's answer is taken when the hand rests and the target begins to move.
        state = self.session.seen["plant_state"]
        if self.session.asked is None and np.abs(state.V_BE).max() < 2e-3 and np.linalg.norm(self.goal[0] - state.p_BE) > 5e-3:
            self.session.asked = time.monotonic()

    def _on_grip(self, event):
        """The ball is dragged in the plane of the picture."""
        if event.phase == "start" or not hasattr(self, "offset"):
            self.offset = np.array(event.end_position) - self.scene.target.position
        position = np.array(event.end_position) - self.offset
        self.scene.target.position = position
        self._drag(position, self.scene.target.wxyz, event.phase)

    def _lines(self, dt):
        """The target of this moment, as `armplane servo --from -` reads it."""
        text = lambda *values: " ".join(f"{x:.7g}" for part in values for x in np.atleast_1d(part))
        if self.mode == "tour":
            return self._guide()
        if self.mode == "posture":
            if np.abs(self.session.q - self.posture).max() < 0.01:
                self._hold()
                self.arrivals += 1
            else:
                return f"posture, joints, 0.5, {text(self.posture)}"
        p, R = self.sent
        way, turn = self.goal[0] - p, (SO3(self.goal[1]) @ R.inverse()).log()
        slow = lambda value, most: value * min(8.0, most / max(float(np.linalg.norm(value)), 1e-9))
        v, w = slow(way, self.speed.value), slow(turn, 3 * self.speed.value)
        self.sent = p, R = p + v * dt, SO3.exp(w * dt) @ R
        return f"pose, base, 0.3, {text(p, R.wxyz / np.linalg.norm(R.wxyz), v, w)}"

    def _guide(self):
        """The tour: near each singularity, along ζ and back, home."""
        if not self.stops:
            self.stops = [(name, q, x) for name, q in self.postures.items() for x in ((0,) if name == "start" else (0, 1, -1, 1))]
            self.since = time.monotonic()
        name, q, x = self.stops[0]
        past = time.monotonic() - self.since
        arrived = np.abs(self.session.q - q).max() < 0.02 or past > 8
        if arrived if x == 0 else past > (2.4 if x < 0 else 1.2):
            self.stops, self.since = self.stops[1:], time.monotonic()
        if x == 0:
            return "posture, joints, 0.5, " + " ".join(f"{value:.7g}" for value in q)
        servo, report = self.session.seen["servo_state"], self.session.seen["singularity"]
        angular = servo.singularity > 0 and report.singularities[servo.singularity - 1].angular
        return f"twist, singular, 0.3, {'0 0 0 ' if angular else ''}{(0.5 if angular else 0.08) * x:.3g} 0 0{'' if angular else ' 0 0 0'}"

    # The loop.

    def run(self):
        """Until the process is told to end."""
        due, number = time.monotonic(), 0
        try:
            while True:
                self._look_after_runs()
                # A run that has just begun has no state for an action yet.
                if self.session.seen is not None:
                    if self.scene is None or self.home is None:
                        self._meet(self.session)
                    if self.sent is None:
                        self._hold()
                    while self.session.seen is not None and not self.actions.empty():
                        self.actions.get()()
                    if self.session.seen is not None:
                        self._step(number)
                due, number = max(due + 1 / RATE_HZ, time.monotonic() - 0.2), number + 1
                time.sleep(max(0.0, due - time.monotonic()))
        finally:
            self.close()

    def _step(self, number):
        session = self.session
        self.clients, idle = len(self.server.get_clients()), time.monotonic() - self.touched
        if self.mode in ("hold", "hand") and not self.dragging and idle > PATIENCE_S:
            if time.monotonic() - session.began > FULL_S:
                self._tell("Two minutes are recorded: a new run begins.")
                return self._begin(self._posture())
            if self.clients and self.tours.value and len(getattr(self, "postures", ())) > 1:
                self.mode, self.stops = "tour", []
        if self.mode == "tour" and not self.clients:
            self._hold()
        line = self._lines(1 / RATE_HZ)
        for one in filter(None, (session, self.ghost)):
            one.say(line)
        with self.server.atomic():
            self._show(session, number)

    def _show(self, session, number):
        seen, ghost = session.seen, self.ghost
        self.scene.show(seen, None if self.mode == "tour" else self.goal, self.dragging)
        if ghost and ghost.seen:
            if self.scene.ghost is None:
                self.scene.set_ghost(ghost.robot)
                self.ghost_is_red = False
            self.scene.ghost.move(ghost.q)
            if not self.ghost_is_red and ghost.peaks.max() >= panel.AT_LIMIT:
                self.scene.ghost.colour((255, 60, 60))
                self.ghost_is_red = True
        self.updates.append(time.monotonic())
        if number % 20 == 0 and self.mode != "posture":
            for slider, angle in zip(self.sliders, np.degrees(session.q)):
                slider.value = float(np.clip(round(angle), slider.min, slider.max))
        if number % 4 == 0:
            self.html.content = panel.page(session.robot, seen, ghost, "\n".join(self.story), self._foot(session, seen))

    def _foot(self, session, seen):
        rate = (len(self.updates) - 1) / max(self.updates[-1] - self.updates[0], 1e-3) if len(self.updates) > 1 else 0.0
        latency = getattr(session, "latency", None)
        hand, servo = list(seen["plant_state"].p_BE), seen["servo_state"]
        state = {
            "camera": {"position": self.server.initial_camera.position.tolist(), "look_at": self.server.initial_camera.look_at.tolist(), "fov": self.server.initial_camera.fov},
            "mode": self.mode, "robot": session.robot.name, "run": session.run, "hand": hand, "target": [*map(float, self.scene.target.position)],
            "reason": servo.reason, "nearest": servo.nearest, "updates": rate, "latency_s": latency, "arrivals": self.arrivals,
            "peaks": session.peaks.max(axis=1).tolist(), "places": [*getattr(self, "postures", ())], "ghost": self.ghost is not None and self.ghost.seen is not None,
        }
        words = [{"tour": "on tour: touch anything to end it", "hand": "your hand", "posture": "goes to a posture", "hold": "holds"}[self.mode], f"{rate:.0f} updates/s"]
        words += [f"target to arm {1000 * latency:.0f} ms"] if latency and self.mode == "hand" else []
        words.append(f"{self.clients} watching, one steers" if self.clients > 1 else "")
        return f"<span class='state' data-state='{json.dumps(state)}'></span>{' · '.join(filter(None, words))}"

    def _meet(self, session):
        """The first tick of an arm that has not been shown yet."""
        for one in [*self.sliders, *([self.buttons] if self.buttons else [])]:
            one.remove()
        self.sliders, self.buttons, self.postures, self.home = [], None, {}, session.q
        floor, name = session.job["scenario"]["plant"].get("floor_m"), session.robot.name
        self.scene = Scene(self.server, session.robot, 0.0 if floor is None else floor, session.q)
        if name not in self.arms.options:
            self.arms.options = (*self.arms.options, name)
        self.arms.value = name
        drag = lambda event: self._drag(event.target.position, event.target.wxyz, event.phase)
        self._on(self.scene.target.on_update, drag)
        self._on(self.scene.grip.on_drag("left"), self._on_grip)
        scenario = session.job["scenario"]
        if self.subject not in Arm.names():
            # A scenario's robot, from now on without its path.
            robot, beside = scenario["robot"], pathlib.Path(self.subject).parent
            self.subject = robot if robot in Arm.names() else str(beside / robot if self.subject.endswith(".toml") else self.subject)
            self.settings = [f"frame={scenario['frame']}"] if scenario["frame"] else []
        self._add_places()

    def close(self):
        """Ends the runs, and waits for them."""
        self.ending += [one for one in (self.session, self.ghost) if one]
        for one in self.ending:
            if not hasattr(one, "ending"):
                one.end()
        while any(not one.ended() for one in self.ending):
            time.sleep(0.02)
