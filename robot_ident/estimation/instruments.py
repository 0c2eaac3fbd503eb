"""Instrumental variables: columns along a motion that knows nothing of the noise in the columns themselves.

Noise of the positions makes the columns of a recording that doesn't repeat uncertain, least squares then underestimates
what multiplies them. theta = (Z' W F)^-1 Z' W b is consistent when Z follows the motion but not the noise of F and b.
Where the servo and its reference are known, Z is taken along their simulation with the model (Janot, Vandanjon and
Gautier, "A generic instrumental variable approach for industrial robots identification", 2014). A recording holds
neither; the closed loop of the model under the servo that would have led to this motion is the motion itself, free of
noise. It is reconstructed at every instant from the samples before and after, without those whose noise the columns at
that instant hold.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.equations import stack
from robot_ident.estimation.least_squares import long_run_scores
from robot_ident.estimation.problem import Problem, Solution, beside_wls, solution
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.filters import ZeroPhaseLowPass
from robot_ident.signals.motion import Array, Motion

_HOLE = 0.6  # over the cutoff: half width [s] of what is left out about an instant, where the low pass keeps memory
_REACH = 3.0  # times that: half width of what is used
_ORDER = 6  # of the local polynomial
_TELL = 1.0  # sigmas of difference from wls that are worth a word


def instrumental_variables(problem: Problem, start: Solution) -> Solution:
    """Return the instrumental-variables estimate, its covariance heteroscedasticity and autocorrelation consistent.

    Periodic measurements are their own instruments: their lines hold little noise, and `ml` is for those that hold
    more. Raises InputError where inner parameters would have to be searched, or the instruments don't follow the
    motion.
    """
    structure = start.structure
    if structure.inner:
        raise InputError(
            f"{problem.source}: iv estimates linear parameters alone, not {structure.inner[0].name};"
            " use --estimator wls"
        )
    equations, p = start.equations, len(structure.parameters)
    reconstructed = [_reconstructed(measured) for measured in problem.measurements]
    other = stack(reconstructed, structure, start.values[:p])
    weighed = problem.noise.precision(other.phi)
    rows, columns = (np.linalg.norm(part, axis=0) for part in (weighed, equations.phi))
    rows, columns = np.where(rows > 0, rows, 1.0), np.where(columns > 0, columns, 1.0)
    normal = (weighed / rows).T @ (equations.phi / columns)
    if np.linalg.cond(normal) > 1e10:
        raise InputError(
            f"{problem.source}: the motion is too rough for instruments: what the samples about an instant say of it"
            " does not excite every parameter; use --estimator wls"
        )
    bread = np.linalg.inv(normal) / np.outer(columns, rows)  # (Z' W F)^-1
    values = bread @ (weighed.T @ equations.torque)
    found = solution(problem, structure, values, equations)
    residual = equations.torque - equations.phi @ values
    covariance = bread @ long_run_scores(weighed, residual, equations, problem.noise, problem.unknown) @ bread.T
    notes = [*found.notes, beside_wls("iv", values, start, covariance, _TELL, ("", ""))]
    own = [m.source for m in problem.measurements if not isinstance(m.low_pass, ZeroPhaseLowPass)]
    if own:
        notes.append(
            f"{', '.join(own)}: periodic, its own instrument; --estimator ml takes noise of its positions into account"
        )
    return replace(found, covariance=covariance, notes=tuple(notes))


def _reconstructed(measured: Measurement) -> Measurement:
    """Return a measurement along the motion that its distant samples tell; a periodic one as it is."""
    if not isinstance(measured.low_pass, ZeroPhaseLowPass):
        return measured
    hole = max(1, round(_HOLE / (measured.low_pass.cutoff * measured.dt)))
    motion = without_neighbours(measured.motion.q, measured.dt, hole, round(_REACH * hole))
    return replace(measured, motion=replace(motion, gravity=measured.motion.gravity))


def without_neighbours(q: Array, dt: float, hole: int, reach: int) -> Motion:
    """Return the motion whose value at each sample comes from those `hole` to `reach` samples away alone.

    A polynomial fitted there gives q, dq and ddq in the middle. q [N, n] rad on an even grid of dt [s]; the ends are
    continued by their odd reflection.
    """
    from scipy.signal import fftconvolve

    reach = min(reach, len(q) - 1)
    if reach - hole < _ORDER:
        raise InputError(f"{len(q)} samples are too few for instruments; use --estimator wls")
    offset = np.concatenate([np.arange(-reach, -hole + 1), np.arange(hole, reach + 1)])
    powers = (offset / reach)[:, None] ** np.arange(_ORDER + 1)
    fit = np.linalg.pinv(powers)
    long = np.concatenate([2.0 * q[0] - q[reach:0:-1], q, 2.0 * q[-1] - q[-2 : -reach - 2 : -1]])
    out = []
    for order, factor in enumerate((1.0, 1.0, 2.0)):
        kernel = np.zeros(2 * reach + 1)
        kernel[offset + reach] = fit[order] * factor / (reach * dt) ** order
        out.append(fftconvolve(long, kernel[::-1, None], mode="valid", axes=0))
    return Motion(out[0], out[1], out[2], dt=dt)
