"""Settings of all tests."""

from hypothesis import HealthCheck, settings

# The result of a test must not depend on the speed of the machine.
settings.register_profile("any speed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any speed")
