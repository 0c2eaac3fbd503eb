"""The options of the command line: each that several commands have is declared once, and `TAKES` lists what a command
takes, in the order and under the headings of its help.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

DEFAULT_ROBOT = "kuka_ir361"


def within(lower: float, upper: float, kind: type[float] | type[int] = float) -> Callable[[str], float]:
    """Return a type for an option: a number between bounds, inclusive."""

    def number(text: str) -> float:
        what = "a whole number" if kind is int else "a number"
        try:
            value = kind(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text}: {what} is expected") from None
        if not lower <= value <= upper:
            raise argparse.ArgumentTypeError(f"{text}: {what} from {lower:g} to {upper:g} is expected")
        return value

    return number


@dataclass(frozen=True)
class Option:
    """An option or a positional argument: its names, and how argparse takes it."""

    names: tuple[str, ...]
    how: Mapping[str, Any]

    def but(self, text: str | None = None, **how: Any) -> Option:
        """Return it as one command means it: with another help, default or form."""
        return replace(self, how={**self.how, **({} if text is None else {"help": text}), **how})

    def add_to(self, parser: argparse._ActionsContainer) -> None:
        """Add it to a parser or a group; the help of a single value says its default, if any."""
        how = dict(self.how)
        says = how.pop("says_default", True) and "default" not in how["help"]
        if says and isinstance(how.get("default"), (int, float, str)):
            how["help"] += " (default: %(default)s)"
        parser.add_argument(*self.names, **how)


def option(usage: str, text: str = "", default: Any = None, **how: Any) -> Option:
    """Return an option by its usage, as the help shows it.

    Without a value (`--force`), with a word (`--topic T`), two (`--tell A B`), one of some (`--base {A,B}`), one or
    several (`--bag BAG ...`); a positional argument with its name first (`bag BAG`).
    """
    name, *values = usage.split()
    if not name.startswith("-"):
        return Option((name,), {"metavar": " ".join(values), "help": text, **how})
    if not values:
        return Option((name,), {"action": "store_true", "help": text, **how})
    if values[-1] == "...":
        return Option((name,), {"metavar": values[0], "nargs": "+", "default": default or [], "help": text, **how})
    form: dict[str, Any] = {"metavar": values[0]}
    if values[0].startswith("{"):
        form = {"choices": values[0].strip("{}").split(",")}
    elif len(values) > 1:
        form = {"metavar": tuple(values), "nargs": len(values)}
    return Option((name,), {"help": text, "default": [] if how.get("action") == "append" else default, **form, **how})


def given(args: argparse.Namespace, names: str) -> str:
    """Return which of some options have another value than their default, in words; empty where none has."""

    def declared(options: Sequence[Option | Group | OneOf]) -> Iterator[Option]:
        for one in options:
            yield from [one] if isinstance(one, Option) else declared(one.options)

    by_name = {one.names[-1]: one.how for one in declared(TAKES[args.verb])}
    dests = {name: by_name[name].get("dest", name.lstrip("-").replace("-", "_")) for name in names.split()}
    return ", ".join(
        n for n, dest in dests.items() if getattr(args, dest) not in (by_name[n].get("default"), None, False)
    )


class Group:
    """Options that the help shows under a heading."""

    def __init__(self, title: str, *options: Option | OneOf) -> None:
        self.title, self.options = title, options

    def add_to(self, parser: argparse._ActionsContainer) -> None:
        """Add the heading and its options."""
        group = parser.add_argument_group(self.title)
        for one in self.options:
            one.add_to(group)


class OneOf:
    """Options of which a command line has one at most, or exactly one."""

    def __init__(self, *options: Option, required: bool = False) -> None:
        self.options, self.required = options, required

    def add_to(self, parser: argparse._ActionsContainer) -> None:
        """Add the options."""
        group = parser.add_mutually_exclusive_group(required=self.required)
        for one in self.options:
            one.add_to(group)


class _Effects(argparse.Action):
    """Takes effects; a recording that follows them is one still."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        words = [values] if isinstance(values, str) else list(values or ())
        bags = [word for word in words[1:] if os.path.exists(word)]
        effects = [*words[:1], *(word for word in words[1:] if word not in bags)]
        setattr(namespace, self.dest, [*getattr(namespace, self.dest), *effects])
        namespace.after_effects = [*getattr(namespace, "after_effects", []), *bags]


BAG = option("bag BAG", "bag, .npz or .csv")
MODEL = option("model model.yaml", "identified model")
EXCITATION = option("excitation excitation.yaml", "excitation or validation motion")
INPUTS = option("inputs model.yaml BAG", nargs="+")
ROBOT = option(
    "--robot R", "kuka_ir361, kuka_ir361_spring, a robot YAML or a URDF (default: kuka_ir361)", DEFAULT_ROBOT
)
OF_MODEL = option("--model MODEL", "model.yaml whose parameters to optimise for")
EFFECT = option("--effect NAME@JOINT", "additional effects in the model (@*: at every joint)", action="append")
PAYLOAD_ONLY = option("--only {payload}")
JOINTS = option("--joints A,B")
HOLD = option("--hold JOINT=ANGLE", action="append")
TOPIC = option("--topic T", "topic of the joint states")
BAGS = option("--bag BAG ...", "recordings to fit the model to", required=True)
VALIDATION = option("--validation BAG2 ...", "validation recordings, never used in a fit", action="extend")
TRAJECTORY = option("--trajectory EXCITATION", action="append")
PERIODS = option("--periods PERIODS", default=16, type=within(1, 100_000, int))
SEED = option("--seed SEED", "seed of the noise", 0, type=within(0, 2**31, int))
BASE_FREQUENCY = option("--base-frequency F", type=within(1e-4, 1e4))
SAMPLE_RATE = option("--sample-rate HZ", type=within(1.0, 1e5))
LOW_PASS = option("--low-pass HZ", type=within(0.01, 1e5))
PRECISION = (
    option("--precision P", "also print how many periods bring sigma down to this ratio of the value, e.g. 5%%"),
    option(
        "--parameter NAME",
        "with --precision: only this parameter (default: all); its value comes from --model or the robot's files",
        action="append",
    ),
)
ACCEPT_UNCHECKED = option(
    "--accept-unchecked", "exit with 0 although limits or collisions were not checked; the output still lists them"
)
CLUSTER = option("--cluster ADDRESS", "run on a Dask scheduler (tcp://HOST:PORT) instead of local processes")
FOLDER = option("--folder DIR")
OUTPUT = Option(("-o", "--output"), {"metavar": "MODEL"})
FORCE = option("--force", "overwrite existing files")
JSON = option("--json", "print one JSON object on standard output, nothing else")
EFFECTS_FROM = option(
    "--effects-from FILE.py", "Python file with user-defined effects (see examples/my_effects.py)", action="append"
)


def output(metavar: str, text: str, *, required: bool = False) -> tuple[Option, Option, Option]:
    """Return the options of a command that writes a file: `-o`, `--force` and `--json`."""
    return OUTPUT.but(text, metavar=metavar, required=required), FORCE, JSON


def joints(does: str, angle: str) -> tuple[Option, Option]:
    """Return the options of some joints only.

    does: what the command does with the joints. angle: where a held joint stands that --hold doesn't name.
    """
    return (
        JOINTS.but(f"{does} these joints only; the others stand still"),
        HOLD.but(f"with --joints: position of a joint that stands still, rad or m (default: {angle})"),
    )


TAKES: dict[str, tuple[Option | Group | OneOf, ...]] = {
    "init": (
        option("--urdf X", "URDF, or the output of xacro (default: /robot_description in BAG)"),
        option("--bag BAG", "recording of the robot, for its joint names and noise"),
        TOPIC.but("topic of the joint states in BAG"),
        option("--name NAME", "name of the robot (default: the URDF's)"),
        OneOf(
            option("--mount {floor,wall,ceiling}", "surface to which the base is mounted"),
            option("--gravity X,Y,Z", "gravity in the base frame, m/s^2"),
        ),
        option(
            "--acceleration A[,A...]",
            "acceleration limits, rad/s^2: one for all moving joints, or one per joint",
        ),
        HOLD.but("joint that does not move, and its position in rad or m"),
        *output("ROBOT", "robot.yaml to write", required=True),
    ),
    "design": (
        Group(
            "what to optimise",
            ROBOT.but(
                "kuka_ir361, kuka_ir361_spring, a robot YAML, URDF or model.yaml (default: --model's, else kuka_ir361)",
                default=None,
            ),
            option(
                "--criterion CRITERION",
                "d-optimal (log det of the covariance), condition (condition number) or crlb (d-optimal with"
                " position noise, needs --model or --iterate); default: %(default)s",
                "d-optimal",
            ),
            EFFECT.but("additional effects to identify (@*: at every joint)", nargs="+", action="extend"),
            option(
                "--iterate",
                "with --criterion crlb: measure the simulated robot, estimate, design again until sigma no longer"
                " falls; --starts and --time-limit are those of each design",
            ),
            OF_MODEL,
            option("--prior BAG ...", "recordings or models whose information is already available"),
            PAYLOAD_ONLY.but("optimise for the payload's parameters alone, with friction re-estimated"),
            option("--tell A@j B@k", "optimise the motion to discriminate between two effects (@*: every joint)"),
        ),
        Group(
            "motion",
            option("--harmonics L", "harmonics of the Fourier series (default: 5)", type=within(1, 60, int)),
            BASE_FREQUENCY.but("base frequency of the Fourier series, Hz", default=0.1, type=within(1e-4, 100.0)),
            option("--bandwidth LO:HI", "use L harmonics within this band only, Hz"),
            SAMPLE_RATE.but("sample rate of the trajectory, Hz", default=150.0),
            option("--symmetric", "make q(-t) = q(t), which separates friction from conservative torque errors"),
            option(
                "--trajectories K",
                "optimise K trajectories jointly; -o NAME.yaml writes NAME_1.yaml...",
                1,
                type=within(1, 20, int),
            ),
            option(
                "--waypoints FILE",
                "instead of a Fourier series, plan a repeated tour of moves between the approved poses of a YAML",
            ),
            option("--moves K", "maximum number of moves of the tour", 12, type=within(2, 200, int)),
            option("--repeats M", "repetitions of the tour", 8, type=within(1, 1000, int)),
            option(
                "--validation-motion",
                "instead of an excitation, draw 20 random points with maximum acceleration and a full stop at each",
            ),
        ),
        Group(
            "limits",
            option(
                "--from BAG ...",
                "stay inside the envelope of these recordings: positions, speeds, accelerations, tool positions",
                dest="run_before",
            ),
            *joints("move", "0"),
            ACCEPT_UNCHECKED,
        ),
        Group(
            "search",
            option("--starts N", "random starts of the optimiser (default: 12)", type=within(1, 100_000, int)),
            option(
                "--time-limit S", "stop after S seconds of wall time and keep the best result", type=within(1e-3, 1e9)
            ),
            SEED.but("seed of the random starts"),
            CLUSTER,
        ),
        Group(
            "output",
            *output("EXCITATION", "excitation.yaml to write")[:2],
            option(
                "--bound",
                "also bound the best criterion within the limits (up to 60 s) and print the D-efficiency",
            ),
            option("--page PAGE", "page.html to write: the motion, its limits, its information"),
            *PRECISION,
            JSON,
        ),
    ),
    "check": (
        EXCITATION,
        ROBOT,
        PERIODS.but("number of periods to play", default=1),
        option(
            "--from Q1,Q2,...",
            "check the approach from rest at these positions (rad or m) too; write --from=-0.1,... if the first is"
            " negative",
            dest="start",
        ),
        OF_MODEL.but("with --precision: model.yaml that holds the parameters"),
        *PRECISION,
        ACCEPT_UNCHECKED,
        JSON,
    ),
    "simulate": (
        EXCITATION.but("excitation or validation motion to play"),
        Group(
            "simulated robot",
            ROBOT,
            EFFECT.but(
                "additional effect of the plant; @*: every joint (robot_ident effects NAME lists its values)",
                metavar="NAME@JOINT[:k=v,...]",
            ),
            option(
                "--hidden SEED",
                "add effects drawn at random and write them to BAG.sealed only (robot_ident trial --open shows them)",
                type=int,
            ),
            option(
                "--payload KG[,X,Y,Z]",
                "point mass at the end effector and its centre in m in that frame; written to BAG.conditions.yaml",
            ),
            option("--servo SERVO", "feedforward or pd", "feedforward"),
        ),
        Group(
            "recording",
            PERIODS.but("steady periods of an excitation, after one transient period"),
            SAMPLE_RATE.but("sample rate (default: the excitation's, else 150 Hz)"),
            option("--anti-alias", "filter the effort as the current sensor's analogue filter does"),
            SEED,
        ),
        Group("output", *output("BAG", "rosbag2 folder, .mcap, .npz or .csv file to write", required=True)),
    ),
    "replay": (
        BAG,
        option("--rate RATE", "playback speed relative to real time", 1.0, type=within(1e-3, 1e4)),
        TOPIC.but("topic to publish on", metavar="TOPIC", default="joint_states"),
        option("--wait S", "wait at most S seconds for a subscriber; 0 starts at once", 30.0, type=float),
        JSON,
    ),
    "info": (
        BAG,
        ROBOT.but("kuka_ir361, kuka_ir361_spring, a robot YAML or a URDF (default: none)", default=None),
        TOPIC,
        JSON,
    ),
    "filter": (
        option(
            "response RESPONSE.csv",
            "measured response: columns frequency [Hz], gain (ratio), phase [deg] and, where known, deviation",
            nargs="?",
        ),
        option("--with BAG", "instead: recording of a motion with the filter", dest="behind"),
        option("--without BAG", "recording of the same motion without the filter"),
        ROBOT,
        option("--joint J", "with two recordings: this joint only (default: all together)"),
        option("--order N", "order of the filter (default: that of the least BIC)", type=within(1, 12, int)),
        JSON,
    ),
    "recover": (BAG.but("truncated bag"), *output("BAG2", "complete bag to write", required=True)),
    "identify": (
        option("bags BAG", "recordings to fit, periodic or not", nargs="*"),
        Group(
            "model",
            EFFECT.but(nargs="+", action=_Effects),
            ROBOT,
            *joints("identify", "as recorded"),
            PAYLOAD_ONLY.but("estimate the payload and friction alone, on an arm with a known --model"),
            OF_MODEL.but("with --only: model.yaml of the arm without payload"),
            option(
                "--base {prediction,declared}",
                "prediction: choose offsets, rotor inertias and filters by cross-validation; declared: use those of"
                " the robot YAML and the options (default: the robot YAML's, else prediction)",
            ),
        ),
        Group(
            "estimation",
            option(
                "--estimator ESTIMATOR",
                "ls (least squares), wls (weighted), ml (maximum likelihood), iv (instrumental variables); default:"
                " %(default)s",
                "wls",
            ),
            option("--physical", "project the estimate onto physically consistent parameters (needs clarabel)"),
            option("--as-declared", "continue even if the data contradict the robot YAML's effort metadata"),
        ),
        Group(
            "reading the recordings",
            OneOf(
                TRAJECTORY.but(
                    "excitation.yaml that was played: sets the period; give it once, or once per recording in"
                    " their order"
                ),
                BASE_FREQUENCY.but("base frequency of the motion, Hz (default: detected from the data)"),
                option("--not-periodic", "treat the recording as non-periodic"),
            ),
            TOPIC.but("topic of the joint states (default: joint_states in any namespace)"),
        ),
        Group(
            "signal processing",
            LOW_PASS.but(
                "low-pass filter of effort and regressor (default: chosen by prediction; with base declared none if"
                " periodic, else 10 Hz)"
            ),
            option(
                "--derivative-bandwidth HZ",
                "low-pass filter of non-periodic positions before differentiation (default: chosen by prediction; with"
                " --low-pass or base declared 4 times the low-pass)",
                type=within(0.01, 1e5),
            ),
            option(
                "--decimate K", "keep every K-th filtered row (default: 1, or as chosen)", 1, type=within(1, 1000, int)
            ),
            option(
                "--minimum-speed V[,V...]",
                "exclude rows slower than this, rad/s or m/s: one value, or one per joint (default: the robot's)",
            ),
            option(
                "--anti-alias ORDER:HZ",
                "compensate this Butterworth filter of the recorded effort; none: no filter (default: the robot"
                " YAML's)",
            ),
        ),
        Group("output", *output("MODEL", "model.yaml to write")),
    ),
    "validate": (
        MODEL,
        BAG.but("validation recording, not used in the fit"),
        TOPIC,
        LOW_PASS.but("cut-off of the low-pass filter (default: the model file's, as in predict, else 10 Hz)"),
        option("--max-rms NM", "exit with 3 if a joint's residual rms exceeds this value", type=within(0.0, 1e9)),
        JSON,
    ),
    "predict": (
        MODEL,
        BAG.but("recording, or planned motion (excitation.yaml or moves.yaml)"),
        TOPIC,
        *output("OUT", "prediction to write: .npz, .csv, .mcap or rosbag2 folder", required=True),
    ),
    "montecarlo": (
        EXCITATION.but("excitation to repeat"),
        ROBOT,
        option("--runs RUNS", "number of identifications", 200, type=within(2, 1_000_000, int)),
        PERIODS.but("periods averaged in each run"),
        EFFECT,
        SEED,
        CLUSTER,
        JSON,
    ),
    "compare": (
        INPUTS.but("models and recordings; two models without a recording: what changed"),
        TOPIC,
        option(
            "--mcap OUT",
            "write effort, prediction, residual and the torque of each effect as time series (.mcap file or folder)",
        ),
        option(
            "--over WHAT",
            "also print the residual and its noise as a function of position, velocity, acceleration, load,"
            " time_since_reversal, time or frequency",
        ),
        option("--fail-on-misfit", "exit with 3 if the first model shows lack of fit at a joint"),
        FORCE,
        option("--fail-on-change", "exit with 3 if a parameter changed from the first of two models to the second"),
        JSON,
    ),
    "diagnose": (
        INPUTS.but("one model and its recordings, two or more for a conclusive verdict"),
        Group("recordings", VALIDATION, TOPIC),
        Group(
            "model extension",
            option(
                "--add-until-adequate",
                "add the missing effects and repeat until the model is adequate; print the error after each step",
            ),
        ),
        Group("output", *output("MODEL", "with --add-until-adequate: extended model to write")),
    ),
    "add": (
        MODEL.but("the model to extend"),
        option("effects NAME@JOINT", "effects to add (@*: at every joint)", nargs="+"),
        BAGS,
        *output("MODEL2", "write the extended model to this file")[:2],
        VALIDATION,
        TOPIC,
        JSON,
    ),
    "effects": (option("name NAME", "effect to explain (default: list all)", nargs="?"), JSON),
    "workbench": (
        MODEL.but("model to start from (default: identify one)", nargs="?"),
        BAGS.but("recordings to fit (default: choose them in the browser)", required=False),
        VALIDATION,
        ROBOT.but("robot of the model to identify (default: kuka_ir361)", default=None),
        TOPIC,
        option("--port P", "TCP port (default: the first free one from 8050)", type=within(0, 65535, int)),
        FOLDER.but("folder of the session, which a later start resumes", default="robot_ident_workbench"),
        option("--no-browser", "print the address with its token and open no browser"),
    ),
    "report": (
        option("models model.yaml", "models, oldest first; the verdict is about the last", nargs="+"),
        BAGS.but("recordings to compare the models with"),
        VALIDATION,
        TRAJECTORY.but("excitation.yaml that was played, for its limit margins (default: from the models)"),
        TOPIC,
        *output("PAGE", "HTML page to write", required=True),
    ),
    "export": (
        MODEL,
        OneOf(
            option("--urdf F", "write the robot's URDF with the identified inertias and joint friction"),
            option("--mjcf F", "write a MuJoCo model, including rotor inertias"),
            option("--c DIR", "write C code of torque, gravity and friction to this folder"),
            required=True,
        ),
        option(
            "--smoothing V",
            "with --c: speed below which Coulomb friction is smoothed, rad/s or m/s",
            0.01,
            type=within(1e-9, 1e3),
        ),
        option(
            "--validation BAG",
            "recording on which to print the model's error and the torque of the effects not exported",
        ),
        TOPIC,
        option(
            "--anyway",
            "export even if the model misses half of its own torque, fails on --validation or is not physically"
            " consistent (C code)",
        ),
        FORCE,
        JSON,
    ),
    "demo": (
        PERIODS.but("steady periods of each trajectory (default %(default)s)", default=10, type=within(2, 1000, int)),
        option("--design-time S", "to optimise the excitations", 16.0, type=within(1.0, 3600.0), says_default=False),
        option(
            "--hidden NAME@JOINT:VALUE ...",
            "what the robot has and the paper's model lacks",
            nargs="*",
        ).but(default=None),
        SEED.but("of design and noise (default %(default)s)"),
        FOLDER.but("where everything is kept (default ./%(default)s)", metavar="FOLDER", default="robot_ident_demo"),
        FORCE.but("replace the folder of an earlier demo"),
        JSON,
    ),
    "paper": (
        OUTPUT.but(
            "page to write, .html, or .md for text and tables alone (default: %(default)s)",
            metavar="PAGE",
            default="paper.html",
        ),
        FORCE,
        option(
            "--section N ...",
            "only these sections of the page, 1 to 6",
            type=within(1, 6, int),
            default=[1, 2, 3, 4, 5, 6],
        ),
        option("--quick", "shorter searches: minutes instead of a quarter of an hour"),
        option("--redesign", "design all trajectories anew instead of those that ship with the package"),
        option(
            "--printed-table",
            "simulate Table I exactly as printed, although no mass distribution has these moments",
        ),
        SEED.but("of noise, draws and searches"),
        JSON,
    ),
    "trial": (
        Group(
            "what to hide",
            ROBOT,
            option(
                "--family {effects,measurement,real}",
                "effects: of the arm; measurement: faults of the recording; real: recordings with the faults of"
                " real ones",
                "effects",
            ),
            option(
                "--kind KIND",
                "single, pair_other_joints, same_joint (two effects), triple, null, unknown or"
                " single_with_background, each with all seeds (default: drawn); of --family real: base, fixed"
                " filters compete with the base model, or effects, several on every joint but one (default:"
                " base)",
                action="append",
            ),
            option("--seeds A:B", "seeds A to B - 1, one case each", "0:20"),
        ),
        Group(
            "recordings",
            option("--excitation FILE ...", "motions to play, the last one for validation (default: design four)"),
            FOLDER.but("folder that caches the designed motions"),
            PERIODS.but("steady periods of each motion", type=int),
            option("--noise NOISE", "factor on the robot's noise variances", 1.0, type=float),
        ),
        Group(
            "execution",
            option("--cases-file F", "file of the finished cases, from which an interrupted trial resumes"),
            option("--workers N", "number of processes (default: one per processor)", type=int),
            CLUSTER,
        ),
        Group("output", option("--open BAG.sealed", "show what simulate --hidden hid, and exit"), JSON),
    ),
}
"""What a command takes, but `--effects-from`."""
