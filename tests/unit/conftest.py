"""Settings of hypothesis for all tests of this folder."""

from hypothesis import settings

# hypothesis limits an example to 200 ms of wall time; beside other tests, a core may be busy for longer than that.
settings.register_profile("beside others", deadline=None)
settings.load_profile("beside others")
