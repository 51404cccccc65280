"""How hard hypothesis looks: `quick` is repeatable and for every day, `--hypothesis-profile search` looks farther."""

from hypothesis import HealthCheck, settings

settings.register_profile(
    'quick', deadline=None, max_examples=60, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile('search', deadline=None, max_examples=5000, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('quick')
