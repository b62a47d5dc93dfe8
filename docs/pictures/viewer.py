"""The Rerun viewer without a window: opens recordings and saves what it shows.

Needs the viewer (`pip install rerun-sdk==0.36.3`, or its path in ARMPLANE_RERUN) and a Vulkan driver; Mesa's software driver is enough
(Debian: mesa-vulkan-drivers libvulkan1 libxkbcommon-x11-0 libegl1 libxcursor1 libxrandr2 libxi6 libx11-xcb1).
"""

import base64
import json
import os
import pathlib
import shlex
import signal
import socket
import subprocess
import tempfile
import time

COMMAND = os.environ.get("ARMPLANE_RERUN") or "rerun"
SOFTWARE_DRIVER = pathlib.Path("/usr/share/vulkan/icd.d/lvp_icd.x86_64.json")


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Viewer:
    """A headless viewer of files, or the one that a command of armplane opens, `through`."""

    def __init__(self, files=(), size="1280x720", through=None):
        self.folder = tempfile.TemporaryDirectory()
        environment = dict(os.environ, XDG_RUNTIME_DIR=self.folder.name, XDG_DATA_HOME=self.folder.name)
        if SOFTWARE_DRIVER.exists():
            environment.setdefault("VK_ICD_FILENAMES", str(SOFTWARE_DRIVER))
        port = free_port()
        quiet = subprocess.DEVNULL
        headless = ["--headless", "--port", str(port), "--window-size", size]
        command = [COMMAND, *map(str, files), "--bind", "127.0.0.1", *headless]
        if through:
            # The viewer as armplane knows it: the same, without a window.
            stand_in = pathlib.Path(self.folder.name) / "viewer.sh"
            quoted = shlex.quote(COMMAND)
            stand_in.write_text(f'#!/bin/sh\n[ "$1" = --version ] && exec {quoted} --version\nexec {quoted} "$@" {shlex.join(headless)}\n')
            stand_in.chmod(0o755)
            environment["ARMPLANE_RERUN"] = str(stand_in)
            command = through
        self.viewer = subprocess.Popen(
            command, env=environment, stdin=quiet, stdout=quiet, stderr=quiet, start_new_session=True,
        )
        self.control = subprocess.Popen(
            [COMMAND, "viewer-mcp"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=quiet, text=True, bufsize=1, start_new_session=True,
        )
        self.number = 0
        hello = {"protocolVersion": "2024-11-05", "capabilities": {}, "clientInfo": {"name": "armplane-pictures", "version": "1"}}
        self.request("initialize", hello)
        self.send({"jsonrpc": "2.0", "method": "notifications/initialized"})
        self.connect(port)
        self.settle()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in (self.control, self.viewer):
            # The whole group: pip's `rerun` is a script that starts the viewer proper.
            os.killpg(process.pid, signal.SIGTERM)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
        self.folder.cleanup()

    def send(self, message):
        self.control.stdin.write(f"{json.dumps(message)}\n")
        self.control.stdin.flush()

    def request(self, method, parameters):
        self.number += 1
        self.send({"jsonrpc": "2.0", "id": self.number, "method": method, "params": parameters})
        for line in self.control.stdout:
            answer = json.loads(line)
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(answer["error"])
                return answer["result"]
        raise RuntimeError("the viewer's control channel closed")

    def call(self, tool, **arguments):
        """The answer's texts and images."""
        result = self.request("tools/call", {"name": tool, "arguments": arguments})
        content = result.get("content", [])
        texts = "\n".join(part["text"] for part in content if part["type"] == "text")
        images = [base64.b64decode(part["data"]) for part in content if part["type"] == "image"]
        return not result.get("isError"), texts, images

    def connect(self, port):
        for _ in range(90):
            if self.viewer.poll() is not None:
                raise RuntimeError(f"the viewer `{COMMAND}` ended with {self.viewer.returncode}")
            if self.call("connect", endpoint=f"http://127.0.0.1:{port}")[0]:
                return
            time.sleep(0.5)
        raise RuntimeError("the viewer does not answer")

    def settle(self):
        """Waits until the recordings are loaded: until the viewer reports the same timelines twice. The cursor may move: it plays."""
        before = None
        for _ in range(60):
            _, state, _ = self.call("viewer_state")
            timelines = [one["timelines"] for one in json.loads(state).get("recordings", [])] if state.startswith("{") else []
            if any(timelines) and timelines == before:
                # Its notes about files and drivers are gone after some seconds.
                time.sleep(6)
                return
            before = timelines
            time.sleep(1)

    def click(self, **what):
        """Presses the button of that label (`content_contains`) or at that place (`pos`)."""
        done, text, _ = self.call("click", **what)
        if not done:
            raise RuntimeError(f"the viewer has no {what}: {text}")
        self.call("wait_for", min_steps=4, timeout_secs=20)

    def light(self):
        """The viewer's light theme, as its menu sets it."""
        self.click(pos={"x": 38, "y": 15})
        for label in ("Settings", "Light"):
            self.click(content_contains=label)
        self.call("press_key", key="Escape")
        self.call("wait_for", min_steps=4, timeout_secs=20)

    def at(self, seconds, timeline="t"):
        asked = int(seconds * 1e9)
        # A recording that has just been loaded may begin to play once more.
        for _ in range(5):
            self.call("set_time", time=asked, timeline=timeline)
            self.call("wait_for", min_steps=4, timeout_secs=60)
            shown = [one["current_time"]["time"] for one in json.loads(self.call("viewer_state")[1])["recordings"]]
            if shown == [asked] * len(shown):
                return
        raise RuntimeError(f"the viewer shows {shown} ns instead of {asked}")

    def picture(self):
        """What the window shows, as PNG."""
        text = ""
        # A loaded machine may take longer than the viewer waits for a frame.
        for _ in range(5):
            _, text, images = self.call("screenshot", pixels_per_point=1.0)
            if images:
                return images[0]
        raise RuntimeError(f"no picture: {text}")
