"""What diagnose says of real recordings, held against plain least squares on parts that it didn't choose by."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from planted import plant
from real_arms import real_cases

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.effects import Effect
from robot_ident.estimation.identify import identify
from robot_ident.estimation.prediction import measured_for
from robot_ident.model.structure import Structure
from robot_ident.recording import Processing, Recording, process
from robot_ident.recording.measurement import Measurement
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array
from robot_ident.workflow.steps import find_missing


@dataclass(frozen=True)
class Emps:
    """One sliding axis: its tracking recording, whole and as halves, and the one with pulses."""

    robot: Robot
    whole: Recording
    first: Recording
    second: Recording
    pulses: Recording

    def measured(self, recording: Recording, low_pass: float | None = None) -> Measurement:
        return process(recording, self.robot, Processing(periodic=False, low_pass=low_pass))


@pytest.fixture(scope="module")
def emps(shared_data: Path, checkout: Path) -> Emps:
    z = np.load(shared_data / "emps/data.npz")
    half = len(z["t"]) // 2

    def recording(name: str, rows: slice, prefix: str = "") -> Recording:
        return Recording(("slide",), *(z[prefix + key][rows] for key in ("t", "q", "tau")), source=name)

    robot = load_robot(checkout / "examples/emps/robot.yaml")
    parts = (slice(None), slice(None, half), slice(half, None))
    names = ("tracking", "first half", "second half")
    whole, first, second = (recording(name, rows) for name, rows in zip(names, parts, strict=True))
    return Emps(robot, whole, first, second, recording("pulses", slice(None), "val_"))


def equations(measured: Measurement, structure: Structure, values: Array) -> tuple[Array, Array]:
    used = measured.used[measured.rows]
    return measured.passed(structure.columns(measured.motion, values))[used], measured.passed(measured.torque)[used]


def relative(fitted: Measurement, tested: Measurement, robot: Robot, effects: Sequence[Effect]) -> float:
    """Return the relative error on a recording of a model fitted to another by plain least squares."""
    structure = Structure.build(robot, effects)
    values = np.zeros(len(structure.names))
    a, b = equations(fitted, structure, values)
    values = np.linalg.lstsq(a, b, rcond=None)[0]
    c, d = equations(tested, structure, values)
    return float(np.linalg.norm(d - c @ values) / np.linalg.norm(d))


def judge_emps(found: Diagnosis, emps: Emps, low_pass: float) -> None:
    """Assert that what is named lowers the held-out error, and that the remainder is said, in N, with its place."""
    assert found.verdict == "missing"
    assert found.missing[0].label == "viscous_asymmetric@slide"
    first, second, pulses = (emps.measured(r, low_pass) for r in (emps.first, emps.second, emps.pulses))
    named = [finding.effect for finding in found.missing]
    for fitted, tested, least in ((first, second, 0.15), (second, first, 0.15), (first, pulses, 0.1)):
        without = relative(fitted, tested, emps.robot, [])
        assert relative(fitted, tested, emps.robot, named[:1]) < (1 - least) * without
        assert relative(fitted, tested, emps.robot, named) < (1 - least) * without
    assert 0.3 < found.remaining_rms["slide"] < 3.0
    assert found.unexplained is not None
    assert found.unexplained.joint == "slide"
    assert "% of the" in found.unexplained.where


@pytest.mark.parametrize("low_pass", [10.0, pytest.param(40.0, marks=pytest.mark.long)])
def test_emps_is_told_that_its_friction_differs_by_direction(emps: Emps, low_pass: float) -> None:
    measured = emps.measured(emps.first, low_pass)
    found = diagnose([measured], Structure.build(emps.robot))
    judge_emps(found, emps, low_pass)
    assert any("noise is unknown" in note for note in found.notes)
    assert any("one recording only" in note for note in found.notes)
    size = {p.name: p for p in found.missing[0].parameters}["viscous_asymmetric@slide"]
    assert size.value == pytest.approx(-37.0, abs=4.0)
    assert 0.3 < size.std < 6.0


@pytest.mark.long
def test_emps_periods_list_the_same_first(emps: Emps) -> None:
    """Friction that explains two fifths of what is far above the noise floor; three periods of one motion have so few
    lines that a disturbance could explain as much: it is listed, and the line says how often.
    """
    measured = process(emps.whole, emps.robot)
    assert measured.periods == 3
    found = diagnose([measured], Structure.build(emps.robot))
    assert not found.missing and found.others[0].label == "viscous_asymmetric@slide"
    assert 0.4 < found.others[0].explained < 0.5
    assert any(note.startswith("viscous_asymmetric@slide is not named: noise of the same") for note in found.notes)
    assert found.unexplained is not None and found.remaining_rms["slide"] > 0.5


@pytest.mark.long
def test_the_validation_counts_as_evidence(emps: Emps) -> None:
    pulses = emps.measured(emps.pulses)
    found = diagnose([emps.measured(emps.whole)], Structure.build(emps.robot), [pulses])
    for finding in found.missing:
        assert finding.validation_before is not None and finding.validation_after is not None
        assert finding.validation_after["slide"] < finding.validation_before["slide"]


def test_pulses_are_not_taken_for_noise(emps: Emps) -> None:
    measured = process(emps.pulses, emps.robot)
    assert measured.base_frequency is None
    assert any("but not the torque of slide" in note for note in measured.notes)
    assert diagnose([measured], Structure.build(emps.robot)).verdict != "adequate"


@pytest.mark.long
def test_staubli_is_given_only_what_lowers_the_error_on_held_out_parts(
    shared_data: Path, checkout: Path, tmp_path: Path
) -> None:
    shutil.copy(checkout / "examples/staubli_tx40/robot.yaml", tmp_path)
    shutil.copy(shared_data / "staubli_tx40/tx40_mdh_modified.urdf", tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    z = np.load(shared_data / "staubli_tx40/data.npz")
    every = 5  # 1 kHz is plenty below 10 Hz
    recording = Recording(robot.joints, z["t"][::every], z["q"][::every], z["tau"][::every], source="tx40")
    measured = process(recording, robot, Processing(decimate=25))
    known = tuple(e for e in robot.known_effects if not e.startswith("wrist_coupling"))
    uncoupled = replace(robot, known_effects=known)
    found = diagnose([measured], Structure.build(uncoupled))
    assert "wrist_coupling@joint_6" in [finding.label for finding in found.missing]
    before = along(measured, Structure.build(uncoupled))
    after = along(measured, Structure.build(uncoupled, [s.effect for s in found.missing]))
    for parts, size in ((2, None), (3, None), (5, 0.4), (2, 2.5)):  # none but the first chose the effects
        without, together = held_out(measured, before, parts, size), held_out(measured, after, parts, size)
        for finding in found.missing:
            joint = finding.effect.joint
            assert together[joint] < 0.95 * without[joint], (finding.label, parts, size)


def along(measured: Measurement, structure: Structure) -> Array:
    """Return the columns [N, n, p] of a model, those that depend on its torque at a fit to everything."""
    torque, used = measured.passed(measured.torque), measured.used[measured.rows]
    phi = measured.passed(structure.columns(measured.motion))
    for _ in range(2 if structure.uses_torque else 0):
        values = np.linalg.lstsq((phi / torque.std(axis=0)[:, None])[used], (torque / torque.std(axis=0))[used])[0]
        phi = measured.passed(structure.columns(measured.motion, values))
    return phi


def held_out(measured: Measurement, phi: Array, parts: int, size: float | None) -> Array:
    """Return the rms error [n] on parts of time left out in turn, of plain least squares on the rest."""
    used, torque = measured.used[measured.rows], measured.passed(measured.torque)
    scale = torque.std(axis=0)
    time = np.arange(len(used)) * measured.dt * measured.decimate
    part = np.minimum(parts * time / time[-1], parts - 1) if size is None else (time / size) % parts
    total = np.zeros(torque.shape[1])
    for number in range(parts):
        train = used & (part.astype(int) != number)[:, None]
        rows = (phi / scale[:, None])[train]
        values = np.linalg.lstsq(rows, (torque / scale)[train], rcond=1e-9)[0]
        error = np.where(used & ~train, torque - phi @ values, 0.0)
        total += np.sum(error**2, axis=0)
    return np.asarray(np.sqrt(total / used.sum(axis=0)))


@pytest.mark.long
def test_a_drift_of_unknown_size_gets_no_name(shared_data: Path, tmp_path: Path) -> None:
    """Ten seconds of a large arm, what its model leaves replaced by noise of the same spectrum: a drift of one joint's
    friction predicts the parts left out, but beside viscous friction it is known to ten times its own size.
    """
    arm, recording = next(
        (case.robot, of)
        for case in real_cases(shared_data, tmp_path)
        if case.robot.name == "kuka_kr300"
        for of in case.train
        if of.source == "B"
    )
    planted = plant(identify([recording], arm, as_declared=True), recording, 1040)
    assert not planted.truth
    model = identify([planted.recording], arm, as_declared=True)
    found = find_missing(model, [measured_for(model, planted.recording)])
    assert "temperature_drift@joint_5" not in [one.label for one in found.missing]
    sizes = [one.parameters[0] for one in found.missing if not one.effect.measuring]
    assert [size.name for size in sizes if abs(size.value) < size.std] == []
