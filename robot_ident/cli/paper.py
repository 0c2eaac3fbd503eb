"""`robot_ident paper`: Swevers et al. (1997) in one command."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from robot_ident.cli.output import print_json, say, tell
from robot_ident.errors import InputError
from robot_ident.files import write_text
from robot_ident.paper.study import Study
from robot_ident.report.page import write_page
from robot_ident.report.paper_experiment import paper_sections
from robot_ident.report.paper_section import as_markdown


def run(args: argparse.Namespace) -> None:
    """Compute the sections and write the page."""
    if len(set(args.section)) < len(args.section):
        raise InputError(f"--section {' '.join(map(str, args.section))}: each once")
    started = time.monotonic()

    def told(what: str) -> None:
        tell(f"[{time.monotonic() - started:4.0f} s] {what}")

    study = Study(args.seed, args.quick, args.redesign, args.printed_table, told)
    sections = paper_sections(study, sorted(args.section))
    how = "designed anew" if args.redesign else "as designed earlier and shipped"
    subtitle = (
        "Swevers, Ganseman, Bilgin Tükel, De Schutter, Van Brussel, IEEE Transactions on Robotics and Automation 13(5),"
        f" 1997. All figures that are not said to be the paper's were computed for this page (seed {args.seed}), on"
        f" trajectories {how}."
    )
    title = "Optimal Robot Excitation and Identification"
    if Path(args.output).suffix == ".md":
        write_text(args.output, as_markdown(title, subtitle, sections), force=args.force)
    else:
        write_page(args.output, title, sections, subtitle=subtitle, force=args.force)
    seconds = time.monotonic() - started
    if args.json:
        data = {"schema": "robot_ident/paper/1", "path": str(args.output), "seconds": seconds, "seed": args.seed}
        print_json({**data, **study.to_dict(sorted(args.section))})
        return
    say(f"written: {args.output} ({seconds:.0f} s); open it in a browser")
