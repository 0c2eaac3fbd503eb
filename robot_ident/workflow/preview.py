"""What a model would become with one effect more, before it is fitted for good."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from robot_ident.diagnosis.before_after import errors, estimates, mean_squares
from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.diagnosis.selection.refinement import best_values
from robot_ident.effects import Effect, candidates_of, make_effect
from robot_ident.errors import InputError
from robot_ident.estimation.equations import apart
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import Evidence, extended, gather, held
from robot_ident.regression.weighed_by_residual import tells_noise, weighed_by_residual
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Preview:
    """An effect beside a model: mean squares by joint before and after [(Nm)^2], on training and on validation (None
    without), its parameters, and the torque [N, n] Nm that would then be predicted along each recording, those of
    validation last.
    """

    effect: Effect
    before: dict[str, float]
    after: dict[str, float]
    validation_before: dict[str, float] | None
    validation_after: dict[str, float] | None
    parameters: tuple[Estimate, ...]
    predicted: tuple[Array, ...]


class Forecast:
    """A model's structure with its evidence, gathered once for all effects that are looked at."""

    def __init__(
        self, measurements: Sequence[Measurement], structure: Structure, validation: Sequence[Measurement]
    ) -> None:
        """Gather the evidence as a diagnosis does."""
        told = all(tells_noise(measured) for measured in measurements)
        self.measurements, self.validation = measurements, validation
        self.evidence = (gather if told else weighed_by_residual)(measurements, structure)

    def of(self, effect: Effect) -> Preview:
        """Return what an effect at its inner parameters would do.

        Linear parameters are fitted anew together with the effect's, inner ones stay; `add` searches these as well.
        """
        fit = after = extended(self._told_of(effect), [effect])
        if effect.trends:
            after = held(self.evidence, fit.structure, fit.values)
        there = bool(self.validation)
        return Preview(
            effect=effect,
            before=mean_squares(self.evidence),
            after=mean_squares(after),
            validation_before=errors(self.evidence, self.validation) if there else None,
            validation_after=errors(after, self.validation) if there else None,
            parameters=estimates(fit, effect),
            predicted=tuple(_predicted(after, m) for m in (*self.measurements, *self.validation)),
        )

    def _told_of(self, effect: Effect) -> Evidence:
        """Return the evidence that tells an effect's size: of periods taken apart where it changes between them."""
        if not effect.trends or not all(tells_noise(measured) for measured in self.measurements):
            return self.evidence
        return gather(apart(self.measurements, [effect]), self.evidence.structure)

    def named(self, label: str) -> Preview:
        """Return what `name@joint` would do at the inner parameters that suit the data best.

        Raises InputError where the recordings can't show it, or the model holds it already.
        """
        structure = self.evidence.structure
        effect = make_effect(label, structure.robot)
        if effect.label in structure.labels:
            raise InputError(f"{effect.label} is in the model already")
        if not effect.regression:
            raise InputError(f"{effect.label} can't be fitted: it shows by other evidence ({effect.evidence})")
        averaged = all(measured.motion.periodic for measured in self.measurements)  # trends do not show there
        possible = {one.label for one in candidates_of(structure) if not (one.trends and averaged)}
        found = best_values(effect, self.evidence) if effect.label in possible else None
        if found is None:
            raise InputError(f"{effect.label}: these recordings can't show it, or the model holds its column already")
        return self.of(found[0])


def _predicted(evidence: Evidence, measured: Measurement) -> Array:
    columns = evidence.structure.columns(measured.motion, evidence.values)
    return measured.passed(columns @ evidence.values)
