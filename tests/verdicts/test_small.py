"""What certify costs for models of two states, in steps of the interior-point method: seconds depend on the machine."""

from dataclasses import dataclass, field

import pytest

import persid as ps
from persid.lyapunov import interior_point


@dataclass
class Counted:
    """Steps taken, and lines of progress."""

    steps: int = 0
    lines: list[str] = field(default_factory=list)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counted:
    """Count the steps of the interior-point method."""
    found, step = Counted(), interior_point.step

    def counting(*args: object) -> object:
        found.steps += 1
        return step(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(interior_point, "step", counting)
    return found


def loop(*functions: str) -> ps.PersidskiiModel:
    """Return a model whose equations both read every function of both states."""
    columns = [[-0.5, 0.3], [-0.2, -0.6]], [[-0.4, 0.1], [0.2, -0.3]]
    terms = [(f, None, A) for f, A in zip(functions, columns, strict=False)]
    return ps.PersidskiiModel([[-1.0, 0.4], [-0.3, -1.5]], terms, [[1.0], [0.5]])


def test_a_function_that_dips_to_zero_is_searched_once(counted: Counted) -> None:
    """No form of sin x + tanh 2x is dropped after a search, so that none is made twice; rate and margin are had."""
    verdict = ps.certify(loop("sin(x) + tanh(2*x)"), progress=counted.lines.append)
    assert isinstance(verdict, ps.Certified)
    assert not any("dropped" in line for line in counted.lines)
    assert counted.steps <= 90  # 275 with forms that no proof holds
    assert verdict.certificate.rate == pytest.approx(0.549, rel=0.02)  # 0.25 then
    assert verdict.margin is not None


def test_the_margin_begins_with_what_earlier_proofs_used(counted: Counted) -> None:
    """The certificate of the margin begins with forms and products that are proved: no search begins anew for it."""
    verdict = ps.certify(loop("sinh(x)", "x/(1+x**2)"))
    assert isinstance(verdict, ps.Certified)
    assert verdict.margin is not None
    assert verdict.margin.certificate.gain == pytest.approx(6.84, rel=0.02)
    assert counted.steps <= 340  # 377 when each question begins anew
