"""The exceptions that a caller may want to catch. Outcomes (certified, refuted, undecided) are values instead."""


class PersidError(Exception):
    """Base of every error that persid raises on purpose."""


class DataError(PersidError, ValueError):
    """Measurements that cannot be used as they are; the message names the file, the row and the column."""


class ModelError(PersidError, ValueError):
    """A model, or a file of one, that is not of the form x' = A0 x + sum A f(R x) + B u + b."""


class GeneratorError(PersidError, ValueError):
    """A Koopman matrix without a trustworthy real logarithm."""


class UnderdeterminedError(PersidError, ValueError):
    """A fit with fewer independent samples than unknown coefficients."""


class RejectedError(PersidError, ValueError):
    """A certificate that `persid_check` does not accept: rejected, or malformed; the message gives its reason."""


class RoundingError(PersidError):
    """The margin of a floating-point solution was lost when its numbers became exact."""


class FolderError(PersidError, ValueError):
    """A folder that does not hold the results of a run, or whose files do not belong together."""
