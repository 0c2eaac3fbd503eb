"""Cases in parallel processes."""

from __future__ import annotations

from math import sqrt

import pytest

from robot_ident.parallel import completed, run_parallel


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_cases(workers: int) -> None:
    seen: list[tuple[int, int]] = []
    results = run_parallel(sqrt, [16.0, 9.0, 4.0], workers, lambda done, of: seen.append((done, of)))
    assert results == [4.0, 3.0, 2.0]
    assert seen == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize("workers", [1, 2])
def test_the_exception_of_a_case_is_raised(workers: int) -> None:
    with pytest.raises(ValueError, match="math domain error"):
        run_parallel(sqrt, [4.0, -1.0], workers)


def test_who_closes_early_gets_no_more() -> None:
    results = completed(sqrt, [1.0, 4.0, 9.0], 1)
    assert next(results) == (0, 1.0)
    results.close()
    assert list(results) == []


def test_no_cases() -> None:
    assert run_parallel(sqrt, [], 2) == []
