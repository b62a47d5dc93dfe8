#!/usr/bin/env python3
"""Makes play.gif and play.png: a mouse drags a PUMA 560 by its hand through a stretched elbow, and back, in headless Chromium.

    docs/pictures/play.py

Needs the Python package with its extra [play], what python/tests/requirements.txt names, Chromium, and Pillow.
"""

import pathlib
import sys
import tempfile
import time

import numpy as np

from make import DOCS, animated, cropped, packed

sys.path.insert(0, str(DOCS.parent / "python/tests"))
import test_play

WINDOW, WIDTH = {"width": 1180, "height": 740}, 780
# Pixels from the ball's place: out to the right, on a little lower, and home; and how many pictures each way has.
CORNERS, COUNTS = [(0, 0), (95, -35), (110, 35), (0, 0)], (13, 10, 13)
# From a movement of the mouse to the picture of it, s, and how long it is shown, ms.
PAUSE_S, SHOWN_MS = 0.3, 130


def way():
    legs = zip(CORNERS, CORNERS[1:], COUNTS)
    return np.concatenate([np.linspace(a, b, count, endpoint=False) for a, b, count in legs])


def main():
    with tempfile.TemporaryDirectory() as folder, test_play.chromium() as browser:
        play = test_play.Play(pathlib.Path(folder), "puma560", browser)
        page = play.open(WINDOW, 1)
        x, y = play.take(page)
        frames = []
        for dx, dy in way():
            page.mouse.move(x + dx, y + dy)
            time.sleep(PAUSE_S)
            frames.append(cropped(page.screenshot(timeout=test_play.PATIENCE_MS)))
        page.mouse.up()
        play.nothing_is_left()
    # The farthest one.
    packed(frames[sum(COUNTS[:2]) - 1]).save(DOCS / "play.png", optimize=True)
    animated(frames, DOCS / "play.gif", SHOWN_MS, WIDTH)


if __name__ == "__main__":
    main()
