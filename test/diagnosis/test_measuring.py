"""Faults of what is measured: each is named, with a line that puts it right, and no friction is blamed for it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import FRICTION, Diagnosis
from robot_ident.diagnosis.measuring.gain import undecidable_gains
from robot_ident.effects import make_effect
from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.recording import Recording, process
from robot_ident.recording.noise_spectrum import off_clock
from robot_ident.regression.evidence import gather
from robot_ident.regression.gram import base_gram
from robot_ident.robot import Robot
from robot_ident.robot.robot import Definition
from robot_ident.robot.robot_file import definition_of, robot_of
from robot_ident.testbed.faulty_recordings import fault_of, spoilt
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play

GAIN = "effort_gain@joint_2:gain=1.25"
SIGN = "effort_gain@joint_1:gain=-1.0"
FILTER = "effort_filter:cutoff=8.0,order=2.0"
LAG = "effort_filter@joint_3:cutoff=6.0,order=1.0"
PAYLOAD = "payload:payload=6.0,x=0.05,y=0.02,z=0.1,recording=1.0"
JITTER = "stamp_jitter:jitter=0.001,late=0.0"


@pytest.fixture(scope="module")
def spoiled(bench: Any) -> Any:
    """Return a function from a fault to three recordings with it and one that no fit sees, made once."""

    @cache
    def play(effects: tuple[str, ...], motion: int) -> Play:
        return Play.of(bench.robot, plant_physics(bench.robot, effects), bench.motions[motion])

    @cache
    def made(text: str) -> tuple[Recording, ...]:
        fault = fault_of(text, bench.robot)
        plays = [play(tuple(fault.effects(bench.robot, k)), k) for k in range(4)]
        return tuple(spoilt(fault, p, k, periods=6, noise=0.1, seed=3) for k, p in enumerate(plays))

    return made


@pytest.fixture(scope="module")
def said(bench: Any, spoiled: Any) -> Any:
    """Return a function from a fault to what is said of it, once each."""

    @cache
    def of(text: str) -> Diagnosis:
        *seen, unseen = (process(r, bench.robot) for r in spoiled(text))
        return diagnose(seen, bench.structure, [unseen])

    return of


@pytest.mark.parametrize(
    "text", [GAIN, FILTER, *(pytest.param(one, marks=pytest.mark.long) for one in (SIGN, LAG, PAYLOAD))]
)
def test_the_fault_is_named_and_nothing_else(said: Any, text: str) -> None:
    found: Diagnosis = said(text)
    assert found.verdict == "missing"
    assert [s.label for s in found.missing] == [text.partition(":")[0]]
    (named,) = found.missing
    assert named.explained > 0.5
    assert named.fix
    assert named.effect.measuring
    assert any("correct it, identify anew" in note for note in found.notes)
    assert min(named.mse_after[joint] / before for joint, before in named.mse_before.items()) < 0.5
    assert found.to_dict()["candidates"][0]["fix"] == named.fix


@pytest.mark.parametrize(
    ("text", "true", "within"),
    [(GAIN, 1.25, 0.03), pytest.param(SIGN, -1.0, 0.03, marks=pytest.mark.long), (FILTER, 8.0, 0.1)],
)
def test_its_size_is_found(said: Any, text: str, true: float, within: float) -> None:
    (named,) = said(text).missing
    assert named.parameters[0].value == pytest.approx(true, rel=within)


def test_the_mass_of_a_load_is_found_and_which_recording_had_it(said: Any) -> None:
    (named,) = said(PAYLOAD).missing
    assert named.parameters[0].value == pytest.approx(6.0, abs=4.0 * named.parameters[0].std)
    assert "recording 2" in named.parameters[0].name


@pytest.mark.long
@pytest.mark.parametrize("places", [(0, 1), (1, 0)])
def test_of_two_recordings_the_one_that_weighs_more_has_a_load(
    bench: Any, spoiled: Any, places: tuple[int, ...]
) -> None:
    """That the other one lacks it says the same."""
    recordings = spoiled(PAYLOAD)
    (named,) = diagnose([process(recordings[k], bench.robot) for k in places], bench.structure).missing
    assert named.label == "payload"
    assert named.parameters[0].value == pytest.approx(6.0, abs=4.0 * named.parameters[0].std)
    assert f"recording {places.index(1) + 1}" in named.parameters[0].name


@pytest.mark.parametrize("wrong", [(1,), pytest.param((0, 2), marks=pytest.mark.long)])
def test_a_gain_of_one_recording_alone_is_no_load(bench: Any, spoiled: Any, wrong: tuple[int, ...]) -> None:
    """Of three recordings one has another gain than the others: it is named, with its joint."""
    right, other = spoiled("effort_gain@joint_2:gain=1.0"), spoiled(GAIN)
    recordings = [(other if k in wrong else right)[k] for k in range(3)]
    found = diagnose([process(r, bench.robot) for r in recordings], bench.structure)
    assert [s.label for s in found.missing] == ["effort_gain@joint_2"]
    (named,) = found.missing
    assert named.parameters[0].name == "gain of joint_2 in recording 2"
    assert named.parameters[0].value == pytest.approx(1.25 if wrong == (1,) else 0.8, rel=0.03)
    assert any("effort_gain@joint_2 in recording 2 alone" in note for note in found.notes)


@pytest.mark.long
@pytest.mark.parametrize(
    ("angles", "named"),
    [((0.0, 90.0, 0.0), ["payload"]), ((0.0, 90.0, 215.0), [])],
    ids=["turned once", "turned twice"],
)
def test_a_load_of_no_mass_is_one_where_it_leaves_nothing(
    bench: Any, spoiled: Any, angles: tuple[float, ...], named: list[str]
) -> None:
    """A tool that was turned in one of three recordings is a load of zero mass there; turned anew in each, it leaves
    much, as whatever swings from the hand does, and is none.
    """
    turned = [np.deg2rad(angle) for angle in angles]
    texts = [
        f"payload:payload=6.0,x={0.1 * np.cos(a):.5f},y={0.1 * np.sin(a):.5f},z=0.1,recording={k}.0"
        for k, a in enumerate(turned)
    ]
    found = diagnose([process(spoiled(text)[k], bench.robot) for k, text in enumerate(texts)], bench.structure)
    assert [s.label for s in found.missing if s.label == "payload"] == named
    assert found.verdict == ("missing" if named else "unexplained")


def changed(robot: Robot, fix: str) -> Robot:
    """Return the robot with the line of YAML that a fix names."""
    known = definition_of(robot)
    content = {key: dict(value) if isinstance(value, dict) else value for key, value in known.yaml.items()}
    for key, value in yaml.safe_load(fix).items():
        if key != "joints":
            content[key] = value
            continue
        for joint, told in value.items():
            content["joints"] = {**content["joints"], joint: {**content["joints"][joint], **told}}
    return robot_of(Definition(content, known.urdf), robot.source)


@pytest.mark.parametrize("text", [GAIN, *(pytest.param(one, marks=pytest.mark.long) for one in (SIGN, FILTER, LAG))])
def test_the_line_puts_it_right(bench: Any, spoiled: Any, said: Any, text: str) -> None:
    """Written into the robot YAML as it stands, what was far from the noise comes near it, and no friction is named."""
    (named,) = said(text).missing
    robot = changed(bench.robot, named.fix)
    again = diagnose([process(r, robot) for r in spoiled(text)[:3]], Structure.build(robot))
    assert not {s.effect.name for s in again.missing} & (FRICTION | {"effort_gain"})
    before = sum(named.mse_before.values()) - sum(named.mse_after.values())
    assert sum(rms**2 for rms in again.remaining_rms.values()) < 0.05 * before


def test_the_validation_shows_the_fall_too(said: Any) -> None:
    (named,) = said(GAIN).missing
    assert named.validation_before is not None and named.validation_after is not None
    assert named.validation_after["joint_2"] < 0.5 * named.validation_before["joint_2"]


@pytest.mark.long
def test_no_fault_where_there_is_none(bench: Any) -> None:
    """Nothing hidden, and friction that a gain or a filter could imitate: neither is called a fault."""
    assert bench.diagnose([]).verdict == "adequate"
    for effect in ("load_friction@joint_2:0.08", "presliding@joint_1"):
        found = bench.diagnose([effect])
        assert [s.effect.name for s in found.missing] == [effect.partition("@")[0]]


def test_samples_off_the_clock_are_named_beside_what_else_there_is(bench: Any, spoiled: Any, said: Any) -> None:
    found: Diagnosis = said(JITTER)
    assert [s.label for s in found.missing] == ["stamp_jitter"]
    (size,) = found.missing[0].parameters
    assert size.value == pytest.approx(1.0, rel=0.15)
    assert found.missing[0].effect.hidden_in(process(spoiled(JITTER)[0], bench.robot).motion)


@pytest.mark.parametrize("jitter", [0.0, 0.05, 0.3])
def test_how_far_off_the_clock(jitter: float) -> None:
    """From positions alone: [samples] rms, against what was put in, with noise of each joint on top."""
    rng, samples = np.random.default_rng(4), 400
    w = 2.0 * np.pi / samples
    k = np.arange(samples)[None, :, None] + jitter * rng.standard_normal((12, samples, 1))
    q = np.concatenate([np.sin(w * k), 0.5 * np.cos(3 * w * k), np.sin(2 * w * k + 1.0)], axis=2)
    found = off_clock(q + 1e-4 * rng.standard_normal(q.shape))
    assert found is not None
    if jitter:
        assert found.size == pytest.approx(jitter, rel=0.1)
        assert found.sigmas > 10.0
    else:
        assert abs(found.sigmas) < 4.0
    assert off_clock(q[:, :, :1]) is None


def test_a_gain_that_nothing_tells_is_called_so(bench: Any) -> None:
    """All joints' gains together, and a joint whose row shares no parameter with others', stay open."""
    evidence = gather(bench.measure([]), bench.structure)
    assert undecidable_gains(evidence, base_gram(evidence)) == []
    alone = replace(evidence, phi=tuple(_apart(phi) for phi in evidence.phi))
    assert undecidable_gains(alone, base_gram(alone)) == list(bench.robot.joints)


def _apart(phi: np.ndarray) -> np.ndarray:
    """Return columns in which every joint has parameters of its own."""
    n, p = phi.shape[1:]
    out = np.zeros((len(phi), n, n * p))
    for joint in range(n):
        out[:, joint, joint * p : (joint + 1) * p] = phi[:, joint]
    return out


def test_no_model_holds_a_fault(bench: Any) -> None:
    for label in ("effort_gain@joint_1", "effort_filter", "link_length@joint_2", "stamp_jitter"):
        with pytest.raises(InputError, match="put it right in the robot YAML"):
            make_effect(label, bench.robot)
