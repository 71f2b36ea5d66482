"""Settings of all tests."""

from hypothesis import HealthCheck, settings

# No test may depend on the speed of the machine.
settings.register_profile("any speed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any speed")
