"""The configuration of a vehicle, as the bridges need it."""

from pathlib import Path

try:
    import tomllib
except ImportError:  # Python 3.10
    import tomli as tomllib


def read_toml(path):
    return tomllib.loads(Path(path).read_text())


def modem_ids(config):
    """Returns the members by their number on the modem, and the vehicle's own number."""
    settings = read_toml(config)
    ids = settings["modem_ids"]
    return ids, next(number for number, name in ids.items() if name == settings["vehicle"])


def own_slots(config):
    """Returns the begin, the period and the duration of the vehicle's slots in seconds, from the team file."""
    settings = read_toml(config)
    slots = read_toml(Path(config).parent / settings["team"])["slots"]
    duration_s, order = slots["duration_s"], slots["order"]
    return slots["start_s"] + order.index(settings["vehicle"]) * duration_s, len(order) * duration_s, duration_s
