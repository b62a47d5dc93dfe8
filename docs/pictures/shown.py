#!/usr/bin/env python3
"""What the real viewer shows when armplane opens it: a picture, and the share of its upper left pane that is the ground of the arm's view.

    docs/pictures/shown.py OUT.png armplane view RUN --layout timing

Needs what viewer.py names, and Pillow.
"""

import io
import sys

from PIL import Image

from viewer import Viewer

# The ground that layouts give views of the arm, and the pane's inside at 1280 x 720: left, top, right, bottom.
GROUND, PANE = (24, 28, 36), (10, 60, 300, 200)


def main():
    path, *command = sys.argv[1:]
    with Viewer(through=command) as viewer:
        picture = Image.open(io.BytesIO(viewer.picture())).convert("RGB")
    picture.save(path)
    pane = picture.crop(PANE)
    pixels = [pane.getpixel((x, y)) for x in range(0, pane.width, 3) for y in range(0, pane.height, 3)]
    near = sum(all(abs(a - b) <= 6 for a, b in zip(pixel, GROUND)) for pixel in pixels)
    print(f"{near / len(pixels):.3f}")


if __name__ == "__main__":
    main()
