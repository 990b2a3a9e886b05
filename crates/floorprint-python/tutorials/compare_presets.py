# %% [markdown]
# # Compare presets
#
# The same drive by three presets: figures, a picture, and the page of `floorprint compare`, on which the maps blink
# over each other.
#
# `python compare_presets.py [DRIVE OUT]`, or as a notebook: `jupytext --to notebook compare_presets.py`.

# %%
from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from matplotlib import pyplot

import floorprint

# A notebook's kernel has arguments of its own.
arguments = [] if "ipykernel" in sys.modules else sys.argv[1:]
if arguments:
    drive, out = map(Path, arguments)
else:
    folder = Path(tempfile.mkdtemp(prefix="floorprint-tutorial-"))
    drive, out = folder / "drive", folder / "out"
    floorprint.simulate(drive, settings={"lidar": {"beams": 181, "rate_hz": 5.0}, "camera": {"rate_hz": 0.5}})

# %%
presets = ("fast", "default", "seed")
results = {preset: floorprint.run(drive, preset=preset) for preset in presets}
for preset, result in results.items():
    error = result.report["errors"].get("trajectory")
    rmse = "no truth" if error is None else f"RMSE {error['translation_m']['rmse']:.4f} m"
    print(f"{preset:<9} {rmse}, {result.report['cost']['cpu_s']:.2f} s of CPU")

# %%
figure, panels = pyplot.subplots(1, len(presets), figsize=(15, 5), sharex=True, sharey=True, layout="constrained")
for axes, (preset, result) in zip(panels, results.items(), strict=True):
    result.plot(axes)
    axes.set_title(preset)
out.mkdir(parents=True, exist_ok=True)
figure.savefig(out / "presets.png", dpi=110)

# %%
# The page: each run as a folder, and the command line, which comes with the package.
folders = [out / preset for preset in presets]
for folder, result in zip(folders, results.values(), strict=True):
    result.save(folder, replace=True)
truth = drive / "truth.tum"
options = ["--truth", truth] if truth.exists() else []
compare = ["compare", *folders, "--out", out / "compare.html", *options]
subprocess.run([sys.executable, "-m", "floorprint", *map(str, compare)], check=True)
print(f"open {out / 'compare.html'} in a browser")
