"""`simulate --payload` states what the hand carries beside the bag, and recordings with and without are one arm's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from robot_ident.recording.conditions import KnownPayload, read_conditions, sidecar

Run = Callable[..., Any]


def test_a_payload_is_simulated_stated_and_taken_off(run: Run, excitation: Path, tmp_path: Path) -> None:
    plain, loaded, model = (str(tmp_path / name) for name in ("plain.npz", "loaded.npz", "model.yaml"))
    run("simulate", excitation, "--periods", "4", "--seed", "1", "-o", plain)
    run("simulate", excitation, "--periods", "4", "--seed", "2", "--payload", "30,0,0.1,0.2", "-o", loaded)
    assert read_conditions(loaded).payload == KnownPayload(30.0, (0.0, 0.1, 0.2))
    assert not sidecar(plain).exists()
    together = run("identify", plain, loaded, "-o", model, "--json").json
    residual = [fit["mse"] / fit["noise_variance"] for fit in together["residual"].values()]
    assert max(residual) < 1.3
    assert any("payload of 30 kg taken off" in note for note in together["notes"])
    assert together["days"]["intervals"] == "this day only"
    assert together["gains"] is None
    sidecar(loaded).unlink()
    forgotten = run("identify", plain, loaded, "--json").json
    assert max(fit["mse"] / fit["noise_variance"] for fit in forgotten["residual"].values()) > 3.0


def test_a_sidecar_never_outlives_its_bag(run: Run, excitation: Path, tmp_path: Path) -> None:
    bag = str(tmp_path / "bag.npz")
    run("simulate", excitation, "--periods", "1", "--payload", "5", "-o", bag)
    Path(bag).unlink()
    assert run("simulate", excitation, "--periods", "1", "-o", bag).code == 2
    run("simulate", excitation, "--periods", "1", "-o", bag, "--force")
    assert not sidecar(bag).exists()


def test_bad_payloads(run: Run, excitation: Path, tmp_path: Path) -> None:
    bag = str(tmp_path / "bag.npz")
    for text in ("-1", "2,3", "heavy", "nan", "0"):
        done = run("simulate", excitation, f"--payload={text}", "-o", bag)
        assert done.code == 2
        assert f"--payload {text}" in done.err
    assert not Path(bag).exists()


def test_a_payload_in_grams_is_named_and_not_the_robot(run: Run, excitation: Path, tmp_path: Path) -> None:
    bag = str(tmp_path / "bag.npz")
    run("simulate", excitation, "--periods", "2", "--payload", "5,0,0,0.1", "-o", bag)
    for wrong, told in (
        ("{mass: 5000, centre: [0, 0, 0.1]}", "payload.mass = 5000"),
        ("{mass: 5, centre: [0, 0, 100]}", "centre: [0, 0, 100] m lies 100 m from the flange: millimetres?"),
    ):
        sidecar(bag).write_text(f"schema: robot_ident/conditions/1\npayload: {wrong}\n", encoding="utf-8")
        done = run("identify", bag)
        assert done.code == 2
        assert f"{sidecar(bag)}: {told}" in done.err
        assert done.err.count("\n") == 1
