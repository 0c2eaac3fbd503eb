"""A model beside a measurement, and the lines of its residual."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from robot_ident.residuals.beside import beside
from robot_ident.residuals.comparison import compare
from robot_ident.residuals.residual_lines import residual_lines

if TYPE_CHECKING:
    from robot_ident.workflow.findings import Findings


def test_it_is_what_compare_judges(findings: Findings) -> None:
    model, measured = findings.last.model, findings.training[0].measured
    found = beside(model, measured)
    judged = compare(model, [measured]).joints
    assert found.mean_square() == pytest.approx([joint.residual_mse for joint in judged])
    assert found.sigma**2 == pytest.approx([joint.noise_variance for joint in judged])
    assert np.allclose(found.predicted, model.predict(measured.motion))
    assert found.t[1] == pytest.approx(measured.dt)


def test_what_the_gear_carries_is_no_friction(findings: Findings) -> None:
    model, measured = findings.last.model, findings.training[0].measured
    found = beside(model, measured)
    rigid = len(model.structure.base.columns)
    assert np.allclose(found.load, model.structure.rigid_columns(measured.motion) @ model.linear[:rigid])


def test_a_recording_without_periods_is_low_passed_and_takes_the_models_noise(findings: Findings) -> None:
    source = findings.validation[0]
    found = beside(findings.last.model, source.measured)
    assert found.base_frequency is None
    assert found.low_pass == 10.0
    listed = np.array(findings.last.model.noise.torque_variance)
    assert found.sigma**2 == pytest.approx(listed * source.measured.low_pass.independent)


def test_lines_hold_the_whole_residual(findings: Findings) -> None:
    measured = findings.training[0].measured
    found = beside(findings.steps[0].model, measured)
    lines = residual_lines(replace(found, used=np.ones_like(found.used)), measured)
    total = np.mean(found.residual**2, axis=0)
    assert np.sum(lines.residual**2, axis=0) + lines.mean**2 == pytest.approx(total, rel=2e-3)  # the last line is half
    assert lines.excited.sum() == 5
    assert lines.frequency[lines.excited] == pytest.approx(0.1 * np.arange(1, 6), rel=1e-3)


@pytest.mark.parametrize("periodic", [True, False])
def test_noise_lies_around_its_line_and_a_tone_stands_out(findings: Findings, periodic: bool) -> None:
    source = (findings.training if periodic else findings.validation)[0]
    found = beside(findings.last.model, source.measured)
    rng, shape = np.random.default_rng(4), found.measured.shape
    raw = rng.normal(size=shape) * 3.0
    noise = raw if periodic else source.measured.passed(raw)
    share = 1.0 if periodic else source.measured.low_pass.independent
    made = replace(
        found, measured=found.predicted + noise, used=np.ones_like(found.used), sigma=np.full(3, 3.0) * share**0.5
    )
    lines = residual_lines(made, replace(source.measured, noise=None))
    assert np.mean(lines.residual**2, axis=0) / np.mean(lines.noise**2, axis=0) == pytest.approx(np.ones(3), abs=0.25)
    dt = source.measured.dt
    tone = 5.0 * np.sin(2.0 * np.pi * 2.0 * np.arange(shape[0]) * dt)[:, None]
    louder = residual_lines(replace(made, measured=made.measured + tone), source.measured)
    peak = int(np.argmax(louder.residual[:, 0]))
    assert louder.frequency[peak] == pytest.approx(2.0, abs=louder.width)
    nearby = louder.residual[max(0, peak - 2) : peak + 3, 0]
    assert np.sqrt(np.sum(nearby**2)) == pytest.approx(5.0 / np.sqrt(2.0), rel=0.1)
