"""`python -m robot_ident`."""

from robot_ident.cli.main import entry

entry()
