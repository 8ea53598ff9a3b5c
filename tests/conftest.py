"""One thread for each test process, and the reasons for which CI may skip a test: any other means that something is missing."""

import os

import pytest

# Set before numpy is loaded, as snakemake does for a job of one thread. Threads of OpenBLAS spin while they wait for each
# other: on cores that are busy with other tests, the spinning costs many times the work itself.
os.environ.setdefault("OMP_NUM_THREADS", "1")

ALLOWED_SKIPS = {
    "needs a CUDA GPU": "the machines of CI have none",
    "there is one": "the opposite case: what happens where there is no GPU",
    "needs SLURM": "its daemons want root, and packages that .ci/run installs where it can",
    "needs ffmpeg with": "Debian's, which .ci/run installs where it can, and which tells what it encodes",
    "no disk can be mounted here": "that wants root, too",
    "needs the Kubernetes executor": "its packages stay apart from the pinned ones; .ci/run fetches them where it can",
    "no axe-core": "npm's registry may be out of reach; .ci/run fetches it where it is not",
    "GSBRIDGE_CAPTURES names no folder": "real captures are not part of the repository",
    "GSBRIDGE_MEASURED names no folder": "real logs are not part of the repository",
}
"""Beginning of each reason, and why nothing can be installed against it."""

_unexpected: list[str] = []


def _reason(report):
    text = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    return text.removeprefix("Skipped: ")


def _note(report):
    if report.skipped and not hasattr(report, "wasxfail"):
        reason = _reason(report)
        if not reason.startswith(tuple(ALLOWED_SKIPS)):
            _unexpected.append(f"{report.nodeid}: {reason}")


def pytest_runtest_logreport(report):
    _note(report)


def pytest_collectreport(report):
    _note(report)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session, exitstatus):
    if os.environ.get("GSBRIDGE_CI") and _unexpected and exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter):
    if os.environ.get("GSBRIDGE_CI") and _unexpected:
        terminalreporter.section("skipped for a reason that tests/conftest.py does not allow")
        for line in _unexpected:
            terminalreporter.write_line(line)
