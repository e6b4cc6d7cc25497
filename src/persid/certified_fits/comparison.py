"""Comparison: the free fit and the one under the certificate side by side."""

from dataclasses import dataclass

from persid._files import Json
from persid.certified_fits.candidates import Candidate
from persid.certified_fits.multistart import Line
from persid.identification.free_runs import Score


@dataclass(frozen=True, eq=False)
class CertifiedReport:
    """The free fit and the certified one side by side: free runs over all of the data, and how the search went.

    `price` is the certified model's RMSE over the free one's; None where nothing was certified or the free model blows
    up. `stop` is the sentence with which the best descent ended.
    """

    free: Score
    certified: Score | None
    ridge: float | None
    excess: float | None
    stop: str
    seconds: float
    history: tuple[Line, ...]
    table: tuple[Candidate, ...]

    @property
    def price(self) -> float | None:
        """RMSE of the certified model over that of the free one."""
        if self.certified is None or self.free.blow_ups or not self.free.rmse > 0:
            return None
        return self.certified.rmse / self.free.rmse

    def __str__(self) -> str:
        lines = [f"free       {_score_text(self.free)}", f"certified  {_score_text(self.certified)}"]
        if self.price is not None:
            lines.append(f"price      RMSE times {self.price:.3f}; residuals {100 * (self.excess or 0.0):+.2g} %")
        lines += [f"{self.stop} ({self.seconds:.1f} s)", *(_line_text(line) for line in self.history)]
        return "\n".join([*lines, *(_candidate_text(candidate) for candidate in self.table)])


def _score_text(score: Score | None) -> str:
    if score is None:
        return "none found"
    blown = f", {score.blow_ups} runs blow up" if score.blow_ups else ""
    blown += f", {score.unfinished} are too fast to be followed" if score.unfinished else ""
    return f"RMSE {score.rmse:.4g}, R2 " + " ".join(f"{r:.3f}" for r in score.r2_states) + blown


def _line_text(line: Line) -> str:
    end = "certified" if line.certified else "not proved"
    cost = f"residuals {100 * line.excess:+.3g} %, {line.steps} steps, {line.seconds:.1f} s"
    return f"  {line.start}: {end}, {cost}. {line.stop}"


def _candidate_text(row: Candidate) -> str:
    end = f"validation error {row.error:.4g}, R2 {row.r2:.4f}" if row.feasible else "no feasible fit"
    end += {None: "", True: ", certified", False: ", no proof"}[row.certified if row.feasible else None]
    return f"  {', '.join(row.names)}; ridge {row.ridge:.1e}: {end}, {row.seconds:.1f} s"


def comparison(report: CertifiedReport, verdict: str) -> Json:
    """Return both fits side by side in plain numbers, as `run.json` keeps them."""
    scores = (("free", report.free, verdict), ("under the certificate", report.certified, "certified"))
    fits = [
        {"name": name, "verdict": word, "rmse": s.rmse, "r2": list(s.r2_states), "blow_ups": s.blow_ups}
        for name, s, word in scores
        if s is not None
    ]
    history = [
        {
            "start": line.start,
            "certified": line.certified,
            "excess": line.excess,
            "seconds": line.seconds,
            "stop": line.stop,
        }
        for line in report.history
    ]
    table = [
        {
            "functions": list(row.names),
            "ridge": row.ridge,
            "feasible": row.feasible,
            "certified": row.certified,
            "error": row.error,
            "r2": row.r2,
            "seconds": row.seconds,
        }
        for row in report.table
    ]
    return {"fits": fits, "price": report.price, "stop": report.stop, "history": history, "candidates": table}
