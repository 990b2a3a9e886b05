"""What can go wrong, with the text of the command line."""


class Error(Exception):
    """A recording, a file or a computation failed: what, where, what was expected, what to do."""


class ConfigError(Error, ValueError):
    """A setting that cannot be used."""


class DataWarning(UserWarning):
    """Something about the data that may have spoilt the result."""
