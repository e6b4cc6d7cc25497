"""Named tasks: `nox -l` lists them, `nox -s long` runs one. `bash .ci/run` is what a change has to pass."""

import nox

nox.options.sessions = ["tests", "lint"]
nox.options.default_venv_backend = "venv"


@nox.session(python=["3.11", "3.12", "3.13", "3.14"])
def tests(session: nox.Session) -> None:
    """Run the usual tests; arguments go to pytest."""
    session.install(".[test]")
    session.run("pytest", *session.posargs)


@nox.session
def long(session: nox.Session) -> None:
    """Run the tests that take seconds each."""
    session.install(".[test]")
    session.run("pytest", "-m", "long", *session.posargs)


@nox.session
def slow(session: nox.Session) -> None:
    """Run the tests that take minutes each, as before a release."""
    session.install(".[test]")
    session.run("pytest", "-m", "slow", *session.posargs)


@nox.session
def lint(session: nox.Session) -> None:
    """Look at style, types and the order of the rooms."""
    session.install("-e", ".[test,lint]")  # the tests' libraries have the types
    for command in ("ruff check .", "ruff format --check .", "mypy", "lint-imports"):
        session.run(*command.split())


@nox.session
def coverage(session: nox.Session) -> None:
    """Show which lines and branches of the checker no test of it reaches."""
    session.install("-e", ".[test]")
    session.run("pytest", "tests/checker", "-n", "auto", "-m", "not slow", "--cov=persid_check", "--cov-branch",
                "--cov-report=term-missing:skip-covered")  # fmt: skip


@nox.session
def oldest(session: nox.Session) -> None:
    """Run the usual tests with the oldest requirements."""
    session.run("bash", ".ci/oldest", external=True)


@nox.session
def checker(session: nox.Session) -> None:
    """Try the checker with nothing but python-flint."""
    session.run("bash", ".ci/checker", external=True)


@nox.session
def shown(session: nox.Session) -> None:
    """Write again what pages show of the program: numbers, help texts, pictures."""
    session.install("-e", ".[test]")
    session.run("python", "docs/make_all.py", *session.posargs)


@nox.session
def site(session: nox.Session) -> None:
    """Build the site."""
    session.install("-e", ".[docs]")
    session.run("mkdocs", "build", "--strict", env={"NO_MKDOCS_2_WARNING": "1"})
