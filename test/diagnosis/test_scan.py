"""What is left out is predicted by what the rest determines; what it hardly determines is no reason for doubt."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from robot_ident.diagnosis import ties
from robot_ident.diagnosis.evidence import gather
from robot_ident.diagnosis.scan import BaseFit, BaseGram, add
from robot_ident.diagnosis.spectrum import whitened
from robot_ident.diagnosis.stage import Stage
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


def test_a_plainer_effect_that_fits_all_data_as_well_ties(bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A soft stop from mid range on may extrapolate better, by chance, than the offset that it imitates."""
    hidden = ("torque_offset@joint_2:torque_offset=8",)
    stage = Stage.of(whitened(gather(bench.measure(hidden, [0, 1], noise=AS_OF_16), bench.structure)))
    by_label = {score.label: score for score in stage.scores}
    offset, stop = by_label["torque_offset@joint_2"], by_label["end_stop@joint_2"]
    assert offset.gain >= stop.gain

    def lost(score: Any, *rest: object) -> Array:
        """Every block of time foretold best by the stop."""
        return np.full(20, 5.0 + (score is not stop)) + 1e-3 * np.arange(20)

    monkeypatch.setattr(ties, "block_losses", lost)
    rivals = [rival.label for rival in ties.tied(stop, stage.scores, stage.evidence, stage.folds)]
    assert "torque_offset@joint_2" in rivals
    for name in rivals:
        further = stop.effect.size - by_label[name].effect.size
        assert further > 0 and by_label[name].gain >= stop.gain - chi2.ppf(0.999, further)
    luckier = replace(stop, gain=offset.gain + 13.7)  # two parameters more gain 13.8 of noise, once in 1000 times
    certain = replace(stop, gain=offset.gain + 13.9)
    for best, as_well in ((luckier, True), (certain, False)):
        monkeypatch.setattr(ties, "block_losses", lambda score, *rest, b=best: lost(stop if score is b else score))
        rivals = [rival.label for rival in ties.tied(best, [best, offset], stage.evidence, stage.folds)]
        assert rivals == (["torque_offset@joint_2"] if as_well else [])


def test_an_encoder_off_by_ten_degrees_is_none(bench: Any) -> None:
    def found(amplitude: float) -> Array:
        hidden = f"encoder_eccentricity@joint_2:encoder_eccentricity={amplitude},position=-0.17,harmonic=2"
        stage = Stage.of(whitened(gather(bench.measure((hidden,), [0, 1], noise=AS_OF_16), bench.structure)))
        score = next(score for score in stage.scores if score.label == "encoder_eccentricity@joint_2")
        return add(score.gram, stage.folds.whole, score.effect.ranges).coefficients  # mrad

    assert np.hypot(*found(0.008)) == pytest.approx(8.0, rel=0.3)
    assert np.max(np.abs(found(0.2))) <= 100.0
