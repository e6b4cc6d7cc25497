"""The 39-bus, ten-machine grid of New England.

Network, loads and schedule: G. W. Bills et al., On-Line Stability Analysis Study, RP90-1 Report for the Edison Electric
Institute, 1970, as the file case39 of MATPOWER (R. D. Zimmerman, C. E. Murillo-Sanchez and R. J. Thomas, IEEE
Transactions on Power Systems 26, 2011) has them, with its solved power flow. Inertias and transient reactances: M. A.
Pai, Energy Function Analysis for Power System Stability, Kluwer 1989, after T. Athay, R. Podmore and S. Virmani, IEEE
Transactions on Power Apparatus and Systems 98, 1979. Machines are numbered as there: 1, at bus 39, stands for the rest
of the interconnection.
"""

from persid.studies.grid import Case, Line, Machine

_LINES = (
    ((1, 2), 0.0035 + 0.0411j, 0.6987), ((1, 39), 0.001 + 0.025j, 0.75), ((2, 3), 0.0013 + 0.0151j, 0.2572),
    ((2, 25), 0.007 + 0.0086j, 0.146), ((3, 4), 0.0013 + 0.0213j, 0.2214), ((3, 18), 0.0011 + 0.0133j, 0.2138),
    ((4, 5), 0.0008 + 0.0128j, 0.1342), ((4, 14), 0.0008 + 0.0129j, 0.1382), ((5, 6), 0.0002 + 0.0026j, 0.0434),
    ((5, 8), 0.0008 + 0.0112j, 0.1476), ((6, 7), 0.0006 + 0.0092j, 0.113), ((6, 11), 0.0007 + 0.0082j, 0.1389),
    ((7, 8), 0.0004 + 0.0046j, 0.078), ((8, 9), 0.0023 + 0.0363j, 0.3804), ((9, 39), 0.001 + 0.025j, 1.2),
    ((10, 11), 0.0004 + 0.0043j, 0.0729), ((10, 13), 0.0004 + 0.0043j, 0.0729), ((13, 14), 0.0009 + 0.0101j, 0.1723),
    ((14, 15), 0.0018 + 0.0217j, 0.366), ((15, 16), 0.0009 + 0.0094j, 0.171), ((16, 17), 0.0007 + 0.0089j, 0.1342),
    ((16, 19), 0.0016 + 0.0195j, 0.304), ((16, 21), 0.0008 + 0.0135j, 0.2548), ((16, 24), 0.0003 + 0.0059j, 0.068),
    ((17, 18), 0.0007 + 0.0082j, 0.1319), ((17, 27), 0.0013 + 0.0173j, 0.3216), ((21, 22), 0.0008 + 0.014j, 0.2565),
    ((22, 23), 0.0006 + 0.0096j, 0.1846), ((23, 24), 0.0022 + 0.035j, 0.361), ((25, 26), 0.0032 + 0.0323j, 0.531),
    ((26, 27), 0.0014 + 0.0147j, 0.2396), ((26, 28), 0.0043 + 0.0474j, 0.7802), ((26, 29), 0.0057 + 0.0625j, 1.029),
    ((28, 29), 0.0014 + 0.0151j, 0.249),
)  # fmt: skip
_TRANSFORMERS = (  # with their taps, at the first bus
    ((2, 30), 0.0181j, 1.025), ((6, 31), 0.025j, 1.07), ((10, 32), 0.02j, 1.07), ((12, 11), 0.0016 + 0.0435j, 1.006),
    ((12, 13), 0.0016 + 0.0435j, 1.006), ((19, 20), 0.0007 + 0.0138j, 1.06), ((19, 33), 0.0007 + 0.0142j, 1.07),
    ((20, 34), 0.0009 + 0.018j, 1.009), ((22, 35), 0.0143j, 1.025), ((23, 36), 0.0005 + 0.0272j, 1.0),
    ((25, 37), 0.0006 + 0.0232j, 1.025), ((29, 38), 0.0008 + 0.0156j, 1.025),
)  # fmt: skip
_LOADS = {  # by bus, per unit
    1: 0.976 + 0.442j, 3: 3.22 + 0.024j, 4: 5.0 + 1.84j, 7: 2.338 + 0.84j, 8: 5.22 + 1.766j, 9: 0.065 - 0.666j,
    12: 0.0853 + 0.88j, 15: 3.2 + 1.53j, 16: 3.29 + 0.323j, 18: 1.58 + 0.3j, 20: 6.8 + 1.03j, 21: 2.74 + 1.15j,
    23: 2.475 + 0.846j, 24: 3.086 - 0.922j, 25: 2.24 + 0.472j, 26: 1.39 + 0.17j, 27: 2.81 + 0.755j, 28: 2.06 + 0.276j,
    29: 2.835 + 0.269j, 31: 0.092 + 0.046j, 39: 11.04 + 2.5j,
}  # fmt: skip

CASE = Case(
    buses=39,
    lines=(
        *(Line(ends, impedance, charging) for ends, impedance, charging in _LINES),
        *(Line(ends, impedance, ratio=ratio) for ends, impedance, ratio in _TRANSFORMERS),
    ),
    machines=(
        Machine(39, 1.03, 10.0, 500.0, 0.006),
        Machine(31, 0.982, None, 30.3, 0.0697),
        Machine(32, 0.9841, 6.5, 35.8, 0.0531),
        Machine(33, 0.9972, 6.32, 28.6, 0.0436),
        Machine(34, 1.0123, 5.08, 26.0, 0.132),
        Machine(35, 1.0494, 6.5, 34.8, 0.05),
        Machine(36, 1.0636, 5.6, 26.4, 0.049),
        Machine(37, 1.0275, 5.4, 24.3, 0.057),
        Machine(38, 1.0265, 8.3, 34.5, 0.057),
        Machine(30, 1.0499, 2.5, 42.0, 0.031),
    ),
    loads={str(bus): (bus, power) for bus, power in _LOADS.items()},
)
