"""The columns of a model: rigid-body base parameters and effects, in one order with names and units."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_ident.effects import CATALOGUE, Effect, Signals, Torques, beside, holder, make_effect
from robot_ident.effects.torque_scale import TorqueScale
from robot_ident.errors import InputError
from robot_ident.model.base_parameters import BaseParameters, random_states, reduce_to_base
from robot_ident.model.rigid_sensitivity import RigidSensitivity
from robot_ident.robot.drives import in_ampere
from robot_ident.robot.robot import Robot, at_every_joint
from robot_ident.signals.motion import Array, Motion

PAPER = ("viscous", "coulomb")
"""Effects of the paper's model, on every joint."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a model; `joint` is None where it belongs to no single joint."""

    name: str
    unit: str
    joint: str | None
    effect: str
    meaning: str


@dataclass(frozen=True)
class Structure:
    """tau = Phi(q, dq, ddq) theta (Swevers et al. 1997, eq. 1): what the columns of Phi are.

    parameters [p]: those that Phi is linear in. inner [r]: those inside the columns of effects, whose values the
    effects hold. given: how many of the effects, the first ones, every model of the robot has.
    """

    robot: Robot
    base: BaseParameters
    effects: tuple[Effect, ...]
    parameters: tuple[Parameter, ...]
    inner: tuple[Parameter, ...] = ()
    notes: tuple[str, ...] = ()
    given: int = 0

    @classmethod
    def build(cls, robot: Robot, effects: Sequence[str | Effect] = ()) -> Structure:
        """Return the paper's model of a robot, its known effects and further ones (`name@joint`, or effects
        themselves).

        Raises InputError on an unknown effect or joint, one that is in the model already, or one whose column others
        span.
        """
        base = reduce_to_base(robot)
        known = [f"{name}@{joint}" for name in PAPER for joint in robot.joints]
        known += [label for label in robot.known_effects if label not in known]
        made: list[Effect] = []
        spare = _compared_with_none(known, robot)
        notes = [_reference_note(label) for label in spare]
        for effect in (make_effect(label, robot) for label in known if label not in spare):
            labels = [other.label for other in made]
            if effect.unseen and effect.name not in PAPER:
                notes.append(f"{effect.label} is left out: {effect.unseen}")
                continue
            into = _merges(effect, base) or holder(effect, labels)
            if into:
                notes.append(f"{effect.label} merges with {into}")
            else:
                made.append(beside(effect, labels))
        notes += [
            f"{name} follows {leader} in the URDF (mimic: a parallelogram or a belt) and stands still in this model: it"
            f" is wrong wherever {leader} moves what hangs on {name}"
            for name, leader in robot.following.items()
        ]
        notes += _behind_the_gear(robot)
        own = cls(robot, base, tuple(made), _linear(robot, base, made), _inner(made), tuple(notes), len(made))
        return own.with_further(effects)

    @property
    def rotors_left_out(self) -> tuple[str, ...]:
        """A line on each rotor of the robot's description whose inertia neither a link nor an effect holds."""
        robot, labels = self.robot, set(self.labels)
        out = []
        for joint in self.base.free_rotors:
            name, size = robot.joints[joint], float(robot.drives.armature[joint])
            label = f"rotor_inertia@{name}"
            if size > 0.0 and label not in labels and robot.side(joint) != "link":
                out.append(
                    f"{name}: its armature, {size:.3g} kg m^2, is in no parameter of this model (no link's inertia has"
                    f" its column): add --effect {label}, or effects: [{label}] in the robot YAML"
                )
        return tuple(out)

    def with_further(self, effects: Sequence[str | Effect]) -> Structure:
        """Return the model with further effects (`name@joint`, or effects themselves); raises InputError as `build`.

        `name@*` is the effect on every joint where the model does not hold its column yet, none of which is named by
        itself; of one that compares joints (a torque scale) the first of them stays without, and a note says so.
        """
        made = list(self.effects)
        each, notes = self._each(effects)
        for item in each:
            effect = make_effect(item, self.robot) if isinstance(item, str) else item
            labels = [other.label for other in made]
            if effect.label in labels:
                raise InputError(f"effect {effect.label!r} is in the model already")
            if effect.unseen:
                raise InputError(f"effect {effect.label!r}: {effect.unseen}")
            into = _merges(effect, self.base) or holder(effect, labels)
            if into:
                raise InputError(f"effect {effect.label!r} merges with {into}: its column is in the model already")
            made.append(beside(effect, labels))
        for label in _compared_with_none([effect.label for effect in made], self.robot):
            name, _, joint = label.partition("@")
            raise InputError(
                f"{name} at every joint: it compares joints, and one of them is the reference; leave out {joint}"
            )
        parameters, inner = _linear(self.robot, self.base, made), _inner(made)
        return replace(self, effects=tuple(made), parameters=parameters, inner=inner, notes=(*self.notes, *notes))

    def _each(self, effects: Sequence[str | Effect]) -> tuple[list[str | Effect], list[str]]:
        """Return effects one by one, and notes on joints left out; InputError where `name@*` has no joint left."""
        out: list[str | Effect] = []
        notes: list[str] = []
        named = [item if isinstance(item, str) else item.label for item in effects]
        held = [*self.labels, *(one for one in named if not one.endswith("@*") and one.partition("@")[0] in CATALOGUE)]
        for item in effects:
            if not isinstance(item, str) or not item.endswith("@*"):
                out.append(item)
                continue
            at = [label for label in self._possible(item) if self.lacks(label, held)]
            spare = _reference_note(at.pop(0)) if at and _compared_with_none([*held, *at], self.robot) else ""
            notes += [spare] if spare else []
            if not at:
                every = [make_effect(label, self.robot) for label in at_every_joint([item], self.robot.joints)]
                unseen = next((f": {e.unseen}" for e in every if e.unseen), f"; {spare}" if spare else "")
                raise InputError(f"effect {item!r}: no joint's column is left to add{unseen}")
            out += at
        return out, notes

    def _possible(self, every: str) -> list[str]:
        """Return what `name@*` stands for at the joints that can have it; all where none can."""
        labels = at_every_joint([every], self.robot.joints)
        kind = CATALOGUE.get(every.partition("@")[0])
        if kind is None or kind.scope == "robot":
            return list(labels)
        return [label for k, label in enumerate(labels) if not kind.available(self.robot, k)] or list(labels)

    def lacks(self, label: str, held: Sequence[str] | None = None) -> bool:
        """Return whether an effect has a column that can be seen and that none of the effects that are held has (None:
        those of the model).
        """
        effect, held = make_effect(label, self.robot), self.labels if held is None else held
        return not (label in held or effect.unseen or _merges(effect, self.base) or holder(effect, held))

    @property
    def joints_scaled(self) -> tuple[str, ...]:
        """Names of the joints whose torque scale is a parameter."""
        return tuple(self.robot.joints[joint] for joint in self.scaled)

    @property
    def added(self) -> tuple[Effect, ...]:
        """The effects that the robot doesn't bring along."""
        return self.effects[self.given :]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the linear parameters [p]."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def labels(self) -> tuple[str, ...]:
        """The effects as `name@joint`."""
        return tuple(effect.label for effect in self.effects)

    @property
    def placed(self) -> tuple[tuple[Effect, slice], ...]:
        """The effects, each with the columns of Phi, and so the places in theta [p], that are its own."""
        ends = np.cumsum([len(self.base.columns), *(len(effect.coefficients) for effect in self.effects)]).tolist()
        return tuple((effect, slice(*span)) for effect, *span in zip(self.effects, ends[:-1], ends[1:], strict=True))

    def places_of(self, chosen: Callable[[Effect], bool]) -> np.ndarray:
        """Return which linear parameters [p] belong to the effects that are chosen (boolean)."""
        out = np.zeros(len(self.parameters), dtype=bool)
        for effect, own in self.placed:
            out[own] = chosen(effect)
        return out

    @property
    def through_links(self) -> np.ndarray:
        """Which linear parameters [p] reach the drives through the links, in the torque scale of each joint."""
        out = self.places_of(lambda effect: effect.through_links)
        out[: len(self.base.columns)] = True
        return out

    def with_only(self, kept: Callable[[Effect], bool]) -> tuple[Structure, np.ndarray]:
        """Return the structure with no effects but those that are kept, and which of the parameters [p] it has."""
        here = ~self.places_of(lambda effect: not kept(effect))
        effects = tuple(effect for effect in self.effects if kept(effect))
        parameters = tuple(self.parameters[k] for k in np.flatnonzero(here))
        given = sum(kept(effect) for effect in self.effects[: self.given])
        return replace(self, effects=effects, parameters=parameters, inner=_inner(effects), given=given), here

    @property
    def settings(self) -> Array:
        """Values of the inner parameters [r]."""
        return np.array([effect.setting[inner.name] for effect in self.effects for inner in effect.inner])

    def with_settings(self, settings: Iterable[float]) -> Structure:
        """Return the same structure with other inner parameters [r]."""
        values = iter(settings)
        effects = [effect.at({inner.name: float(next(values)) for inner in effect.inner}) for effect in self.effects]
        return replace(self, effects=tuple(effects))

    @property
    def uses_torque(self) -> bool:
        """Whether columns depend on the parameters, through the model's own torque."""
        return any(effect.uses_torque for effect in self.effects)

    def rigid_columns(self, motion: Motion) -> Array:
        """Return the columns of the base parameters [N, n, b], before any torque scale."""
        return self.robot.rigid.regressor(motion)[:, :, list(self.base.columns)]

    @property
    def scales(self) -> Array:
        """The scale [n] in which each joint's torque is reported: 1 where no effect says otherwise."""
        out = np.ones(self.robot.n)
        for effect in self.effects:
            if isinstance(effect, TorqueScale):
                out[effect.joint] = effect.scale
        return out

    @property
    def scaled(self) -> tuple[int, ...]:
        """Joints whose torque scale is a parameter."""
        return tuple(effect.joint for effect in self.effects if isinstance(effect, TorqueScale))

    def reported(self, rigid: Array) -> Array:
        """Return columns or torques [N, n, ...] of the links in the scale of each joint."""
        if not self.scaled:
            return rigid
        return np.asarray(rigid * self.scales.reshape(1, -1, *([1] * (rigid.ndim - 2))))

    def columns(self, motion: Motion, values: Array | None = None, rigid: Array | None = None) -> Array:
        """Return Phi [N, n, p] along a motion.

        values [p or more] are needed where an effect depends on the model's torque (zero torque is taken without them).
        rigid: `rigid_columns`, where they are known already.
        """
        return np.concatenate(self.parts(motion, values, rigid), axis=2)

    def parts(
        self,
        motion: Motion,
        values: Array | None = None,
        rigid: Array | None = None,
        sensitivity: RigidSensitivity | None = None,
    ) -> list[Array]:
        """Return the columns [N, n, k] of the base parameters and of each effect apart; sensitivity: of the rigid arm
        with these values, where it is known already.
        """
        rigid = self.reported(self.rigid_columns(motion) if rigid is None else rigid)
        plain = [rigid, *(self.columns_of(effect, motion) for effect in self.effects if not effect.uses_torque)]
        if not self.uses_torque:
            return plain
        torques = self._torques(motion, plain, values, sensitivity)
        rest = iter(plain[1:])
        return [rigid, *(self.columns_of(e, motion, torques) if e.uses_torque else next(rest) for e in self.effects)]

    def columns_of(self, effect: Effect, motion: Motion, torques: Torques | None = None) -> Array:
        """Return the columns [N, n, k] of an effect, its own or one that it may lack, as each joint reports them."""
        columns = effect.columns(motion, torques)
        return self.reported(columns) if effect.through_links else columns

    def sensitivity(self, motion: Motion, values: Array) -> RigidSensitivity:
        """Return how the torque of the rigid arm with parameters values [p or more] changes along a motion."""
        return RigidSensitivity(self.robot, self.base, values[: len(self.base.columns)], motion, self.scales)

    def torques(self, motion: Motion, values: Array, rigid: Array | None = None) -> Torques:
        """Return the torques [N, n] that effects may depend on; rigid: as for `columns`."""
        rigid = self.reported(self.rigid_columns(motion) if rigid is None else rigid)
        plain = (self.columns_of(effect, motion) for effect in self.effects if not effect.uses_torque)
        return self._torques(motion, [rigid, *plain], values)

    def _torques(
        self,
        motion: Motion,
        plain: Sequence[Array],
        values: Array | None,
        sensitivity: RigidSensitivity | None = None,
    ) -> Torques:
        if values is None:
            nothing = np.zeros(plain[0].shape[:2])
            return Torques(nothing, nothing)
        load, total, dry = self.load_total_dry(plain, values)
        return Torques(load, total, sensitivity or self.sensitivity(motion, values), dry)

    def load_total_dry(self, plain: Sequence[Any], values: Array) -> tuple[Any, Any, Any]:
        """Return the torque of what loads the gear, of all effects that don't depend on torque, and of dry friction.

        plain: columns (numbers or expressions) of the base parameters and of those effects, values [p or more].
        """
        load = total = plain[0] @ values[: len(self.base.columns)]
        dry = 0.0 * load
        rest = iter(plain[1:])
        for effect, own in self.placed:
            if effect.uses_torque:
                continue
            torque = next(rest) @ values[own]
            total = total + torque
            if effect.loads_gear:
                load = load + torque
            if effect.steps:
                dry = dry + torque
        return load, total, dry

    def true_values(self) -> Array:
        """Return theta [p] of the simulated robot.

        Base parameters come from URDF and armature, effects from the robot's YAML (0 where it has none).
        """
        robot = self.robot
        base = self.base.values(robot.rigid.parameters, robot.drives.armature)
        coefficients: list[float] = []
        for effect in self.effects:
            truth = effect.truth()
            coefficients += [0.0] * len(effect.coefficients) if truth is None else effect.coefficient_values(truth)
            if truth is not None:
                base = base + self._absorbed(effect, truth)
        return np.concatenate([base, coefficients])

    def _absorbed(self, effect: Effect, truth: dict[str, float]) -> Array:
        """Return what the part of an effect that has no column of its own adds to the base parameters."""
        motion = random_states(self.robot)
        terms = effect.absorbed(Signals.of(motion), np, truth)
        if not terms:
            return np.zeros(len(self.base.columns))
        torque = np.zeros((motion.samples, self.robot.n))
        for joint, values in terms.items():
            torque[:, joint] = values
        rigid = self.robot.rigid.regressor(motion)[:, :, list(self.base.columns)]
        share, *_ = np.linalg.lstsq(rigid.reshape(-1, rigid.shape[2]), torque.ravel(), rcond=None)
        return np.asarray(share)


def _merges(effect: Effect, base: BaseParameters) -> str:
    """Return the base parameters that a rotor inertia merges with, or an empty text."""
    if effect.name != "rotor_inertia" or effect.joint in base.free_rotors:
        return ""
    column = 10 * effect.robot.n + effect.joint
    into = [name for name, row in zip(base.names, base.regrouping, strict=True) if row[column] != 0.0]
    return ", ".join(into)


def _behind_the_gear(robot: Robot) -> list[str]:
    """Return a line about joints whose sensor stands behind the gear, on what the paper's friction means there."""
    names = [name for joint, name in enumerate(robot.joints) if robot.side(joint) == "link"]
    if not names:
        return []
    return [
        f"{', '.join(names)}: effort is measured behind the gear; friction is that of bearings, seals and cables beyond"
        " the sensor and of its own hysteresis, and no rotor inertia is in the links"
    ]


def _linear(robot: Robot, base: BaseParameters, effects: Sequence[Effect]) -> tuple[Parameter, ...]:
    ampere = robot.ampere_joints == robot.joints  # a joint in Nm sets the scale of what joints share
    rigid = [
        Parameter(name, in_ampere(unit) if ampere else unit, robot.joints[link], "rigid_body", rule)
        for name, unit, link, rule in zip(base.names, base.units, base.links, base.rules, strict=True)
    ]
    further = [
        Parameter(name, unit, effect.place, effect.name, effect.meaning)
        for effect in effects
        for name, unit in zip(effect.parameter_names(), effect.parameter_units(), strict=True)
    ]
    return (*rigid, *further)


def _compared_with_none(labels: Sequence[str], robot: Robot) -> list[str]:
    """Return of every effect that compares joints and is on all of them the label of the first one."""
    names = dict.fromkeys(label.partition("@")[0] for label in labels)
    relative = [name for name in names if name in CATALOGUE and CATALOGUE[name].relative]
    every = {name: [f"{name}@{joint}" for joint in robot.joints] for name in relative}
    return [each[0] for each in every.values() if set(each) <= {*labels}]


def _reference_note(label: str) -> str:
    return f"{label} is left out: this joint is the reference of the others"


def _inner(effects: Sequence[Effect]) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(name, unit, effect.place, effect.name, effect.meaning)
        for effect in effects
        for name, unit in zip(effect.inner_names(), effect.inner_units(), strict=True)
    )
