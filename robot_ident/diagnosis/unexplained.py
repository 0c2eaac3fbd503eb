"""What a residual depends on when no known effect explains it: curves over a variable, judged on other motion, and
shapes that no effect of the catalogue has.

Of several wrong names one is always the best, and on unseen motion it may explain half of what is missing. A cause that
is not in the catalogue still follows something: a product of two joints' speeds, a curve over a position. Such plain
columns are rivals of every name that leaves much unexplained; they get none themselves, but are told in words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import combinations

import numpy as np

from robot_ident.diagnosis.candidates import Candidate, Score, score
from robot_ident.diagnosis.curves import Variable, held_out_share, own, variables
from robot_ident.diagnosis.diagnosis import EVERYWHERE, Unexplained
from robot_ident.diagnosis.evidence import Evidence
from robot_ident.diagnosis.refine import refined
from robot_ident.diagnosis.regions import Region, densest
from robot_ident.diagnosis.scan import columns_of
from robot_ident.diagnosis.stage import GAIN, Stage
from robot_ident.diagnosis.ties import block_losses, significant
from robot_ident.effects.effect import Coefficient, Effect, Torques
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

_MOVING = ("velocity", "speed", "time_since_reversal")  # variables that are zero as the joint reverses
_MOST = 0.5  # of the excess, that sits there
_SLOW = 0.02  # rad/s or m/s: slower than this a joint may stick
_OTHERS = 0.02  # of the error that another joint's motion must explain to be listed


def explain_by_variables(evidence: Evidence, joint: int, *, floor: bool = True) -> Unexplained:
    """Return which variable predicts a joint's residual on trajectories left out, and where along it the error sits.

    floor: whether the weights of the evidence are the noise's, so that only what exceeds it counts.
    """
    robot = evidence.structure.robot
    residual = [r[:, joint] for r in evidence.residual]
    used = [t.weight[:, joint] > 0 for t in evidence.trajectories]
    dof = float(sum(t.dof[joint] for t in evidence.trajectories)) if floor else 0.0
    excess = max(sum(float(np.sum(r**2)) for r in residual) - dof, 1e-12)
    seen = _along(evidence, joint)
    names = [name for name in seen[0] if all(name in one for one in seen)]
    shares = {name: held_out_share([one[name] for one in seen], residual, used, excess) for name in names}
    level = [
        float(t.dof[joint]) / max(1, int(u.sum())) if floor else 0.0
        for t, u in zip(evidence.trajectories, used, strict=True)
    ]
    region = _densest(seen, shares, residual, used, level)
    listed = own(shares, _OTHERS)
    where = EVERYWHERE if region is None else region.in_words(robot, joint)
    return Unexplained(robot.joints[joint], listed, where, region is not None and _around_reversals(region))


def _around_reversals(region: Region) -> bool:
    return region.what in _MOVING and region.lower <= 0.0 <= region.upper and region.share >= _MOST


def stiction_note(found: Unexplained, evidence: Evidence) -> list[str]:
    """Return how to leave out the rows near rest, where what remains follows a joint's reversals and they are used.

    A joint that sticks rests on an undetermined torque, and breaks away with a jerk that noise hides.
    """
    joint = evidence.structure.robot.joint_index(found.joint)
    first = max(found.depends_on, key=lambda name: found.depends_on[name])
    speeds = [np.abs(t.motion.dq[t.measured.rows, joint])[t.weight[:, joint] > 0] for t in evidence.trajectories]
    slow = any(np.any(speed < _SLOW) for speed in speeds)
    follows = first == "time_since_reversal" and found.depends_on[first] > 0.0
    if not slow or not (follows or found.around_reversals):
        return []
    return [
        f"what remains of {found.joint} follows its reversals; where it sticks there, no model tells its torque, and"
        f" steps of friction fall between two samples: identify with --minimum-speed {_SLOW:g} (rad/s or m/s) and"
        " diagnose again, or record at a higher rate"
    ]


def _along(evidence: Evidence, joint: int) -> list[dict[str, Variable]]:
    """Return the variables of every trajectory on its rows, computed once for all parts of one measurement."""
    known: dict[int, dict[str, Variable]] = {}
    for t in evidence.trajectories:
        if id(t.measured) not in known:
            found = variables(evidence.structure, evidence.values, t.motion, joint)
            known[id(t.measured)] = {name: variable[t.measured.rows] for name, variable in found.items()}
    return [known[id(t.measured)] for t in evidence.trajectories]


def _densest(
    seen: Sequence[Mapping[str, Variable]],
    shares: Mapping[str, float],
    residual: Sequence[np.ndarray],
    used: Sequence[np.ndarray],
    level: Sequence[float],
) -> Region | None:
    """Return the region that holds most error beyond its share of the time, along the variables that explain most."""
    squared = [r**2 for r in residual]
    ranked = sorted((name for name in shares if not name.endswith("_and_direction")), key=lambda name: -shares[name])
    for name in ranked:
        region = densest(name, [one[name].signed(name) for one in seen], squared, used, level)
        if region is not None:
            return region
    return None


ENOUGH = 0.8  # of its joint's excess that an effect explains: no shape is asked any more
MORE = 0.15  # of the excess that a shape must explain beyond it
_CLOSER = 0.5  # of what a spring leaves, that another curve over position must hold to be told
BROAD = 0.7  # of the excess, explained, from which on nothing broad is asked, either

_DEGREES = range(2, 8)  # of the polynomials of a curve: what is constant or a spring has names
_WAVES = range(3, 13)  # to a turn: fewer are springs, weights and cams that have names
_KNOTS = 16  # of a curve with corners, over all positions that the motions reach

Course = Callable[[Motion, Torques | None], Array]
"""The columns [N, k] of a shape along a motion with the model's torques."""


class Shape(Effect):
    """Columns at a joint by a formula of the motion alone; `words`: what they follow, for the user.

    broad: it may hold several small things beside a named one, and is no rival of what explains much.
    """

    name = "shape"
    candidate = False

    def __init__(
        self, robot: Robot, joint: int, words: str, course: Course, count: int = 1, *, broad: bool = False
    ) -> None:
        """Place a formula of `count` columns at a joint."""
        super().__init__(robot, joint)
        self.words = words
        self.broad = broad
        self.course = course
        self.coefficients = tuple(Coefficient(f"c{k}", "Nm", "N") for k in range(count))

    def columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return them [N, n, k]."""
        out = np.zeros((motion.samples, self.robot.n, len(self.coefficients)))
        out[:, self.joint] = self.course(motion, torques)
        return out


def doubted(members: Sequence[Score], first: Stage, last: Stage) -> dict[str, str]:
    """Return why members of a model are not to be named, by their label.

    first, last: the stage of the model as it was given, and with all members.
    """
    out = {}
    for member in members:
        joint = member.effect.joint
        left = float(last.excess[joint]) / max(float(first.excess[joint]), 1e-300)
        if not member.effect.whole and left > 1.0 - ENOUGH:
            words = _doubt(member, _without([member], members, first))
            if words:
                out[member.label] = words
    for joint in {m.effect.joint for m in members}:
        group = [m for m in members if m.effect.over_position and m.effect.joint == joint and m.label not in out]
        if len(group) > 1:
            out |= _one_curve(group, _without(group, members, first), last)
    return out


def _without(some: Sequence[Score], members: Sequence[Score], first: Stage) -> Stage:
    """Return the stage with all members but some."""
    labels = {m.label for m in some}
    fellows = [m.effect for m in members if m.label not in labels]
    return first.under(first.evidence, fellows) if fellows else first


def _doubt(member: Score, stage: Stage) -> str | None:
    """Return in words which shape predicts far better than a member, None where none does."""
    found = next((s for s in stage.scores if s.label == member.label), None)
    joint, evidence, folds = member.effect.joint, stage.evidence, stage.folds
    excess = float(stage.excess[joint])
    if found is None or excess <= 0.0:
        return None
    mine = refined(found, evidence, folds)
    if mine.held_out_by_joint[joint] >= ENOUGH * excess:
        return None
    much = mine.held_out_by_joint[joint] >= BROAD * excess
    robot = evidence.structure.robot
    tried = [shape for shape in shapes(robot, joint, _reach(joint, stage)) if not (much and shape.broad)]
    rivals = [_scored(shape, stage) for shape in tried]
    best = max(rivals, key=lambda s: s.held_out)
    if best.held_out - mine.held_out < MORE * excess:
        return None
    if not significant(block_losses(mine, evidence, folds) - block_losses(best, evidence, folds)):
        return None
    assert isinstance(best.effect, Shape)
    shares = (100.0 * float(np.clip(s.held_out_by_joint[joint] / excess, 0.0, 1.0)) for s in (mine, best))
    return (
        f"{member.label} gets no name: it predicts {next(shares):.0f} % of what {robot.joints[joint]} lacks,"
        f" {best.effect.words} {next(shares):.0f} %, and no effect of the catalogue is that"
    )


def _one_curve(group: Sequence[Score], stage: Stage, last: Stage) -> dict[str, str]:
    """Return why several springs of one joint get no names, by their label: where one curve over its position predicts
    as well, their number tells of a curve that no spring has. What explains nearly all alone keeps its name.

    stage: that without them, last: with them.
    """
    joint, robot = group[0].effect.joint, stage.evidence.structure.robot
    curve, excess = _scored(_cornered(robot, joint, _reach(joint, stage)), stage), float(stage.excess[joint])
    theirs, its = float(last.excess[joint]), max(excess - float(curve.held_out_by_joint[joint]), 0.0)
    if its - theirs >= GAIN:
        return {}
    labels = [m.label for m in group]
    alone = [refined(s, stage.evidence, stage.folds) for s in stage.scores if s.label in labels]
    kept = [s.label for s in alone if s.held_out_by_joint[joint] >= ENOUGH * excess][:1]
    assert isinstance(curve.effect, Shape)
    left = [100.0 * x / max(excess, 1e-300) for x in (theirs, its)]
    nameless = [label for label in labels if label not in kept]
    words = (
        f"{' and '.join(nameless)} {'gets' if kept else 'get'} no name: {' and '.join(labels)} leave {left[0]:.1f} % of"
        f" what {robot.joints[joint]} lacks, {curve.effect.words} {left[1]:.1f} %"
    )
    return {label: words for label in nameless}


def of_another_form(members: Sequence[Score], first: Stage, last: Stage) -> list[str]:
    """Return a line on each named spring whose joint still lacks something that another curve over its position holds.

    The name stays: it explains most. But its values then are those of the nearest straight line or sine.
    """
    out = []
    for member in members:
        joint = member.effect.joint
        if not member.effect.over_position or not last.fits[joint].fails:
            continue
        stage = _without([member], members, first)
        mine = next((refined(s, stage.evidence, stage.folds) for s in stage.scores if s.label == member.label), None)
        if mine is None:
            continue
        excess, robot = float(stage.excess[joint]), stage.evidence.structure.robot
        best = max((_scored(s, stage) for s in _curves(robot, joint, _reach(joint, stage))), key=lambda s: s.held_out)
        theirs, its = (float(s.held_out_by_joint[joint]) for s in (mine, best))
        behind = block_losses(mine, stage.evidence, stage.folds) - block_losses(best, stage.evidence, stage.folds)
        if its - theirs < max(GAIN, _CLOSER * (excess - theirs)) or not significant(behind):
            continue
        assert isinstance(best.effect, Shape)
        shares = [100.0 * float(np.clip(share / excess, 0.0, 1.0)) for share in (theirs, its)]
        out.append(
            f"{member.label} predicts {shares[0]:.0f} % of what {robot.joints[joint]} lacks, {best.effect.words}"
            f" {shares[1]:.0f} %: what is there is static in q, but of another form"
        )
    return out


def _scored(shape: Shape, stage: Stage) -> Score:
    columns = columns_of(shape, stage.evidence, stage.evidence.torques)
    return score(Candidate(shape.words, (columns,)), stage.evidence, stage.folds)


def _reach(joint: int, stage: Stage) -> tuple[float, float]:
    """Return the least and the largest position of a joint in all recordings."""
    paths = [t.motion.q[:, joint] for t in stage.evidence.trajectories]
    return min(float(q.min()) for q in paths), max(float(q.max()) for q in paths)


def shapes(robot: Robot, joint: int, reach: tuple[float, float]) -> Iterator[Shape]:
    """Return the shapes that are tried at a joint; reach: least and largest of its positions."""
    names, j = robot.joints, joint
    mine = names[j]
    yield from _curves(robot, j, reach)
    for times in _WAVES:
        wave = f"its torque * {_words(mine, times)}"
        yield Shape(robot, j, wave, partial(_wave, joint=j, times=times, loaded=True), 2)
    for a, b in combinations(range(robot.n), 2):
        yield Shape(robot, j, f"dq of {names[a]} * dq of {names[b]}", partial(_product, a=a, b=b))
        yield Shape(robot, j, f"q of {names[a]} * q of {names[b]}", partial(_positions, a=a, b=b))
    for o in (o for o in range(robot.n) if o != j):
        other = names[o]
        yield Shape(robot, j, f"dq of {mine} * |dq of {other}|", partial(_rubbing, a=j, b=o))
        yield Shape(robot, j, f"dq of {other} * |dq of {mine}|", partial(_rubbing, a=o, b=j))
        yield Shape(robot, j, f"dq of {other}, squared", partial(_product, a=o, b=o))
        yield Shape(robot, j, f"dq of {other} * its size", partial(_rubbing, a=o, b=o))
        yield Shape(robot, j, f"dq of {mine} * q of {other}", partial(_leaning, a=j, b=o))
        yield Shape(robot, j, f"a curve over q of {other}", partial(_curve, joint=o), len(_DEGREES))


def _curves(robot: Robot, joint: int, reach: tuple[float, float]) -> Iterator[Shape]:
    """Return the shapes over a joint's own position alone."""
    mine = robot.joints[joint]
    yield Shape(robot, joint, f"a curve over q of {mine}", partial(_curve, joint=joint), len(_DEGREES))
    yield _cornered(robot, joint, reach)
    for times in _WAVES:
        yield Shape(robot, joint, _words(mine, times), partial(_wave, joint=joint, times=times, loaded=False), 2)


def _words(joint: str, times: int) -> str:
    return f"a wave over q of {joint}, {times} a turn"


def _cornered(robot: Robot, joint: int, reach: tuple[float, float]) -> Shape:
    """Return any curve over a joint's position, as straight pieces between places as far apart as each other."""
    knots = np.linspace(*reach, _KNOTS)
    words = f"a curve with corners over q of {robot.joints[joint]}"
    return Shape(robot, joint, words, partial(_pieces, joint=joint, knots=knots), len(knots), broad=True)


def _product(motion: Motion, torques: Torques | None, *, a: int, b: int) -> Array:
    return motion.dq[:, [a]] * motion.dq[:, [b]]


def _rubbing(motion: Motion, torques: Torques | None, *, a: int, b: int) -> Array:
    return motion.dq[:, [a]] * np.abs(motion.dq[:, [b]])


def _positions(motion: Motion, torques: Torques | None, *, a: int, b: int) -> Array:
    return motion.q[:, [a]] * motion.q[:, [b]]


def _leaning(motion: Motion, torques: Torques | None, *, a: int, b: int) -> Array:
    return motion.dq[:, [a]] * motion.q[:, [b]]


def _wave(motion: Motion, torques: Torques | None, *, joint: int, times: int, loaded: bool) -> Array:
    """Return cos and sin of so many turns a turn of the joint [N, 2], over its torque where loaded."""
    turns = times * motion.q[:, joint]
    size = torques.total[:, joint] if loaded and torques is not None else np.ones(motion.samples)
    return np.stack([size * np.cos(turns), size * np.sin(turns)], axis=1)


def _curve(motion: Motion, torques: Torques | None, *, joint: int) -> Array:
    """Return Chebyshev's polynomials of a position in half turns [N, k]."""
    x = np.clip(motion.q[:, joint] / np.pi, -1.0, 1.0)
    return np.stack([np.cos(degree * np.arccos(x)) for degree in _DEGREES], axis=1)


def _pieces(motion: Motion, torques: Torques | None, *, joint: int, knots: Array) -> Array:
    """Return the straight pieces [N, k] of a curve with corners at knots [k]."""
    return np.stack([np.interp(motion.q[:, joint], knots, one) for one in np.eye(len(knots))], axis=1)
