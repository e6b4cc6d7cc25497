"""Setting: one group of a stability claim with the curve that its forms are proved on."""

from dataclasses import dataclass

from persid_check.search.side import Curve, Domain, Shift
from persid_check.subject import Group
from persid_check.version_1.format import GroupProof


@dataclass(frozen=True)
class Setting:
    """One group as the prover sees it: the curve phi_g, the domain r_g'X (None: R), the ball of r_g'(x* - x_ref)."""

    index: int
    group: Group
    proof: GroupProof
    curve: Curve
    domain: Domain
    shift: Shift
