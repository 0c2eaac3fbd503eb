"""What no effect of the catalogue is gets no name, though some effect explains half of it, and is told in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.candidates import Score
from robot_ident.diagnosis.evidence import gather
from robot_ident.diagnosis.refine import refined
from robot_ident.diagnosis.spectrum import whitened
from robot_ident.diagnosis.stage import Stage
from robot_ident.diagnosis.unexplained import doubted, of_another_form, shapes
from robot_ident.recording import process
from robot_ident.recording.recording import Recording
from robot_ident.signals.motion import Motion

PERIOD = 1500
Torque = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def of_two_speeds(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return friction of joint 3 that rises with the speed of joint 2."""
    return 9.0 * dq[:, 2] * np.abs(dq[:, 1])


def with_hidden(recording: Recording, joint: int, hidden: Torque) -> Recording:
    """Return a recording with more torque at a joint, by the mean of its periods, differentiated by differences."""
    q = recording.q.reshape(-1, PERIOD, 3).mean(axis=0)
    dq = (np.roll(q, -3, axis=0) - np.roll(q, 3, axis=0)) / (6.0 / 150.0)
    tau = recording.tau.copy()
    tau[:, joint] += np.tile(hidden(q, dq, tau[:PERIOD]), len(tau) // PERIOD)
    return replace(recording, tau=tau)


def torque_wave(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return the error of a gear that gives 4 % more and less, seven times a turn of joint 3."""
    return 0.04 * tau[:, 2] * np.sin(7.0 * q[:, 2] + 0.4)


def coupled(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return what joint 3 feels of the friction of joint 2."""
    return 4.0 * dq[:, 1] + 2.0 * np.sign(dq[:, 1])


def dent(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return the torque of a dent in a gear at one place of joint 3."""
    return -14.0 / np.cosh((q[:, 2] - 0.5) / 0.12) ** 2


def hose_and_stop(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return a hose that bends about 0.1 rad and a rubber stop that gets harder, both of joint 3."""
    return 9.0 * np.tan(0.6 * (q[:, 2] - 0.1)) + 120.0 * np.maximum(q[:, 2] - 0.45, 0.0) ** 1.2


def cogging(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return a wave over the position of joint 3, of which the motions see little more than a turn."""
    return 6.0 * np.sin(3.0 * q[:, 2] + 0.7)


def hose(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return a hose that pulls in proportion."""
    return 8.0 * (q[:, 2] - 0.1)


Members = tuple[list[Score], Stage, Stage]


def members_of(name: str, bench: Any, hidden: Torque) -> Members:
    """Return effects at joint 3 as the members of a model, on data with something hidden, its first and last stage."""
    measured = [process(with_hidden(bench.record([], k), 2, hidden), bench.robot) for k in (0, 1)]
    first = Stage.of(whitened(gather(measured, bench.structure)))
    members: list[Score] = []
    for one in name.split():
        stage = first.under(first.evidence, [m.effect for m in members])
        found = next(s for s in stage.scores if s.label == f"{one}@joint_3")
        members.append(refined(found, stage.evidence, stage.folds))
    return members, first, first.under(first.evidence, [m.effect for m in members])


def said_of(name: str, bench: Any, hidden: Torque) -> dict[str, str]:
    """Return what is said of effects at joint 3 on data with something hidden."""
    return doubted(*members_of(name, bench, hidden))


@pytest.mark.parametrize(
    ("hidden", "words"),
    [
        (of_two_speeds, "dq of joint_3 * |dq of joint_2|"),
        (torque_wave, "its torque * a wave over q of joint_3, 7 a turn"),
    ],
)
def test_what_follows_a_shape_gets_no_name(bench: Any, hidden: Torque, words: str) -> None:
    for name in ("joint_coupling", "position_friction", "encoder_eccentricity"):
        why = said_of(name, bench, hidden)[f"{name}@joint_3"]
        assert "gets no name" in why and words in why


@pytest.mark.parametrize("name", ["cable", "gravity_spring", "end_stop"])
def test_a_dent_is_no_spring(bench: Any, name: str) -> None:
    assert "a curve with corners over q of joint_3" in said_of(name, bench, dent)[f"{name}@joint_3"]


def test_springs_that_only_together_make_a_dent_get_no_names(bench: Any) -> None:
    why = said_of("end_stop gravity_spring", bench, dent)
    assert set(why) == {"end_stop@joint_3", "gravity_spring@joint_3"}


def test_of_two_springs_the_one_that_explains_nearly_all_keeps_its_name(bench: Any) -> None:
    why = said_of("end_stop cable", bench, hose_and_stop)
    assert set(why) == {"cable@joint_3"}
    assert "cable@joint_3 gets no name" in why["cable@joint_3"]


def test_a_spring_that_stands_for_another_form_is_told(bench: Any) -> None:
    (line,) = of_another_form(*members_of("cable", bench, cogging))
    assert line.startswith("cable@joint_3 predicts ")
    assert "over q of joint_3" in line and line.endswith("static in q, but of another form")
    assert not of_another_form(*members_of("cable", bench, hose))
    assert not of_another_form(*members_of("joint_coupling", bench, of_two_speeds))


def test_a_cause_keeps_its_name(bench: Any) -> None:
    assert said_of("joint_coupling", bench, coupled) == {}


@pytest.mark.parametrize("joint", [0, 2])
def test_shapes_are_columns_at_their_joint(bench: Any, joint: int) -> None:
    """Finite, of the joint alone, none a multiple of another one, each with words of its own."""
    t = np.arange(0.0, 10.0, 0.02)
    q = np.stack([0.8 * np.sin(0.63 * k * t + k) for k in (1, 2, 3)], axis=1)
    motion = Motion(q, np.gradient(q, 0.02, axis=0), np.zeros_like(q), 0.02)
    made = [shape for shape in shapes(bench.robot, joint, (-1.0, 1.0)) if "torque" not in shape.words]
    columns = [shape.columns(motion) for shape in made]
    assert len({shape.words for shape in made}) == len(made)
    for one in columns:
        assert np.all(np.isfinite(one))
        assert not np.delete(one, joint, axis=1).any()
    single = np.stack([one[:, joint, 0] / np.linalg.norm(one[:, joint, 0]) for one in columns if one.shape[2] == 1])
    alike = np.abs(single @ single.T) - np.eye(len(single))
    assert alike.max() < 0.9999
