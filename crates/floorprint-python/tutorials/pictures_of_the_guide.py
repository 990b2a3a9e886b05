"""The pictures of docs/guide.md: each step of the report's particle filter, as it happens on a simulated drive.

    python pictures_of_the_guide.py DRIVE FOLDER

DRIVE is an ECE276A folder with its truth, as ``floorprint simulate --world rooms --out DRIVE`` makes one.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from filter_in_numpy import CELL_M, SIDE, Array, cells_of, draw, moved
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import floorprint

PARTICLES = 300
BLUE, RED, GREY = "#2563eb", "#dc2626", "#9ca3af"


def show(axes: Axes, log_odds: Array, around: Array, half_m: float) -> None:
    """A grid, white where free, black where occupied, grey where unknown."""
    shade = np.select([log_odds < 0, log_odds > 0], [1.0, 0.0], 0.8)
    side_m = CELL_M * SIDE / 2
    axes.imshow(shade, cmap="gray", vmin=0, vmax=1, origin="lower", extent=(-side_m, side_m, -side_m, side_m))
    axes.set(xlim=(around[0] - half_m, around[0] + half_m), ylim=(around[1] - half_m, around[1] + half_m))
    axes.set(aspect="equal", xticks=[], yticks=[])


def save(figure: Figure, folder: Path, name: str) -> None:
    figure.savefig(folder / name, dpi=90, bbox_inches="tight", pil_kwargs={"optimize": True})
    pyplot.close(figure)


def frame_and_map(frame: floorprint.Frame, pose: Array, folder: Path) -> None:
    """Eqs. 8–11 and the map's update: one scan, in the body's frame, in the world and in the grid."""
    figure, (left, middle, right) = pyplot.subplots(1, 3, figsize=(12, 4))
    hits = np.asarray(frame.hits, dtype=np.float64)
    left.plot(*hits.T, ".", color=BLUE, markersize=2)
    left.plot(*frame.origin_m, "o", color=RED)
    left.plot(0, 0, "+", color=RED, markersize=12)
    left.set(title="body's frame: + body, ● LiDAR", aspect="equal", xlabel="x, m", ylabel="y, m")
    world = moved(pose[None], hits)[0]
    middle.plot(*world.T, ".", color=BLUE, markersize=2)
    middle.plot(*pose[:2], "o", color=RED)
    middle.set(title="world: turned by θ, moved by (x, y)", aspect="equal", xlabel="x, m")
    log_odds = np.zeros((SIDE, SIDE))
    draw(log_odds, pose, frame)
    show(right, log_odds, np.array([3.0, 0.5]), 3.6)
    right.set_title("grid: free along each ray, occupied at its end")
    save(figure, folder, "scan.png")


def main(drive: str, out: str) -> None:
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    recording = floorprint.open(drive)
    frames = recording.frames(recording.config(preset="seed"))
    truth = floorprint.read_trajectory(f"{drive}/truth.tum")
    start = np.interp(frames[0].stamp_s, truth["stamp_s"], np.arange(len(truth)))
    first = truth[round(float(start))]

    def true_pose(frame: floorprint.Frame) -> Array:
        """The true pose, seen from the first scan's."""
        at = truth[int(np.abs(truth["stamp_s"] - frame.stamp_s).argmin())]
        cos, sin = np.cos(first["theta"]), np.sin(first["theta"])
        dx, dy = at["x"] - first["x"], at["y"] - first["y"]
        return np.array([cos * dx + sin * dy, -sin * dx + cos * dy, at["theta"] - first["theta"]])

    moving = next(k for k, frame in enumerate(frames) if np.hypot(*true_pose(frame)[:2]) > 1.0)
    frame_and_map(frames[moving], true_pose(frames[moving]), folder)

    # The map up to a moment of the drive, drawn at the true poses, and 60 scans after it without looking: eq. 13.
    since = min(moving + 40, len(frames) // 2)
    ahead = min(40, len(frames) - since)
    log_odds = np.zeros((SIDE, SIDE))
    for frame in frames[:since]:
        draw(log_odds, true_pose(frame), frame)
    random = np.random.default_rng(1)
    poses = np.tile(true_pose(frames[since - 1]), (PARTICLES, 1))
    clouds = [poses.copy()]
    for frame in frames[since : since + ahead]:
        step = np.array(frame.motion or (0.0, 0.0, 0.0))
        poses[:, :2] = moved(poses, step[None, :2])[:, 0]
        poses[:, 2] += step[2]
        # The noise grows with the motion, and a third of it is drawn in turning.
        size = np.hypot(step[0], step[1]) + 0.2 * abs(step[2])
        poses += random.normal(size=poses.shape) * np.array([0.5, 0.5, 0.5]) * size
        clouds.append(poses.copy())
    here, frame = true_pose(frames[since + ahead - 1]), frames[since + ahead - 1]

    figure, axes = pyplot.subplots(figsize=(6, 6))
    show(axes, log_odds, here, 2.0)
    for cloud, colour in zip(clouds[:: ahead // 3], ("#111827", "#7c3aed", "#2563eb", "#06b6d4"), strict=False):
        axes.plot(cloud[:, 0], cloud[:, 1], ".", color=colour, markersize=3)
    axes.plot(*here[:2], "x", color=RED, markersize=12, markeredgewidth=2)
    axes.set_title("predict: the cloud spreads as the robot drives on; × is the truth")
    save(figure, folder, "predict.png")

    # Eqs. 20 and 21: how many of the scan's points fall into occupied cells, from each particle.
    hits = np.asarray(frame.hits, dtype=np.float64)
    column, row = np.moveaxis(cells_of(moved(poses, hits)), -1, 0)
    correlation = (log_odds[row, column] > 0).sum(axis=1).astype(np.float64)
    best, worst = int(correlation.argmax()), int(correlation.argmin())
    figure, panels = pyplot.subplots(1, 3, figsize=(13, 4.4))
    show(panels[0], log_odds, here, 0.6)
    dots = panels[0].scatter(poses[:, 0], poses[:, 1], c=correlation, s=9, cmap="viridis")
    panels[0].plot(*here[:2], "x", color=RED, markersize=12, markeredgewidth=2)
    panels[0].set_title("points in occupied cells, for each particle")
    figure.colorbar(dots, ax=panels[0], fraction=0.045)
    for axes, index, name in ((panels[1], worst, "worst"), (panels[2], best, "best")):
        show(axes, log_odds, here, 4.0)
        axes.plot(*moved(poses[[index]], hits)[0].T, ".", color=BLUE, markersize=2.5)
        axes.plot(*poses[index, :2], "o", color=RED, markersize=4)
        axes.set_title(f"the {name} particle: {correlation[index]:.0f} of {len(hits)} points")
    save(figure, folder, "weigh.png")

    # Eq. 22: few particles have all the weight, so that they are resampled, one from each equal piece of the circle.
    # To count a thousand points as a thousand witnesses is the report's; neighbours err together, as fewer do.
    figure, panels = pyplot.subplots(1, 3, figsize=(13, 4.2))
    for axes, witnesses, colour in ((panels[0], len(hits), RED), (panels[1], 10, BLUE)):
        share = (correlation - correlation.max()) / len(hits) * witnesses
        weights = np.exp(share) / np.exp(share).sum()
        axes.bar(np.arange(60), np.sort(weights)[::-1][:60], color=colour)
        effective = 1.0 / (weights**2).sum()
        axes.set_title(f"{witnesses} witnesses: {effective:.0f} of {PARTICLES} effective")
        axes.set_xlabel("the 60 heaviest particles")
    chosen = np.searchsorted(np.cumsum(weights), (np.arange(PARTICLES) + random.random(PARTICLES)) / PARTICLES)
    kept, copies = np.unique(chosen.clip(max=PARTICLES - 1), return_counts=True)
    show(panels[2], log_odds, here, 0.6)
    panels[2].plot(poses[:, 0], poses[:, 1], ".", color=GREY, markersize=4)
    panels[2].scatter(poses[kept, 0], poses[kept, 1], s=8.0 * copies, facecolors="none", edgecolors=BLUE)
    panels[2].plot(*here[:2], "x", color=RED, markersize=12, markeredgewidth=2)
    panels[2].set_title(f"resampled: {len(kept)} go on")
    save(figure, folder, "resample.png")


if __name__ == "__main__":
    main(*sys.argv[1:])
