"""From a recording to a result."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from functools import cached_property
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

from floorprint import _native
from floorprint._config import Config, configuration
from floorprint._evaluation import errors_over_time
from floorprint._map import Floor, Map, floor_of
from floorprint._pictures import BLUE, GREEN, RED, new_figure
from floorprint._poses import structured, tum
from floorprint._progress import Progress, shown
from floorprint._recording import EVERYTHING, Choice, choice
from floorprint._session import Session
from floorprint._tables import to_arrow, to_pandas

if TYPE_CHECKING:
    import numpy as np
    import pandas
    import pyarrow
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

#: The tables of a result.
Table = Literal["trajectory", "odometry", "steps", "closures"]
TABLES = get_args(Table)


def run(
    path: str | PathLike[str],
    *,
    preset: str | None = None,
    config: Config | None = None,
    drive: int | None = None,
    scan: str | Sequence[str] = (),
    odom: str | None = None,
    truth: str | None = None,
    base: str | None = None,
    max_expansion: float | None = None,
    threads: int | None = None,
    texture: bool = True,
    progress: bool | Progress = False,
    **settings: object,
) -> Result:
    """Solves a drive: trajectory, map and floor, the same bytes as ``floorprint run``.

    Args:
        path: Data set: a file or a folder, recognised by its content.
        preset: Named configuration to start from; ``default`` where nothing is said.
        config: Configuration, in the place of a preset.
        drive: Number of the drive, for folders that hold several.
        scan, odom, truth, base: Topics and frame of a bag; what is not chosen is found out.
        max_expansion: How many times its size a file may take in memory, besides 256 MB.
        threads: Threads that share the work; the results are the same for any number. All cores where nothing is said.
        texture: Whether the floor is painted, where there are images.
        progress: ``True`` for a bar (with tqdm), or a callback: task, steps done, steps in all.
        settings: Single settings, as ``filter={"particles": 60}``, ``seed=3`` or ``**{"filter.particles": 60}``.

    Raises:
        ConfigError: A setting cannot be used.
        Error: The recording cannot be read, or no map can be made of it.
        KeyboardInterrupt: Ctrl-C.
    """
    return solve(
        path,
        configuration(config, preset, settings),
        choice(drive, scan, odom, truth, base, max_expansion),
        threads=threads,
        texture=texture,
        progress=progress,
    )


def solve(
    path: str | PathLike[str],
    config: Config,
    chosen: Choice = EVERYTHING,
    *,
    threads: int | None = None,
    texture: bool = True,
    progress: bool | Progress = False,
    address: str | None = None,
) -> Result:
    """Solves a drive; ``address`` is where a recording came from that was fetched to be read."""
    words = ["floorprint.run", address or fspath(path), *config.layers[2]]
    with shown(progress) as show:
        solved = _native.solve(path, chosen, config.layers, threads, texture, " ".join(words), address, show)
    return Result(solved)


class Result:
    """What a drive amounts to."""

    def __init__(self, solved: _native.Solved) -> None:
        self._solved = solved

    @cached_property
    def trajectory(self) -> NDArray[np.void]:
        """The body's pose at every scan, the first the identity.

        Fields stamp_s (seconds), x, y (metres), theta (radians), sigma_m and sigma_rad (standard deviations, NaN where
        nothing is known of them).
        """
        return structured(self._solved.trajectory())

    @property
    def trajectory_tum(self) -> NDArray[np.float64]:
        """The trajectory as an array of shape (n, 8): stamp x y z qx qy qz qw."""
        return tum(self.trajectory)

    @cached_property
    def odometry(self) -> NDArray[np.void]:
        """Dead reckoning at the same stamps: fields stamp_s (seconds), x, y (metres), theta (radians).

        Empty where nothing but scans tells the motion, and without a LiDAR, where the trajectory is dead reckoning."""
        return structured(self._solved.odometry())

    @cached_property
    def truth(self) -> NDArray[np.void] | None:
        """The true trajectory in the result's world; None where it is not known.

        Fields stamp_s (seconds), x, y (metres), theta (radians).
        """
        truth = self._solved.truth()
        return None if truth is None else structured(truth)

    @cached_property
    def steps(self) -> NDArray[np.void]:
        """What each step of the filter said, live: fields index, stamp_s, x, y, theta, sigma_m, sigma_rad, score,
        inlier_share, effective_particles, resampled, odometry_rejected, is_lost."""
        return structured(self._solved.steps())

    @cached_property
    def closures(self) -> NDArray[np.void]:
        """Every comparison of two places: fields older_frame, newer_frame, older_stamp_s, newer_stamp_s, the pose of
        the newer seen from the older (x, y, theta), correction_m, correction_rad, inlier_share, distinctness, sigma_m,
        accepted and verdict (in words)."""
        import numpy as np

        verdicts = np.asarray(self._solved.verdicts(), dtype=np.str_)
        return structured({**self._solved.closures(), "verdict": verdicts})

    @cached_property
    def map(self) -> Map:
        """The occupancy map."""
        cells, resolution_m, origin_m = self._solved.map()
        return Map(resolution_m, origin_m, cells)

    @cached_property
    def floor(self) -> Floor | None:
        """The floor's colours; None where it was not painted."""
        return floor_of(self._solved.floor())

    @property
    def session(self) -> Session:
        """All of it, to be gone on with."""
        return Session(self._solved.session())

    @property
    def report(self) -> dict[str, Any]:
        """The figures of ``report.json``: drive, loops, errors, what was dropped, cost …"""
        report: dict[str, Any] = json.loads(self._solved.report_json())
        return report

    @property
    def config_toml(self) -> str:
        """The configuration in force, with the robot's calibration, as a TOML file."""
        return self._solved.config_toml()

    def save(self, out: str | PathLike[str], *, replace: bool = False) -> None:
        """Writes the folder that ``floorprint run`` writes, whole or not at all.

        Args:
            out: Folder to make.
            replace: Whether an earlier run is replaced; never a folder that also holds anything else.
        """
        self._solved.save(out, replace)

    def to_pandas(self, table: Table = "trajectory") -> pandas.DataFrame:
        """A table of the result as a pandas data frame, by stamps where it has stamps.

        Raises:
            ImportError: pandas is not installed.
        """
        frame = to_pandas(self._table(table))
        return frame.set_index("stamp_s") if "stamp_s" in frame else frame

    def to_arrow(self, table: Table = "trajectory") -> pyarrow.Table:
        """A table of the result as one of Arrow, which polars, DuckDB and Parquet take as it is.

        Raises:
            ImportError: pyarrow is not installed.
        """
        return to_arrow(self._table(table))

    def _table(self, name: str) -> NDArray[np.void]:
        if name not in TABLES:
            raise ValueError(f"there is no table {name!r}; there are {', '.join(TABLES)}")
        array: NDArray[np.void] = getattr(self, name)
        return array

    def plot(self, axes: Axes | None = None) -> Figure:
        """Draws map, dead reckoning (blue) and trajectory (red) with matplotlib; where the truth is known also the true
        trajectory (green), and below the map the errors over time.

        Args:
            axes: Where to draw the map, and nothing else; a new figure where nothing is said.

        Returns:
            The figure: ``savefig`` writes it, a notebook shows it.

        Raises:
            ImportError: matplotlib is not installed.
        """
        errors = (
            [] if self.truth is None else [errors_over_time(self.truth, of) for of in (self.odometry, self.trajectory)]
        )
        # The truth may be of another time, and there may be no odometry.
        has_errors = len(errors) > 0 and len(errors[1]) > 0
        below: list[Axes] = []
        if axes is None:
            axes, below = new_figure(charts=2 if has_errors else 0)
        self.map.plot(axes)
        lines = [("odometry", self.odometry, BLUE, 0.8), ("trajectory", self.trajectory, RED, 1.2)]
        if self.truth is not None:
            lines.append(("truth", self.truth, GREEN, 1.2))
        for name, poses, color, width in lines:
            if len(poses) == 0:
                continue
            style = "--" if name == "truth" else "-"
            axes.plot(poses["x"], poses["y"], style, color=color, linewidth=width, label=name)
        # Dead reckoning that runs far off must not shrink the map to a spot.
        left, right, bottom, top = self.map.extent
        axes.set(xlim=(left, right), ylim=(bottom, top))
        axes.legend(loc="best", fontsize="small")
        if below:
            self._plot_errors(errors, below)
        return cast("Figure", axes.figure)

    def _plot_errors(self, errors: list[NDArray[np.void]], panels: list[Axes]) -> None:
        """Position and heading errors over time, beside what the trajectory states of its uncertainty."""
        import numpy as np

        stamp_s = self.trajectory["stamp_s"]
        sigmas = (self.trajectory["sigma_m"], np.degrees(self.trajectory["sigma_rad"]))
        names = (("translation_m", "position, m"), ("rotation_deg", "heading, °"))
        for axes, (field, label), sigma in zip(panels, names, sigmas, strict=True):
            for error, color in zip(errors, (BLUE, RED), strict=True):
                axes.plot(error["stamp_s"] - stamp_s[0], error[field], color=color, linewidth=0.8)
            axes.plot(stamp_s - stamp_s[0], sigma, ":", color="black", linewidth=0.8, label="stated σ")
            # Dead reckoning runs off; the trajectory is what is looked at.
            highest = np.nanmax([*errors[1][field], *sigma, 1e-9])
            axes.set_ylim(0.0, 1.3 * float(highest))
            axes.set_xlabel("time, s")
            axes.set_title(f"error of the {label}", fontsize="small")
            axes.grid(alpha=0.3)
        panels[0].legend(loc="upper left", fontsize="small")

    def _repr_png_(self) -> bytes:
        return self._solved.picture_png()

    def _repr_html_(self) -> str:
        import base64

        report = self.report
        drive = report["drive"]
        lines = [
            ("drive", f"{drive['length_m']:.1f} m in {drive['duration_s']:.1f} s, {drive['poses']} scans"),
            ("map", "{}×{} cells of {} m".format(*report["map"]["size_cells"], report["map"]["resolution_m"])),
            ("closures", str(int(self.closures["accepted"].sum()))),
            ("cost", f"{report['cost']['wall_s']:.2f} s, {report['cost']['real_time_factor']:.0f}× real time"),
        ]
        error = report["errors"].get("trajectory")
        if error is not None:
            lines.insert(1, ("error", f"RMSE {error['translation_m']['rmse']:.4f} m"))
        rows = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>" for name, text in lines)
        picture = base64.b64encode(self._repr_png_()).decode()
        return f'<table>{rows}</table><img style="max-width:100%" src="data:image/png;base64,{picture}">'

    def __repr__(self) -> str:
        return f"Result({len(self.trajectory)} poses, map {self.map.cells.shape}, {len(self.closures)} closures)"
