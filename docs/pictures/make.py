#!/usr/bin/env python3
"""Makes the pictures of README and docs again, each from a run made just before, as the Rerun viewer shows it at 1280 × 720.

    docs/pictures/make.py [--armplane target/release/armplane] [--only NAME,…]

Needs `cargo build --release`, what viewer.py names, Pillow (`pip install pillow`), and for the report Chromium or its path in BROWSER.
"""

import argparse
import csv
import io
import os
import pathlib
import subprocess
import sys
import tempfile

from PIL import Image, ImageDraw, ImageFont

from viewer import Viewer

HERE = pathlib.Path(__file__).resolve().parent
DOCS = HERE.parent
FAULTS = HERE / "faults.toml"
BROWSER = os.environ.get("BROWSER", "chromium")

# Picture: what is run, when it is seen (s), and the layout where it is not the scenario's.
PICTURES = {
    "control": (["run", "fig5-wrist-rotation"], 1.0, None),
    "free": (["run", "fig5-wrist-rotation"], 3.4, None),
    "overhead": (["run", "overhead-pass"], 1.6, None),
    "straight-up": (["run", "straight-up"], 0.15, None),
    "race": (["compare", "fig5-wrist-rotation", "--race"], 2.6, None),
    "arms": (["run", "ur5-wrist"], 1.0, None),
    "timing": (["run", str(FAULTS)], 2.66, None),
}

# Animated picture: what is run, from when to when (s), how many seconds pass in one, and its part of the window (left, top, right, bottom).
ANIMATIONS = {
    "race.gif": (["compare", "fig5-wrist-rotation", "--race"], (0.0, 4.4), 1.0, (0, 54, 676, 830)),
    "servo.gif": (["servo", "servo-line-panda"], (0.0, 23.0), 4.0, (0, 54, 676, 520)),
}
# Every scenario that ends by itself, at a moment of the stretch that the viewer plays again and again.
EVERY = {
    "fig4-elbow-and-wrist": 0.3, "fig5-wrist-rotation": 1.0, "elbow-in-and-out": 3.9, "overhead-pass": 1.6, "straight-up": 0.15,
    "wrist-near-miss": 1.0, "ur5-wrist": 1.0, "ur5-elbow": 3.9, "iiwa-elbow": 3.9, "iiwa-posture": 0.3,
    "seven-joints": 2.0, "fr3-elbow": 4.3, "fr3-shoulder": 0.4, "fr3-wrist": 1.0, "fig1-pseudo-inverse": 1.9,
    "servo-line-panda": 8.0, "servo-line-xarm7": 8.0, "servo-line-gen3": 8.0, "servo-over-base-panda": 8.0, "servo-hostile": 3.0,
}
# The arm, the close-up and the words of the layout for control; size of one on the sheet, and how many are in a row.
LEFT, CELL, COLUMNS = (0, 28, 676, 690), (452, 442), 5

# Kinds of paths, as `armplane new --path` knows them.
KINDS = ["line", "circle", "waypoints", "spline", "table"]

# A whole window without its title bar, which names the machine's driver.
BODY = (0, 28, 1280, 720)

# Frames per second, the window, width of a frame.
RATE, WINDOW, WIDTH = 10, "1280x860", 676
COLOURS = 200


def armplane(command, arguments, folder):
    done = subprocess.run([command, *arguments, "--out", str(folder)], capture_output=True, text=True, check=False)
    if not (folder / "run.rrd").exists():
        sys.exit(f"armplane {' '.join(arguments)} left no recording: {done.stderr.strip()}")


def blueprint(command, folder, layout):
    path = folder / f"{layout}.rbl"
    subprocess.run([command, "export", str(folder), "--format", "rbl", "--layout", layout, "--out", str(folder)], capture_output=True, check=True)
    return path


def cropped(png, part):
    return Image.open(io.BytesIO(png)).convert("RGB").crop(part)


def small(png, part=None):
    """A picture of few colours, which is as good to the eye and a third of the size."""
    return cropped(png, part).quantize(255, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)


def picture(command, name, scratch):
    arguments, seconds, layout = PICTURES[name]
    folder = scratch / name
    armplane(command, arguments, folder)
    files = [folder / "run.rrd"] + ([blueprint(command, folder, layout)] if layout else [])
    with Viewer(files, piped=layout is not None) as viewer:
        if seconds is not None:
            viewer.at(seconds)
        small(viewer.picture(), BODY).save(DOCS / f"{name}.png", optimize=True)


def animation(command, name, scratch):
    arguments, (begin, end), speed, part = ANIMATIONS[name]
    folder = scratch / name
    armplane(command, arguments, folder)
    frames = []
    with Viewer([folder / "run.rrd"], WINDOW) as viewer:
        for k in range(int((end - begin) / speed * RATE)):
            viewer.at(begin + k * speed / RATE)
            frame = cropped(viewer.picture(), part)
            frames.append(frame.resize((WIDTH, WIDTH * frame.height // frame.width), Image.Resampling.LANCZOS))
    # One palette for all, made of several: the background stays as it is from frame to frame and packs well.
    some = frames[:: max(1, len(frames) // 6)]
    sheet = Image.new("RGB", (WIDTH, sum(frame.height for frame in some)))
    for k, frame in enumerate(some):
        sheet.paste(frame, (0, k * frame.height))
    palette = sheet.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    path = DOCS / name
    hold = [1000 // RATE] * (len(frames) - 1) + [1500]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=hold, loop=0, optimize=True)
    if path.stat().st_size > 3_000_000:
        sys.exit(f"{path} has {path.stat().st_size} bytes; 3 MB are the most")


def figure(command, scratch):
    """Figure 3 of the paper, as `armplane figures` draws it, with the Python package."""
    folder = scratch / "figures"
    subprocess.run([command, "figures", "--out", str(folder)], capture_output=True, check=True)
    small((folder / "fig3.png").read_bytes()).save(DOCS / "fig3.png", optimize=True)


def still(command, scratch):
    """Figures 1 and 2 of the paper as the viewer shows them, one beside the other."""
    parts = []
    for name in ("fig1-pseudo-inverse", "fig2-dynamically-consistent"):
        armplane(command, ["run", name], scratch / name)
        with Viewer([scratch / name / "run.rrd"]) as viewer:
            viewer.at(1.9)
            parts.append(cropped(viewer.picture(), LEFT))
    sheet = Image.new("RGB", (2 * 676, 662))
    for k, part in enumerate(parts):
        sheet.paste(part, (676 * k, 0))
    sheet.quantize(255, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(DOCS / "still.png", optimize=True)


def every(command, scratch):
    """What each default recording tells, on one sheet."""
    rows = -(-len(EVERY) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * CELL[0], rows * CELL[1]))
    for k, (name, seconds) in enumerate(EVERY.items()):
        armplane(command, ["servo" if name.startswith("servo") else "run", name], scratch / name)
        with Viewer([scratch / name / "run.rrd"]) as viewer:
            viewer.at(seconds)
            part = cropped(viewer.picture(), LEFT)
        sheet.paste(part.resize(CELL, Image.Resampling.LANCZOS), (k % COLUMNS * CELL[0], k // COLUMNS * CELL[1]))
    sheet.quantize(128, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(DOCS / "every.png", optimize=True)


def light(command, scratch):
    """The default scenario in the viewer's light theme."""
    armplane(command, ["run", "fig5-wrist-rotation"], scratch / "light")
    with Viewer([scratch / "light" / "run.rrd"]) as viewer:
        viewer.light()
        viewer.at(1.0)
        small(viewer.picture(), BODY).save(DOCS / "light.png", optimize=True)


def report(command, scratch):
    """The first page of a report, in a browser."""
    folder, page, shot = scratch / "report", scratch / "report.html", scratch / "report.png"
    armplane(command, ["run", "fig5-wrist-rotation"], folder)
    subprocess.run([command, "report", str(folder), "--out", str(page)], capture_output=True, check=True)
    browser = [BROWSER, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={scratch / 'browser'}"]
    subprocess.run([*browser, "--window-size=1280,1080", f"--screenshot={shot}", page.as_uri()], capture_output=True, check=True)
    small(shot.read_bytes()).save(DOCS / "report.png", optimize=True)


def paths(command, scratch):
    """The path of each kind that `armplane new` writes: the hand's way, and where it is every 0.1 s; a cross where it begins."""
    side, edge, scale = 190, 30, 4
    sheet = Image.new("RGB", (len(KINDS) * side * scale, (side + edge) * scale), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(15 * scale)
    for k, kind in enumerate(KINDS):
        folder = scratch / kind
        subprocess.run([command, "new", kind, "--path", kind], cwd=scratch, capture_output=True, check=True)
        armplane(command, ["run", str(scratch / f"{kind}.toml")], folder)
        subprocess.run([command, "export", str(folder), "--format", "csv", "--out", str(folder)], capture_output=True, check=True)
        with open(folder / "signals.csv") as file:
            rows = [[float(row[f"desired.position.{axis}"] or "nan") for axis in "xyz"] for row in csv.DictReader(file)]
        spans = [max(column) - min(column) for column in zip(*rows)]
        across, up = sorted(sorted(range(3), key=spans.__getitem__)[1:])
        middle = [(max(column) + min(column)) / 2 for column in zip(*rows)]
        zoom = (side - 2 * edge) * scale / max(spans)
        place = lambda row: ((k + 0.5) * side * scale + zoom * (row[across] - middle[across]), side * scale / 2 - zoom * (row[up] - middle[up]))
        draw.line([place(row) for row in rows], (90, 120, 180), 3 * scale, joint="curve")
        dots = [place(row) for row in rows[::100]]
        for x, y in dots:
            draw.ellipse([x - 4 * scale, y - 4 * scale, x + 4 * scale, y + 4 * scale], (214, 51, 164))
        (x, y), arm = dots[0], 9 * scale
        draw.line([x - arm, y, x + arm, y], (40, 44, 52), 2 * scale)
        draw.line([x, y - arm, x, y + arm], (40, 44, 52), 2 * scale)
        draw.text(((k + 0.5) * side * scale, side * scale), kind, (40, 44, 52), font, anchor="mt")
    small = sheet.resize((sheet.width // scale, sheet.height // scale), Image.Resampling.LANCZOS)
    small.quantize(64, dither=Image.Dither.NONE).save(DOCS / "paths.png", optimize=True)


# Pictures that need no viewer, or several of its frames.
OTHERS = {"every": every, "paths": paths, "light": light, "still": still, "fig3": figure, "report": report}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--armplane", default=str(DOCS.parent / "target/release/armplane"))
    parser.add_argument("--only", default=",".join([*PICTURES, *ANIMATIONS, *OTHERS]), help="names, separated by commas")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        for name in arguments.only.split(","):
            if name in ANIMATIONS:
                animation(arguments.armplane, name, pathlib.Path(scratch))
            elif name in OTHERS:
                OTHERS[name](arguments.armplane, pathlib.Path(scratch))
            else:
                picture(arguments.armplane, name, pathlib.Path(scratch))
            print(name, flush=True)


if __name__ == "__main__":
    main()
