# %% [markdown]
# # Localise a robot in a finished map
#
# Monday's drive makes a map. On Tuesday the robot is switched on somewhere in it and is not told where: it looks at the
# places that fit, drives on, and claims a pose once a single place stands alone.
#
# `python localise.py`, or as a notebook: `jupytext --to notebook localise.py`.

# %%
from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from matplotlib import pyplot

import floorprint

# The camera is of no use here.
settings = {"lidar": {"beams": 181, "rate_hz": 5.0}, "camera": {"rate_hz": 0.5}}
folder = Path(tempfile.mkdtemp(prefix="floorprint-tutorial-"))
floorprint.simulate(folder / "drive", world="rooms", settings=settings)

# %%
# Monday.
monday = floorprint.run(folder / "drive")
monday

# %%
# Tuesday: the same building. The recording's second half is another robot's for all that the localiser knows: it starts
# in the middle of the building, and counts its odometry from there.
recording = floorprint.open(folder / "drive")
config = recording.config()
frames = recording.frames(config)
begin = len(frames) // 2

localizer = floorprint.Localizer(monday.session, config)
reports = [localizer.process(frame) for frame in frames[begin:]]

# %%
# A report's `modes` are the places that are possible, with their weights; it has a pose once one of them stands alone,
# also against all that nobody thought of.
likely = next(k for k, report in enumerate(reports) if report.modes)
found = next(k for k, report in enumerate(reports) if report.pose is not None)
for (x, y, theta), weight in reports[likely].modes:
    print(f"scan {likely + 1}: perhaps at ({x:.2f} m, {y:.2f} m, {np.degrees(theta):.0f}°), weight {weight:.2f}")
print(f"found after {found + 1} scans, {frames[begin + found].stamp_s - frames[begin].stamp_s:.1f} s")

# %%
# How far is what it claims from where Monday's trajectory has the robot?
poses = np.array([report.pose for report in reports[found:] if report.pose is not None])
known = monday.trajectory[begin + found :]
distance_m = np.hypot(poses[:, 0] - known["x"], poses[:, 1] - known["y"])
print(
    f"followed for {len(poses)} scans, median {100 * np.median(distance_m):.1f} cm off, worst {distance_m.max():.2f} m"
)

# %%
figure, axes = pyplot.subplots(figsize=(7, 6), layout="constrained")
monday.map.plot(axes)
axes.plot(known["x"], known["y"], color="#15803d", linewidth=3, alpha=0.5, label="Monday's trajectory")
axes.plot(poses[:, 0], poses[:, 1], color="#dc2626", linewidth=1, label="localised")
axes.plot(*poses[0, :2], "o", color="#dc2626", label="found here")
for (x, y, _), weight in reports[likely].modes:
    axes.plot(x, y, "x", color="#2563eb", markersize=4 + 8 * weight, label=f"possible at scan {likely + 1}")
axes.legend(loc="best", fontsize="small")
figure.savefig("localised.png", dpi=110)
