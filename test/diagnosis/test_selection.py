"""The search over sets of effects: what it names, how sure it is, and the algebra that it stands on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.before_after import estimates
from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.diagnosis.selection.consistency import splits
from robot_ident.diagnosis.selection.data_set import DataSet, Rows
from robot_ident.diagnosis.selection.diagnosis_of import TWO_SIGMA, known_parameters
from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.diagnosis.selection.probability import Election
from robot_ident.diagnosis.selection.reversals import near_reversals, resolution, unresolved_rows
from robot_ident.diagnosis.selection.search import Search
from robot_ident.diagnosis.selection.unseen_reactions import with_unseen_reactions
from robot_ident.effects import make_effect
from robot_ident.estimation.solve import solve
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.regression.evidence import extended, gather
from robot_ident.regression.spectrum import whitened
from robot_ident.robot import Robot
from robot_ident.signals.fourier import above_noise

OFFSET = "torque_offset@joint_1:torque_offset=6"
STRIBECK = "stribeck@joint_2:stribeck=20,speed=0.08"


def by_sets(bench: Any, measurements: Sequence[Measurement], **options: Any) -> Diagnosis:
    return diagnose(measurements, bench.structure, **options)


def labels(found: Diagnosis) -> set[str]:
    return {one.label for one in found.missing}


@pytest.mark.parametrize(
    "effect",
    [
        OFFSET,
        "end_stop@joint_2:end_stop=30,position=0.5,direction=1",
        "friction_behind_play@joint_1:level=20,gap=0.03,reach=0.001",
        "time_delay@joint_3:time_delay=0.008",
        *(
            pytest.param(effect, marks=pytest.mark.long)
            for effect in (
                STRIBECK,
                "load_friction@joint_3:load_friction=0.08",
                "position_friction@joint_1:position_friction=14",
                "presliding@joint_2:reach=0.02",
                "presliding@joint_1:reach=0.001",
            )
        ),
    ],
)
def test_one_effect_is_named_and_nothing_else(bench: Any, effect: str) -> None:
    found = by_sets(bench, bench.measure((effect,)))
    name = effect.partition(":")[0]
    assert labels(found) == {name} or name in {label for one in found.missing for label in one.tied_with}
    assert all(one.probability is not None and one.probability >= 0.8 for one in found.missing)


@pytest.mark.parametrize(
    "pair",
    [
        pytest.param(
            ("stribeck@joint_2:stribeck=20,speed=0.08", "position_friction@joint_2:position_friction=14"),
            marks=pytest.mark.long,
        ),
        pytest.param(
            ("load_friction@joint_1:load_friction=0.05", "position_friction@joint_1:position_friction=14"),
            marks=pytest.mark.long,
        ),
        ("torque_ripple@joint_2:torque_ripple=3,order=206.47", "joint_coupling@joint_2:viscous=2.5"),
    ],
    ids=["one parameter", "two", "three"],
)
def test_two_effects_of_one_joint(bench: Any, pair: tuple[str, str]) -> None:
    """Of one parameter or several, such that neither alone explains half of what both leave."""
    assert labels(by_sets(bench, bench.measure(pair))) == {effect.partition(":")[0] for effect in pair}


@pytest.mark.parametrize("noise", [1 / 16, 1.0])
def test_nothing_is_named_where_nothing_is_missing(bench: Any, noise: float) -> None:
    found = by_sets(bench, bench.measure((), noise=noise))
    assert found.verdict == "adequate" and found.missing == () and found.tied_sets == ()


@pytest.mark.long
def test_friction_that_drifts_over_the_periods_is_named_beside_what_their_mean_shows(bench: Any) -> None:
    drift = "temperature_drift@joint_3:temperature_drift=30,time_constant=80"
    found = by_sets(bench, bench.measure((OFFSET, drift)))
    assert labels(found) == {"torque_offset@joint_1", "temperature_drift@joint_3"}


def _pulled(measured: Measurement, size: float) -> Measurement:
    """A rope in space: what it does to a joint depends on where the others stand."""
    q = measured.motion.q
    force = size * np.sin(q[:, 0] + 2.0 * q[:, 1]) * np.cos(q[:, 2])
    return replace(measured, torque=measured.torque + np.outer(force, [1.0, 0.7, 0.4]))


@pytest.mark.long
def test_a_cause_outside_the_catalogue_gets_no_name(bench: Any) -> None:
    found = by_sets(bench, [_pulled(measured, 25.0) for measured in bench.measure(())])
    assert found.missing == () and found.verdict in ("unexplained", "not_decidable")


@pytest.mark.long
def test_friction_of_a_drive_is_named_though_most_of_the_rest_has_an_unknown_cause(bench: Any) -> None:
    rubbing = bench.measure(("viscous_nonlinear@joint_2:viscous_nonlinear=20",))
    found = by_sets(bench, [_pulled(measured, 8.0) for measured in rubbing])
    assert labels(found) == {"viscous_nonlinear@joint_2"}
    (one,) = found.missing
    assert one.explained < 0.5, "what explains less of anything else gets no name"
    assert max(found.remaining_rms.values()) > 2.0, "Nm, that nothing accounts for"


@pytest.mark.long
def test_a_curve_over_a_position_is_no_two_causes(bench: Any) -> None:
    """A bump looks like a cable and an end stop; a cable is one cause, and may be a spring and an offset."""
    found = by_sets(bench, bench.measure(("unknown_bump@joint_2:bump=25,position=0.1,width=0.3",)))
    assert not found.missing and found.verdict == "unexplained"
    found = by_sets(bench, bench.measure(("cable@joint_3:cable=11,relaxed=0.33",)))
    assert labels(found) == {"cable@joint_3"}
    other = "gravity_spring@joint_3 and torque_offset@joint_3"
    assert tuple(other.split(" and ")) in found.tied_sets
    assert f"these recordings do not tell the sets apart: either cable@joint_3, or {other}" in found.notes


@pytest.mark.long
def test_a_play_and_a_way_to_sliding_are_told_apart_where_the_recording_shows_the_way(bench: Any) -> None:
    """A milliradian is crossed between two samples; thirty take a tenth of a second, in which friction is away."""
    fast = by_sets(bench, bench.measure(("presliding@joint_1:reach=0.001",)))
    assert {label for one in fast.missing for label in (one.label, *one.tied_with)} == set(LATE)
    slow = by_sets(bench, bench.measure(("friction_behind_play@joint_1:level=20,gap=0.03,reach=0.001",)))
    assert labels(slow) == {LATE[1]} and slow.tied_sets == ()


LATE = ("presliding@joint_1", "friction_behind_play@joint_1")
EARLY = "time_delay@joint_3:time_delay=-0.003"
"""Half a sample early: it shows in one sample before each reversal."""


@pytest.mark.long
def test_one_effect_beside_another_may_be_two(bench: Any) -> None:
    """A cable beside a third effect of its joint may be a spring and an offset."""
    spring = "gravity_spring@joint_2:stiffness=3000"
    hidden = (spring, "torque_offset@joint_2:torque_offset=-5.3", "stribeck@joint_2:stribeck=44,speed=0.03")
    found = by_sets(bench, bench.measure(hidden, noise=1.0))
    assert ("gravity_spring@joint_2", "stribeck@joint_2", "torque_offset@joint_2") in found.tied_sets


def test_what_a_formula_may_err_counts_in_the_model_as_in_the_set(bench: Any) -> None:
    measured = bench.measure((STRIBECK,))
    bare = DataSet(Rows.of(measured, bench.structure))
    h = bare.hypotheses["stribeck@joint_2"][0]
    given = Search(bare).given([h])
    longer = DataSet(Rows.of(measured, bench.structure.with_further([h.effect])))
    assert bare.known_errors == {}
    of_set = h.formula_error**2 * given.contribution(h)
    np.testing.assert_allclose(longer.known_errors["stribeck@joint_2"], of_set, rtol=0.02)


@pytest.mark.long
def test_what_formulas_of_the_model_may_have_left_is_said(bench: Any) -> None:
    """Stribeck friction in the model at a speed that is a fifth off."""
    measured = bench.measure(("stribeck@joint_2:stribeck=60,speed=0.08",))
    known = make_effect("stribeck@joint_2", bench.robot).at({"vs": 0.1})
    found = diagnose(measured, bench.structure.with_further([known]))
    assert found.verdict == "not_decidable" and found.missing == ()
    assert any(
        "the formulas of effects that the model has (above all stribeck@joint_2)" in note for note in found.notes
    )


def test_what_a_joint_leaves_where_it_creeps_is_no_remainder(bench: Any) -> None:
    """A tenth of its rows, slower than a hundredth of its largest speed, hold an error of five times the noise."""
    first = bench.measure((STRIBECK,))[0]
    speed = np.abs(first.motion.dq[:, 0])
    slow = 1.0 + np.argsort(np.argsort(speed)) / len(speed)
    creeping = replace(first.motion, dq=first.motion.dq * np.where(slow < 1.1, 1e-3, 1.0)[:, None])
    data = DataSet(Rows.of([replace(first, motion=creeping), *bench.measure((STRIBECK,))[1:]], bench.structure))
    given = Search(data).given(())
    before = given.excess()
    assert 0.05 < 1.0 - np.mean(data.moving[0][:, 0]) < 0.2
    data.y[0][0][~data.moving[0][:, 0]] += 5.0
    np.testing.assert_allclose(given.excess(), before)
    data.y[0][0][data.moving[0][:, 0]] += 5.0
    assert given.excess()[0] > before[0] + 20.0 * np.sum(data.moving[0][:, 0])


def test_a_small_part_of_a_large_shift_is_no_delay(bench: Any) -> None:
    lower, upper = make_effect("time_delay@joint_2", bench.robot).at({"shift": -0.02}).ranges[0]
    assert lower < -20.0 < upper < -2.0


def test_an_effect_whose_size_is_vague_is_named_where_it_explains_all(bench: Any) -> None:
    assert labels(by_sets(bench, bench.measure((EARLY,)))) == {"time_delay@joint_3"}


@pytest.mark.long
def test_an_effect_whose_size_is_vague_is_listed_next_to_an_unknown_cause(bench: Any) -> None:
    found = by_sets(bench, bench.measure((EARLY, "unknown_product@joint_2:product=20,other=1")))
    assert found.verdict == "not_decidable" and not found.missing
    assert (found.others[0].label, found.others[0].probability) == ("time_delay@joint_3", None)
    assert any(note.startswith("time_delay@joint_3 may be missing: its size is known to ") for note in found.notes)


def test_what_may_be_zero_is_not_told_from_it(bench: Any) -> None:
    """A parameter that is hidden, and the same one where nothing is, in the model that `add` makes."""
    label = "torque_offset@joint_2"
    chances = {
        hidden: known_parameters(solve(bench.measure(hidden), Structure.build(bench.robot, [label]), "wls"))[label]
        for hidden in ((), (f"{label}:torque_offset=15",))
    }
    there, nothing = chances[(f"{label}:torque_offset=15",)], chances[()]
    assert there.chance < TWO_SIGMA and there.parameters[0].value == pytest.approx(15.0, rel=0.2)
    for found in (there, nothing):
        assert found.least == found.parameters[0]
        assert (found.chance < TWO_SIGMA) == (abs(found.least.value) > 2.0 * found.least.std)
    assert nothing.chance > 1e-3


def test_a_spring_whose_lever_vanishes_is_not_told_from_a_hose(bench: Any) -> None:
    """A hose fitted as a spring: both sizes are known, but the least ratio of lever to distance fits it best."""
    label = "gravity_spring@joint_3"
    measured = bench.measure(("cable@joint_3:cable=40",))
    found = known_parameters(solve(measured, Structure.build(bench.robot, [label]), "wls"))[label]
    assert all(one.value > 10.0 * one.std for one in found.parameters[:2])
    assert (found.least.name, found.chance) == ("gravity_spring.ratio@joint_3", 1.0)


def test_what_few_lines_do_not_tell_from_chance_is_listed(bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A motion whose lines tell nothing from chance: what predicts most is no name, but a reason to record another."""
    monkeypatch.setattr(Search, "stands_out", lambda *_: False)
    found = by_sets(bench, bench.measure((OFFSET,)))
    assert found.verdict == "not_decidable" and not found.missing
    assert (found.others[0].label, found.others[0].probability) == ("torque_offset@joint_1", None)
    assert any(n.startswith("torque_offset@joint_1 may be missing") and "few frequencies" in n for n in found.notes)


@pytest.mark.long
def test_what_is_slow_beside_a_clearance_hides_it_from_nobody(bench: Any) -> None:
    both = ("backlash@joint_1", "torque_offset@joint_1:torque_offset=3")
    found = by_sets(bench, bench.measure(both, noise=1.0))
    assert labels(found) == {"backlash@joint_1", "torque_offset@joint_1"}


def test_a_filter_is_told_from_a_delay_where_reversals_are_resolved(bench: Any, sticking: list[Measurement]) -> None:
    """Joints that stick round the steps of dry friction, as a filter would."""
    for measured, tells in ((bench.measure(()), True), (sticking, False)):
        data = DataSet(Rows.of(measured, bench.structure))
        assert [data.tells_filter(place) for place in (None, *bench.robot.joints)] == 4 * [tells]
        assert tells == any(label.startswith("effort_filter") for label in data.hypotheses)


def test_an_effect_beside_the_one_that_it_contains_has_the_parameters_of_the_rest(bench: Any) -> None:
    offset, cable = (make_effect(f"{name}@joint_1", bench.robot) for name in ("torque_offset", "cable"))
    both = extended(gather(bench.measure((OFFSET,)), bench.structure), [offset, cable])
    (stiffness,) = estimates(both, cable)
    assert stiffness.unit == "Nm/rad" and abs(stiffness.value) < 4.0 * stiffness.std
    (level,) = estimates(both, offset)
    assert level.value == pytest.approx(6.0, abs=0.5)


def test_sets_that_can_not_be_told_apart_are_said(bench: Any) -> None:
    found = replace(by_sets(bench, bench.measure(())), verdict="not_decidable", tied_sets=(("a", "b"), ("c",)))
    assert found.in_words == "not decidable from these recordings: either a and b, or c"


def test_a_recording_that_only_validates_is_a_fold_that_no_fit_sees(bench: Any) -> None:
    training, aside = bench.measure((STRIBECK,)), bench.measure((STRIBECK,), [3])
    data = DataSet(Rows.of(training, bench.structure, aside))
    assert data.training == len(training) and len(data.folds) == len(training) + 1
    assert all(weights[-1] == 0.0 for weights, _ in data.left_out_weights())
    (found,) = by_sets(bench, training, validation=aside).missing
    assert found.label == "stribeck@joint_2"
    assert found.validation_after["joint_2"] < 0.75 * found.validation_before["joint_2"]


@pytest.fixture(scope="module")
def search(bench: Any) -> Search:
    return Search(DataSet(Rows.of(bench.measure((STRIBECK,)), bench.structure)))


def _stacked(data: DataSet, chosen: Sequence[Any], fold: int) -> tuple[Any, Any]:
    """Return base and some hypotheses as rows of all joints in a fold, and the torque."""
    rows = []
    for joint in range(data.n):
        further = [
            data.pools[joint].rows(fold, h.at[joint])
            if joint in h.at
            else np.zeros((len(data.y[joint][fold]), len(h.ranges)))
            for h in chosen
        ]
        rows.append(np.concatenate([data.base[joint][fold], *further], axis=1))
    return np.concatenate(rows), np.concatenate([data.y[joint][fold] for joint in range(data.n)])


def test_gains_are_those_of_fits_done_anew(search: Search) -> None:
    """Held-out and fitted, beside a selected effect, against least squares on all rows with the faint weight."""
    data = search.data
    selected = [data.hypotheses["torque_offset@joint_1"][0]]
    new = data.hypotheses["torque_offset@joint_2"][0]
    given = search.given(selected)
    folds = range(data.training)

    def error(chosen: Sequence[Any], left: int | None) -> float:
        weights = [1.0 if f != left else 0.01 for f in folds]
        parts = [_stacked(data, chosen, f) for f in folds]
        x = np.concatenate([np.sqrt(w) * part for w, (part, _) in zip(weights, parts, strict=True)])
        y = np.concatenate([np.sqrt(w) * part for w, (_, part) in zip(weights, parts, strict=True)])
        size = np.maximum(np.linalg.norm(x, axis=0), 1e-300)
        values = np.linalg.lstsq(x / size, y, rcond=1e-10)[0] / size
        if left is None:
            return float(np.sum((y - x @ values) ** 2))
        rows, torque = parts[left]
        return float(np.sum((torque - rows @ values) ** 2))

    assert given.gain(new) == pytest.approx(error(selected, None) - error([*selected, new], None), rel=1e-5)
    held_out = given.held_out_gain(new).sum(axis=1)
    for left in folds:
        expected = error(selected, left) - error([*selected, new], left)
        assert held_out[left] == pytest.approx(expected, rel=1e-4, abs=1e-3)
    before, after = given.block_losses(), given.block_losses(new)
    falls = [b.sum() - a.sum() for b, a in zip(before, after, strict=True)]
    np.testing.assert_allclose(falls, held_out, rtol=1e-6, atol=1e-6)
    assert given.loss.sum() == pytest.approx(sum(block.sum() for block in before), rel=1e-9)


def test_the_best_values_of_a_grid_are_those_of_all(search: Search) -> None:
    """Bounds spare most of the gains, and change none of the best."""
    given = search.given([search.data.hypotheses["torque_offset@joint_1"][0]])
    for h in search.best_values(given):
        every = [given.gain(one) - 2.0 * one.effect.size for one in search.data.hypotheses[h.label]]
        assert given.gain(h) - 2.0 * h.effect.size == pytest.approx(max(every), rel=1e-6, abs=1e-6)


def test_one_recording_is_whitened_as_a_whole_and_cut(bench: Any, sticking: list[Measurement]) -> None:
    """Its parts hold each row once; blocks of half a second are those of the recording, but for the cuts."""
    rows = Rows.of(sticking[:1], bench.structure)
    (whole,) = whitened(gather(sticking[:1], bench.structure)).trajectories
    assert whole.whitening is not None
    tested = rows.tested.trajectories
    np.testing.assert_allclose(sum(t.y for t in tested), whole.y)
    assert sum(np.count_nonzero(np.any(t.y != 0.0, axis=1)) for t in tested) == np.count_nonzero(whole.y.any(axis=1))
    data = DataSet(rows)
    assert [len(y) for y in data.y[0]] == [len(t.y[t.rows]) for t in data.folds]
    assert sum(len(y) for y in data.y[0]) == len(whole.y)
    seconds = len(whole.y) * whole.measured.dt
    assert seconds / 0.5 <= data.block_count <= seconds / 0.5 + len(data.folds)


def test_the_error_of_a_size_is_that_of_its_blocks(search: Search) -> None:
    """Held-out torque of an effect against what is left with it, every half second for itself, fitted anew."""
    data = search.data
    new = max(data.hypotheses["stribeck@joint_2"], key=search.given([]).gain)
    folds = range(data.training)

    def values(chosen: Sequence[Any], left: int) -> Any:
        parts = [(np.sqrt(0.01 if f == left else 1.0), *_stacked(data, chosen, f)) for f in folds]
        x, y = (np.concatenate([w * part[k] for w, *part in parts]) for k in (0, 1))
        size = np.maximum(np.linalg.norm(x, axis=0), 1e-300)
        return np.linalg.lstsq(x / size, y, rcond=1e-10)[0] / size

    size, spread = 0.0, 0.0
    for left in folds:
        (x0, y), (x1, _) = _stacked(data, [], left), _stacked(data, [new], left)
        before, after = y - x0 @ values([], left), y - x1 @ values([new], left)
        size += before @ (before - after)
        spread += np.sum(np.bincount(np.tile(data.blocks[left], data.n), after * (before - after)) ** 2)
    assert search.given([]).size_error(new) == pytest.approx(np.sqrt(spread) / size, rel=1e-4)


def test_the_best_pair_by_the_score_test_is_the_best_of_all_pairs(search: Search) -> None:
    given = search.given(())
    names = ["torque_offset@joint_2", "stribeck@joint_2", "cable@joint_2", "viscous_asymmetric@joint_2"]
    for label in list(search.data.hypotheses):
        if label not in names:
            search.barred.add(label)
    found = search.pairs((), 1, 1)
    search.barred.clear()
    every = [
        given.gain(a, b)
        for k, first in enumerate(names)
        for second in names[:k]
        for a in search.data.hypotheses.get(first, [])
        for b in search.data.hypotheses.get(second, [])
        if not a.excludes(b)
    ]
    assert "stribeck@joint_2" in {found[0][1].label, found[0][2].label}
    assert given.gain(*found[0][1:]) > 0.98 * max(every)


def test_a_likeness_changes_with_what_it_does_not_depend_on(bench: Any) -> None:
    """An offset of joint 1 that is there on one side of joint 3 alone; one that is there everywhere stays the same."""

    def worst(measurements: Sequence[Measurement]) -> float:
        data = DataSet(Rows.of(measurements, bench.structure))
        search = Search(data)
        offset = data.hypotheses["torque_offset@joint_1"][0]
        gain = search.given(()).held_out_gain(offset).sum()
        return max(split.more for split in splits(search.given(()), offset)) / gain

    def one_sided(measured: Measurement) -> Measurement:
        side = measured.motion.q[:, 2] > np.median(measured.motion.q[:, 2])
        return replace(measured, torque=measured.torque + np.outer(20.0 * side, [1.0, 0.0, 0.0]))

    assert worst(bench.measure((OFFSET,))) < 0.05
    assert worst([one_sided(measured) for measured in bench.measure(())]) > 0.5


def test_rows_near_reversals_are_those_that_a_dense_search_finds(bench: Any) -> None:
    (measured,) = bench.measure((), [0])
    near = near_reversals(measured)
    assert measured.position_lines is not None and measured.base_frequency is not None
    motion, period = measured.motion, 1.0 / measured.base_frequency
    t = np.arange(motion.samples) * measured.dt
    for joint in range(3):
        fastest = np.flatnonzero(measured.position_lines[:, joint]).max() * measured.base_frequency
        sign = np.sign(motion.dq[:, joint])
        turns = t[sign != np.roll(sign, 1)]
        apart = np.abs((t[:, None] - turns + period / 2) % period - period / 2).min(axis=1)
        np.testing.assert_array_equal(near[:, joint], apart <= 0.5 / fastest + 1e-9)
    inertia = np.full((motion.samples, 3, 3), 1e9)
    assert unresolved_rows(measured, 0.0 * inertia, np.ones(3)).mean() < 0.01, "noise hides next to nothing here"
    np.testing.assert_array_equal(unresolved_rows(measured, inertia, np.ones(3)).all(axis=1), near.any(axis=1))


def test_a_jump_of_acceleration_that_noise_hides_is_as_large_as_its_lines_say(bench: Any) -> None:
    """Of a sawtooth of acceleration, the line beyond the fastest known one is as large as one that noise hides."""
    (measured,) = bench.measure((), [0])
    within, hidden = resolution(measured)
    base, samples = measured.base_frequency, 4096
    for joint in range(3):
        sawtooth = hidden[joint] * (np.arange(samples) / samples - 0.5)
        number = round(0.5 / within[joint] / base)
        line = 2.0 / samples * np.abs(np.fft.rfft(sawtooth)[number]) / (2.0 * np.pi * number * base) ** 2
        lines = np.zeros((len(measured.position_lines), 2), dtype=complex)
        lines[number] = 0.99 * line, 1.01 * line
        variance = np.full(2, measured.averaged_position_variance[joint])
        assert above_noise(lines, variance, measured.motion.samples)[number].tolist() == [False, True]


@pytest.mark.parametrize("hides", [1e24, 0.0])
def test_a_joint_that_is_not_seen_gives_way_to_those_that_shake_it(bench: Any, hides: float) -> None:
    """Without a drive its torque would be none: what noise lets it hide of that, lines of the torque may lack."""
    (measured,) = bench.measure((), [0])
    share = np.ones_like(measured.line_share)
    share[:, 2] = 0.0
    free = replace(measured, line_share=share, averaged_position_variance=hides * measured.averaged_position_variance)
    evidence = gather([free], bench.structure)
    ((t,), (torques,)) = evidence.trajectories, evidence.torques
    seen, lost = with_unseen_reactions(t, None, torques)
    inertia, ddq = torques.rigid.inertia, measured.motion.ddq
    asked = inertia[:, 2, 0] * ddq[:, 0] + inertia[:, 2, 1] * ddq[:, 1]
    given = asked / inertia[:, 2, 2]
    missing = inertia[:, :, 2] * (given - given.mean())[:, None]  # noise hides no lasting acceleration
    if not hides:
        assert lost.max() < 1e-9
        return
    power = np.abs(np.fft.rfft(missing, axis=0)) ** 2 / (len(asked) * measured.averaged_variance)
    strong = power > 10.0 * np.median(power, axis=0)
    wide = np.array([np.convolve(column, np.full(5, 0.2), mode="same") for column in power.T]).T
    found = seen.whitening**-2.0 - 1.0
    np.testing.assert_allclose(found[5:-5][strong[5:-5]], wide[5:-5][strong[5:-5]], rtol=1e-6, atol=1e-10)
    assert lost.min() > 0.0
    every = replace(free, line_share=np.ones_like(share))
    (known,) = gather([every], bench.structure).trajectories
    assert not with_unseen_reactions(known, None, torques)[1].any()


def one_pass(bench: Any, effects: Sequence[str], motions: Sequence[int]) -> list[Measurement]:
    """Recordings that do not tell their noise."""
    processing = Processing(periodic=False, low_pass=10.0)
    return [process(bench.record(effects, k), bench.robot, processing) for k in motions]


@pytest.mark.long
def test_recordings_that_do_not_tell_their_noise_are_searched_alike(bench: Any) -> None:
    pair = ("torque_offset@joint_1:torque_offset=20", STRIBECK)
    training, unseen = one_pass(bench, pair, (0, 1, 2)), one_pass(bench, pair, (3,))
    found = by_sets(bench, training, validation=unseen)
    assert labels(found) == {"torque_offset@joint_1", "stribeck@joint_2"}
    for one in found.missing:
        assert one.probability is not None and one.probability >= 0.8
        assert one.validation_before is not None and one.validation_after is not None
        assert sum(one.validation_after.values()) < sum(one.validation_before.values())


@pytest.mark.long
def test_without_a_noise_floor_what_acts_besides_withholds_no_name(bench: Any) -> None:
    """A drag that grows as joint 3 stretches follows its position as the parts of the named friction would."""
    measured = one_pass(bench, ("viscous_nonlinear@joint_2:viscous_nonlinear=25",), (0, 1, 2))
    dragged = [
        replace(one, torque=one.torque + np.outer(3.0 * one.motion.q[:, 2] * np.sign(one.motion.dq[:, 1]), [0, 1, 0]))
        for one in measured
    ]
    assert "viscous_nonlinear@joint_2" in labels(by_sets(bench, dragged))


@pytest.mark.long
def test_without_a_noise_floor_a_torque_that_turns_round_at_rest_is_no_friction_of_speed(bench: Any) -> None:
    """Where joint 2 sticks, dry friction goes from one side to the other over tens of milliseconds: a curve that bends
    near zero speed follows it there, and explains nothing elsewhere.
    """
    measured = []
    for one in one_pass(bench, (), (0, 1, 2)):
        sign = np.sign(one.motion.dq[:, 1])
        late = np.convolve(np.pad(sign, 20, mode="edge"), np.full(41, 1.0 / 41.0), "valid")
        near = near_reversals(one)[:, 1]
        measured.append(replace(one, torque=one.torque + np.outer(20.0 * near * (late - sign), [0, 1, 0])))
    search = Search(DataSet(Rows.of(measured, bench.structure)))
    given = search.given(())
    best = max(search.data.hypotheses["viscous_nonlinear@joint_2"], key=given.gain)
    search.weigh_by(())
    assert search.share(best, ()) > 0.2
    assert not search.predicts(best, ())
    assert not labels(by_sets(bench, measured)) & {"viscous_nonlinear@joint_2", "stribeck@joint_2"}


def smeared(bench: Any, effect: str, noise: float) -> Measurement:
    """A short recording whose low pass smears reversals."""
    recording = bench.record((effect,), 0, noise=noise)
    short = recording[: int(13.0 / np.median(np.diff(recording.t)))]
    return process(short, bench.robot, Processing(periodic=False, low_pass=3.0))


@pytest.mark.long
def test_friction_behind_a_play_is_named_only_where_chance_does_not_prefer_it(bench: Any) -> None:
    """A play fits a way to sliding as well as that; a wide gap shows."""

    def both(effect: str, noise: float) -> tuple[Search, Hypothesis, Hypothesis]:
        search = Search(DataSet(Rows.of([smeared(bench, effect, noise)], bench.structure, ())))
        given, found = search.given(()), []
        for name in ("presliding", "friction_behind_play"):
            best = max(search.data.hypotheses[f"{name}@joint_3"], key=given.gain)
            found.append(search.refinement.of(given, best))
        search.weigh_by(found[1:])
        return search, *found

    for reach in (0.002, 0.004, 0.008):
        search, usual, gapped = both(f"presliding@joint_3:reach={reach}", 1.0)
        assert not search.tells_apart([gapped], [usual])
        assert not search.tells_apart([usual], [usual])
    search, usual, gapped = both("friction_behind_play@joint_3:level=20,gap=0.05,reach=0.001", 0.1)
    assert search.tells_apart([gapped], [usual]) and not search.tells_apart([usual], [gapped])


def test_two_parameters_of_which_only_the_product_is_known_are_not_zero(bench: Any) -> None:
    found = by_sets(bench, [smeared(bench, "presliding@joint_3:reach=0.0015", 0.6)])
    assert labels(found) == {"presliding@joint_3"}
    (way,) = (one for one in found.missing[0].parameters if one.name.startswith("presliding.x0"))
    assert way.std < way.value < 2.0 * way.std


def test_without_a_noise_floor_a_size_is_known_as_well_before_it_is_selected_as_after(
    bench: Any,
) -> None:
    """A joint weighs little while an effect is missing from it."""
    recording = bench.record(("viscous_asymmetric@joint_1:viscous_asymmetric=30",), 0)
    short = recording[: int(14.0 / np.median(np.diff(recording.t)))]
    measured = process(short, bench.robot, Processing(periodic=False, low_pass=10.0))
    search = Search(DataSet(Rows.of([measured], bench.structure, ())))
    (effect,) = search.data.hypotheses["viscous_asymmetric@joint_1"]
    search.weigh_by(())
    first, as_weighed = search.size_error_of(effect, ()), search.given(()).size_error(effect)
    search.weigh_by((effect,))
    assert search.size_error_of(effect, ()) == pytest.approx(first, rel=0.05)
    assert as_weighed > 1.3 * first


@pytest.mark.long
def test_without_a_noise_floor_nothing_is_called_adequate(bench: Any) -> None:
    found = by_sets(bench, one_pass(bench, (), (0, 1, 2)))
    assert found.verdict in ("not_decidable", "unexplained") and found.missing == ()
    assert "the noise is unknown" in found.notes[0]


def test_an_end_stop_that_the_first_motion_does_not_reach(bench: Any) -> None:
    measured, start = bench.measure((), (2, 1, 0)), 0.95
    reached = [float(one.motion.q[:, 0].max()) for one in measured]
    assert reached[0] < start - 0.2 and min(reached[1:]) > start + 0.1
    pressed = []
    for one in measured:
        torque = np.zeros_like(one.torque)
        torque[:, 0] = 600.0 * np.maximum(0.0, one.motion.q[:, 0] - start)
        pressed.append(replace(one, torque=one.torque + torque))
    assert labels(by_sets(bench, pressed)) == {"end_stop@joint_1"}


def _scaled(measured: Measurement, scales: Sequence[float], structure: Structure, values: np.ndarray) -> Measurement:
    """What drives report whose links' torque arrives in other scales."""
    links = structure.rigid_columns(measured.motion) @ values[: len(structure.base.columns)]
    return replace(measured, torque=measured.torque + (np.asarray(scales) - 1.0) * links)


SCALES = (1.0, 1.2, 0.85)


@pytest.fixture
def scaled(bench: Any) -> tuple[list[Measurement], Any]:
    """Recordings of a robot two of whose joints report in other scales, and its model."""
    plain = bench.structure
    measured = [_scaled(one, SCALES, plain, plain.true_values()) for one in bench.measure((STRIBECK,))]
    structure = plain.with_further(["torque_scale@joint_2", "torque_scale@joint_3"])
    return measured, solve(measured, structure, "wls")


def test_a_model_with_torque_scales_leaves_of_its_recordings_what_its_fit_left(scaled: Any) -> None:
    measured, solution = scaled
    structure, linear = solution.structure, solution.values[: len(solution.structure.names)]
    assert structure.scales == pytest.approx(SCALES, rel=0.02)
    evidence = gather(measured, structure)
    for t, left in zip(evidence.trajectories, evidence.newton, strict=True):
        rows = t.weight > 0
        fitted = t.measured.torque - structure.columns(t.motion, linear) @ linear
        assert np.allclose(left[rows], fitted[t.measured.rows][rows], atol=0.2)


def test_torque_scales_stay_free_in_the_search(scaled: Any) -> None:
    measured, solution = scaled
    off = solution.structure.with_settings([1.03 * s for s in solution.structure.settings])
    data = DataSet(Rows.of(measured, off), [make_effect("stribeck@joint_2", off.robot)])
    search = Search(data)
    (stribeck,) = [h for h in search.best_values(search.given(())) if h.label == "stribeck@joint_2"]
    left = search.given((stribeck,)).loss.sum() / data.dof.sum()
    assert left < 2.0, "scales that are three per cent off would leave much more, were they fixed"


def test_an_effect_among_torque_scales_gets_its_name(scaled: Any) -> None:
    measured, solution = scaled
    assert labels(diagnose(measured, solution.structure)) == {"stribeck@joint_2"}


def test_friction_that_differs_between_directions_does_not_change_with_the_direction(bench: Any) -> None:
    effect = make_effect("viscous_asymmetric@joint_2", bench.robot)
    data = DataSet(Rows.of(bench.measure((STRIBECK,)), bench.structure), [effect])
    search = Search(data)
    (settings,) = data.hypotheses.values()
    words = {split.words for split in splits(search.given(()), settings[0])}
    assert "with the direction of joint_1" in words
    assert "with the direction of joint_2" not in words, "viscous friction holds the half of it"


@pytest.mark.long
def test_an_offset_of_the_model_hides_nothing_by_its_formula(bench: Any) -> None:
    measured = bench.measure(("torque_offset@joint_1:torque_offset=60", "load_friction@joint_1:load_friction=0.02"))
    structure = bench.structure.with_further(["torque_offset@joint_1"])
    data = DataSet(Rows.of(measured, structure), [])
    assert data.known_errors == {}
    assert labels(diagnose(measured, structure)) == {"load_friction@joint_1"}


def test_what_may_stand_in_the_place_of_an_effect_acts_on_its_joints(kuka: Robot) -> None:
    spring = Hypothesis(make_effect("gravity_spring@joint_2", kuka), {1: np.array([0])}, ((-np.inf, np.inf),))
    shares = {("gravity_spring@joint_2",): 0.6, ("cable@joint_2", "torque_offset@joint_3"): 0.4}
    joints = {"gravity_spring@joint_2": {1}, "cable@joint_2": {1}, "torque_offset@joint_3": {2}}
    election = Election((spring,), shares, shares, joints={label: frozenset(at) for label, at in joints.items()})
    assert election.instead_of(spring.label) == {"cable@joint_2"}
