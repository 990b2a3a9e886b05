"""Where did the robot drive, what does the building look like, and what lies on its floor?

From a recording to a picture::

    import floorprint

    result = floorprint.run("drive.bag")
    result.plot().savefig("map.png")

Poses are ``(x, y, theta)`` in metres and radians; many of them are structured arrays with fields ``stamp_s`` (seconds),
``x``, ``y`` and ``theta``. The body's origin is midway between the axles, x ahead, y left; the world is the body's
frame at the first scan. Grids have row 0 at the lowest y, as messages of ROS do: ``origin="lower"`` for pictures.
"""

from typing import TYPE_CHECKING

from floorprint._config import Config, presets
from floorprint._errors import ConfigError, DataWarning, Error
from floorprint._evaluation import calibrate, check, errors_over_time, evaluate, evaluate_relations, simulate
from floorprint._live import Localizer, Slam
from floorprint._map import Floor, Map
from floorprint._native import (
    Encoders,
    Frame,
    Imu,
    LocalizationReport,
    Odometry,
    RgbdImage,
    Scan,
    ScanGeometry,
    StepReport,
    version,
)
from floorprint._poses import read_trajectory, tum, write_trajectory
from floorprint._recording import Recording, open
from floorprint._run import Result, run
from floorprint._session import Change, Session
from floorprint._tables import to_arrow, to_pandas

if TYPE_CHECKING:
    from floorprint import fleet

__version__ = version()


def __getattr__(name: str) -> object:
    # Numpy, and what few programs need, is imported when it is used: `import floorprint` is quick.
    if name == "fleet":
        import importlib

        return importlib.import_module("floorprint.fleet")
    raise AttributeError(f"module 'floorprint' has no attribute {name!r}")


__all__ = [
    "Change",
    "Config",
    "ConfigError",
    "DataWarning",
    "Encoders",
    "Error",
    "Floor",
    "Frame",
    "Imu",
    "LocalizationReport",
    "Localizer",
    "Map",
    "Odometry",
    "Recording",
    "Result",
    "RgbdImage",
    "Scan",
    "ScanGeometry",
    "Session",
    "Slam",
    "StepReport",
    "calibrate",
    "check",
    "errors_over_time",
    "evaluate",
    "evaluate_relations",
    "fleet",
    "open",
    "presets",
    "read_trajectory",
    "run",
    "simulate",
    "to_arrow",
    "to_pandas",
    "tum",
    "write_trajectory",
]
