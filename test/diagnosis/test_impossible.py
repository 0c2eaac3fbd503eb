"""What only a coefficient below zero would explain is not named; nor is what rounded positions imitate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import signal

from robot_ident.diagnosis.candidates import Candidate, Folds, Score, candidate_of, score
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.evidence import Evidence, gather
from robot_ident.diagnosis.impossible import possible
from robot_ident.diagnosis.measuring.filtered import exact, filters
from robot_ident.diagnosis.measuring.finding import Finding
from robot_ident.diagnosis.measuring.first import near_noise
from robot_ident.diagnosis.scan import base_gram
from robot_ident.effects import make_effect
from robot_ident.recording import Recording, process
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play


@pytest.fixture(scope="module")
def recorded(bench: Any) -> list[Recording]:
    """Three recordings as they should be, of little noise."""
    plays = [Play.of(bench.robot, plant_physics(bench.robot, ()), bench.motions[k]) for k in range(3)]
    return [play.record(6, noise=0.1, seed=40 + k) for k, play in enumerate(plays)]


def scored(label: str, evidence: Evidence, bench: Any) -> Score:
    candidate: Candidate = candidate_of(make_effect(label, bench.robot), evidence)
    return score(candidate, evidence, Folds.of(base_gram(evidence)))


def evidence_with(recordings: list[Recording], bench: Any, inertia: float) -> Evidence:
    """Return the evidence on recordings to which a rotor of an inertia kg m^2 was added on the last axis."""
    measured = [process(r, bench.robot) for r in recordings]
    rotor = [m.motion.ddq * [0.0, 0.0, inertia] for m in measured]
    return gather(
        [replace(m, torque=m.torque + more) for m, more in zip(measured, rotor, strict=True)], bench.structure
    )


def test_a_rotor_is_named_and_its_negative_is_not(bench: Any, recorded: list[Recording]) -> None:
    for inertia in (4.0, -4.0):
        evidence = evidence_with(recorded, bench, inertia)
        rotor = scored("rotor_inertia@joint_3", evidence, bench)
        kept, notes = possible([rotor], evidence)
        assert [m.label for m in kept] == (["rotor_inertia@joint_3"] if inertia > 0 else [])
        assert len(notes) == (inertia < 0)
    assert "rotor_inertia@joint_3 is not named" in notes[0] and "-4.0" in notes[0] and "clock" in notes[0]


def test_what_may_have_either_sign_is_kept(bench: Any, recorded: list[Recording]) -> None:
    evidence = evidence_with(recorded, bench, -4.0)
    offset = scored("torque_offset@joint_3", evidence, bench)
    assert possible([offset], evidence) == ([offset], [])


def test_a_clock_that_runs_wrong_is_no_rotor(bench: Any, recorded: list[Recording]) -> None:
    fast = [replace(r, t=1.5 * (r.t - r.t[0]), dq=None) for r in recorded[:2]]
    found = diagnose([process(r, bench.robot) for r in fast], bench.structure)
    assert "rotor_inertia@joint_3" not in [s.label for s in found.missing]
    assert not [p for s in found.missing for p in s.parameters if "rotor_inertia" in p.name and p.value < 0]
    assert "times too fast" in found.clock


def rounded(recordings: list[Recording], step: float = 1e-3) -> list[Recording]:
    return [replace(r, q=np.round(r.q / step) * step, dq=None) for r in recordings]


def test_rounded_positions_are_not_the_arm_s_fault(bench: Any, recorded: list[Recording]) -> None:
    found = diagnose([process(r, bench.robot) for r in rounded(recorded)], bench.structure)
    assert (found.verdict, found.missing) == ("adequate", ())


def low_pass(recordings: list[Recording], bench: Any) -> tuple[Finding, Evidence, Folds]:
    """Return the low pass over all efforts that fits best."""
    evidence = gather([process(r, bench.robot) for r in recordings], bench.structure)
    folds = Folds.of(base_gram(evidence))
    (coarse,) = (f for f in filters(evidence, folds.base) if f.effect.place is None)
    return exact(coarse, evidence, folds.base), evidence, folds


def test_a_low_pass_leaves_noise_where_it_is_the_cause(
    bench: Any, recorded: list[Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Were the rounding not known, a low pass would follow most of what it leaves, but not down to the noise."""
    sections = signal.butter(2, 3.0, fs=150.0, output="sos")
    slow = [
        replace(r, tau=signal.sosfilt(sections, np.concatenate([r.tau, r.tau]), axis=0)[len(r.tau) :]) for r in recorded
    ]
    assert near_noise(*low_pass(slow[:2], bench))
    monkeypatch.setattr("robot_ident.recording.periodic.position_step", lambda q: np.zeros(q.shape[1]))
    found, evidence, folds = low_pass(rounded(recorded[:2]), bench)
    assert found.held_out > 0.8 * float(folds.loss.sum())
    assert not near_noise(found, evidence, folds)
