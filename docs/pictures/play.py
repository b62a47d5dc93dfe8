#!/usr/bin/env python3
"""Makes play.gif and play.png: a mouse drags a PUMA 560 by its hand through a stretched elbow, and back, in headless Chromium.

    docs/pictures/play.py

Needs the Python package with its extra [play], what python/tests/requirements.txt names, Chromium, and Pillow.
"""

import io
import pathlib
import sys
import tempfile
import time

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

from make import DOCS, packed, sheet

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
    options = "--no-sandbox --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader".split()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as engine:
        browser = engine.chromium.launch(executable_path=test_play.CHROMIUM, args=options)
        play = test_play.Play(pathlib.Path(folder), "puma560", browser)
        page = play.open(WINDOW, 1)
        x, y = play.take(page)
        frames, farthest = [], None
        for k, (dx, dy) in enumerate(way()):
            page.mouse.move(x + dx, y + dy)
            time.sleep(PAUSE_S)
            frames.append(Image.open(io.BytesIO(page.screenshot(timeout=test_play.PATIENCE_MS))).convert("RGB"))
            farthest = frames[-1] if k == sum(COUNTS[:2]) - 1 else farthest
        page.mouse.up()
        browser.close()
        play.nothing_is_left()
    packed(farthest).save(DOCS / "play.png", optimize=True)
    small = [frame.resize((WIDTH, WIDTH * frame.height // frame.width), Image.Resampling.LANCZOS) for frame in frames]
    palette = packed(sheet(small[::8], 1), colours=128)
    first, *others = [packed(frame, palette) for frame in small]
    first.save(DOCS / "play.gif", save_all=True, append_images=others, duration=SHOWN_MS, loop=0, optimize=True)


if __name__ == "__main__":
    main()
