# %% [markdown]
# # Paint a floor
#
# A robot with a colour and a depth camera sees the floor ahead. Each image is laid onto the plane of the floor at the
# place where the robot was, and where several show the same spot the best of them count.
#
# `python paint_a_floor.py`, or as a notebook: `jupytext --to notebook paint_a_floor.py`.

# %%
from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np
from matplotlib import pyplot

import floorprint

# %%
# A drive with a camera, and the floor as it truly is.
folder = Path(tempfile.mkdtemp(prefix="floorprint-tutorial-"))
settings = {"motion": {"speed_m_s": 2.0}, "lidar": {"beams": 181, "rate_hz": 5.0}, "camera": {"rate_hz": 0.5}}
floorprint.simulate(folder / "drive", world="rooms", settings=settings)

# %%
result = floorprint.run(folder / "drive")
floor = result.floor
assert floor is not None
# Red, green, blue and opacity of each cell; opacity 0 where nothing was seen. Row 0 lies at the lowest y.
seen = floor.rgba[..., 3] > 0
print(f"{seen.sum() * floor.resolution_m**2:.0f} m² painted in cells of {100 * floor.resolution_m:.0f} cm")

# %%
# Beside it the truth, which a simulation knows. How far are the colours off where both are known?
error = result.report["errors"]["texture"]
print(f"mean error {error['mean_absolute_error']:.1f} of 255, {error['compared_cells']} cells compared")
place = json.loads((folder / "drive" / "truth_texture.json").read_text())
truth = pyplot.imread(folder / "drive" / place["image"])
height, width = truth.shape[:2]
(x, y), side = place["origin"][:2], place["resolution"]

# %%
figure, (left, right) = pyplot.subplots(1, 2, figsize=(12, 6), sharex=True, sharey=True, layout="constrained")
floor.plot(left)
left.plot(result.trajectory["x"], result.trajectory["y"], color="white", linewidth=0.6)
left.set_title("painted, with the trajectory")
right.imshow(truth, extent=(x, x + width * side, y, y + height * side))
right.set(title="truth", xlabel="x, m")
for axes in (left, right):
    axes.set_facecolor("#111827")
figure.savefig("floor.png", dpi=110)

# %%
# The floor is an array like any other: how bright is it on average, where it was seen?
print("mean colour", np.round(floor.rgba[seen][:, :3].mean(axis=0)).astype(int))
