"""The result of a diagnosis: what is missing, what else it might be, what stays unexplained, and what effects that
recordings can't tell apart have in common.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from robot_ident.effects import Effect, unseen_of
from robot_ident.robot.robot import Robot

FAMILIES: dict[str, frozenset[str]] = {
    name: frozenset(members.split())
    for name, members in {
        "static in q": "cable gravity_spring base_tilt end_stop torque_offset encoder_eccentricity torque_ripple",
        "friction over speed": "viscous coulomb stribeck viscous_nonlinear viscous_asymmetric temperature_drift",
        "around reversals": "presliding friction_behind_play time_delay backlash stribeck joint_elasticity",
        "over the load": "load_friction torque_saturation joint_elasticity",
        "friction that varies over the path": "position_friction load_friction coulomb",
        "over acceleration": "rotor_inertia payload joint_elasticity time_delay",
    }.items()
}


FRICTION = frozenset(
    (
        "viscous",
        "coulomb",
        "stribeck",
        "viscous_asymmetric",
        "viscous_nonlinear",
        "presliding",
        "friction_behind_play",
        "load_friction",
        "position_friction",
        "joint_coupling",
        "temperature_drift",
    )
)
"""Effects that rub: what is blamed first, and wrongly where the measuring is at fault."""


def family(names: Collection[str]) -> str | None:
    """Return the family that holds all effects of some names, None where none does."""
    return next((name for name, members in FAMILIES.items() if members.issuperset(names)), None)


Verdict = Literal["adequate", "missing", "unexplained", "not_decidable"]

_TIED_NAMED = 2  # of those that can't be told from an effect, in a sentence


@dataclass(frozen=True)
class Estimate:
    """An estimated parameter of a candidate."""

    name: str
    value: float
    std: float
    unit: str

    @property
    def in_words(self) -> str:
        """The parameter with its standard deviation, where it has one, and its unit."""
        spread = f" ± {self.std:.2g}" if self.std else ""
        return f"{self.name} = {self.value:.4g}{spread} {self.unit}".rstrip()


@dataclass(frozen=True)
class Finding:
    """One candidate: how much it explains and what adding it does.

    explained: share of the excess squared error on its joints that it removes on trajectories left out of the fit.
    Mean squares by joint, (Nm)^2. experiment: the command that designs the motion which tells it from the first of
    those that it is tied with. fix: of a fault of what is measured, the line to change. probability: that it is
    missing, where sets of effects were compared.
    """

    effect: Effect
    p_value: float
    explained: float
    mse_before: Mapping[str, float]
    mse_after: Mapping[str, float]
    validation_before: Mapping[str, float] | None
    validation_after: Mapping[str, float] | None
    parameters: tuple[Estimate, ...]
    tied_with: tuple[str, ...]
    experiment: str | None
    fix: str | None = None
    probability: float | None = None

    @property
    def label(self) -> str:
        """`name@joint`."""
        return self.effect.label

    @property
    def place(self) -> str:
        """The joint of the effect; of one on the whole robot, where it does most."""
        before, after = self.mse_before, self.mse_after
        return self.effect.place or max(before, key=lambda name: before[name] - after[name])

    @property
    def family(self) -> str | None:
        """What the effect and those that it is tied with have in common: `static in q`; None where nothing has."""
        return (
            family({self.effect.name, *(label.partition("@")[0] for label in self.tied_with)})
            if self.tied_with
            else None
        )

    def to_dict(self, rank: int) -> dict[str, Any]:
        """Return the candidate as `diagnose --json` prints it."""
        return {
            "effect": self.effect.name,
            "joint": self.effect.place,
            "rank": rank,
            "p_value": self.p_value,
            "explained": self.explained,
            "probability": self.probability,
            "residual_mse_before": dict(self.mse_before),
            "residual_mse_after": dict(self.mse_after),
            "validation_mse_before": None if self.validation_before is None else dict(self.validation_before),
            "validation_mse_after": None if self.validation_after is None else dict(self.validation_after),
            "parameters": [{"name": p.name, "value": p.value, "std": p.std, "unit": p.unit} for p in self.parameters],
            "tied_with": list(self.tied_with),
            "family": self.family,
            "experiment": self.experiment,
            "fix": self.fix,
        }


EVERYWHERE = "spread over the whole motion"


@dataclass(frozen=True)
class Unexplained:
    """What no known effect explains: the joint, which variables the residual depends on (held-out shares), and where
    it sits; around_reversals: whether most of it is where the joint hardly moves.
    """

    joint: str
    depends_on: Mapping[str, float]
    where: str
    around_reversals: bool = False

    @property
    def everywhere(self) -> bool:
        """Whether no region of the motion holds more of it than its share."""
        return self.where == EVERYWHERE


def either(sets: Sequence[Sequence[str]]) -> str:
    """Return sets of effects in words, the first three of them: `either a or b and c`."""
    told = [" and ".join(labels) or "nothing" for labels in sets[: _TIED_NAMED + 1]]
    more = f", or {len(sets) - len(told)} more sets" if len(sets) > len(told) else ""
    return f"either {', or '.join(told)}{more}"


def _or_tied(finding: Finding) -> str:
    """Return an effect and, in brackets, those that recordings can't tell from it, two of them by name."""
    tied = finding.tied_with
    if not tied:
        return finding.label
    more = f" or {len(tied) - _TIED_NAMED} more" if len(tied) > _TIED_NAMED else ""
    return f"{finding.label} (or {', '.join(tied[:_TIED_NAMED])}{more})"


@dataclass(frozen=True)
class Diagnosis:
    """Verdict, the members found in their order, further candidates, the remainder by joint [Nm rms], and notes.

    hidden_from_sensor: by joint the effects that were no candidates, since effort is measured where they don't show.
    hidden_in_path: the joints whose remainder may all be of the part of the path that noise of the positions hides.
    clock: what the recordings say against the clock of their stamps, empty where nothing. tied_sets: the sets of
    effects that the recordings can't tell apart, the missing one first.
    """

    verdict: Verdict
    missing: tuple[Finding, ...]
    others: tuple[Finding, ...]
    remaining_rms: Mapping[str, float]
    unexplained: Unexplained | None
    notes: tuple[str, ...] = ()
    hidden_from_sensor: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    hidden_in_path: tuple[str, ...] = ()
    clock: str = ""
    tied_sets: tuple[tuple[str, ...], ...] = ()

    @property
    def in_words(self) -> str:
        """The verdict in one sentence, after what is wrong with the time of the recordings."""
        return f"{self.clock}; with this time, {self._verdict}" if self.clock else self._verdict

    @property
    def _verdict(self) -> str:
        if self.verdict == "adequate":
            more = (
                f", and at {', '.join(self.hidden_in_path)} what noise hides of the path" if self.hidden_in_path else ""
            )
            return f"adequate: what is left over is noise{more}"
        if self.verdict == "missing":
            return "missing: " + ", ".join(_or_tied(finding) for finding in self.missing)
        if self.verdict == "not_decidable":
            return "not decidable from these recordings" + (f": {either(self.tied_sets)}" if self.tied_sets else "")
        where = f"; {self.unexplained.joint}: {self.unexplained.where}" if self.unexplained else ""
        return f"unexplained: none of the known effects accounts for the error{where}"

    def seen_by(self, robot: Robot) -> Diagnosis:
        """Return the same with what the robot's sensors can't show, and a line that says so."""
        hidden = unseen_of(robot)
        if not hidden:
            return self
        kinds = dict.fromkeys(name for names in hidden.values() for name in names)
        line = (
            f"{', '.join(hidden)}: effort is measured behind the gear, where {', '.join(kinds)} can't show; they may be"
            " there and were not looked for"
        )
        return replace(self, hidden_from_sensor=hidden, notes=(*self.notes, line))

    def _repr_html_(self) -> str:
        """Show the verdict, the candidates with their evidence and what remains, in a notebook."""
        from robot_ident.markup import listed, paragraph, table

        rows = [
            (
                rank,
                finding.label,
                "missing" if finding in self.missing else "",
                f"{100 * finding.explained:.0f} %",
                "; ".join(p.in_words for p in finding.parameters),
                ", ".join(finding.tied_with),
            )
            for rank, finding in enumerate((*self.missing, *self.others), start=1)
        ]
        found = table(("rank", "effect", "named", "explains", "size", "tied with"), rows) if rows else ""
        rest = table(("joint", "remains, Nm rms beyond noise"), list(self.remaining_rms.items()))
        return paragraph(self.in_words) + found + rest + listed(self.notes)

    def to_dict(self) -> dict[str, Any]:
        """Return what `diagnose --json` prints."""
        listed = [*self.missing, *self.others]
        return {
            "schema": "robot_ident/diagnosis/1",
            "verdict": self.verdict,
            "remaining_rms": dict(self.remaining_rms),
            "missing": [{"effect": s.effect.name, "joint": s.effect.place} for s in self.missing],
            "candidates": [finding.to_dict(rank) for rank, finding in enumerate(listed, start=1)],
            "unexplained": None
            if self.unexplained is None
            else {
                "joint": self.unexplained.joint,
                "depends_on": dict(self.unexplained.depends_on),
                "where": self.unexplained.where,
            },
            "clock": self.clock or None,
            "tied_sets": [list(labels) for labels in self.tied_sets],
            "hidden_in_path": list(self.hidden_in_path),
            "hidden_from_sensor": {joint: list(names) for joint, names in self.hidden_from_sensor.items()},
            "notes": list(self.notes),
        }


Tell = Callable[[float, str], None]
"""Called with the part [0, 1] that is done, never falling, and what is being done."""

_STEP = 0.8  # of what is left: how many steps there will be is not known beforehand


def silent(done: float, what: str) -> None:
    """Tell nobody."""


def after(steps: int, begin: float, end: float) -> float:
    """Return where a part of the work stands after some steps of an unknown number of them."""
    return end - (end - begin) * _STEP**steps
