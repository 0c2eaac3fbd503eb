"""Model beside measurement: does it fit, and where does it fail?

The model is taken as it stands; nothing is fitted but the curves that show what its residual depends on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.model.model import Model
from robot_ident.recording.checks import refuse_copies, refuse_silent, silent_joints, still_notes
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import Evidence, Trajectory, trajectory
from robot_ident.regression.hidden_path import note
from robot_ident.regression.misfit import beside_hidden_path, misfit
from robot_ident.regression.more_than_noise import NoiseTest, chance
from robot_ident.regression.spectrum import bands
from robot_ident.residuals.curves import Variable, held_out_share, odd_and_even, own, variables
from robot_ident.residuals.regions import Profile, Region, densest, profiles
from robot_ident.signals.motion import Array, Mask

EDGES = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, np.inf)  # Hz
_LISTED = 6  # regions named for a joint
_DENSE = 0.05  # by which a region's share of the error must exceed its share of the time
_LISTED_SHARE = 0.005  # of the excess: less is no dependence
_OTHERS = 0.02  # of the excess that another joint's motion must explain to be listed


@dataclass(frozen=True)
class JointComparison:
    """How a model fares at one joint.

    residual_mse, noise_variance: mean square of the residual and variance of the noise of the same data [(Nm)^2], the
    latter None where unknown. misfit: None where the recordings don't tell their noise. excess [Nm rms]: beyond the
    noise. explained_by: share of the excess that a curve over each variable explains on unseen motion. by_frequency:
    share of the excess in bands (lower, upper [Hz], share). odd, even: shares under time reversal, None where the
    motion has no mirror. worst: regions that hold most error beyond their share of the time. profiles: mean and rms
    beside the noise along each variable, whether it fits or not. hidden_in_path: whether bends of the path that the
    noise of the positions hides may make all that is beyond the noise, where the model fails.
    """

    name: str
    residual_mse: float
    noise_variance: float | None
    misfit: NoiseTest | None
    excess: float
    explained_by: Mapping[str, float] = field(default_factory=dict)
    by_frequency: tuple[tuple[float, float, float], ...] = ()
    odd: float | None = None
    even: float | None = None
    worst: tuple[Region, ...] = ()
    profiles: tuple[Profile, ...] = ()
    hidden_in_path: bool = False

    @property
    def fails(self) -> bool | None:
        """Whether the model doesn't fit; None where the noise is unknown."""
        return None if self.misfit is None else self.misfit.fails

    @property
    def in_words(self) -> str:
        """Whether the model fits: `fits`, `does not fit`, `fits but for the hidden path` where it fails by no more than
        that may do, or `not judged` where the noise is unknown.
        """
        if self.misfit is None:
            return "not judged"
        return "fits but for the hidden path" if self.hidden_in_path else "does not fit" if self.fails else "fits"

    def row(self) -> tuple[object, ...]:
        """Return the joint as a row of a table.

        Its name, residual and noise [rms], what is beyond the noise, chi2/dof, p, the word, and the variable that the
        excess depends on most.
        """
        most = max(self.explained_by.items(), key=lambda item: item[1], default=None)
        return (
            self.name,
            self.residual_mse**0.5,
            None if self.noise_variance is None else self.noise_variance**0.5,
            self.excess,
            None if self.misfit is None else self.misfit.statistic,
            None if self.misfit is None else chance(self.misfit.p_value),
            self.in_words,
            "" if most is None or most[1] < _LISTED_SHARE else f"{most[0].replace('_', ' ')} ({100 * most[1]:.0f} %)",
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the joint as `compare --json` prints it."""
        found = self.misfit
        return {
            "name": self.name,
            "residual_mse": self.residual_mse,
            "noise_variance": self.noise_variance,
            "lack_of_fit": {
                "statistic": None if found is None else found.statistic,
                "p_value": None if found is None else found.p_value,
            },
            "fails": self.fails,
            "excess_rms": self.excess,
            "hidden_in_path": self.hidden_in_path,
            "explained_by": dict(self.explained_by),
            "by_frequency": [{"from": a, "to": b, "share": share} for a, b, share in self.by_frequency],
            "time_symmetry": None if self.odd is None else {"odd": self.odd, "even": self.even},
            "worst": [
                {"what": r.what, "from": r.lower, "to": r.upper, "share": r.share, "of_time": r.of_time}
                | ({"recording": r.recording} if r.recording else {})
                for r in self.worst
            ],
            "profiles": [profile.to_dict() for profile in self.profiles],
        }


@dataclass(frozen=True)
class Comparison:
    """One model beside all measurements; notes say what limits the judgement."""

    joints: tuple[JointComparison, ...]
    notes: tuple[str, ...]

    def _repr_html_(self) -> str:
        """Show every joint's residual beside its noise, and what the excess depends on, in a notebook."""
        from robot_ident.markup import listed, table

        header = ("joint", "residual rms", "noise rms", "beyond noise", "chi2/dof", "p", "", "depends most on")
        rows = [joint.row() for joint in self.joints]
        return table(header, rows, "rms in Nm, in N on a sliding joint") + listed(self.notes)


def compare(model: Model, measurements: Sequence[Measurement]) -> Comparison:
    """Return where a model fails on measurements of its robot."""
    if not measurements:
        raise InputError("no recording was given")
    refuse_copies(measurements)
    still = silent_joints(measurements)
    if still.all():
        refuse_silent(measurements)
    known = [_noise_known(measured) for measured in measurements]
    trajectories = [judged(measured, model) for measured in measurements]
    evidence = _evidence(model, trajectories)
    tested = [t for t, yes in zip(trajectories, known, strict=True) if yes]
    testable = evidence if len(tested) == len(trajectories) else _evidence(model, tested) if tested else None
    fits = None if testable is None else misfit(testable, model.by_noise)
    joints = tuple(
        _still_joint(evidence, measurements, joint)
        if still[joint]
        else _joint(evidence, joint, None if fits is None else fits[joint])
        for joint in range(evidence.structure.robot.n)
    )
    notes = [
        f"{measured.source}: its noise is unknown without periods; it is shown, not judged"
        for measured, yes in zip(measurements, known, strict=True)
        if not yes
    ]
    notes += [line for measured in measurements for line in still_notes(measured)]
    if testable is not None and any(joint.fails for joint in joints):
        joints = _with_hidden_path(joints, testable, model.by_noise)
    return Comparison(joints, (*notes, *_hidden_note(joints)))


def _with_hidden_path(
    joints: Sequence[JointComparison], evidence: Evidence, covariance: Array
) -> tuple[JointComparison, ...]:
    """Return the joints, told which of those that fail may do so for bends of the path that noise hides."""
    beside = beside_hidden_path(evidence, covariance)
    return tuple(
        replace(joint, hidden_in_path=bool(joint.fails and not test.fails))
        for joint, test in zip(joints, beside, strict=True)
    )


def _hidden_note(joints: Sequence[JointComparison]) -> list[str]:
    hidden = [joint.name for joint in joints if joint.hidden_in_path]
    return [note(hidden)] if hidden else []


def _noise_known(measured: Measurement) -> bool:
    variance = measured.averaged_variance
    return bool(np.all(np.isfinite(variance)) and np.all(variance > 0))


def judged(measured: Measurement, model: Model) -> Trajectory:
    """Return a measurement in units of its noise; of the model's, or of nothing known, where it doesn't tell it.

    Where no noise is known at all, the unit is 1 Nm and the whole residual counts as excess.
    """
    if _noise_known(measured):
        return trajectory(measured)
    listed = np.array([np.nan if v is None else v for v in model.noise.torque_variance], dtype=float)
    told = bool(np.all(np.isfinite(listed)) and np.all(listed > 0))
    variance = listed if told else np.ones(len(listed))
    plain = trajectory(replace(measured, torque_variance=variance, averages=1.0, noise=None, quantisation=None))
    return plain if told else replace(plain, dof=np.zeros(len(listed)))


def _evidence(model: Model, trajectories: Sequence[Trajectory]) -> Evidence:
    """Return the evidence with the model's own parameters, nothing fitted."""
    structure = model.structure
    rigid = tuple(structure.rigid_columns(t.motion) for t in trajectories)
    phi = tuple(
        t.weighed(structure.columns(t.motion, model.linear, r)) for t, r in zip(trajectories, rigid, strict=True)
    )
    return Evidence(structure, tuple(trajectories), rigid, phi, model.linear)


def _joint(evidence: Evidence, joint: int, fit: NoiseTest | None) -> JointComparison:
    trajectories = evidence.trajectories
    residual = [r[:, joint] for r in evidence.residual]
    used = [t.weight[:, joint] > 0 for t in trajectories]
    dof = [float(t.dof[joint]) for t in trajectories]
    excess = sum(float(np.sum(r**2)) for r in residual) - sum(dof)
    rows = max(1, sum(int(u.sum()) for u in used))
    newton = [r[u] / t.weight[u, joint] for r, u, t in zip(residual, used, trajectories, strict=True)]
    mse = float(sum(np.sum(one**2) for one in newton) / rows)
    parts = [u.sum() * t.measured.averaged_variance[joint] for u, t in zip(used, trajectories, strict=True)]
    floor = float(sum(parts) / rows) if all(d > 0.0 or not u.any() for d, u in zip(dof, used, strict=True)) else None
    fails = fit is None or fit.fails
    seen = [_variables(evidence, t, joint) for t in trajectories]
    shares = {
        name: held_out_share([one[name] for one in seen], residual, used, excess)
        for name in (seen[0] if fails else ())
        if all(name in one for one in seen)
    }
    odd, even = _symmetry(evidence, joint) if fails else (None, None)
    return JointComparison(
        name=evidence.structure.robot.joints[joint],
        residual_mse=mse,
        noise_variance=floor,
        misfit=fit,
        excess=float(np.sqrt(max(0.0, mse - (floor or 0.0)))),
        explained_by=own(shares, _OTHERS),
        by_frequency=_by_frequency(evidence, joint) if fails else (),
        odd=odd,
        even=even,
        worst=_worst(evidence, joint, seen, shares) if fails else (),
        profiles=profiles(evidence, joint, seen, bands(evidence, joint, EDGES), floor is not None),
    )


def _still_joint(evidence: Evidence, measurements: Sequence[Measurement], joint: int) -> JointComparison:
    """Return what is left of the torque of a joint that doesn't move, of all rows; nothing of it is judged."""
    left = []
    for measured, rigid in zip(measurements, evidence.rigid, strict=True):
        predicted = evidence.structure.columns(measured.motion, evidence.values, rigid) @ evidence.values
        left.append(measured.passed(measured.torque - predicted)[:, joint])
    mse = float(np.mean(np.concatenate(left) ** 2))
    rows = [len(one) for one in left]
    noise = float(np.average([measured.averaged_variance[joint] for measured in measurements], weights=rows))
    floor = noise if noise > 0.0 else None
    name, excess = evidence.structure.robot.joints[joint], float(np.sqrt(max(0.0, mse - (floor or 0.0))))
    return JointComparison(name, mse, floor, None, excess)


def _variables(evidence: Evidence, t: Trajectory, joint: int) -> dict[str, Variable]:
    found = variables(evidence.structure, evidence.values, t.motion, joint)
    return {name: values[t.measured.rows] for name, values in found.items()}


def _by_frequency(evidence: Evidence, joint: int) -> tuple[tuple[float, float, float], ...]:
    found = bands(evidence, joint, EDGES)
    total = sum(band.beyond for band in found)
    if total <= 0.0:
        return ()
    top = [0.5 / t.measured.dt for t in evidence.trajectories]
    return tuple((band.lower, min(band.upper, max(top)), band.beyond / total) for band in found)


def _symmetry(evidence: Evidence, joint: int) -> tuple[float | None, float | None]:
    pairs = [
        odd_and_even(t, residual, joint) for t, residual in zip(evidence.trajectories, evidence.residual, strict=True)
    ]
    told = [pair for pair in pairs if pair is not None]
    odd, even = sum(pair[0] for pair in told), sum(pair[1] for pair in told)
    if not told or odd + even <= 0.0:
        return None, None
    return odd / (odd + even), even / (odd + even)


def _worst(
    evidence: Evidence, joint: int, seen: Sequence[Mapping[str, Variable]], shares: Mapping[str, float]
) -> tuple[Region, ...]:
    """Return the regions that hold most error beyond their share of the time, the densest first, one a variable."""
    trajectories = evidence.trajectories
    squared = [r[:, joint] ** 2 for r in evidence.residual]
    used = [t.weight[:, joint] > 0 for t in trajectories]
    noise = [float(t.dof[joint]) / max(1, int(u.sum())) for t, u in zip(trajectories, used, strict=True)]
    found: list[Region | None] = [
        densest(name, [one[name].signed(name) for one in seen], squared, used, noise)
        for name in shares
        if not name.endswith("_and_direction")
    ]
    found += _in_time(trajectories, squared, used, noise)
    dense = [region for region in found if region is not None and region.density >= _DENSE]
    dense.sort(key=lambda region: -region.density)
    velocities = [region for region in dense if region.what in ("velocity", "speed")]
    return tuple(region for region in dense if region not in velocities[1:])[:_LISTED]


def _in_time(
    trajectories: Sequence[Trajectory], squared: Sequence[Array], used: Sequence[Mask], noise: Sequence[float]
) -> list[Region]:
    """Return the densest stretch of time of every recording, with its shares of the error and time of all."""
    excess = [float(np.sum(s[u]) - level * u.sum()) for s, u, level in zip(squared, used, noise, strict=True)]
    rows = [float(u.sum()) for u in used]
    out = []
    for k, t in enumerate(trajectories):
        time = np.asarray(np.arange(len(squared[k])) * t.measured.dt * t.measured.decimate, dtype=float)
        region = densest("time", [time], [squared[k]], [used[k]], [noise[k]])
        if region is not None:
            share = float(np.clip(region.share * excess[k] / max(sum(excess), 1e-300), 0.0, 1.0))
            part = region.of_time * rows[k] / sum(rows)
            out.append(replace(region, share=share, of_time=part, recording=t.measured.source))
    return out


def misfit_aside(model: Model, validation: Sequence[Measurement]) -> tuple[str, ...]:
    """Return a line where a model, adequate by the recordings that it was fitted to, misfits those kept aside."""
    if not validation:
        return ()
    robot = model.robot
    worst = [
        f"{one.name} by {one.excess:.3g} {robot.torque_unit(robot.joint_index(one.name))} rms beyond the noise"
        for one in compare(model, validation).joints
        if one.fails and not one.hidden_in_path
    ]
    if not worst:
        return ()
    return (
        f"the model does not fit what was kept aside: {', '.join(worst)} (robot_ident compare shows where); something"
        " is there that the fitted recordings don't show",
    )
