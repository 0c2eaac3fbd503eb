"""Gears and shafts that twist under load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Course, Effect, Inner, Mathematics, Signals, Torques, scaled
from robot_ident.signals.filters import ringing
from robot_ident.signals.motion import Array, Motion

_MOST = 0.9  # of the least inertia about the joint, that the motor may be
_LEAST = 1e-4  # of the mean inertia about the joint, below which the model's is none

_SMALL = 0.1  # rad or m that a gear gives way at most: the formula is of first order, and no gear yields 6 degrees
_RINGS = 0.4  # of the inertia about the joint that a gear lets ring at least: all of it, less what ringing blurs


class JointElasticity(Effect):
    """A gear of stiffness k and damping d between motor (with its encoder) and link: the link stands at q - e.

    The link is a mass on the gear, M e'' + d e' + k e = tauL along the path, M its inertia about the joint (Spong
    1987), k = M (2 pi f)^2 and d = 2 zeta M (2 pi f) for the mean M; far below the resonance f, e = tauL / k. To first
    order in e the torque changes by -D[tau] e, D[tau] the change of the links' torque with their displacement and its
    two derivatives along time. The coefficient is the compliance 1 / k; the resonance is searched apart from it, as
    motors whose inertia the model counts among the links' shift it.
    """

    name = "joint_elasticity"
    equation = "-D[tau](e), M e'' + d e' + k e = tauL"
    meaning = "compliance of the gear between motor and link"
    coefficients = (Coefficient("compliance", "mrad/kNm", "um/N", positive=True),)
    inner: tuple[Inner, ...] = (
        Inner("resonance", "Hz", "Hz", 2.0, 200.0, (4.0, 6.0, 9.0, 13.0, 20.0, 30.0, 60.0), logarithmic=True),
        Inner("damping", "1", "1", 0.005, 0.25, (0.02, 0.15), logarithmic=True),
        Inner("rotor", "1", "1", 0.0, 0.7, (0.0, 0.2, 0.4)),
    )
    symmetry = "memory"
    signature = "grows with the 2nd to 4th power of frequency, and rings at its resonance"
    confused_with = ("time_delay", "rotor_inertia", "encoder_eccentricity")
    also_like = ("a base or pedestal that gives way",)
    experiment = "excite 2.5 to 10 Hz; below 0.5 Hz it hides under 0.1 Nm"
    magnitude = "k 1e5-1e6 / 5e3-3e4 Nm/rad: 1-10 / 30-200 mrad/kNm, below 0.1 Nm under 0.5 Hz"
    uses_torque = True
    needs_time = True
    symbolic = False

    def placed_inner(self) -> tuple[Inner, ...]:
        """Return the inner parameters, without `rotor` where the links hold none or the armature is known."""
        known = not self._held or self.robot.known_rotor(self.joint) > 0.0
        return tuple(inner for inner in super().placed_inner() if inner.name != "rotor" or not known)

    def settings(self, motion: Motion | None = None) -> Sequence[dict[str, float]]:
        """Return every resonance with every damping, and with the least damping every share of the motor besides."""
        damping, *rotor = self.inner[1:]
        every = super().settings(motion)
        return [s for s in every if s["damping"] == damping.grid[0] or all(s[i.name] == i.middle for i in rotor)]

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return -D[tau] k e, Nm per mrad/kNm; zero where the model has no inertia about the joint."""
        out = np.zeros((motion.samples, self.robot.n, 1))
        if torques is None or torques.rigid is None:
            return out
        by_position, by_velocity, by_acceleration = torques.rigid.by_joint(self.joint)
        rotor = self._rotor(by_acceleration)
        by_acceleration = by_acceleration - rotor * (np.arange(self.robot.n) == self.joint)
        mean = float(by_acceleration[:, self.joint].mean())
        if not mean or (inertia := by_acceleration[:, self.joint] / mean).min() <= _LEAST:
            return out
        w = 2.0 * np.pi * self.setting["resonance"]
        drag = by_velocity[:, self.joint] / mean + 2.0 * self.setting["damping"] * w
        spring = by_position[:, self.joint] / mean + w**2
        load = torques.load[:, self.joint] - rotor * motion.ddq[:, self.joint]
        e, de, dde = ringing(motion, w**2 * load, inertia, drag, spring)
        change = by_position * e[:, None] + by_velocity * de[:, None] + by_acceleration * dde[:, None]
        return -1e-6 * change[:, :, None]

    @property
    def _held(self) -> bool:
        """Whether the links' inertias hold the motor's."""
        return self.robot.side(self.joint) != "link" and self.robot.rigid.holding_rotors[self.joint]

    def _share_of(self, inertia: Any) -> Any:
        """Return what of an inertia about the joint is the motor's, before any bound."""
        if "rotor" in self.setting:
            return self.setting["rotor"] * inertia
        return self._held * self.robot.known_rotor(self.joint)

    def _rotor(self, by_acceleration: Array) -> float:
        """Return what of the inertia about the joint [N, n] is the motor's, within the least of it."""
        felt = by_acceleration[:, self.joint]
        rotor = self._share_of(float(felt.mean()))
        return max(0.0, min(rotor, _MOST * float(felt.min())))

    def contradicts_itself(
        self, values: Array, along: Sequence[tuple[Motion, Torques]], beside: Mapping[str, float]
    ) -> bool:
        """Return whether the link would stand off by more than a first-order formula holds for, or far less than the
        inertia behind the gear rings, M (2 pi f)^2 / k: a mass that swings on the arm, or the base on its feet.
        """
        if 1e-6 * values[0] * max(np.abs(torques.load[:, self.joint]).max() for _, torques in along) > _SMALL:
            return True
        known = [torques.rigid for _, torques in along if torques.rigid is not None]
        felt = [rigid.by_joint(self.joint)[2] for rigid in known]
        inertia = np.mean([one[:, self.joint].mean() - self._rotor(one) for one in felt])
        return bool(1e-6 * values[0] * inertia * (2.0 * np.pi * self.setting["resonance"]) ** 2 < _RINGS)

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return what holds far below the resonance as an expression: the load's derivatives by the chain rule."""
        inertia = course.displaced(self.joint, (0.0, 0.0, 1.0))[self.joint]
        rotor = self._share_of(inertia)
        load = x.load[self.joint] - rotor * x.ddq[self.joint]
        rate = course.rate(load)
        bend = course.rate(rate)
        out = scaled(-1e-6, course.displaced(self.joint, (load, rate, bend)))
        return [{**out, self.joint: out[self.joint] + 1e-6 * rotor * bend}]
