"""Recordings that tell no more than another: copies are refused, repetitions of one motion said to be weaker."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import resample

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.recording import Processing, process
from robot_ident.recording.checks import of_one_motion, refuse_copies
from robot_ident.recording.measurement import Measurement
from robot_ident.residuals.comparison import compare


def test_a_copy_under_another_name_is_refused(bench: Any) -> None:
    (one,) = bench.measure((), [0], noise=1.0)
    copy = replace(one, source="copy", torque=one.torque.copy())
    model = bench.model([one])
    recording = bench.record((), 0, noise=1.0)
    for wants in (
        lambda: identify([recording, replace(recording, source="copy")], bench.robot),
        lambda: compare(model, [one, copy]),
        lambda: diagnose([one, copy], bench.structure),
        lambda: diagnose([one], bench.structure, [copy]),
    ):
        with pytest.raises(InputError, match="^copy holds the samples of .*: a copy of it, or .* give every one once"):
            wants()


def test_one_that_was_rounded_or_trimmed_is_known_by_its_noise(bench: Any) -> None:
    model, recording = bench.model(bench.measure((), [0], noise=1.0)), bench.record((), 0, noise=1.0)
    one, trimmed = (process(part, bench.robot) for part in (recording, recording[slice(0, -700)]))
    assert trimmed.periods == one.periods - 1
    rounded = replace(one, torque=np.round(one.torque, 3))
    for copy in (rounded, trimmed, rolled(rounded, 37)):
        with pytest.raises(InputError, match="holds the samples of"):
            compare(model, [one, copy])
    (again,) = bench.measure((), [0], noise=1.0, seed=2)
    compare(model, [one, again])


def test_repetitions_of_one_motion_are_known_and_said(bench: Any) -> None:
    (one,), (again,), (other,) = (bench.measure((), [k], noise=1.0, seed=seed) for k, seed in ((0, 1), (0, 2), (1, 3)))
    later = rolled(again, 37)
    assert of_one_motion([one, again, later])
    assert not of_one_motion([one, other])
    assert not of_one_motion([one, again, other])
    q, dq, ddq = (resample(x, 2 * len(x) + 1) for x in (again.motion.q, again.motion.dq, again.motion.ddq))
    finer = replace(again, motion=replace(again.motion, q=q, dq=dq, ddq=ddq))
    assert of_one_motion([one, finer])
    assert of_one_motion([finer, one])
    moved = replace(again, motion=replace(again.motion, q=again.motion.q + 0.2))
    assert not of_one_motion([one, moved]), "the same about another pose is another motion"
    assert any("all recordings are of one motion" in note for note in diagnose([one, later], bench.structure).notes)
    assert not any("one motion" in note for note in diagnose([one, other], bench.structure).notes)


def rolled(measured: Measurement, samples: int) -> Measurement:
    """Return a measurement whose periods begin later."""
    motion = measured.motion
    q, dq, ddq, torque, used = (
        np.roll(x, samples, axis=0) for x in (motion.q, motion.dq, motion.ddq, measured.torque, measured.used)
    )
    return replace(measured, motion=replace(motion, q=q, dq=dq, ddq=ddq), torque=torque, used=used)


def test_a_commanded_torque_may_stand_in_two_motions(bench: Any) -> None:
    (one,) = bench.measure((), [0], noise=1.0)
    elsewhere = replace(one, source="elsewhere", motion=replace(one.motion, q=one.motion.q + 26.0))
    compare(bench.model([one]), [one, elsewhere])


@pytest.mark.parametrize("periodic", [None, False])
def test_a_commanded_torque_may_be_the_same_in_two_recordings_of_one_motion(bench: Any, periodic: bool | None) -> None:
    """Positions that stray by a hundred times the encoder's noise, or hold another draw of it, are no copy's."""
    recording = bench.record((), 0, noise=1.0)
    sigma = np.sqrt(bench.robot.noise.position_variance)
    slow = np.sin(2.0 * np.pi * 0.1 * recording.t)[:, None]
    noise = np.random.default_rng(5).normal(size=recording.q.shape)
    for q in (recording.q + 100.0 * sigma * slow, recording.q + sigma * noise):
        step = bench.robot.drives.encoder_step
        again = replace(recording, q=np.round(q / step) * step, dq=None, source="again")
        refuse_copies([process(one, bench.robot, Processing(periodic=periodic)) for one in (recording, again)])


@pytest.mark.parametrize("periodic", [None, False])
@pytest.mark.parametrize("digits", [None, 6, 4, 3])
def test_a_file_that_was_printed_or_stored_more_coarsely_is_a_copy(
    bench: Any, digits: int | None, periodic: bool | None
) -> None:
    recording = bench.record((), 0, noise=1.0)
    q, tau = (
        x.astype(np.float32).astype(float) if digits is None else np.round(x, digits)
        for x in (recording.q, recording.tau)
    )
    saved = replace(recording, q=q, tau=tau, dq=None, source="saved")
    both = [process(one, bench.robot, Processing(periodic=periodic)) for one in (recording, saved)]
    with pytest.raises(InputError, match="saved holds the samples of"):
        refuse_copies(both)
