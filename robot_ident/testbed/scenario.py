"""Hidden effects, drawn at random: which, at what joint, how large, and what else is there; and answers that nobody
reads by accident.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_ident.configuration import Closed, parse
from robot_ident.errors import InputError, did_you_mean
from robot_ident.files import read_text
from robot_ident.model.structure import Structure
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.testbed.calibrate import TOLERANCE, Calibrated, calibrate, pooled, standard_motions, visible
from robot_ident.testbed.phenomena import PHYSICS, nominal_physics, plant_physics
from robot_ident.testbed.phenomena.phenomenon import Physics, between, strength
from robot_ident.testbed.servo import Servo
from robot_ident.testbed.simulation import Play
from robot_ident.trajectories.fourier_series import FourierSeries

KINDS = {
    "single": 0.6,
    "pair_other_joints": 0.2,
    "null": 0.1,
    "unknown": 0.1,
    "single_with_background": 0.0,
    "same_joint": 0.0,
    "triple": 0.0,
}
"""Kinds of scenarios and how often `simulate --hidden` draws them."""

COUNTS = {"null": 0, "pair_other_joints": 2, "same_joint": 2, "triple": 3}
"""Hidden effects of a kind; one of any other."""

NOT_HIDDEN = ("viscous", "coulomb", "payload")
"""Part of every model, or invisible in any one recording."""

SIZES = (1.0, 8.0)
"""Visible residual [Nm rms] of a hidden effect on an industrial arm; a tenth of it on a light one."""

INDUSTRIAL = 200.0
"""Median torque [Nm] of the joints from which on an arm is industrial."""

BACKGROUND = 0.3
"""Part of the main effect's residual that three other ones leave together."""

DRAWS = 30
"""How many effects are drawn before it is given up to find one that is possible and large enough."""

ROUGHLY = 0.3
"""Tolerance of the size of what stands in the background."""


class Scenario(Closed):
    """What is hidden in a robot.

    effects: what there is to be found, background: what else there is, both as `NAME@JOINT:k=v,...`. visible_rms [Nm]:
    what a refitted model without any of it leaves, by joint, on the motions that it was drawn for.
    """

    kind: str
    seed: int
    robot: str
    effects: tuple[str, ...]
    background: tuple[str, ...]
    visible_rms: tuple[float, ...]

    @property
    def all_effects(self) -> tuple[str, ...]:
        """Everything that is hidden."""
        return (*self.effects, *self.background)

    @property
    def labels(self) -> tuple[str, ...]:
        """What there is to be found, as `name@joint`."""
        return tuple(effect.partition(":")[0] for effect in self.effects)

    def plays(self, robot: Robot, references: Sequence[FourierSeries]) -> list[Play]:
        """Return the robot's steady answers to periodic motions, from which any number of recordings is made."""
        physics, servo = plant_physics(robot, self.all_effects), Servo.make(robot)
        return [Play.of(robot, physics, series, servo=servo) for series in references]


def draw_scenario(
    seed: int,
    robot: Robot,
    *,
    kinds: Sequence[str] = (),
    names: Sequence[str] = (),
    references: Sequence[FourierSeries] = (),
    sizes: tuple[float, float] | None = None,
) -> Scenario:
    """Draw what is hidden in a robot; the same seed and arguments give the same.

    kinds: those to choose from, evenly (default: all, by the shares of `KINDS`). names: effects to choose from.
    references: periodic motions on which sizes hold (default: `standard_motions`, so that the scenario is the same
    whatever motion the robot is then moved by). sizes: range [Nm rms] of the visible residual of each effect (default:
    `SIZES`, a tenth of it on light arms). InputError on an unknown kind or name, or where nothing fits.
    """
    if seed < 0:
        raise InputError(f"hidden seed {seed}: must not be negative")
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(f"unknown kind of scenario {kind!r}{did_you_mean(kind, KINDS)}")
    for name in names:
        if name not in PHYSICS or name in NOT_HIDDEN:
            raise InputError(f"effect {name!r} can't be hidden{did_you_mean(name, set(PHYSICS) - set(NOT_HIDDEN))}")
    rng = np.random.default_rng([seed, 1997])
    motions = references or standard_motions(robot)
    kind = str(rng.choice(kinds)) if kinds else str(rng.choice(list(KINDS), p=list(KINDS.values())))
    return _Drawer(robot, motions, rng, sizes or usual_sizes(robot), tuple(names)).scenario(kind, seed)


def usual_sizes(robot: Robot) -> tuple[float, float]:
    """Return the range of visible residuals [Nm rms] that is usual for a robot."""
    middle = float(np.median([strength(robot, j) for j in range(robot.n)]))
    unit = 1.0 if middle >= INDUSTRIAL else 0.1
    return SIZES[0] * unit, SIZES[1] * unit


@dataclass
class _Drawer:
    """Draws effects one after the other until their number is reached."""

    robot: Robot
    motions: Sequence[FourierSeries]
    rng: np.random.Generator
    sizes: tuple[float, float]
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        self.pool: Motion = pooled(self.motions)
        self.servo = Servo.make(self.robot)
        self.structure = Structure.build(self.robot)
        self.taken = {(p.name, p.place) for p in nominal_physics(self.robot)}

    def scenario(self, kind: str, seed: int) -> Scenario:
        """Return a scenario of a kind."""
        unknown = kind == "unknown"
        places = {"pair_other_joints": "other", "same_joint": "same"}.get(kind, "any")
        found = list(self._effects(COUNTS.get(kind, 1), unknown, places=places))
        background: list[Physics] = []
        if kind == "single_with_background":
            target = BACKGROUND / np.sqrt(3) * float(found[0].visible.max())
            background = [c.physics for c in self._effects(3, False, target=target)]
        hidden = tuple(c.physics.text for c in found)
        behind = tuple(p.text for p in background)
        left = (
            found[0].visible
            if len(found) == 1 and not background
            else visible(self.structure, self._plays(*hidden, *behind))
        )
        shown = tuple(float(x) for x in left)
        return Scenario(
            kind=kind, seed=seed, robot=self.robot.name, effects=hidden, background=behind, visible_rms=shown
        )

    def _effects(
        self, count: int, unknown: bool, *, places: str = "any", target: float | None = None
    ) -> Iterator[Calibrated]:
        """Draw so many effects; places: of `other` joints each, all of the `same` one, or `any`."""
        done: list[Physics] = []
        for _ in range(DRAWS):
            if len(done) == count:
                return
            drawn = self._draw(unknown, joint_only=places != "any")
            if drawn is None or self._excluded(drawn):
                continue
            if places != "any" and any((drawn.place == p.place) == (places == "other") for p in done):
                continue
            wanted = between(self.rng, *self.sizes) if target is None else target
            tolerance = TOLERANCE if target is None else ROUGHLY
            least, most = (0.9 * self.sizes[0], 1.2 * self.sizes[1]) if target is None else (0.5 * target, 1.5 * target)
            made = calibrate(
                drawn, wanted, lambda p: self._plays(p.text), self.structure, tolerance=tolerance, least=least
            )
            if not least <= float(made.visible.max()) <= most:
                continue
            done.append(made.physics)
            gone = (made.physics.name, *made.physics.replaces, *made.physics.includes)
            self.taken |= {(name, made.physics.place) for name in gone}
            yield made
        if len(done) < count:
            raise InputError(
                f"robot {self.robot.name}: no {'unknown ' if unknown else ''}effect leaves {self.sizes[0]:g} Nm rms"
                " on these motions; give larger motions or smaller sizes"
            )

    def _draw(self, unknown: bool, *, joint_only: bool) -> Physics | None:
        """Return a phenomenon of a random name at a random joint, None where it can't be there."""
        names = [n for n in self.names or PHYSICS if n not in NOT_HIDDEN and n.startswith("unknown_") == unknown]
        if joint_only:
            names = [n for n in names if PHYSICS[n].scope != "robot"]
        if not names:
            raise InputError(f"no effect to choose from among {', '.join(self.names)}")
        kind = PHYSICS[str(self.rng.choice(names))]
        joint = int(self.rng.integers(self.robot.n))
        everywhere = kind.scope == "robot" or (kind.scope == "either" and not joint_only and self.rng.random() < 0.3)
        if not everywhere and not kind.possible(self.robot, joint):
            return None
        values = kind.draw(self.robot, joint, self.rng, self.pool)
        return kind(self.robot, None if everywhere else joint, values)

    def _excluded(self, drawn: Physics) -> bool:
        """Return whether it is there already, or doesn't go with what is."""
        shafts = {place for name, place in self.taken if PHYSICS[name].shaft}
        told = {(name, drawn.place) for name in (drawn.name, *drawn.includes)}
        return bool(told & self.taken) or (drawn.shaft and drawn.place in shafts)

    def _plays(self, *effects: str) -> list[Play]:
        physics = plant_physics(self.robot, effects)
        return [Play.of(self.robot, physics, motion, servo=self.servo) for motion in self.motions]


SCHEMA = "robot_ident/sealed/1"
NOTE = "what was hidden in the simulated robot; to open it: robot_ident trial --open FILE"

_LARGEST = 1 << 20  # bytes of an answer; what is packed may claim to be any size


def sealed_path(bag: Path | str) -> Path:
    """Return where the answer to a bag lies: beside it, `BAG.sealed`."""
    bag = Path(bag)
    return bag.with_name(bag.name + ".sealed")


def seal(scenario: Scenario) -> str:
    """Return the text of a sealed file."""
    answer = json.dumps(scenario.model_dump(), sort_keys=True)
    packed = base64.b64encode(zlib.compress(answer.encode())).decode()
    return json.dumps({"schema": SCHEMA, "note": NOTE, "sealed": packed}, indent=2) + "\n"


def open_sealed(path: Path | str) -> Scenario:
    """Return the answer of a sealed file, or of a bag beside which one lies; InputError where it can't be read."""
    path = sealed_path(path) if sealed_path(path).is_file() else Path(path)
    try:
        data = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: can't be read as a sealed file ({error})") from error
    schema = data.get("schema") if isinstance(data, dict) else None
    if schema != SCHEMA:
        raise InputError(f"{path}: schema: {schema!r} is no sealed file ({SCHEMA!r})")
    try:
        packed = base64.b64decode(data["sealed"], validate=True)
        answer = json.loads(zlib.decompressobj().decompress(packed, _LARGEST))
    except (KeyError, TypeError, ValueError, RecursionError, zlib.error) as error:
        raise InputError(f"{path}: sealed: damaged ({error})") from error
    return parse(Scenario, answer, f"{path}: sealed")
