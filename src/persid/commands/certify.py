"""The commands that prove: certify and check."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from persid._files import Json
from persid.commands.console import Talk, complain
from persid.commands.exit_codes import (
    DONE,
    EXIT,
    INTERRUPTED,
    REFUTED,
    UNDECIDED,
    WRONG,
    attempt_rows,
    named_gains,
    question,
    read_any_model,
    refuse_unwritable,
    uninterrupted,
    verdict_rows,
)
from persid.commands.options import FILE, NEW_FILE, Numbers, batching, proving, talking

if TYPE_CHECKING:
    from persid.certificates.margin import Margin
    from persid.models.descriptor import DescriptorModel
    from persid.models.model import PersidskiiModel
    from persid.models.outputs import OutputModel
    from persid.plants.margin import Reading
    from persid.plants.members import CertifiedModels
    from persid.verdicts.batches import Answer
    from persid.verdicts.verdict import Verdict


@click.command()
@click.argument("models", nargs=-1, required=True, type=FILE, metavar="MODEL.json...")
@click.option(
    "-o", "--output", type=NEW_FILE, required=True, help="The certificate to write; of several models, MODEL.NAME each."
)
@proving
@click.option(
    "--gains",
    type=click.Choice(["joint", "each"]),
    default="joint",
    show_default=True,
    help="One gain for all inputs together, or one for each input.",
)
@click.option(
    "--claim",
    type=click.Choice(["strongest", "incremental", "practical"]),
    default="strongest",
    show_default=True,
    help="What is to be proved: the strongest that is found about the operating point, bounds between any two runs, or"
    " where nothing stronger holds a ball about x_ref that every run comes into.",
)
@click.option(
    "--device",
    default="cpu",
    show_default=True,
    help='Where the matrix inequalities are solved: cpu, or a device of PyTorch such as cuda (extra "gpu").',
)
@click.option("--plants", type=NEW_FILE, help="Write the certificate of every plant within the residual margin, too.")
@click.option(
    "--plant",
    type=FILE,
    multiple=True,
    metavar="DATA",
    help="Measurements of the model's states and inputs: say how far from the model the plant may be.",
)
@click.option(
    "--hold",
    type=click.Choice(["zoh", "paper"]),
    default="zoh",
    show_default=True,
    help="With --plant: whether inputs are held from sample to sample or vary.",
)
@click.option(
    "--bound",
    type=Numbers(),
    help="With --plant: measurement noise of at most so much, one number or one a state: linear programmes over all "
    "models that it allows, no statistics.",
)
@click.option(
    "--models",
    "allowed",
    type=NEW_FILE,
    help="With --plant: write the certificate of every model with coefficients that the data allow, or of the part of "
    "them that is certified.",
)
@click.option("--explain", is_flag=True, help="Print every attempt at a verdict, with its outcome and its time.")
@batching
@talking
def certify(
    *, models: tuple[Path, ...], output: Path, operating_point: object, u_op: object, domain: str, time_limit: float,
    rate: float | None, gains: str, claim: str, device: str, plants: Path | None, plant: tuple[Path, ...], hold: str,
    bound: list[float] | None, allowed: Path | None, explain: bool, jobs: int, engine: str, scheduler: str | None,
    as_json: bool, quiet: bool,
) -> int:  # fmt: skip
    """Decide whether models are input-to-state stable, and write the proofs.

    A file is written only when the checker has accepted it: a certificate, a witness against stability, or, of an
    undecided model, the proof that no certificate of the family exists, where there is one. A certificate of another
    model under that name is removed.
    Of several models, one that cannot be read or decided does not stop the others. The exit code is then 1 if one is
    refuted, else 2 if one failed, else 3 if one stays undecided, else 0. After Ctrl-C the proofs of the models that
    were decided are written.

    \b
    Example:
      persid certify model.json -o certificate.json
    """
    from persid.verdicts.batches import certify_many
    from persid.verdicts.certify import certify as decide

    talk = Talk(as_json, quiet, output)
    targets = _targets(models, output)
    if plant and len(models) > 1:
        raise click.UsageError("--plant goes with one model")
    if allowed is not None and not plant:
        raise click.UsageError("--models needs --plant: the measurements that say which models are allowed")
    asked = question(operating_point, u_op, domain, time_limit, rate)
    asked |= {"gains": gains, "claim": claim, "device": device}
    alone = read_any_model(models[0]) if len(models) == 1 else None
    beside: list[Path | None] = [None] * len(models) if plants is None else [*_targets(models, plants)]
    for target in (*targets, *filter(None, (*beside, allowed))):
        refuse_unwritable(target)
    with talk.progress() as progress:
        if alone is not None:
            verdicts: Sequence[Answer] = [uninterrupted(decide(alone, progress=progress, **asked))]
        else:
            chosen = None if engine == "processes" and jobs == 1 else engine
            verdicts = certify_many(models, engine=chosen, jobs=jobs, scheduler=scheduler, progress=progress, **asked)
    found, rows, codes = [], [], []
    for path, verdict, target, second in zip(models, verdicts, targets, beside, strict=True):
        facts, lines, code = _told(path, verdict, target, explain, rate)
        if plant:
            facts["plant"], more = _plant(verdict, alone, plant, _reading(hold, bound, time_limit), allowed)
            lines += more
        if second is not None:
            facts["plants"] = _write_beside(getattr(verdict, "margin", None), second)
            lines.append(("plants file", facts["plants"] or "none written"))
        found.append({"model": str(path), **facts})
        rows += [("model", str(path)), *lines]
        codes.append(code)
    if INTERRUPTED in codes:
        done = len(codes) - codes.count(INTERRUPTED)
        complain(f"interrupted; {done} of {len(codes)} models were decided", INTERRUPTED, False)
    talk.result(found[0] if len(found) == 1 else {"models": found}, rows)
    return next((code for code in (INTERRUPTED, REFUTED, WRONG, UNDECIDED) if code in codes), DONE)


def _told(
    path: Path, verdict: "Answer", target: Path, explain: bool, rate: float | None
) -> tuple[Json, list[tuple[str, str]], int]:
    """Write what a verdict proves; return it for programs, for people, and as an exit code."""
    from persid.verdicts.batches import Failed, was_interrupted
    from persid.verdicts.summary import summarize

    if isinstance(verdict, Failed):
        return {"error": verdict.error}, [("error", verdict.error)], WRONG
    brief = summarize(verdict)
    if was_interrupted(verdict):
        return brief.to_dict(), verdict_rows(verdict), INTERRUPTED
    written = _write_proof(verdict, read_any_model(path), target)
    facts = {**brief.to_dict(), "file": written}
    if gains := named_gains(verdict):
        facts["gains"] = gains
    if explain:
        facts["attempts"] = [attempt.to_dict() for attempt in verdict.attempts]
    rows = [*verdict_rows(verdict, rate), *(attempt_rows(verdict) if explain else [])]
    what = " (proves the reason; stability is not refuted)" if written and brief.verdict == "undecided" else ""
    return facts, [*rows, ("file", f"{written}{what}" if written else "none written")], EXIT[brief.verdict]


@click.command()
@click.argument("certificate", type=FILE, metavar="CERTIFICATE.json")
@click.option("--model", type=FILE, help="model.json, which must be the model of the certificate.")
@click.option("--explain", is_flag=True, help="Print the steps of the proof.")
@talking
def check(certificate: Path, model: Path | None, explain: bool, as_json: bool, quiet: bool) -> int:
    """Check a certificate, exactly, from the file alone.

    This is the independent checker. The same without persid, with Python and python-flint only:
    python -m persid_check CERTIFICATE.json
    The exit code says what is proved: 0 that the model is stable, 1 that it is not, 3 only that no certificate of a
    family exists; 5 that the file proves nothing.

    \b
    Example:
      persid check certificate.json --model model.json
    """
    import persid_check
    from persid_check.__main__ import exit_code

    answer = persid_check.check(certificate, model, explain)
    name = type(answer).__name__.lower()
    if isinstance(answer, persid_check.Accepted):
        rows = [("verdict", f"{name}, claim {answer.claim}"), ("statement", answer.statement)]
        rows += [("steps", "\n".join(answer.steps))] if answer.steps else []
        content: Json = {"claim": answer.claim, "statement": answer.statement, "steps": list(answer.steps)}
    else:
        rows = [("verdict", name), ("where", answer.where), ("why", answer.why)]
        content = {"where": answer.where, "why": answer.why}
    Talk(as_json, quiet).result({"result": name, **content}, rows)
    return exit_code(answer)


def _targets(models: Sequence[Path], output: Path) -> list[Path]:
    """Return where the certificate of each model goes."""
    if len(models) == 1:
        return [output]
    names = [f"{path.stem}.{output.name}" for path in models]
    if len(set(names)) < len(names):
        raise click.UsageError("models of the same file name cannot share one -o; certify them one by one")
    return [output.with_name(name) for name in names]


def _write_proof(
    verdict: "Verdict", model: "PersidskiiModel | OutputModel | DescriptorModel", target: Path
) -> str | None:
    """Write the proof of a verdict and return its path; remove a certificate of another model of that name.

    That no certificate of some family exists is written too, but never over a certificate of this model.
    """
    from persid.verdicts.verdict import Undecided

    proof = verdict.proof
    if proof is not None and not (isinstance(verdict, Undecided) and _is_certificate_of(model, target)):
        target.parent.mkdir(parents=True, exist_ok=True)
        proof.save(target)
        return str(target)
    if target.is_file() and model.sha256 not in target.read_text(encoding="utf-8", errors="replace"):
        target.unlink()
    return None


def _reading(hold: str, bound: list[float] | None, time_limit: float) -> "Reading":
    """Return how measurements of a plant are to be read; one bound is that of every state."""
    from persid.plants.margin import Reading

    size = bound[0] if bound is not None and len(bound) == 1 else bound
    return Reading(hold, noise="random" if bound is None else "bounded", bound=size, time_limit=time_limit)


def _plant(
    verdict: Any, model: Any, files: tuple[Path, ...], reading: "Reading", allowed: Path | None
) -> tuple[Json | None, list[tuple[str, str]]]:
    """Return what measurements say of the plant, for programs and for people; nothing of a model without a margin."""
    from persid.measurements.opening import files_of
    from persid.measurements.readers import read_measurements
    from persid.networks.certificate import NetworkCertificate
    from persid.plants.margin import margin_of

    if getattr(verdict, "margin", None) is None and not isinstance(verdict.proof, NetworkCertificate):
        if allowed is not None:
            _write_beside(None, allowed)
        return None, [("of the plant", "nothing: the model has no residual margin")]
    data = read_measurements(files_of(list(files)), states=list(model.states), inputs=list(model.inputs))
    found = margin_of(verdict, data, reading)
    facts, lines = found.to_dict(), [("of the plant", str(found))]
    if allowed is not None:
        facts["models_file"] = _write_beside(found.models, allowed)
        lines.append(("models file", facts["models_file"] or "none written"))
    return facts, lines


def _write_beside(said: "Margin | CertifiedModels | None", target: Path) -> str | None:
    """Write the certificate of what is said of plants or of models, where there is one; an old one goes."""
    if said is None:
        target.unlink(missing_ok=True)
        return None
    target.parent.mkdir(parents=True, exist_ok=True)
    said.certificate.save(target)
    return str(target)


def _is_certificate_of(model: "PersidskiiModel | OutputModel | DescriptorModel", path: Path) -> bool:
    """Whether a file says that it is a certificate of stability of this model."""
    from persid.certificates.claims import STABILITY

    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    claims = (*STABILITY, "L1")
    return isinstance(content, dict) and content.get("model_sha256") == model.sha256 and content.get("claim") in claims
