"""The checker's sentences about outputs and about any two solutions."""

from fractions import Fraction

from persid_check.version_1.conclusions import Conclusions, Outputs
from persid_check.version_1.format import Stability
from persid_check.words import SHOWN, decimal, input_names, root


def bounds(claim: Stability, outputs: Outputs) -> str:
    """Return the bound of every output: L (sqrt(c V) e^{-kappa t/2} + (sqrt(c gamma/kappa) + |D|) sup|u - u*|)."""
    parts = [_bound(claim, outputs, i) for i in range(len(outputs.names))]
    shown = parts[:SHOWN] + ([f"... ({len(parts)} outputs)"] if len(parts) > SHOWN else [])
    return f"the outputs keep to {'; '.join(shown)}; for all t >= 0, with y* for x* and u*"


def _bound(claim: Stability, outputs: Outputs, i: int) -> str:
    c, decay = outputs.lipschitz[i] ** 2 * outputs.constants[i], decimal(claim.kappa / 2, up=False)
    start = f"{root(c)} sqrt(V(x(0))) exp(-{decay} t)"
    gains = [f"{gain} {what}" for gain, what in _gains(claim, outputs, i)]
    gains = gains if len(gains) <= SHOWN else [*gains[:SHOWN], f"... (a part for each of {len(gains)} inputs)"]
    return f"|{outputs.names[i]!r} - y*| <= {' + '.join([start, *gains])}"


def _gains(claim: Stability, outputs: Outputs, i: int) -> list[tuple[str, str]]:
    """The gain from all inputs together, or from each, and what it multiplies."""
    square, D = outputs.lipschitz[i] ** 2, outputs.D[i]
    c = square * outputs.constants[i] / claim.kappa
    names = claim.subject.model.inputs
    if not names:
        return []
    if isinstance(claim.gamma, Fraction):
        direct = sum((d * d for d in D), Fraction(0))
        return [(_sum(c * claim.gamma, square * direct), "sup|u - u*|")]
    parts = zip(input_names(names), D, claim.gamma, strict=True)
    return [(_sum(c * row[-1], square * d * d), f"sup|{name} - {name}*|") for name, d, row in parts]


def _sum(a: Fraction, b: Fraction) -> str:
    """Return a decimal upper bound of sqrt(a) + sqrt(b)."""
    return decimal(Fraction(root(a, digits=9)) + Fraction(root(b, digits=9))) if b else root(a)


def between(conclusions: Conclusions) -> str:
    """Return the sentence about any two solutions."""
    places = "x, y and u" if conclusions.outputs is not None else "x and u"
    return (
        f"The same bounds hold between any two solutions: with {places} of the other one in place of those with a star,"
        " and sqrt(d'P d), d the difference of the two x(0), in place of sqrt(V(x(0)))."
    )


def steps(conclusions: Conclusions) -> list[str]:
    """Return the steps that prove the conclusions."""
    found = []
    if conclusions.outputs is not None:
        if conclusions.outputs.maps is not None:
            found.append(
                "L y - h(y) and L y + h(y) are nondecreasing on R for every output map h: |h(a) - h(b)| <= L |a - b|."
            )
        found.append(
            "c > C M^-1 C' was proved by enclosures for every output, V >= (x - x*)'M (x - x*): |C (x - x*)|^2 <= c V."
        )
    if conclusions.incremental:
        found.append(
            "V has no integrals and every form that is used is nondecreasing on R: all steps hold for the difference of"
            " two solutions."
        )
    return found
