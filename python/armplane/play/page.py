"""The page: one loop that takes in what people ask for, steers the run, and shows it."""

import collections
import contextlib
import io
import logging
import queue
import socket
import sys
import threading
import time
import webbrowser
from time import monotonic

import numpy as np
import viser

from .. import Arm, laws
from ..arena import OPPONENTS
from ..results import _next_folder
from . import door, panel
from .hand import Hand
from .scene import Scene
from .session import Session

RATE_HZ = 40
# So long nobody touches the page before the arm goes on tour, s.
PATIENCE_S = 15
# A longer run ends as soon as nobody has a hand on it, s: its recording grows by 2 MB a second.
FULL_S = 120
# Whoever steers may pause so long, s.
KEEPS_S = 10
# Ends of the slider, m/s; and no hand is dragged further, m.
SPEEDS, FARTHEST_M = (0.05, 0.5), 100
# Simulated by real time: a smaller share is told.
SLOW = 0.9
FAULTS = {
    "kill controller": "controller kill",
    "noise": "plant sensor --as noise --joint 2 --amount 0.001 --for 1s",
    "delay": "controller delay --delay 3 --for 0.5s",
}
HINT = "kill the controller; noise on encoder 2 for 1 s; delay its messages by 3 ms for 0.5 s"
NOBODY = "none"
MODES = {
    "tour": "on tour: touch anything to end it",
    "hand": "your hand",
    "posture": "goes to a posture",
    "hold": "holds",
}
YOURS = "You steer."
FREE = "Nobody steers: take the hand."
TAKEN = f"Somebody else steers, until nobody has touched the hand for {KEEPS_S} s. You watch."


class Page:
    """Everything happens on the thread that calls `run`; callbacks of browsers queue actions."""

    def __init__(self, given, folder, keeper, token):
        self.given, self.token, self.room = given, token, (folder, keeper)
        self.actions, self.story = queue.Queue(), collections.deque(["Drag the yellow ball."], 4)
        # The steering browser, since when nobody has touched anything; clicks of others; notices by browser.
        self.driver, self.touched, self.refused, self.notices = None, monotonic(), 0, {}
        # Browsers whose camera stays as a person has turned it, until the arm gets something to do.
        self.turned = set()
        self.subject, self.law, self.home = given.subject, None, None
        self.session, self.ghost, self.hand, self.scene = None, None, None, None
        self.failures, self.ended, self.said, self.kept = 0, [], monotonic(), {}
        # viser prints a box with addresses, without the token.
        with door.guarded(token), contextlib.redirect_stdout(io.StringIO()):
            self.server = viser.ViserServer(given.host, given.port, label="armplane play", verbose=False)
        # viser's tunnel would show the page to the world.
        self.server.request_share_url = lambda *_, **__: None
        # A stranger's broken request is no error of ours.
        logging.getLogger("websockets").setLevel(logging.CRITICAL)
        self.server.on_client_connect(self._greet)
        self._add_controls(self.server.gui)
        self._begin(None)

    # The controls.

    def _add_controls(self, gui):
        gui.configure_theme(dark_mode=True, control_width="large", show_logo=False, show_share_button=False, brand_color=(214, 51, 164))
        gui.add_html(panel.STYLE)
        self.html = gui.add_html("")
        save = gui.add_button("Save this run", icon="device-floppy")
        with gui.add_folder("Go to") as self.places:
            speed = gui.add_slider("speed, m/s", *SPEEDS, 0.05, 0.3)
            tours = gui.add_checkbox("tour when idle", True)
        with gui.add_folder("Arm and law"):
            arms = [name for name in Arm.names() if not name.startswith("planar")]
            self.arms = gui.add_dropdown("arm", arms)
            self.laws = gui.add_dropdown("law", laws())
            self.rivals = gui.add_dropdown("race against", [NOBODY, *laws(), *OPPONENTS])
        with gui.add_folder("Faults"):
            faults = gui.add_button_group("inject", tuple(FAULTS), hint=HINT)
        self.joints = gui.add_folder("Joints", expand_by_default=False)
        # Those of one arm: its buttons and sliders.
        self.own, self.sliders = [], []
        among = lambda control: lambda value: value in control.options
        self._keep("arm", self.arms, among(self.arms), self._change_arm)
        self._keep("law", self.laws, among(self.laws), self._change_law)
        self._keep("rival", self.rivals, among(self.rivals), lambda _: self._race(self._posture()))
        self._keep("speed", speed, lambda value: SPEEDS[0] <= value <= SPEEDS[1])
        self._keep("tours", tours, lambda value: True)
        self._on(faults.on_click, lambda event: self._inject(event.target.value))
        self._on(save.on_click, lambda _: self._save())

    def _on(self, attach, action):
        """Queues what the person who steers does, and counts what others try."""

        # viser keeps the order of coroutines only: the end of a drag comes last.
        async def call(event):
            if event.client_id is not None:
                self.actions.put(lambda: self._may(event.client_id) and action(event))

        attach(call)

    def _keep(self, name, control, is_offered, action=lambda _: None):
        """A control's value, in `self.kept`, by whoever steers. viser takes any from every browser, and shows it to all: others are put back."""
        self.kept[name] = control.value

        def take(client, value):
            if is_offered(value) and self._may(client):
                self.kept[name] = value
                action(value)
            else:
                control.value = self.kept[name]

        async def call(event):
            if event.client_id is not None:
                self.actions.put(lambda value=control.value: take(event.client_id, value))

        control.on_update(call)

    def _greet(self, client):
        if self.scene:
            self.scene.aim(client)

        def look(camera):
            place, gaze = camera.position, camera.look_at - camera.position
            self.actions.put(lambda: self._look(client.client_id, place, gaze))

        client.camera.on_update(look)

    def _is_taken(self):
        """Whether somebody steers: holds the ball, or has just touched something."""
        is_here = self.driver in self.server.get_clients()
        recently = monotonic() - self.touched < KEEPS_S
        return is_here and (recently or self.hand is not None and self.hand.mode == "hand")

    def _may(self, client):
        # A browser is there from its first camera on: of one before that nobody would know that it steers.
        is_here = client in self.server.get_clients()
        if is_here and not self._is_taken():
            self.driver = client
        if not is_here or self.driver != client:
            self.refused += 1
            return False
        self._touch()
        self.turned.clear()
        return True

    def _touch(self):
        """Ends the tour, and puts the next one off."""
        self.touched = monotonic()
        if self.hand.mode == "tour":
            self.hand.hold()

    def _look(self, client, place, gaze):
        """Whoever turns the camera wants to look for himself: no tour meanwhile."""
        if self.scene.is_sent(client, place):
            return
        self.scene.take(client, place, gaze)
        self.turned.add(client)
        if self.driver is None or self.driver == client:
            self._touch()

    def _notify(self, clients):
        """Tells each browser who steers, as long as there are several."""
        taken = self._is_taken()
        for number, client in clients.items():
            if number not in self.notices:
                self.notices[number] = client.gui.add_markdown("", order=-1)
            text = FREE if not taken else YOURS if number == self.driver else TAKEN
            self.notices[number].content = text if len(clients) > 1 else ""

    def _search(self, robot, home):
        """Buttons for the postures of this arm, as soon as they have been found."""
        found = {"start": home, **robot.near(home)}
        self.actions.put(lambda: robot is self.scene.robot and self._show_places(robot, found))

    def _show_places(self, robot, found):
        self.postures, gui = found, self.server.gui
        with self.places:
            buttons = gui.add_button_group("near", tuple(found), order=0.0)
        self._on(buttons.on_click, lambda event: self._go_near(event.target.value))
        with self.joints:
            for i, (low, high) in enumerate(np.degrees([robot.lower, robot.upper]).T):
                ends = float(np.floor(low)), float(np.ceil(high))
                slider = gui.add_slider(f"joint {i + 1}, °", *ends, 1.0, ends[0])
                self._on(slider.on_update, lambda event, i=i: self._turn(i, event.target.value))
                self.sliders.append(slider)
        self.own = [buttons, *self.sliders]

    def _go_near(self, name):
        if name in self.postures:
            self.hand.go(self.postures[name])

    def _turn(self, joint, degrees):
        if not np.isfinite(degrees):
            return
        q = self._posture()
        q[joint] = np.radians(degrees)
        self.hand.go(q)

    def _on_grip(self, event):
        """The ball is dragged in the plane of the picture."""
        if self.hand.mode != "hand":
            self.offset = np.array(event.start_position) - self.scene.target.position
        self.scene.target.position = np.array(event.end_position) - self.offset
        self._on_target(event)

    def _on_target(self, event):
        target = self.scene.target
        position, wxyz = target.position.copy(), target.wxyz.copy()
        # Any other numbers would stay in the hand.
        is_pose = np.isfinite(position).all() and abs(np.linalg.norm(wxyz) - 1) < 1e-3
        if is_pose and np.abs(position).max() < FARTHEST_M:
            self.hand.drag(position, wxyz, event.phase)

    # Runs.

    def _begin(self, start, kept=None):
        """A new run in the posture `start`, or in the arm's own; the ghost begins beside it."""
        self._end(self.session, kept)
        self.hand = None
        self.session = Session(self.subject, *self.room, start, self.law)
        self._race(start)

    def _race(self, start):
        self._end(self.ghost)
        law, self.ghost = self.kept["rival"], None
        if self.scene:
            self.scene.remove_ghost()
        if law != NOBODY:
            self.ghost = Session(self.subject, *self.room, start, law)

    def _end(self, session, kept=None):
        if session:
            session.end(kept, self.story.append)
            self.ended = [one for one in self.ended if one.ending.is_alive()] + [session]

    def _posture(self):
        robot = self.session.robot
        return np.clip(self.session.q, robot.lower + 1e-6, robot.upper - 1e-6)

    def _change_arm(self, name):
        if name in Arm.names():
            self.subject, self.home = name, None
            self.story.append(f"{name}.{' The race begins anew.' if self.ghost else ''}")
            self._begin(None)

    def _change_law(self, law):
        self.law = law
        self.story.append(f"The arm goes on under {law}.")
        self._begin(self._posture())

    def _save(self):
        self.story.append("The run is being saved; the arm goes on in a new one.")
        self._begin(self._posture(), _next_folder(f"play-{self.session.robot.name}"))

    def _inject(self, name):
        if name not in FAULTS:
            return
        fault, words = self.session.fault, FAULTS[name].split()
        threading.Thread(target=lambda: self.story.append(fault(*words)), daemon=True).start()

    def _look_after_runs(self):
        """A run that has ended by itself goes on as another one, in the posture left."""
        session, ghost = self.session, self.ghost
        if has_ended := session.process.poll() is not None:
            session.listener.join(1)
        while session.lines:
            self.story.append(session.lines.popleft())
        if ghost and ghost.process.poll() is not None:
            ghost.listener.join(1)
            last = " ".join([*ghost.lines][-2:])
            self.story.append(f"The ghost's run has ended: {last}")
            self.rivals.value = self.kept["rival"] = NOBODY
            self._race(None)
        if has_ended:
            is_short = monotonic() - session.began < 10
            self.failures = self.failures + 1 if is_short else 1
            if session.seen is None and self.home is None or self.failures > 3:
                print(f"armplane play: {self.story[-1].removeprefix('armplane: ')}", file=sys.stderr)
                raise SystemExit(max(session.process.returncode, 1))
            self.story.append("The run has ended; another one begins.")
            knows = session.seen and self.home is not None
            self._begin(self._posture() if knows else self.home)

    # The loop.

    def run(self):
        """Until the process is told to end."""
        # At every tick the run waits for the thread that observes it: that must not wait for this.
        sys.setswitchinterval(1e-4)
        due, number = monotonic(), 0
        try:
            while True:
                self._look_after_runs()
                if self.session.seen is not None:
                    if self.home is None:
                        self._meet(self.session)
                    self.hand = self.hand or Hand(self.session)
                    self._step(number)
                due, number = max(due + 1 / RATE_HZ, monotonic() - 0.2), number + 1
                self._listen(due)
        finally:
            self._end(self.session)
            self._end(self.ghost)
            with contextlib.redirect_stdout(io.StringIO()):
                self.server.stop()
            for session in self.ended:
                session.ending.join()

    def _listen(self, due):
        """Waits; a person's action goes to the arm at once, as soon as its run has a state."""
        while self.hand:
            try:
                self.actions.get(timeout=max(due - monotonic(), 0))()
            except queue.Empty:
                return
            self._say()
        time.sleep(max(due - monotonic(), 0))

    def _say(self):
        """The target of this moment, for the arm and its ghost."""
        if self.hand:
            now = monotonic()
            line = self.hand.line(min(now - self.said, 0.1), self.kept["speed"])
            self.said = now
            for one in filter(None, (self.session, self.ghost)):
                one.say(line)

    def _step(self, number):
        session, hand, clients = self.session, self.hand, self.server.get_clients()
        if hand.mode == "hold" and monotonic() - self.touched > PATIENCE_S:
            if monotonic() - session.began > FULL_S:
                self.story.append("Two minutes are recorded: a new run begins.")
                return self._begin(self._posture())
            if clients and self.kept["tours"] and len(self.postures) > 1:
                hand.start_tour(self.postures)
        is_left = {"hand": self.driver not in clients, "tour": not clients}
        if is_left.get(hand.mode):
            hand.hold()
        self._say()
        ghost = self.ghost if self.ghost and self.ghost.seen else None
        with self.server.atomic():
            goal = None if hand.mode == "tour" else hand.goal
            self.scene.show(session.seen, goal, hand.mode == "hand")
            # Not while the ball is dragged: its plane is the picture's.
            for client in clients.values() if hand.mode != "hand" else ():
                if client.client_id in self.scene.sent.keys() - self.turned:
                    self.scene.follow(client)
            if ghost:
                self.scene.show_ghost(ghost, ghost.peaks.max() >= panel.AT_LIMIT)
            if number % 4 == 0 and clients:
                self._show_panel(session, ghost, clients)
            if number % 20 == 0 and hand.mode != "posture":
                for slider, angle in zip(self.sliders, np.degrees(session.q)):
                    slider.value = float(np.clip(round(angle), slider.min, slider.max))
        # viser would wait for more.
        self.server.flush()

    def _show_panel(self, session, ghost, clients):
        self._notify(clients)
        seen, mode, pace = session.seen, self.hand.mode, session.pace()
        foot = MODES[mode] + (f" · {len(clients)} watch" if len(clients) > 1 else "")
        foot += f" · slow computer: {pace:.2f} of real time" if pace < SLOW else ""
        viewer, ball = self.driver if self.driver in clients else min(clients), self.scene.target.position
        state = {
            "mode": mode, "robot": session.robot.name, "run": session.run, "target": ball.tolist(), "hand": [*seen["plant_state"].p_BE],
            "nearest": seen["servo_state"].nearest, "arrivals": self.hand.arrivals, "places": [*self.postures], "ghost": ghost is not None,
            "refused": self.refused, "camera": self.scene.camera(clients[viewer]) if viewer in self.scene.sent else None
        }  # fmt: skip
        self.html.content = panel.page(session.robot, seen, ghost, ball, "\n".join(self.story), foot, state)

    def _meet(self, session):
        """The first tick of an arm that has not been shown yet."""
        for one in self.own:
            one.remove()
        if self.scene is None:
            self._announce()
        scenario, robot = session.job["scenario"], session.robot
        self.own, self.sliders, self.postures, self.home = [], [], {}, session.q
        floor = scenario["plant"].get("floor_m") or 0.0
        self.scene = Scene(self.server, robot, floor, session.q)
        if lacking := robot.solids["lacking"]:
            self.story.append(lacking)
        if robot.name not in self.arms.options:
            self.arms.options = (*self.arms.options, robot.name)
        self.kept |= {"arm": robot.name, "law": scenario["control"]["strategy"]}
        self.arms.value, self.laws.value = self.kept["arm"], self.kept["law"]
        self._on(self.scene.target.on_update, self._on_target)
        self._on(self.scene.grip.on_drag("left"), self._on_grip)
        threading.Thread(target=self._search, args=(robot, session.q), daemon=True).start()

    def _announce(self):
        """Prints the page's address, and opens it."""
        host, port = "localhost", self.server.get_port()
        if self.token is not None:
            is_any = self.given.host in ("0.0.0.0", "::")
            host = socket.gethostname() if is_any else self.given.host
        address = f"http://{f'[{host}]' if ':' in host else host}:{port}/"
        address += f"?token={self.token}" if self.token else ""
        # Nobody may be there to read it.
        with contextlib.suppress(OSError):
            print(f"armplane play: {address}  (Ctrl-C ends it)", flush=True)
        if not self.given.no_open:
            webbrowser.open(address)
