"""What is noise of the positions, whatever a path's kinks, or noise of any colour, is taken for no effect."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.power import ENOUGH
from robot_ident.diagnosis.selection.data_set import DataSet, Rows
from robot_ident.diagnosis.selection.fitted_set import FittedSet
from robot_ident.recording import process
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import gather
from robot_ident.regression.gram import base_gram
from robot_ident.regression.misfit import lack_of_fit
from robot_ident.regression.spectrum import whitened

SLOW = 2.0  # Hz: pole of the noise's colour


@pytest.fixture(scope="module")
def coloured(bench: Any) -> list[Measurement]:
    """Nothing hidden; the noise of the torque has passed a pole."""
    out = []
    for motion in (0, 1, 2):
        quiet = bench.record((), motion, noise=1e-6)
        white = np.random.default_rng(motion).standard_normal(quiet.tau.shape)
        f = np.fft.rfftfreq(len(white), 1 / 150)[:, None]
        noise = np.fft.irfft(np.fft.rfft(white, axis=0) / np.sqrt(1 + (f / SLOW) ** 2), len(white), axis=0)
        noise *= np.sqrt(bench.robot.noise.torque_variance) / noise.std(axis=0)
        out.append(process(replace(quiet, tau=quiet.tau + noise), bench.robot))
    return out


def test_drives_that_let_joints_stick_lack_nothing(bench: Any, sticking: list[Measurement]) -> None:
    found = diagnose(sticking, bench.structure)
    assert found.verdict == "adequate"
    assert not found.missing


def test_the_noise_of_positions_is_no_lack_of_fit(bench: Any, sticking: list[Measurement]) -> None:
    """A path of many lines: by the torque's noise alone, what is left over would be far too much."""
    plain = gather(sticking, bench.structure)
    white = whitened(plain)
    tests = lack_of_fit(white, base_gram(white))
    assert any(test.fails for test in lack_of_fit(plain, base_gram(plain)))
    assert not any(test.fails for test in tests)
    assert [test.statistic for test in tests] == pytest.approx([1.0] * 3, abs=0.12)


def test_a_slow_noise_gains_no_effect_anything(bench: Any, coloured: list[Measurement]) -> None:
    def best(evidence: Any) -> float:
        data = DataSet(Rows.plain(evidence))
        given = FittedSet(data, (), np.ones_like(data.power))
        return max(given.gain(h) for settings in data.hypotheses.values() for h in settings)

    plain = gather(coloured, bench.structure)
    assert best(whitened(plain)) < ENOUGH < best(plain)


def test_rows_are_the_same_in_newton(bench: Any, sticking: list[Measurement]) -> None:
    """Whitening weighs lines; the residual in Nm is what the torque lacks, row by row."""
    white = whitened(gather(sticking, bench.structure))
    for t, rigid, rest in zip(white.trajectories, white.rigid, white.newton, strict=True):
        assert t.whitening is not None
        predicted = white.structure.columns(t.motion, white.values, rigid) @ white.values
        expected = np.where(t.weight > 0, t.measured.torque - predicted, 0.0)
        np.testing.assert_allclose(rest[t.weight > 0], expected[t.weight > 0], atol=1e-8)


def test_white_noise_and_a_smooth_path_are_left_as_they_are(bench: Any) -> None:
    evidence = gather(bench.measure((), noise=1.0), bench.structure)
    assert whitened(evidence) is evidence


def test_half_of_the_rows_has_half_of_the_weight(bench: Any, coloured: list[Measurement]) -> None:
    (t, *_) = whitened(gather(coloured, bench.structure)).trajectories
    middle = len(t.y) // 2
    first, second = t.part(slice(middle)), t.part(slice(middle, None))
    assert first.dof == pytest.approx(t.dof / 2, rel=0.01)
    np.testing.assert_array_equal(first.y + second.y, t.y)
