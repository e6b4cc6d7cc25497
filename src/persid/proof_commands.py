"""The commands that prove: certify and check."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from persid.options import FILE, NEW_FILE, proving, talking
from persid.outcomes import (
    DONE,
    EXIT,
    REFUTED,
    UNDECIDED,
    WRONG,
    question,
    read_model,
    refuse_unwritable,
    uninterrupted,
    verdict_rows,
)
from persid.talk import Talk

if TYPE_CHECKING:
    from persid.model import PersidskiiModel


@click.command()
@click.argument("models", nargs=-1, required=True, type=FILE, metavar="MODEL.json...")
@click.option(
    "-o", "--output", type=NEW_FILE, required=True, help="The certificate to write; of several models, MODEL.NAME each."
)
@proving
@talking
def certify(
    models: tuple[Path, ...], output: Path, operating_point: Any, u_op: Any, domain: str, time_limit: float,
    as_json: bool, quiet: bool,
) -> int:  # fmt: skip
    """Decide whether models are input-to-state stable, and write the proofs.

    A file is written only when the checker has accepted it; a certificate of another model under that name is removed.
    The exit code is 1 if one of several models is refuted, else 3 if one stays undecided, else 0.

    \b
    Example:
      persid certify model.json -o certificate.json
    """
    from persid.certify import certify as decide
    from persid.summary import summarize

    talk = Talk(as_json, quiet)
    targets = _targets(models, output)
    asked = question(operating_point, u_op, domain, time_limit)
    subjects = [read_model(path) for path in models]
    for target in targets:
        refuse_unwritable(target)
    found, rows, codes = [], [], []
    with talk.progress() as progress:
        for path, model, target in zip(models, subjects, targets, strict=True):
            verdict = uninterrupted(decide(model, progress=progress, **asked))
            brief = summarize(verdict)
            written = _write_proof(verdict, model, target)
            found.append({"model": str(path), **brief.to_dict(), "file": written})
            rows += [("model", str(path)), *verdict_rows(verdict), ("file", written or "none written")]
            codes.append(EXIT[brief.verdict])
    talk.result(found[0] if len(found) == 1 else {"models": found}, rows)
    return next((code for code in (REFUTED, UNDECIDED) if code in codes), DONE)


@click.command()
@click.argument("certificate", type=FILE, metavar="CERTIFICATE.json")
@click.option("--model", type=FILE, help="model.json, which must be the model of the certificate.")
@click.option("--explain", is_flag=True, help="Print the steps of the proof.")
@talking
def check(certificate: Path, model: Path | None, explain: bool, as_json: bool, quiet: bool) -> int:
    """Check a certificate, exactly, from the file alone.

    This is the independent checker. The same without persid, with Python and python-flint only:
    python -m persid_check CERTIFICATE.json

    \b
    Example:
      persid check certificate.json --model model.json
    """
    import persid_check

    answer = persid_check.check(certificate, model, explain)
    name = type(answer).__name__.lower()
    if isinstance(answer, persid_check.Accepted):
        rows = [("verdict", f"{name}, claim {answer.claim}"), ("statement", answer.statement)]
        rows += [("steps", "\n".join(answer.steps))] if answer.steps else []
        content: dict[str, Any] = {"claim": answer.claim, "statement": answer.statement, "steps": list(answer.steps)}
    else:
        rows = [("verdict", name), ("where", answer.where), ("why", answer.why)]
        content = {"where": answer.where, "why": answer.why}
    Talk(as_json, quiet).result({"result": name, **content}, rows)
    return {"accepted": DONE, "rejected": REFUTED, "malformed": WRONG}[name]


def _targets(models: Sequence[Path], output: Path) -> list[Path]:
    """Return where the certificate of each model goes."""
    if len(models) == 1:
        return [output]
    names = [f"{path.stem}.{output.name}" for path in models]
    if len(set(names)) < len(names):
        raise click.UsageError("models of the same file name cannot share one -o; certify them one by one")
    return [output.with_name(name) for name in names]


def _write_proof(verdict: Any, model: "PersidskiiModel", target: Path) -> str | None:
    """Write the proof of a verdict and return its path; remove a certificate of another model of that name."""
    proof = verdict.certificate if verdict.is_certified else getattr(verdict, "witness", None)
    if proof is not None:
        target.parent.mkdir(parents=True, exist_ok=True)
        proof.save(target)
        return str(target)
    if target.is_file() and model.sha256 not in target.read_text(encoding="utf-8", errors="replace"):
        target.unlink()
    return None
