"""The workbench: compare, see, learn, add, watch, in the browser on this machine.

`session` and `tasks` know no web: steps on disk, made by the same calls as the command line's. `server` shows them.
"""
