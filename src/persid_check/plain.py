"""Numbers of a plain model as canonical text; what is no number stays as it is, for the strict reader to refuse."""

ZERO, NEGATIVE_ZERO = (0.0).hex(), (-0.0).hex()


def texts(values: object, size: int) -> object:
    """Return numbers as text, zeros where none are given."""
    if values is None:
        return [ZERO] * size
    return list(map(text, values)) if isinstance(values, list) else values


def text(value: object) -> object:
    """Return a number as float.hex() writes it, zero without a sign; else what is given."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return ZERO if value == NEGATIVE_ZERO else value
    try:
        return (float(value) + 0.0).hex()
    except OverflowError:
        return value
