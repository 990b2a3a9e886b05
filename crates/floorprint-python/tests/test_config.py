"""Configuration by attributes."""

from __future__ import annotations

import pickle

import pytest

import floorprint


def test_options_are_attributes_and_checked_as_they_are_set() -> None:
    config = floorprint.Config("fast", filter={"particles": 7})
    assert config.filter.particles == 7
    config.filter.particles = 60
    config.seed = 3
    assert (config.filter.particles, config.seed) == (60, 3)
    assert "particles" in dir(config.filter) and "filter" in dir(config)
    with pytest.raises(floorprint.ConfigError, match=r"`filter\.particles` is 0, expected"):
        config.filter.particles = 0
    with pytest.raises(floorprint.ConfigError, match=r"did you mean `filter\.particles`"):
        config.filter.particels = 3
    with pytest.raises(AttributeError, match="particles"):
        _ = config.filter.particels
    assert config.filter.particles == 60, "what is refused changes nothing"
    with pytest.raises(floorprint.ConfigError, match="did you mean `fast`"):
        floorprint.Config("fats")


@pytest.mark.parametrize("preset", floorprint.presets)
def test_every_preset_resolves(preset: str) -> None:
    assert floorprint.Config(preset).to_toml()


def test_configurations_are_pickled_and_compared() -> None:
    config = floorprint.Config("seed", map={"resolution_m": 0.1}, robot={"lidar": {"mount": {"x_m": 0.3}}})
    again = pickle.loads(pickle.dumps(config))
    assert again == config and again.robot.lidar.mount.x_m == 0.3
    assert again.copy(seed=4) != config and config.seed != 4


def test_numbers_of_numpy_are_numbers() -> None:
    import numpy as np

    config = floorprint.Config(map={"resolution_m": np.float32(0.25)}, seed=np.int64(5))
    assert (config.map.resolution_m, config.seed) == (0.25, 5)


def test_options_are_explained() -> None:
    assert "particles" in floorprint.Config.help("filter.particles").lower()
