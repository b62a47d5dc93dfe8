"""The page `armplane play` in headless Chromium, dragged with a real mouse; what it leaves when it, its tab or a process of the run is killed."""

import asyncio
import functools
import json
import os
import queue
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import armplane
import numpy as np
import pandas
import processes
import pytest
from numpy.linalg import norm
from processes import ended, having

pytest.importorskip("viser"), pytest.importorskip("mcap")
playwright = pytest.importorskip("playwright.sync_api")

CHROMIUM = "/usr/bin/chromium"
# Vertical field of view of the page's camera, rad.
FOV = 0.85
WINDOW = {"width": 1000, "height": 600}
# Canvas pixels a CSS pixel: a quarter of the work for the software renderer.
SCALE = 0.5
# A machine may be so busy that everything takes as long; whoever waits for a condition gives up after that, s and ms.
PATIENCE = 300
PATIENCE_MS = 1000 * PATIENCE
WIRE = armplane.wire
wait = functools.partial(processes.wait, seconds=PATIENCE)
# In the page: when the mouse was moved, and when the page learnt of it; in the worker that reads the WebSocket: when messages arrived. In ms since 1970, with
# the places of links, m. Nothing of it waits for a picture.
WATCH = """
const ours = `const post = self.postMessage.bind(self), arrived = []
self.WebSocket = class extends WebSocket {
    constructor(...more) { super(...more); this.addEventListener("message", () => arrived.push(performance.timeOrigin + performance.now())) }
}
self.postMessage = (data, more) => post(data.type === "message_batch" ? {...data, at: arrived.shift()} : data, more)\n`
window.moves = []; window.updates = []; window.all = []
window.addEventListener("pointermove", event => moves.push([event.timeStamp, performance.now()].map(ms => performance.timeOrigin + ms)), true)
const script = text => URL.createObjectURL(new Blob([text], {type: "text/javascript"})), first = script(ours)
window.Worker = class extends Worker {
    constructor(url, options) {
        // Without `await`, for a message that comes meanwhile would be lost.
        super(script(options?.type === "module" ? `import "${first}"; import "${url}"` : `importScripts("${first}", "${url}")`), options)
        this.addEventListener("message", ({data}) => {
            const links = data.messages?.filter(one => one.position && /^.arm.[0-9]+$/.test(one.name)).map(one => [one.name, one.position])
            if (links) for (const list of [updates, all]) list.push([data.at, Object.fromEntries(links)])
        })
    }
}"""

# Ten pictures a second at most: a software renderer that draws all it can takes the cores on which the run lives.
FEWER_PICTURES = "const draw = requestAnimationFrame.bind(window); window.requestAnimationFrame = then => setTimeout(() => draw(then), 100)"

# Whether no link has moved by 0.05 mm in the last 0.3 s and more.
RESTS = """updates.length > 11 && [1, 2, 3, 4, 5].every(link => [0, 1, 2].every(axis => {
    const values = updates.slice(-12).flatMap(([_, links]) => links["/arm/" + link] ? [links["/arm/" + link][axis]] : [])
    return Math.max(...values) - Math.min(...values) < 5e-5 || values.length < 1
}))"""


def _press(control):
    """Without the real mouse, which waits for a picture of the software renderer; only the hand is dragged with it."""
    control.evaluate("node => node.click()", timeout=PATIENCE_MS)


class Play:
    """`armplane play`, and a browser that looks at it."""

    def __init__(self, folder, subject, browser=None, options=""):
        self.temporary = folder / "tmp"
        self.temporary.mkdir()
        command = [sys.executable, *f"-m armplane.play {subject} --no-open {options}".split()]
        environment = {**os.environ, "TMPDIR": str(self.temporary)}
        self.process = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.address = next(line.split()[2] for line in self.process.stdout if line.startswith("armplane play: http"))
        self.browser, self.folder, self.pages, self.saved, self.runs = browser, folder, 0, 0, set()

    def open(self, window=WINDOW, scale=SCALE):
        page = self.browser.new_page(viewport=window, device_scale_factor=scale)
        page.set_default_timeout(PATIENCE_MS)
        page.add_init_script(WATCH)
        page.add_init_script(FEWER_PICTURES)
        page.goto(self.address)
        # viser's warning of the software renderer lies over the picture.
        page.add_style_tag(content=".mantine-Notifications-root { display: none }")
        self.until(page, "state.places.length > 1")
        if self.pages == 0:
            # It would set off while a slow browser draws.
            _press(page.get_by_label("tour when idle"))
        self.pages += 1
        self.until(page, "state.mode !== 'tour'")
        return page

    def measure(self, page):
        """Moves the ball by steps, each when the arm rests. Messages a second at the page; medians of the times from the mouse's event, and from when the
        page learnt of it, to the first message with a link that has moved by 0.2 mm, ms."""
        page.evaluate("all.length = 0")
        x, y = self.grip(page)
        page.mouse.move(x, y)
        page.mouse.down()
        # The first movement only takes the ball.
        page.mouse.move(x, y - 10)
        for k in range(6):
            page.evaluate("updates.length = 0")
            end = time.monotonic() + 10
            while not page.evaluate(RESTS) and time.monotonic() < end:
                time.sleep(0.2)
            if k == 0:
                page.evaluate("moves.length = 0")
            page.mouse.move(x, y - 10 * (k + 2))
        time.sleep(1)
        page.mouse.up()
        moves, updates = page.evaluate("[moves, all]")
        places = pandas.DataFrame([{(name, axis): x for name, at in links.items() for axis, x in enumerate(at)} for _, links in updates])
        times, places = np.array([at for at, _ in updates]), places.ffill().to_numpy()
        delays = []
        for event, known in moves[:6]:
            k = np.searchsorted(times, event)
            has_moved = np.abs(places[k:] - places[k - 1]).max(axis=1) > 2e-4
            delays.append(times[k:][has_moved][0] - np.array([event, known]))
        return 1000 * (len(times) - 1) / np.ptp(times), *np.median(delays, axis=0)

    def until(self, page, wanted="true", seconds=PATIENCE):
        """The page's `state`, as soon as it is as wanted, in the words of JavaScript."""
        script = f"() => {{ const state = JSON.parse(document.querySelector('.ap')?.dataset.state ?? null); return state && ({wanted}) && state }}"
        state = page.wait_for_function(script, timeout=1000 * seconds, polling=50).json_value()
        self.runs.add(state["run"])
        return state

    def grip(self, page):
        """Where the ball is on the screen, as soon as the browser has the camera where it follows the hand to."""
        state = self.until(page, "state.camera")
        eye, look, target = (np.array(at) for at in (*state["camera"], state["target"]))
        forward = (look - eye) / norm(look - eye)
        right = np.cross(forward, [0, 0, 1])
        right /= norm(right)
        box, d = page.locator("canvas").first.bounding_box(), target - eye
        scale = box["height"] / 2 / np.tan(FOV / 2) / (d @ forward)
        return box["x"] + box["width"] / 2 + scale * (d @ right), box["y"] + box["height"] / 2 - scale * (d @ np.cross(right, forward))

    def take(self, page):
        """Takes the ball; where the mouse holds it."""
        for _ in range(5):
            # The picture may be older than the state; whoever misses the ball tries again.
            page.evaluate("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
            x, y = self.grip(page)
            page.mouse.move(x, y)
            page.mouse.down()
            page.mouse.move(x + 10, y)
            with suppress(playwright.TimeoutError):
                self.until(page, "state.mode === 'hand'", 20)
                return x, y
            page.mouse.up()
        raise AssertionError("the ball was not taken")

    def drag(self, page, way, wanted="true"):
        """Takes the ball and leads it along a way of pixels; the state at its end, as wanted, before it is let go."""
        x, y = self.take(page)
        for dx, dy in way:
            page.mouse.move(x + dx, y + dy)
            time.sleep(0.03)
        state = self.until(page, wanted)
        page.mouse.up()
        return state

    def go(self, page, name):
        """To a posture by its button."""
        before = self.until(page)["arrivals"]
        for _ in range(PATIENCE // 60):
            # A slow browser may have put another button in its place meanwhile.
            _press(page.get_by_role("button", name=name, exact=True))
            with suppress(playwright.TimeoutError):
                return self.until(page, f"state.arrivals > {before}", 60)
        raise AssertionError(f"never at {name}")

    def save(self, page):
        self.saved += 1
        _press(page.get_by_role("button", name="Save this run"))
        page.get_by_text(f"-{self.saved:03}/scenario.toml").wait_for(state="attached")
        return armplane.load(next(self.folder.glob(f"runs/*-{self.saved:03}")))

    def processes(self, word=""):
        """Ids of the processes of the page and its runs, with a word among their arguments: they and nobody else have its folder for temporary files."""
        return having(word, TMPDIR=str(self.temporary))

    def launcher(self, but=None):
        """Process id of `armplane servo`, another one than `but`."""
        return wait(lambda: [pid for pid in self.processes("servo") if pid != but])[0]

    def nothing_is_left(self):
        """Ends it, and looks for processes, shared memory and temporary files of it."""
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(timeout=PATIENCE) in (0, -signal.SIGKILL)
        assert wait(lambda: not self.processes())
        assert not list(self.temporary.iterdir())
        assert not [path for run in self.runs for path in Path("/dev/shm").glob(f"{run}*")]
        self.process.stdout.close()


@contextmanager
def chromium():
    """A headless browser."""
    options = "--no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader".split()
    with playwright.sync_playwright() as engine, engine.chromium.launch(executable_path=CHROMIUM, args=options) as browser:
        yield browser


@pytest.fixture
def browser():
    if not os.path.exists(CHROMIUM):
        pytest.skip(f"there is no {CHROMIUM}")
    with chromium() as browser:
        yield browser


@pytest.fixture
def play(tmp_path, browser):
    made = []

    def start(subject):
        made.append(Play(tmp_path, subject, browser))
        return made[-1]

    yield start
    for one in made:
        one.nothing_is_left()


def _circle(radius, count=60):
    angles = np.linspace(0, 2 * np.pi, count)
    return [(radius * np.sin(a), radius * 0.7 * np.sin(2 * a)) for a in angles]


@pytest.mark.parametrize("robot", ["puma560", "ur5", "panda"])
def test_a_hand_is_dragged_through_locks(play, robot):
    one = play(robot)
    page = one.open()
    for lock in ("wrist", "elbow"):
        one.go(page, lock)
        if os.environ.get("ARMPLANE_TIMES"):
            rate, seen, known = one.measure(page)
            load = os.getloadavg()[0] / os.cpu_count()
            print(f"{robot}, {lock}: {rate:.0f} updates/s; {seen:.0f} ms from mouse to arm, {known:.0f} ms of them after the page learnt of it; load {load:.1f} a core")
            assert rate >= 30 and seen < 100
            one.go(page, lock)
        one.drag(page, _circle(130))
        _judge(one.save(page), lock)


def _judge(run, lock):
    """A dragged run: within all limits, through the lock, and where the hand does not come forward although it should, with a reason."""
    states, truth, torques, reports = (run.messages(topic) for topic in ("servo_state", "plant_state", "torque", "singularity"))
    assert all(np.isfinite(values).all() for values in (truth["q"], truth["qdot"], torques["tau"]))
    assert run.summary["joints"]["speed_max_ratio"] <= 1 and run.summary["joints"]["torque_max_ratio"] <= 1
    assert not truth["limit_mask"].any() and states["refused"][-1] == 0
    inside = reports["singularities"]["inside"] == 1
    locks = {WIRE.KINDS[kind] for kind in reports["singularities"]["kind"][inside]}
    # With a spare joint a direction keeps the name under which it was tracked: one that comes from elsewhere may be called otherwise.
    assert lock in locks or run.summary["robot"] == "panda" and locks
    wanted = norm(states["V_target"][:, :3], axis=1) > 0.02
    stands = norm(truth["V_BE"][:, :3], axis=1) < 0.001
    silent = wanted & stands & (states["reason"] == WIRE.REASON_FOLLOWING)
    longest = max(map(len, "".join("x" if tick else " " for tick in silent).split()), default=0)
    assert longest < 300, f"stands still for {longest} ms and gives no reason"


def test_a_saved_run_repeats_itself(play, tmp_path):
    one = play("puma560")
    page = one.open()
    one.go(page, "wrist")
    one.drag(page, _circle(60, 20))
    run = one.save(page)
    again = armplane.run(run.folder / "scenario.toml", out=tmp_path / "again")
    for topic in ("sensor", "target", "torque"):
        first, second = run.messages(topic), again.messages(topic)
        assert [first[name].tobytes() for name in first.dtype.names if name != "header"] == [second[name].tobytes() for name in first.dtype.names if name != "header"]


def test_one_steers_and_others_watch(play):
    one = play("ur5")
    first, second = one.open(), one.open()
    # As long as the first one holds the ball, nobody else steers.
    one.take(first)
    first.get_by_text("You steer").wait_for(state="attached")
    second.get_by_text("Somebody else steers").wait_for(state="attached")
    _press(second.get_by_role("button", name="wrist", exact=True))
    assert one.until(second, "state.refused > 0")["mode"] == "hand"
    # It is closed while it drags: the arm rests, and the second one steers, even after it is loaded again.
    first.close()
    one.until(second, "state.mode === 'hold'")
    one.go(second, "wrist")
    second.reload()
    assert one.until(second, "state.nearest < 1")["robot"] == "ur5"
    second.close()


def test_a_killed_controller_is_replaced(play):
    one = play("puma560")
    page = one.open()
    one.go(page, "start")
    _press(page.get_by_role("button", name="kill controller"))
    page.get_by_text("SIGKILL").wait_for(state="attached")
    before = one.until(page)["hand"]
    one.drag(page, [(0, -5 * k) for k in range(20)], f"Math.hypot(...state.hand.map((at, axis) => at - {before}[axis])) > 0.005")
    # Killed with its browser open, the page leaves nothing behind, as the fixture checks.
    one.process.kill()


def test_a_controller_of_others_races(play):
    pytest.importorskip("jparse_robotics")
    one = play("panda")
    page = one.open()
    page.get_by_label("race against").click()
    _press(page.get_by_role("option", name="j_parse"))
    one.until(page, "state.ghost")
    one.go(page, "wrist")
    one.drag(page, _circle(60, 20))
    page.get_by_text("j_parse: largest speed").wait_for(state="attached")
    assert one.until(page)["ghost"]


def test_a_killed_run_is_followed_by_another_and_a_killed_page_leaves_nothing(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as owner:
        taken = owner.getsockname()[1]
        one = Play(tmp_path, "puma560", options=f"--port {taken}")
        assert f":{taken}/" not in one.address, "a taken port is left to its owner"
        first = one.launcher()
        os.kill(first, signal.SIGKILL)
        second = one.launcher(but=first)
        assert wait(lambda: one.runs.update(path.name for path in Path("/dev/shm").glob(f"armplane-*-{second}-*") if path.is_dir()) or one.runs)
        os.kill(second, signal.SIGKILL)
        one.process.kill()
        one.nothing_is_left()


def test_a_full_disk_is_told_in_a_sentence_and_keeps_no_half_run(tmp_path, monkeypatch):
    from armplane.play import session

    def full(source, target):
        target.mkdir()
        raise session.shutil.Error([(source, target, f"[Errno 28] No space left on device: '{source}' -> '{target}'")])

    monkeypatch.setattr(session.shutil, "move", full)
    one, told, kept = object.__new__(session.Session), [], tmp_path / "runs/one"
    one.process, one.folder = subprocess.Popen(["true"]), tmp_path / "room"
    one._finish(kept, told.append)
    assert not kept.exists() and "No space left on device. Start" in told[0]


SLIDES = """<robot name="slides"><link name="base"/>
<link name="a"><inertial><mass value="2"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="b"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tip"/>
<joint name="rail" type="prismatic"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="99" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="99" velocity="4"/></joint>
<joint name="end" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="0.4 0 0"/></joint></robot>"""


def test_a_new_run_begins_where_the_arm_stands_also_on_a_rail(tmp_path, monkeypatch):
    from armplane.play.robot import Robot
    from armplane.results import _program, as_settings

    monkeypatch.chdir(tmp_path)
    Path("slides.urdf").write_text(SLIDES)
    Path("slides.toml").write_text('default_frame = "tip"\nlength_m = 0.4\ntask = ["x", "y"]\n')
    (stands,) = as_settings({"start": {"q": np.array([0.2, 0.05])}})
    said = ended(f"{_program()} servo slides.urdf --from=- --out=run --set={stands.replace(' ', '')}", input="twist, base, 0.2, 0.02 0 0 0 0 0\nend\n")
    run = armplane.load(tmp_path / "run")
    assert said.returncode == 0, said.stderr
    assert run.summary["joints"]["q_start"] == pytest.approx([0.2, 0.05], abs=1e-6)
    # Of every link something is drawn, also of a file without shapes.
    solids = Robot(json.loads((run.folder / "job.json").read_text())).solids
    assert {one["joint"] for one in solids["pieces"]} == {None, 0, 1} and solids["lacking"] is None


def test_strangers_are_refused_on_every_address(tmp_path):
    one = Play(tmp_path, "puma560", options="--host 0.0.0.0")
    port, token = re.search(r":(\d+)/\?token=(\S+)", one.address).groups()

    def status(path, **headers):
        try:
            return urllib.request.urlopen(urllib.request.Request(f"http://127.0.0.1:{port}{path}", headers=headers), timeout=PATIENCE).status
        except urllib.error.HTTPError as error:
            return error.code

    socket_headers = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
    assert (status("/"), status("/?token=wrong"), status("/", **socket_headers)) == (403, 403, 403)
    assert status(f"/?token={token}") == 200
    assert status(f"/?token={token}", Origin="http://evil.example") == 403
    one.nothing_is_left()


def test_a_wrong_name_is_said_before_any_address(tmp_path):
    said = ended(f"{sys.executable} -m armplane.play nobody", cwd=tmp_path)
    assert said.returncode == 2 and "http" not in said.stdout and "nobody" in said.stderr


def test_the_door_is_shut_for_strangers():
    from armplane.play.door import refusal

    class Request:
        def __init__(self, path="/", **headers):
            self.path, self.headers = path, headers

    assert refusal(Request(Host="localhost:8080"), None) is None
    assert refusal(Request(Host="evil.example:8080"), None)
    assert refusal(Request(Host="localhost:8080", Origin="http://evil.example"), None)
    assert refusal(Request(Host="10.0.0.2:8080", Cookie="a=b; armplane-play=secret"), "secret") is None


@pytest.mark.parametrize("aspect", [1.5, 0.46])
def test_the_camera_follows_hand_and_ball_but_no_person(aspect):
    from armplane.play import scene

    one = object.__new__(scene.Scene)
    one.robot, one.sent, one.gaze = SimpleNamespace(reach=1), {}, {}
    low, high = scene.ABOVE if aspect < 1 else scene.BESIDE
    gaze = np.array([1, 2, -0.8])
    camera = SimpleNamespace(aspect=aspect, fov=FOV, position=-1.5 * gaze, look_at=-0.5 * gaze)
    client = SimpleNamespace(client_id=1, camera=camera)
    one.take(1, camera.position, gaze)
    ahead, right = gaze / norm(gaze), np.cross(gaze, [0, 0, 1])
    right /= norm(right)
    for points in np.random.default_rng(1).uniform(-1.5, 1.5, (20, 2, 3)):
        one.hand, one.target = points[0], SimpleNamespace(position=points[1])
        for _ in range(400):
            one.follow(client)
        assert one.is_sent(1, camera.position) and np.allclose(camera.look_at - camera.position, gaze)
        d = points - camera.position
        seen = np.stack([d @ right, d @ np.cross(right, ahead)], axis=1) / (d @ ahead)[:, None] / np.tan(FOV / 2) / [aspect, 1]
        assert (seen > low - 0.1).all() and (seen < high + 0.1).all()
    assert not one.is_sent(1, camera.position + 0.1)


def test_a_browser_changes_only_what_is_offered_and_only_while_it_steers():
    """viser takes any value from any browser: it is put back where the page does not offer it, or the browser may not."""
    from armplane.play.page import Page

    steers, watches, has_no_camera, nor_has_this = 1, 2, 3, 4
    page, given, faults = object.__new__(Page), [], []
    page.actions, page.kept, page.driver, page.refused, page.touched, page.turned = queue.Queue(), {}, None, 0, time.monotonic(), set()
    page.server = SimpleNamespace(get_clients=lambda: {steers: None, watches: None})
    page.hand = SimpleNamespace(mode="hold")
    page.session, page.postures = SimpleNamespace(fault=lambda *words: faults.append(words) or "done"), {}
    page.story = given
    control = SimpleNamespace(value=0.3, on_update=lambda call: setattr(control, "call", call))
    page._keep("speed", control, lambda value: 0.05 <= value <= 0.5)

    def set_by(client, value):
        control.value = value
        asyncio.run(control.call(SimpleNamespace(client_id=client)))
        while not page.actions.empty():
            page.actions.get()()
        assert control.value == page.kept["speed"]
        return control.value

    # Nobody steers yet: a value that is none gives nobody the hand, nor does a browser without a picture get it.
    assert [set_by(watches, value) for value in (5000.0, -1.0, float("nan"))] == [0.3] * 3
    assert (set_by(has_no_camera, 0.1), set_by(nor_has_this, 0.1), page.driver, page.refused) == (0.3, 0.3, None, 2)
    assert (set_by(steers, 0.2), page.driver) == (0.2, steers)
    assert (set_by(watches, 0.4), set_by(has_no_camera, 0.4), page.driver, page.refused) == (0.2, 0.2, steers, 4)
    page._inject("x"), page._go_near("x"), page._turn(0, float("nan"))
    assert not faults
    page._inject("noise")
    assert wait(lambda: faults)[0][0] == "plant"


def test_without_viser_a_sentence_says_what_to_install(monkeypatch, capsys):
    from armplane.play import __main__ as play

    monkeypatch.setattr(sys, "argv", ["armplane play"])
    monkeypatch.setattr(play, "find_spec", lambda name: None)
    assert play.main() == 2 and "pip install" in capsys.readouterr().err
