"""A third simulator: arms of six and seven axes in MuJoCo, whose friction, gears, contacts, tendons, motors and servos
are MuJoCo's own.

`arm`, `effects` and `cases` import neither robot_ident nor its formulas: what they hide is physics that the catalogue
was not written for. `run` alone knows both sides.
"""
