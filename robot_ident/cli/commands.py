"""The commands of `robot_ident`, by what they are for: the help lists them so."""

from __future__ import annotations

import argparse

from robot_ident.cli.output import Parser

DESCRIPTION = (
    "Identify the dynamics of a robot arm from a ROS 2 bag: inertial and friction parameters with uncertainty,"
    " and which physical effect the model still lacks."
)

HINT = "Start with: robot_ident demo. Options of a command: robot_ident COMMAND --help."

GROUPS: dict[str, dict[str, str]] = {
    "Plan": {
        "init": "describe your robot: write a robot YAML from a URDF and a recording, with what is guessed or missing",
        "design": "optimise an excitation trajectory within the robot's limits",
        "check": "check the limits of a motion over continuous time",
    },
    "Record": {
        "simulate": "record a simulated robot, faster than real time",
        "replay": "publish a recording on joint_states with its original timing",
        "info": "show what a recording holds: topics, joints, sample rate, periods, noise",
        "recover": "rewrite a truncated bag as a complete one",
    },
    "Identify": {
        "identify": "estimate the dynamic parameters with their uncertainty",
        "validate": "predict an independent recording and print the residual of each joint",
        "predict": "predict the torque along a motion with its uncertainty",
        "montecarlo": "measure bias and efficiency of the estimator over repeated noise",
    },
    "Diagnose": {
        "compare": "compare a model with recordings: where and by how much the residual exceeds the noise",
        "diagnose": "name the physical effect that the model lacks, with the evidence",
        "add": "add effects to a model and print the error before and after",
        "effects": "list the catalogue of physical effects, or explain one",
        "workbench": "compare, diagnose and extend a model in the browser",
        "report": "write the verdict and its evidence as one HTML page",
    },
    "Hand on": {
        "export": "export a model as physically consistent URDF or MJCF, or as C code for a controller",
    },
    "Learn": {
        "demo": "run the end-to-end example: a simulated KUKA arm and the real ROS 2 nodes",
        "trial": "hide effects in a simulated robot and count how often the diagnosis names them",
    },
}
"""Purpose: command: what it does."""


class Commands(Parser):
    """The parser of the command line's first word, whose help lists the commands under their purposes."""

    def format_help(self) -> str:
        """Return usage, description, the commands and the options."""
        form = self._get_formatter()
        form.add_usage("robot_ident COMMAND [OPTION...]", [], [])
        form.add_text(self.description)
        for title, commands in GROUPS.items():
            form.start_section(title)
            form.add_arguments(argparse.Action([], name, metavar=name, help=text) for name, text in commands.items())
            form.end_section()
        form.start_section("Options")
        form.add_arguments(action for action in self._actions if action.option_strings)
        form.end_section()
        form.add_text(self.epilog)
        return form.format_help()
