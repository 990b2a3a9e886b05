# %% [markdown]
# # Bring your own robot
#
# Readings are pushed as they come in, from any driver. The robot here is made up: it drives a circle in a room of
# 8 m × 6 m, with odometry that reads 1 % long.
#
# `python your_own_robot.py`, or as a notebook: `jupytext --to notebook your_own_robot.py`.

# %%
from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

import floorprint

# %%
# The LiDAR sits 10 cm ahead of the point whose odometry is told, 30 cm above the floor.
config = floorprint.Config(robot={"lidar": {"mount": {"x_m": 0.1, "z_m": 0.3}}})
# The rays of its scans, counter-clockwise.
geometry = floorprint.ScanGeometry(np.linspace(-math.pi, math.pi, 360, endpoint=False), 0.05, 12.0)


def pose_at(stamp_s: float) -> tuple[float, float, float]:
    """Where the robot really is: on a circle of 2 m radius, once around in twelve seconds."""
    angle = 2.0 * math.pi * stamp_s / 12.0
    return 2.0 * math.sin(angle), -2.0 * math.cos(angle), angle


def ranges_at(stamp_s: float) -> NDArray[np.float64]:
    """What the LiDAR measures: the nearest of four walls along each ray."""
    x, y, theta = pose_at(stamp_s)
    x, y = x + 0.1 * math.cos(theta), y + 0.1 * math.sin(theta)
    cos, sin = np.cos(theta + geometry.angles_rad), np.sin(theta + geometry.angles_rad)
    with np.errstate(divide="ignore"):
        to_x = (np.copysign(4.0, cos) - x) / cos
        to_y = (np.copysign(3.0, sin) - y) / sin
    return np.asarray(np.minimum(to_x, to_y))


# %%
slam = floorprint.Slam(config)
newest = None
for tick in range(1200):
    # 50 Hz of odometry, 10 Hz of scans.
    stamp_s = 0.02 * tick
    reports = slam.push(floorprint.Odometry(stamp_s, *pose_at(1.01 * stamp_s)))
    if tick % 5 == 0:
        reports += slam.push(floorprint.Scan(stamp_s, ranges_at(stamp_s), geometry))
    # A scan comes out once the odometry has passed it.
    newest = reports[-1] if reports else newest

# %%
assert newest is not None
assert slam.map is not None
# The world is the body's frame at the first scan.
(x, y, theta), (x0, y0, _) = pose_at(newest.stamp_s), pose_at(0.0)
off_m = math.hypot(newest.pose[0] - (x - x0), newest.pose[1] - (y - y0))
print(f"at {newest.pose}, ±{newest.sigma_m:.3f} m; map of {slam.map.cells.shape} cells")
print(f"{100.0 * off_m:.1f} cm off after two rounds")
session = slam.finish()
