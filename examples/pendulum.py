"""Certify a region of a damped pendulum: how far may it swing, and how hard may it be pushed?

    x1' = x2,   x2' = -sin x1 - 0.5 x2 + u          (x1 in rad, x2 in rad/s, u in rad/s^2)

It rests at every multiple of pi, so no global claim can hold; certify says so with a proof. Inside a box about the
lower position sin x1 has the sign of x1, and a region can be certified.

    python examples/pendulum.py
"""

import numpy as np

import persid as ps

PENDULUM = ps.PersidskiiModel(
    A0=[[0.0, 1.0], [0.0, -0.5]],
    terms=[("sin(x)", [[1.0, 0.0]], [[0.0], [-1.0]])],
    B=[[0.0], [1.0]],
    states=["angle", "speed"],
    inputs=["torque"],
)


def main() -> None:
    """Print the global verdict, and the regional one for boxes |x1| <= r."""
    print(ps.certify(PENDULUM))
    print(f"\n{'r':>4s} {'|torque| <=':>11s} {'angle in':>16s} {'rate 1/s':>9s} {'gain':>6s}")
    for r in (1.0, 2.0, 3.0, 3.1):
        verdict = ps.certify(PENDULUM, domain=[[-r, r], [-3.0 * r, 3.0 * r]])
        if not isinstance(verdict, ps.Certified):
            print(f"{r:4.1f} {verdict}")
            continue
        found = verdict.certificate
        angles = np.linspace(-r, r, 2001)
        inside = angles[found.V(np.stack([angles, 0 * angles], axis=1)) <= found.level]
        reach = f"+-{inside.max():.2f} at rest"
        print(f"{r:4.1f} {found.input_bound:11.3f} {reach:>16s} {found.rate:9.3f} {found.gain:6.2f}")


if __name__ == "__main__":
    main()
