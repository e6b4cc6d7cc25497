"""The arguments of `persid.certify` that other functions hand on to it."""

from typing import TypedDict


class Asked(TypedDict, total=False):
    """What is asked about a model at every rate; see `persid.certify`."""

    operating_point: object
    u_op: object
    domain: object
    gains: str
    claim: str
    time_limit: float | int
    device: str


class AskedAtRate(Asked, total=False):
    """The same, with the rate in 1/s that a certificate is to have at least."""

    rate: float | int | None
