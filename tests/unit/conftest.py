"""Settings of hypothesis for all tests of this folder."""

from hypothesis import settings

# Its limit of 200 ms is one of the clock: beside other tests a core may be busy for longer, whatever an example takes.
settings.register_profile("beside others", deadline=None)
settings.load_profile("beside others")
