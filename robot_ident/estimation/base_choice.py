"""What was taken for processing and base model among the candidates, by how much, and how it is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.estimation.held_out import Fitted
from robot_ident.recording.measurement import Processing
from robot_ident.signals.motion import Array

OFFSET, ROTOR, SCALE = "torque_offset", "rotor_inertia", "torque_scale"
PIECES = 8
"""Of the path, each left out in turn."""

_BETTER = 2.0  # standard errors by which torque scales have to predict better than none, one pass than averages
_SCALES_TOLD = 3.0  # from which on they count as measured: true motor torques got .87 to 1.37 below it
_USUAL = 0.7, 1.4  # what a scale lies between, unless a unit or a gear ratio is wrong


@dataclass(frozen=True)
class Candidate:
    """One way to process and one set of columns, with its squared error [PIECES, n] on pieces left out and the torque's
    square there [n]; kept: which columns those are, fitted: to everything.
    """

    processing: Processing
    effects: tuple[str, ...]
    averaged: bool
    error: Array
    torque: Array
    kept: np.ndarray
    fitted: Fitted

    @property
    def score(self) -> float:
        """Sum over joints of ln of the squared error."""
        return float(np.sum(np.log(np.maximum(self.error.sum(axis=0), 1e-300))))

    @property
    def scaled(self) -> bool:
        """Whether joints have torque scales of their own."""
        return any(label.startswith(SCALE) for label in self.effects)

    @property
    def relative(self) -> float:
        """Root of the squared error of all joints over that of the torque."""
        return float(np.sqrt(self.error.sum() / max(float(self.torque.sum()), 1e-300)))

    def worse(self, best: Candidate) -> float:
        """Return by how many standard errors it predicts worse than another, over the pieces: of squared errors or of
        their logarithms, whichever says more. Where one piece is far worse than the others, it alone makes the spread.
        """
        mine, other = (np.maximum(one.error, 1e-300) for one in (self, best))
        difference = np.sum((mine - other) / other.sum(axis=0), axis=1)
        return max(_standard_errors(difference), _standard_errors(np.sum(np.log(mine / other), axis=1)))


@dataclass(frozen=True)
class Choice:
    """The candidate that was taken; band: Hz up to which it was judged, None where there was nothing to choose."""

    processing: Processing
    taken: Candidate | None = None
    band: float | None = None
    candidates: tuple[Candidate, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def effects(self) -> tuple[str, ...]:
        """Offsets, rotor inertias and torque scales that belong to the base model."""
        return () if self.taken is None else self.taken.effects

    @property
    def scale_evidence(self) -> float:
        """Standard errors by which the same without torque scales predicts worse, 0 where there are none."""
        if self.taken is None or not self.taken.scaled:
            return 0.0
        free = [one for one in self.candidates if not one.scaled]
        return min(free, key=lambda one: one.score).worse(self.taken)

    @property
    def scale_spread(self) -> Array | None:
        """Standard errors [n] of torque scales over the pieces, None where there are none."""
        return self.taken.fitted.scale_spread if self.taken is not None and self.taken.scaled else None

    def to_dict(self) -> dict[str, Any] | None:
        """Return what `identify --json` prints of it: what was taken, what was compared, how much worse it was."""
        taken = self.taken
        if taken is None or self.band is None:
            return None
        best = min(self.candidates, key=lambda one: one.score)
        return {
            "band_hz": self.band,
            "pieces": PIECES,
            "effects": list(self.effects),
            "error": taken.relative,
            "standard_errors_worse_than_best": taken.worse(best),
            "scale_evidence": self.scale_evidence,
            "scale_spread": None if self.scale_spread is None else self.scale_spread.tolist(),
            "compared": [
                {
                    "averaged": one.averaged,
                    "low_pass": one.processing.low_pass,
                    "derivative_bandwidth": one.processing.derivative_bandwidth,
                    "effects": list(one.effects),
                    "error": one.relative,
                    "score": one.score - best.score,
                }
                for one in sorted(self.candidates, key=lambda one: one.score)
            ],
        }


def best_of(candidates: Sequence[Candidate]) -> Candidate:
    """Return the candidate of the least score; torque scales only where they serve beyond doubt, and averages, which
    tell the noise, wherever they predict as well.
    """
    free = [one for one in candidates if not one.scaled]
    best, first = min(free, key=lambda one: one.score), min(candidates, key=lambda one: one.score)
    if first.scaled and best.worse(first) >= _BETTER:
        best, free = first, [one for one in candidates if one.scaled]
    alike = [one for one in free if one.averaged and one.worse(best) <= _BETTER]
    return min(alike or [best], key=lambda one: one.score)


def note_of(taken: Candidate, candidates: Sequence[Candidate], band: float) -> str:
    """Return what was taken and by how much others are worse, in a line."""
    kinds = {OFFSET: "offsets", ROTOR: "rotor inertias", SCALE: "torque scales"}
    has = [word for name, word in kinds.items() if any(x.startswith(name) for x in taken.effects)]
    way = _averaged(taken.processing) if taken.averaged else _one_pass(taken.processing)
    rivals = {
        "periods averaged" if not taken.averaged else "as one pass": [
            one for one in candidates if one.averaged is not taken.averaged
        ],
        "without torque scales": [one for one in candidates if not one.scaled and taken.scaled],
        "links and friction alone": [one for one in candidates if not one.effects and taken.effects],
    }
    beside = [
        f"{word} {100 * best.relative:.3g} % ({best.worse(taken):+.1f} standard errors)"
        for word, others in rivals.items()
        if others
        for best in [min(others, key=lambda one: one.score)]
    ]
    told = f" ({'; '.join(beside)})" if beside else ""
    return (
        f"base model by prediction of pieces of the path left out, up to {band:.3g} Hz: {way},"
        f" {' and '.join(has) if has else 'no offsets, no rotor inertias'}; error {100 * taken.relative:.3g} %{told}"
    )


def torque_scale_notes(choice: Choice, scales: Mapping[str, tuple[float, float]]) -> list[str]:
    """Return what torque scales by joint, each with its sigma, mean: measured, or no more than a help to prediction."""
    if not scales:
        return []
    told = ", ".join(f"{joint} {value:.3g} ± {std:.1g}" for joint, (value, std) in scales.items())
    known = choice.scale_evidence >= _SCALES_TOLD
    word = "torque scales beside the first joint's" if known else "torque scales that serve prediction and may be none"
    lines = [
        f"{word}: {told} ({choice.scale_evidence:.1f} standard errors over the pieces, {_SCALES_TOLD:g} count as"
        " measured); what an effort is reported in, or what the links' model lacks; no drive's gain as long as no known"
        " payload says the same"
    ]
    far = [joint for joint, (value, _) in scales.items() if not _USUAL[0] <= value <= _USUAL[1]]
    if far:
        lines.append(
            f"the torque scale of {', '.join(far)} lies beyond {_USUAL[0]:g} to {_USUAL[1]:g}: check the unit of the"
            " effort, the gear ratio and the URDF there before anything else"
        )
    return lines


def _standard_errors(differences: Array) -> float:
    spread = float(np.std(differences, ddof=1) * np.sqrt(len(differences)))
    return float(differences.sum() / spread) if spread > 0.0 else 0.0


def _averaged(processing: Processing) -> str:
    low_pass = processing.low_pass
    return "periods averaged" if low_pass is None else f"periods averaged and low-passed at {low_pass:.3g} Hz"


def _one_pass(processing: Processing) -> str:
    if processing.low_pass is None:
        return "processed as asked"
    wide = processing.derivative_bandwidth or 4.0 * processing.low_pass
    return f"one pass, rows low-passed at {processing.low_pass:.3g} Hz, positions differentiated to {wide:.3g} Hz"
