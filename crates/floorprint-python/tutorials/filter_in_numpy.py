# %% [markdown]
# # The report's particle filter in thirty lines of numpy, beside ours
#
# Equation by equation; docs/guide.md has them with pictures.
#
# `python filter_in_numpy.py [DRIVE [PICTURE]]`, or as a notebook: `jupytext --to notebook filter_in_numpy.py`. DRIVE is
# an ECE276A folder with its truth, as `floorprint simulate --out DRIVE` makes one, and as is made where none is named.

# %%
from __future__ import annotations

import sys
import tempfile

import numpy as np
from matplotlib import pyplot
from numpy.typing import NDArray

import floorprint

Array = NDArray[np.float64]
CELL_M, SIDE, PARTICLES = 0.05, 1000, 200  # A map of 50 m × 50 m around the start.


# %%
def cells_of(points: Array) -> NDArray[np.int64]:
    return np.asarray(np.floor(points / CELL_M), dtype=np.int64) + SIDE // 2


def moved(poses: Array, points: Array) -> Array:
    """Points of the body's frame in the world, for each pose: (particles, points, 2)."""
    x, y, theta = (poses[:, None, axis] for axis in range(3))
    cos, sin = np.cos(theta), np.sin(theta)
    return np.stack([x + cos * points[:, 0] - sin * points[:, 1], y + sin * points[:, 0] + cos * points[:, 1]], -1)


# %%
def draw(log_odds: Array, pose: Array, frame: floorprint.Frame) -> None:
    """Map, §III.A.2: cells that the rays end in are occupied, those passed are free."""
    hits, origin = np.asarray(frame.hits, dtype=np.float64), np.array(frame.origin_m)
    steps = np.linspace(0.0, 1.0, 250, endpoint=False)[:, None, None]
    for points, change in ((origin + steps * (hits - origin), -1.0), (hits, 5.0)):
        column, row = cells_of(moved(pose[None], points.reshape(-1, 2))[0]).T
        seen = np.zeros_like(log_odds, dtype=bool)
        seen[row, column] = True
        log_odds[seen] += change * np.log(9.0)
    np.clip(log_odds, -100.0, 100.0, out=log_odds)


# %%
def particle_filter(frames: list[floorprint.Frame], seed: int = 0) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    log_odds = np.zeros((SIDE, SIDE))
    poses, log_weights = np.zeros((PARTICLES, 3)), np.zeros(PARTICLES)
    trail: list[tuple[float, ...]] = []
    for frame in frames:
        # Predict, eqs. 12–13: every particle moves by the odometry and noise of its own.
        step = np.array(frame.motion or (0.0, 0.0, 0.0))
        if trail:
            poses[:, :2] = moved(poses, step[None, :2])[:, 0]
            poses[:, 2] += step[2]
            poses += random.normal(size=poses.shape) * [0.005, 0.005, 0.003]
        # Weigh, eqs. 20–21: how many points fall into occupied cells.
        hits = np.asarray(frame.hits, dtype=np.float64)
        column, row = np.moveaxis(cells_of(moved(poses, hits)), -1, 0)
        log_weights += (log_odds[row, column] > 0).sum(axis=1)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        best = int(weights.argmax())
        trail.append((frame.stamp_s, *poses[best]))
        draw(log_odds, poses[best], frame)
        # Resample, eq. 22: stratified, where few particles have all the weight.
        if 1.0 / (weights**2).sum() < 0.1 * PARTICLES:
            drawn = (np.arange(PARTICLES) + random.random(PARTICLES)) / PARTICLES
            poses = poses[np.searchsorted(np.cumsum(weights), drawn).clip(max=PARTICLES - 1)]
            log_weights = np.zeros(PARTICLES)
    return np.array(trail), log_odds


# %% [markdown]
# ## Beside ours
#
# The same filter with other draws (preset `seed`) is about as good; what was refined since (preset `default`) is
# better.


# %%
def main(drive: str, picture: str) -> None:
    recording = floorprint.open(drive)
    config = recording.config(preset="seed")
    by_hand, log_odds = particle_filter(recording.frames(config))
    truth = floorprint.read_trajectory(f"{drive}/truth.tum")
    results = {preset: floorprint.run(drive, preset=preset) for preset in ("seed", "default")}
    poses = {
        "odometry": results["seed"].odometry,
        "numpy": by_hand,
        **{name: of.trajectory for name, of in results.items()},
    }
    for name, trajectory in poses.items():
        error = floorprint.evaluate(truth, trajectory)["translation_m"]
        print(f"{name:<9} RMSE {error['rmse']:.4f} m, largest {error['max']:.4f} m")

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 5.5), layout="constrained")
    half_m = CELL_M * SIDE / 2
    shade = np.select([log_odds < 0, log_odds > 0], [1.0, 0.0], 0.8)
    left.imshow(shade, cmap="gray", vmin=0, vmax=1, origin="lower", extent=(-half_m, half_m, -half_m, half_m))
    left.plot(by_hand[:, 1], by_hand[:, 2], color="#dc2626", linewidth=1)
    results["default"].plot(right)
    left.set(title="thirty lines of numpy", aspect="equal", xlim=right.get_xlim(), ylim=right.get_ylim())
    right.set_title("preset default")
    figure.savefig(picture, dpi=110)


# %%
if __name__ == "__main__":
    # A notebook's kernel has arguments of its own.
    arguments = [] if "ipykernel" in sys.modules else sys.argv[1:]
    if not arguments:
        arguments = [f"{tempfile.mkdtemp(prefix='floorprint-tutorial-')}/drive"]
        settings = {"lidar": {"beams": 181, "rate_hz": 5.0}, "camera": {"rate_hz": 0.5}}
        floorprint.simulate(arguments[0], settings=settings)
    main(*arguments, *["filter.png"][len(arguments) - 1 :])
