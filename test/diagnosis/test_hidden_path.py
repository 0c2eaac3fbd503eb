"""What hides in the noise of the positions is taken for no effect."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.estimation.identify import estimate
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording, process
from robot_ident.recording.measurement import Measurement
from robot_ident.residuals.comparison import compare
from robot_ident.robot import Robot
from robot_ident.signals.motion import Motion

PERIODS = 16
RIPPLE = "torque_ripple@joint_2:torque_ripple=8.9,order=206.47,phase=-3,second=0.15"


def giving_way(measured: Measurement, robot: Robot, amount: float, rng: np.random.Generator) -> Measurement:
    """Return a measurement of the motion of another, but the first drive gives way by `amount` [rad] to its friction.

    Through four poles at 11 Hz; torque by the exact path, noise of the paper on both.
    """
    structure, motion = Structure.build(robot), measured.motion
    w = 2j * np.pi * np.arange(motion.samples // 2 + 1)[:, None] * measured.base_frequency
    lines = np.fft.rfft(motion.q, axis=0)
    kink = np.fft.rfft(np.sign(motion.dq[:, 0])) / (1 + w[:, 0] / (2 * np.pi * 11.0)) ** 4
    lines[:, 0] -= amount * kink
    q, dq, ddq = (np.fft.irfft(lines * w**k, motion.samples, axis=0) for k in range(3))
    torque = structure.torques(Motion(q, dq, ddq), structure.true_values()).total
    q, torque = np.tile(q, (PERIODS, 1)), np.tile(torque, (PERIODS, 1))
    q = q + rng.standard_normal(q.shape) * np.sqrt(robot.noise.position_variance)
    torque = torque + rng.standard_normal(q.shape) * np.sqrt(robot.noise.torque_variance)
    return process(Recording(robot.joints, np.arange(len(q)) * measured.dt, q, torque), robot)


@pytest.fixture(scope="module")
def reversing(bench: Any) -> list[Measurement]:
    """Nothing hidden but a drive whose gear gives way."""
    rng = np.random.default_rng(6)
    return [giving_way(m, bench.robot, 3e-4, rng) for m in bench.measure(())]


def test_an_adequate_model_says_what_the_hidden_path_leaves(bench: Any, sticking: list[Measurement]) -> None:
    """As `compare` judges it the model misfits; the diagnosis says where, and why nothing is missing all the same."""
    found = diagnose(sticking, bench.structure)
    compared = compare(estimate(sticking, bench.structure), sticking)
    misfits = [one.name for one in compared.joints if one.fails]
    assert found.verdict == "adequate"
    assert misfits
    assert [one.name for one in compared.joints if one.hidden_in_path] == misfits
    assert compared.notes[-1].startswith(f"{', '.join(misfits)}: all that is left beyond the noise may be bends")
    assert {one.in_words for one in compared.joints if one.fails} == {"fits but for the hidden path"}
    assert list(found.hidden_in_path) == misfits
    assert found.in_words.endswith(f"and at {', '.join(misfits)} what noise hides of the path")
    assert found.notes[-1] == compared.notes[-1]
    assert "--minimum-speed" in found.notes[-1]


def test_values_that_are_wrong_do_not_hide_in_the_path(bench: Any, sticking: list[Measurement]) -> None:
    """A model a tenth too heavy would fit if it were identified anew; as it stands it fails."""
    model = estimate(sticking, bench.structure)
    values = model.values.copy()
    values[:15] *= 1.1  # the base parameters of its links
    compared = compare(replace(model, values=values), sticking)
    assert any(one.fails and not one.hidden_in_path for one in compared.joints)


def test_what_a_spring_does_hides_in_no_path(bench: Any) -> None:
    measured = bench.measure(("gravity_spring@joint_2",))
    compared = compare(estimate(measured, bench.structure), measured)
    assert any(one.fails for one in compared.joints)
    assert not any(one.hidden_in_path for one in compared.joints)


def test_a_model_that_fits_hides_nothing(bench: Any) -> None:
    found = diagnose(bench.measure((), noise=1.0), bench.structure)
    assert found.in_words == "adequate: what is left over is noise"
    assert not found.hidden_in_path


def test_a_drive_that_gives_way_lacks_nothing(bench: Any, reversing: list[Measurement]) -> None:
    found = diagnose(reversing, bench.structure)
    assert found.verdict == "adequate"
    assert not found.missing


@pytest.mark.long
def test_a_ripple_that_shakes_its_drive_is_no_delay_as_well(bench: Any) -> None:
    assert [finding.label for finding in bench.diagnose((RIPPLE,)).missing] == ["torque_ripple@joint_2"]
