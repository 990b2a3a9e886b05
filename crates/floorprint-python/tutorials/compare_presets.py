"""Compare presets on a drive: figures, a picture, and the page of ``floorprint compare``.

python compare_presets.py DRIVE OUT
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import floorprint
from floorprint import fleet


def main(drive: str, out: str) -> None:
    folders = []
    for preset in ("fast", "default", "seed"):
        # `fleet.map` takes many logs; here it is one. What fails is an outcome, not an end.
        for outcome in fleet.map([drive], out=Path(out) / preset, preset=preset):
            if outcome.report is None or outcome.folder is None:
                print(f"{preset:<9} {outcome.status}: {outcome.error}")
                continue
            error = outcome.report["errors"].get("trajectory")
            figure = "no truth" if error is None else f"RMSE {error['translation_m']['rmse']:.4f} m"
            print(f"{preset:<9} {figure}, {outcome.report['cost']['cpu_s']:.2f} s of CPU")
            folders.append(outcome.folder)
    page = Path(out) / "compare.html"
    truth = Path(drive) / "truth.tum"
    options = ["--truth", str(truth)] if truth.exists() else []
    compare = [sys.executable, "-m", "floorprint", "compare", *folders, "--out", str(page), *options]
    subprocess.run(compare, check=True)
    figure = floorprint.run(drive, preset="fast").plot()
    figure.savefig(Path(out) / "fast.png", dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
