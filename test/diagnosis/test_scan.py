"""What is left out is predicted by what the rest determines; what it hardly determines is no reason for doubt."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.selection.data_set import DataSet, Rows
from robot_ident.diagnosis.selection.fitted_set import FittedSet
from robot_ident.effects import make_effect
from robot_ident.regression.gram import FAINT, BaseFit, BaseGram
from robot_ident.signals.motion import Array

ROWS, NOISE = 400, 1.0
TRUE = np.array([30.0, 20.0])
AS_OF_16 = 6.0 / 16.0  # of the noise: six periods tell as much as sixteen of the paper's


def gram_of(parts: list[tuple[Array, Array]]) -> BaseGram:
    """Return the Gram matrices of columns [N, p] and torques [N] of one joint."""
    own = np.array([[phi.T @ phi] for phi, _ in parts])
    return BaseGram(own, np.array([[phi.T @ y] for phi, y in parts]), np.array([[y @ y] for _, y in parts]))


def part(sizes: tuple[float, float], random: np.random.Generator) -> tuple[Array, Array]:
    phi = random.normal(size=(ROWS, 2)) * sizes
    return phi, phi @ TRUE + NOISE * random.normal(size=ROWS)


@pytest.mark.parametrize("seed", range(5))
def test_a_direction_that_only_the_left_out_one_moves_in_is_not_extrapolated_to(seed: int) -> None:
    random = np.random.default_rng(seed)
    parts = [part((1.0, 1e-4), random), part((1.0, 1.0), random)]
    loss = float(BaseFit.of(gram_of(parts), [0]).loss(gram_of(parts), 1)[0])
    phi, y = parts[0]
    alone = np.linalg.lstsq(phi, y, rcond=None)[0]
    blind = float(np.sum((parts[1][1] - parts[1][0] @ alone) ** 2))
    assert blind > 100.0 * ROWS, "the other trajectory alone tells nothing of it"
    assert loss < 1.2 * ROWS


@pytest.mark.parametrize("seed", range(5))
def test_what_the_others_determine_hardly_notices(seed: int) -> None:
    random = np.random.default_rng(seed)
    parts = [part((1.0, 1.0), random) for _ in range(3)]
    off = 0.5 * parts[2][0][:, 0]  # the third is another arm by so much
    parts[2] = parts[2][0], parts[2][1] + off
    phi, y = (np.concatenate(rows) for rows in zip(*parts[:2], strict=True))
    plain = float(np.sum((parts[2][1] - parts[2][0] @ np.linalg.lstsq(phi, y, rcond=None)[0]) ** 2))
    loss = float(BaseFit.of(gram_of(parts), [0, 1]).loss(gram_of(parts), 2)[0])
    assert loss == pytest.approx(plain, rel=0.02)


def test_an_encoder_off_by_ten_degrees_is_none(bench: Any) -> None:
    def found(amplitude: float) -> Array:
        hidden = f"encoder_eccentricity@joint_2:encoder_eccentricity={amplitude},position=-0.17,harmonic=2"
        measured = bench.measure((hidden,), [0, 1], noise=AS_OF_16)
        effect = make_effect("encoder_eccentricity@joint_2", bench.robot)
        data = DataSet(Rows.of(measured, bench.structure), [effect])
        given = FittedSet(data, (), np.ones_like(data.power))
        return given.coefficients(-1, max(data.hypotheses[effect.label], key=given.gain))[0]  # mrad

    assert np.hypot(*found(0.008)) == pytest.approx(8.0, rel=0.3)
    assert np.max(np.abs(found(0.2))) <= 100.0


def test_noise_of_fitted_motions_moves_what_the_others_lose(bench: Any) -> None:
    """As fits of noisy rows do, each to all motions but one, of which a hundredth is kept."""
    measured, effect = bench.measure(("stribeck@joint_1",)), make_effect("stribeck@joint_1", bench.robot)
    data = DataSet(Rows.of(measured, bench.structure), [effect])
    given = FittedSet(data, data.hypotheses[effect.label][:1], np.array([[1.0, 2.0, 1.5]] * 3))
    random, draws = np.random.default_rng(7), 4
    noise = {
        (j, f): random.normal(size=(draws, len(data.y[j][f]))) for j in range(data.n) for f in range(data.training)
    }
    found = given.noise_losses(lambda j, f: noise[j, f] @ given.columns(j, f))
    lost = np.zeros((draws, 2))
    for left in range(data.training):
        rows, torques = [], []
        for (j, f), e in noise.items():
            scale = 1.0 / np.sqrt(given.dispersion[f, j])
            faint = np.sqrt(FAINT) if f == left else 1.0
            rows.append(faint * scale * given.columns(j, f))
            clean = faint * scale * np.tile(data.y[j][f], (draws, 1))
            torques.append(np.stack([clean, clean if f == left else clean + e], axis=2))
        phi, y = np.concatenate(rows), np.concatenate(torques, axis=1)
        for draw, which in np.ndindex(draws, 2):
            values = np.linalg.lstsq(phi, y[draw, :, which], rcond=None)[0]
            for j in range(data.n):
                error = data.y[j][left] - given.columns(j, left) @ values
                lost[draw, which] += error @ error / given.dispersion[left, j]
    moved = lost[:, 1] - lost[:, 0]
    assert np.ptp(moved) > 3.0
    np.testing.assert_allclose(found - found.mean(), moved - moved.mean(), atol=1e-3 * np.ptp(moved))
