"""The whole paper: its motions, its robots, and every section once, computed where it is first asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from robot_ident.paper.excitation import Excitations, excitations
from robot_ident.paper.friction import Friction, RealRobot, friction
from robot_ident.paper.measuring import MeasuringChain, measuring_chain
from robot_ident.paper.missing import Missing, missing
from robot_ident.paper.robots import robot_of_section_v, simulated_robot, table_i
from robot_ident.provenance import config_file
from robot_ident.robot.robot import Robot
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.point_to_point import PointToPoint, load_motion

if TYPE_CHECKING:
    from robot_ident.testbed.redesign import Redesigned

SECTIONS = (1, 2, 3, 4, 5, 6)
SPRING_FLOOR = -50.0
"""log10 of the determinant that the c1-optimal trajectory of section V may not exceed: the condition number alone is
lowest for slow motions, which tell little.
"""

_STARTS, _QUICK_STARTS = 4, 1
_BOUND, _QUICK_BOUND = 60.0, 8.0  # s
_DRAWS, _QUICK_DRAWS = 30, 6


@dataclass(frozen=True)
class Study:
    """What is computed: seed of all noise and drawn motions, quick or whole, the trajectories that ship with the
    package or designed anew, Table I as it is printed or made physically possible.
    """

    seed: int = 0
    quick: bool = False
    redesigned: bool = False
    printed_table: bool = False
    tell: Callable[[str], None] = lambda what: None

    @cached_property
    def robot(self) -> Robot:
        """The robot of sections I to IV."""
        return simulated_robot(self.printed_table)

    @cached_property
    def motions(self) -> Mapping[str, Excitation]:
        """The c1- (`condition`) and c2-optimal (`d-optimal`) trajectories of section IV."""
        if not self.redesigned:
            return {c: _shipped(name) for c, name in (("condition", "c1"), ("d-optimal", "c2"))}
        return {criterion: self._designed(self.robot, criterion) for criterion in ("condition", "d-optimal")}

    @cached_property
    def spring_motions(self) -> Mapping[str, Excitation]:
        """Those of section V, with the spring and torque offsets among the parameters."""
        if not self.redesigned:
            return {c: _shipped(name) for c, name in (("condition", "c1_spring"), ("d-optimal", "c2_spring"))}
        robot = robot_of_section_v()
        return {
            "condition": self._designed(robot, "condition", SPRING_FLOOR),
            "d-optimal": self._designed(robot, "d-optimal"),
        }

    @cached_property
    def slow_motion(self) -> Excitation:
        """The c1-optimal trajectory of section V without a floor for the determinant but that of random motions."""
        return self._designed(robot_of_section_v(), "condition") if self.redesigned else _shipped("c1_spring_alone")

    @cached_property
    def validation(self) -> PointToPoint:
        """The 20 points of section V-C."""
        from robot_ident.planning.validation_motion import validation_motion

        if self.redesigned:
            return validation_motion(robot_of_section_v(), seed=self.seed)
        motion = load_motion(str(config_file("paper", "validation.yaml")))
        assert isinstance(motion, PointToPoint)
        return motion

    @cached_property
    def excitations(self) -> Excitations:
        """Section IV."""
        self.tell("section IV: both optimal trajectories, 200 runs of the estimator on each, the bound")
        limit = _QUICK_BOUND if self.quick else _BOUND
        return excitations(self.robot, self.motions, seed=self.seed, bound_seconds=limit)

    @cached_property
    def redesign(self) -> Redesigned:
        """Section III-B: the iteration with the Cramer-Rao bound, from the c1-optimal trajectory on."""
        from robot_ident.testbed.redesign import redesign

        self.tell("section III-B: measure, estimate, design by the Cramer-Rao bound, until sigma no longer falls")
        starts = _QUICK_STARTS if self.quick else _STARTS
        return redesign(self.robot, first=self.motions["condition"], starts=starts, seed=self.seed)

    @cached_property
    def measuring(self) -> MeasuringChain:
        """Section V-A."""
        self.tell("section V-A: the anti-alias filter identified and undone")
        return measuring_chain(robot_of_section_v(), self.spring_motions["d-optimal"], seed=self.seed)

    @cached_property
    def real(self) -> RealRobot:
        """The robot of section V as hardware."""
        return RealRobot(self.spring_motions, self.seed)

    @cached_property
    def friction(self) -> Friction:
        """Section V-B and C."""
        draws = _QUICK_DRAWS if self.quick else _DRAWS
        self.tell(f"section V-B, C: residuals, validation, model 1 against model 2 over {draws} draws")
        return friction(self.real, self.validation, self.slow_motion, draws=draws)

    @cached_property
    def missing(self) -> Missing:
        """Section VI."""
        self.tell("section VI: diagnosing what the 21 parameters lack, adding it")
        return missing(self.real, self.validation)

    def _designed(self, robot: Robot, criterion: str, floor: float | None = None) -> Excitation:
        from robot_ident.design.design import design

        self.tell(f"designing a trajectory of {robot.name} by {criterion}")
        starts = _QUICK_STARTS if self.quick else _STARTS
        return design(robot, criterion=criterion, determinant_floor=floor, starts=starts, seed=self.seed).excitation

    def to_dict(self, sections: Sequence[int] = SECTIONS) -> dict[str, Any]:
        """Return the figures of some sections."""
        parts: dict[int, tuple[str, Callable[[], dict[str, Any]]]] = {
            1: ("table_i", lambda: table_i(self.robot).to_dict()),
            2: ("excitation", lambda: self.excitations.to_dict()),
            3: ("redesign", lambda: self.redesign.to_dict()),
            4: ("measuring", lambda: self.measuring.to_dict()),
            5: ("friction", lambda: self.friction.to_dict()),
            6: ("missing", lambda: self.missing.to_dict()),
        }
        return {name: made() for number, (name, made) in parts.items() if number in sections}


def _shipped(name: str) -> Excitation:
    return Excitation.read(config_file("paper", f"{name}.yaml"))
