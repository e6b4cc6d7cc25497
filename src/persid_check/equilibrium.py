"""stub"""

from fractions import Fraction


def has_unique_equilibrium(model, x, radius, u):
    return False


def prove_equilibrium(model_dict, x, u):
    return None
