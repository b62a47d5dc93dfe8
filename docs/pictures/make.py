#!/usr/bin/env python3
"""Makes the pictures of README and docs again, each from runs made just before, as the Rerun viewer shows them at 1280 × 720.

    docs/pictures/make.py [--armplane target/release/armplane] [--only NAME,…]

Needs `cargo build --release`, what viewer.py names, the package armplane[experiments], Pillow (`pip install pillow`), and for the report Chromium or its
path in BROWSER.
"""

import argparse
import io
import os
import pathlib
import subprocess
import sys
import tempfile
import tomllib

import armplane
import numpy as np
from matplotlib import pyplot
from PIL import Image, ImageDraw, ImageFont

from viewer import Viewer

HERE = pathlib.Path(__file__).resolve().parent
DOCS = HERE.parent
BROWSER = os.environ.get("BROWSER", "chromium")
# The shots of the viewer.
TAKEN = tomllib.loads((HERE / "pictures.toml").read_text())
# On a sheet of many: size of a shot, how many are in a row, and each one's name.
CELL, COLUMNS = (360, 187), 5
FONT, INK = ImageFont.load_default(15), (230, 232, 236)
# Frames per second, the window, width of a frame.
RATE, WINDOW, WIDTH = 10, "1280x860", 676
# Kinds of paths, as `armplane new --path` knows them.
KINDS = "line circle waypoints spline table".split()


def recording(program, words, folder):
    """The recording of a run."""
    done = subprocess.run([program, *words.split(), "--out", folder], cwd=HERE, capture_output=True, text=True)
    if not (file := folder / "run.rrd").exists():
        sys.exit(f"armplane {words} left no recording: {done.stderr.strip()}")
    return [file]


def cropped(png, part=None):
    return Image.open(io.BytesIO(png)).convert("RGB").crop(part)


def packed(image, palette=None, colours=224):
    """A picture of few colours, which is as good to the eye and a third of the size."""
    return image.quantize(colours, method=Image.Quantize.FASTOCTREE, palette=palette, dither=Image.Dither.NONE)


def sheet(parts, columns):
    """Pictures of one size side by side, row by row."""
    (width, height), rows = parts[0].size, -(-len(parts) // columns)
    whole = Image.new("RGB", (columns * width, rows * height))
    for k, part in enumerate(parts):
        whole.paste(part, (k % columns * width, k // columns * height))
    return whole


def animated(frames, path, durations_ms, width):
    """Saves pictures as one that moves, in this width."""
    frames = [frame.resize((width, width * frame.height // frame.width), Image.Resampling.LANCZOS) for frame in frames]
    # One palette for all, made of several: the background stays as it is from frame to frame and packs well.
    palette = packed(sheet(frames[:: max(1, len(frames) // 6)], 1), colours=128)
    first, *others = [packed(frame, palette) for frame in frames]
    first.save(path, save_all=True, append_images=others, duration=durations_ms, loop=0, optimize=True)
    if path.stat().st_size > 3_000_000:
        sys.exit(f"{path} has {path.stat().st_size} bytes; 3 MB are the most")


def named(part, words):
    """A shot for a sheet of many: small, with its scenario's name."""
    small = part.resize(CELL, Image.Resampling.LANCZOS)
    ImageDraw.Draw(small).text((9, 6), words.split()[1], fill=INK, font=FONT)
    return small


def still(program, name, scratch):
    asked, parts = TAKEN["stills"][name], []
    for k, (words, seconds) in enumerate(asked["shots"].items()):
        with Viewer(recording(program, words, scratch / f"{name}-{k}")) as viewer:
            if name == "light":
                viewer.light()
            viewer.at(seconds)
            parts.append(cropped(viewer.picture(), TAKEN["parts"][asked["part"]]))
    if len(parts) > COLUMNS:
        parts = [*map(named, parts, asked["shots"])]
    packed(sheet(parts, min(len(parts), COLUMNS))).save(DOCS / f"{name}.png", optimize=True)


def animation(program, name, scratch):
    asked, frames = TAKEN["animations"][name], []
    with Viewer(recording(program, asked["run"], scratch / name), WINDOW) as viewer:
        for seconds in np.arange(asked["from_s"], asked["to_s"], asked["speed"] / RATE):
            viewer.at(seconds)
            frames.append(cropped(viewer.picture(), asked["part"]))
    animated(frames, DOCS / name, [1000 // RATE] * (len(frames) - 1) + [1500], WIDTH)


def figure(program, name, scratch):
    """Figure 3 of the paper, as `armplane figures` draws it."""
    subprocess.run([program, "figures", "--out", scratch / name], capture_output=True, check=True)
    packed(cropped((scratch / name / "fig3.png").read_bytes())).save(DOCS / "fig3.png", optimize=True)


def report(program, name, scratch):
    """The first page of a report, in a browser."""
    page, shot = scratch / "report.html", scratch / "report.png"
    recording(program, "run fig5-wrist-rotation", scratch / name)
    subprocess.run([program, "report", scratch / name, "--out", page], capture_output=True, check=True)
    browser = [BROWSER, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={scratch / 'browser'}"]
    subprocess.run([*browser, "--window-size=1280,1080", f"--screenshot={shot}", page.as_uri()], capture_output=True, check=True)
    packed(cropped(shot.read_bytes())).save(DOCS / "report.png", optimize=True)


def paths(program, _, scratch):
    """The path of each kind that `armplane new` writes: the hand's way, and where it is every 0.1 s; a cross where it begins."""
    drawing, panels = pyplot.subplots(1, len(KINDS), figsize=(9.5, 2.2), layout="constrained")
    for axes, kind in zip(panels, KINDS):
        subprocess.run([program, "new", kind, "--path", kind], cwd=scratch, capture_output=True, check=True)
        signals = armplane.trace(scratch / f"{kind}.toml").to_pandas()
        rows = signals.filter(like="desired.position.").dropna().to_numpy()
        # The two axes along which most happens.
        rows = rows[:, sorted(np.argsort(np.ptp(rows, axis=0))[1:])]
        axes.plot(*rows.T, color="#5a78b4", lw=2)
        axes.plot(*rows[::100].T, "o", color="#d633a4", ms=4)
        axes.plot(*rows[0], "+", color="#282c34", ms=14, mew=1.5)
        axes.set_title(kind, y=-0.1)
        middle, half = (rows.max(axis=0) + rows.min(axis=0)) / 2, 0.6 * np.ptp(rows, axis=0).max()
        axes.axis(np.stack([middle - half, middle + half], 1).ravel())
        axes.set_aspect("equal")
        axes.set_axis_off()
    drawing.savefig(DOCS / "paths.png", dpi=100)


PICTURES = {**dict.fromkeys(TAKEN["stills"], still), **dict.fromkeys(TAKEN["animations"], animation), "fig3": figure, "report": report, "paths": paths}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--armplane", type=os.path.abspath, default=str(DOCS.parent / "target/release/armplane"))
    parser.add_argument("--only", default=",".join(PICTURES), help="names, separated by commas")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        for name in options.only.split(","):
            PICTURES[name](options.armplane, name, pathlib.Path(scratch))
            print(name, flush=True)


if __name__ == "__main__":
    main()
