"""Scores the outcomes of a trial: rates with their intervals, and what was taken for what."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.diagnosis.diagnosis import FRICTION
from robot_ident.testbed.scenario import COUNTS
from robot_ident.testbed.trial import MEASUREMENT, Outcome

NOTHING = "nothing"
"""What the confusion matrix says where nothing was named."""


def wilson(successes: int, cases: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate (Wilson 1927): the rates that the count doesn't contradict.

    (p + z^2 / 2n -+ z sqrt(p (1 - p) / n + z^2 / 4 n^2)) / (1 + z^2 / n); (0, 1) without cases.
    """
    from scipy.stats import binomtest

    if cases == 0:
        return 0.0, 1.0
    interval = binomtest(successes, cases).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


@dataclass(frozen=True)
class Rate:
    """How often something happened: its 95 % interval, and the seeds where it didn't go as hoped."""

    name: str
    successes: int
    cases: int
    exceptions: tuple[int, ...]

    @classmethod
    def of(cls, name: str, happened: Sequence[tuple[int, bool]], *, hoped: bool) -> Rate:
        """Return it from what happened in the cases of some seeds, and whether that was hoped for."""
        otherwise = sorted({seed for seed, one in happened if one is not hoped})
        return cls(name, sum(one for _, one in happened), len(happened), tuple(otherwise))

    @property
    def share(self) -> float:
        """Part of the cases."""
        return self.successes / self.cases

    def to_dict(self) -> dict[str, Any]:
        """Return it as `trial --json` prints it."""
        lower, upper = wilson(self.successes, self.cases)
        return {
            "name": self.name,
            "successes": self.successes,
            "cases": self.cases,
            "share": self.share,
            "lower": lower,
            "upper": upper,
            "exceptions": list(self.exceptions),
        }


def named_right(o: Outcome) -> bool:
    """Return whether just what is hidden was named, effect and joint."""
    return set(o.named) == set(o.truth)


def in_tie_group(o: Outcome) -> bool:
    """Return whether all that is hidden was named, or tied with what was, or is one of the sets that are tied."""
    if any(set(labels) == set(o.truth) for labels in o.tied_sets):
        return True
    said = {*o.named, *(label for group in o.tied for label in group)}
    return bool(o.named) and set(o.truth) <= said


def found_or_tied(o: Outcome) -> bool:
    """Return whether all that is hidden was named or is one of the sets that are tied, and nothing else was named."""
    return in_tie_group(o) and not named_wrong(o)


def named_wrong(o: Outcome) -> bool:
    """Return whether something was named that is not there, and that what is there is not said to tie with."""
    there = {*o.truth, *o.background}
    pairs = zip(o.named, o.tied, strict=True)
    return any(label not in there and not there & set(group) for label, group in pairs)


_Test = Callable[[Outcome], bool]


def rates(outcomes: Sequence[Outcome], least: float) -> list[Rate]:
    """Return the rates of a trial; `least` [Nm rms]: the visible residual from which on an effect has to be found."""

    def single(o: Outcome) -> bool:
        return o.kind == "single" and max(o.visible.values()) >= least

    def several(o: Outcome) -> bool:
        return COUNTS.get(o.kind, 1) > 1

    def fault(o: Outcome, *, visible: bool) -> bool:
        return o.kind == MEASUREMENT and (max(o.visible.values()) >= least) == visible

    def rubs(o: Outcome) -> bool:
        return any(label.partition("@")[0] in FRICTION for label in o.named)

    def main_named(o: Outcome) -> bool:
        return set(o.truth) <= set(o.named) and not named_wrong(o)

    # which cases count, what is counted, and whether it is wanted
    rows: tuple[tuple[str, _Test, _Test, bool], ...] = (
        ("named_right", single, named_right, True),
        ("truth_in_tie_group", single, in_tie_group, True),
        ("wrong_name_outside_tie", single, named_wrong, False),
        ("false_name_on_null", lambda o: o.kind == "null", lambda o: bool(o.named), False),
        ("unknown_named", lambda o: o.kind == "unknown", lambda o: bool(o.named), False),
        ("pair_found_nothing_else", lambda o: o.kind == "pair_other_joints", named_right, True),
        ("same_joint_found_or_tied", lambda o: o.kind == "same_joint", found_or_tied, True),
        ("triple_found_or_tied", lambda o: o.kind == "triple", found_or_tied, True),
        ("wrong_name_among_several", several, named_wrong, False),
        ("unexplained_though_known", several, lambda o: o.verdict == "unexplained", False),
        ("fault_named", lambda o: fault(o, visible=True), in_tie_group, True),
        ("wrong_name_for_faint_fault", lambda o: fault(o, visible=False), named_wrong, False),
        ("friction_named_for_fault", lambda o: o.kind == MEASUREMENT, rubs, False),
        ("named_right_with_background", lambda o: o.kind == "single_with_background", main_named, True),
    )
    out = []
    for name, counts, happened, wanted in rows:
        among = [o for o in outcomes if counts(o)]
        if among:
            said = [happened(o) for o in among]
            seeds = [o.seed for o, yes in zip(among, said, strict=True) if yes != wanted]
            out.append(Rate(name, sum(said), len(among), tuple(seeds)))
    return out


def removed_quantiles(outcomes: Sequence[Outcome]) -> tuple[float, float] | None:
    """Return median and 10th percentile of the share of the unseen error that adding removed; None without cases.

    Where nothing was named, or what was named could not be added, nothing was removed.
    """
    shares = [o.removed or 0.0 for o in outcomes if o.kind == "single"]
    if not shares:
        return None
    tenth, median = np.quantile(np.array(shares), [0.1, 0.5])
    return float(median), float(tenth)


def confusion(outcomes: Sequence[Outcome]) -> dict[str, dict[str, int]]:
    """Return, by the name of what was hidden, how often it was named how.

    Singles, cases without anything hidden and unknown ones. Several names are joined by ` + `; a name at another joint
    reads `name elsewhere`.
    """
    table: dict[str, Counter[str]] = {}
    for o in outcomes:
        if len(o.truth) > 1:
            continue
        name, _, joint = (o.truth[0] if o.truth else NOTHING).partition("@")
        said = []
        for label in o.named:
            what, _, place = label.partition("@")
            said.append(what if place == joint else f"{what} elsewhere")
        table.setdefault(name, Counter())[" + ".join(sorted(said)) or NOTHING] += 1
    return {name: dict(row.most_common()) for name, row in sorted(table.items())}


def summary(outcomes: Sequence[Outcome], least: float) -> dict[str, Any]:
    """Return all scores of a trial as data."""
    removed = removed_quantiles(outcomes)
    seconds = [o.seconds for o in outcomes]
    return {
        "rates": [rate.to_dict() for rate in rates(outcomes, least)],
        "error_removed": None if removed is None else {"median": removed[0], "tenth_percentile": removed[1]},
        "not_added": sum(1 for o in outcomes if o.trouble),
        "diagnosis_seconds": {"median": float(np.median(seconds)), "largest": max(seconds)} if seconds else None,
        "confusion": confusion(outcomes),
    }
