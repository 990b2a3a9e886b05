# %% [markdown]
# # A hundred logs
#
# `fleet.map` solves many logs, each in a process of its own. A log that crashes, hangs or cannot be read is an outcome
# that says why, not the end of the others. The same lines run on a cluster once Ray is initialised, and logs and
# results may lie in a store: `fleet.map(["s3://bucket/one.bag", …], out="s3://bucket/runs")`.
#
# `python a_hundred_logs.py [COUNT]`, or as a notebook: `jupytext --to notebook a_hundred_logs.py`.

# %%
from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from matplotlib import pyplot
from numpy.typing import NDArray

import floorprint
from floorprint import fleet

# A notebook's kernel has arguments of its own.
arguments = [] if "ipykernel" in sys.modules else sys.argv[1:]
count = int(arguments[0]) if arguments else 100
folder = Path(tempfile.mkdtemp(prefix="floorprint-tutorial-"))

# %%
# A hundred robots, each in a rectangular room of its own, on a circle of 1.5 m radius, with odometry that reads some
# percent long: logs of CARMEN, a line a scan with 180 ranges from −90° to 90° and the pose by odometry.
random = np.random.default_rng(1)
angles_rad = np.radians(np.arange(180) - 90.0)


def scan_line(half_m: NDArray[np.float64], stamp_s: float, scale: float) -> str:
    turned = 2.0 * np.pi * stamp_s / 8.0
    x, y = 1.5 * np.sin(turned), -1.5 * np.cos(turned)
    cos, sin = np.cos(turned + angles_rad), np.sin(turned + angles_rad)
    with np.errstate(divide="ignore"):
        walls_m = [
            (np.copysign(half, way) - at) / way for half, way, at in zip(half_m, (cos, sin), (x, y), strict=True)
        ]
    ranges_m = np.minimum(*walls_m) + random.normal(0.0, 0.01, 180)
    pose = f"{scale * x:.4f} {scale * y:.4f} {turned:.5f}"
    return f"FLASER 180 {' '.join(f'{r:.3f}' for r in ranges_m)} {pose} {pose} {stamp_s:.3f} robot {stamp_s:.3f}"


logs, areas_m2 = [], {}
for number in range(count):
    half_m, scale = random.uniform(2.0, 5.0, 2), random.uniform(1.0, 1.05)
    log = folder / f"robot-{number:03}.clf"
    log.write_text("\n".join(scan_line(half_m, 0.2 * tick, scale) for tick in range(50)) + "\n")
    logs.append(log)
    areas_m2[str(log)] = 4.0 * half_m[0] * half_m[1]
# One of them was cut off before its first scan.
logs[count // 2].write_text("FLASER 180 1.0\n")

# %%
# Outcomes come as they are ready: exactly one for each log. `done` has the figures of report.json.
outcomes = []
for outcome in fleet.map(logs, out=folder / "runs", timeout_s=60.0):
    outcomes.append(outcome)
    if outcome.status != "done":
        print(f"{Path(outcome.log).name} {outcome.status}: {outcome.error}")
print(dict(Counter(outcome.status for outcome in outcomes)))

# %%
# Anything can be asked of all reports: is the free floor of each map as large as its room?
done = [(outcome, outcome.report) for outcome in outcomes if outcome.report is not None]
true_m2 = np.array([areas_m2[outcome.log] for outcome, _ in done])
free_m2 = np.array([report["map"]["free_m2"] for _, report in done])
cpu_s = np.array([report["cost"]["cpu_s"] for _, report in done])
share = np.median(free_m2 / true_m2)
print(f"free floor is {100 * share:.1f} % of the room in the median, at {cpu_s.mean():.2f} s of CPU a log")
worst = int(np.abs(free_m2 / true_m2 - 1.0).argmax())

# %%
# The odd one is looked at: each run's folder is that of `floorprint run`, with its report.html.
figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 5), layout="constrained")
left.plot(true_m2, free_m2, ".", true_m2, true_m2, "-")
left.set(xlabel="room, m²", ylabel="free floor of its map, m²")
session = floorprint.Session.open(Path(str(done[worst][0].folder)) / "session.gpkg")
assert session.map is not None
session.map.plot(right).set_title(f"{Path(done[worst][0].log).name}: {free_m2[worst]:.1f} of {true_m2[worst]:.1f} m²")
figure.savefig("a-hundred-logs.png", dpi=110)
