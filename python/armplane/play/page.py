"""The page: one loop that takes in what people ask for, steers the run, and shows it."""

import collections
import contextlib
import io
import itertools
import json
import logging
import pathlib
import queue
import socket
import threading
import time
import webbrowser

import numpy as np
import viser
from viser.transforms import SO3

from .. import Arm
from ..arena.__main__ import strategies
from ..results import _next_folder
from . import door, panel
from .scene import Scene, quaternion
from .session import FILES, Session

RATE_HZ = 40
# So long nobody touches the page before the arm goes on tour, s.
PATIENCE_S = 4.0
# A session longer than this ends at the next moment without a hand on it, s: its recording grows by 2 MB a second.
FULL_S = 120
FAULTS = {
    "kill controller": ("controller", "kill"),
    "noise": ("plant", "sensor", "--as", "noise", "--joint", "2", "--amount", "0.001", "--for", "1s"),
    "delay": ("controller", "delay", "--delay", "3", "--for", "0.5s"),
}
NOBODY = "none"
# Whoever steers may pause so long, s.
KEEPS_S = 10
MODES = {"tour": "on tour: touch anything to end it", "hand": "your hand", "posture": "goes to a posture", "hold": "holds"}


class Page:
    """Everything here happens on the thread that calls `run`; callbacks of the browser only put actions into a queue."""

    def __init__(self, given, folder, keeper, token):
        self.given, self.token, self.room, self.actions = given, token, (folder, keeper), queue.Queue()
        self.story = collections.deque(["Drag the yellow ball."], maxlen=4)
        self.driver, self.touched, self.failures, self.arrivals = None, time.monotonic(), 0, 0
        self.subject, self.settings, self.law, self.home = given.subject, [], None, None
        self.session, self.ghost, self.scene, self.ended = None, None, None, []
        # viser prints a box with addresses, without the token.
        with door.guarded(token), contextlib.redirect_stdout(io.StringIO()):
            self.server = viser.ViserServer(host=given.host, port=given.port, verbose=False, label="armplane play")
        # viser's tunnel would show the page to the world; a stranger's broken request is no error of ours.
        self.server.request_share_url = lambda *_, **__: None
        logging.getLogger("websockets").setLevel(logging.CRITICAL)
        self.server.gui.configure_theme(dark_mode=True, control_width="large", show_logo=False, show_share_button=False, brand_color=(214, 51, 164))
        self.server.on_client_connect(self._greet)
        self._add_controls()
        self._begin(None)

    # The controls.

    def _add_controls(self):
        gui = self.server.gui
        self.html, self.state = gui.add_html(""), gui.add_html("")
        with gui.add_folder("Go to") as self.places:
            self.speed = gui.add_slider("speed, m/s", 0.05, 0.5, 0.05, 0.3)
            self.tours = gui.add_checkbox("tour when idle", True)
        with gui.add_folder("Arm and law"):
            self.arms = gui.add_dropdown("arm", [name for name in Arm.names() if not name.startswith("planar")])
            self.laws = gui.add_dropdown("law", strategies())
            self.rivals = gui.add_dropdown("race against", [NOBODY, *strategies(), *FILES])
        with gui.add_folder("Faults and recording"):
            faults = gui.add_button_group("inject", tuple(FAULTS), hint="kill the controller; noise on encoder 2 for 1 s; delay its messages by 3 ms for 0.5 s")
            save = gui.add_button("Save this run", icon="device-floppy")
        self.joints = gui.add_folder("Joints", expand_by_default=False)
        # Those of one arm: its buttons and sliders.
        self.own, self.sliders = [], []
        self._on(self.arms.on_update, lambda event: self._change_arm(event.target.value))
        self._on(self.laws.on_update, lambda event: self._change_law(event.target.value))
        self._on(self.rivals.on_update, lambda _: self._race(self._posture()))
        self._on(faults.on_click, lambda event: self._inject(event.target.value))
        self._on(save.on_click, lambda _: self._save())
        for control in (self.speed, self.tours):
            self._on(control.on_update, lambda _: None)

    def _on(self, attach, action):
        """Queues what the person who steers does; tells everybody else that somebody steers."""

        def call(event):
            if event.client_id is not None:
                self.actions.put(lambda: self._may(event) and action(event))

        attach(call)

    def _greet(self, client):
        if self.scene:
            self.scene.aim(client)
        client.camera.on_update(lambda _: self.actions.put(lambda: self._look(client.client_id)))

    def _may(self, event):
        """Whether a browser may steer: one keeps the hand until it has not touched it for a while."""
        if self.driver not in self.server.get_clients() or time.monotonic() - self.touched > KEEPS_S:
            self.driver = event.client_id
        if self.driver != event.client_id:
            event.client.add_notification("Somebody else steers", f"You watch. The hand is yours when nobody has touched it for {KEEPS_S} s.", auto_close_seconds=4.0)
            return False
        self._touch()
        return True

    def _touch(self):
        """Ends the tour, and puts the next one off."""
        self.touched = time.monotonic()
        if self.mode == "tour":
            self._hold()

    def _look(self, client):
        """Whoever turns the camera wants to look for himself: no tour meanwhile."""
        if self.driver is None or self.driver == client:
            self._touch()

    def _search(self, robot, home):
        """Buttons for the postures of this arm, as soon as they have been found."""
        found = {"start": home, **robot.near(home)}
        self.actions.put(lambda: robot is self.scene.robot and self._show_places(robot, found))

    def _show_places(self, robot, found):
        self.postures, gui = found, self.server.gui
        with self.places:
            self.own.append(gui.add_button_group("near", tuple(found), order=0.0))
        self._on(self.own[-1].on_click, lambda event: self._go(found[event.target.value]))
        with self.joints:
            for i, (low, high) in enumerate(np.degrees([robot.lower, robot.upper]).T):
                self.sliders.append(gui.add_slider(f"joint {i + 1}, °", float(np.floor(low)), float(np.ceil(high)), 1.0, float(np.floor(low))))
                self._on(self.sliders[i].on_update, lambda event, i=i: self._turn(i, np.radians(event.target.value)))

    # Runs.

    def _begin(self, start, kept=None):
        """A new run of this arm, in the posture in which it is, or in its own start posture; the ghost begins anew beside it."""
        self.mode, self.posture, self.goal, self.sent = "hold", None, None, None
        self._end(self.session, kept)
        self.session = Session(self.subject, *self.room, start, self.law, self.settings)
        self._race(start)

    def _race(self, start):
        self._end(self.ghost)
        law, self.ghost = self.rivals.value, None
        if self.scene:
            self.scene.remove_ghost()
        if law != NOBODY:
            self.ghost = Session(self.subject, *self.room, start, law, self.settings)

    def _end(self, session, kept=None):
        if session:
            session.end(kept, self.story.append)
            self.ended = [one for one in self.ended if one.ending.is_alive()] + [session]

    def _posture(self):
        robot = self.scene.robot
        return np.clip(self.session.q, robot.lower + 1e-6, robot.upper - 1e-6)

    def _change_arm(self, name):
        if name in Arm.names():
            self.subject, self.home, self.settings = name, None, []
            self.story.append(f"{name}." + (" The race begins anew with this arm." if self.ghost else ""))
            self._begin(None)

    def _change_law(self, law):
        self.law = law
        self.story.append(f"The arm goes on under {law}.")
        self._begin(self._posture())

    def _save(self):
        self.story.append("The run is being saved; the arm goes on in a new one.")
        self._begin(self._posture(), _next_folder(f"play-{self.scene.robot.name}"))

    def _inject(self, name):
        session = self.session
        threading.Thread(target=lambda: self.story.append(session.fault(*FAULTS[name])), daemon=True).start()

    def _look_after_runs(self):
        """A run that has ended by itself goes on as another one, in the posture in which the arm was left."""
        session, ghost = self.session, self.ghost
        has_ended = session.process.poll() is not None
        if has_ended:
            session.listener.join(1.0)
        while session.lines:
            self.story.append(session.lines.popleft())
        if ghost and ghost.process.poll() is not None:
            ghost.listener.join(1.0)
            self.story.append(f"The ghost's run has ended: {' '.join([*ghost.lines][-2:])}")
            self.rivals.value = NOBODY
            self._race(None)
        if has_ended:
            self.failures = self.failures + 1 if time.monotonic() - session.began < 10 else 1
            if session.seen is None and self.home is None or self.failures > 3:
                raise SystemExit(f"armplane play: {self.story[-1].removeprefix('armplane: ')}")
            self.story.append("The run has ended; another one begins.")
            self._begin(self._posture() if session.seen and self.home is not None else self.home)

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
        self.mode, self.goal = "hold" if phase == "end" else "hand", (np.array(position), np.array(wxyz))

    def _on_grip(self, event):
        """The ball is dragged in the plane of the picture."""
        if self.mode != "hand":
            self.offset = np.array(event.end_position) - self.scene.target.position
        position = np.array(event.end_position) - self.offset
        self.scene.target.position = position
        self._drag(position, self.scene.target.wxyz, event.phase)

    def _line(self, dt):
        """The target of this moment, as `armplane servo --from -` reads it."""
        text = lambda *values: " ".join(f"{x:.7g}" for part in values for x in np.atleast_1d(part))
        if self.mode == "tour":
            return next(self.tour)
        if self.mode == "posture":
            if np.abs(self.session.q - self.posture).max() >= 0.01:
                return f"posture, joints, 0.5, {text(self.posture)}"
            self._hold()
            self.arrivals += 1
        p, R = self.sent
        way, turn = self.goal[0] - p, (SO3(self.goal[1]) @ R.inverse()).log()
        slow = lambda value, most: value * min(8.0, most / max(float(np.linalg.norm(value)), 1e-9))
        v, w = slow(way, self.speed.value), slow(turn, 3 * self.speed.value)
        self.sent = p, R = p + v * dt, SO3.exp(w * dt) @ R
        return f"pose, base, 0.3, {text(p, R.wxyz / np.linalg.norm(R.wxyz), v, w)}"

    def _tour(self):
        """The tour's targets: near each singularity, along ζ and back, home."""
        for name, q in itertools.cycle(self.postures.items()):
            began = time.monotonic()
            while np.abs(self.session.q - q).max() > 0.02 and time.monotonic() - began < 8:
                yield "posture, joints, 0.5, " + " ".join(f"{value:.7g}" for value in q)
            for side, seconds in () if name == "start" else ((1, 1.2), (-1, 2.4), (1, 1.2)):
                began = time.monotonic()
                while time.monotonic() - began < seconds:
                    servo, report = self.session.seen["servo_state"], self.session.seen["singularity"]
                    angular = servo.singularity > 0 and report.singularities[servo.singularity - 1].angular
                    yield "twist, singular, 0.3, " + (f"0 0 0 {0.5 * side} 0 0" if angular else f"{0.08 * side} 0 0 0 0 0")

    # The loop.

    def run(self):
        """Until the process is told to end."""
        due, number = time.monotonic(), 0
        try:
            while True:
                self._look_after_runs()
                # A run that has just begun has no state for an action yet.
                if self.session.seen is not None:
                    if self.home is None:
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
            self._end(self.session)
            self._end(self.ghost)
            with contextlib.redirect_stdout(io.StringIO()):
                self.server.stop()
            for session in self.ended:
                session.ending.join()

    def _step(self, number):
        session, watching, idle = self.session, len(self.server.get_clients()), time.monotonic() - self.touched
        if self.mode == "hold" and idle > PATIENCE_S:
            if time.monotonic() - session.began > FULL_S:
                self.story.append("Two minutes are recorded: a new run begins.")
                return self._begin(self._posture())
            if watching and self.tours.value and len(self.postures) > 1:
                self.mode, self.tour = "tour", self._tour()
        if self.mode in ("tour", "hand") and not watching:
            self._hold()
        line = self._line(1 / RATE_HZ)
        for one in filter(None, (session, self.ghost)):
            one.say(line)
        with self.server.atomic():
            self._show(session, number)
            if number % 4 == 0:
                foot = MODES[self.mode] + (f" · {watching} watching, one steers" if watching > 1 else "")
                self.html.content = panel.page(session.robot, session.seen, self.ghost and self.ghost.seen and self.ghost, "\n".join(self.story), foot)

    def _show(self, session, number):
        seen, ghost = session.seen, self.ghost
        self.scene.show(seen, None if self.mode == "tour" else self.goal, self.mode == "hand")
        if ghost and ghost.seen:
            self.scene.show_ghost(ghost, ghost.peaks.max() >= panel.AT_LIMIT)
        if number % 20 == 0 and self.mode != "posture":
            for slider, angle in zip(self.sliders, np.degrees(session.q)):
                slider.value = float(np.clip(round(angle), slider.min, slider.max))
        # For programs that look at the page.
        state = {"mode": self.mode, "robot": session.robot.name, "run": session.run, "arrivals": self.arrivals, "nearest": seen["servo_state"].nearest}
        state |= {"hand": [*seen["plant_state"].p_BE], "target": self.scene.target.position.tolist(), "places": [*self.postures], "ghost": self.scene.ghost is not None, "camera": self.scene.camera, "story": [*self.story]}
        self.state.content = f"<span class='state' data-state='{json.dumps(state)}'></span>"

    def _meet(self, session):
        """The first tick of an arm that has not been shown yet."""
        for one in [*self.own, *self.sliders]:
            one.remove()
        if self.scene is None:
            self._announce()
        self.own, self.sliders, self.postures, self.home = [], [], {}, session.q
        scenario, name = session.job["scenario"], session.robot.name
        self.scene = Scene(self.server, session.robot, scenario["plant"].get("floor_m") or 0.0, session.q)
        if name not in self.arms.options:
            self.arms.options = (*self.arms.options, name)
        self.arms.value, self.laws.value = name, scenario["control"]["strategy"]
        self._on(self.scene.target.on_update, lambda event: self._drag(event.target.position, event.target.wxyz, event.phase))
        self._on(self.scene.grip.on_drag("left"), self._on_grip)
        if self.subject not in Arm.names():
            # A scenario's robot, from now on without its path.
            robot, beside = scenario["robot"], pathlib.Path(self.subject).parent
            self.subject = robot if robot in Arm.names() else str(beside / robot if self.subject.endswith(".toml") else self.subject)
            self.settings = [f"frame={scenario['frame']}"] if scenario["frame"] else []
        threading.Thread(target=self._search, args=(session.robot, session.q), daemon=True).start()

    def _announce(self):
        """Prints the page's address, and opens it."""
        host = "localhost" if self.token is None else socket.gethostname() if self.given.host in ("0.0.0.0", "::") else self.given.host
        address = f"http://{f'[{host}]' if ':' in host else host}:{self.server.get_port()}/" + (f"?token={self.token}" if self.token else "")
        # Nobody may be there to read it.
        with contextlib.suppress(OSError):
            print(f"armplane play: {address}  (Ctrl-C ends it)", flush=True)
        if not self.given.no_open:
            webbrowser.open(address)
