"""The exception family: every message says what was wrong, where, and what to do."""


class StereoHdrError(Exception):
    """Base of every error that stereohdr raises on purpose."""


class InputError(StereoHdrError, ValueError):
    """The images or arguments that were given cannot be used as they are."""


class ExposureError(InputError):
    """Exposure times are missing, identical, or contradict the images."""


class ConfigError(InputError):
    """A configuration value is unknown, of the wrong type, or out of range."""


class MemoryLimitError(InputError):
    """The photos need more memory than they may take; the message says how much."""


class FileFormatError(InputError):
    """A file cannot be read, or not be written in the format that its name asks for."""


class OutputError(StereoHdrError):
    """A file could not be written although its name is fine: the disk is full, or writing is not permitted."""


class ResponseError(InputError):
    """A response curve is malformed, or the pair does not determine one."""


class MissingDependencyError(StereoHdrError):
    """An optional package is needed for what was asked; the message names the extra to install."""


class StereoHdrWarning(UserWarning):
    """The result is usable, but the user should know something about it."""
