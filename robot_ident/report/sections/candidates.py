"""What might be missing: candidates with their evidence, ties, and the experiment that tells."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.diagnosis.diagnosis import Diagnosis, Suspect
from robot_ident.diagnosis.staircase import Step
from robot_ident.figures.candidates import candidates_figure, candidates_text
from robot_ident.report.findings import Findings
from robot_ident.report.section import Plot, Section, Table
from robot_ident.report.words import NOTHING, percent, short

_HEADER = ("effect", "", "explains", "p", "at joint", "before", "after", "validation before", "validation after")


@dataclass(frozen=True)
class Candidates(Section):
    """What the first model lacked, and what the last one lacks."""

    found: Findings

    title = "What is missing"
    template = "candidates.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return for each diagnosed model the verdict, the candidates and what to do next."""
        models = []
        for place, diagnosis in sorted(self.found.diagnoses.items()):
            step, listed = self.found.steps[place], [*diagnosis.missing, *diagnosis.others]
            models.append(
                {
                    "name": step.name,
                    "verdict": diagnosis.in_words,
                    "figure": Plot(candidates_figure(diagnosis), candidates_text(diagnosis)) if listed else None,
                    "figures": Table(_HEADER, [_row(s, diagnosis) for s in listed], numeric=(2, 3, 5, 6, 7, 8)),
                    "named": [self._named(suspect, step) for suspect in diagnosis.missing],
                    "remains": self._remains(diagnosis),
                    "unexplained": _unexplained(diagnosis),
                }
            )
        return {"models": models, "several": len(self.found.training) > 1}

    def _named(self, suspect: Suspect, step: Step) -> dict[str, Any]:
        """Return a named effect with its size, its ties and the command that adds it."""
        bags = [source.path for source in self.found.training]
        unseen = [word for source in self.found.validation for word in ("--validation", source.path)]
        add = ["robot_ident", "add", step.path, suspect.label, "--bag", *bags, *unseen, "-o", "model_with_it.yaml"]
        effect = suspect.effect
        return {
            "label": suspect.label,
            "meaning": effect.meaning,
            "equation": effect.equation,
            "sizes": [p.in_words for p in suspect.parameters],
            "tied": list(suspect.tied_with),
            "experiment": suspect.experiment or effect.experiment,
            "tell": _tell(suspect, step),
            "add": "" if effect.measuring else shlex.join(add),
        }

    def _remains(self, diagnosis: Diagnosis) -> list[str]:
        robot = self.found.robot
        return [
            f"{joint} {value:.3g} {robot.torque_unit(robot.joint_index(joint))}"
            for joint, value in diagnosis.remaining_rms.items()
            if value > 0.0
        ]


def _row(suspect: Suspect, diagnosis: Diagnosis) -> tuple[str, ...]:
    joint = suspect.effect.place or max(suspect.mse_before, key=lambda j: suspect.mse_before[j] - suspect.mse_after[j])
    unseen = [NOTHING, NOTHING]
    if suspect.validation_before is not None and suspect.validation_after is not None:
        unseen = [short(suspect.validation_before[joint] ** 0.5), short(suspect.validation_after[joint] ** 0.5)]
    return (
        suspect.label,
        "missing" if suspect in diagnosis.missing else "",
        percent(suspect.explained),
        f"{suspect.p_value:.1g}" if suspect.p_value else "< 1e-300",
        joint,
        short(suspect.mse_before[joint] ** 0.5),
        short(suspect.mse_after[joint] ** 0.5),
        *unseen,
    )


def _tell(suspect: Suspect, step: Step) -> str:
    """Return the command that designs the motion which tells an effect from the first that it is tied with."""
    if not suspect.tied_with:
        return ""
    words = ["robot_ident", "design", "--model", step.path, "--tell", suspect.label, suspect.tied_with[0]]
    return shlex.join([*words, "-o", "tell.yaml"])


def _unexplained(diagnosis: Diagnosis) -> dict[str, Any] | None:
    if diagnosis.unexplained is None:
        return None
    ranked = sorted(diagnosis.unexplained.depends_on.items(), key=lambda item: -item[1])
    shares = [f"{name.replace('_', ' ')} {percent(share)}" for name, share in ranked if share >= 0.005]
    return {"joint": diagnosis.unexplained.joint, "where": diagnosis.unexplained.where, "shares": shares}
