"""A second simulator, written apart from the product: nothing here imports robot_ident.

Its arm, servo, noise and formulas of hidden effects are its own, so that what it hides tests the diagnosis against
physics that neither the catalogue nor the product's simulator has seen.
"""
