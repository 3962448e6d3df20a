"""The config of a training as it would be composed, for commands that run none."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import hydra

from deepring.errors import ConfigError
from deepring.experiment.config import Config, check_config
from deepring.experiment.config_groups import config_folder, register_configs
from deepring.experiment.config_mistakes import config_mistake


def composed(overrides: Sequence[str]) -> Config:
    """The config of ``deepring train`` with these overrides; nothing runs, nothing is written.

    Raises ConfigError for a mistake in the overrides.
    """
    register_configs()
    with (
        in_our_words(overrides),
        hydra.initialize_config_dir(str(config_folder()), version_base="1.3"),
    ):
        return check_config(hydra.compose("train", ["paths.run=.", *overrides]))


@contextmanager
def in_our_words(arguments: Sequence[str]) -> Iterator[None]:
    """Raise what the config libraries say about a mistake in these arguments as ConfigError."""
    try:
        yield
    except Exception as error:
        mistake = config_mistake(error, [text for text in arguments if not text.startswith("-")])
        if mistake is None:
            raise
        raise ConfigError(mistake) from error
