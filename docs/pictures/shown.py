#!/usr/bin/env python3
"""What the real viewer shows when armplane opens it: a picture, and the share of its upper left pane that is the ground of the arm's view.

    docs/pictures/shown.py OUT.png armplane view RUN --layout timing

Needs what viewer.py names, Pillow and numpy.
"""

import io
import sys

import numpy as np
from PIL import Image

from viewer import Viewer

# The ground of a view in the dark theme has a hue, and is darker than any lane: the least spread of its colours, and the brightest of them.
SPREAD, BRIGHTEST = 15, 50
# The pane's inside at 1280 x 720: left, top, right, bottom.
PANE = (10, 60, 300, 200)


def main():
    path, *command = sys.argv[1:]
    with Viewer(through=command) as viewer:
        picture = Image.open(io.BytesIO(viewer.picture())).convert("RGB")
    picture.save(path)
    pixels = np.asarray(picture.crop(PANE))
    print(f"{np.mean((pixels.max(axis=2) < BRIGHTEST) & (np.ptp(pixels, axis=2) > SPREAD)):.3f}")


if __name__ == "__main__":
    main()
