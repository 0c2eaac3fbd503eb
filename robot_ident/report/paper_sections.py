"""The page of the paper: what it says, what is found here, the difference, and the command that repeats it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.estimation.prediction import measured_for
from robot_ident.figures import paper as figures
from robot_ident.figures.error_steps import staircase_figure, staircase_text
from robot_ident.figures.torque_over_time import torque_figure, torque_text
from robot_ident.figures.trajectory import point_to_point_figure, trajectories_figure, trajectory_text
from robot_ident.paper import printed
from robot_ident.paper.excitation import CRITERIA, Excitations, sigma_share
from robot_ident.paper.friction import Friction
from robot_ident.paper.measuring import NOMINAL, MeasuringChain
from robot_ident.paper.missing import SEEN, Missing
from robot_ident.paper.study import SPRING_FLOOR, Study
from robot_ident.paper.table_i import TableI, table_i
from robot_ident.report.page import Plot, Section, Table
from robot_ident.residuals.beside import beside
from robot_ident.signals.motion import Array

NAMES = {"condition": "c1", "d-optimal": "c2"}


@dataclass(frozen=True)
class PaperSection(Section):
    """One section of the paper. says: what is printed; finds: what is found here; items: plots and tables."""

    name: str
    says: str
    finds: Sequence[str]
    items: Sequence[Plot | Table]
    difference: str
    commands: Sequence[str]

    title = "Section of the paper"
    template = "paper.html.j2"

    @property
    def heading(self) -> str:
        """The section's own name."""
        return self.name

    def context(self) -> Mapping[str, Any]:
        """Return texts, plots and tables."""
        return {
            "says": self.says,
            "finds": self.finds,
            "items": self.items,
            "difference": self.difference,
            "commands": self.commands,
        }


def paper_sections(study: Study, sections: Sequence[int]) -> list[PaperSection]:
    """Return the asked sections of the page, computed."""
    made = {
        1: lambda: _robot(study, table_i(study.robot)),
        2: lambda: _excitation(study, study.excitations),
        3: lambda: _iteration(study),
        4: lambda: _measuring(study, study.measuring),
        5: lambda: _friction(study, study.friction),
        6: lambda: _missing(study, study.missing),
    }
    return [made[number]() for number in sections]


def as_markdown(title: str, subtitle: str, sections: Sequence[PaperSection]) -> str:
    """Return texts and tables of the page in Markdown, and in words what its figures show."""
    lines = [f"# {title}", "", subtitle]
    for section in sections:
        lines += ["", f"## {section.name}", "", f"**The paper.** {section.says}"]
        for number, paragraph in enumerate(section.finds):
            lines += ["", f"{'' if number else '**Here.** '}{paragraph}"]
        for item in section.items:
            lines += ["", *(_rows(item) if isinstance(item, Table) else [f"*Figure.* {item.caption} {item.text}"])]
        lines += ["", f"**The difference.** {section.difference}", "", "```sh", *section.commands, "```"]
    return "\n".join(lines) + "\n"


def _rows(table: Table) -> list[str]:
    """Return a table's lines in Markdown."""
    sides = ["--:" if column in table.numeric else "---" for column in range(len(table.header))]
    return ["| " + " | ".join(map(str, row)) + " |" for row in (table.header, sides, *table.rows)]


def _again(study: Study, number: int, *more: str) -> list[str]:
    words = ["robot_ident paper --section", str(number)]
    words += [f"--seed {study.seed}"] if study.seed else []
    words += [
        option
        for option, given in (
            ("--quick", study.quick),
            ("--redesign", study.redesigned),
            ("--printed-table", study.printed_table),
        )
        if given
    ]
    return [" ".join(words), *more]


def _numbers(values: Iterable[float], form: str = ".1f") -> str:
    return ", ".join(f"{value:{form}}" for value in values)


def _power(log10: float) -> str:
    """Return 10^x as a number is printed."""
    exponent = int(np.floor(log10))
    return f"{10.0 ** (log10 - exponent):.2f}e{exponent}"


def _robot(study: Study, table: TableI) -> PaperSection:
    rows = [
        (f"p{k}", name if name != f"p{k}" else "", meaning, f"{shown:g}", f"{value:.2f}", unit)
        for k, (name, meaning, shown, value, unit) in enumerate(
            zip(table.names, printed.MEANING, printed.TABLE_I, table.simulated, table.units, strict=True), 1
        )
    ]
    if table.possible:
        found = (
            "Simulated is the nearest set that a mass distribution can have: p11 = 7.65 and p15 = 7.73, the rest as"
            " printed. It changes the torque by 0.69, 0.31 and 0.31 Nm rms, far below the noise of 5, 5.1 and 3.2 Nm."
        )
    else:
        found = (
            "Simulated is the printed set as it is (--printed-table): the equation of motion holds for it, although no"
            " mass distribution has these moments."
        )
    return PaperSection(
        "1. The robot and its parameters (section IV-A, fig. 1, Table I)",
        "The first three axes of a KUKA IR 361. The model has 21 parameters: 15 combinations of inertial parameters,"
        " p1 to p15, and viscous and Coulomb friction of each joint, p16 to p21.",
        (
            "Frames by modified Denavit-Hartenberg parameters, drawn from the URDF that is simulated. Gravity enters"
            " through p2, p3, p9 and p10 alone.",
            found,
        ),
        (
            Plot(figures.robot_figure(study.robot), figures.robot_text(study.robot), "Fig. 1: x red, y green, z blue."),
            Table(("parameter", "our name", "meaning", "printed", "simulated", "unit"), rows, numeric=(3, 4)),
        ),
        "The printed Table I is not physically possible: Izz3 = 7.63 is less than Ixx3 - Iyy3 = 8.21, and of a body's"
        " three moments of inertia none can exceed the sum of the others. The estimates in the paper are not"
        " constrained, so that noise and friction errors could lead there (identify --physical prevents it).",
        _again(study, 1),
    )


def _excitation(study: Study, found: Excitations) -> PaperSection:
    best, bound = found.optimal["d-optimal"], found.bound
    criteria = []
    for criterion in CRITERIA:
        one, log10 = found.optimal[criterion], found.optimal[criterion].evaluation.log10_det_covariance
        criteria.append(
            (
                f"{NAMES[criterion]}-optimal",
                f"{printed.CONDITION[criterion]:.2f}",
                f"{one.evaluation.condition_number:.2f}",
                f"{printed.DETERMINANT[criterion]:.2e}",
                _power(log10),
                f"{bound.efficiency(printed.LOG10_DET[criterion]):.0%}",
                f"{bound.efficiency(log10):.0%}",
            )
        )
    counts = []
    for criterion in CRITERIA:
        for who, runs in (("1500", found.optimal[criterion].runs), ("500", found.optimal[criterion].fewer)):
            low, high = runs.ratio_interval
            counts.append(
                (
                    NAMES[criterion],
                    who,
                    f"{runs.inside_mean} of 21",
                    f"{runs.inside_ratio} of 21",
                    f"{low:.3f} to {high:.3f}",
                    f"{runs.bias_statistic:.1f} ({runs.bias_interval[0]:.1f} to {runs.bias_interval[1]:.1f})",
                    f"{runs.error_statistic:.3f} ({runs.error_interval[0]:.3f} to {runs.error_interval[1]:.3f})",
                )
            )
    fewer = best.fewer
    unbiased = all(
        one.fewer.bias_interval[0] < one.fewer.bias_statistic < one.fewer.bias_interval[1]
        for one in found.optimal.values()
    )
    wider = float(np.mean(fewer.sigma / best.runs.sigma))
    ratio = sigma_share(found, "d-optimal")
    return PaperSection(
        "2. Optimal excitation and its estimates (section IV, figs. 2 and 3, Table II)",
        "Two trajectories, five harmonics of 0.1 Hz, 10,000 iterations of sequential quadratic programming: c1 has"
        " condition number 4.15 and determinant 1.76e-43, c2 5.94 and 2.36e-49. 200 identifications with simulated"
        " noise: the means of 16 of 21 parameters lie within sigma / sqrt(200) of the truth, the standard deviations of"
        " 19 of 21 inside their 90 % interval. With 500 samples instead of 1500 the estimates are said to be biased.",
        (
            f"The c2-optimal trajectory reaches a determinant of {_power(best.evaluation.log10_det_covariance)}: sigma"
            f" is {float(np.exp(np.mean(np.log(ratio)))):.2f} times the printed one in the geometric mean"
            f" ({ratio.min():.2f} to {ratio.max():.2f}). No trajectory within the limits gets below"
            f" {_power(bound.log10_det_covariance)}; per parameter it tells at least"
            f" {bound.efficiency(best.evaluation.log10_det_covariance):.0%} of what any could (the paper's"
            f" {bound.efficiency(printed.LOG10_DET['d-optimal']):.0%}).",
            "The exact tests of the last two columns use all parameters with their covariance: n D' C^-1 D of the mean"
            " errors D is chi-square with 21 degrees of freedom, the mean of e' C^-1 e / 21 over the runs is 1.",
            "With every third sample, 500, the estimates are"
            + (" not biased" if unbiased else " outside the interval of an unbiased estimator")
            + f" either; sigma grows by {wider:.2f}, the root of 3. Least squares with exact regressors is unbiased for"
            " any number of samples.",
        ),
        (
            Plot(
                trajectories_figure(
                    {
                        "c1 (fig. 2)": found.optimal["condition"].excitation,
                        "c2 (fig. 3)": best.excitation,
                    },
                    found.robot,
                ),
                f"c1: {trajectory_text(found.optimal['condition'].excitation, found.robot)}"
                f" c2: {trajectory_text(best.excitation, found.robot)}",
                "One period. Dashed: limits of the joint of that colour, grey where joints share one.",
            ),
            Table(
                (
                    "trajectory",
                    "condition, paper",
                    "here",
                    "determinant, paper",
                    "here",
                    "D-efficiency at least, paper",
                    "here",
                ),
                criteria,
                numeric=(1, 2, 3, 4, 5, 6),
            ),
            Plot(figures.sigmas_figure(found), _sigma_text(ratio), "Table II: predicted standard deviations."),
            _table_ii(found),
            Table(
                (
                    "trajectory",
                    "samples",
                    "means inside (paper: 16)",
                    "ratios inside (paper: 19)",
                    "interval of the ratio",
                    "bias (99.8 % interval)",
                    "spread (3 sigma)",
                ),
                counts,
                numeric=(1, 2, 3),
            ),
        ),
        "Better trajectories by a multi-start search of a smooth problem with exact derivatives; the estimates behave"
        " as the paper finds. Two slips: the interval of the ratio of standard deviations is .919 to 1.084 by the"
        " paper's formula (.923 to 1.089 are printed), and the bias with 500 samples can't be, unless the regressor is"
        " noisy.",
        _again(
            study,
            2,
            "robot_ident design --criterion condition --bound -o c1.yaml",
            "robot_ident design --bound -o c2.yaml",
            "robot_ident montecarlo c2.yaml --runs 200",
        ),
    )


def _sigma_text(ratio: Array) -> str:
    return (
        f"Standard deviations of 21 parameters; of the c2-optimal trajectory {int(np.sum(ratio < 1))} are smaller than"
        f" the printed ones, the ratio runs from {ratio.min():.2f} to {ratio.max():.2f}."
    )


def _table_ii(found: Excitations) -> Table:
    one, two = (found.optimal[criterion].runs for criterion in CRITERIA)
    rows = []
    for k in range(len(found.names)):
        digits = max(4, 1 - int(np.floor(np.log10(two.sigma[k]))))
        rows.append(
            (
                f"p{k + 1}",
                *(
                    f"{value:.{digits}f}"
                    for value in (
                        two.true[k],
                        printed.SIGMA["condition"][k],
                        one.sigma[k],
                        printed.SIGMA["d-optimal"][k],
                        two.sigma[k],
                        found.sigma_cr[k],
                        two.mean[k],
                        two.sample_sigma[k],
                    )
                ),
            )
        )
    header = (
        "parameter",
        "true",
        "sigma c1, paper",
        "here",
        "sigma c2, paper",
        "here",
        "Cramér-Rao, c2",
        "200 runs, c2: mean",
        "sigma",
    )
    return Table(header, rows, numeric=tuple(range(1, 9)))


def _iteration(study: Study) -> PaperSection:
    found, bound = study.redesign, study.excitations.bound
    rows = [
        (
            str(number),
            {"condition": "c1", "crlb": "Cramér-Rao bound"}.get(one.excitation.criterion or "", ""),
            f"{one.log10_det_bound:.2f}",
            f"{one.model.condition_number:.2f}",
            f"{-100 * one.fall:+.1f} %" if one.fall else "",
        )
        for number, one in enumerate(found.rounds, 1)
    ]
    ended = (
        f"After {len(found.rounds)} measurements the next trajectory would lower the mean sigma by"
        f" {100 * max(0.0, found.next_fall):.1f} %, less than the 2 % of the stop rule."
        if found.converged
        else f"After {len(found.rounds)} measurements sigma still falls by {100 * found.next_fall:.1f} %."
    )
    gain = float(np.max(np.abs(study.excitations.sigma_cr / study.excitations.optimal["d-optimal"].runs.sigma - 1.0)))
    return PaperSection(
        "3. Design by the Cramér-Rao bound, iterated (section III-B)",
        "With noise on positions the bound depends on the parameters: design by c1, measure, estimate by maximum"
        " likelihood, minimise the bound at that estimate, measure again, until nothing changes. No figures are given.",
        (
            ended,
            f"Position noise of 1e-5 rad changes the standard deviations of Table II by at most {gain:.0e} of"
            " themselves: the bound is that of c2, and the second trajectory is c2-optimal at once. On the real robot,"
            " too, the paper found that it changed nothing.",
        ),
        (
            Plot(
                figures.rounds_figure(found, bound.log10_det_covariance),
                "log10 of the determinant of the bound:"
                f" {_numbers((one.log10_det_bound for one in found.rounds), '.2f')}.",
            ),
            Table(
                ("measurement", "designed by", "log10 det of the bound", "condition number", "sigma, mean"),
                rows,
                numeric=(0, 2, 3, 4),
            ),
        ),
        "Eq. 6 as printed is a product of gradients, zero at the optimum; used here is F = sum J' W J, and for theta"
        " (F_tt - F_td F_dd^-1 F_dt)^-1.",
        _again(study, 3, "robot_ident design --criterion crlb --iterate -o last.yaml"),
    )


def _measuring(study: Study, found: MeasuringChain) -> PaperSection:
    identified, real = found.identified, found.real
    words = {"ignored": "ignored", "nominal": "nominal Butterworth undone", "identified": "identified filter undone"}
    rows = [
        (words[one.name], f"{one.chi_square_ratio:.3f}", f"{one.largest_error:+.1f}", one.parameter)
        for one in found.undone
    ]
    by_name = {one.name: one for one in found.undone}
    noise = [
        (joint, f"{shown:g}", f"{paper:.2f}", f"{right:.2f}")
        for joint, shown, paper, right in zip(
            found.robot.joints, printed.NOISE, found.noise_paper, found.noise, strict=True
        )
    ]
    criteria = []
    for criterion in CRITERIA:
        model = study.friction.models["model 1" if criterion == "condition" else "model 2"]
        criteria.append(
            (
                f"{NAMES[criterion]}-optimal",
                f"{printed.SPRING_CONDITION[criterion]:.1f}",
                f"{model.condition_number:.1f}",
                f"{printed.SPRING_DETERMINANT[criterion]:.2e}",
                _power(model.log10_det_covariance),
            )
        )
    return PaperSection(
        "4. The measuring chain (section V-A)",
        "25 parameters: the spring of axis 2 and torque offsets are added. The motor currents pass Butterworth filters"
        " of order 8 at 40 Hz; their identified model is inverted before 16 periods are averaged. The noise variance of"
        " the average is 1/16 of the sample variance: 25.1, 26.5, 9.5 (Nm)^2.",
        (
            "The simulated robot's filter is built of parts with tolerances: its poles are off those of a Butterworth"
            f" filter by 4 % (sections of {_sections(real.sections)}). A measured response of 100 points, 0.3 % each,"
            f" identifies order {identified.filter.order} by BIC and a delay of slow signals of"
            f" {1e3 * identified.filter.delay:.3f} ms (true: {1e3 * real.delay:.3f} ms; the nominal filter:"
            f" {1e3 * NOMINAL.delay:.3f} ms).",
            f"Ignored, the filter makes errors of up to {abs(by_name['ignored'].largest_error):.0f} sigma"
            f" ({by_name['ignored'].parameter}) and {by_name['ignored'].chi_square_ratio:.1f} times the residual that"
            " noise leaves. Undone, none is left.",
            "The paper divides the scatter about the mean of 16 periods by 16 x 1500 - 1; the mean costs 1500 degrees"
            " of freedom, and (16 - 1) x 1500 is right. Its noise is 6 % too small: a perfect model would be rejected"
            f" by {found.false_alarm:.1f} standard deviations of chi-square.",
        ),
        (
            Plot(figures.response_figure(found), _response_text(found)),
            Table(("the filter is", "chi-square / dof", "largest error [sigma]", "of"), rows, numeric=(1, 2)),
            Table(
                ("joint", "noise variance, paper [(Nm)^2]", "here, its divisor", "here, right divisor"),
                noise,
                numeric=(1, 2, 3),
            ),
            Table(
                ("trajectory, 25 parameters", "condition, paper", "here", "determinant, paper", "here"),
                criteria,
                numeric=(1, 2, 3, 4),
            ),
        ),
        _filter_difference(found),
        _again(
            study,
            4,
            "robot_ident simulate c2.yaml --robot kuka_ir361_spring -o plain",
            "robot_ident simulate c2.yaml --robot kuka_ir361_spring --anti-alias --seed 1 -o filtered",
            "robot_ident filter --with filtered --without plain --robot kuka_ir361_spring",
        ),
    )


def _sections(sections: Sequence[Sequence[float]]) -> str:
    return ", ".join(f"{section[0]:.1f} Hz, Q {section[1]:.2f}" for section in sections)


def _response_text(found: MeasuringChain) -> str:
    return (
        f"Gain and phase of the filter: measured at {len(found.response.frequency)} frequencies, identified with a"
        f" residual of {100 * found.identified.misfit:.2g} %, and the nominal filter."
    )


def _filter_difference(found: MeasuringChain) -> str:
    by_name = {one.name: one for one in found.undone}
    nominal, identified = by_name["nominal"].chi_square_ratio, by_name["identified"].chi_square_ratio
    if abs(nominal - identified) < 0.02:
        told = "within the band of this motion the nominal filter would do as well as the identified one"
    else:
        told = f"the nominal filter leaves {nominal / identified:.2f} times the residual of the identified one"
    return (
        f"The inversion works as the paper says; {told}. The divisor matters more: 6 % of the noise variance are the"
        " difference between a model that is accepted and one that is not."
    )


def _friction(study: Study, found: Friction) -> PaperSection:
    mse, noise = found.residual("model 2")
    one, two = found.models["model 1"], found.models["model 2"]
    rows = []
    for name in found.models:
        own, floor = found.residual(name)
        rows.append(
            (
                name,
                str(len(found.models[name].structure.names)),
                f"{found.models[name].condition_number:.1f}",
                _numbers(own),
                _numbers(np.sqrt(np.maximum(own - floor, 0.0))),
                _numbers(found.validation[name]),
            )
        )
    rows.append(
        (
            "model 2, paper",
            "",
            "111.7",
            _numbers(printed.RESIDUAL),
            _numbers(np.sqrt(np.array(printed.RESIDUAL) - np.array(printed.NOISE))),
            _numbers(printed.VALIDATION),
        )
    )
    rows.append(("noise (paper: 25.1, 26.5, 9.5)", "", "", _numbers(noise), "", ""))
    worse = np.median(found.draws.worse, axis=0)
    share = np.mean(found.draws.worse > 0, axis=0)
    bare = found.models["model 2 without the spring"]
    own_bare, _ = found.residual("model 2 without the spring")
    slow = found.validation["model of the condition number alone"]
    aside = {"model 2": beside(two, measured_for(two, found.validation_recording))}
    return PaperSection(
        "5. Residuals, validation, two models (section V-B and C, figs. 4 and 5)",
        "Model 1 comes from the c1-optimal, model 2 from the c2-optimal trajectory, both with spring and offsets. Model"
        " 2 leaves mean squared residuals of 81.1, 88.8, 23.1 (Nm)^2 where the noise is 25.1, 26.5, 9.5; they peak at"
        " low velocity: the friction model is too simple. On 20 random points, everything low-passed at 10 Hz, it errs"
        " by 45.0, 53.6, 12.0; model 1 by 20 % more on axis 1.",
        (
            "The simulated robot has friction that the model lacks; what it is stands at the end of the page. Its size"
            f" was chosen once so that the residuals are the paper's: {_numbers(mse)} (Nm)^2 here. What the 20 points"
            f" say was not chosen: {_numbers(found.validation['model 2'])} (Nm)^2.",
            f"Over {len(found.draws.worse)} draws of noise and 20 points, model 1 errs more than model 2 on axis 1 in"
            f" {share[0]:.0%} of the draws, by {100 * worse[0]:.0f} % in the median (axes 2 and 3:"
            f" {100 * worse[1]:+.0f} %, {100 * worse[2]:+.0f} %).",
            f"Without the spring ({len(bare.structure.names)} parameters) the residual of axis 2 is {own_bare[1]:.1f}"
            f" instead of {mse[1]:.1f} (Nm)^2, and on the 20 points"
            f" {found.validation['model 2 without the spring'][1]:.0f} instead of"
            f" {found.validation['model 2'][1]:.0f}.",
            "A low condition number alone is not enough: it doesn't change when all columns shrink. The trajectory with"
            f" the least one moves axis 1 at half its speed, and its model errs by {slow[0]:.0f} (Nm)^2 there"
            f" ({slow[0] / found.validation['model 2'][0]:.0f} times model 2). Model 1 is therefore from a trajectory"
            f" whose determinant may not exceed 1e{SPRING_FLOOR:.0f} (condition number {one.condition_number:.1f}).",
        ),
        (
            Table(
                (
                    "model",
                    "parameters",
                    "condition number",
                    "residual, axes 1, 2, 3 [(Nm)^2]",
                    "excess over the noise [Nm rms]",
                    "20 points, 10 Hz [(Nm)^2]",
                ),
                rows,
                numeric=(1, 2, 3, 4, 5),
            ),
            Plot(
                torque_figure({"model 2": beside(two, measured_for(two, found.recordings["d-optimal"]))}),
                torque_text({"model 2": beside(two, measured_for(two, found.recordings["d-optimal"]))}),
                "Fig. 4: measured and predicted torque on the c2-optimal trajectory, and the residual.",
            ),
            Plot(
                point_to_point_figure(found.motion, two.robot),
                f"Position of each joint over {found.motion.duration:.1f} s through {len(found.motion.points)} points.",
                "Fig. 5, positions: 20 random points, maximum acceleration, a full stop at each.",
            ),
            Plot(torque_figure(aside), torque_text(aside), "Fig. 5, torques, low-passed at 10 Hz."),
            Plot(
                figures.draws_figure(found.draws, found.joints),
                f"Share by which model 1 errs more: median {_numbers(100 * worse)} % by joint.",
                "Each point a draw of noise and of 20 points. Dashed: the paper's 20 % on axis 1.",
            ),
        ),
        "The printed validation errors are smaller than what one run's noise leaves below 10 Hz (53, 55, 21 (Nm)^2 if"
        " it is white): the motion must have been repeated, as here, 16 times. That model 1 is worse on axis 1 is"
        " confirmed; by how much depends on how slowly its trajectory moves, which the condition number does not see.",
        _again(study, 5, "robot_ident design --validation-motion -o validation.yaml"),
    )


def _missing(study: Study, found: Missing) -> PaperSection:
    first, last = found.steps[0], found.steps[-1]
    measured = measured_for(last.model, found.recordings[-1])
    pair = {"21 parameters": beside(first.model, measured), "with all that was added": beside(last.model, measured)}
    rows = [
        (
            ", ".join(step.added) or "the paper's 21 parameters",
            _numbers(level.mse for level in step.training.values()),
            _numbers(level.excess for level in step.training.values()),
            _numbers(level.mse for level in step.validation.values()),
        )
        for step in found.steps
    ]
    sets = [tuple(labels) for labels in found.said[0].to_dict()["tied_sets"]]
    common = set(sets[0]).intersection(*sets) if sets else set()
    tied = "; or ".join(" and ".join(label for label in labels if label not in common) for labels in sets)
    paragraphs = [
        "Spring, torque offsets and the true friction are hidden from the model. diagnose says: "
        f"{found.said[0].in_words}.",
    ]
    if found.chosen:
        paragraphs.append(
            f"What acts over the position of axis 2 these recordings can't decide alone: either {tied}. A spring can be"
            f" seen on the arm: the set with {SEEN} is taken, and diagnose asked again."
        )
    paragraphs.append(
        f"At the end: {found.said[-1].in_words}. Of {len(found.truth)} effects that the robot has, {len(found.right)}"
        " are in the model" + (f"; wrong: {', '.join(found.wrong)}." if found.wrong else ", and none that it has not.")
    )
    paragraphs.append(f"The truth: {', '.join((*found.truth[: -len(study.real.hidden)], *study.real.hidden))}.")
    return PaperSection(
        "6. What the paper leaves as future work: the loop closes",
        "Better friction models are named as future work; which effect is missing, the paper cannot tell.",
        paragraphs,
        (
            Plot(staircase_figure(found.steps), staircase_text(found.steps)),
            Table(
                (
                    "added",
                    "residual, axes 1, 2, 3 [(Nm)^2]",
                    "excess over the noise [Nm rms]",
                    "20 points, 10 Hz [(Nm)^2]",
                ),
                rows,
                numeric=(1, 2, 3),
            ),
            Plot(
                torque_figure(pair),
                torque_text(pair),
                "Fig. 4 again: the paper's 21 parameters, and the model with all that was added.",
            ),
        ),
        f"The residual falls from {_numbers(level.mse for level in first.training.values())} to"
        f" {_numbers(level.mse for level in last.training.values())} (Nm)^2, the error on the 20 points from"
        f" {_numbers(level.mse for level in first.validation.values())} to"
        f" {_numbers(level.mse for level in last.validation.values())}.",
        _again(
            study,
            6,
            "robot_ident diagnose model.yaml c1_run c2_run --validation validation_run --add-until-adequate",
        ),
    )
