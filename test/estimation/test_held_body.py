"""A payload of which a part is known: what is given stays, what is left out is estimated, and better than before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.bags import write_recording
from robot_ident.cli.main import main
from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.payload import Holding, identify_payload
from robot_ident.model.model_file import write_model
from robot_ident.recording import Recording, process
from robot_ident.recording.conditions import Conditions, KnownPayload, PayloadPart
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array
from robot_ident.testbed.calibrate import standard_motions
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play

BODY = KnownPayload(12.0, (0.06, 0.02, 0.1))
POINT = (0.0,) * 6
PARTS = {
    "mass": PayloadPart(mass=12.0),
    "centre": PayloadPart(centre=BODY.centre),
    "mass and centre": PayloadPart(12.0, BODY.centre),
    "mass and inertia": PayloadPart(12.0, None, POINT),
    "inertia": PayloadPart(inertia=POINT),
}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def runs(robot: Robot) -> list[Recording]:
    """Return the empty arm on one motion, and one that carries the body on another, twice."""
    first, second = standard_motions(robot)[:2]
    empty = Play.of(robot, plant_physics(robot, []), first, sample_rate=75.0)
    loaded = Play.of(robot, plant_physics(robot, ["payload:payload=12,x=0.06,y=0.02,z=0.1"]), second, sample_rate=75.0)
    return [
        replace(empty.record(8, seed=2), source="plain"),
        replace(loaded.record(8, seed=3), source="carried"),
        replace(loaded.record(8, seed=4), source="again"),
    ]


def with_part(recording: Recording, part: PayloadPart) -> Recording:
    return replace(recording, conditions=Conditions(estimated=True, body="box", part=part))


@pytest.fixture(scope="module")
def free(robot: Robot, runs: list[Recording]) -> dict[str, Any]:
    """Return what is found where nothing is known."""
    (one,) = identify([runs[0], with_part(runs[1], PayloadPart())], robot).payloads
    return dict(one)


@pytest.mark.parametrize("part", PARTS.values(), ids=PARTS)
def test_what_is_free_are_the_derivatives_of_what_is_held(robot: Robot, part: PayloadPart) -> None:
    """From a body that keeps what is known, a small way along each direction still keeps it to first order."""
    rng = np.random.default_rng(1)
    holding = Holding(part, robot)
    values = holding.settled(np.array([9.0, *rng.normal(size=9)]))
    directions, vague = holding.directions(values)
    assert np.linalg.matrix_rank(directions) == directions.shape[1] == len(vague)
    free = 10 - sum({"mass": 1, "centre": 3, "inertia": 6}[name] for name in part.given)
    assert directions.shape[1] == free
    for column in directions.T:
        for step in (1e-3, 1e-4):
            moved = values + step * column
            assert np.abs(holding.settled(moved) - moved).max() <= 10.0 * step**2 + 1e-12


@pytest.mark.parametrize("part", PARTS.values(), ids=PARTS)
def test_what_is_given_is_held_and_the_rest_found(
    robot: Robot, runs: list[Recording], free: dict[str, Any], part: PayloadPart
) -> None:
    model = identify([runs[0], with_part(runs[1], part)], robot)
    (one,) = model.payloads
    assert one["given"] == list(part.given)
    truth = {"mass": BODY.mass, "centre": BODY.centre, "inertia": POINT}
    for name, expected in truth.items():
        off = np.abs(np.array(one[name]) - np.array(expected))
        std, before = np.array(one[f"{name}_std"]), np.array(free[f"{name}_std"])
        if name in part.given:
            assert np.max(off) < 1e-9 and np.all(std == 0.0)
        else:
            assert np.all(off < 4.0 * std)
            assert np.all(std < 1.001 * before)
    if part.mass is not None and part.centre is None:
        surer = np.array(one["centre_std"]) / np.array(free["centre_std"])
        assert np.all(surer < 1.0) and surer.min() < 0.5, "a known mass makes the centre surer"
    if part.mass is not None:
        assert "12 kg (given)" in " ".join(model.notes)
    error = (model.linear - model.structure.true_values()) / model.std
    assert np.abs(error).max() < 4.0


def test_covariance_is_that_of_repetition(robot: Robot) -> None:
    """Mass known: over many recordings the centre scatters by its standard deviation."""
    first, second = standard_motions(robot)[:2]
    empty = Play.of(robot, plant_physics(robot, []), first, sample_rate=50.0)
    loaded = Play.of(robot, plant_physics(robot, ["payload:payload=12,x=0.06,y=0.02,z=0.1"]), second, sample_rate=50.0)
    z: list[Array] = []
    for seed in range(10):
        recordings = [empty.record(6, seed=2 * seed), with_part(loaded.record(6, seed=2 * seed + 1), PARTS["mass"])]
        (one,) = identify(recordings, robot).payloads
        z.append((np.array(one["centre"]) - BODY.centre) / one["centre_std"])
    assert 0.65 < np.sqrt(np.mean(np.square(z))) < 1.45


def test_on_a_known_arm_what_is_given_is_held(
    robot: Robot, runs: list[Recording], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = identify(runs[:1], robot)
    measured = [process(runs[1], robot)]
    free = identify_payload(measured, model).body
    for part in PARTS.values():
        body = identify_payload(measured, model, part=part).body
        assert body.given == part.given
        assert body.mass == pytest.approx(12.0, abs=1e-9 if part.mass else 4 * free.mass_std)
        assert np.all(np.abs(body.centre - BODY.centre) <= 4 * free.centre_std)
        assert np.all(body.centre_std <= 1.001 * free.centre_std)
    write_model(model, tmp_path / "model.yaml")
    bag = tmp_path / "carried.npz"
    write_recording(bag, runs[1])
    sidecar = Path(f"{bag}.conditions.yaml")
    sidecar.write_text(Conditions(estimated=True, body="box", part=PARTS["mass"]).text(), encoding="utf-8")
    assert main(["identify", str(bag), "--only", "payload", "--model", str(tmp_path / "model.yaml")]) == 0
    out = capsys.readouterr().out
    assert "given" in next(line for line in out.splitlines() if line.startswith("mass"))
    assert "given" not in next(line for line in out.splitlines() if line.startswith("centre x"))


def test_one_name_stands_for_one_body(robot: Robot, runs: list[Recording]) -> None:
    again = with_part(runs[2], PayloadPart(mass=13.0))
    with pytest.raises(InputError, match="again: payload box: mass = 13.0, where carried states 12.0"):
        identify([runs[0], with_part(runs[1], PARTS["mass"]), again], robot)
    (one,) = identify(
        [runs[0], with_part(runs[1], PARTS["mass"]), with_part(runs[2], PARTS["centre"])],
        robot,
    ).payloads
    assert one["given"] == ["mass", "centre"], "what each of them states holds for all"
