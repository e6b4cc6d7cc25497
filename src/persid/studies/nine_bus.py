"""The nine-bus, three-machine grid of the textbooks.

Data: P. M. Anderson and A. A. Fouad, Power System Control and Stability, Iowa State University Press 1977, figures
2.18 and 2.19 and tables 2.1 and 2.2.
"""

from persid.studies.grid import Case, Line, Machine

CASE = Case(
    buses=9,
    lines=(
        Line((1, 4), 0.0576j), Line((2, 7), 0.0625j), Line((3, 9), 0.0586j),
        Line((4, 5), 0.01 + 0.085j, 0.176), Line((4, 6), 0.017 + 0.092j, 0.158), Line((5, 7), 0.032 + 0.161j, 0.306),
        Line((6, 9), 0.039 + 0.17j, 0.358), Line((7, 8), 0.0085 + 0.072j, 0.149), Line((8, 9), 0.0119 + 0.1008j, 0.209),
    ),
    machines=(
        Machine(1, 1.04, None, 23.64, 0.0608),
        Machine(2, 1.025, 1.63, 6.4, 0.1198),
        Machine(3, 1.025, 0.85, 3.01, 0.1813),
    ),
    loads={"A": (5, 1.25 + 0.5j), "B": (6, 0.9 + 0.3j), "C": (8, 1.0 + 0.35j)},
)  # fmt: skip
