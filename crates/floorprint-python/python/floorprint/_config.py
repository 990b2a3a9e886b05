"""Configuration: options by attributes, checked as they are set."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from os import PathLike, fspath
from typing import Any

from floorprint import _native
from floorprint._errors import ConfigError

#: The presets by name.
presets = ("default", "fast", "accurate", "seed", "gmapping")


def _toml(value: object) -> str:
    """A value as TOML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if hasattr(value, "item"):  # A number of numpy's.
        return _toml(value.item())
    return repr(value)


def _flat(settings: Mapping[str, object], prefix: str = "") -> Iterator[str]:
    """Settings as the command line has them, KEY=VALUE; sections may be mappings."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}={_toml(value)}"


class Section:
    """A section of a configuration; its options are attributes."""

    __slots__ = ("_config", "_prefix")

    def __init__(self, config: Config, prefix: str) -> None:
        object.__setattr__(self, "_config", config)
        object.__setattr__(self, "_prefix", prefix)

    def __getattr__(self, name: str) -> Any:
        return self._config._value(f"{self._prefix}{name}")

    def __setattr__(self, name: str, value: object) -> None:
        self._config._set(f"{self._prefix}{name}", value)

    def __dir__(self) -> list[str]:
        return sorted(self._config._table_at(self._prefix))

    def __repr__(self) -> str:
        return json.dumps(self._config._table_at(self._prefix), indent=2)


class Config:
    """Everything that shapes a run: a preset, a TOML file and settings, over the robot's calibration.

    Options are attributes, ``config.filter.particles = 60``; ``dir(config.filter)`` lists them, ``help`` explains one.
    Values are checked as they are set. A recording's own calibration is laid underneath when the recording is run.

    Args:
        preset: Named configuration to start from.
        file: TOML file laid over the preset.
        robot: The robot's calibration, as sections of ``[robot]``; a recording brings its own.
        settings: Single settings laid over all else, as ``filter={"particles": 60}`` or ``**{"filter.particles": 60}``.

    Raises:
        ConfigError: An option that does not exist, a value of the wrong type or out of range.
    """

    _preset: str
    _file: str | None
    _settings: list[str]
    _robot: str | None
    _table: dict[str, Any]
    _text: str

    def __init__(
        self,
        preset: str = "default",
        *,
        file: str | PathLike[str] | None = None,
        robot: Mapping[str, object] | None = None,
        **settings: object,
    ) -> None:
        of_robot = [] if robot is None else list(_flat({"robot": robot}))
        self._take(preset, None if file is None else fspath(file), of_robot + list(_flat(settings)), None)

    def _take(self, preset: str, file: str | None, settings: list[str], robot: str | None) -> None:
        text, toml = _native.resolve((preset, file, settings, robot))
        values = {
            "_preset": preset,
            "_file": file,
            "_settings": settings,
            "_robot": robot,
            "_table": json.loads(text),
            "_text": toml,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _with(self, settings: Mapping[str, object] | None = None, robot: str | None = None) -> Config:
        config = object.__new__(Config)
        more = [] if settings is None else list(_flat(settings))
        config._take(self._preset, self._file, self._settings + more, self._robot if robot is None else robot)
        return config

    @property
    def layers(self) -> tuple[str, str | None, list[str], str | None]:
        """Preset, file, settings and the robot's calibration (JSON): what it is made of."""
        return (self._preset, self._file, self._settings, self._robot)

    def copy(self, **settings: object) -> Config:
        """The same configuration with other settings."""
        return self._with(settings)

    def to_toml(self) -> str:
        """The resolved configuration as a TOML file, as ``floorprint run --config`` takes it."""
        return self._text

    def to_dict(self) -> dict[str, Any]:
        """The resolved configuration, sections as dictionaries."""
        table: dict[str, Any] = json.loads(json.dumps(self._table))
        return table

    @staticmethod
    def help(key: str) -> str:
        """What an option (``filter.particles``) means."""
        for name, description in _native.options():
            if name == key:
                return description
        raise ConfigError(f"there is no option `{key}`")

    def _table_at(self, prefix: str) -> dict[str, Any]:
        table = self._table
        for part in prefix.split(".")[:-1]:
            table = table[part]
        return table

    def _value(self, key: str) -> Any:
        prefix, _, name = key.rpartition(".")
        table = self._table_at(f"{prefix}." if prefix else "")
        if name not in table:
            raise AttributeError(f"there is no option `{key}`; there are {', '.join(sorted(table))}")
        value = table[name]
        return Section(self, f"{key}.") if isinstance(value, dict) else value

    def _set(self, key: str, value: object) -> None:
        self._take(self._preset, self._file, [*self._settings, f"{key}={_toml(value)}"], self._robot)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._value(name)

    def __setattr__(self, name: str, value: object) -> None:
        self._set(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*self._table, "copy", "help", "layers", "to_dict", "to_toml"})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Config) and self._text == other._text

    def __reduce__(self) -> tuple[Any, ...]:
        return (restored, self.layers)

    def __repr__(self) -> str:
        return f"Config(preset={self._preset!r}, settings={self._settings!r})"


def restored(preset: str, file: str | None, settings: list[str], robot: str | None) -> Config:
    """A configuration of what it was made of."""
    config = object.__new__(Config)
    config._take(preset, file, settings, robot)
    return config


def configuration(config: Config | None, preset: str | None, settings: Mapping[str, object]) -> Config:
    """The configuration that a call asks for."""
    if config is None:
        return Config(preset or "default")._with(settings)
    if preset is not None:
        raise ConfigError("give either a configuration or a preset")
    return config._with(settings)
