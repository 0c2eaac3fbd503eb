"""Torque scales judged on pieces left out: their standard error holds where what is left keeps its sign for a while."""

from __future__ import annotations

import numpy as np

from robot_ident.estimation.held_out import Grams, held_out

PIECES, ROWS = 8, 60


def drawn(rng: np.random.Generator, scale: float) -> Grams:
    """Two joints share three columns, the second in a scale; a disturbance keeps its sign over a whole piece."""
    columns = rng.standard_normal((PIECES * ROWS, 2, 3)).cumsum(axis=0) / np.sqrt(ROWS)
    torque = columns @ np.array([2.0, -1.0, 1.5]) * np.array([1.0, scale])
    piece = np.repeat(np.arange(PIECES), ROWS)
    slow = rng.standard_normal((PIECES, 2))[piece]
    torque = torque + 0.3 * slow + 0.05 * rng.standard_normal(torque.shape)
    return Grams.of(columns, torque, piece, np.ones(torque.shape, dtype=bool), PIECES)


def test_the_spread_of_a_scale_over_pieces_is_its_error() -> None:
    rng, rigid, free = np.random.default_rng(5), np.ones(3, dtype=bool), np.array([False, True])
    z = []
    for _ in range(150):
        sums = drawn(rng, 1.1)
        _, fitted = held_out(sums, [sums], 1.0, rigid, free)
        assert fitted.scale_spread is not None
        assert fitted.scale_spread[0] == 0.0, "the first joint's scale is held"
        z.append((fitted.scale[1] - 1.1) / fitted.scale_spread[1])
    # eight pieces: Student's t of seven degrees of freedom lies within two in 91 %, whitened residuals in half of it
    assert 0.8 <= np.mean(np.abs(z) < 2.0) <= 0.99
